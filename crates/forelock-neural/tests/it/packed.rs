//! Inference for packed strands of any number of particles against a specification in float64.

#![expect(clippy::unwrap_used, reason = "a test fails where its strands are not as expected")]

use forelock_core::lane::{Row, Simd};
use forelock_core::pose::Pose;
use forelock_core::strands::{Model, State, Strands, vector};
use forelock_neural::network::inference::{Positions, Predictor};
use forelock_neural::network::packed::{PackedFrame, is_even};
use forelock_neural::network::rotation::{Basis, basis};
use forelock_neural::network::{Network, SHARED, STATICS, Shape, evaluate, shared_part, static_part};
use forelock_neural::random::Random;
use forelock_neural::{EDGES, PARTICLES};
use glam::{DQuat, DVec3};

/// Strands, cm, strand after strand.
struct Hair {
    positions: Vec<[f32; 3]>,
    offsets: Vec<u32>,
}

/// Wavy strands of these numbers of particles; edges of a strand are equally long, or differ by
/// up to `spread`.
fn hair(counts: &[usize], spread: f64) -> Hair {
    let mut random = Random::new(3);
    let mut hair = Hair { positions: Vec::new(), offsets: vec![0] };
    for &count in counts {
        let mut x = 5.0 * DVec3::new(random.signed(), random.signed(), random.signed());
        let mut direction = DVec3::NEG_Y;
        hair.positions.push(x.as_vec3().to_array());
        for _ in 1..count {
            let turn = 0.3 * DVec3::new(random.signed(), random.signed(), random.signed());
            direction = (direction + turn).normalize();
            let edge = 20.0 / (count - 1) as f64;
            x += direction * edge * (1.0 + spread * random.signed());
            hair.positions.push(x.as_vec3().to_array());
        }
        hair.offsets.push(hair.positions.len() as u32);
    }
    hair
}

fn network() -> Network<f32> {
    let shape = Shape::default();
    let mut random = Random::new(5);
    let weights = (0..shape.parameters()).map(|_| 0.06 * random.signed() as f32);
    Network::new(shape, weights.collect()).unwrap()
}

fn numbers(count: usize, seed: u64) -> Vec<f32> {
    let mut random = Random::new(seed);
    (0..count).map(|_| random.signed() as f32).collect()
}

fn to_f64(x: &[f32]) -> Vec<f64> {
    x.iter().map(|x| f64::from(*x)).collect()
}

/// The positions of a strand with particles `rest` whose network gives `o`.
fn expected(rest: &[DVec3], o: &[f64], basis: &Basis) -> Vec<DVec3> {
    let u: Vec<DVec3> = basis
        .iter()
        .map(|row| (0..EDGES).map(|k| 0.5 * row[k] * DVec3::from_slice(&o[3 * k..])).sum())
        .collect();
    let lengths: Vec<f64> = rest.windows(2).map(|x| x[0].distance(x[1])).collect();
    let whole: f64 = lengths.iter().sum();
    let (mut x, mut arc) = (vec![rest[0]], 0.0);
    for (i, length) in lengths.iter().enumerate() {
        let share = (arc + 0.5 * length) / whole;
        arc += length;
        let own = if is_even(&lengths) { i as f64 } else { 24.0 * share - 0.5 };
        let below = own.floor().clamp(0.0, 22.0);
        let fraction = (own - below).clamp(0.0, 1.0);
        let u = u[below as usize].lerp(u[below as usize + 1], fraction);
        let v = rest[i + 1] - rest[i];
        let across = u.cross(v);
        let turn = 2.0 / (1.0 + u.length_squared()) * (across + u.cross(across));
        x.push(x[i] + v + turn);
    }
    x
}

/// The positions that the network with the rotation head predicts, in the groom's order.
fn predict(hair: &Hair, simd: Simd, pose: &Pose) -> Vec<DVec3> {
    predict_with(&Predictor::new(&network(), &basis(100.0, 1e-4, 1.0 / 30.0), simd).unwrap(), hair, pose)
}

/// The positions that `predictor` predicts, in the groom's order.
fn predict_with(predictor: &Predictor, hair: &Hair, pose: &Pose) -> Vec<DVec3> {
    let model = Model::<f32>::new(&Strands::new(&hair.positions, &hair.offsets)).unwrap();
    let statics = numbers(STATICS * model.strand_count, 7);
    let strands = predictor.prepare_packed(&model, &statics).unwrap();
    let mut rows = vec![Row([f32::NAN; 16]); 3 * model.places()];
    let shared = numbers(SHARED, 9);
    // Rest positions are about the model's centre.
    let pose = model.about_centre(pose, DVec3::ZERO);
    let frame = PackedFrame { shared: &shared, rest: &model.rest, pose };
    predictor.predict_packed(&strands, &frame, &mut predictor.workspace(), &mut rows);
    let mut found = vec![DVec3::NAN; hair.positions.len()];
    State::<f32>::each_particle(&model, |particle, place, lane| {
        found[particle] = DVec3::from_array(vector(&rows, place, lane).map(f64::from));
    });
    found
}

/// What a GPU takes: the first layer's sums, block after block. The last packet is not full.
#[test]
fn sums_of_strands_are_stored_block_after_block() {
    let hair = hair(&[25; 16 * 5 + 3], 0.0);
    let model = Model::<f32>::new(&Strands::new(&hair.positions, &hair.offsets)).unwrap();
    let statics = numbers(STATICS * model.strand_count, 7);
    let network = network();
    let predictor = Predictor::displacing(&network, Simd::Auto).unwrap();
    let strands = predictor.prepare_packed(&model, &statics).unwrap();
    let width = network.shape().width;
    assert_eq!((model.blocks.len(), strands.sums().len()), (6, 8 * width));
    for (block, sums) in model.blocks.iter().zip(strands.sums().chunks_exact(width)) {
        for (lane, strand) in block.strands[..block.live].iter().enumerate() {
            let expected = static_part(&network, &statics[STATICS * *strand as usize..][..STATICS]);
            for (sum, expected) in sums.iter().zip(expected) {
                assert!((sum.0[lane] - expected).abs() < 1e-5, "{strand}: {} {expected}", sum.0[lane]);
            }
        }
    }
}

