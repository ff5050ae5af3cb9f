//! Solids on the device, and the kernels that resolve collisions with them.

use crate::bending::{DeviceBody, bending};
use crate::fields::{describe, fields_of, place_of, table_of};
use crate::frame::FAR;
use crate::kernel::{Constant, Kernel, Shader, Threads, bindings, shader};
use crate::uniforms::FrameUniform;
use crate::{Gpu, GpuError};
use bytemuck::{Pod, Zeroable};
use forelock_core::body::{BRICK_NODES, ColliderFrame, FLAT_GRADIENT, REFINEMENT, SHAPES_WGSL, STILL, Shape};
use forelock_core::collide::resolve_solids::{self, SolidMotion};
use forelock_core::frame::FrameRules;
use forelock_core::frame::{FrameInput, FramePlan, Step, fractions};
use forelock_core::pose::Pose;
use glam::{DMat4, DVec2, DVec3, Mat4, UVec3, UVec4, Vec2, Vec3};
use wgpu::BufferUsages;

/// Largest number of solids in a frame.
pub const MOST_SOLIDS: usize = 32;
/// Numbers of the shapes.
pub mod kinds {
    /// A ball.
    pub const SPHERE: u32 = 0;
    /// A ball that contains the hair.
    pub const HOLLOW_SPHERE: u32 = 1;
    /// A capsule.
    pub const CAPSULE: u32 = 2;
    /// A box.
    pub const BOX: u32 = 3;
    /// A plane.
    pub const PLANE: u32 = 4;
    /// A field of distances.
    pub const FIELD: u32 = 5;
    /// A sequence of fields: a shape that changes.
    pub const MORPH: u32 = 6;
    /// The field of a body that bends.
    pub const BENDING: u32 = 7;
}

/// Bit of [`QueryUniform::how`]: a substep has passed since the query before.
const AFTER_SUBSTEP: u32 = 1;
/// Bit of [`QueryUniform::how`]: the last query of the frame, whose contacts are reported.
const LAST: u32 = 2;
/// Bit of [`QueryUniform::how`]: the length pass has displaced particles.
const DISPLACED: u32 = 4;
/// Bit of [`QueryUniform::how`]: nothing is done unless contacts moved strands.
const IF_MOVED: u32 = 8;
/// Bit of [`QueryUniform::how`]: nothing is done if contacts moved strands.
const UNLESS_MOVED: u32 = 16;
/// Bit of [`QueryUniform::how`]: velocities will be derived from positions.
const POSITIONAL: u32 = 32;

/// Queries of a frame after those of its substeps, by their number from there.
pub(crate) mod queries {
    use forelock_core::frame::{FrameRules, Span};

    /// After the length pass.
    pub const RESTORED: u32 = 0;
    /// After the length pass that follows contacts.
    pub const RESTORED_AGAIN: u32 = 1;
    /// After interactions.
    pub const FINAL: u32 = 2;
    /// Their count.
    const COUNT: u32 = 3;

    /// All queries of a frame of `substeps` under a solver with `rules`.
    pub fn of_frame(rules: &FrameRules, substeps: u32) -> u32 {
        substeps + COUNT * rules.spans(substeps)
    }

    /// The number of `query` at the end of `span` in a frame of `substeps`.
    pub fn at_end(span: Span, query: u32, substeps: u32) -> u32 {
        substeps + COUNT * span.number + query
    }
}

/// Constants of the text that samples shapes.
pub(crate) const SHAPE_CONSTANTS: &[Constant] = &[
    Constant::u32("SPHERE", kinds::SPHERE),
    Constant::u32("HOLLOW_SPHERE", kinds::HOLLOW_SPHERE),
    Constant::u32("CAPSULE", kinds::CAPSULE),
    Constant::u32("BOX", kinds::BOX),
    Constant::u32("PLANE", kinds::PLANE),
    Constant::u32("FIELD", kinds::FIELD),
    Constant::u32("MORPH", kinds::MORPH),
    Constant::u32("BENDING", kinds::BENDING),
    Constant::u32("AFTER_SUBSTEP", AFTER_SUBSTEP),
    Constant::u32("LAST", LAST),
    Constant::u32("DISPLACED", DISPLACED),
    Constant::u32("IF_MOVED", IF_MOVED),
    Constant::u32("UNLESS_MOVED", UNLESS_MOVED),
    Constant::u32("POSITIONAL", POSITIONAL),
    Constant::u32("MOST_SOLIDS", MOST_SOLIDS as u32),
    Constant::u32("FIELD_NUMBERS", FIELD_NUMBERS),
    Constant::u32("REFINEMENT", REFINEMENT),
    Constant::u32("BRICK_NODES", BRICK_NODES as u32),
    Constant::f32("STILL", STILL),
    Constant::f32("FLAT_GRADIENT", FLAT_GRADIENT),
];

