//! Strands under the augmented mass-spring model, on a GPU.

use crate::batch::{Batch, Shared, split};
use crate::clock::{Clock, StageSecs};
use crate::kernels::{SOLIDS, STRANDS, Stage};
use crate::layout::{FrameUniform, ReportEntry, SubstepUniform};
use crate::solids::Solids;
use crate::{Gpu, GpuError};
use forelock_core::body::ColliderFrame;
use forelock_core::groom::Groom;
use forelock_core::model::{Model, Strands};
use forelock_core::solver::params::Inextensibility;
use forelock_core::solver::{AmsParams, Frame, Options};
use forelock_core::state::{Snapshot, State};
use glam::DVec3;

/// A simulation whose state lives on a GPU: [`forelock_core::solver::Simulation`], stage by stage.
///
/// Memory, in bytes a particle: 28 of model, 32 of state, 120 of scratch (that of the largest batch).
#[derive(Debug)]
pub struct GpuSimulation {
    gpu: Gpu,
    model: Model<f32>,
    /// The state as it was last on the CPU; its origin is always true.
    mirror: State<f32>,
    params: AmsParams,
    options: Options,
    shared: Shared,
    solids: Solids,
    batches: Vec<Bound>,
    substeps: Vec<u8>,
    clock: Option<Clock>,
}

/// A batch and what stages see of it.
#[derive(Debug)]
struct Bound {
    batch: Batch,
    to_strands: wgpu::BindGroup,
    to_solids: wgpu::BindGroup,
}

/// What the frames since the last report did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GpuReport {
    /// Largest |l/l₀ − 1| of an edge after the length pass.
    pub max_edge_stretch: f32,
    /// The same at the end of a frame, after solids.
    pub max_edge_stretch_final: f32,
    /// Strands that were not finite and were put back to their rest shape.
    pub quarantined_strands: u32,
    /// Particles in touch with a solid at a frame's end, over all frames.
    pub touching: u32,
    /// Deepest particle under a solid's surface at a frame's end, metres.
    pub max_penetration_m: f32,
    /// Seconds of each stage in the last frame, if stages are timed.
    pub stage_secs: Option<StageSecs>,
}

impl GpuSimulation {
    /// A simulation of `groom`, at rest at `options.rest_pose`.
    ///
    /// # Errors
    /// [`GpuError`] if the groom cannot be packed, a parameter is out of range, or the GPU has no room.
    pub fn new(gpu: &Gpu, groom: &Groom, params: &AmsParams, options: &Options) -> Result<Self, GpuError> {
        Self::from_strands(gpu, &groom.into(), params, options)
    }

    /// The same from plain arrays.
    ///
    /// # Errors
    /// As [`GpuSimulation::new`].
    pub fn from_strands(
        gpu: &Gpu,
        strands: &Strands<'_, f32>,
        params: &AmsParams,
        options: &Options,
    ) -> Result<Self, GpuError> {
        params.validate()?;
        let model = Model::new(strands)?;
        let mirror = State::at_rest(&model, &options.rest_pose);
        let ranges = split(gpu, &model)?;
        let places = |range: &std::ops::Range<usize>| {
            model.blocks[range.clone()].iter().map(|block| block.particles).sum::<usize>()
        };
        let shared = Shared::new(gpu, ranges.iter().map(places).max().unwrap_or(1), params.substeps);
        let solids = Solids::new(gpu, params.substeps);
        let bound = |range| {
            let batch = Batch::new(gpu, &model, range);
            batch.write(gpu, &mirror);
            let (kernels, rest) = (gpu.kernels(), (&shared, &solids));
            Bound {
                to_strands: batch.bind(gpu, (&kernels.strands, &STRANDS), rest),
                to_solids: batch.bind(gpu, (&kernels.solids, &SOLIDS), rest),
                batch,
            }
        };
        let batches = ranges.into_iter().map(bound).collect();
        gpu.check()?;
        Ok(Self {
            gpu: gpu.clone(),
            model,
            mirror,
            params: params.clone(),
            options: *options,
            shared,
            solids,
            batches,
            substeps: Vec::new(),
            clock: None,
        })
    }

