//! The first time at which two edges, or a point and a triangle, touch while their corners move
//! straight and evenly.
//!
//! # Theory
//! Four points x(t) = x⁰ + t (x¹ − x⁰), 0 < t ≤ 1, lie in a plane where the determinant of their
//! differences vanishes, a cubic in t: for edges (p₀, p₁) and (q₀, q₁) that is
//! det[p₁ − p₀, q₁ − q₀, q₀ − p₀], for a point p and a triangle (a, b, c)
//! det[b − a, c − a, p − a]. At each root in turn the place of the touch follows from the 2 × 2
//! normal equations of p₀ + s (p₁ − p₀) = q₀ + r (q₁ − q₀), or p = a + s (b − a) + r (c − a). The
//! first root whose place lies within both is the impact (Provot 1997).
//!
//! # Practice
//! The extrema of the cubic divide the time into at most three parts in which it is monotonic. In
//! each the root is bracketed, and Newton's method is safeguarded by bisection.
//!
//! The search for contacts between strands has a thickness and advances pairs by their distance
//! instead ([`find_contacts`](crate::interaction::contact::find_contacts)); its tests require it to
//! find every impact of these functions.
//!
//! # Limitations
//! Motion in one plane, for which the cubic vanishes, and parallel edges have no answer: those are
//! found by their distance.

use crate::lane::Real;
use crate::strands::number;

/// The corners of two edges (p₀, p₁, q₀, q₁), or a point and a triangle (p, a, b, c), metres.
pub type Corners<T> = [[T; 3]; 4];

/// How two parts touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact<T> {
    /// When, as a share of the time from the first to the second positions.
    pub time: T,
    /// Where: (s, r) of the theory.
    pub place: [T; 2],
    /// Σ weight · corner is the vector from the second part to the first where they are to touch,
    /// zero at the impact.
    pub weights: [T; 4],
    /// The unit vector from the second part to the first before the impact, along which they
    /// touch.
    pub normal: [T; 3],
}

/// How far outside of its part a place may be that counts as within, as a share of its length.
const SLACK: f64 = 1e-9;
/// The same in float32.
const SLACK_F32: f64 = 1e-5;
/// Steps of the search for a root.
const STEPS: usize = 64;

/// The first impact of the edges (p₀, p₁) and (q₀, q₁), whose corners move from `from` to `to`.
pub fn edges<T: Real>(from: &Corners<T>, to: &Corners<T>) -> Option<Impact<T>> {
    let frame = |[p0, p1, q0, q1]: &Corners<T>| [sub(*p1, *p0), sub(*q1, *q0), sub(*q0, *p0)];
    first(from, to, frame, |[u, v, w]| {
        // u s − v r = w.
        let [s, r] = least_squares(u, v.map(|c| -c), w)?;
        let one = T::one();
        (within(s) && within(r)).then_some(([s, r], [one - s, s, r - one, -r]))
    })
}

/// The first impact of the point p and the triangle (a, b, c), whose corners move from `from` to
/// `to`.
pub fn point_triangle<T: Real>(from: &Corners<T>, to: &Corners<T>) -> Option<Impact<T>> {
    let frame = |[p, a, b, c]: &Corners<T>| [sub(*b, *a), sub(*c, *a), sub(*p, *a)];
    first(from, to, frame, |[u, v, w]| {
        let [s, r] = least_squares(u, v, w)?;
        let one = T::one();
        (within(s) && within(r) && within(s + r)).then_some(([s, r], [one, s + r - one, -s, -r]))
    })
}

/// A place and its weights.
type Place<T> = ([T; 2], [T; 4]);

/// The first root of the determinant of `frame` at which there is a place.
fn first<T: Real>(
    from: &Corners<T>,
    to: &Corners<T>,
    frame: impl Fn(&Corners<T>) -> [[T; 3]; 3],
    place: impl Fn([[T; 3]; 3]) -> Option<Place<T>>,
) -> Option<Impact<T>> {
    let start = frame(from);
    let end = frame(to);
    let change: [[T; 3]; 3] = std::array::from_fn(|k| sub(end[k], start[k]));
    let at = |time: T| -> [[T; 3]; 3] { std::array::from_fn(|k| add_scaled(start[k], time, change[k])) };
    Cubic::of_determinant(&start, &change).roots().into_iter().flatten().find_map(|time| {
        let now = at(time);
        let (place, weights) = place(now)?;
        let normal = cross(now[0], now[1]);
        let length = dot(normal, normal).sqrt();
        let sum = |corners: &Corners<T>| {
            let zero = [T::zero(); 3];
            corners.iter().zip(weights).fold(zero, |sum, (corner, weight)| add_scaled(sum, weight, *corner))
        };
        let sign = if dot(normal, sum(from)) < T::zero() { -T::one() } else { T::one() };
        let normal = normal.map(|c| sign * c / length);
        Some(Impact { time, place, weights, normal })
    })
}

