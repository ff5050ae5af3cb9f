//! What a simulation reads back: reports and the state.

use crate::clock::{Clock, FrameSecs};
use crate::uniforms::ReportEntry;
use crate::{GpuError, GpuSimulation};
use crate::{acceleration, air, frame};
use forelock_core::frame::{FrameReport, SphReport, StageTimes, Step};
use forelock_core::interaction::contact::ContactReport;
use forelock_core::interaction::grid::GridReport;
use forelock_core::lane::Row;
use forelock_core::strands::{State, world_positions};
use glam::Vec3;

/// Bytes of a report that sum up frames; the rest is of the last frame.
const SUMS: usize = std::mem::offset_of!(ReportEntry, contacts);

/// A report of the frames since the last one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GpuReport {
    /// Largest |l/l₀ − 1| of an edge after the length pass.
    pub max_edge_stretch: f32,
    /// The same at the end of a frame, after collisions.
    pub max_edge_stretch_final: f32,
    /// Strands that were not finite and were reset to their rest shape.
    pub quarantined_strands: u32,
    /// Strands that sleep after the last frame: all or none.
    pub sleeping_strands: u32,
    /// Particles in contact with a solid at a frame's end, summed over all frames.
    pub touching: u32,
    /// Largest depth of a particle inside a solid at a frame's end, metres.
    pub max_penetration_m: f32,
    /// The grid in the last frame, as far as the device measures it; `None` without one. Iterations
    /// are sweeps; the residual is the change of the last sweeps over the largest right-hand side.
    pub grid: Option<GridReport>,
    /// The contacts between strands in the last frame, without their times; `None` without them.
    pub strand_contacts: Option<ContactReport>,
    /// The times of the last frame, if it was timed ([`GpuSimulation::time_stages`]).
    pub secs: Option<FrameSecs>,
}

