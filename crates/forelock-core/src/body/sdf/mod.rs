//! Signed distance fields on a regular grid: what a solid looks like to a strand.
//!
//! # Theory
//! σ(p) is the distance from p to the solid's surface, negative inside. Between the nodes it is trilinear, so that it
//! is continuous and its gradient inside a cell is the exact derivative of the value returned. Outside the grid, with
//! c the nearest point of the grid's box, every point q of the solid has (p − c)·(q − c) ≤ 0, hence
//! |p − q|² ≥ |p − c|² + |c − q|²: the field answers √(|p − c|² + σ(c)²), a lower bound of the truth.
//!
//! # Limitations
//! Features thinner than a cell are seen only where a node falls into them. Trilinear interpolation of an exact
//! distance errs by at most cell²/(8 r) per axis where the surface's radius of curvature is r, and rounds sharp edges by about
//! a third of a cell.

mod build;
mod bytes;

use glam::{UVec3, Vec3};

pub use bytes::SdfBytesError;

/// Signed distances in metres on the nodes of a regular grid, negative inside; x varies fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Sdf {
    dims: UVec3,
    origin: Vec3,
    cell: f32,
    values: Vec<f32>,
    /// 1 / cell, and the last node's index, so that a sample need not derive them.
    inv_cell: f32,
    top: Vec3,
}

/// Why values do not make a field.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SdfError {
    /// Fewer than two nodes along an axis, or more than memory can index.
    #[error("a grid of {} x {} x {} nodes cannot hold a field", .0.x, .0.y, .0.z)]
    Dims(UVec3),
    /// The number of values is not the number of nodes.
    #[error("the grid has {expected} nodes, but {found} values were given")]
    Length {
        /// Nodes of the grid.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// The cell is not a positive length, or the origin is not finite.
    #[error("the grid needs a finite origin and a positive cell, not {origin} and {cell} m")]
    Frame {
        /// The origin given.
        origin: Vec3,
        /// The cell given.
        cell: f32,
    },
    /// More or fewer nodes than a field is made with, or a padding that is not a length.
    #[error("a field is made with 8 to 1024 nodes and a padding of 0 m or more, not {nodes} and {padding} m")]
    Resolution {
        /// Nodes along the longest axis.
        nodes: u32,
        /// Padding in metres.
        padding: f32,
    },
    /// The mesh encloses nothing.
    #[error("the mesh encloses no volume, so it has no inside")]
    NothingInside,
    /// A value is not finite.
    #[error("value {0} of the field is not finite")]
    NonFinite(usize),
}

impl Sdf {
    /// A field of `values` (metres, x fastest) on `dims` nodes, the first at `origin`, `cell` metres apart.
    ///
    /// # Errors
    /// [`SdfError`] if there are fewer than two nodes along an axis, the values are not one a node, or anything is
    /// not finite.
    pub fn new(dims: UVec3, origin: Vec3, cell: f32, values: Vec<f32>) -> Result<Self, SdfError> {
        let expected = node_count(dims).ok_or(SdfError::Dims(dims))?;
        if !(origin.is_finite() && cell > 0.0 && cell.is_finite() && (1.0 / cell).is_finite()) {
            return Err(SdfError::Frame { origin, cell });
        }
        if values.len() != expected {
            return Err(SdfError::Length { expected, found: values.len() });
        }
        if let Some(node) = values.iter().position(|v| !v.is_finite()) {
            return Err(SdfError::NonFinite(node));
        }
        let top = (dims - 1).as_vec3();
        Ok(Self { dims, origin, cell, values, inv_cell: 1.0 / cell, top })
    }

    /// Nodes along x, y and z, each at least 2.
    pub fn dims(&self) -> UVec3 {
        self.dims
    }

    /// The first node, in metres.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Distance between neighbouring nodes, in metres.
    pub fn cell(&self) -> f32 {
        self.cell
    }

