//! Vectors and matrices (arrays of columns) of either precision.

use forelock_core::lane::Real;

pub(super) type V<T> = [T; 3];
/// A matrix by columns.
pub(super) type M<T> = [V<T>; 3];

/// A constant in the precision at hand.
#[inline(always)]
pub(super) fn num<T: Real>(x: f64) -> T {
    T::from(x).unwrap_or_else(T::nan)
}

#[inline(always)]
pub(super) fn add<T: Real>(a: V<T>, b: V<T>) -> V<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(super) fn sub<T: Real>(a: V<T>, b: V<T>) -> V<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn scale<T: Real>(a: V<T>, s: T) -> V<T> {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
pub(super) fn dot<T: Real>(a: V<T>, b: V<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn cross<T: Real>(a: V<T>, b: V<T>) -> V<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub(super) fn apply<T: Real>(m: &M<T>, v: V<T>) -> V<T> {
    add(add(scale(m[0], v[0]), scale(m[1], v[1])), scale(m[2], v[2]))
}

/// mᵀ v.
#[inline(always)]
pub(super) fn apply_transposed<T: Real>(m: &M<T>, v: V<T>) -> V<T> {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

/// Whether all numbers are finite.
pub(super) fn finite<T: Real>(v: V<T>) -> bool {
    v.iter().all(|c| c.is_finite())
}

/// The coefficients of a rotation by the vector θ, with t = |θ|: sin t/t, (1 − cos t)/t² and
/// (t − sin t)/t³.
pub(super) struct Exponential<T> {
    theta: V<T>,
    first: T,
    second: T,
    third: T,
}

/// t² below which the coefficients are summed as series, whose terms fall below float64 there.
const SERIES_SQUARE: f64 = 0.25;

impl<T: Real> Exponential<T> {
    #[inline]
    pub(super) fn new(theta: V<T>) -> Self {
        let square = dot(theta, theta);
        if square < num(SERIES_SQUARE) {
            return Self {
                theta,
                first: series(square, 1),
                second: series(square, 2),
                third: series(square, 3),
            };
        }
        let t = square.sqrt();
        let (sin, cos) = t.sin_cos();
        let first = sin / t;
        Self { theta, first, second: (T::one() - cos) / square, third: (T::one() - first) / square }
    }

    /// exp(θ) v.
    #[inline(always)]
    pub(super) fn rotate(&self, v: V<T>) -> V<T> {
        let once = cross(self.theta, v);
        let twice = cross(self.theta, once);
        add(v, add(scale(once, self.first), scale(twice, self.second)))
    }

    /// J_r(θ)ᵀ v, where exp(θ + δ) = exp(θ) exp(J_r(θ) δ) to the first order.
    #[inline(always)]
    pub(super) fn right_jacobian_transposed(&self, v: V<T>) -> V<T> {
        let once = cross(self.theta, v);
        let twice = cross(self.theta, once);
        add(v, add(scale(once, self.second), scale(twice, self.third)))
    }
}

/// Σ_k (−q)^k / (2k + `order`)!, eight terms.
#[inline(always)]
fn series<T: Real>(q: T, order: u32) -> T {
    let mut sum = T::one();
    for k in (1..8).rev() {
        let last = f64::from(2 * k + order);
        sum = T::one() - q * sum * num(1.0 / (last * (last - 1.0)));
    }
    let factorial = f64::from((1..=order).product::<u32>());
    sum * num(1.0 / factorial)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_join_at_the_series_bound() {
        for t in [0.4999999f64, 0.3, 0.5000001, 3.0] {
            let e = Exponential::new([0.0, t, 0.0]);
            assert!((e.first - t.sin() / t).abs() < 1e-15);
            assert!((e.second - 2.0 * ((t / 2.0).sin() / t).powi(2)).abs() < 1e-15);
            assert!((e.third - (t - t.sin()) / t.powi(3)).abs() < 1e-14);
        }
        let e = Exponential::new([0.0f64; 3]);
        assert_eq!((e.first, e.second, e.third), (1.0, 0.5, 1.0 / 6.0));
    }
}