/// Constants of the text that resolves the collisions of a particle.
pub(crate) const PARTICLE_CONSTANTS: &[Constant] = &[
    Constant::u32("MAX_PUSHES", resolve_solids::MAX_PUSHES as u32),
    Constant::u32("PROJECTION_ROUNDS", resolve_solids::PROJECTION_ROUNDS as u32),
    Constant::u32("SWEEP_STEPS", resolve_solids::SWEEP_STEPS as u32),
    Constant::f32("TOUCH", resolve_solids::TOUCH as f32),
    Constant::f32("CCD_MOTION", resolve_solids::CCD_MOTION as f32),
    Constant::u32("MOST_PARTS", resolve_solids::MOST_PARTS as u32),
    Constant::f32("PASSES", resolve_solids::PASSES as f32),
    Constant::f32("NOWHERE", resolve_solids::NOWHERE as f32),
    Constant::f32("HELD", resolve_solids::HELD as f32),
    Constant::f32("OPPOSITE", resolve_solids::OPPOSITE as f32),
];

/// Constants of the strand kernel.
const STRAND_CONSTANTS: &[Constant] = &[
    // Rows of scratch; the length pass writes those from ORIGIN on.
    Constant::u32("ORIGIN", 5),
    Constant::u32("MOVED", 8),
    Constant::u32("BEFORE_EDGES", 9),
    Constant::u32("OLD_CURVE", 12),
    Constant::u32("PACKET", resolve_solids::EDGE_SAMPLES as u32 + 1),
    Constant::f32("SKIN_SHARE", resolve_solids::SKIN_SHARE as f32),
    Constant::u32("REFINEMENTS", resolve_solids::REFINEMENTS as u32),
    Constant::u32("EDGE_ROUNDS", resolve_solids::EDGE_ROUNDS as u32),
    Constant::u32("TAKE_BACK_ROUNDS", resolve_solids::TAKE_BACK_ROUNDS as u32),
    Constant::f32("NEARLY", resolve_solids::NEARLY as f32),
    Constant::u32("SHORTER_STEPS", resolve_solids::SHORTER_STEPS as u32),
    Constant::f32("FOLDS", resolve_solids::FOLDS as f32),
    Constant::f32("THIN", resolve_solids::THIN as f32),
    Constant::f32("LAG", resolve_solids::LAG as f32),
    Constant::f32("SLIP", resolve_solids::SLIP as f32),
    Constant::f32("LEAST_TURN", resolve_solids::LEAST_TURN as f32),
    Constant::f32("SHALLOW", resolve_solids::SHALLOW as f32),
    Constant::u32("SLIDE_STEPS", resolve_solids::SLIDE_STEPS as u32),
    Constant::f32("STRETCHED", resolve_solids::STRETCHED as f32),
    Constant::f32("COINCIDENT", resolve_solids::COINCIDENT as f32),
    Constant::f32("PINCHED", resolve_solids::PINCHED as f32),
    Constant::u32("EXACT_ROUNDS", resolve_solids::EXACT_ROUNDS as u32),
];

/// All shapes are supported.
pub(crate) const BENDING: &[Constant] = &[Constant::bool("CHANGES", true), Constant::bool("MAY_BEND", true)];
/// Bodies that bend are left out, which makes the kernel faster.
pub(crate) const MORPHING: &[Constant] =
    &[Constant::bool("CHANGES", true), Constant::bool("MAY_BEND", false)];
/// All shapes that change are left out.
pub(crate) const RIGID: &[Constant] = &[Constant::bool("CHANGES", false), Constant::bool("MAY_BEND", false)];

bindings! {
    /// Strands and solids.
    pub(crate) struct SolidBindings {
        0 frame: uniform(FrameUniform),
        2 blocks: read,
        3 model: read,
        5 positions: read_write,
        6 velocities: read_write,
        7 memory: read_write,
        8 scratch: read_write,
        9 report: read_write,
        10 fields: read,
        11 query: dynamic(QueryUniform),
    }
}

