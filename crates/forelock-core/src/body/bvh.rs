//! A bounding volume hierarchy over triangles: nearest points and winding numbers.
//!
//! # Theory
//! The nearest point is found by descending into the nearer child first and skipping every box that
//! is farther than the best triangle so far. The winding number of a closed surface about p is the
//! signed number of its crossings with any ray from p: +1 where the ray leaves through the front of
//! a triangle, −1 where it enters. Rays run along +x, so that a crossing is a point-in-triangle
//! test in the yz plane. Ties are resolved by moving p by (ε, ε²) in that plane (simulation of
//! simplicity, Edelsbrunner and Mücke 1990), and each edge is always evaluated from the same end: a
//! ray through an edge or a vertex is counted exactly once, so the number is right on every closed
//! surface.
//!
//! # Practice
//! Nodes are split at the median along the longest axis. The tree is balanced, so the traversal
//! stack has a fixed size, and the same triangles always give the same tree. Corners are stored in
//! leaf order.

mod overlap;

use glam::{DVec3, Vec3};

use super::TriMesh;

/// Maximum number of triangles in a leaf.
const LEAF: usize = 4;
/// Largest depth of the traversal stack: a balanced tree over 2³² triangles with one pending
/// sibling per level.
const STACK: usize = 40;

/// A bounding volume hierarchy over triangles.
#[derive(Clone, Debug)]
pub struct Bvh {
    nodes: Vec<Node>,
    /// Corners in leaf order.
    corners: Vec<[Vec3; 3]>,
    /// For each triangle in leaf order, its index in the list from which the tree was built.
    sources: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// Leaf: its first triangle. Inner node: its right child (the left child is the next node).
    first: u32,
    /// Number of triangles of a leaf; 0 for an inner node.
    count: u32,
}

/// The point of a surface nearest to a query point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Index of the triangle in the list from which the tree was built.
    pub triangle: u32,
    /// Barycentric coordinates in the triangle; they sum to 1.
    pub barycentric: [f32; 3],
    /// The nearest point, in metres.
    pub point: Vec3,
    /// Squared distance to the query point, in m².
    pub distance_squared: f32,
    /// Index of the triangle in leaf order, used as a hint for a query nearby.
    slot: u32,
}

impl Bvh {
    /// Builds the tree over the triangles of `mesh`.
    pub fn new(mesh: &TriMesh) -> Self {
        Self::from_triangles((0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect())
    }

    /// Builds the tree over `triangles` (corners in metres, finite).
    pub fn from_triangles(triangles: Vec<[Vec3; 3]>) -> Self {
        let mut order: Vec<u32> = (0..u32::try_from(triangles.len()).unwrap_or(u32::MAX)).collect();
        let centres: Vec<Vec3> = triangles.iter().map(|[a, b, c]| *a + *b + *c).collect();
        let mut nodes = Vec::with_capacity(triangles.len());
        if !triangles.is_empty() {
            build(&triangles, &centres, &mut order, 0, &mut nodes);
        }
        Self { nodes, corners: order.iter().map(|&t| triangles[t as usize]).collect(), sources: order }
    }

    /// The point nearest to `p`; `None` if there are no triangles or `p` is not finite.
    pub fn nearest(&self, p: Vec3) -> Option<Nearest> {
        self.nearest_from(p, None)
    }

    /// [`Bvh::nearest`] with a hint: it is faster if `hint` is the result for a point near `p`.
    pub fn nearest_from(&self, p: Vec3, hint: Option<&Nearest>) -> Option<Nearest> {
        if self.nodes.is_empty() || !p.is_finite() {
            return None;
        }
        let mut best = self.measure(p, hint.map_or(0, |hint| hint.slot));
        let mut stack = [(0u32, 0.0f32); STACK];
        stack[0] = (0, box_distance_squared(&self.nodes[0], p));
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (mut at, distance) = stack[waiting];
            if distance >= best.distance_squared {
                continue;
            }
            loop {
                let node = &self.nodes[at as usize];
                if node.count > 0 {
                    for slot in node.first..node.first + node.count {
                        let found = self.measure(p, slot);
                        if found.distance_squared < best.distance_squared {
                            best = found;
                        }
                    }
                    break;
                }
                let (left, right) = (at + 1, node.first);
                let near = box_distance_squared(&self.nodes[left as usize], p);
                let far = box_distance_squared(&self.nodes[right as usize], p);
                let (near, far) =
                    if near <= far { ((left, near), (right, far)) } else { ((right, far), (left, near)) };
                if far.1 < best.distance_squared {
                    stack[waiting] = far;
                    waiting += 1;
                }
                if near.1 >= best.distance_squared {
                    break;
                }
                at = near.0;
            }
        }
        Some(best)
    }

