//! The network against reference results, and inference against the network's specification.

#![expect(clippy::unwrap_used, reason = "a test fails where its file is not as expected")]

use crate::golden::{error, load, numbers, vectors};
use forelock_core::lane::{LANES, Row, Simd, V3};
use forelock_neural::losses::Strand;
use forelock_neural::network::inference::{Positions, Predictor};
use forelock_neural::network::product::{Factors, Start, product, tile_by_tile};
use forelock_neural::network::rotation::{Basis, basis, rotate, rotate_gradient};
use forelock_neural::network::{
    Network, OUTPUTS, SHARED, STATICS, Shape, evaluate, shared_part, static_part,
};
use forelock_neural::{EDGES, PARTICLES};
use glam::DVec3;
use serde_json::Value;

/// Rows and columns exchanged.
fn transposed(of: &[f64], columns: usize) -> Vec<f64> {
    (0..columns).flat_map(|c| of.iter().skip(c).step_by(columns).copied().collect::<Vec<_>>()).collect()
}

/// The network of the file, whose weights are `[outputs, inputs]`.
fn small(file: &Value) -> Network<f64> {
    let shape = Shape { width: 8, ..Shape::default() };
    let first = transposed(&numbers(&file["W1"]), STATICS + SHARED);
    let hidden = transposed(&numbers(&file["W2"]), 8);
    let output = transposed(&numbers(&file["W3"]), 8);
    let biases = ["b1", "b2", "b3"].map(|key| numbers(&file[key]));
    let (statics, shared) = first.split_at(STATICS * 8);
    let parts = [statics, shared, &biases[0], &hidden, &biases[1], &output, &biases[2]];
    Network::new(shape, parts.concat()).unwrap()
}

fn to_f32(x: &[f64]) -> Vec<f32> {
    x.iter().map(|x| *x as f32).collect()
}

fn to_f64(x: &[f32]) -> Vec<f64> {
    x.iter().map(|x| f64::from(*x)).collect()
}

#[test]
fn the_split_first_layer_agrees_with_reference_results() {
    let file = load("net_1_split_first_layer");
    let network = small(&file);
    let rows = |key: &str, size: usize| -> Vec<Vec<f64>> {
        numbers(&file[key]).chunks_exact(size).map(<[f64]>::to_vec).collect()
    };
    let statics: Vec<Vec<f64>> = rows("static", STATICS).iter().map(|x| static_part(&network, x)).collect();
    let shared: Vec<Vec<f64>> = rows("shared", SHARED).iter().map(|x| shared_part(&network, x)).collect();
    assert!(error(&statics.concat(), &numbers(&file["pre_static"])) < 1e-9);
    assert!(error(&shared.concat(), &numbers(&file["pre_shared"])) < 1e-9);
    let outputs: Vec<f64> = shared
        .iter()
        .flat_map(|f| statics.iter().flat_map(|s| evaluate(&network, s, f)).collect::<Vec<_>>())
        .collect();
    assert!(error(&outputs, &numbers(&file["out"])) < 1e-9);
}

#[test]
fn sizes_and_operations_are_those_of_the_paper() {
    let shape = Shape::default();
    assert_eq!(shape.parameters(), 276_040);
    assert_eq!(4 * shape.parameters(), 1_104_160);
    assert_eq!(shape.operations_per_strand(), 168_192);
    assert_eq!(shape.operations_per_frame(), 349_184);
}

/// Numbers in −1 to 1.
fn random(count: usize, seed: u64) -> Vec<f64> {
    let mut state = seed;
    let next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / f64::from(1u32 << 31).powi(2) * 1024.0 - 1.0
    };
    std::iter::repeat_with(next).take(count).collect()
}

