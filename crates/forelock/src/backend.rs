//! Where a run computes.
//!
//! # Practice
//! On a GPU each frame is stepped there, and its state is read back into a simulation on the CPU:
//! positions, snapshots and hashes come from that. A snapshot of one continues on the other; bits
//! are equal on the same device only.

use std::sync::LazyLock;

use forelock_core::body::ColliderFrame;
use forelock_core::frame::{
    CHECK, COLLIDE, ContactReport, Exchange, FrameInput, FramePlan, FrameReport, GridReport, LENGTHS, Phase,
    PlannedStep, Step,
};
use forelock_core::interaction::contact::{self, ContactParams};
use forelock_core::interaction::grid::{self, GridParams};
use forelock_core::interaction::sph::{self, SphParams};
use forelock_core::simulation::Simulation;
use forelock_gpu::{Choice, Gpu, GpuError, GpuSimulation, to_frame_report};

use crate::player::PlayerError;
use crate::scene::{InteractionKind, InteractionSection, SolverSection};

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

/// A stage from which on a run can be on a GPU, by its name in reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuStage(&'static str);

impl GpuStage {
    /// All of them, in the order of a frame: those of the built-in solvers and interactions, and
    /// those that all frames share. Stages that run together are named by their first.
    pub fn all() -> &'static [Self] {
        static ALL: LazyLock<Vec<GpuStage>> = LazyLock::new(|| {
            let mut interactions = [grid::EXCHANGE, sph::EXCHANGE, contact::EXCHANGE];
            interactions.sort_by_key(|own| own.phase);
            let (before, after): (Vec<Exchange>, Vec<Exchange>) =
                interactions.into_iter().partition(|own| own.phase == Phase::BeforeStrands);
            let mut names: Vec<&str> = before.iter().map(|own| own.stage).collect();
            for own in SolverSection::default().built_in() {
                let stage = own.solver.rules().stage;
                // Solvers may share a stage.
                if !names.contains(&stage) {
                    names.push(stage);
                }
            }
            names.extend([COLLIDE, LENGTHS]);
            names.extend(after.iter().map(|own| own.stage));
            names.push(CHECK);
            names.into_iter().map(GpuStage).collect()
        });
        &ALL
    }

    /// Its name, as reports have it.
    pub fn name(self) -> &'static str {
        self.0
    }

    /// Whether every stage of a frame is this one or comes after it.
    fn is_first(self) -> bool {
        self == Self::all()[0]
    }

    /// Whether it is stage `name` or comes before it.
    fn is_up_to(self, name: &str) -> bool {
        let place = |name: &str| Self::all().iter().position(|own| own.0 == name);
        place(self.0) <= place(name)
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
        let from = if let Self::GpuFrom(stage) = self { stage } else { GpuStage::all()[0] };
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
    sph: Option<SphParams>,
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
            sph: None,
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
        self.sph = (*kind == InteractionKind::Sph).then(|| sph.clone());
        self.contacts = contacts.then(|| contact.clone());
    }

    fn simulation_mut(&mut self) -> Result<&mut GpuSimulation, GpuError> {
        let name = self.gpu.name();
        let reason = "it has no simulation after an error".to_owned();
        self.simulation.as_mut().ok_or_else(|| GpuError::Failed { name: name.to_owned(), reason })
    }

    /// Whether the plan of frames lacks the stage from which on the device computes.
    fn passes_over(&self, simulation: &Simulation) -> bool {
        let rules = simulation.solver().rules();
        let grid = self.grid.as_ref().map(|_| grid::EXCHANGE);
        let sph = self.sph.as_ref().map(|_| sph::EXCHANGE);
        let contacts = self.contacts.as_ref().map(|_| contact::EXCHANGE);
        let interactions: Vec<_> = [grid, sph, contacts].into_iter().flatten().collect();
        !FramePlan::new(&rules, &interactions).stages().contains(&self.from.name())
    }

    /// The GPU's name.
    pub(crate) fn name(&self) -> &str {
        self.gpu.name()
    }

    /// Whether some stages run on the CPU.
    pub(crate) fn is_mixed(&self) -> bool {
        !self.from.is_first()
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
        own.set_grid(self.grid.as_ref().filter(|_| self.from.is_up_to(grid::EXCHANGE.stage)))?;
        own.set_sph(self.sph.as_ref())?;
        own.set_contacts(self.contacts.as_ref().filter(|_| self.from.is_up_to(contact::EXCHANGE.stage)))?;
        own.time_stages(true);
        self.simulation = Some(own);
        Ok(())
    }

    /// Steps a frame, and brings the state to `simulation`.
    pub(crate) fn step(
        &mut self,
        frame: &FrameInput<'_>,
        simulation: &mut Simulation,
    ) -> Result<FrameReport, PlayerError> {
        if self.is_mixed() {
            return self.step_mixed(frame, simulation);
        }
        let own = self.simulation_mut()?;
        own.step_frame(frame)?;
        let (report, state) = own.report_and_state()?;
        simulation.state_mut().take(state);
        self.frame_secs = report.secs.as_ref().map(|secs| secs.whole);
        Ok(to_frame_report(&report, simulation.solver().rules().stage))
    }

    /// Steps a frame, some of it on `simulation`: the state goes to and fro. After an error the
    /// simulation is where it was before the frame.
    fn step_mixed(
        &mut self,
        frame: &FrameInput<'_>,
        simulation: &mut Simulation,
    ) -> Result<FrameReport, PlayerError> {
        let before = simulation.snapshot();
        let stepped = self.step_by_step(frame, simulation);
        if stepped.is_err() {
            simulation.restore(&before)?;
        }
        stepped
    }

    fn step_by_step(
        &mut self,
        frame: &FrameInput<'_>,
        simulation: &mut Simulation,
    ) -> Result<FrameReport, PlayerError> {
        let plan = simulation.plan().clone();
        // Where the plan lacks the stage, the next one that it has.
        let from = plan.stages().into_iter().find(|stage| self.from.is_up_to(stage)).unwrap_or(CHECK);
        let own = self.simulation_mut()?;
        let rules = simulation.solver().rules();
        let collides = |own: &&PlannedStep| own.step.collides(rules.solver_collides);
        let last_collision = plan.steps().iter().rfind(collides).map(|own| own.step);
        let mut sum = FrameReport::default();
        for (on_cpu, part) in plan.split_at(from) {
            if !on_cpu {
                own.step_part(frame, part)?;
                let (report, state) = own.report_and_state()?;
                simulation.state_mut().take(state);
                let mut report = to_frame_report(&report, rules.stage);
                // Interactions outside this part were reported before.
                let has =
                    |name| part.iter().any(|own| matches!(own.step, Step::Exchange(own) if own.name == name));
                if !has(grid::EXCHANGE.name) {
                    report.grid = GridReport::default();
                }
                if !has(contact::EXCHANGE.name) {
                    report.strand_contacts = ContactReport::default();
                }
                sum = sum.and(&report);
                continue;
            }
            for step in part {
                let mut report = simulation.step_part(frame, std::slice::from_ref(step))?;
                // Contacts are reported from the final collision pass.
                if Some(step.step) != last_collision {
                    (report.touching, report.max_penetration_m) = (0, 0.0);
                }
                sum = sum.and(&report);
            }
            own.restore(&simulation.snapshot())?;
        }
        Ok(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_in_the_order_of_a_frame() {
        let names: Vec<_> = GpuStage::all().iter().map(|stage| stage.name()).collect();
        let expected = [
            "find_neighbours",
            "solve_strands",
            "follow_leader",
            "resolve_solids",
            "restore_lengths",
            "splat_segments",
            "find_contacts",
            "check_strands",
        ];
        assert_eq!(names, expected);
    }
}
