//! A solid that changes its shape: a sequence of distance fields that are blended over time.
//!
//! # Theory
//! Between field k and the next, σ(p, φ) = (1 − f) σ_k(p) + f σ_{k+1}(p) with f = φ − k. A moving
//! surface moves along its normal with the speed −(∂σ/∂φ)(dφ/dt)/|∇σ|. The blend of two distances
//! is 1-Lipschitz, as each of them is, so that a clearance computed from the blend is valid.
//!
//! # Limitations
//! The blend is the distance to a moving surface only where the surface moves by less than about
//! half of the solid's thickness from one field to the next. A finger that moves by its full width
//! becomes thinner in between, and one that moves farther vanishes and reappears. A sequence must
//! be dense enough for its fastest part. Tangential motion of the surface (a sleeve that slides
//! along its arm) does not drag hair, because a distance field does not contain it.

use glam::Vec3;
use rayon::prelude::*;

use super::Sdf;

/// A sequence of distance fields of one solid.
#[derive(Clone, Debug, PartialEq)]
pub struct Morph {
    fields: Vec<Sdf>,
    change: f32,
}

impl Morph {
    /// Creates the sequence of `fields`; `None` if it is empty.
    pub fn new(fields: Vec<Sdf>) -> Option<Self> {
        let change = fields.windows(2).map(|pair| change(&pair[0], &pair[1]).max(change(&pair[1], &pair[0])));
        let change = change.fold(0.0, f32::max);
        (!fields.is_empty()).then_some(Self { fields, change })
    }

    /// Number of fields.
    pub fn len(&self) -> usize {
        self.fields.len()
    }

    /// The fields.
    pub fn fields(&self) -> &[Sdf] {
        &self.fields
    }

    /// Whether there are no fields; always false.
    pub fn is_empty(&self) -> bool {
        self.fields.is_empty()
    }

    /// Distance in metres and gradient at `p`, at `phase` fields after the first. Phases outside
    /// the sequence are clamped to its ends.
    #[inline]
    pub fn sample(&self, p: Vec3, phase: f64) -> (f32, Vec3) {
        let last = self.fields.len() - 1;
        #[expect(clippy::cast_precision_loss, reason = "a sequence has fewer fields than float64 counts")]
        let phase = if phase > 0.0 { phase.min(last as f64) } else { 0.0 };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the sequence")]
        let (first, share) = (phase as usize, phase.fract() as f32);
        let (distance, gradient) = self.fields[first].sample(p);
        if share == 0.0 {
            return (distance, gradient);
        }
        let (next, slope) = self.fields[first + 1].sample(p);
        let blended = gradient.lerp(slope, share);
        // Opposite gradients cancel where the surface turns inside out.
        let gradient = if blended.length_squared() > 1e-6 { blended } else { gradient };
        (distance + (next - distance) * share, gradient)
    }

    /// The largest change of the distance at any point from one field to the next, metres.
    pub fn change(&self) -> f32 {
        self.change
    }

    /// The smallest cell of all fields, metres.
    pub fn cell(&self) -> f32 {
        self.fields.iter().map(Sdf::near_cell).fold(f32::INFINITY, f32::min)
    }

    /// The smallest [`Sdf::thinness`] of all fields, metres.
    pub fn thinness(&self) -> f32 {
        self.fields.iter().map(Sdf::thinness).fold(f32::INFINITY, f32::min)
    }

    /// The bounding box of all fields: (min, max) in metres.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let bounds = self.fields.iter().map(Sdf::bounds);
        bounds.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), (a, b)| (lo.min(a), hi.max(b)))
    }
}

/// The largest difference between `b` and `a` at the nodes of `a`.
fn change(a: &Sdf, b: &Sdf) -> f32 {
    let at_nodes = |(first, values): (Vec3, &[f32])| {
        let nodes = (0..).zip(values).map(|(node, value)| (first + a.brick_node(node), value));
        nodes.map(|(p, value)| (b.sample(p).0 - value).abs()).fold(0.0, f32::max)
    };
    let in_bricks = a.bricks().par_bridge().map(at_nodes).reduce(|| 0.0, f32::max);
    let (dims, layer) = (a.dims(), (a.dims().x * a.dims().y) as usize);
    let layers = a.values()[..layer * dims.z as usize].par_chunks(layer).enumerate();
    let greatest = layers.map(|(k, values)| {
        let node = |at: usize| Vec3::new((at as u32 % dims.x) as f32, (at as u32 / dims.x) as f32, k as f32);
        let difference =
            |(at, value): (usize, &f32)| (b.sample(a.origin() + node(at) * a.cell()).0 - value).abs();
        values.iter().enumerate().map(difference).fold(0.0, f32::max)
    });
    greatest.reduce(|| in_bricks, f32::max)
}

#[cfg(test)]
mod tests {
    use super::super::shapes_for_tests::uv_sphere;
    use super::*;

    fn growing() -> Morph {
        let ball = |radius: f32| Sdf::from_mesh(&uv_sphere(radius, 48, 24), 40, 0.03).unwrap();
        Morph::new([0.1, 0.11, 0.13].map(ball).into()).unwrap()
    }

    #[test]
    fn a_ball_grows_evenly_between_its_fields() {
        let morph = growing();
        let from_middle = |phase: f64| 0.12 - morph.sample(Vec3::new(0.0, 0.12, 0.0), phase).0;
        for (phase, radius) in
            [(-1.0, 0.1), (0.0, 0.1), (0.5, 0.105), (1.0, 0.11), (1.25, 0.115), (2.0, 0.13), (9.0, 0.13)]
        {
            // The facets lie up to 0.9 % of the radius inside the ball, and cells of 7 mm cause
            // errors of 0.1 mm.
            assert!((from_middle(phase) - radius).abs() < 1.3e-3, "{phase}: {}", from_middle(phase));
        }
        // 2 cm, plus the error of the lower bounds outside the smaller grid.
        assert!((morph.change() - 0.02).abs() < 0.01, "{}", morph.change());
        assert!(Morph::new(Vec::new()).is_none());
    }
}
