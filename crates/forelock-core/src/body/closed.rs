//! Closing a triangle mesh, so that inside and outside are well defined for any mesh.
//!
//! # Theory
//! The boundary of a sum of oriented triangles is a set of directed edges, and at every vertex as
//! many edges arrive as leave. Hence the boundary of any mesh splits into loops. Each loop is
//! closed by a cone from its centroid; then the surface has no boundary and its winding number is
//! an integer everywhere. (A cone also cancels a triangle that is wound the wrong way.) Inside is
//! where the winding number is positive. Where parts overlap (eyes in a head, an ear that reaches
//! into it), triangles with the inside on both sides do not bound the solid and are left out of the
//! distance.
//!
//! The generalised winding number of a mesh with holes (Jacobson 2013; Barill 2018, by dipoles)
//! also closes holes, but leaves the distance to the closing surface undefined. Here the closing
//! surface is part of the mesh, so distance and sign are consistent.
//!
//! # Limitations
//! A hole is closed by a cone over its rim: this is right for necks, eyes and small holes, and
//! crude for a rim that folds back on itself. A single sheet closes to a body without thickness,
//! which encloses nothing.

mod segment;

use std::collections::HashMap;

use glam::Vec3;
use rayon::prelude::*;

use super::bvh::{Bvh, Nearest};
use super::mesh::TriMesh;
pub use segment::{SEGMENT_TOLERANCE_M, segment_tolerance};

/// Vertices closer than this fraction of the mesh's diagonal are merged.
const WELD: f32 = 1e-6;
/// Distance at which both sides of a triangle are probed, as a fraction of the mesh's diagonal.
const PROBE: f32 = 1e-5;

/// A closed surface made from a mesh, with search trees for distances and winding numbers.
#[derive(Clone, Debug)]
pub struct ClosedMesh {
    triangles: Vec<[Vec3; 3]>,
    winding: Bvh,
    surface: Bvh,
    report: ClosingReport,
}

/// Statistics of closing a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClosingReport {
    /// Number of closed rims: one for each hole, two for each triangle wound the wrong way.
    pub rims: usize,
    /// Length of the longest rim in metres.
    pub longest_rim: f32,
    /// Triangles left out because they lie inside other parts or bound nothing.
    pub hidden_triangles: usize,
    /// Whether all triangles were reversed because the mesh had a negative volume.
    pub turned: bool,
}

/// The triangles of a closed surface as indices, for a mesh whose vertices move.
#[derive(Clone, Debug, PartialEq)]
pub struct ClosedFaces {
    /// Corners of each triangle: vertices of the mesh, then the centres of rims.
    corners: Vec<[u32; 3]>,
    /// The vertices around each rim that is closed by a cone from its centre.
    rims: Vec<Vec<u32>>,
    /// Whether the inside is on one side of a triangle of the mesh at rest and the outside on the
    /// other.
    bounding: Vec<bool>,
    report: ClosingReport,
}

impl ClosedFaces {
    /// Closes `mesh`.
    pub fn new(mesh: &TriMesh) -> Self {
        Self::with_closed(mesh).0
    }

    /// The faces of `mesh` and its closed surface.
    fn with_closed(mesh: &TriMesh) -> (Self, ClosedMesh) {
        let (low, high) = mesh.bounds();
        let diagonal = (high - low).length();
        let mut corners = weld(mesh, low, diagonal * WELD);
        let loops = boundary_loops(&corners);
        let mut report = ClosingReport { rims: loops.len(), ..ClosingReport::default() };
        let mut rims = Vec::new();
        for rim in loops {
            let length =
                edges(&rim).map(|(a, b)| mesh.positions[a as usize].distance(mesh.positions[b as usize]));
            report.longest_rim = report.longest_rim.max(length.sum());
            if let [a, b, c] = rim[..] {
                corners.push([a, b, c]);
            } else {
                let centre = (mesh.positions.len() + rims.len()) as u32;
                corners.extend(edges(&rim).map(|(a, b)| [a, b, centre]));
                rims.push(rim);
            }
        }
        let mut faces = Self { corners, rims, bounding: Vec::new(), report };
        let positions = faces.positions(&mesh.positions);
        let at = |corners: &[u32; 3]| corners.map(|corner| positions[corner as usize]);
        let mut triangles: Vec<[Vec3; 3]> = faces.corners.iter().map(at).collect();
        faces.report.turned = volume(&triangles, (low + high) * 0.5) < 0.0;
        if faces.report.turned {
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            faces.corners.iter_mut().for_each(|corners| corners.swap(1, 2));
        }
        let winding = Bvh::from_triangles(triangles.clone());
        // Far from the origin places are rounded by more.
        let rounding = f32::EPSILON * low.abs().max(high.abs()).max_element();
        faces.bounding = are_bounding(&triangles, &winding, (diagonal * PROBE).max(4.0 * rounding));
        faces.report.hidden_triangles = faces.bounding.iter().filter(|bounding| !**bounding).count();
        let closed = faces.closed_with(triangles, winding);
        (faces, closed)
    }

