//! Moving a groom out of the body on which it grows.
//!
//! # Theory
//! The ghosts of the solver are at the rest shape and attract the hair permanently: a particle
//! whose rest position is inside the head would be pulled into the head against the contact that
//! pushes it out, and so would an edge that passes through an ear. Therefore the rest shape is
//! moved out of the body, with as little change as possible. A root that is at most `max_depth`
//! deep moves to the surface, together with its strand.
//!
//! Then, from the root outwards, each edge beyond the clamped particles keeps its length, and its
//! direction where it is free: the particle `margin` outside, and no point of the edge inside. An
//! edge that is not free turns towards the normal of the surface through which it enters the body.
//! Where that folds the strand, it takes the free direction nearest to its own that does not. The
//! edges after it turn by up to 30° to bring the strand back to where it was.
//!
//! # Practice
//! Edges that are at most [`EDGE_DEPTH`] deep stay, as those of strands that lie on the skin are:
//! between two particles on a head a chord of 1 cm is 0.2 mm deeper than they are. Solids push them
//! out by as much.
//!
//! # Limitations
//! A root deeper than `max_depth` is not moved: a strand with its root in the middle of the head
//! indicates a wrong scale or position of the groom, which should be reported and not hidden.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::Groom;
use crate::body::Sdf;

/// Depth in the body of a point of an edge between its particles, metres, beyond which the edge is
/// moved out.
pub const EDGE_DEPTH: f32 = 3e-4;

/// Most points at which an edge is tested.
const EDGE_POINTS: usize = 64;

/// Share of its leader's displacement that an edge takes back; at most this share of its length.
const RETURN: f32 = 0.5;

/// Cosine of the angle between two consecutive edges below which the strand is folded.
const LEAST_COSINE: f32 = 0.2;

/// Directions that are tried where a turn towards the surface's normal does not help.
const DIRECTIONS: u32 = 256;

/// Most turns of an edge in the search for a free direction.
const TURNS: usize = 32;

/// Parameters of [`lift_out`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiftParams {
    /// Distance in metres at which particles are kept from the surface. Default 0.0005, range 0 or
    /// more.
    pub margin: f32,
    /// Largest depth in metres of a root that is moved to the surface. Default 0.02, range 0 or
    /// more; 0 moves none.
    pub max_depth: f32,
    /// Number of particles from the root that may be under the skin, because they follow the head:
    /// at least 1. Default 1.
    pub clamped: usize,
    /// Whether roots may be moved; if not, strands are moved out from their roots on, at any depth
    /// of the root. Default true.
    pub move_roots: bool,
}

impl Default for LiftParams {
    fn default() -> Self {
        Self { margin: 5e-4, max_depth: 0.02, clamped: 1, move_roots: true }
    }
}

/// Statistics of [`lift_out`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LiftReport {
    /// Strands whose root was inside and was moved to the surface together with the strand.
    pub roots_lifted: usize,
    /// Strands whose root is too deep to be moved.
    pub roots_too_deep: usize,
    /// Particles beyond the clamped ones that were inside before.
    pub inside_before: usize,
    /// Particles beyond the clamped ones that are still inside.
    pub inside_after: usize,
    /// Depth in metres of the deepest such particle before.
    pub deepest: f32,
    /// Edges beyond the clamped particles that were deeper than [`EDGE_DEPTH`] in the body before.
    pub edges_before: usize,
    /// Such edges that still are.
    pub edges_after: usize,
    /// Strands of which a particle beyond the clamped ones was moved.
    pub strands_bent: usize,
    /// Largest relative change of an edge's length.
    pub max_stretch: f32,
}

impl LiftReport {
    /// The sum of both reports; of depths and stretches, the maximum.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        Self {
            roots_lifted: self.roots_lifted + other.roots_lifted,
            roots_too_deep: self.roots_too_deep + other.roots_too_deep,
            inside_before: self.inside_before + other.inside_before,
            inside_after: self.inside_after + other.inside_after,
            deepest: self.deepest.max(other.deepest),
            edges_before: self.edges_before + other.edges_before,
            edges_after: self.edges_after + other.edges_after,
            strands_bent: self.strands_bent + other.strands_bent,
            max_stretch: self.max_stretch.max(other.max_stretch),
        }
    }
}

