//! A smooth signed distance field in canonical space.
//!
//! # Theory
//! Distances on a grid of nodes are the coefficients of a quadratic B-spline in each axis. Its
//! gradient is continuous and exactly that of its value, which line searches need; it rounds a
//! surface of curvature radius r by h²/8r for nodes h apart.
//!
//! # Limitations
//! Outside the grid, the distance is that of the nearest place of the grid plus the way to it.

use super::body::{Body, Near};
use forelock_core::lane::{Lane, Real, V3};
use glam::DVec3;

/// Distances on a grid, cm.
#[derive(Clone, Debug)]
pub struct SmoothField {
    /// The first node.
    origin: [f64; 3],
    /// Distance of nodes.
    spacing: f64,
    /// Nodes along each axis.
    counts: [usize; 3],
    /// Distances, x fastest.
    values: Vec<f32>,
}

impl SmoothField {
    /// Samples `distance` at nodes `spacing` apart between the corners `bounds`, all in cm.
    pub fn new(bounds: [DVec3; 2], spacing: f64, distance: impl Fn(DVec3) -> f32) -> Self {
        let origin = bounds[0].to_array();
        // At least three nodes along each axis: a spline's support.
        let counts = ((bounds[1] - bounds[0]) / spacing).to_array().map(|n| n.max(0.0).ceil() as usize + 3);
        let mut values = Vec::with_capacity(counts.iter().product());
        for k in 0..counts[2] {
            for j in 0..counts[1] {
                for i in 0..counts[0] {
                    let at = DVec3::new(i as f64, j as f64, k as f64);
                    values.push(distance(bounds[0] + spacing * at));
                }
            }
        }
        Self { origin, spacing, counts, values }
    }

    /// The distance at `x`, cm, and its gradient.
    #[inline(always)]
    pub fn sample<T: Real>(&self, x: [T; 3]) -> (T, [T; 3]) {
        let number = |x: f64| T::from(x).unwrap_or_else(T::zero);
        let [half, over] = [0.5, 1.0 / self.spacing].map(number);
        let (mut first, mut weights, mut slopes) = ([0usize; 3], [[T::zero(); 3]; 3], [[T::zero(); 3]; 3]);
        let mut beyond = [T::zero(); 3];
        for c in 0..3 {
            let free = (x[c] - number(self.origin[c])) * over;
            let last = number((self.counts[c] - 2) as f64 + 0.499);
            let at = free.max(number(0.501)).min(last);
            beyond[c] = (free - at) / over;
            let node = (at + half).floor();
            let t = at - node;
            first[c] = node.to_usize().map_or(0, |node| node.saturating_sub(1).min(self.counts[c] - 3));
            weights[c] =
                [half * (half - t) * (half - t), number(0.75) - t * t, half * (half + t) * (half + t)];
            slopes[c] = [(t - half) * over, -(t + t) * over, (t + half) * over];
        }
        let (mut value, mut gradient) = (T::zero(), [T::zero(); 3]);
        for k in 0..3 {
            for j in 0..3 {
                let row = ((first[2] + k) * self.counts[1] + first[1] + j) * self.counts[0] + first[0];
                let (mut sum, mut by_x) = (T::zero(), T::zero());
                for (i, distance) in self.values[row..row + 3].iter().enumerate() {
                    let distance = T::from(*distance).unwrap_or_else(T::zero);
                    sum = sum + weights[0][i] * distance;
                    by_x = by_x + slopes[0][i] * distance;
                }
                let (y, z) = (weights[1][j], weights[2][k]);
                value = value + y * z * sum;
                gradient[0] = gradient[0] + y * z * by_x;
                gradient[1] = gradient[1] + slopes[1][j] * z * sum;
                gradient[2] = gradient[2] + y * slopes[2][k] * sum;
            }
        }
        let outside = beyond.iter().fold(T::zero(), |sum, b| sum + *b * *b).sqrt();
        if outside > T::zero() {
            return (value + outside, beyond.map(|b| b / outside));
        }
        (value, gradient)
    }
}

impl<L: Lane> Body<L> for SmoothField {
    #[inline(always)]
    fn near(&self, x: V3<L>) -> Near<L> {
        let mut near = Near { distance: L::zero(), gradient: V3::zero() };
        for lane in 0..L::WIDTH {
            let (distance, gradient) = self.sample(x.get(lane));
            near.distance.set(lane, distance);
            near.gradient.set(lane, gradient);
        }
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_is_rounded_by_its_curvature_and_its_gradient_is_that_of_its_value() {
        let bounds = [DVec3::splat(-14.0), DVec3::splat(14.0)];
        let field = SmoothField::new(bounds, 0.4, |x| (x.length() - 9.0) as f32);
        for k in 0..200 {
            let angle = 0.37 * f64::from(k);
            let x = (7.0 + 0.03 * f64::from(k))
                * DVec3::new(angle.cos(), 0.3 * (2.0 * angle).sin(), angle.sin()).normalize();
            let (distance, gradient) = field.sample(x.to_array());
            // The spline of a function f is f + h² Δf/8.
            let expected = x.length() - 9.0 + 0.16 / 8.0 * 2.0 / x.length();
            assert!((distance - expected).abs() < 1e-4, "{distance} {expected}");
            for (c, found) in gradient.iter().enumerate() {
                let mut ends = [x.to_array(); 2];
                ends[0][c] += 1e-5;
                ends[1][c] -= 1e-5;
                let [a, b] = ends.map(|x| field.sample(x).0);
                assert!(((a - b) / 2e-5 - found).abs() < 1e-4, "{x} {c}");
            }
        }
        let (far, out) = field.sample([0.0f64, 30.0, 0.0]);
        assert!((far - 21.0).abs() < 0.5 && (out[1] - 1.0).abs() < 1e-9, "{far}");
    }
}