    /// The closed surface of the mesh with its vertices at `positions`. The triangles that bound it
    /// are those of the mesh at rest.
    pub fn closed(&self, positions: &[Vec3]) -> ClosedMesh {
        let positions = self.positions(positions);
        let at = |corners: &[u32; 3]| corners.map(|corner| positions[corner as usize]);
        let triangles: Vec<_> = self.corners.iter().map(at).collect();
        let winding = Bvh::from_triangles(triangles.clone());
        self.closed_with(triangles, winding)
    }

    fn closed_with(&self, triangles: Vec<[Vec3; 3]>, winding: Bvh) -> ClosedMesh {
        let bounding = triangles.iter().zip(&self.bounding).filter(|(_, bounding)| **bounding);
        let surface = Bvh::from_triangles(bounding.map(|(triangle, _)| *triangle).collect());
        ClosedMesh { triangles, winding, surface, report: self.report }
    }

    /// The positions of all corners, from those of the mesh's vertices.
    fn positions(&self, vertices: &[Vec3]) -> Vec<Vec3> {
        let mut positions = Vec::with_capacity(vertices.len() + self.rims.len());
        self.write_positions(vertices, &mut positions);
        positions
    }

    /// Writes the positions of all corners to `out`, from those of the mesh's vertices.
    pub(super) fn write_positions(&self, vertices: &[Vec3], out: &mut Vec<Vec3>) {
        out.clear();
        out.extend_from_slice(vertices);
        out.extend(
            self.rims.iter().map(|rim| {
                rim.iter().map(|&vertex| vertices[vertex as usize]).sum::<Vec3>() / rim.len() as f32
            }),
        );
    }

    /// The corners of each triangle, and whether it bounds the solid.
    pub(super) fn triangles(&self) -> impl ExactSizeIterator<Item = ([u32; 3], bool)> + Clone {
        self.corners.iter().copied().zip(self.bounding.iter().copied())
    }

    /// Number of triangles.
    pub(super) fn len(&self) -> u32 {
        self.corners.len() as u32
    }

    /// Whether a triangle bounds the solid.
    #[inline(always)]
    pub(super) fn is_bounding(&self, triangle: u32) -> bool {
        self.bounding[triangle as usize]
    }

    /// The corners of a triangle.
    #[inline(always)]
    pub(super) fn corners_of(&self, triangle: u32) -> [u32; 3] {
        self.corners[triangle as usize]
    }

    /// Whether the surface encloses any volume.
    pub fn encloses_something(&self) -> bool {
        self.report.hidden_triangles < self.corners.len()
    }
}

impl ClosedMesh {
    /// Closes `mesh`.
    pub fn new(mesh: &TriMesh) -> Self {
        ClosedFaces::with_closed(mesh).1
    }

    /// Statistics of how the mesh was closed.
    pub fn report(&self) -> ClosingReport {
        self.report
    }

    /// Whether the surface encloses any volume.
    pub fn encloses_something(&self) -> bool {
        self.report.hidden_triangles < self.triangles.len()
    }

    /// The area of all triangles in m², including closing and hidden ones.
    pub fn area(&self) -> f32 {
        let doubled = |[a, b, c]: &[Vec3; 3]| (b - a).cross(c - a).length();
        self.triangles.iter().map(doubled).sum::<f32>() * 0.5
    }