shader! {
    /// `resolve_solids` for shapes that do not change.
    RESOLVE: "resolve_solids", SolidBindings;
    texts: [SHAPES_WGSL, resolve_solids::PARTICLE_WGSL, resolve_solids::WGSL];
    constants: [SHAPE_CONSTANTS, PARTICLE_CONSTANTS, STRAND_CONSTANTS, RIGID];
    kernels: {
        /// Resolves the collisions of each strand.
        RESOLVE_SOLIDS: "resolve_solids", Threads::Strands;
    }
}

shader! {
    /// `resolve_solids` where some shapes change.
    RESOLVE_MORPHING: "resolve_solids", SolidBindings;
    texts: [SHAPES_WGSL, resolve_solids::PARTICLE_WGSL, resolve_solids::WGSL];
    constants: [SHAPE_CONSTANTS, PARTICLE_CONSTANTS, STRAND_CONSTANTS, MORPHING];
    kernels: {
        /// Resolves the collisions of each strand.
        RESOLVE_MORPHING_SOLIDS: "resolve_solids", Threads::Strands;
    }
}

shader! {
    /// `resolve_solids` where a body bends.
    RESOLVE_BENDING: "resolve_solids", SolidBindings;
    texts: [SHAPES_WGSL, resolve_solids::PARTICLE_WGSL, resolve_solids::WGSL];
    constants: [SHAPE_CONSTANTS, PARTICLE_CONSTANTS, STRAND_CONSTANTS, BENDING];
    kernels: {
        /// Resolves the collisions of each strand.
        RESOLVE_BENDING_SOLIDS: "resolve_solids", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&RESOLVE, &RESOLVE_MORPHING, &RESOLVE_BENDING];

/// Which solids a frame has, as far as kernels differ by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SolidKinds {
    /// None.
    None,
    /// Only shapes that do not change.
    Rigid,
    /// Some that change.
    Morphing,
    /// Some that bend; others may change.
    Bending,
}

impl SolidKinds {
    /// Those of `solids`.
    pub fn of(solids: &[ColliderFrame<'_>]) -> Self {
        if solids.is_empty() {
            Self::None
        } else if solids.iter().any(|solid| matches!(solid.shape, Shape::Bending(_))) {
            Self::Bending
        } else if solids.iter().any(|solid| matches!(solid.shape, Shape::Morph { .. })) {
            Self::Morphing
        } else {
            Self::Rigid
        }
    }

    /// The kernel that resolves collisions after a substep, if there are solids.
    pub fn resolve(self) -> Option<&'static Kernel<SolidBindings<'static>>> {
        match self {
            Self::None => None,
            Self::Rigid => Some(&RESOLVE_SOLIDS),
            Self::Morphing => Some(&RESOLVE_MORPHING_SOLIDS),
            Self::Bending => Some(&RESOLVE_BENDING_SOLIDS),
        }
    }
}

/// A solid in a substep: `Solid` in the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SolidEntry {
    /// From positions to its own space at the substep's end.
    pub at_end: Mat4,
    /// The same at its start.
    pub at_start: Mat4,
    /// Maps a point of the carrier from the substep's start to its end.
    pub carry: Mat4,
    /// Rotation vector of the carrier over the substep.
    pub spin: Vec3,
    /// Coulomb friction.
    pub friction: f32,
    /// Displacement of the carrier, metres.
    pub travel: Vec3,
    /// One of [`kinds`].
    pub kind: u32,
    /// Position of the carrier, metres.
    pub pivot: Vec3,
    /// Displacements below this cannot tunnel through it, metres.
    pub thinness: f32,
    /// Radius; half length and radius; half extents. Metres.
    pub size: Vec3,
    /// Side of a field's cells near the surface, metres; 0 for what is exact.
    pub cell: f32,
    /// Centre of its bounding ball.
    pub ball: Vec3,
    /// Radius of its bounding ball, metres.
    pub ball_radius: f32,
    /// A field's first node, metres.
    pub origin: Vec3,
    /// Of a shape that changes, the first number of the description of its first field; of a field,
    /// the first entry of its table of bricks, 0 if it is not refined; of a body that bends, the
    /// first value at the frame's end.
    pub described: u32,
    /// A field's nodes.
    pub dims: UVec3,
    /// The first of its values; of a body that bends, at the frame's start.
    pub first: u32,
    /// Of a shape that changes, the position in its sequence at the substep's start and end; of a
    /// body that bends, the shares of the frame.
    pub phases: Vec2,
    /// The largest displacement of its surface in the substep, metres.
    pub swell: f32,
    /// The number of its fields.
    pub fields: u32,
    /// Of a body that bends, the first corner of its triangles, fall of its cells, value of its
    /// bricks and nearest triangle.
    pub body: UVec4,
}