    /// The model.
    pub fn model(&self) -> &Model<f32> {
        &self.model
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        let batches = self.batches.iter().map(|bound| bound.batch.bytes());
        self.shared.bytes() + self.solids.bytes() + batches.sum::<u64>()
    }

    /// Hands a frame to the device, in one submission, and does not wait for it.
    ///
    /// # Errors
    /// [`GpuError::Params`] if the frame's time and stiffness are beyond float32, [`GpuError::Unsupported`] for what runs on the CPU only, [`GpuError::Failed`] if the
    /// device has failed.
    pub fn step_frame(&mut self, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.gpu.check()?;
        self.params.validate_step(frame.dt_secs, self.options.beyond_float32)?;
        if self.params.drag_along != 1.0 || self.params.drag_quadratic != 0.0 {
            return Err(GpuError::Unsupported { what: "drag that differs along a strand" });
        }
        self.hold(frame.colliders)?;
        self.place(frame);
        let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
        self.encode(&mut encoder, !frame.colliders.is_empty());
        self.gpu.queue().submit([encoder.finish()]);
        Ok(())
    }

    /// Brings the fields of `solids` to the device, before a frame asks for them.
    ///
    /// # Errors
    /// [`GpuError::Unsupported`] for solids that it cannot take, [`GpuError::TooLarge`] if their fields have no room.
    pub fn hold(&mut self, solids: &[ColliderFrame<'_>]) -> Result<(), GpuError> {
        if self.solids.hold(&self.gpu, solids)? {
            let layout = (&self.gpu.kernels().solids, &SOLIDS[..]);
            for bound in &mut self.batches {
                bound.to_solids = bound.batch.bind(&self.gpu, layout, (&self.shared, &self.solids));
            }
        }
        Ok(())
    }

    /// Times stages from the next frame on, or not any more; whether the device can.
    pub fn time_stages(&mut self, on: bool) -> bool {
        let passes = self.batches.len() as u32 * (2 * self.params.substeps + 3);
        self.clock = on.then(|| Clock::new(&self.gpu, passes)).flatten();
        self.clock.is_some()
    }

    /// All stages of a frame: in one pass, or where they are timed each in its own.
    fn encode(&mut self, encoder: &mut wgpu::CommandEncoder, has_solids: bool) {
        let mut clock = self.clock.take();
        if let Some(clock) = &mut clock {
            clock.begin();
            for bound in &self.batches {
                for (stage, number) in self.stages(has_solids) {
                    let timestamp_writes = Some(clock.next(stage));
                    let described =
                        wgpu::ComputePassDescriptor { label: Some(stage.name()), timestamp_writes };
                    self.run(&mut encoder.begin_compute_pass(&described), bound, stage, number);
                }
            }
            clock.end(encoder);
        } else {
            let described = wgpu::ComputePassDescriptor { label: Some("frame"), timestamp_writes: None };
            let mut pass = encoder.begin_compute_pass(&described);
            for bound in &self.batches {
                self.stages(has_solids).for_each(|(stage, number)| self.run(&mut pass, bound, stage, number));
            }
        }
        self.clock = clock;
    }

    /// The stages of a frame in their order, each with the number of its substep or look.
    fn stages(&self, has_solids: bool) -> impl Iterator<Item = (Stage, u32)> + use<> {
        let (count, lengths) = (self.params.substeps, self.restores_lengths());
        let look = move |number: u32| has_solids.then_some((Stage::ResolveSolids, number));
        let substeps = (0..count).flat_map(move |number| {
            [Some((Stage::SolveStrands, number)), look(number)].into_iter().flatten()
        });
        let restored = lengths.then_some((Stage::RestoreLengths, count - 1));
        let last = lengths.then(|| look(count)).flatten();
        substeps.chain(restored).chain(last).chain([(Stage::CheckStrands, count - 1)])
    }

    fn run(&self, pass: &mut wgpu::ComputePass<'_>, bound: &Bound, stage: Stage, number: u32) {
        pass.set_pipeline(self.gpu.kernels().pipeline(stage));
        if stage == Stage::ResolveSolids {
            pass.set_bind_group(0, &bound.to_solids, &[number * self.solids.stride]);
        } else {
            pass.set_bind_group(0, &bound.to_strands, &[number * self.shared.stride]);
        }
        pass.dispatch_workgroups(bound.batch.groups, 1, 1);
    }

    fn restores_lengths(&self) -> bool {
        self.params.inextensibility != Inextensibility::Off
    }

    /// Brings what the frame's strands share to the device.
    fn place(&mut self, frame: &Frame<'_>) {
        let origin = frame.origin(&self.model);
        let shift = self.mirror.origin - origin;
        self.mirror.origin = origin;
        let uniform = FrameUniform::new(&self.params, frame.dt_secs, frame.gravity, frame.air_velocity);
        self.gpu.queue().write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&uniform));
        let (count, weight) = (self.params.substeps, self.options.carried_gravity());
        let poses = || frame.poses(&self.model, count, origin);
        self.substeps.clear();
        for ((step, start), end) in (0..count).zip(poses()).zip(poses().skip(1)) {
            let shift = if step == 0 { shift } else { DVec3::ZERO };
            let substep = SubstepUniform::new([&start, &end], weight, shift);
            self.substeps.resize((step * self.shared.stride) as usize, 0);
            self.substeps.extend_from_slice(bytemuck::bytes_of(&substep));
        }
        self.gpu.queue().write_buffer(&self.shared.substeps, 0, &self.substeps);
        if !frame.colliders.is_empty() {
            let lengths = self.restores_lengths();
            self.solids.place(&self.gpu, &self.params, frame, origin, lengths);
        }
    }

    /// What the frames since the last report did. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn report(&mut self) -> Result<GpuReport, GpuError> {
        let found = self.gpu.read::<ReportEntry>(&self.shared.report)?[0];
        self.gpu.queue().write_buffer(&self.shared.report, 0, &[0; size_of::<ReportEntry>()]);
        let restored = if self.restores_lengths() { found.restored } else { found.stretch };
        Ok(GpuReport {
            max_edge_stretch: f32::from_bits(restored),
            max_edge_stretch_final: f32::from_bits(found.stretch),
            quarantined_strands: found.quarantined,
            touching: found.touching,
            max_penetration_m: f32::from_bits(found.deepest),
            stage_secs: self.clock.as_ref().map(|clock| clock.read(&self.gpu)).transpose()?,
        })
    }

    /// A copy of the state that resumes bit for bit. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn snapshot(&mut self) -> Result<Snapshot<f32>, GpuError> {
        for Bound { batch, .. } in &self.batches {
            batch.read(&self.gpu, &mut self.mirror)?;
        }
        Ok(self.mirror.snapshot(&self.model))
    }

    /// Goes back to a snapshot, of this or of a simulation of the same groom on a CPU.
    ///
    /// # Errors
    /// [`GpuError::Snapshot`] if it is of another groom, [`GpuError::Failed`] if the device has failed.
    pub fn restore(&mut self, snapshot: &Snapshot<f32>) -> Result<(), GpuError> {
        self.mirror.restore(&self.model, snapshot)?;
        self.batches.iter().for_each(|bound| bound.batch.write(&self.gpu, &self.mirror));
        self.gpu.check()
    }

    /// A 64-bit hash of the state: see [`Snapshot::hash`]. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn state_hash(&mut self) -> Result<u64, GpuError> {
        Ok(self.snapshot()?.hash())
    }
}