/// The positions of a strand with particles `rest` whose network gives the displacements `o`.
fn displaced(rest: &[DVec3], o: &[f64]) -> Vec<DVec3> {
    let o: Vec<DVec3> = o.chunks_exact(3).map(DVec3::from_slice).collect();
    let lengths: Vec<f64> = rest.windows(2).map(|x| x[0].distance(x[1])).collect();
    let whole: f64 = lengths.iter().sum();
    let (mut x, mut arc) = (vec![rest[0]], 0.0);
    for (i, length) in lengths.iter().enumerate() {
        arc += length;
        let own = if is_even(&lengths) { i as f64 } else { 24.0 * arc / whole - 1.0 };
        let below = own.floor().clamp(0.0, 22.0);
        let fraction = (own - below).clamp(0.0, 1.0);
        x.push(rest[i + 1] + arc * o[below as usize].lerp(o[below as usize + 1], fraction));
    }
    x
}

const COUNTS: [usize; 6] = [25, 2, 40, 10, 3, 101];

#[test]
fn strands_of_any_number_of_particles_take_the_outputs_at_their_arc_lengths() {
    let counts: Vec<usize> = (0..300).map(|s| COUNTS[s % 6]).collect();
    let pose = Pose::new(DQuat::from_rotation_z(0.7), DVec3::new(3.0, -1.0, 2.0));
    let network = network();
    let double = Network::new(*network.shape(), to_f64(network.parameters())).unwrap();
    let (basis, shared) = (basis(100.0, 1e-4, 1.0 / 30.0), to_f64(&numbers(SHARED, 9)));
    let frame = shared_part(&double, &shared);
    for spread in [0.0, 0.8] {
        let hair = hair(&counts, spread);
        let statics = to_f64(&numbers(STATICS * counts.len(), 7));
        let strands: Vec<Vec<DVec3>> = hair
            .offsets
            .windows(2)
            .map(|range| {
                let own = &hair.positions[range[0] as usize..range[1] as usize];
                own.iter().map(|x| DVec3::from_array(x.map(f64::from))).collect()
            })
            .collect();
        let expected = [true, false].map(|rotates| -> Vec<DVec3> {
            let inputs = strands.iter().zip(statics.chunks_exact(STATICS));
            let placed = inputs.flat_map(|(rest, statics)| {
                let o = evaluate(&double, &static_part(&double, statics), &frame);
                if rotates { expected(rest, &o, &basis) } else { displaced(rest, &o) }
            });
            placed.map(|x| pose.transform_point(x)).collect()
        });
        for simd in Simd::ALL.into_iter().filter(|simd| simd.is_supported()) {
            let displacing = Predictor::displacing(&network, simd).unwrap();
            let found = [predict(&hair, simd, &pose), predict_with(&displacing, &hair, &pose)];
            for (found, expected) in found.iter().zip(&expected) {
                let worst = found.iter().zip(expected).map(|(a, b)| a.distance(*b));
                let worst = worst.fold(0.0, |a: f64, b| if b > a || b.is_nan() { b } else { a });
                assert!(worst < 1e-4, "{simd:?}, spread {spread}: {worst:e} cm");
            }
        }
        // The strands moved at all.
        let rest = hair.positions.iter().map(|x| pose.transform_point(DVec3::from_array(x.map(f64::from))));
        let rest: Vec<DVec3> = rest.collect();
        for expected in &expected {
            assert!(expected.iter().zip(&rest).any(|(a, b)| a.distance(*b) > 1.0));
        }
    }
}

#[test]
fn strands_of_the_network_have_the_results_of_its_own_inference() {
    let hair = hair(&[PARTICLES; 150], 0.0);
    let rest: Vec<Positions> = hair.positions.as_chunks().0.to_vec();
    let rotating = Predictor::new(&network(), &basis(100.0, 1e-4, 1.0 / 30.0), Simd::Auto).unwrap();
    for predictor in [rotating, Predictor::displacing(&network(), Simd::Auto).unwrap()] {
        let found = predict_with(&predictor, &hair, &Pose::IDENTITY);
        let strands = predictor.prepare(&rest, &numbers(STATICS * rest.len(), 7)).unwrap();
        let mut out = vec![[[0.0; 3]; PARTICLES]; rest.len()];
        predictor.predict(&strands, &numbers(SHARED, 9), &mut out);
        for (a, b) in found.iter().zip(out.as_flattened()) {
            let error = a.distance(DVec3::from_array(b.map(f64::from)));
            assert!(error < 1e-5, "{:?}: {error:e} cm", predictor.head());
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let hair = hair(&(0..700).map(|s| COUNTS[s % 6]).collect::<Vec<_>>(), 0.5);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| predict(&hair, Simd::Auto, &Pose::IDENTITY))
    };
    let one = on(1);
    assert!(on(2) == one && on(3) == one);
}

#[test]
fn strands_without_inputs_are_refused() {
    let hair = hair(&[25, 10], 0.0);
    let model = Model::<f32>::new(&Strands::new(&hair.positions, &hair.offsets)).unwrap();
    let predictor = Predictor::new(&network(), &basis(100.0, 1e-4, 1.0 / 30.0), Simd::Auto).unwrap();
    assert!(predictor.prepare_packed(&model, &numbers(STATICS, 1)).is_err());
}