impl std::fmt::Display for LiftReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if *self == Self::default() {
            return write!(f, "no strand is inside the body");
        }
        let Self { roots_lifted, roots_too_deep, inside_before, inside_after, .. } = self;
        let Self { edges_before, edges_after, strands_bent, .. } = self;
        write!(
            f,
            "{inside_before} particles (deepest {:.2} mm) and {edges_before} edges were inside the body: \
             {roots_lifted} strands were moved with their roots to the surface, {strands_bent} were bent \
             out of the body, edge lengths changed by {:.1} % at most; {inside_after} particles and \
             {edges_after} edges are still inside",
            self.deepest * 1e3,
            self.max_stretch * 1e2
        )?;
        if *roots_too_deep > 0 {
            write!(
                f,
                "; {roots_too_deep} roots are too deep to be moved: check the unit and the position of \
                 the groom"
            )?;
        }
        Ok(())
    }
}

/// Moves the strands of `groom` out of `body`, which is in the same space, and reports the changes.
/// Strands that are outside are unchanged, bit for bit.
pub fn lift_out(groom: &mut Groom, body: &Sdf, params: &LiftParams) -> LiftReport {
    let ranges: Vec<Range<usize>> = (0..groom.strand_count()).map(|strand| groom.range(strand)).collect();
    let pinned: Vec<usize> = match &groom.pinned {
        Some(pinned) => pinned.iter().map(|&n| usize::from(n)).collect(),
        None => vec![0; ranges.len()],
    };
    let mut strands = Vec::with_capacity(ranges.len());
    let mut rest = groom.positions_mut();
    for range in &ranges {
        let (strand, after) = rest.split_at_mut(range.len());
        strands.push(strand);
        rest = after;
    }
    let reports: Vec<LiftReport> = strands
        .into_par_iter()
        .zip(pinned)
        .map(|(strand, pinned)| lift_strand(strand, body, params, params.clamped.max(pinned).max(1)))
        .collect();
    reports.iter().fold(LiftReport::default(), |sum, one| sum.and(one))
}

fn lift_strand(strand: &mut [Vec3], body: &Sdf, params: &LiftParams, clamped: usize) -> LiftReport {
    let mut report = LiftReport::default();
    let Some(&root) = strand.first().filter(|_| strand.iter().all(|p| p.is_finite())) else { return report };
    let mut left = Depths::of(strand, body, clamped);
    (report.inside_before, report.deepest, report.edges_before) = (left.particles, left.deepest, left.edges);
    let lengths: Vec<f32> = strand.windows(2).map(|w| w[0].distance(w[1])).collect();
    let depth = -body.sample(root).0;
    report.roots_too_deep = usize::from(params.move_roots && depth > params.max_depth);
    if report.roots_too_deep == 0 {
        if params.move_roots && depth > 0.0 {
            report.roots_lifted = 1;
            let shift = pushed_out(root, body, 0.0) - root;
            strand.iter_mut().for_each(|p| *p += shift);
            left = Depths::of(strand, body, clamped);
        }
        if left.particles + left.edges > 0 {
            report.strands_bent = 1;
            bend_out(strand, &lengths, body, params.margin, clamped);
            left = Depths::of(strand, body, clamped);
        }
    }
    (report.inside_after, report.edges_after) = (left.particles, left.edges);
    report.max_stretch = strand
        .windows(2)
        .zip(&lengths)
        .filter(|(_, length)| **length > 0.0)
        .map(|(w, length)| (w[0].distance(w[1]) / length - 1.0).abs())
        .fold(0.0, f32::max);
    report
}

/// What of a strand beyond its clamped particles is inside the body.
struct Depths {
    particles: usize,
    /// Of the deepest particle, metres.
    deepest: f32,
    /// Edges deeper than [`EDGE_DEPTH`].
    edges: usize,
}

