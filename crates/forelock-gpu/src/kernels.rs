//! The kernels: texts beside the stages that they are twins of, constants from here, pipelines from both.

use crate::layout::{FLAGS, FrameUniform, SubstepUniform};
use forelock_core::lane::{ASIN_RATIO, LANES};
use forelock_core::stage::restore_lengths::NEWTON_STEPS;
use forelock_core::stage::solve_strands::PIVOT_FLOOR;
use std::fmt::Write as _;

/// Strands of a workgroup.
pub const WORKGROUP: u32 = 64;
/// Rows of scratch a particle: three 3×3 links and a vector.
pub const SCRATCH_ROWS: u32 = 30;
/// Rows of the model a particle.
pub const MODEL_ROWS: u32 = 7;

/// A stage that runs on the GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// One implicit substep.
    SolveStrands,
    /// Edges back to their lengths.
    RestoreLengths,
    /// Stretch, and strands that are not finite.
    CheckStrands,
}

/// A row of the table of stages.
#[derive(Clone, Copy, Debug)]
pub struct StageKernel {
    /// Which.
    pub stage: Stage,
    /// Its name: of the stage, of the entry point and of labels.
    pub name: &'static str,
    /// Its text, to come after the prelude.
    pub text: &'static str,
}

/// What all kernels of strands begin with.
const PRELUDE: &str = include_str!("../../forelock-core/src/stage/prelude.wgsl");

/// All stages, in their order.
pub const STAGES: [StageKernel; 3] = [
    StageKernel {
        stage: Stage::SolveStrands,
        name: "solve_strands",
        text: include_str!("../../forelock-core/src/stage/solve_strands/kernel.wgsl"),
    },
    StageKernel {
        stage: Stage::RestoreLengths,
        name: "restore_lengths",
        text: include_str!("../../forelock-core/src/stage/restore_lengths/kernel.wgsl"),
    },
    StageKernel {
        stage: Stage::CheckStrands,
        name: "check_strands",
        text: include_str!("../../forelock-core/src/stage/check_strands/kernel.wgsl"),
    },
];

/// What each binding of group 0 is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binding {
    /// Uniform of a frame.
    Frame,
    /// Uniform of a substep, at a dynamic offset.
    Substep,
    /// Storage that kernels read.
    Read(&'static str),
    /// Storage that kernels change.
    Change(&'static str),
}

/// The bindings of group 0, in their order: eight of storage, as many as WebGPU grants.
pub const BINDINGS: [Binding; 10] = [
    Binding::Frame,
    Binding::Substep,
    Binding::Read("blocks"),
    Binding::Read("model"),
    Binding::Read("strands"),
    Binding::Change("positions"),
    Binding::Change("velocities"),
    Binding::Change("memory"),
    Binding::Change("scratch"),
    Binding::Change("report"),
];

/// The whole text of a stage: constants, prelude, kernel.
pub fn text(stage: &StageKernel) -> String {
    let mut text = String::new();
    let mut constant = |name: &str, kind: &str, value: &dyn std::fmt::Display, end: &str| {
        // Writing to a string does not fail.
        let _ = writeln!(text, "const {name}: {kind} = {value}{end};");
    };
    let counts = [
        ("LANES", LANES as u32),
        ("WORKGROUP", WORKGROUP),
        ("SCRATCH", SCRATCH_ROWS),
        ("NEWTON_STEPS", NEWTON_STEPS as u32),
    ];
    for (name, value) in counts.into_iter().chain(FLAGS) {
        constant(name, "u32", &value, "u");
    }
    constant("PIVOT_FLOOR", "f32", &(PIVOT_FLOOR as f32), "f");
    for (k, value) in ASIN_RATIO.iter().enumerate() {
        constant(&format!("ASIN_RATIO_{k}"), "f32", value, "f");
    }
    text.push_str(PRELUDE);
    text.push_str(stage.text);
    text
}

/// Pipelines of all stages, and the layout that they share.
#[derive(Debug)]
pub(crate) struct Kernels {
    pub layout: wgpu::BindGroupLayout,
    pipelines: [wgpu::ComputePipeline; STAGES.len()],
}

impl Kernels {
    /// How many pipelines there are.
    pub const COUNT: u32 = STAGES.len() as u32;

    pub fn new(device: &wgpu::Device) -> Self {
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("strands"),
            entries: &entries(),
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("strands"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipelines = STAGES.map(|stage| {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(stage.name),
                source: wgpu::ShaderSource::Wgsl(text(&stage).into()),
            });
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(stage.name),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some(stage.name),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        });
        Self { layout, pipelines }
    }

    pub fn pipeline(&self, stage: Stage) -> &wgpu::ComputePipeline {
        &self.pipelines[stage as usize]
    }
}

fn entries() -> [wgpu::BindGroupLayoutEntry; BINDINGS.len()] {
    let mut number = 0;
    BINDINGS.map(|binding| {
        let uniform = wgpu::BufferBindingType::Uniform;
        let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
        let (ty, has_dynamic_offset, size) = match binding {
            Binding::Frame => (uniform, false, size_of::<FrameUniform>()),
            Binding::Substep => (uniform, true, size_of::<SubstepUniform>()),
            Binding::Read(_) => (storage(true), false, 0),
            Binding::Change(_) => (storage(false), false, 0),
        };
        number += 1;
        wgpu::BindGroupLayoutEntry {
            binding: number - 1,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty,
                has_dynamic_offset,
                min_binding_size: std::num::NonZeroU64::new(size as u64),
            },
            count: None,
        }
    })
}
