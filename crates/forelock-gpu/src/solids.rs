//! Solids on the device.

use crate::{Gpu, GpuError};
use bytemuck::{Pod, Zeroable};
use forelock_core::body::{ColliderFrame, Sdf, Shape};
use forelock_core::pose::Pose;
use forelock_core::frame::{Frame, fractions};
use forelock_core::solver::{SolverParams};
use forelock_core::collide::resolve_solids::SolidMotion;
use glam::{DMat4, DVec2, DVec3, Mat4, UVec3, Vec2, Vec3};
use std::sync::Arc;
use wgpu::BufferUsages;

/// Solids of a frame at most.
pub const MOST_SOLIDS: usize = 32;
/// Numbers of the shapes.
pub mod kinds {
    /// A ball.
    pub const SPHERE: u32 = 0;
    /// A ball that holds what is in it.
    pub const HOLLOW_SPHERE: u32 = 1;
    /// A capsule.
    pub const CAPSULE: u32 = 2;
    /// A box.
    pub const BOX: u32 = 3;
    /// A plane.
    pub const PLANE: u32 = 4;
    /// A field of distances.
    pub const FIELD: u32 = 5;
    /// Fields, one after the other: a shape that changes.
    pub const MORPH: u32 = 6;
}

/// The same by name, for the kernels.
pub const KINDS: [(&str, u32); 7] = [
    ("SPHERE", kinds::SPHERE),
    ("HOLLOW_SPHERE", kinds::HOLLOW_SPHERE),
    ("CAPSULE", kinds::CAPSULE),
    ("BOX", kinds::BOX),
    ("PLANE", kinds::PLANE),
    ("FIELD", kinds::FIELD),
    ("MORPH", kinds::MORPH),
];
/// Bits of [`LookUniform::how`].
pub const HOW: [(&str, u32); 2] = [("AFTER_SUBSTEP", AFTER_SUBSTEP), ("LAST", LAST)];
const AFTER_SUBSTEP: u32 = 1;
const LAST: u32 = 2;

/// A solid in a substep: `Solid` in the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SolidEntry {
    /// From positions to its own space at the substep's end.
    pub at_end: Mat4,
    /// The same at its start.
    pub at_start: Mat4,
    /// From positions to positions, of what moves with it.
    pub carry: Mat4,
    /// Rotation vector of the carrier over the substep.
    pub spin: Vec3,
    /// Coulomb friction.
    pub friction: f32,
    /// How far the carrier goes, metres.
    pub travel: Vec3,
    /// One of [`kinds`].
    pub kind: u32,
    /// Where the carrier is, metres.
    pub pivot: Vec3,
    /// What moves less than this cannot pass through, metres.
    pub thinness: f32,
    /// Radius; half length and radius; half extents. Metres.
    pub size: Vec3,
    /// Side of a field's cells, metres; 0 for what is exact.
    pub cell: f32,
    /// Middle of a ball that holds it.
    pub ball: Vec3,
    /// And its radius, metres.
    pub ball_radius: f32,
    /// A field's first node, metres.
    pub origin: Vec3,
    /// Of a shape that changes, where its first field is described.
    pub described: u32,
    /// A field's nodes.
    pub dims: UVec3,
    /// Where its values start.
    pub first: u32,
    /// How far along its fields a shape that changes is at the substep's start and end.
    pub phases: Vec2,
    /// How far its surface may move in the substep, metres.
    pub swell: f32,
    /// How many fields it has.
    pub fields: u32,
}

/// Numbers that describe a field: first node, side of a cell, nodes, and where its values start, in two halves.
pub const FIELD_NUMBERS: u32 = 9;

/// A look at all solids: `Look` in the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LookUniform {
    /// How many solids there are.
    pub count: u32,
    /// Bits of [`HOW`].
    pub how: u32,
    /// Distance kept from surfaces, metres.
    pub thickness: f32,
    /// Depth that a particle which was inside may lose now, metres.
    pub way_out: f32,
    /// The first `count` are there.
    pub solids: [SolidEntry; MOST_SOLIDS],
}

/// Nothing is farther, in metres: the kernels know no infinity.
pub const FAR: f64 = 1e30;

/// Fields that are on the device, and the looks of a frame.
#[derive(Debug)]
pub(crate) struct Solids {
    /// Values of all fields, one after the other.
    pub fields: wgpu::Buffer,
    /// Shapes whose fields are there, and where: the first value of a field, or where a shape that changes is described.
    held: Vec<(Shape, u32)>,
    /// A `LookUniform` a look, each at a multiple of `stride`.
    pub looks: wgpu::Buffer,
    pub stride: u32,
    look: Box<LookUniform>,
    /// All looks as bytes.
    bytes: Vec<u8>,
}