impl Depths {
    fn of(strand: &[Vec3], body: &Sdf, clamped: usize) -> Self {
        let mut depths = Self { particles: 0, deepest: 0.0, edges: 0 };
        for (i, &p) in strand.iter().enumerate().skip(clamped) {
            let distance = body.sample(p).0;
            depths.particles += usize::from(distance < 0.0);
            depths.deepest = depths.deepest.max(-distance);
            depths.edges += usize::from(Edge::of(strand, i, clamped).is_deep(body));
        }
        depths
    }
}

/// Places every particle outside the body, at its edge's length from the previous one, from the
/// root to the tip. Edges keep their directions, turned by up to 30° towards where their particles
/// were.
fn bend_out(strand: &mut [Vec3], lengths: &[f32], body: &Sdf, margin: f32, clamped: usize) {
    let old = strand.to_vec();
    for i in clamped..strand.len() {
        let (leader, length) = (strand[i - 1], lengths[i - 1]);
        let offset = (old[i - 1] - leader).clamp_length_max(length);
        let moves = offset != Vec3::ZERO;
        if moves {
            strand[i] = leader + (old[i] - old[i - 1]) + RETURN * offset;
        }
        let edge = Edge::of(strand, i, clamped);
        if moves || body.sample(edge.end).0 < margin || edge.is_deep(body) {
            strand[i] = edge.placed(length, body, margin);
        }
    }
}

/// An edge from a particle to the next one.
#[derive(Clone, Copy)]
struct Edge {
    leader: Vec3,
    end: Vec3,
    /// Direction of the edge before, or of the first edge itself.
    before: Vec3,
    /// Whether the leader is clamped: it and the half of the edge next to it may be inside.
    is_root: bool,
}

/// The part of an edge that is inside the body.
struct Inside {
    /// Where on the edge the deepest point is, 0 to 1.
    at: f32,
    depth: f32,
    /// Gradient of the distance where the edge enters the body.
    normal: Vec3,
}

impl Edge {
    /// The edge to particle `i` of a strand.
    fn of(strand: &[Vec3], i: usize, clamped: usize) -> Self {
        let [leader, end] = [strand[i - 1], strand[i]];
        let before = if i < 2 { end - leader } else { leader - strand[i - 2] }.normalize_or_zero();
        Self { leader, end, before, is_root: i == clamped }
    }

    /// Where the edge between its particles is inside the body.
    fn inside(&self, body: &Sdf) -> Option<Inside> {
        let length = self.leader.distance(self.end);
        let ends = if self.is_root { 0.0 } else { body.sample(self.leader).0 } + body.sample(self.end).0;
        // Distances change by no more than the way along the edge.
        if ends >= length {
            return None;
        }
        let parts = (4.0 * length / body.near_cell()).ceil().clamp(2.0, EDGE_POINTS as f32);
        let mut inside: Option<Inside> = None;
        for k in 1..parts as usize {
            let at = k as f32 / parts;
            let (distance, gradient) = body.sample(self.leader.lerp(self.end, at));
            if distance >= 0.0 || (self.is_root && at < 0.5) {
                continue;
            }
            let inside = inside.get_or_insert(Inside { at, depth: 0.0, normal: gradient });
            if -distance > inside.depth {
                (inside.at, inside.depth) = (at, -distance);
            }
        }
        inside
    }

    /// Whether it is deeper than [`EDGE_DEPTH`] in the body.
    fn is_deep(&self, body: &Sdf) -> bool {
        self.inside(body).is_some_and(|inside| inside.depth > EDGE_DEPTH)
    }

    /// The part of the edge that is inside the body, with its end if that is less than `margin`
    /// outside, up to a tenth of the margin.
    fn blocked(&self, body: &Sdf, margin: f32) -> Option<Inside> {
        self.inside(body).or_else(|| {
            let (distance, normal) = body.sample(self.end);
            (distance < 0.9 * margin).then_some(Inside { at: 1.0, depth: margin - distance, normal })
        })
    }