/// Numbers of the description of a field: first node, side of a cell, nodes, and in two halves each
/// the index of its first value and that of its table of bricks.
pub const FIELD_NUMBERS: u32 = 11;

/// A query of all solids: `Query` in the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct QueryUniform {
    /// The number of solids.
    pub count: u32,
    /// Bits 1: after a substep; 2: the last query of the frame; 4: the length pass has displaced
    /// particles; 8: only if contacts moved strands; 16: only if they did not; 32: velocities will
    /// be derived from positions.
    pub how: u32,
    /// Distance kept from surfaces, metres.
    pub thickness: f32,
    /// Depth by which a particle inside a solid may be moved out, metres.
    pub max_push_out: f32,
    /// Share of a solid's thinness that an edge may move without being tested.
    pub slow_edges: f32,
    /// Largest displacement of a point of an edge that was inside before, metres.
    pub max_edge_push: f32,
    /// Stretch above which a strand that touches solids is laid along them; `FAR`: never.
    pub stretch_limit: f32,
    /// Unused.
    pub pad_2: f32,
    /// The first `count` are used.
    pub solids: [SolidEntry; MOST_SOLIDS],
}

/// The solids of a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SolidFrame<'a> {
    /// The frame.
    pub frame: &'a FrameInput<'a>,
    /// Its substeps.
    pub substeps: u32,
    /// The origin of positions.
    pub origin: DVec3,
    /// The frame's plan.
    pub plan: &'a FramePlan,
    /// Whether velocities are derived from positions after the collisions of a substep.
    pub positional: bool,
}

/// Distance fields on the device, and the queries of a frame.
#[derive(Debug)]
pub(crate) struct Solids {
    /// Values of all fields, one after the other.
    pub fields: wgpu::Buffer,
    /// Shapes whose fields are there, and where: the first value of a field, or the description of
    /// a shape that changes.
    held: Vec<(Shape, u32)>,
    /// Those of the bodies that bend, in the order of the solids.
    bodies: Vec<DeviceBody>,
    /// A `QueryUniform` a query, each at a multiple of `stride`.
    pub queries: wgpu::Buffer,
    stride: u32,
    query: Box<QueryUniform>,
    /// All queries as bytes.
    bytes: Vec<u8>,
}

impl Solids {
    /// For frames of `count` queries ([`queries::of_frame`]), without a field yet.
    pub fn new(gpu: &Gpu, count: u32) -> Self {
        let stride = gpu.uniform_stride(size_of::<QueryUniform>());
        Self {
            fields: buffer_of(gpu, 0),
            held: Vec::new(),
            bodies: Vec::new(),
            queries: queries_of(gpu, stride, count),
            stride,
            query: Box::new(QueryUniform::zeroed()),
            bytes: Vec::new(),
        }
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        self.fields.size() + self.queries.size()
    }

    /// Makes room for frames of `count` queries. Returns whether the buffer is a new one.
    pub fn hold_queries(&mut self, gpu: &Gpu, count: u32) -> bool {
        let grows = query_bytes(self.stride, count) > self.queries.size();
        if grows {
            self.queries = queries_of(gpu, self.stride, count);
        }
        grows
    }