/// c₀ + c₁ t + c₂ t² + c₃ t³.
#[derive(Clone, Copy, Debug)]
struct Cubic<T>([T; 4]);

impl<T: Real> Cubic<T> {
    /// det[a + t u, b + t v, c + t w].
    fn of_determinant([a, b, c]: &[[T; 3]; 3], [u, v, w]: &[[T; 3]; 3]) -> Self {
        let det = |a: &[T; 3], b: &[T; 3], c: &[T; 3]| dot(*a, cross(*b, *c));
        Self([
            det(a, b, c),
            det(u, b, c) + det(a, v, c) + det(a, b, w),
            det(u, v, c) + det(u, b, w) + det(a, v, w),
            det(u, v, w),
        ])
    }

    fn at(&self, t: T) -> T {
        let [a, b, c, d] = self.0;
        a + t * (b + t * (c + t * d))
    }

    fn slope(&self, t: T) -> T {
        let [_, b, c, d] = self.0;
        b + t * (number::<T>(2.0) * c + t * number::<T>(3.0) * d)
    }

    /// The roots in (0, 1], in rising order.
    fn roots(&self) -> [Option<T>; 3] {
        let [_, b, c, d] = self.0;
        let (zero, one) = (T::zero(), T::one());
        let mut ends = [zero, one, one, one];
        let mut parts = 1;
        for extremum in quadratic_roots(b, number::<T>(2.0) * c, number::<T>(3.0) * d) {
            if extremum > zero && extremum < one {
                (ends[parts], parts) = (extremum, parts + 1);
            }
        }
        let mut roots = [None; 3];
        for part in 0..parts {
            roots[part] = self.root_between(ends[part], ends[part + 1]);
        }
        roots
    }

    /// The root in a part in which it is monotonic, but not at the part's start.
    fn root_between(&self, mut low: T, mut high: T) -> Option<T> {
        let (zero, half) = (T::zero(), number::<T>(0.5));
        let (first, last) = (self.at(low), self.at(high));
        if first == zero || last != zero && (first > zero) == (last > zero) {
            return None;
        }
        let mut t = half * (low + high);
        for _ in 0..STEPS {
            let value = self.at(t);
            if value == zero {
                break;
            }
            if (value > zero) == (first > zero) {
                low = t;
            } else {
                high = t;
            }
            let next = t - value / self.slope(t);
            let next = if next > low && next < high { next } else { half * (low + high) };
            if next == t {
                break;
            }
            t = next;
        }
        Some(t)
    }
}

/// The roots of a + b t + c t², the smaller first; not a number where there are none.
fn quadratic_roots<T: Real>(a: T, b: T, c: T) -> [T; 2] {
    let two = number::<T>(2.0);
    let root = (b * b - number::<T>(4.0) * a * c).sqrt();
    // Without cancellation.
    let q = -(b + if b < T::zero() { -root } else { root }) / two;
    let (x, y) = (q / c, a / q);
    if x < y { [x, y] } else { [y, x] }
}

/// (s, r) with the least |s u + r v − w|; `None` for parallel vectors.
fn least_squares<T: Real>(u: [T; 3], v: [T; 3], w: [T; 3]) -> Option<[T; 2]> {
    let (uu, uv, vv) = (dot(u, u), dot(u, v), dot(v, v));
    let determinant = uu * vv - uv * uv;
    if determinant <= T::epsilon() * uu * vv {
        return None;
    }
    let (uw, vw) = (dot(u, w), dot(v, w));
    Some([(vv * uw - uv * vw) / determinant, (uu * vw - uv * uw) / determinant])
}

/// Whether a share is 0 to 1, up to rounding.
fn within<T: Real>(share: T) -> bool {
    let slack = if T::epsilon() > number(1e-10) { SLACK_F32 } else { SLACK };
    share >= number(-slack) && share <= number(1.0 + slack)
}