    /// All triangles, including closing and hidden ones: a surface without boundary.
    pub(super) fn triangles(&self) -> &[[Vec3; 3]] {
        &self.triangles
    }

    /// The triangles between inside and outside.
    #[cfg(test)]
    pub(super) fn surface_triangles(&self) -> impl Iterator<Item = &[Vec3; 3]> {
        self.surface.triangles()
    }

    /// Whether `p` is inside: the winding number there is positive.
    pub fn contains(&self, p: Vec3) -> bool {
        self.winding.winding_number(p) > 0
    }

    /// The point nearest to `p` of the surface between inside and outside. The search is faster if
    /// `hint` is the result for a point close to `p`. The triangle index in the result is internal.
    /// `None` if nothing is enclosed.
    pub(super) fn nearest_from(&self, p: Vec3, hint: Option<&Nearest>) -> Option<Nearest> {
        self.surface.nearest_from(p, hint)
    }

    /// The depth of `p` in metres under the surface; 0 if it is outside. Outside it is faster than
    /// [`ClosedMesh::signed_distance`].
    pub fn depth(&self, p: Vec3) -> f32 {
        let distance = || self.nearest_from(p, None).map_or(0.0, |n| n.distance_squared.sqrt());
        if self.contains(p) { distance() } else { 0.0 }
    }

    /// The signed distance in metres from `p` to the surface, negative inside; +∞ if nothing is
    /// enclosed.
    pub fn signed_distance(&self, p: Vec3) -> f32 {
        let distance = self.nearest_from(p, None).map_or(f32::INFINITY, |n| n.distance_squared.sqrt());
        if self.contains(p) { -distance } else { distance }
    }
}

/// Pairs of consecutive vertices around a loop.
fn edges(rim: &[u32]) -> impl Iterator<Item = (u32, u32)> {
    rim.iter().copied().zip(rim.iter().copied().cycle().skip(1))
}

/// The faces of `mesh` without degenerate ones. Of vertices in the same cell of size `tolerance`
/// all are replaced by the first.
fn weld(mesh: &TriMesh, low: Vec3, tolerance: f32) -> Vec<[u32; 3]> {
    let mut known: HashMap<[i32; 3], u32> = HashMap::with_capacity(mesh.positions.len());
    let scale = if tolerance > 0.0 { 1.0 / tolerance } else { 0.0 };
    let place = |p: Vec3| ((p - low) * scale).round().as_ivec3().to_array();
    let positions = (0..).zip(&mesh.positions);
    let merged: Vec<u32> = positions.map(|(vertex, &p)| *known.entry(place(p)).or_insert(vertex)).collect();
    let faces = mesh.triangles.iter().map(|face| face.map(|v| merged[v as usize]));
    faces.filter(|[a, b, c]| a != b && b != c && c != a).collect()
}

/// Loops whose cones, added to `faces`, leave no boundary.
fn boundary_loops(faces: &[[u32; 3]]) -> Vec<Vec<u32>> {
    // Each undirected edge with +1 if a triangle traverses it upwards and −1 if downwards. The
    // edges whose sum is not zero are the boundary.
    let mut directed: Vec<(u32, u32, i32)> = faces
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        .map(|(a, b)| if a < b { (a, b, 1) } else { (b, a, -1) })
        .collect();
    directed.sort_unstable();
    let mut next: HashMap<u32, Vec<u32>> = HashMap::new();
    let mut starts = Vec::new();
    for same in directed.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        let net: i32 = same.iter().map(|e| e.2).sum();
        // The closing surface traverses the edge against the mesh.
        let (from, to) = if net > 0 { (same[0].1, same[0].0) } else { (same[0].0, same[0].1) };
        for _ in 0..net.abs() {
            next.entry(from).or_default().push(to);
            starts.push(from);
        }
    }
    let mut loops = Vec::new();
    for start in starts {
        let mut path = vec![start];
        let mut place: HashMap<u32, usize> = HashMap::from([(start, 0)]);
        while let Some(to) = path.last().and_then(|at| next.get_mut(at)).and_then(Vec::pop) {
            if let Some(&from) = place.get(&to) {
                let rim = path.split_off(from);
                rim.iter().for_each(|v| {
                    place.remove(v);
                });
                loops.push(rim);
                path.push(to);
                place.insert(to, from);
            } else {
                place.insert(to, path.len());
                path.push(to);
            }
        }
    }
    loops
}

