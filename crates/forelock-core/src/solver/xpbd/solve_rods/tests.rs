//! Single constraints against reference results in float64, and against their energies.

use super::{Edge, Rotation, couple, stretch_shear};
use crate::lane::{Lane, Pack, Quat, V3};
use glam::{DQuat, DVec3};
use num_traits::ToPrimitive;
use serde_json::Value;

/// The single solves of a file.
fn cases(name: &str) -> Vec<Value> {
    let path = format!("{}/tests/golden/xpbd/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let file: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    file["cases"].as_array().unwrap().clone()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn vector(value: &Value) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|k| number(&value[k])))
}

/// A quaternion w, x, y, z.
fn quaternion(value: &Value) -> DQuat {
    let [w, x, y, z] = [0, 1, 2, 3].map(|k| number(&value[k]));
    DQuat::from_xyzw(x, y, z, w)
}

/// The largest difference of `found` from `expected`, over the largest number expected.
fn error<L: Lane>(found: &[L], expected: &[f64]) -> f64 {
    let found = found.iter().map(|x| x.get(0).to_f64().unwrap());
    let differences = found.zip(expected).map(|(x, y)| (x - y).abs());
    let largest = expected.iter().fold(1.0f64, |most, x| most.max(x.abs()));
    differences.fold(0.0, f64::max) / largest
}

fn parts<L: Lane>(q: Quat<L>) -> [L; 4] {
    let [x, y, z] = q.v.0;
    [x, y, z, q.w]
}

/// A rotation that has not changed yet.
fn still<L: Lane>(now: Quat<L>) -> Rotation<L> {
    Rotation { now, change: Quat::zero() }
}

fn worst_stretch_shear<L: Lane>() -> f64 {
    let mut worst = 0.0f64;
    for case in cases("xpbd_1_stretch_shear") {
        let (inp, out) = (&case["inp"], &case["out"]);
        let ends = [vector(&inp["x0"]), vector(&inp["x1"])];
        let length = number(&case["l"]);
        let (inverse, w) = (L::from_f64(1.0 / length), [number(&case["w0"]), number(&case["w1"])]);
        // Frames at rest along z, as the file's.
        let before = Quat::<L>::splat(quaternion(&inp["q"]));
        let mut edge = Edge {
            rotation: still(before),
            before,
            weight: L::from_f64(number(&case["wq"])),
            length: L::from_f64(length),
            tangent: V3::splat(DVec3::Z),
        };
        let alpha = L::from_f64(number(&case["at"]));
        let sum = V3::splat(inp.get("lam").map_or(DVec3::ZERO, vector));
        let change = stretch_shear(ends.map(V3::splat), &mut edge, w.map(L::from_f64), inverse, alpha, sum);
        let moved = [(0, -1.0), (1, 1.0)]
            .map(|(k, side)| V3::splat(ends[k]).add_scaled(L::from_f64(side * w[k] / length), change));
        let q = quaternion(&out["q"]);
        worst = worst
            .max(error(&moved[0].0, &vector(&out["x0"]).to_array()))
            .max(error(&moved[1].0, &vector(&out["x1"]).to_array()))
            .max(error(&(sum + change).0, &vector(&out["lam"]).to_array()))
            .max(error(&parts(edge.rotation.now), &q.to_array()));
    }
    worst
}

fn worst_bend_twist<L: Lane>() -> f64 {
    let mut worst = 0.0f64;
    for case in cases("xpbd_2_bend_twist") {
        let (inp, out) = (&case["inp"], &case["out"]);
        // The frame of `a` at rest is the identity, that of `b` the file's Ω⁰.
        let arc = quaternion(inp.get("O0").unwrap_or(&case["O0"]));
        let mut a = still(Quat::<L>::splat(quaternion(&inp["qa"])));
        let mut b = still(Quat::<L>::splat(quaternion(&inp["qb"]) * arc.inverse()));
        let w = [number(&case["wa"]), number(&case["wb"])].map(L::from_f64);
        let sum = V3::splat(inp.get("lam").map_or(DVec3::ZERO, vector));
        let arc = Quat::splat(arc);
        let sum = couple([&mut a, &mut b], arc, w, L::from_f64(number(&case["at"])), sum);
        worst = worst
            .max(error(&parts(a.now), &quaternion(&out["qa"]).to_array()))
            .max(error(&parts(b.now * arc), &quaternion(&out["qb"]).to_array()))
            .max(error(&sum.0, &vector(&out["lam"]).to_array()));
    }
    worst
}

#[test]
fn single_solves_agree_with_the_references() {
    let found = [worst_stretch_shear::<f64>(), worst_bend_twist::<f64>()];
    assert!(found.iter().all(|error| *error <= 1e-12), "float64: {found:?}");
    let found = [worst_stretch_shear::<Pack<1, false>>(), worst_bend_twist::<Pack<1, false>>()];
    assert!(found.iter().all(|error| *error <= 1e-5), "float32: {found:?}");
}

/// Gradient of `f` by central differences, without its part along the unit quaternion `at`.
fn gradient(at: DQuat, f: impl Fn(DQuat) -> f64) -> DQuat {
    let step = 1e-5;
    let along = |k: usize| {
        let mut parts = [0.0; 4];
        parts[k] = step;
        let aside = DQuat::from_array(parts);
        (f(at + aside) - f(at - aside)) / (2.0 * step)
    };
    let all = DQuat::from_array([0, 1, 2, 3].map(along));
    all - at * at.dot(all)
}

fn glam(q: Quat<f64>) -> DQuat {
    DQuat::from_array(parts(q))
}

/// A small correction of a rotation is its weight times the gradient of Δλ·C.
#[test]
fn corrections_follow_the_gradients() {
    const SMALL: f64 = 1e-10;
    let vector = |q: DQuat| DVec3::new(q.x, q.y, q.z);
    let pure = |v: DVec3| DQuat::from_xyzw(v.x, v.y, v.z, 0.0);
    for k in 0..20 {
        let angle = f64::from(k);
        let a = DQuat::from_scaled_axis(DVec3::new(angle.sin(), 0.3 * angle, angle.cos())).normalize();
        let b = a * DQuat::from_scaled_axis(0.4 * DVec3::new(angle.cos(), angle.sin(), 0.5));
        let arc = DQuat::from_rotation_arc(DVec3::Z, DVec3::new(0.3, 0.1, 1.0).normalize());
        let tangent = DVec3::new(0.2, angle.cos(), 0.4).normalize();
        let direction = DVec3::new(0.1, angle.sin(), -0.7);

        let mut edge = Edge {
            rotation: still(Quat::<f64>::splat(a)),
            before: Quat::splat(a),
            weight: SMALL,
            length: 1.0,
            tangent: V3::splat(tangent),
        };
        let ends = [V3::zero(), V3::splat(direction)];
        let change = stretch_shear(ends, &mut edge, [0.5, 0.7], 1.0, 0.1, V3::zero());
        let change = DVec3::from_array(change.0);
        let constraint = |r: DQuat| direction - vector(r * pure(tangent) * r.conjugate());
        let expected = gradient(a, |r| change.dot(constraint(r)));
        let found = glam(edge.rotation.change) * (1.0 / SMALL);
        assert!((found - expected).length() < 1e-8, "{found} {expected}");

        let mut pair = [still(Quat::<f64>::splat(a)), still(Quat::splat(b))];
        let [of_a, of_b] = &mut pair;
        let change = couple([of_a, of_b], Quat::splat(arc), [SMALL; 2], 0.2, V3::zero());
        let change = DVec3::from_array(change.0);
        let constraint = |a: DQuat, b: DQuat| vector(a.conjugate() * b * arc);
        let expected =
            [gradient(a, |a| change.dot(constraint(a, b))), gradient(b, |b| change.dot(constraint(a, b)))];
        for (own, expected) in pair.iter().zip(expected) {
            let found = glam(own.change) * (1.0 / SMALL);
            assert!((found - expected).length() < 1e-8, "{found} {expected}");
        }
    }
}
