//! Where a run computes.
//!
//! # Practice
//! On a GPU each frame is stepped there, and its state is read back into a simulation on the CPU:
//! positions, snapshots and hashes come from that. A snapshot of one continues on the other; bits
//! are equal on the same device only.

use forelock_core::air::WindField;
use forelock_core::body::ColliderFrame;
use forelock_core::contact::{ContactParams, ContactReport};
use forelock_core::grid::{GridParams, GridReport};
use forelock_core::solver::{Frame, FrameReport, FrameStep, Meeting, STAGES, Simulation};
use forelock_core::sph::{SphParams, SphReport};
use forelock_gpu::{Choice, Gpu, GpuError, GpuReport, GpuSimulation};

use crate::player::PlayerError;
use crate::scene::{InteractionKind, InteractionSection};

/// Where to compute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// On this processor.
    #[default]
    Cpu,
    /// On a graphics processor; an error where there is none, or where it cannot do what the scene
    /// asks for.
    Gpu,
    /// On a graphics processor if there is one that can do what the scene asks for, else on this
    /// one.
    Auto,
    /// On a graphics processor, but for the stages before this one, wherever they come in the
    /// frame: if a result is wrong with one stage and right with the next, the first of the two is
    /// at fault.
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

/// What a scene asks of a device.
#[derive(Clone, Copy)]
pub(crate) struct DeviceNeeds<'a> {
    pub(crate) interaction: &'a InteractionSection,
    /// The solids of the first frame.
    pub(crate) solids: &'a [ColliderFrame<'a>],
}

/// Where a simulation runs.
#[derive(Debug, Default)]
pub(crate) struct Placed {
    /// The device; none for the CPU.
    pub(crate) device: Option<Device>,
    /// What the user should know about the choice.
    pub(crate) note: Option<String>,
}

impl Backend {
    /// The device that continues `simulation`.
    pub(crate) fn place(
        self,
        needs: DeviceNeeds<'_>,
        simulation: &Simulation,
    ) -> Result<Placed, PlayerError> {
        if self == Self::Cpu {
            return Ok(Placed::default());
        }
        let from = if let Self::GpuFrom(stage) = self { stage } else { GpuStage::FindNeighbours };
        let chosen = Chosen { from, software: self != Self::Auto };
        match Device::open(chosen, needs, simulation) {
            Ok(device) => {
                let note = (device.is_mixed() && device.passes_over(simulation)).then(|| {
                    let name = from.name();
                    format!("no frame of this scene has {name}: what would come after it is on the GPU")
                });
                Ok(Placed { device: Some(device), note })
            }
            Err(error) if self == Self::Auto => {
                Ok(Placed { device: None, note: Some(format!("on the CPU: {error}")) })
            }
            Err(error) => Err(error.into()),
        }
    }
}

/// Which device, and what runs on it.
struct Chosen {
    /// Stages before this one run on the CPU.
    from: GpuStage,
    /// Whether a processor that emulates a GPU will do: it is slower than the CPU's solver.
    software: bool,
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
    /// Seconds of the last frame on the device's clock, if it has one.
    pub(crate) frame_secs: Option<f64>,
}

impl Device {
    fn open(chosen: Chosen, needs: DeviceNeeds<'_>, simulation: &Simulation) -> Result<Self, GpuError> {
        let gpu = Gpu::open(&Choice::Fastest)?;
        if gpu.is_software() && !chosen.software {
            return Err(GpuError::None { reason: format!("{} is software", gpu.name()) });
        }
        let mut device = Self {
            simulation: None,
            gpu,
            grid: None,
            particles: None,
            contacts: None,
            from: chosen.from,
            frame_secs: None,
        };
        device.set_interaction(needs.interaction);
        device.rebuild(simulation)?;
        device.simulation_mut()?.hold(needs.solids)?;
        Ok(device)
    }

    /// Changes the interaction of strands from the next [`Device::rebuild`] on.
    pub(crate) fn set_interaction(&mut self, section: &InteractionSection) {
        let InteractionSection { kind, grid, sph, contacts, contact } = section;
        self.grid = (*kind == InteractionKind::Grid).then(|| grid.clone());
        self.particles = (*kind == InteractionKind::Sph).then(|| sph.clone());
        self.contacts = contacts.then(|| contact.clone());
    }

    fn simulation_mut(&mut self) -> Result<&mut GpuSimulation, GpuError> {
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
        self.simulation_mut()?.restore(&simulation.snapshot())
    }

    /// Continues `simulation`, whose strands or parameters have changed. The old simulation is
    /// dropped first: there may not be room for both.
    pub(crate) fn rebuild(&mut self, simulation: &Simulation) -> Result<(), GpuError> {
        self.simulation = None;
        let mut own = GpuSimulation::continuing(&self.gpu, simulation)?;
        // What the CPU does is not asked of the device.
        own.set_grid(self.grid.as_ref().filter(|_| self.from <= GpuStage::SplatSegments))?;
        own.set_particles(self.particles.as_ref())?;
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
    ) -> Result<FrameReport, PlayerError> {
        if self.is_mixed() {
            return self.step_mixed(frame, wind, simulation);
        }
        let own = self.simulation_mut()?;
        own.step_frame_in(frame, wind)?;
        let (report, state) = own.report_and_state()?;
        simulation.state_mut().take(state);
        self.frame_secs = report.secs.map(|secs| secs.whole);
        Ok(to_report(&report))
    }

    /// Steps a frame, some of it on `simulation`: the state goes to and fro. After an error the
    /// simulation is where it was before the frame.
    fn step_mixed(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        simulation: &mut Simulation,
    ) -> Result<FrameReport, PlayerError> {
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
    ) -> Result<FrameReport, PlayerError> {
        let from = self.from;
        let own = self.simulation_mut()?;
        let steps: Vec<_> = FrameStep::all(simulation.params(), simulation.meeting()).collect();
        let collides = |step: &FrameStep| {
            use FrameStep::{FollowLeader, LastSolids, ResolveSolids};
            matches!(step, ResolveSolids(_) | FollowLeader | LastSolids)
        };
        let last_collision = steps.iter().rfind(|step| collides(step)).copied();
        let mut sum = FrameReport::default();
        for part in steps.chunk_by(|a, b| from.is_after(*a) == from.is_after(*b)) {
            if !from.is_after(part[0]) {
                own.step_part(frame, wind, part)?;
                let (report, state) = own.report_and_state()?;
                simulation.state_mut().take(state);
                let mut report = to_report(&report);
                // Interactions outside this part were reported before.
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
                // Contacts are reported from the final collision pass.
                if Some(*step) != last_collision {
                    (report.touching, report.max_penetration_m) = (0, 0.0);
                }
                sum = sum.and(&report);
            }
            own.restore(&simulation.snapshot())?;
        }
        Ok(sum)
    }
}

/// The report of a GPU in the form of the CPU's.
fn to_report(report: &GpuReport) -> FrameReport {
    let stages = report.secs.map(|secs| secs.stages);
    let ran = |name: &str| stages.iter().flatten().any(|(own, secs)| *own == name && *secs > 0.0);
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
            let secs = stages.iter().flatten().filter(|(own, _)| is_of(own));
            (name, secs.map(|(_, secs)| *secs).sum())
        }),
    }
}
