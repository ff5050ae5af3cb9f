//! A frame in two parts: stages before a given one on the CPU, the others on a GPU. If a result is
//! wrong from one stage and right from the next, the first of the two is at fault.
//!
//! # Practice
//! The state is on the CPU. It is uploaded before each part on the GPU and read back after it.

use forelock_core::frame::{
    CHECK, ContactReport, FrameInput, FramePlan, FrameReport, GridReport, PlannedStep, Solver, Step,
};
use forelock_core::groom::edit::Source;
use forelock_core::groom::{Groom, RootFrames};
use forelock_core::interaction::{Interactions, contact, grid};
use forelock_core::pose::Pose;
use forelock_core::simulation::{Simulation, Teleport};
use forelock_core::simulator::{HostPositions, Positions, Simulator, SimulatorError};
use forelock_core::strands::{Between, Model, Snapshot};
use forelock_gpu::{Gpu, GpuError, GpuSimulation, to_frame_report};
use glam::Vec3;

use super::GpuStage;

/// A simulation on the CPU, some stages of which run on a GPU.
#[derive(Debug)]
pub(super) struct Mixed {
    cpu: HostPositions,
    gpu: GpuSimulation,
    /// Stages before this one run on the CPU.
    from: GpuStage,
}

impl Mixed {
    pub(super) fn new(
        gpu: &Gpu,
        from: GpuStage,
        simulation: Simulation,
        interactions: &Interactions,
    ) -> Result<Self, GpuError> {
        let own = GpuSimulation::continuing(gpu, &simulation)?;
        let mut mixed = Self { cpu: HostPositions::new(simulation), gpu: own, from };
        mixed.set_gpu_interactions(interactions)?;
        Ok(mixed)
    }

    /// Sets the interactions that run on the GPU.
    fn set_gpu_interactions(&mut self, interactions: &Interactions) -> Result<(), GpuError> {
        let Interactions { grid, sph, contacts } = interactions.clone();
        self.gpu.set_interactions(&Interactions {
            grid: grid.filter(|_| self.from.is_up_to(grid::EXCHANGE.stage)),
            sph,
            contacts: contacts.filter(|_| self.from.is_up_to(contact::EXCHANGE.stage)),
        })
    }

    fn step_by_step(&mut self, frame: &FrameInput<'_>) -> Result<FrameReport, SimulatorError> {
        let cpu = self.cpu.simulation_mut();
        let plan = cpu.plan_for(frame.dt_secs);
        // Where the plan lacks the stage, the next one that it has.
        let from = plan.stages().into_iter().find(|stage| self.from.is_up_to(stage)).unwrap_or(CHECK);
        let rules = cpu.solver().rules();
        let collides = |own: &&PlannedStep| own.step.collides(rules.solver_collides);
        let last_collision = plan.steps().iter().rfind(collides).map(|own| own.step);
        let mut sum = FrameReport::default();
        for (on_cpu, part) in plan.split_at(from) {
            if on_cpu {
                for step in part {
                    let mut report = cpu.step_part(frame, std::slice::from_ref(step))?;
                    // Contacts are reported from the final collision pass.
                    if Some(step.step) != last_collision {
                        (report.touching, report.max_penetration_m) = (0, 0.0);
                    }
                    sum = sum.and(&report);
                }
                continue;
            }
            self.gpu.restore(&cpu.snapshot())?;
            self.gpu.step_part(frame, part)?;
            let (report, state) = self.gpu.report_and_state()?;
            cpu.state_mut().take(state);
            let mut report = to_frame_report(&report, rules.stage);
            // Interactions outside this part were reported before.
            let has = |name| {
                let is_own = |own: &PlannedStep| matches!(own.step, Step::Exchange { exchange, .. } if exchange.name == name);
                part.iter().any(is_own)
            };
            if !has(grid::EXCHANGE.name) {
                report.grid = GridReport::default();
            }
            if !has(contact::EXCHANGE.name) {
                report.strand_contacts = ContactReport::default();
            }
            sum = sum.and(&report);
        }
        Ok(sum)
    }
}

impl Simulator for Mixed {
    /// After an error the state is that before the frame.
    fn step(&mut self, frame: &FrameInput<'_>) -> Result<FrameReport, SimulatorError> {
        let before = self.cpu.snapshot()?;
        let stepped = self.step_by_step(frame);
        if stepped.is_err() {
            self.cpu.restore(&before)?;
        }
        stepped
    }

    fn positions(&mut self) -> Result<Positions<'_>, SimulatorError> {
        self.cpu.positions()
    }

    fn read_positions(&mut self, out: &mut Vec<Vec3>) -> Result<(), SimulatorError> {
        self.cpu.read_positions(out)
    }

    fn read_positions_between(
        &mut self,
        moment: &Between,
        out: &mut Vec<Vec3>,
    ) -> Result<(), SimulatorError> {
        self.cpu.read_positions_between(moment, out)
    }

    fn snapshot(&mut self) -> Result<Snapshot<f32>, SimulatorError> {
        self.cpu.snapshot()
    }

    fn restore(&mut self, snapshot: &Snapshot<f32>) -> Result<(), SimulatorError> {
        self.cpu.restore(snapshot)
    }

    fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) -> Result<(), SimulatorError> {
        self.cpu.teleport(from, to, mode)
    }

    fn rest_on(&mut self, head: &Pose, frames: &RootFrames) -> Result<(), SimulatorError> {
        self.cpu.rest_on(head, frames)
    }

    fn forget_solids(&mut self) -> Result<(), SimulatorError> {
        self.cpu.forget_solids()
    }

    fn set_params(&mut self, solver: &Solver<f32>) -> Result<(), SimulatorError> {
        self.cpu.set_params(solver)?;
        Ok(self.gpu.set_params(solver)?)
    }

    /// Frames that are run in parts do not sleep.
    fn set_sleep_speed(&mut self, _: f64) {}

    fn set_interactions(&mut self, interactions: &Interactions) -> Result<(), SimulatorError> {
        self.cpu.set_interactions(interactions)?;
        Ok(self.set_gpu_interactions(interactions)?)
    }

    fn regroom(&mut self, groom: &Groom, sources: &[Source], head: &Pose) -> Result<(), SimulatorError> {
        self.cpu.regroom(groom, sources, head)?;
        Ok(self.gpu.regroom(groom, sources, head)?)
    }

    fn device(&self) -> Option<&str> {
        self.gpu.device()
    }

    fn plan(&self) -> &FramePlan {
        self.cpu.plan()
    }

    fn model(&self) -> &Model<f32> {
        self.cpu.model()
    }

    fn bytes(&self) -> u64 {
        self.cpu.bytes() + GpuSimulation::bytes(&self.gpu)
    }
}
