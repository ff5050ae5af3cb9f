//! Where a run computes.
//!
//! # Practice
//! On a GPU each frame is stepped there, and its state brought to a simulation on the CPU that stands for it: positions, snapshots and hashes are read from that. A snapshot of one goes on on
//! the other; bits are the same only on the same device.

use forelock_core::air::WindField;
use forelock_core::frame::{Frame, FrameReport, FrameStep, Meeting, STAGES};
use forelock_core::interaction::contact::{ContactParams, ContactReport};
use forelock_core::interaction::grid::{GridParams, GridReport};
use forelock_core::interaction::sph::{SphParams, SphReport};
use forelock_core::simulation::Simulation;
use forelock_gpu::{Choice, Gpu, GpuError, GpuReport, GpuSimulation};

use crate::assets::Assets;
use crate::run::RunError;
use crate::scene::{InteractionKind, Scene};

/// Where to compute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// On this processor.
    #[default]
    Cpu,
    /// On a graphics processor; an error where there is none, or where it cannot do what the scene asks for.
    Gpu,
    /// On a graphics processor if there is one that can do what the scene asks for, else on this one.
    Auto,
    /// On a graphics processor, but for the stages before this one, wherever they come in the frame: if a result is wrong with one stage and right with the next, the first of the two is at fault.
    GpuFrom(GpuStage),
}

/// A stage from which on a run can be on a GPU, in the order of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum GpuStage {
    /// All of them: smoothed particles come first.
    FindNeighbours,
    /// The strand solve.
    SolveStrands,
    /// Follow the leader, solids included.
    FollowLeader,
    /// Hair against solids.
    ResolveSolids,
    /// Edges back to their lengths.
    RestoreLengths,
    /// Hair on the grid, whose three stages go together.
    SplatSegments,
    /// Contacts between strands, found and resolved together.
    FindContacts,
    /// Nothing but the last.
    CheckStrands,
}

impl GpuStage {
    /// All of them, in their order.
    pub const ALL: [Self; 8] = [
        Self::FindNeighbours,
        Self::SolveStrands,
        Self::FollowLeader,
        Self::ResolveSolids,
        Self::RestoreLengths,
        Self::SplatSegments,
        Self::FindContacts,
        Self::CheckStrands,
    ];

    /// Its name, as reports have it.
    pub fn name(self) -> &'static str {
        let step = match self {
            Self::FindNeighbours => FrameStep::Particles,
            Self::SolveStrands => FrameStep::SolveStrands(0),
            Self::FollowLeader => FrameStep::FollowLeader,
            Self::ResolveSolids => FrameStep::LastSolids,
            Self::RestoreLengths => FrameStep::RestoreLengths,
            Self::SplatSegments => FrameStep::Grid,
            Self::FindContacts => FrameStep::Contacts,
            Self::CheckStrands => FrameStep::CheckStrands,
        };
        step.stage()
    }

    /// Whether `step` comes before it.
    fn is_after(self, step: FrameStep) -> bool {
        Self::ALL.into_iter().take_while(|stage| *stage < self).any(|stage| stage.name() == step.stage())
    }
}

impl Backend {
    /// The device of `scene` on which `simulation` goes on, none for the CPU, and what is worth telling about the choice.
    pub(crate) fn device(
        self,
        (scene, assets): (&Scene, &Assets),
        simulation: &Simulation,
    ) -> Result<(Option<Device>, Option<String>), RunError> {
        if self == Self::Cpu {
            return Ok((None, None));
        }
        let from = if let Self::GpuFrom(stage) = self { stage } else { GpuStage::FindNeighbours };
        match Device::open((scene, assets), simulation, (from, self != Self::Auto)) {
            Ok(device) => {
                let note = (device.is_mixed() && device.passes_over(simulation)).then(|| {
                    let name = from.name();
                    format!("no frame of this scene has {name}: what would come after it is on the GPU")
                });
                Ok((Some(device), note))
            }
            Err(error) if self == Self::Auto => Ok((None, Some(format!("on the CPU: {error}")))),
            Err(error) => Err(error.into()),
        }
    }
}

/// A simulation on a GPU.
#[derive(Debug)]
pub(crate) struct Device {
    gpu: Gpu,
    grid: Option<GridParams>,
    particles: Option<SphParams>,
    contacts: Option<ContactParams>,
    /// Stages before this one run on the CPU.
    from: GpuStage,
    /// None only after an error.
    simulation: Option<GpuSimulation>,
    /// What the last frame took by its own clock, if it has one.
    pub(crate) frame_secs: Option<f64>,
}

impl Device {
    /// On a processor that plays a GPU only if `software` will do: it is slower than itself.
    fn open(
        (scene, assets): (&Scene, &Assets),
        simulation: &Simulation,
        (from, software): (GpuStage, bool),
    ) -> Result<Self, GpuError> {
        let gpu = Gpu::open(&Choice::Fastest)?;
        if gpu.is_software() && !software {
            return Err(GpuError::None { reason: format!("{} is software", gpu.name()) });
        }
        let meets = scene.interaction.kind == InteractionKind::Grid;
        let grid = meets.then(|| scene.interaction.grid.clone());
        let particles = scene.interaction.kind == InteractionKind::Sph;
        let particles = particles.then(|| scene.interaction.sph.clone());
        let contacts = scene.interaction.contacts.then(|| scene.interaction.contact.clone());
        let mut own = Self { simulation: None, gpu, grid, particles, contacts, from, frame_secs: None };
        own.begin_anew(simulation)?;
        let times = [0.0, 1.0 / scene.time.fps];
        own.own()?.hold(&assets.collider_frames(times, times.map(|time| assets.head_pose(time))))?;
        Ok(own)
    }