    /// A place of the end at distance `length` from the leader where the edge is not
    /// [`blocked`](Self::blocked), in a direction near to that of the edge and without a fold at
    /// the leader.
    fn placed(&self, length: f32, body: &Sdf, margin: f32) -> Vec3 {
        let goal = (self.end - self.leader).normalize_or_zero();
        let at = |direction: Vec3| self.leader + direction * length;
        let unfolded = |direction: &Vec3| direction.dot(self.before) >= LEAST_COSINE;
        let turned = self.turned(goal, length, body, margin);
        if let Some(direction) = turned.filter(unfolded) {
            return at(direction);
        }
        let free = |direction: &Vec3| Self { end: at(*direction), ..*self }.blocked(body, margin).is_none();
        let mut directions: Vec<Vec3> = sphere().collect();
        directions.sort_by(|a, b| b.dot(goal).total_cmp(&a.dot(goal)));
        let found = directions.iter().copied().filter(unfolded).find(free).or(turned);
        // No position fits in a fold narrower than the edge: a short edge is better than a particle
        // inside.
        let found = found.or_else(|| directions.into_iter().find(free));
        found.map_or_else(|| pushed_out(at(goal), body, margin), at)
    }

    /// The direction in which the edge is free after turns from the direction `goal` towards the
    /// normal of the surface through which it enters the body.
    fn turned(&self, goal: Vec3, length: f32, body: &Sdf, margin: f32) -> Option<Vec3> {
        let mut direction = goal;
        for _ in 0..TURNS {
            let end = self.leader + direction * length;
            let Some(inside) = (Self { end, ..*self }).blocked(body, margin) else { return Some(direction) };
            let step = ((inside.depth + 0.1 * margin) / (inside.at * length)).max(0.05);
            let way = direction + inside.normal.normalize_or_zero() * step;
            if way.length() < 0.2 {
                break;
            }
            direction = way.normalize();
        }
        None
    }
}

/// Directions spread over the sphere (Fibonacci lattice).
fn sphere() -> impl Iterator<Item = Vec3> {
    (0..DIRECTIONS).map(|k| {
        let z = 1.0 - (2.0 * k as f32 + 1.0) / DIRECTIONS as f32;
        let (sine, cosine) = (k as f32 * std::f32::consts::PI * (3.0 - 5.0f32.sqrt())).sin_cos();
        Vec3::new(cosine, sine, 0.0) * (1.0 - z * z).sqrt() + Vec3::Z * z
    })
}