impl Solids {
    /// For frames of `substeps`, as yet without a field.
    pub fn new(gpu: &Gpu, substeps: u32) -> Self {
        let aligned = gpu.device().limits().min_uniform_buffer_offset_alignment;
        let stride = (size_of::<LookUniform>() as u32).next_multiple_of(aligned);
        let bytes = u64::from(stride) * u64::from(substeps + 1);
        Self {
            fields: buffer_of(gpu, &[]),
            held: Vec::new(),
            looks: gpu.buffer("looks", bytes, BufferUsages::UNIFORM | BufferUsages::COPY_DST),
            stride,
            look: Box::new(LookUniform::zeroed()),
            bytes: Vec::new(),
        }
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        self.fields.size() + self.looks.size()
    }

    /// Brings the fields of `solids` to the device; whether they are in a new buffer.
    pub fn hold(&mut self, gpu: &Gpu, solids: &[ColliderFrame<'_>]) -> Result<bool, GpuError> {
        if solids.len() > MOST_SOLIDS {
            return Err(GpuError::Unsupported { what: "more than 32 solids at once" });
        }
        let shapes = || solids.iter().map(|solid| solid.shape).filter(|shape| !fields_of(shape).is_empty());
        if shapes().all(|shape| place_of(&self.held, shape).is_some()) {
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
                }
            }
        }
        for (_, place) in held.iter_mut().filter(|(shape, _)| matches!(shape, Shape::Morph { .. })) {
            *place += values.len() as u32;
        }
        values.append(&mut described);
        gpu.check_room("the solids' distance fields together", size_of_val(&*values) as u64, u64::MAX)?;
        self.fields = buffer_of(gpu, &values);
        self.held = held;
        Ok(true)
    }

    /// Brings the looks of a frame to the device: one after each substep, and one after the lengths.
    pub fn place(
        &mut self,
        gpu: &Gpu,
        params: &SolverParams,
        frame: &Frame<'_>,
        origin: DVec3,
        looks_last: bool,
    ) {
        let (count, substeps) = (frame.colliders.len(), params.substeps());
        let h = frame.dt_secs / f64::from(substeps);
        self.bytes.clear();
        self.look.count = count as u32;
        self.look.thickness = params.skin_thickness() as f32;
        for (step, fractions) in (0..substeps).zip(fractions(substeps)) {
            for (entry, solid) in self.look.solids.iter_mut().zip(frame.colliders) {
                let place = place_of(&self.held, solid.shape).unwrap_or(0);
                *entry = entry_of(solid, fractions, origin, place);
            }
            let is_last = step + 1 == substeps;
            self.look.how = if is_last && !looks_last { AFTER_SUBSTEP | LAST } else { AFTER_SUBSTEP };
            self.look.way_out = (params.depenetration_speed() * h) as f32;
            self.append(step);
        }
        self.look.how = LAST;
        self.look.way_out = 0.0;
        self.append(substeps);
        gpu.queue().write_buffer(&self.looks, 0, &self.bytes);
    }

    fn append(&mut self, number: u32) {
        self.bytes.resize((number * self.stride) as usize, 0);
        self.bytes.extend_from_slice(bytemuck::bytes_of(&*self.look));
    }
}

/// The fields of a shape; none of a primitive.
fn fields_of(shape: &Shape) -> &[Sdf] {
    match shape {
        Shape::Sdf(field) => std::slice::from_ref(field),
        Shape::Morph { morph, .. } => morph.fields(),
        _ => &[],
    }
}

/// Where `shape` is held, if it is.
fn place_of(held: &[(Shape, u32)], shape: &Shape) -> Option<u32> {
    let is_same = |own: &Shape| match (own, shape) {
        (Shape::Sdf(own), Shape::Sdf(other)) => Arc::ptr_eq(own, other),
        (Shape::Morph { morph: own, .. }, Shape::Morph { morph: other, .. }) => Arc::ptr_eq(own, other),
        _ => false,
    };
    held.iter().find(|(own, _)| is_same(own)).map(|(_, first)| *first)
}

/// [`FIELD_NUMBERS`] of a field whose values start at `first`.
fn describe(field: &Sdf, first: u32) -> [f32; FIELD_NUMBERS as usize] {
    let ([x, y, z], [i, j, k]) = (field.origin().to_array(), field.dims().as_vec3().to_array());
    [x, y, z, field.cell(), i, j, k, (first >> 16) as f32, (first & 0xffff) as f32]
}

fn buffer_of(gpu: &Gpu, values: &[f32]) -> wgpu::Buffer {
    gpu.filled("fields", bytemuck::cast_slice(values), BufferUsages::STORAGE)
}

/// `solid`, which is held at `place`, from one fraction of its frame to another, relative to `origin`.
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
        described: place,
        dims: field.map_or(UVec3::ONE, |field| field.dims()),
        first: place,
        phases: DVec2::from_array(phases).as_vec2(),
        swell: motion.swell as f32,
        fields: fields_of(solid.shape).len() as u32,
    }
}