    /// Uploads what is missing of the fields of `solids`. Returns whether the buffer is a new one.
    pub fn hold(&mut self, gpu: &Gpu, solids: &[ColliderFrame<'_>]) -> Result<bool, GpuError> {
        let is_new = self.hold_constant(gpu, solids)?;
        for (body, field) in self.bodies.iter_mut().zip(bending(solids)) {
            body.write(gpu, &self.fields, field);
        }
        Ok(is_new)
    }

    /// Makes the buffer anew and uploads what does not change, if some of that is missing.
    fn hold_constant(&mut self, gpu: &Gpu, solids: &[ColliderFrame<'_>]) -> Result<bool, GpuError> {
        if solids.len() > MOST_SOLIDS {
            return Err(GpuError::Unsupported { what: "more than 32 solids at once" });
        }
        let shapes = || solids.iter().map(|solid| solid.shape).filter(|shape| !fields_of(shape).is_empty());
        let bodies_fit = bending(solids).count() <= self.bodies.len()
            && bending(solids).zip(&self.bodies).all(|(field, body)| body.fits(field));
        if bodies_fit && shapes().all(|shape| place_of(&self.held, shape).is_some()) {
            return Ok(false);
        }
        let mut held: Vec<(Shape, u32)> = Vec::new();
        let mut values: Vec<f32> = Vec::new();
        let mut described: Vec<f32> = Vec::new();
        for shape in shapes() {
            if place_of(&held, shape).is_none() {
                let is_one = matches!(shape, Shape::Sdf(_));
                held.push((shape.clone(), if is_one { values.len() } else { described.len() } as u32));
                for field in fields_of(shape) {
                    if !is_one {
                        described.extend(describe(field, values.len() as u32));
                    }
                    values.extend_from_slice(field.values());
                    // A float holds the numbers exactly: 2²⁴ bricks would be 8 GB.
                    values.extend(field.brick_numbers().map(|number| number as f32));
                }
            }
        }
        for (_, place) in held.iter_mut().filter(|(shape, _)| matches!(shape, Shape::Morph { .. })) {
            *place += values.len() as u32;
        }
        values.append(&mut described);
        let mut count = values.len();
        let mut bodies: Vec<DeviceBody> = Vec::new();
        for field in bending(solids) {
            let body = DeviceBody::new(field, count);
            count += body.len();
            bodies.push(body);
        }
        let bytes = (count * size_of::<f32>()) as u64;
        gpu.check_room("the solids' distance fields together", bytes, u64::MAX)?;
        self.fields = buffer_of(gpu, count);
        gpu.queue().write_buffer(&self.fields, 0, bytemuck::cast_slice(&values));
        bodies.iter_mut().for_each(|body| body.write_rest(gpu, &self.fields));
        (self.held, self.bodies) = (held, bodies);
        Ok(true)
    }

    /// Writes the queries of a frame: one after each substep, and those of [`queries`] after each
    /// span.
    pub fn write_frame(&mut self, gpu: &Gpu, rules: &FrameRules, frame: &SolidFrame<'_>) {
        let SolidFrame { substeps, plan, .. } = *frame;
        let h = frame.frame.dt_secs / f64::from(substeps);
        self.bytes.clear();
        self.query.count = frame.frame.colliders.len() as u32;
        self.query.thickness = rules.skin_thickness as f32;
        let limit = rules.stretch_limit.unwrap_or(FAR) as f32;
        let positional = if frame.positional { POSITIONAL } else { 0 };
        self.query.max_edge_push = (rules.depenetration_speed * h) as f32;
        self.query.max_push_out = (rules.depenetration_speed * h) as f32;
        // Contacts are reported by the query that comes last.
        let again = plan.any(|step| matches!(step, Step::RestoreIfMoved { .. }));
        let always = |step: &Step| matches!(step, Step::CollideFinal { unless_moved: false, .. });
        let is_final = again || plan.any(always);
        let restored = plan.any(|step| matches!(step, Step::RestoreLengths { .. })) && !is_final;
        let last = |reports: bool| if reports { LAST } else { 0 };
        for (step, fractions) in (0..substeps).zip(fractions(substeps)) {
            self.place(frame, fractions);
            let ends = step + 1 == substeps;
            self.query.how = AFTER_SUBSTEP | positional | last(ends && !is_final && !restored);
            let is_final_pass = rules.collides_once() && ends;
            self.query.slow_edges = if is_final_pass { 0.0 } else { 1.0 / substeps as f32 };
            self.query.stretch_limit = if is_final_pass { limit } else { FAR as f32 };
            self.append(step);
        }
        self.query.max_push_out = 0.0;
        self.query.slow_edges = 0.0;
        self.query.stretch_limit = limit;
        let unless = if again { UNLESS_MOVED } else { 0 };
        for &span in plan.spans() {
            let fractions = [span.end - 1, span.end].map(|step| f64::from(step) / f64::from(substeps));
            self.place(frame, fractions);
            let secs = span.secs(substeps, frame.frame.dt_secs);
            self.query.max_edge_push = (rules.depenetration_speed * secs) as f32;
            let ends = span.end == substeps;
            for (query, how) in [
                (queries::RESTORED, DISPLACED | last(restored && ends)),
                (queries::RESTORED_AGAIN, DISPLACED | IF_MOVED | last(ends)),
                (queries::FINAL, unless | last(ends)),
            ] {
                self.query.how = how;
                self.append(queries::at_end(span, query, substeps));
            }
        }
        gpu.queue().write_buffer(&self.queries, 0, &self.bytes);
    }

    /// Places the colliders of a query at `fractions` of the frame.
    fn place(&mut self, frame: &SolidFrame<'_>, fractions: [f64; 2]) {
        let mut bodies = self.bodies.iter();
        for (entry, solid) in self.query.solids.iter_mut().zip(frame.frame.colliders) {
            let place = place_of(&self.held, solid.shape).unwrap_or(0);
            *entry = entry_of(solid, fractions, frame.origin, place);
            if let Shape::Bending(field) = solid.shape
                && let Some(body) = bodies.next()
            {
                entry.place_body(field, body, fractions);
            }
        }
    }

    fn append(&mut self, number: u32) {
        self.bytes.resize((number * self.stride) as usize, 0);
        self.bytes.extend_from_slice(bytemuck::bytes_of(&*self.query));
    }
}

/// Bytes of `count` queries, each at a multiple of `stride`.
fn query_bytes(stride: u32, count: u32) -> u64 {
    u64::from(stride) * u64::from(count)
}

fn queries_of(gpu: &Gpu, stride: u32, count: u32) -> wgpu::Buffer {
    let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
    gpu.buffer("queries", query_bytes(stride, count), usage)
}

/// A buffer of `count` numbers.
fn buffer_of(gpu: &Gpu, count: usize) -> wgpu::Buffer {
    let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    gpu.buffer("fields", (count.max(1) * size_of::<f32>()) as u64, usage)
}

/// `solid`, which is held at `place`, from one fraction of its frame to another, relative to
/// `origin`.
fn entry_of(solid: &ColliderFrame<'_>, fractions: [f64; 2], origin: DVec3, place: u32) -> SolidEntry {
    let motion = SolidMotion::new(solid, fractions, origin);
    let matrix = |pose: &Pose| DMat4::from_rotation_translation(pose.rotation, pose.translation).as_mat4();
    let (kind, size) = match solid.shape {
        Shape::Sphere { radius } => (kinds::SPHERE, DVec3::splat(*radius)),
        Shape::HollowSphere { radius } => (kinds::HOLLOW_SPHERE, DVec3::splat(*radius)),
        Shape::Capsule { half_length, radius } => {
            (kinds::CAPSULE, DVec3::new(*half_length, *radius, *radius))
        }
        Shape::Box { half_extents } => (kinds::BOX, *half_extents),
        Shape::Plane => (kinds::PLANE, DVec3::ZERO),
        Shape::Sdf(_) => (kinds::FIELD, DVec3::ZERO),
        Shape::Bending(_) => (kinds::BENDING, DVec3::ZERO),
        Shape::Morph { .. } => (kinds::MORPH, DVec3::ZERO),
    };
    let (ball, ball_radius) = motion.ball.unwrap_or((DVec3::ZERO, FAR));
    let field = fields_of(solid.shape).first();
    let phases = match solid.shape {
        Shape::Morph { phases: [from, to], .. } => fractions.map(|fraction| from + (to - from) * fraction),
        _ => [0.0; 2],
    };
    SolidEntry {
        at_end: matrix(&motion.poses[1].inverse()),
        at_start: matrix(&motion.poses[0].inverse()),
        carry: matrix(&motion.carry),
        spin: motion.spin.as_vec3(),
        friction: solid.friction as f32,
        travel: motion.travel.as_vec3(),
        kind,
        pivot: motion.pivot.as_vec3(),
        thinness: solid.shape.thinness().min(FAR) as f32,
        size: size.as_vec3(),
        cell: solid.shape.cell().unwrap_or(0.0),
        ball: ball.as_vec3(),
        ball_radius: ball_radius as f32,
        origin: field.map_or(Vec3::ZERO, |field| field.origin()),
        described: match solid.shape {
            Shape::Sdf(field) => table_of(field, place),
            _ => place,
        },
        dims: field.map_or(UVec3::ONE, |field| field.dims()),
        first: place,
        phases: DVec2::from_array(phases).as_vec2(),
        swell: motion.swell as f32,
        fields: fields_of(solid.shape).len() as u32,
        body: UVec4::ZERO,
    }
}