impl GpuSimulation {
    /// A report of the frames since the last one. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn report(&mut self) -> Result<GpuReport, GpuError> {
        let read = self.gpu.read(&self.report_buffers())?;
        Ok(self.take_report(&mut read.iter().map(Vec::as_slice)))
    }

    /// The same and the state, rows as in the model, in one wait.
    ///
    /// # Errors
    /// The same errors as [`GpuSimulation::report`].
    pub fn report_and_state(&mut self) -> Result<(GpuReport, &State<f32>), GpuError> {
        let mut buffers = self.report_buffers();
        buffers.extend(self.state_buffers());
        let read = self.gpu.read(&buffers)?;
        let mut read = read.iter().map(Vec::as_slice);
        let report = self.take_report(&mut read);
        Ok((report, self.take_state(&mut read)))
    }

    /// Copies the state to the CPU. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn read_state(&mut self) -> Result<&State<f32>, GpuError> {
        let read = self.gpu.read(&self.state_buffers().collect::<Vec<_>>())?;
        Ok(self.take_state(&mut read.iter().map(Vec::as_slice)))
    }

    /// Positions in world space and the groom's order, `[P]`, metres. Waits for the device and
    /// copies positions only; see [`GpuSimulation::begin_read`] for a copy without a wait.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn read_positions(&self, out: &mut Vec<Vec3>) -> Result<(), GpuError> {
        let buffers: Vec<_> = self.batches.iter().map(|batch| &batch.positions).collect();
        let rows: Vec<Row<f32>> = self
            .gpu
            .read(&buffers)?
            .concat()
            .chunks_exact(size_of::<Row<f32>>())
            .map(bytemuck::pod_read_unaligned)
            .collect();
        world_positions(&self.model, &rows, self.origin, out);
        Ok(())
    }

    /// Memory for a read-back: that of the one before, if there was one.
    pub(crate) fn take_memory(&mut self) -> State<f32> {
        let made = || {
            let mut state = State::at_rest(&self.model, &self.options.rest_pose);
            self.solver.channels().prepare_state(&self.model, &mut state);
            state
        };
        let mut state = self.read_back.take().unwrap_or_else(made);
        state.origin = self.origin;
        state
    }

    /// Uploads `state`.
    pub(crate) fn write_state(&mut self, state: &State<f32>) {
        self.batches.iter().for_each(|batch| batch.write(&self.gpu, state));
        self.sleep.take(&self.gpu, &self.model, state);
        self.channels.take(state);
        self.origin = state.origin;
        self.positions.origin = state.origin;
    }

    fn report_buffers(&self) -> Vec<&wgpu::Buffer> {
        let mut buffers = vec![&self.shared.report];
        buffers.extend(self.interactions.iter().filter_map(|own| own.report_buffer()));
        buffers.extend(self.sleep.report_buffer());
        buffers.extend(self.clock.as_ref().and_then(Clock::resolved));
        buffers
    }

    fn state_buffers(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.batches.iter().flat_map(|batch| batch.state())
    }

    /// The report in the bytes of [`Self::report_buffers`]; its sums begin anew.
    fn take_report<'a>(&mut self, read: &mut impl Iterator<Item = &'a [u8]>) -> GpuReport {
        let mut next = || read.next().unwrap_or_default();
        self.gpu.queue().write_buffer(&self.shared.report, 0, &[0; SUMS]);
        let own: ReportEntry = bytemuck::pod_read_unaligned(next());
        // A solver may leave edges at their lengths without a length pass.
        let restores =
            |step: &Step| matches!(step, Step::RestoreLengths { .. } | Step::RestoreIfMoved { .. });
        let restores = self.plan.any(restores);
        let restored = if restores { own.restored } else { own.stretch };
        let mut report = GpuReport {
            max_edge_stretch: f32::from_bits(restored),
            max_edge_stretch_final: f32::from_bits(own.stretch),
            quarantined_strands: own.quarantined,
            touching: own.touching,
            max_penetration_m: f32::from_bits(own.deepest),
            ..GpuReport::default()
        };
        for interaction in self.interactions.iter().filter(|own| own.report_buffer().is_some()) {
            interaction.add_report(next(), &own, &mut report);
        }
        if self.sleep.report_buffer().is_some() {
            let settle_secs = self.interactions.iter().map(|own| own.settle_secs()).fold(0.0, f64::max);
            self.sleep.report(&self.gpu, next(), [self.options.sleep_speed, settle_secs]);
        }
        report.sleeping_strands = self.sleeping_strands() as u32;
        let timed = self.clock.as_ref().filter(|clock| clock.resolved().is_some());
        report.secs = timed.map(|clock| clock.secs(next()));
        report
    }

    /// The state in the bytes of [`Self::state_buffers`].
    fn take_state<'a>(&mut self, read: &mut impl Iterator<Item = &'a [u8]>) -> &State<f32> {
        let mut state = self.take_memory();
        let mut next = || read.next().unwrap_or_default();
        for batch in &self.batches {
            batch.take([next(), next(), next(), next()], &mut state);
        }
        self.channels.give(&mut state);
        self.sleep.give(&mut state);
        self.read_back.insert(state)
    }
}

/// The report of a GPU in the form of the CPU's, under a solver whose stage is `solver_stage`
/// ([`FrameRules::stage`](forelock_core::frame::FrameRules::stage)).
pub fn to_frame_report(report: &GpuReport, solver_stage: &'static str) -> FrameReport {
    let stages = report.secs.as_ref().map(|secs| &secs.stages[..]).unwrap_or_default();
    let mut times = StageTimes::default();
    for &(name, secs) in stages {
        times.add(if FOR_SOLVER.contains(&name) { solver_stage } else { name }, secs);
    }
    FrameReport {
        max_edge_stretch: report.max_edge_stretch.into(),
        max_edge_stretch_final: report.max_edge_stretch_final.into(),
        max_penetration_m: report.max_penetration_m.into(),
        touching: report.touching,
        quarantined_strands: report.quarantined_strands,
        sleeping_strands: report.sleeping_strands,
        grid: report.grid.unwrap_or_default(),
        strand_contacts: report.strand_contacts.unwrap_or_default(),
        sph: SphReport::default(),
        stages: times,
        device_secs: report.secs.as_ref().map(|secs| secs.whole),
    }
}

/// Stages of kernels that count for the solver, as their work does on the CPU.
static FOR_SOLVER: [&str; 3] = [acceleration::ACCELERATION.stage, air::AIR.stage, frame::LOAD.stage];
