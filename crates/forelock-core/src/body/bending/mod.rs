//! The distance field of a body that bends, during one step.
//!
//! # Theory
//! At the step's start and at its end the field is that of the posed surface ([`build`]); between
//! them it is their blend, σ(p, f) = (1 − f) σ₀(p) + f σ₁(p). In a step of 1/60 s skin moves by a
//! few millimetres to centimetres relative to the joint that carries the hair, less than the parts
//! of a body are thick, and then the blend is the distance to a surface that moves from one to the
//! other (see [`Morph`](super::Morph)).
//!
//! Where the body touches hair, the skin's displacement is that of the nearest triangle, so skin
//! that slides along its own surface carries hair by friction.
//!
//! For a point that does not move, σ over the rest of a step is at least the smaller of the blend
//! now and σ₁. So a clearance that is computed from both holds until the step's end, and at the
//! start of the next step it falls by at most [`BendingField::fall`] of the cell.
//!
//! # Limitations
//! Deeper inside than the band the field is flat: hair that gets there is held and not pushed out.
//! Between two poses that differ by more than the thickness of a part, the part vanishes in
//! between. Distances beyond 1.25 coarse cells, 20 mm with cells of 4 mm near the surface, are
//! lower bounds.

mod brick;
mod build;
mod grid;
mod parts;
mod triangle;
mod winding;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::{UVec3, Vec3};
use rayon::prelude::*;

use super::bvh::nearest_barycentric;
use super::sdf::{BRICK_NODES, NO_BRICK, REFINEMENT, Sdf};
use super::{ClosedFaces, PACKET, SdfError, TriMesh};
use build::{Level, Work, build};
use grid::Grid;
pub use parts::{BendingBody, BendingLevel};

/// The most coarse nodes of a field; larger ones have larger cells.
const MOST_NODES: f32 = 1.5e6;
/// A fall that leaves no clearance, metres.
const ALL: f32 = 1e6;
/// The fall of a cell in which the field is the same at both ends.
pub const STILL: f32 = -1.0;

/// A body at rest, and the place and the cells of its field.
#[derive(Debug)]
struct Body {
    faces: ClosedFaces,
    grid: Grid,
    /// The field at rest.
    base: Level,
}

/// The distance field of a body that bends, from one pose to the next, in the space of the joint
/// that carries the hair.
#[derive(Debug)]
pub struct BendingField {
    body: Arc<Body>,
    /// At the step's start and at its end.
    ends: [Level; 2],
    /// For each cell, how far the field falls at most at any of its points, metres; [`STILL`] where
    /// both ends are alike.
    fall: Vec<f32>,
    changes: bool,
    /// The largest displacement of a corner within the box, metres.
    motion: f32,
    work: Work,
}

impl Clone for BendingField {
    fn clone(&self) -> Self {
        let Self { body, ends, fall, changes, motion, work: _ } = self;
        Self {
            body: body.clone(),
            ends: ends.clone(),
            fall: fall.clone(),
            changes: *changes,
            motion: *motion,
            work: Work::default(),
        }
    }
}

impl PartialEq for BendingField {
    fn eq(&self, other: &Self) -> bool {
        let corners = |field: &Self| field.ends.each_ref().map(|end| end.corners.clone());
        Arc::ptr_eq(&self.body, &other.body) && corners(self) == corners(other)
    }
}

/// Where a [`BendingField`] is, and how fine.
#[derive(Clone, Debug, PartialEq)]
pub struct BendingBox {
    /// The box in which the field is needed, (low, high) in metres.
    pub bounds: [Vec3; 2],
    /// The balls in that box in which it is needed, centre and radius in metres; all of the box if
    /// there are none. Elsewhere the field says that nothing is near.
    pub balls: Vec<(Vec3, f32)>,
    /// Side of the cells near the surface in metres; larger where the box is so large that the
    /// field would have too many.
    pub near: f32,
    /// See [`Shape::thinness`](super::Shape::thinness), metres.
    pub thinness: f32,
}

