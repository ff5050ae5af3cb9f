//! Moving a groom out of the body on which it grows.
//!
//! # Theory
//! The ghosts of the solver are at the rest shape and attract the hair permanently: a particle
//! whose rest position is inside the head would be pulled into the head against the contact that
//! pushes it out. Therefore the rest shape is moved out of the body, with as little change as
//! possible. A root that is at most `max_depth` deep moves to the surface, together with its
//! strand. Then, from the root outwards, each particle beyond the clamped ones keeps its direction
//! from the previous particle (follow the leader), rotated just as far that it is `margin` outside,
//! at the length of its edge. The point that is both on the sphere about the previous particle and
//! on the surface is found by alternating projections; an edge that points straight into the body
//! is placed along the skin instead.
//!
//! # Limitations
//! A root deeper than `max_depth` is not moved: a strand with its root in the middle of the head
//! indicates a wrong scale or position of the groom, which should be reported and not hidden.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::Groom;
use crate::body::Sdf;

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
        let Self { roots_lifted, roots_too_deep, inside_before, inside_after, strands_bent, .. } = self;
        write!(
            f,
            "{inside_before} particles were inside the body (deepest {:.2} mm): {roots_lifted} strands \
             were moved with their roots to the surface, {strands_bent} were bent out of the body, edge \
             lengths changed by {:.1} % at most; {inside_after} particles are still inside",
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
    let deepest = |strand: &[Vec3]| {
        let free = strand.iter().skip(clamped).map(|&p| body.sample(p).0).filter(|d| *d < 0.0);
        free.fold((0, 0.0f32), |(count, deepest), d| (count + 1, deepest.max(-d)))
    };
    (report.inside_before, report.deepest) = deepest(strand);
    let lengths: Vec<f32> = strand.windows(2).map(|w| w[0].distance(w[1])).collect();
    let depth = -body.sample(root).0;
    if params.move_roots && depth > params.max_depth {
        report.roots_too_deep = 1;
        report.inside_after = report.inside_before;
        return report;
    }
    if params.move_roots && depth > 0.0 {
        report.roots_lifted = 1;
        let shift = pushed_out(root, body, 0.0) - root;
        strand.iter_mut().for_each(|p| *p += shift);
    }
    if deepest(strand).0 > 0 {
        report.strands_bent = 1;
        bend_out(strand, &lengths, body, params.margin, clamped);
    }
    report.inside_after = deepest(strand).0;
    report.max_stretch = strand
        .windows(2)
        .zip(&lengths)
        .filter(|(_, length)| **length > 0.0)
        .map(|(w, length)| (w[0].distance(w[1]) / length - 1.0).abs())
        .fold(0.0, f32::max);
    report
}

/// Places every particle outside the body, at its edge's length from the previous one, from the
/// root to the tip.
fn bend_out(strand: &mut [Vec3], lengths: &[f32], body: &Sdf, margin: f32, clamped: usize) {
    for i in clamped..strand.len() {
        let (leader, length) = (strand[i - 1], lengths[i - 1]);
        let distance = strand[i].distance(leader);
        let moved = (distance - length).abs() > 1e-5 * length;
        if moved || body.sample(strand[i]).0 < margin {
            strand[i] = placed(leader, strand[i] - leader, length, body, margin);
        }
    }
}

/// The point at distance `length` from `leader` whose direction is nearest to `edge` and that is
/// `margin` outside the body, up to a tenth of the margin.
fn placed(leader: Vec3, edge: Vec3, length: f32, body: &Sdf, margin: f32) -> Vec3 {
    let clear = |p: Vec3| body.sample(p).0 >= 0.9 * margin;
    let mut p = leader + edge.normalize_or_zero() * length;
    for _ in 0..16 {
        if clear(p) {
            return p;
        }
        let out = pushed_out(p, body, margin) - leader;
        if out.length() < 0.2 * length {
            break;
        }
        p = leader + out.normalize() * length;
    }
    let normal = body.sample(leader).1.normalize();
    let along =
        edge.reject_from_normalized(normal).try_normalize().unwrap_or(normal.any_orthonormal_vector());
    let turned = |up: f32| leader + (along * (1.0 - up) + normal * up).normalize() * length;
    let found = [0.0, 0.15, 0.3, 0.5, 0.7, 0.85, 1.0].into_iter().map(turned).find(|&p| clear(p));
    // No position fits in a fold narrower than the edge: a short edge is better than a particle
    // inside.
    found.unwrap_or_else(|| pushed_out(p, body, margin))
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