#[test]
fn products_agree_with_sums_on_every_instruction_set() {
    for simd in Simd::ALL.into_iter().filter(|simd| simd.is_supported()) {
        for ((k, m), panels) in [((1, 1), 4), ((7, 6), 1), ((66, 72), 4), ((256, 17), 7), ((300, 5), 3)] {
            let [a, bias] = [to_f32(&random(k * m, 1)), to_f32(&random(m, 2))];
            let columns = LANES * panels;
            let b = to_f32(&random(k * columns, 3));
            let row = |at: usize| Row(b[at..at + LANES].try_into().unwrap());
            let stored: Vec<Row<f32>> = (0..panels)
                .flat_map(|panel| (0..k).map(move |k| k * columns + LANES * panel))
                .map(row)
                .collect();
            for (start, is_relu) in [
                (Start::Zero, false),
                (Start::Sums, false),
                (Start::Bias(&bias), false),
                (Start::BiasRelu(&bias), true),
            ] {
                let before = if matches!(start, Start::Sums) { 0.25 } else { f32::NAN };
                let mut c = vec![Row([before; LANES]); m * panels];
                product(simd, Factors { a: &tile_by_tile(&a, m), columns: m, b: &stored }, start, &mut c);
                let mut expected = Vec::new();
                for panel in 0..panels {
                    for (row, column) in (0..m).flat_map(|row| (0..LANES).map(move |lane| (row, lane))) {
                        let column = LANES * panel + column;
                        let begin = match start {
                            Start::Zero => 0.0,
                            Start::Sums => 0.25,
                            Start::Bias(bias) | Start::BiasRelu(bias) => f64::from(bias[row]),
                        };
                        let terms =
                            (0..k).map(|k| f64::from(a[k * m + row]) * f64::from(b[k * columns + column]));
                        let sum = begin + terms.sum::<f64>();
                        expected.push(if is_relu { sum.max(0.0) } else { sum });
                    }
                }
                let found: Vec<f64> = c.iter().flat_map(|row| row.0.map(f64::from)).collect();
                assert!(error(&found, &expected) < 1e-5, "{simd:?} {k} {m} {panels}");
            }
        }
    }
}

fn basis_of(value: &Value) -> Basis {
    let numbers = numbers(value);
    std::array::from_fn(|r| std::array::from_fn(|c| numbers[EDGES * r + c]))
}

#[test]
fn the_rotation_head_agrees_with_reference_results() {
    let file = load("net_4_rot_output");
    let printed = basis_of(&file["B_modal"]);
    let own = basis(100.0, 1e-4, 1.0 / 30.0);
    for k in 0..EDGES {
        let sign = if own[0][k] * printed[0][k] < 0.0 { -1.0 } else { 1.0 };
        for i in 0..EDGES {
            assert!(
                (sign * own[i][k] - printed[i][k]).abs() < 1e-6 * printed[i][k].abs().max(1e-2),
                "{i} {k}"
            );
        }
    }
    let identity: Basis = std::array::from_fn(|r| std::array::from_fn(|c| f64::from(u8::from(r == c))));
    let strands = |key: &str, size: usize| -> Vec<Vec<DVec3>> {
        vectors(&file[key]).chunks_exact(size).map(|x| x.iter().map(|x| DVec3::from(*x)).collect()).collect()
    };
    let (rests, outputs, weights) =
        (strands("x_rest", PARTICLES), strands("o", EDGES), strands("c", PARTICLES));
    for (name, basis) in [("identity", identity), ("modal", printed)] {
        let (mut x, mut by_o) = (Vec::new(), Vec::new());
        for ((rest, o), c) in rests.iter().zip(&outputs).zip(&weights) {
            let edges = std::array::from_fn(|i| V3::<f64>::splat(rest[i + 1] - rest[i]));
            let u = basis.map(|row| V3::splat(row.iter().zip(o).map(|(b, o)| 0.5 * *b * *o).sum()));
            let found: Strand<f64> = rotate(V3::splat(rest[0]), &edges, &u);
            x.extend(found.iter().flat_map(|x| x.0));
            let by_x: Strand<f64> = std::array::from_fn(|i| V3::splat(c[i]));
            let by_u = rotate_gradient(&edges, &u, &by_x);
            by_o.extend((0..EDGES).flat_map(|k| {
                let terms = basis.iter().zip(&by_u).map(|(row, by_u)| 0.5 * row[k] * DVec3::from(by_u.0));
                terms.sum::<DVec3>().to_array()
            }));
        }
        let expected = &file["out"][name];
        assert!(error(&x, &numbers(&expected["x"])) < 1e-9, "{name}");
        assert!(error(&by_o, &numbers(&expected["grad_o"])) < 1e-9, "{name}");
    }
}