fn sub<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn add_scaled<T: Real>(a: [T; 3], by: T, b: [T; 3]) -> [T; 3] {
    [a[0] + by * b[0], a[1] + by * b[1], a[2] + by * b[2]]
}

fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    fn cases() -> Vec<Value> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/xpbd/xpbd_5_ccd.json");
        let file: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        file["cases"].as_array().unwrap().clone()
    }

    fn numbers(list: &Value) -> Vec<f64> {
        list.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    }

    fn corners(list: &Value) -> Corners<f64> {
        std::array::from_fn(|k| numbers(&list[k]).try_into().unwrap())
    }

    fn impact<T: Real>(kind: &str, from: &Corners<f64>, to: &Corners<f64>) -> Option<Impact<T>> {
        let [from, to] = [from, to].map(|corners| corners.map(|corner| corner.map(number::<T>)));
        match kind {
            "edge-edge" => edges(&from, &to),
            "point-triangle" => point_triangle(&from, &to),
            other => panic!("{other}"),
        }
    }

    /// Checks the golden pairs, and returns how many of them touch.
    fn check<T: Real>(tolerance: f64) -> usize {
        let mut hits = 0;
        for (number, case) in cases().iter().enumerate() {
            let kind = case["kind"].as_str().unwrap();
            let found = impact::<T>(kind, &corners(&case["x0"]), &corners(&case["x1"]));
            let out = &case["out"];
            assert_eq!(Some(found.is_some()), out["hit"].as_bool(), "case {number}");
            let Some(found) = found else { continue };
            hits += 1;
            let near = |a: &[T], b: &[f64]| {
                assert_eq!(a.len(), b.len());
                for (a, b) in a.iter().zip(b) {
                    let error = (a.to_f64().unwrap() - b).abs();
                    assert!(error < tolerance * b.abs().max(1.0), "case {number}: {a:?}, {b}");
                }
            };
            near(&[found.time], &[out["t"].as_f64().unwrap()]);
            near(&found.place, &numbers(&out["par"]));
            near(&found.weights, &numbers(&out["weights"]));
            near(&found.normal, &numbers(&out["normal"]));
        }
        hits
    }

    #[test]
    fn golden_pairs_in_float64() {
        assert!(check::<f64>(1e-9) > 10);
    }

    #[test]
    fn golden_pairs_in_float32() {
        assert!(check::<f32>(1e-4) > 10);
    }

    /// Numbers of −1 to 1.
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    #[test]
    fn edges_that_are_thrown_through_each_other_touch_where_they_were_made_to() {
        let mut state = 7;
        let mut vector = |scale: f64| [0; 3].map(|_| scale * random(&mut state));
        for _ in 0..10_000 {
            // They touch at time t at s and r, and come from anywhere.
            let [t, s, r] = vector(1.0).map(|c| 0.5 + 0.45 * c);
            let (u, v, centre) = (vector(1.0), vector(1.0), vector(1.0));
            let normal = cross(u, v);
            if dot(normal, normal) < 1e-3 {
                continue;
            }
            let touch = [
                add_scaled(centre, -s, u),
                add_scaled(centre, 1.0 - s, u),
                add_scaled(centre, -r, v),
                add_scaled(centre, 1.0 - r, v),
            ];
            let motions = [vector(1.0), vector(1.0), vector(1.0), vector(1.0)];
            let place = |time: f64| -> Corners<f64> {
                std::array::from_fn(|k| add_scaled(touch[k], time - t, motions[k]))
            };
            let found = edges(&place(0.0), &place(1.0)).expect("they touch");
            assert!(found.time <= t + 1e-9, "{} is later than {t}", found.time);
            // At the time found they do touch.
            let now = place(found.time);
            let zero = [0.0; 3];
            let apart =
                now.iter().zip(found.weights).fold(zero, |sum, (x, weight)| add_scaled(sum, weight, *x));
            assert!(dot(apart, apart) < 1e-14, "{apart:?}");
        }
    }

    #[test]
    fn motion_in_a_plane_and_parallel_edges_have_no_answer() {
        let flat = |y: f64| [[-1.0, y, 0.0], [1.0, y, 0.0], [0.0, -1.0, 0.0], [0.0, 0.2, 0.0]];
        assert_eq!(edges(&flat(1.0), &flat(-1.0)), None);
        let parallel = |y: f64| [[-1.0, y, 0.0], [1.0, y, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        assert_eq!(edges(&parallel(1.0), &parallel(-1.0)), None);
    }
}
