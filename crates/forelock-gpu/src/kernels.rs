//! The kernels: texts beside the stages that they are twins of, constants from here, pipelines from both.

use crate::layout::{FLAGS, FrameUniform, SubstepUniform};
use crate::solids::{FAR, HOW, KINDS, LookUniform, MOST_SOLIDS};
use forelock_core::lane::{ASIN_RATIO, LANES};
use forelock_core::stage::SCRATCH_ROWS;
use forelock_core::stage::resolve_solids::{LOOKS, ROUNDS, SLIDES, STRETCHED, SWEEP_STEPS, TOUCH};
use forelock_core::stage::restore_lengths::NEWTON_STEPS;
use forelock_core::stage::solve_strands::PIVOT_FLOOR;
use std::fmt::Write as _;

/// Strands of a workgroup.
pub const WORKGROUP: u32 = 64;
/// Rows of the model a particle.
pub const MODEL_ROWS: u32 = 7;

/// A stage that runs on the GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// One implicit substep.
    SolveStrands,
    /// Hair against solids.
    ResolveSolids,
    /// Edges back to their lengths.
    RestoreLengths,
    /// Stretch, and strands that are not finite.
    CheckStrands,
}

impl Stage {
    /// Its name.
    pub fn name(self) -> &'static str {
        STAGES[self as usize].name
    }
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
    /// What it binds, of group 0: number and what. Up to eight of storage, as many as WebGPU grants.
    pub bindings: &'static [(u32, Binding)],
}

/// What all kernels of strands begin with.
const PRELUDE: &str = include_str!("../../forelock-core/src/stage/prelude.wgsl");

/// All stages, in their order.
pub const STAGES: [StageKernel; 4] = [
    StageKernel {
        stage: Stage::SolveStrands,
        name: "solve_strands",
        text: include_str!("../../forelock-core/src/stage/solve_strands/kernel.wgsl"),
        bindings: &STRANDS,
    },
    StageKernel {
        stage: Stage::ResolveSolids,
        name: "resolve_solids",
        text: include_str!("../../forelock-core/src/stage/resolve_solids/kernel.wgsl"),
        bindings: &SOLIDS,
    },
    StageKernel {
        stage: Stage::RestoreLengths,
        name: "restore_lengths",
        text: include_str!("../../forelock-core/src/stage/restore_lengths/kernel.wgsl"),
        bindings: &STRANDS,
    },
    StageKernel {
        stage: Stage::CheckStrands,
        name: "check_strands",
        text: include_str!("../../forelock-core/src/stage/check_strands/kernel.wgsl"),
        bindings: &STRANDS,
    },
];

/// What a binding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binding {
    /// Uniform of a frame.
    Frame,
    /// Uniform of a substep, at a dynamic offset.
    Substep,
    /// Uniform of a look at solids, at a dynamic offset.
    Look,
    /// Storage that kernels read.
    Read(&'static str),
    /// Storage that kernels change.
    Change(&'static str),
}

/// What the stages of strands alone bind.
pub const STRANDS: [(u32, Binding); 10] = [
    (0, Binding::Frame),
    (1, Binding::Substep),
    (2, Binding::Read("blocks")),
    (3, Binding::Read("model")),
    (4, Binding::Read("strands")),
    (5, Binding::Change("positions")),
    (6, Binding::Change("velocities")),
    (7, Binding::Change("memory")),
    (8, Binding::Change("scratch")),
    (9, Binding::Change("report")),
];

/// What the look at solids binds.
pub const SOLIDS: [(u32, Binding); 9] = [
    (0, Binding::Frame),
    (2, Binding::Read("blocks")),
    (3, Binding::Read("model")),
    (5, Binding::Change("positions")),
    (6, Binding::Change("velocities")),
    (7, Binding::Change("memory")),
    (9, Binding::Change("report")),
    (10, Binding::Read("fields")),
    (11, Binding::Look),
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
        ("SCRATCH", SCRATCH_ROWS as u32),
        ("MODEL_ROWS", MODEL_ROWS),
        ("NEWTON_STEPS", NEWTON_STEPS as u32),
        ("LOOKS", LOOKS as u32),
        ("ROUNDS", ROUNDS as u32),
        ("SLIDES", SLIDES as u32),
        ("SWEEP_STEPS", SWEEP_STEPS as u32),
        ("MOST_SOLIDS", MOST_SOLIDS as u32),
    ];
    for (name, value) in counts.into_iter().chain(FLAGS).chain(KINDS).chain(HOW) {
        constant(name, "u32", &value, "u");
    }
    for (name, value) in
        [("PIVOT_FLOOR", PIVOT_FLOOR), ("FAR", FAR), ("TOUCH", TOUCH), ("STRETCHED", STRETCHED)]
    {
        constant(name, "f32", &format_args!("{:e}", value as f32), "f");
    }
    for (k, value) in ASIN_RATIO.iter().enumerate() {
        constant(&format!("ASIN_RATIO_{k}"), "f32", value, "f");
    }
    text.push_str(PRELUDE);
    text.push_str(stage.text);
    text
}

/// Pipelines of all stages, and their layouts.
#[derive(Debug)]
pub(crate) struct Kernels {
    /// Of [`STRANDS`].
    pub strands: wgpu::BindGroupLayout,
    /// Of [`SOLIDS`].
    pub solids: wgpu::BindGroupLayout,
    pipelines: [wgpu::ComputePipeline; STAGES.len()],
}

impl Kernels {
    /// How many pipelines there are.
    pub const COUNT: u32 = STAGES.len() as u32;

    pub fn new(device: &wgpu::Device) -> Self {
        let layout = |label: &str, bindings: &[(u32, Binding)]| {
            let entries: Vec<_> = bindings.iter().map(entry).collect();
            let described = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries };
            device.create_bind_group_layout(&described)
        };
        let (strands, solids) = (layout("strands", &STRANDS), layout("solids", &SOLIDS));
        let pipelines = STAGES.map(|stage| {
            let layout = if stage.stage == Stage::ResolveSolids { &solids } else { &strands };
            let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(stage.name),
                bind_group_layouts: &[Some(layout)],
                immediate_size: 0,
            });
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
        Self { strands, solids, pipelines }
    }

    pub fn pipeline(&self, stage: Stage) -> &wgpu::ComputePipeline {
        &self.pipelines[stage as usize]
    }
}

fn entry(&(binding, what): &(u32, Binding)) -> wgpu::BindGroupLayoutEntry {
    let uniform = wgpu::BufferBindingType::Uniform;
    let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
    let (ty, has_dynamic_offset, size) = match what {
        Binding::Frame => (uniform, false, size_of::<FrameUniform>()),
        Binding::Substep => (uniform, true, size_of::<SubstepUniform>()),
        Binding::Look => (uniform, true, size_of::<LookUniform>()),
        Binding::Read(_) => (storage(true), false, 0),
        Binding::Change(_) => (storage(false), false, 0),
    };
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset,
            min_binding_size: std::num::NonZeroU64::new(size as u64),
        },
        count: None,
    }
}