    fn own(&mut self) -> Result<&mut GpuSimulation, GpuError> {
        let name = self.gpu.name();
        let reason = "it has no simulation after an error".to_owned();
        self.simulation.as_mut().ok_or_else(|| GpuError::Failed { name: name.to_owned(), reason })
    }

    /// Whether frames lack the first stage that is asked of the device.
    fn passes_over(&self, simulation: &Simulation) -> bool {
        let meeting = Meeting {
            grid: self.grid.is_some(),
            particles: self.particles.is_some(),
            contacts: self.contacts.is_some(),
        };
        !FrameStep::all(simulation.params(), meeting).any(|step| step.stage() == self.from.name())
    }

    /// The GPU's name.
    pub(crate) fn name(&self) -> &str {
        self.gpu.name()
    }

    /// Whether some stages run on the CPU.
    pub(crate) fn is_mixed(&self) -> bool {
        self.from > GpuStage::FindNeighbours
    }

    /// Bytes held on it.
    pub(crate) fn bytes(&self) -> u64 {
        self.simulation.as_ref().map_or(0, GpuSimulation::bytes)
    }

    /// Takes the state of `simulation` over.
    pub(crate) fn take(&mut self, simulation: &Simulation) -> Result<(), GpuError> {
        self.own()?.restore(&simulation.snapshot())
    }

    /// Goes on with `simulation`, whose strands are other ones now. What there was goes first, for there may not be room for both.
    pub(crate) fn begin_anew(&mut self, simulation: &Simulation) -> Result<(), GpuError> {
        self.simulation = None;
        let mut own = GpuSimulation::continuing(&self.gpu, simulation)?;
        // What the CPU does is not asked of the device.
        own.set_grid(self.grid.as_ref().filter(|_| self.from <= GpuStage::SplatSegments))?;
        own.set_sph(self.particles.as_ref())?;
        own.set_contacts(self.contacts.as_ref().filter(|_| self.from <= GpuStage::FindContacts))?;
        own.time_stages(true);
        self.simulation = Some(own);
        Ok(())
    }

    /// Steps a frame, and brings the state to `simulation`.
    pub(crate) fn step(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        simulation: &mut Simulation,
    ) -> Result<FrameReport, RunError> {
        if self.is_mixed() {
            return self.step_mixed(frame, wind, simulation);
        }
        let own = self.own()?;
        own.step_frame_in(frame, wind)?;
        let (report, state) = own.report_and_state()?;
        simulation.state_mut().take(state);
        self.frame_secs = report.secs.as_ref().map(|secs| secs.whole);
        Ok(told(&report))
    }

    /// Steps a frame, some of it on `simulation`: the state goes to and fro. After an error the simulation is where it was before the frame.
    fn step_mixed(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        simulation: &mut Simulation,
    ) -> Result<FrameReport, RunError> {
        let before = simulation.snapshot();
        let stepped = self.step_by_step(frame, wind, simulation);
        if stepped.is_err() {
            simulation.restore(&before)?;
        }
        stepped
    }

    fn step_by_step(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        simulation: &mut Simulation,
    ) -> Result<FrameReport, RunError> {
        let from = self.from;
        let own = self.own()?;
        let steps: Vec<_> = FrameStep::all(simulation.params(), simulation.meeting()).collect();
        let looks = |step: &FrameStep| {
            use FrameStep::{FollowLeader, LastSolids, ResolveSolids};
            matches!(step, ResolveSolids(_) | FollowLeader | LastSolids)
        };
        let last_look = steps.iter().rfind(|step| looks(step)).copied();
        let mut sum = FrameReport::default();
        for part in steps.chunk_by(|a, b| from.is_after(*a) == from.is_after(*b)) {
            if !from.is_after(part[0]) {
                own.step_part(frame, wind, part)?;
                let (report, state) = own.report_and_state()?;
                simulation.state_mut().take(state);
                let mut report = told(&report);
                // What meets in no step of this part was told before.
                if !part.contains(&FrameStep::Grid) {
                    report.grid = GridReport::default();
                }
                if !part.contains(&FrameStep::Contacts) {
                    report.strand_contacts = ContactReport::default();
                }
                sum = sum.and(&report);
                continue;
            }
            for step in part {
                let mut report = simulation.step_part(frame, wind, *step)?;
                // Solids have their word at the last look.
                if Some(*step) != last_look {
                    (report.touching, report.max_penetration_m) = (0, 0.0);
                }
                sum = sum.and(&report);
            }
            own.restore(&simulation.snapshot())?;
        }
        Ok(sum)
    }
}

/// What a GPU tells of a frame, as the CPU tells it.
fn told(report: &GpuReport) -> FrameReport {
    let stages = report.secs.iter().flat_map(|secs| &secs.stages);
    let ran = |name: &str| stages.clone().any(|(own, secs)| *own == name && *secs > 0.0);
    let follows = ran("follow_leader");
    FrameReport {
        max_edge_stretch: report.max_edge_stretch.into(),
        max_edge_stretch_final: report.max_edge_stretch_final.into(),
        max_penetration_m: report.max_penetration_m.into(),
        touching: report.touching,
        quarantined_strands: report.quarantined_strands,
        grid: report.grid.unwrap_or_default(),
        strand_contacts: report.strand_contacts.unwrap_or_default(),
        particles: SphReport::default(),
        stage_secs: STAGES.map(|name| {
            // On the CPU the air is sampled by the stage that it is for.
            let blown = if follows { "follow_leader" } else { "solve_strands" };
            let is_of = |own: &str| own == name || (own == "sample_air" && name == blown);
            let secs = stages.clone().filter(|(own, _)| is_of(own));
            (name, secs.map(|(_, secs)| *secs).sum())
        }),
    }
}