    /// The winding number of the surface about `p`: exact if the triangles form a closed surface (a
    /// [`ClosedMesh`](super::ClosedMesh) can be made from any mesh) and `p` is not on it;
    /// meaningless otherwise.
    pub fn winding_number(&self, p: Vec3) -> i32 {
        let mut winding = 0;
        let misses = |node: &Node| {
            node.high.x < p.x
                || p.y < node.low.y
                || p.y > node.high.y
                || p.z < node.low.z
                || p.z > node.high.z
        };
        self.visit(misses, |_, corners| {
            if let Some((x, sign)) = crossing(corners, p.y, p.z)
                && x > f64::from(p.x)
            {
                winding += sign;
            }
        });
        winding
    }

    /// Calls `visit` with the place and the corners of each triangle of each leaf, but for subtrees
    /// whose box `misses`.
    #[inline]
    fn visit(&self, misses: impl Fn(&Node) -> bool, mut visit: impl FnMut(usize, &[Vec3; 3])) {
        if self.nodes.is_empty() {
            return;
        }
        let mut stack = [0u32; STACK];
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let at = stack[waiting];
            let node = &self.nodes[at as usize];
            if misses(node) {
                continue;
            }
            if node.count == 0 {
                stack[waiting] = node.first;
                stack[waiting + 1] = at + 1;
                waiting += 2;
                continue;
            }
            for slot in node.first as usize..(node.first + node.count) as usize {
                visit(slot, &self.corners[slot]);
            }
        }
    }

    /// The corners of all triangles.
    #[cfg(test)]
    pub(super) fn triangles(&self) -> impl Iterator<Item = &[Vec3; 3]> {
        self.corners.iter()
    }

    fn measure(&self, p: Vec3, slot: u32) -> Nearest {
        let corners = &self.corners[slot as usize];
        let barycentric = nearest_barycentric(corners, p);
        let [a, b, c] = corners;
        let point = *a * barycentric[0] + *b * barycentric[1] + *c * barycentric[2];
        Nearest {
            triangle: self.sources[slot as usize],
            barycentric,
            point,
            distance_squared: p.distance_squared(point),
            slot,
        }
    }
}

/// Builds the subtree over `order`, whose first entry has the index `first` in leaf order.
fn build(triangles: &[[Vec3; 3]], centres: &[Vec3], order: &mut [u32], first: usize, nodes: &mut Vec<Node>) {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (mut centre_low, mut centre_high) = (low, high);
    for &t in order.iter() {
        for corner in triangles[t as usize] {
            (low, high) = (low.min(corner), high.max(corner));
        }
        let centre = centres[t as usize];
        (centre_low, centre_high) = (centre_low.min(centre), centre_high.max(centre));
    }
    let at = nodes.len();
    nodes.push(Node { low, high, first: first as u32, count: order.len() as u32 });
    if order.len() <= LEAF {
        return;
    }
    let axis = (centre_high - centre_low).max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        centres[a as usize][axis].total_cmp(&centres[b as usize][axis]).then(a.cmp(&b))
    });
    let (left, right) = order.split_at_mut(middle);
    build(triangles, centres, left, first, nodes);
    nodes[at].first = nodes.len() as u32;
    nodes[at].count = 0;
    build(triangles, centres, right, first + middle, nodes);
}

#[inline]
fn box_distance_squared(node: &Node, p: Vec3) -> f32 {
    (node.low - p).max(p - node.high).max(Vec3::ZERO).length_squared()
}