/// Moves `p` along the gradient until it is `margin` outside, as far as a few Newton steps allow.
fn pushed_out(mut p: Vec3, body: &Sdf, margin: f32) -> Vec3 {
    for _ in 0..8 {
        let (distance, gradient) = body.sample(p);
        if distance >= margin {
            break;
        }
        // Half a micron is added, so that rounding does not leave the point inside.
        p += gradient * ((margin - distance + 5e-7) / gradient.length_squared().max(0.25));
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::shapes_for_tests::uv_sphere;

    const RADIUS: f32 = 0.1;

    fn ball() -> Sdf {
        Sdf::from_mesh(&uv_sphere(RADIUS, 48, 24), 48, 0.02).unwrap()
    }

    /// A strand of `count` particles, 5 mm apart, that starts at `root` along `direction`.
    fn straight(root: Vec3, direction: Vec3, count: usize) -> Vec<Vec3> {
        (0..count).map(|i| root + direction.normalize() * (i as f32 * 0.005)).collect()
    }

    #[test]
    fn strands_outside_are_unchanged() {
        let strands =
            [straight(Vec3::Y * 0.102, Vec3::Y, 20), straight(Vec3::new(0.2, 0.0, 0.0), Vec3::Y, 20)];
        let mut groom = Groom::from_strands(strands).unwrap();
        let before = groom.clone();
        let report = lift_out(&mut groom, &ball(), &LiftParams::default());
        assert_eq!(groom, before);
        assert_eq!(report.to_string(), "no strand is inside the body");
    }

    #[test]
    fn a_shallow_root_moves_with_its_strand() {
        let mut groom = Groom::from_strands([straight(Vec3::Y * 0.096, Vec3::Y, 10)]).unwrap();
        let shape: Vec<Vec3> = groom.positions().iter().map(|&p| p - groom.positions()[0]).collect();
        let report = lift_out(&mut groom, &ball(), &LiftParams::default());
        assert_eq!((report.roots_lifted, report.strands_bent, report.roots_too_deep), (1, 0, 0));
        assert!((groom.positions()[0].y - RADIUS).abs() < 5e-4);
        for (p, offset) in groom.positions().iter().zip(shape) {
            assert!((*p - groom.positions()[0] - offset).length() < 1e-6);
        }
    }

    #[test]
    fn a_strand_through_the_body_is_bent_around_it() {
        let body = ball();
        let chord = straight(Vec3::new(-0.06, 0.0825, 0.0), Vec3::new(1.0, -0.1, 0.05), 25);
        let tangled = straight(Vec3::new(0.0, 0.0, 0.1), Vec3::new(0.2, 1.0, -0.3), 40);
        let mut groom = Groom::from_strands([chord, tangled]).unwrap();
        let report = lift_out(&mut groom, &body, &LiftParams::default());
        assert!(report.inside_before > 20 && report.strands_bent == 2, "{report}");
        assert_eq!(report.inside_after, 0, "{report}");
        assert!(report.max_stretch < 1e-4, "{report}");
        for strand in groom.strands() {
            assert!(strand.iter().skip(1).all(|p| p.length() > RADIUS - 5e-4));
        }
    }

    /// An ear of 3 mm by 4 cm lies between two particles of a strand.
    #[test]
    fn a_strand_through_an_ear_is_led_around_it() {
        let mut mesh = uv_sphere(0.02, 48, 24);
        for vertex in &mut mesh.positions {
            vertex.z *= 0.075;
        }
        let ear = Sdf::from_mesh(&mesh, 96, 0.02).unwrap();
        for offset in [0.0, 0.006, 0.012] {
            let strand: Vec<Vec3> =
                (0..16).map(|i| Vec3::new(offset, 0.001, 0.004 + 0.008 * (i as f32 - 4.0))).collect();
            let mut groom = Groom::from_strands([strand]).unwrap();
            let report =
                lift_out(&mut groom, &ear, &LiftParams { move_roots: false, ..LiftParams::default() });
            assert_eq!((report.inside_before, report.edges_before), (0, 1), "{report}");
            assert_eq!((report.inside_after, report.edges_after, report.strands_bent), (0, 0, 1), "{report}");
            assert!(report.max_stretch < 1e-4, "{report}");
            let turns = groom.positions().windows(3).map(|w| (w[1] - w[0]).angle_between(w[2] - w[1]));
            let sharpest = turns.fold(0.0, f32::max);
            assert!(sharpest < 2.0, "a fold of {sharpest}");
            // It goes on behind the ear.
            let tip = groom.positions()[15];
            assert!(tip.z > 0.02, "the tip is at {tip}");
        }
    }

    #[test]
    fn an_edge_straight_into_the_body_is_placed_along_the_skin() {
        let mut groom = Groom::from_strands([straight(Vec3::Y * 0.104, Vec3::NEG_Y, 8)]).unwrap();
        let report = lift_out(&mut groom, &ball(), &LiftParams::default());
        assert_eq!(report.inside_after, 0);
        assert!(report.max_stretch < 1e-4, "{report}");
    }

    #[test]
    fn a_root_too_deep_is_reported_and_not_moved() {
        let mut groom = Groom::from_strands([straight(Vec3::Y * 0.05, Vec3::Y, 20)]).unwrap();
        let before = groom.clone();
        let report = lift_out(&mut groom, &ball(), &LiftParams::default());
        assert_eq!((report.roots_too_deep, report.inside_after), (1, report.inside_before));
        assert_eq!(groom, before);
        assert!(report.to_string().contains("1 roots are too deep"));
    }

    #[test]
    fn pinned_particles_may_stay_under_the_skin() {
        let mut groom =
            Groom::from_strands([straight(Vec3::Y * 0.1005, Vec3::new(1.0, -0.2, 0.0), 3)]).unwrap();
        groom.pinned = Some(vec![3]);
        let before = groom.clone();
        assert_eq!(lift_out(&mut groom, &ball(), &LiftParams::default()), LiftReport::default());
        assert_eq!(groom, before);
    }
}
