//! Where a run computes.
//!
//! # Practice
//! [`Place::simulator`] makes the simulator of a run: on the CPU, on a GPU, whose state stays
//! there, or a mixture that runs some stages on each (`mixed.rs`). A snapshot of one continues on
//! the other; bits are equal on the same device only.

mod mixed;

use std::sync::{Arc, LazyLock};

use forelock_core::body::ColliderFrame;
use forelock_core::frame::{CHECK, COLLIDE, LENGTHS, Phase};
use forelock_core::groom::Groom;
use forelock_core::interaction::{Interactions, contact, grid, sph};
use forelock_core::simulation::{BuildError, Options, Simulation, check_memory};
use forelock_core::simulator::{HostPositions, Simulator};
use forelock_core::solver::Solver;
use forelock_gpu::{Choice, Gpu, GpuError, GpuSimulation};

use crate::neural::{Learned, NeuralError, NeuralSimulator, OnGpu};
use crate::player::PlayerError;
use crate::scene::SolverSection;
use mixed::Mixed;

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
            let mut interactions = [grid::EXCHANGE, sph::EXCHANGE, contact::FRICTION, contact::EXCHANGE];
            interactions.sort_by_key(|own| own.phase);
            let stages = |is_of: fn(Phase) -> bool| {
                interactions.iter().filter(move |own| is_of(own.phase)).map(|own| own.stage)
            };
            let mut names: Vec<&str> = stages(|phase| phase == Phase::BeforeStrands).collect();
            for own in SolverSection::default().built_in() {
                let stage = own.solver.rules().stage;
                // Solvers may share a stage.
                if !names.contains(&stage) {
                    names.push(stage);
                }
            }
            names.push(COLLIDE);
            names.extend(stages(|phase| matches!(phase, Phase::BeforeLengths(_))));
            names.push(LENGTHS);
            names.extend(stages(|phase| phase > Phase::BeforeLengths(u8::MAX)));
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

/// What a simulation is built from.
pub(crate) struct Parts<'a> {
    pub(crate) solver: &'a Solver<f32>,
    pub(crate) interactions: Interactions,
    /// The trained model that moves the strands, if one does.
    pub(crate) learned: Option<&'a Arc<Learned>>,
}

/// The processor that a run has chosen.
#[derive(Debug)]
pub(crate) enum Place {
    Cpu,
    /// Stages before `from` run on the CPU.
    Gpu {
        gpu: Gpu,
        from: GpuStage,
    },
}

/// A simulator, where it runs, and what the user should know about that choice.
pub(crate) struct Placed {
    pub(crate) simulator: Box<dyn Simulator>,
    pub(crate) place: Place,
    pub(crate) note: Option<String>,
}

impl Backend {
    /// The simulator of `groom` on this backend, ready for `solids` as the colliders of its first
    /// frame. A GPU is `own`, or the fastest.
    pub(crate) fn place(
        self,
        own: Option<Gpu>,
        groom: &Groom,
        parts: &Parts<'_>,
        options: &Options,
        solids: &[ColliderFrame<'_>],
    ) -> Result<Placed, PlayerError> {
        let mut note = None;
        if self != Self::Cpu {
            match self.on_gpu(own, groom, parts, options, solids) {
                Ok(placed) => return Ok(placed),
                Err(PlayerError::Gpu(error)) if self == Self::Auto => {
                    note = Some(format!("on the CPU: {error}"));
                }
                Err(error) => return Err(error),
            }
        }
        let place = Place::Cpu;
        Ok(Placed { simulator: place.simulator(groom, parts, options, &[])?, place, note })
    }

    fn on_gpu(
        self,
        own: Option<Gpu>,
        groom: &Groom,
        parts: &Parts<'_>,
        options: &Options,
        solids: &[ColliderFrame<'_>],
    ) -> Result<Placed, PlayerError> {
        let from = if let Self::GpuFrom(stage) = self { stage } else { GpuStage::all()[0] };
        if parts.learned.is_some() && !from.is_first() {
            return Err(NeuralError::GpuFrom.into());
        }
        let gpu = own.map_or_else(|| Gpu::open(&Choice::Fastest), Ok)?;
        // A processor that emulates a GPU is slower than the solver on the CPU.
        if gpu.is_software() && self == Self::Auto {
            return Err(GpuError::None { reason: format!("{} is software", gpu.name()) }.into());
        }
        let place = Place::Gpu { gpu, from };
        let simulator = place.simulator(groom, parts, options, solids)?;
        let passed_over = !from.is_first() && !simulator.plan().stages().contains(&from.name());
        let note = passed_over.then(|| {
            let name = from.name();
            format!("no frame of this scene has {name}: what would come after it is on the GPU")
        });
        Ok(Placed { simulator, place, note })
    }
}

impl Place {
    /// A simulator of `groom` at rest, ready for `solids` as colliders.
    pub(crate) fn simulator(
        &self,
        groom: &Groom,
        parts: &Parts<'_>,
        options: &Options,
        solids: &[ColliderFrame<'_>],
    ) -> Result<Box<dyn Simulator>, PlayerError> {
        let Parts { solver, interactions, learned } = parts;
        if let Some(learned) = learned {
            check_memory(groom.particle_count() as u64, &Interactions::default())
                .map_err(BuildError::from)?;
            let on = match self {
                Self::Cpu => None,
                Self::Gpu { gpu, .. } => Some(OnGpu { gpu, solids }),
            };
            return Ok(Box::new(NeuralSimulator::new(groom, solver, learned, options, on)?));
        }
        check_memory(groom.particle_count() as u64, interactions).map_err(BuildError::from)?;
        let solver = *solver;
        let on_cpu = || -> Result<Simulation, PlayerError> {
            let mut simulation = Simulation::new(groom, solver, options)?;
            simulation.set_interactions(interactions)?;
            Ok(simulation)
        };
        match self {
            Self::Cpu => Ok(Box::new(HostPositions::new(on_cpu()?))),
            Self::Gpu { gpu, from } if from.is_first() => {
                let mut simulation = GpuSimulation::new(gpu, groom, solver, options)?;
                simulation.set_interactions(interactions)?;
                simulation.hold(solids)?;
                simulation.time_stages(true);
                Ok(Box::new(simulation))
            }
            Self::Gpu { gpu, from } => Ok(Box::new(Mixed::new(gpu, *from, on_cpu()?, interactions)?)),
        }
    }

    /// Whether everything runs on the CPU.
    pub(crate) fn is_cpu(&self) -> bool {
        matches!(self, Self::Cpu)
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
            "solve_rods",
            "resolve_solids",
            "splat_segments",
            "hold_hair",
            "restore_lengths",
            "find_contacts",
            "check_strands",
        ];
        assert_eq!(names, expected);
    }
}