    /// Signed distances in metres, one a node, x fastest.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The box of nodes: (first, last) in metres.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        (self.origin, self.origin + self.top * self.cell)
    }

    /// The signed distance in metres at `p` and its gradient (not of unit length, but never zero: +y stands in where
    /// the interpolant is flat).
    ///
    /// Outside the grid the distance is a lower bound and positive.
    #[inline]
    pub fn sample(&self, p: Vec3) -> (f32, Vec3) {
        let at = (p - self.origin) * self.inv_cell;
        let inside = at.clamp(Vec3::ZERO, self.top);
        let low = inside.min(self.top - 1.0);
        let (i, j, k) = (low.x as usize, low.y as usize, low.z as usize);
        let f = inside - Vec3::new(i as f32, j as f32, k as f32);
        let (row, layer) = (self.dims.x as usize, self.dims.x as usize * self.dims.y as usize);
        let first = i + row * j + layer * k;
        let pair = |at: usize| {
            let pair = &self.values[at..at + 2];
            (pair[0] + (pair[1] - pair[0]) * f.x, pair[1] - pair[0])
        };
        let (v00, d00) = pair(first);
        let (v10, d10) = pair(first + row);
        let (v01, d01) = pair(first + layer);
        let (v11, d11) = pair(first + layer + row);
        let (v0, v1) = (v00 + (v10 - v00) * f.y, v01 + (v11 - v01) * f.y);
        let (d0, d1) = (d00 + (d10 - d00) * f.y, d01 + (d11 - d01) * f.y);
        let (e0, e1) = (v10 - v00, v11 - v01);
        let value = v0 + (v1 - v0) * f.z;
        let slope = Vec3::new(d0 + (d1 - d0) * f.z, e0 + (e1 - e0) * f.z, v1 - v0) * self.inv_cell;
        if at == inside {
            (value, if slope.length_squared() > 1e-12 { slope } else { Vec3::Y })
        } else {
            self.beyond(at, inside, value, slope)
        }
    }

    /// A sample outside the grid, from the value and slope at the nearest point of its box.
    #[cold]
    fn beyond(&self, at: Vec3, inside: Vec3, value: f32, slope: Vec3) -> (f32, Vec3) {
        let away = (at - inside) * self.cell;
        let distance = (away.length_squared() + value * value).sqrt();
        let along = Vec3::select(away.cmpeq(Vec3::ZERO), slope, Vec3::ZERO);
        let gradient = (away + along * value.max(0.0)) / distance;
        (distance, if gradient.length_squared() > 1e-12 { gradient } else { Vec3::Y })
    }
}

/// Nodes of a grid of `dims`, if it has at least two along each axis and memory can index them.
fn node_count(dims: UVec3) -> Option<usize> {
    if dims.min_element() < 2 {
        return None;
    }
    let nodes = u64::from(dims.x).checked_mul(u64::from(dims.y))?.checked_mul(u64::from(dims.z))?;
    usize::try_from(nodes).ok().filter(|&nodes| nodes <= isize::MAX as usize / 4)
}

#[cfg(test)]
mod tests {
    use super::super::shapes_for_tests::lattice;
    use super::*;

    /// A ball of radius 0.4 on a grid that reaches from −0.5 to 0.5.
    fn ball() -> Sdf {
        let values = (0..21 * 21 * 21)
            .map(|i| {
                let p = UVec3::new(i % 21, i / 21 % 21, i / 441).as_vec3() * 0.05 - 0.5;
                p.length() - 0.4
            })
            .collect();
        Sdf::new(UVec3::splat(21), Vec3::splat(-0.5), 0.05, values).unwrap()
    }

    #[test]
    fn the_gradient_is_the_derivative_of_the_value() {
        let (sdf, h) = (ball(), 1e-3);
        let mut compared = 0;
        for p in lattice(3000, 0.7) {
            let at = (p + 0.5) / 0.05;
            // Within a cell only: the slope jumps between cells.
            if (at - at.round()).abs().min_element() < 0.05 {
                continue;
            }
            let (_, gradient) = sdf.sample(p);
            let slope = Vec3::from_array(std::array::from_fn(|axis| {
                let step = Vec3::AXES[axis] * h;
                (sdf.sample(p + step).0 - sdf.sample(p - step).0) / (2.0 * h)
            }));
            assert!((slope - gradient).length() < 2e-3, "{p}: {gradient} for {slope}");
            compared += 1;
        }
        assert!(compared > 1000);
    }

    #[test]
    fn outside_the_grid_the_distance_is_a_positive_lower_bound() {
        let sdf = ball();
        for p in lattice(3000, 4.0) {
            if p.abs().max_element() > 0.5 {
                let (distance, gradient) = sdf.sample(p);
                assert!(distance > 0.0 && distance <= p.length() - 0.4 + 1e-3, "{p}: {distance}");
                assert!(gradient.dot(p) > 0.0);
            }
        }
        let (distance, _) = sdf.sample(Vec3::X * 3.0);
        assert!(distance > 2.5, "{distance}");
    }

    #[test]
    fn a_flat_place_still_has_a_direction() {
        let flat = Sdf::new(UVec3::splat(2), Vec3::ZERO, 1.0, vec![-1.0; 8]).unwrap();
        assert_eq!(flat.sample(Vec3::splat(0.5)), (-1.0, Vec3::Y));
        assert!(flat.sample(Vec3::NAN).1.is_finite() || flat.sample(Vec3::NAN).0.is_nan());
    }

    #[test]
    fn fields_that_cannot_be_are_refused() {
        let new = |dims: [u32; 3], cell, values| Sdf::new(dims.into(), Vec3::ZERO, cell, values);
        assert!(matches!(new([1, 8, 1], 1.0, vec![0.0; 8]), Err(SdfError::Dims(_))));
        assert!(matches!(new([u32::MAX; 3], 1.0, vec![]), Err(SdfError::Dims(_))));
        assert!(matches!(new([2; 3], 1.0, vec![0.0; 7]), Err(SdfError::Length { .. })));
        assert!(matches!(new([2; 3], 0.0, vec![0.0; 8]), Err(SdfError::Frame { .. })));
        assert!(matches!(new([2; 3], 1.0, vec![f32::NAN; 8]), Err(SdfError::NonFinite(0))));
    }
}