/// Six times the signed volume enclosed by `triangles`, in m³; computed about `centre` to keep
/// precision.
fn volume(triangles: &[[Vec3; 3]], centre: Vec3) -> f64 {
    triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|p| (p - centre).as_dvec3());
            a.dot(b.cross(c))
        })
        .sum()
}

/// Which triangles have the inside on one side and the outside on the other, probed at `reach`
/// metres from the surface.
fn are_bounding(triangles: &[[Vec3; 3]], winding: &Bvh, reach: f32) -> Vec<bool> {
    // The centroid decides for almost all triangles; if another part cuts the triangle, only a
    // point near a corner or an edge may show it.
    const PLACES: [[f32; 3]; 7] = [
        [0.3333, 0.3334, 0.3333],
        [0.9, 0.06, 0.04],
        [0.04, 0.9, 0.06],
        [0.06, 0.04, 0.9],
        [0.48, 0.47, 0.05],
        [0.05, 0.48, 0.47],
        [0.47, 0.05, 0.48],
    ];
    let is_bounding = |[a, b, c]: &[Vec3; 3]| {
        let normal = (b - a).cross(c - a).normalize_or_zero() * reach;
        PLACES.iter().any(|w| {
            let p = *a * w[0] + *b * w[1] + *c * w[2];
            (winding.winding_number(p + normal) > 0) != (winding.winding_number(p - normal) > 0)
        })
    };
    triangles.par_iter().map(is_bounding).collect()
}

#[cfg(test)]
mod tests {
    use super::super::shapes_for_tests::{cuboid, lattice, uv_sphere};
    use super::*;

    #[test]
    fn a_sphere_with_holes_keeps_its_inside() {
        let mut mesh = uv_sphere(1.0, 32, 16);
        let whole = ClosedMesh::new(&mesh);
        assert_eq!(whole.report(), ClosingReport::default());
        // The southern cap below y = −0.7 and two single triangles are removed; one triangle is
        // reversed.
        mesh.triangles.retain(|t| t.iter().any(|&v| mesh.positions[v as usize].y > -0.7));
        mesh.triangles.swap_remove(200);
        mesh.triangles.swap_remove(100);
        mesh.triangles[50].swap(0, 1);
        let open = ClosedMesh::new(&mesh);
        // The reversed triangle has two rims: one removes it, the other restores it.
        assert_eq!(open.report().rims, 5);
        for p in lattice(3000, 1.2) {
            if p.y > -0.68 {
                assert_eq!(open.contains(p), whole.contains(p), "{p}");
            }
            if p.y < -0.72 {
                assert!(!open.contains(p), "{p}");
            }
        }
        // Near the closing surface the distance is the distance to it.
        assert!(open.signed_distance(Vec3::Y * -0.6) > -0.15);
        assert!(open.signed_distance(Vec3::Y * -0.9).is_sign_positive());
    }

    #[test]
    fn an_inside_out_mesh_is_reversed() {
        let mut mesh = cuboid(Vec3::ONE);
        mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        let closed = ClosedMesh::new(&mesh);
        assert!(closed.report().turned && closed.contains(Vec3::ZERO));
        assert_eq!(closed.signed_distance(Vec3::X * 0.75), -0.25);
    }

    #[test]
    fn faces_inside_other_parts_do_not_count() {
        let mut mesh = cuboid(Vec3::ONE);
        let inner = cuboid(Vec3::splat(0.5));
        mesh.triangles.extend(inner.triangles.iter().map(|t| t.map(|v| v + 8)));
        mesh.positions.extend(inner.positions);
        let closed = ClosedMesh::new(&mesh);
        assert_eq!(closed.report().hidden_triangles, 12);
        assert_eq!(closed.signed_distance(Vec3::X * 0.5), -0.5);
    }

    #[test]
    fn a_sheet_encloses_nothing() {
        let sheet = TriMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]).unwrap();
        let closed = ClosedMesh::new(&sheet);
        assert!(!closed.encloses_something());
        assert_eq!(closed.signed_distance(Vec3::Z), f32::INFINITY);
    }
}