#[test]
fn inference_agrees_with_the_specification_for_every_number_of_strands() {
    let shape = Shape::default();
    // He's deviations, so that activations stay of order one.
    let mut parameters = random(shape.parameters(), 5);
    for (range, inputs) in shape.ranges().into_iter().zip([STATICS, 300, 1, 256, 1, 256, 1]) {
        parameters[range].iter_mut().for_each(|w| *w *= 2.0 / (inputs as f64).sqrt());
    }
    let network = Network::new(shape, parameters.clone()).unwrap();
    let single = Network::new(shape, to_f32(&parameters)).unwrap();
    let basis = basis(100.0, 1e-4, 1.0 / 30.0);
    let shared = random(SHARED, 7);
    let frame = shared_part(&network, &shared);
    for simd in Simd::ALL.into_iter().filter(|simd| simd.is_supported()) {
        let predictor = Predictor::new(&single, &basis, simd).unwrap();
        for count in [1, 15, 17, 63, 64, 65, 200] {
            let statics = random(count * STATICS, 9);
            let rest: Vec<Positions> = (0..count)
                .map(|s| {
                    let edges = random(3 * PARTICLES, 11 + s as u64);
                    let mut at = [0.0f32; 3];
                    std::array::from_fn(|i| {
                        at = std::array::from_fn(|c| at[c] + edges[3 * i + c] as f32);
                        at
                    })
                })
                .collect();
            let strands = predictor.prepare(&rest, &to_f32(&statics)).unwrap();
            let mut out = vec![[[0.0; 3]; PARTICLES]; count];
            predictor.predict(&strands, &to_f32(&shared), &mut out);
            let mut expected = Vec::new();
            for (rest, statics) in rest.iter().zip(statics.chunks_exact(STATICS)) {
                let o = evaluate(&network, &static_part(&network, statics), &frame);
                let at = |i: usize| DVec3::from(rest[i].map(f64::from));
                let edges = std::array::from_fn(|i| V3::<f64>::splat(at(i + 1) - at(i)));
                let u = std::array::from_fn(|i| {
                    V3::splat((0..EDGES).map(|k| 0.5 * basis[i][k] * DVec3::from_slice(&o[3 * k..])).sum())
                });
                expected.extend(rotate(V3::splat(at(0)), &edges, &u).iter().flat_map(|x| x.0));
            }
            assert_eq!(expected.len(), count * 3 * PARTICLES);
            let found = to_f64(out.as_flattened().as_flattened());
            let error = error(&found, &expected);
            assert!(error < 1e-5, "{simd:?}, {count} strands: {error:e}");
        }
    }
}

#[test]
fn wrong_sizes_are_refused() {
    let shape = Shape::default();
    let refused = Network::new(shape, vec![0.0f32; 10]).unwrap_err();
    assert_eq!(refused.to_string(), "a network of this shape has 276040 parameters, not 10");
    let network = Network::new(shape, vec![0.0f32; shape.parameters()]).unwrap();
    let predictor = Predictor::new(&network, &basis(100.0, 1e-4, 1.0 / 30.0), Simd::Auto).unwrap();
    assert!(predictor.prepare(&[[[0.0; 3]; PARTICLES]], &[0.0; OUTPUTS]).is_err());
    let narrow = Shape { outputs: 3, ..shape };
    let narrow = Network::new(narrow, vec![0.0f32; narrow.parameters()]).unwrap();
    assert!(Predictor::new(&narrow, &basis(100.0, 1e-4, 1.0 / 30.0), Simd::Auto).is_err());
}