/// Barycentric coordinates of the point of a triangle nearest to `p` (Ericson, Real-Time Collision
/// Detection, 5.1.5: by Voronoi region).
pub(super) fn nearest_barycentric([a, b, c]: &[Vec3; 3], p: Vec3) -> [f32; 3] {
    let (ab, ac, ap) = (*b - *a, *c - *a, p - *a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - *b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = ratio(d1, d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let cp = p - *c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = ratio(d2, d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = ratio(d4 - d3, (d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let area = va + vb + vc;
    let (v, w) = (ratio(vb, area), ratio(vc, area));
    [1.0 - v - w, v, w]
}

/// `part / whole`, clamped to 0–1; 0 if a degenerate triangle makes both vanish.
#[inline]
fn ratio(part: f32, whole: f32) -> f32 {
    if whole > 0.0 { (part / whole).clamp(0.0, 1.0) } else { 0.0 }
}

/// The crossing of the line along x through (`y`, `z`) with a triangle: the x coordinate, and +1 if
/// +x leaves through the front, −1 if it enters.
pub(super) fn crossing([a, b, c]: &[Vec3; 3], y: f32, z: f32) -> Option<(f64, i32)> {
    let p = DVec3::new(0.0, f64::from(y), f64::from(z));
    let (ab, bc, ca) = (side(*a, *b, p), side(*b, *c, p), side(*c, *a, p));
    if ab.1 != bc.1 || bc.1 != ca.1 {
        return None;
    }
    let area = ab.0 + bc.0 + ca.0;
    let x = if area == 0.0 {
        f64::from(a.x)
    } else {
        (bc.0 * f64::from(a.x) + ca.0 * f64::from(b.x) + ab.0 * f64::from(c.x)) / area
    };
    Some((x, if ab.1 { 1 } else { -1 }))
}

/// Twice the area of (a, b, p) in the yz plane, and whether p (moved by (ε, ε²)) is on the left.
/// Swapping a and b negates both exactly.
#[inline]
fn side(a: Vec3, b: Vec3, p: DVec3) -> (f64, bool) {
    let swap = (a.y, a.z) > (b.y, b.z);
    let (from, to) = if swap { (b.as_dvec3(), a.as_dvec3()) } else { (a.as_dvec3(), b.as_dvec3()) };
    let (dy, dz) = (to.y - from.y, to.z - from.z);
    let area = dy * (p.z - from.z) - dz * (p.y - from.y);
    let left = if area != 0.0 {
        area > 0.0
    } else if dz != 0.0 {
        dz < 0.0
    } else {
        dy > 0.0
    };
    if swap { (-area, !left) } else { (area, left) }
}

#[cfg(test)]
mod tests {
    use super::super::shapes_for_tests::{cuboid, lattice, uv_sphere};
    use super::*;

    #[test]
    fn nearest_agrees_with_an_exhaustive_search() {
        let mesh = uv_sphere(0.1, 24, 12);
        let bvh = Bvh::new(&mesh);
        let mut hint = None;
        for p in lattice(500, 0.2) {
            let found = bvh.nearest_from(p, hint.as_ref()).unwrap();
            let brute = (0..mesh.triangles.len())
                .map(|t| {
                    let corners = mesh.corners(t);
                    let [u, v, w] = nearest_barycentric(&corners, p);
                    p.distance_squared(corners[0] * u + corners[1] * v + corners[2] * w)
                })
                .fold(f32::INFINITY, f32::min);
            assert_eq!(found.distance_squared, brute);
            assert_eq!(bvh.nearest(p).unwrap().distance_squared, brute);
            let corners = mesh.corners(found.triangle as usize);
            let rebuilt: Vec3 = corners.iter().zip(found.barycentric).map(|(c, w)| *c * w).sum();
            assert!((rebuilt - found.point).length() < 1e-7);
            hint = Some(found);
        }
    }

    #[test]
    fn no_sampled_point_of_a_triangle_is_nearer() {
        let triangles = [
            [Vec3::ZERO, Vec3::X, Vec3::Y],
            [Vec3::ZERO, Vec3::X, Vec3::new(0.3, 1e-4, 0.0)],
            [Vec3::ZERO, Vec3::X, Vec3::X * 0.5],
            [Vec3::ZERO, Vec3::X, Vec3::X],
            [Vec3::ONE; 3],
        ];
        for corners in triangles {
            for p in lattice(200, 1.5) {
                let weights = nearest_barycentric(&corners, p);
                assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{corners:?} {p} {weights:?}");
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                let at = |w: [f32; 3]| corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
                let best = p.distance(at(weights));
                for i in 0..=20 {
                    for j in 0..=20 - i {
                        let (u, v) = (i as f32 / 20.0, j as f32 / 20.0);
                        assert!(best <= p.distance(at([1.0 - u - v, u, v])) + 1e-5, "{corners:?} {p}");
                    }
                }
            }
        }
    }

    #[test]
    fn winding_is_exact_even_through_edges_and_vertices() {
        // Rays along x through the cube hit diagonals, edges and vertices of its faces.
        let bvh = Bvh::new(&cuboid(Vec3::ONE));
        for step in 0..=8 {
            for other in 0..=8 {
                let (y, z) = (step as f32 / 4.0 - 1.0, other as f32 / 4.0 - 1.0);
                let expected = i32::from(y.abs() < 1.0 && z.abs() < 1.0);
                let got = bvh.winding_number(Vec3::new(0.0, y, z));
                if y.abs() < 1.0 && z.abs() < 1.0 {
                    assert_eq!(got, expected, "{y} {z}");
                }
                assert_eq!(bvh.winding_number(Vec3::new(-2.0, y, z)), 0);
                assert_eq!(bvh.winding_number(Vec3::new(2.0, y, z)), 0);
            }
        }
        let ball = Bvh::new(&uv_sphere(1.0, 24, 12));
        for p in lattice(2000, 1.5).chain([Vec3::ZERO, Vec3::Y * 0.5]) {
            let r = p.length();
            if !(0.95..1.0).contains(&r) {
                assert_eq!(ball.winding_number(p), i32::from(r < 1.0), "{p}");
            }
        }
    }

    #[test]
    fn an_empty_tree_finds_nothing() {
        let bvh = Bvh::from_triangles(Vec::new());
        assert!(bvh.nearest(Vec3::ZERO).is_none());
        assert_eq!(bvh.winding_number(Vec3::ZERO), 0);
        assert!(Bvh::new(&cuboid(Vec3::ONE)).nearest(Vec3::NAN).is_none());
    }
}