impl BendingField {
    /// The field of `mesh`, whose vertices move, at rest.
    ///
    /// # Errors
    /// [`SdfError`] if the mesh encloses nothing, or `place` is no box or has no cells.
    pub fn new(mesh: &TriMesh, place: &BendingBox) -> Result<Self, SdfError> {
        let faces = ClosedFaces::new(mesh);
        if !faces.encloses_something() {
            return Err(SdfError::NothingInside);
        }
        let [low, high] = place.bounds;
        let size = high - low;
        let frame = || SdfError::Frame { origin: low, cell: place.near };
        if !(low.is_finite()
            && size.min_element() > 0.0
            && size.is_finite()
            && place.near > 0.0
            && place.thinness > 0.0)
        {
            return Err(frame());
        }
        let mut cell = place.near * REFINEMENT as f32;
        let nodes = |cell: f32| ((size / cell).ceil() + 2.0).element_product();
        while nodes(cell) > MOST_NODES {
            cell *= 1.05;
        }
        let dims: UVec3 = (size / cell).ceil().as_uvec3() + 2;
        let origin = (low + high - (dims - 1).as_vec3() * cell) * 0.5;
        let mut grid = Grid { dims, origin, cell, reached: Default::default() };
        let everywhere = [((low + high) * 0.5, size.length())];
        grid.find_reached(if place.balls.is_empty() { &everywhere } else { &place.balls });
        let sdf = Sdf::blank(dims, origin, cell, place.thinness).ok_or_else(frame)?;
        let mut base = Level { sdf, nearest: Vec::new(), corners: Vec::new() };
        faces.write_positions(&mesh.positions, &mut base.corners);
        let mut work = Work::default();
        build(&grid, &faces, None, &mut base, &mut work);
        let ends = [base.clone(), base.clone()];
        let fall = vec![STILL; base.sdf.least().len()];
        Ok(Self { body: Arc::new(Body { faces, grid, base }), ends, fall, changes: false, motion: 0.0, work })
    }

    /// Starts a step at the end of the last one, to a pose with the mesh's vertices at `positions`.
    pub fn advance(&mut self, positions: &[Vec3]) {
        self.ends.swap(0, 1);
        self.set_end(1, positions);
        self.compare();
    }

    /// Starts a step from one pose to another.
    pub fn set(&mut self, positions: [&[Vec3]; 2]) {
        for (end, positions) in positions.into_iter().enumerate() {
            self.set_end(end, positions);
        }
        self.compare();
    }

    /// Stands still in a pose with the mesh's vertices at `positions`.
    pub fn hold(&mut self, positions: &[Vec3]) {
        self.set_end(1, positions);
        self.ends[0] = self.ends[1].clone();
        self.compare();
    }

    fn set_end(&mut self, end: usize, positions: &[Vec3]) {
        let Body { faces, grid, base } = &*self.body;
        let level = &mut self.ends[end];
        faces.write_positions(positions, &mut level.corners);
        build(grid, faces, Some(base), level, &mut self.work);
    }

    /// Whether the body bends in the step.
    pub fn changes(&self) -> bool {
        self.changes
    }

    /// The largest displacement in the step of a corner of the surface within the field's box,
    /// metres.
    pub fn motion(&self) -> f32 {
        self.motion
    }

    /// The side of the cells near the surface, metres.
    pub fn cell(&self) -> f32 {
        self.ends[1].sdf.near_cell()
    }

    /// See [`Shape::thinness`](super::Shape::thinness), metres.
    pub fn thinness(&self) -> f32 {
        self.ends[1].sdf.thinness()
    }

