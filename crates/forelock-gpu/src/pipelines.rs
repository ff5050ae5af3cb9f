//! Pipelines, made at first use and kept by the device.

use crate::kernel::{BindingKind, BindingLayout, KernelDef, Shader};
use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

/// What a device has compiled so far. Definitions are statics, so an address identifies one.
#[derive(Debug, Default)]
pub(crate) struct Pipelines(Mutex<Made>);

#[derive(Debug, Default)]
struct Made {
    layouts: HashMap<usize, wgpu::BindGroupLayout>,
    modules: HashMap<usize, (wgpu::ShaderModule, wgpu::PipelineLayout)>,
    pipelines: HashMap<usize, wgpu::ComputePipeline>,
    /// The kernels of the pipelines, in the order in which they were made.
    kernels: Vec<&'static KernelDef>,
}

fn address<T>(definition: &'static T) -> usize {
    std::ptr::from_ref(definition).addr()
}

/// A module of one of our shaders, without the bound that wgpu sets to the iterations of each loop:
/// on an H100 its counter takes a ninth of a frame with contacts.
pub(crate) fn trusted_module(
    device: &wgpu::Device,
    descriptor: wgpu::ShaderModuleDescriptor<'_>,
) -> wgpu::ShaderModule {
    let checks =
        wgpu::ShaderRuntimeChecks { force_loop_bounding: false, ..wgpu::ShaderRuntimeChecks::checked() };
    // SAFETY: every loop of our shaders ends after a number of iterations that is bounded by the
    // sizes of buffers, whatever the buffers hold. All other checks remain.
    unsafe { device.create_shader_module_trusted(descriptor, checks) }
}

impl Pipelines {
    /// The layout of bind groups.
    pub fn layout(&self, device: &wgpu::Device, layout: &'static BindingLayout) -> wgpu::BindGroupLayout {
        self.made().layout(device, layout).clone()
    }

    /// The pipeline of a kernel.
    pub fn pipeline(&self, device: &wgpu::Device, kernel: &'static KernelDef) -> wgpu::ComputePipeline {
        self.made().pipeline(device, kernel)
    }

    /// The kernels whose pipelines were made, in the order in which they were made.
    pub fn kernels(&self) -> Vec<&'static KernelDef> {
        self.made().kernels.clone()
    }

    fn made(&self) -> std::sync::MutexGuard<'_, Made> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Made {
    fn layout(&mut self, device: &wgpu::Device, layout: &'static BindingLayout) -> &wgpu::BindGroupLayout {
        self.layouts.entry(address(layout)).or_insert_with(|| {
            let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
            let entry = |binding: &crate::kernel::Binding| wgpu::BindGroupLayoutEntry {
                binding: binding.number,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty: match binding.kind {
                        BindingKind::Uniform(_) | BindingKind::DynamicUniform(_) => {
                            wgpu::BufferBindingType::Uniform
                        }
                        BindingKind::Read => storage(true),
                        BindingKind::ReadWrite => storage(false),
                    },
                    has_dynamic_offset: matches!(binding.kind, BindingKind::DynamicUniform(_)),
                    min_binding_size: std::num::NonZeroU64::new(binding.kind.size() as u64),
                },
                count: None,
            };
            let entries: Vec<_> = layout.bindings.iter().map(entry).collect();
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(layout.name),
                entries: &entries,
            })
        })
    }

    fn module(
        &mut self,
        device: &wgpu::Device,
        shader: &'static Shader,
    ) -> &(wgpu::ShaderModule, wgpu::PipelineLayout) {
        let group = self.layout(device, shader.layout).clone();
        self.modules.entry(address(shader)).or_insert_with(|| {
            let label = Some(shader.stage);
            let subgroups = device.features().contains(wgpu::Features::SUBGROUP);
            let source = wgpu::ShaderSource::Wgsl(shader.source(subgroups).into());
            let module = trusted_module(device, wgpu::ShaderModuleDescriptor { label, source });
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label,
                bind_group_layouts: &[Some(&group)],
                immediate_size: 0,
            });
            (module, layout)
        })
    }

    fn pipeline(&mut self, device: &wgpu::Device, kernel: &'static KernelDef) -> wgpu::ComputePipeline {
        if let Some(pipeline) = self.pipelines.get(&address(kernel)) {
            return pipeline.clone();
        }
        let (module, layout) = self.module(device, kernel.shader);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(kernel.entry),
            layout: Some(layout),
            module,
            entry_point: Some(kernel.entry),
            // Kernels write workgroup memory before they read it.
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        self.kernels.push(kernel);
        self.pipelines.insert(address(kernel), pipeline.clone());
        pipeline
    }
}
