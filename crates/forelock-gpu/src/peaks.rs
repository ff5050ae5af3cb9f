//! Measures the peak arithmetic and memory rates of a device, for a roofline model.

use crate::{Gpu, GpuError};
use std::time::Instant;
use wgpu::BufferUsages;

/// Iterations per thread, each of 32 multiply–adds: on a GPU, and on a software rasterizer.
const ROUNDS: [u32; 2] = [4096, 512];
/// Number of threads of the dispatch that measures arithmetic.
const THREADS: u32 = 256 * 1024;
/// Bytes copied by a dispatch; fewer on a software rasterizer, or where the size of a binding is
/// limited.
const BYTES: u64 = 256 << 20;
/// Maximum number of dispatches of a measurement.
const MOST_TIMES: u32 = 1 << 20;
/// Minimum duration of a measurement, seconds.
const LEAST_SECS: f64 = 0.2;

/// Peak rates of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Peaks {
    /// Float32 operations per second, in independent multiply–adds of two operations each.
    pub operations_per_sec: f64,
    /// Bytes per second, read and written, in a copy that is larger than the caches.
    pub bytes_per_sec: f64,
}

impl Peaks {
    /// Measures the rates of `gpu`. This takes about a second, and up to half a gigabyte of its
    /// memory.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device fails.
    pub fn measure(gpu: &Gpu) -> Result<Self, GpuError> {
        let mut bytes = BYTES.min(gpu.most_bound());
        if gpu.is_software() {
            bytes = bytes.min(BYTES / 4);
        }
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let buffers = ["source", "target"].map(|label| gpu.buffer(label, bytes, storage));
        let rounds = ROUNDS[usize::from(gpu.is_software())];
        let text = format!("const ROUNDS: u32 = {rounds}u;\n{}", include_str!("peaks.wgsl"));
        let descriptor = wgpu::ShaderModuleDescriptor {
            label: Some("peaks"),
            source: wgpu::ShaderSource::Wgsl(text.into()),
        };
        let module = crate::pipelines::trusted_module(gpu.device(), descriptor);
        let rate = |entry: &str, groups: u32, work: f64| -> Result<f64, GpuError> {
            let pipeline = gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: None,
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            });
            let entries: [_; 2] = std::array::from_fn(|k| wgpu::BindGroupEntry {
                binding: k as u32,
                resource: buffers[k].as_entire_binding(),
            });
            let bound = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            let run = |times: u32| -> Result<f64, GpuError> {
                let mut encoder = gpu.device().create_command_encoder(&Default::default());
                {
                    let mut pass = encoder.begin_compute_pass(&Default::default());
                    pass.set_pipeline(&pipeline);
                    pass.set_bind_group(0, &bound, &[]);
                    (0..times).for_each(|_| pass.dispatch_workgroups(groups, 1, 1));
                }
                let commands = encoder.finish();
                let started = Instant::now();
                gpu.queue().submit([commands]);
                gpu.wait()?;
                Ok(started.elapsed().as_secs_f64())
            };
            run(1)?;
            let mut times = 1;
            loop {
                let secs = run(times)?;
                if secs >= LEAST_SECS {
                    return Ok(f64::from(times) * work / secs);
                }
                if times >= MOST_TIMES {
                    let reason = "its dispatches take no measurable time".to_owned();
                    return Err(GpuError::Failed { name: gpu.name().to_owned(), reason });
                }
                times *= 2;
            }
        };
        let operations_per_sec = {
            // A multiply–add counts as two operations.
            let operations = 2.0 * 32.0 * f64::from(rounds) * f64::from(THREADS);
            rate("multiply_add", THREADS / 256, operations)?
        };
        let bytes_per_sec = rate("copy", 16_384, 2.0 * bytes as f64)?;
        Ok(Self { operations_per_sec, bytes_per_sec })
    }
}
