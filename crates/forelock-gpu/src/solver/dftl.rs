//! Kernels of follow the leader.

use super::{GpuSolver, SolveBatch};
use crate::Gpu;
use crate::batch::{DeviceStrands, StrandGroups};
use crate::collide::{
    BENDING, MORPHING, PARTICLE_CONSTANTS, QueryUniform, RIGID, SHAPE_CONSTANTS, SolidKinds, Solids,
};
use crate::frame::{ROOT_CONSTANTS, WindBindings};
use crate::kernel::{Bound, DispatchList, Shader, Threads, bindings, shader};
use crate::uniforms::{FrameUniform, SubstepUniform, flags};
use forelock_core::body::SHAPES_WGSL;
use forelock_core::collide::resolve_solids;
use forelock_core::frame::{ROOTS_WGSL, Solver};
use forelock_core::solver::dftl::follow_leader::{self, FollowTerms};
use forelock_core::solver::dftl::{DftlParams, Schedule};

bindings! {
    /// Strands that collide while they follow their leaders.
    pub(crate) struct FollowBindings {
        0 frame: uniform(FrameUniform),
        1 substep: dynamic(SubstepUniform),
        2 blocks: read,
        3 model: read,
        4 strands: read,
        5 positions: read_write,
        6 velocities: read_write,
        7 memory: read_write,
        9 report: read_write,
        10 fields: read,
        11 query: dynamic(QueryUniform),
    }
}

shader! {
    /// `follow_leader` among shapes that do not change.
    FOLLOW: "follow_leader", FollowBindings;
    texts: [
        ROOTS_WGSL,
        SHAPES_WGSL,
        resolve_solids::PARTICLE_WGSL,
        follow_leader::LEVEL_WGSL,
        follow_leader::WGSL,
        follow_leader::SCHEDULES_WGSL,
    ];
    constants: [ROOT_CONSTANTS, SHAPE_CONSTANTS, PARTICLE_CONSTANTS, RIGID];
    kernels: {
        /// A whole step.
        FOLLOW_LEADER: "follow_leader", Threads::Strands;
        /// The prediction of each particle, before one of the next two.
        PREDICT_PARTICLES: "predict_particles", Threads::StrandParticles;
        /// The rest of the step, strand by strand.
        FOLLOW_STRANDS: "follow_strands", Threads::Strands;
        /// One level of the rest of the step, on all strands.
        FOLLOW_LEVEL: "follow_level_of_strands", Threads::Strands;
    }
}

shader! {
    /// `follow_leader` where some shapes change.
    FOLLOW_MORPHING: "follow_leader", FollowBindings;
    texts: [
        ROOTS_WGSL,
        SHAPES_WGSL,
        resolve_solids::PARTICLE_WGSL,
        follow_leader::LEVEL_WGSL,
        follow_leader::WGSL,
    ];
    constants: [ROOT_CONSTANTS, SHAPE_CONSTANTS, PARTICLE_CONSTANTS, MORPHING];
    kernels: {
        /// A whole step.
        FOLLOW_LEADER_MORPHING: "follow_leader", Threads::Strands;
    }
}

shader! {
    /// `follow_leader` where a body bends.
    FOLLOW_BENDING: "follow_leader", FollowBindings;
    texts: [
        ROOTS_WGSL,
        SHAPES_WGSL,
        resolve_solids::PARTICLE_WGSL,
        follow_leader::LEVEL_WGSL,
        follow_leader::WGSL,
    ];
    constants: [ROOT_CONSTANTS, SHAPE_CONSTANTS, PARTICLE_CONSTANTS, BENDING];
    kernels: {
        /// A whole step.
        FOLLOW_LEADER_BENDING: "follow_leader", Threads::Strands;
    }
}

shader! {
    /// The drag of a wind field.
    WIND: "follow_leader", WindBindings;
    texts: [follow_leader::WIND_WGSL];
    constants: [];
    kernels: {
        /// Adds the drag to velocities, before the step.
        APPLY_WIND: "apply_wind", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&FOLLOW, &FOLLOW_MORPHING, &FOLLOW_BENDING, &WIND];

/// The solver on a GPU, if `solver` is dynamic follow the leader.
pub(crate) fn of(solver: &Solver<f32>) -> Option<Box<dyn GpuSolver>> {
    let params = solver.params::<DftlParams>()?.clone();
    Some(Box::new(GpuDftl { params, groups: Vec::new() }))
}

#[derive(Debug)]
struct GpuDftl {
    params: DftlParams,
    /// One a batch.
    groups: Vec<Bound<FollowBindings<'static>>>,
}

impl GpuSolver for GpuDftl {
    fn substep_entries(&self, substeps: u32, longest: u32) -> u32 {
        // Kernels of one level read its number from a substep.
        if self.params.schedule == Schedule::Particles { longest } else { substeps }
    }

    fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>, solids: &Solids, _: Option<&[wgpu::Buffer]>) {
        let shared = strands.shared;
        let bound = strands.batches.iter().map(|batch| {
            let bindings = FollowBindings {
                frame: &shared.frame,
                substep: &shared.substeps,
                blocks: &batch.blocks,
                model: &batch.model,
                strands: &batch.strands,
                positions: &batch.positions,
                velocities: &batch.velocities,
                memory: &batch.memory,
                report: &shared.report,
                fields: &solids.fields,
                query: &solids.queries,
            };
            bindings.bind(gpu, batch.threads)
        });
        self.groups = bound.collect();
    }

    fn write_terms(&self, dt_secs: f64, uniform: &mut FrameUniform) {
        let terms = FollowTerms::new(&self.params, dt_secs);
        uniform.drag = (terms.h * terms.drag) as f32;
        [uniform.shape_global, uniform.shape_local] = terms.shape.map(|x| x as f32);
        [uniform.tip_global, uniform.tip_local] = terms.tip_scales.map(|x| x as f32);
        uniform.recheck = terms.recheck;
        *uniform = uniform.with_flags(&[(terms.sag_free, flags::SAG_FREE)]);
    }

    fn solve<'a>(&'a self, list: &mut DispatchList<'a>, batch: &SolveBatch<'a>, _: u32) {
        let follow = &self.groups[batch.batch];
        // Only the fused kernel supports shapes that change.
        match self.params.schedule {
            _ if batch.solids == SolidKinds::Bending => {
                list.push(follow.dispatch(&FOLLOW_LEADER_BENDING, &[]));
            }
            _ if batch.solids == SolidKinds::Morphing => {
                list.push(follow.dispatch(&FOLLOW_LEADER_MORPHING, &[]));
            }
            Schedule::Fused => list.push(follow.dispatch(&FOLLOW_LEADER, &[])),
            Schedule::Strands => {
                list.push(follow.dispatch(&PREDICT_PARTICLES, &[]));
                list.push(follow.dispatch(&FOLLOW_STRANDS, &[]));
            }
            Schedule::Particles => {
                list.push(follow.dispatch(&PREDICT_PARTICLES, &[]));
                for level in 1..batch.longest {
                    list.push(follow.dispatch(&FOLLOW_LEVEL, &[level]));
                }
            }
        }
    }

    fn apply_wind<'a>(&self, list: &mut DispatchList<'a>, groups: &'a StrandGroups) {
        list.run(&groups.wind, &APPLY_WIND, &[0]);
    }
}