    /// The box of the field, (low, high) in metres.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        self.ends[1].sdf.bounds()
    }

    /// The field at the step's end.
    pub fn end(&self) -> &Sdf {
        &self.ends[1].sdf
    }

    /// The faces of the surface.
    pub fn faces(&self) -> &ClosedFaces {
        &self.body.faces
    }

    /// Bytes of the fields in memory.
    pub fn bytes(&self) -> usize {
        let of_level = |level: &Level| {
            level.sdf.bytes() + size_of_val(&level.nearest[..]) + size_of_val(&level.corners[..])
        };
        let levels = self.ends.iter().chain([&self.body.base]);
        levels.map(of_level).sum::<usize>() + size_of_val(&self.fall[..])
    }

    /// How far the field falls at most in the step at a point in the cell of `p`, metres.
    #[inline(always)]
    pub fn fall(&self, p: Vec3) -> f32 {
        self.fall[self.ends[1].sdf.block_of(p)].max(0.0)
    }

    /// Whether the field is the same at both ends of the step in the cell of `p`.
    #[inline(always)]
    pub fn is_still(&self, p: Vec3) -> bool {
        self.fall[self.ends[1].sdf.block_of(p)] == STILL
    }

    /// The distance in metres and its gradient at `p`, at `fraction` of the step.
    #[inline]
    pub fn sample(&self, p: Vec3, fraction: f64) -> (f32, Vec3) {
        let [from, to] = &self.ends;
        let share = fraction as f32;
        if share >= 1.0 || self.is_still(p) {
            return to.sdf.sample(p);
        }
        let ((before, a), (after, b)) = (from.sdf.sample(p), to.sdf.sample(p));
        let blended = a.lerp(b, share);
        // Opposite gradients cancel where the surface turns inside out.
        let gradient = if blended.length_squared() > 1e-6 { blended } else { b };
        (before + (after - before) * share, gradient)
    }

    /// [`BendingField::sample`] of a packet, component-major. Results are bit-identical to those of
    /// single points.
    #[inline(always)]
    pub fn sample_packet(&self, p: [[f32; PACKET]; 3], fraction: f64) -> ([f32; PACKET], [[f32; PACKET]; 3]) {
        let [from, to] = &self.ends;
        let (ends, slopes) = to.sdf.sample_lanes(p);
        let share = fraction as f32;
        let point = |k: usize| Vec3::new(p[0][k], p[1][k], p[2][k]);
        let same: [bool; PACKET] = std::array::from_fn(|k| self.is_still(point(k)));
        if share >= 1.0 || same.iter().all(|same| *same) {
            return (ends, slopes);
        }
        let (starts, before) = from.sdf.sample_lanes(p);
        let (mut values, mut gradients) = (ends, slopes);
        for k in 0..PACKET {
            if same[k] {
                continue;
            }
            let (a, b) = ([0, 1, 2].map(|c| before[c][k]), [0, 1, 2].map(|c| slopes[c][k]));
            let (a, b) = (Vec3::from_array(a), Vec3::from_array(b));
            let blended = a.lerp(b, share);
            let gradient = if blended.length_squared() > 1e-6 { blended } else { b };
            values[k] = starts[k] + (ends[k] - starts[k]) * share;
            for c in 0..3 {
                gradients[c][k] = gradient[c];
            }
        }
        (values, gradients)
    }

    /// The distance at the step's end, metres.
    #[inline]
    pub fn sample_end(&self, p: Vec3) -> f32 {
        self.ends[1].sdf.sample(p).0
    }

    /// The displacement over the whole step of the skin nearest to `p`, metres. `None` where the
    /// surface is farther than the field's band.
    pub fn displacement(&self, p: Vec3) -> Option<Vec3> {
        let [from, to] = &self.ends;
        if self.is_still(p) {
            return Some(Vec3::ZERO);
        }
        let node = to.sdf.nearest_in_brick(p)?;
        let triangle = to.nearest[node - to.nodes()];
        if triangle == u32::MAX {
            return None;
        }
        let corners = self.body.faces.corners_of(triangle).map(|corner| corner as usize);
        let now = corners.map(|corner| to.corners[corner]);
        let shares = nearest_barycentric(&now, p);
        let moved = corners.map(|corner| to.corners[corner] - from.corners[corner]);
        Some(moved[0] * shares[0] + moved[1] * shares[1] + moved[2] * shares[2])
    }

    /// Finds where and how far the field falls.
    fn compare(&mut self) {
        let [from, to] = &self.ends;
        let (low, high) = to.sdf.bounds();
        let pairs = from.corners.iter().zip(&to.corners);
        let is_in = |p: &Vec3| p.cmpge(low).all() && p.cmple(high).all();
        let within = pairs.filter(|(from, to)| is_in(from) || is_in(to));
        self.motion = within.map(|(from, to)| from.distance_squared(*to)).fold(0.0, f32::max).sqrt();
        self.changes = from.corners != to.corners;
        if !self.changes {
            self.fall.fill(STILL);
            return;
        }
        let [columns, rows, _] = self.body.grid.dims.to_array().map(|n| n as usize);
        let at_rest = self.body.base.sdf.values().len();
        let plane = columns * rows;
        let nodes = from.nodes();
        let [before, after] = [from, to].map(|level| (&level.sdf.values()[..nodes], level.sdf.starts()));
        self.fall.par_chunks_mut((columns - 1) * (rows - 1)).enumerate().for_each(|(k, fall)| {
            for row in 0..rows - 1 {
                for column in 0..columns - 1 {
                    let at = column + columns * row + plane * k;
                    let corners = [at, at + columns, at + plane, at + plane + columns];
                    let (mut greatest, mut alike) = (0.0f32, true);
                    for corner in corners.into_iter().flat_map(|at| [at, at + 1]) {
                        let falls = before.0[corner] - after.0[corner];
                        greatest = greatest.max(falls);
                        alike &= falls == 0.0;
                    }
                    let starts = [before, after].map(|(_, starts)| starts[at]);
                    let fall = &mut fall[column + (columns - 1) * row];
                    *fall = match starts {
                        [NO_BRICK, NO_BRICK] => {
                            if alike {
                                STILL
                            } else {
                                greatest
                            }
                        }
                        [NO_BRICK, _] | [_, NO_BRICK] => ALL,
                        [a, b] if a == b && (a as usize) < at_rest => STILL,
                        [a, b] => {
                            let before = &from.sdf.values()[a as usize..][..BRICK_NODES];
                            let after = &to.sdf.values()[b as usize..][..BRICK_NODES];
                            before.iter().zip(after).map(|(a, b)| a - b).fold(0.0, f32::max)
                        }
                    };
                }
            }
        });
    }
}
