use super::*;
use crate::PARTICLES;
use crate::losses::body::Capsule;
use crate::losses::field::SmoothField;
use crate::network::STATICS;
use forelock_core::lane::V3;
use glam::{DMat3, DVec3};

/// A ball about the origin.
pub(super) fn ball(radius: f64) -> SmoothField {
    SmoothField::new([DVec3::splat(-15.0), DVec3::splat(15.0)], 0.5, |x| (x.length() - radius) as f32)
}

/// Curved strands on a ball that turns, with random inputs.
pub(crate) fn set() -> TrainingSet {
    let mut random = Random::stream(7, 0);
    let mut strands = Vec::new();
    for strand in 0..200 {
        let edge = if strand < 120 { 0.8 } else { 0.5 };
        let mut out = DVec3::new(random.signed(), random.unit(), random.signed()).normalize();
        let mut at = 9.0 * out;
        let rest = std::array::from_fn(|_| {
            let here = at.as_vec3().to_array();
            out =
                (out + 0.2 * DVec3::new(random.signed(), random.signed() - 0.5, random.signed())).normalize();
            at += edge * out;
            here
        });
        let statics = (0..STATICS).map(|_| random.signed() as f32).collect();
        strands.push(TrainingStrand { rest, statics });
    }
    let mut frame = |frame: i32| Frame {
        rotation: DMat3::from_rotation_y(0.05 * f64::from(frame)),
        origin: DVec3::new(0.2 * f64::from(frame), 160.0, 0.0),
        pose: std::array::from_fn(|_| 0.3 * random.signed() as f32),
        velocity: std::array::from_fn(|_| 0.3 * random.signed() as f32),
        parts: vec![Capsule { ends: [V3([0.0, -18.0, 0.0]), V3([0.0, -8.0, 0.0])], radius: 6.0 }],
    };
    let clips = vec![(0..20).map(&mut frame).collect(), (0..MOMENTS as i32).map(&mut frame).collect()];
    TrainingSet::new(strands, &[120, 80], clips, ball(8.8)).unwrap()
}

#[test]
fn the_gradient_of_a_batch_agrees_with_finite_differences() {
    let alone = Energies::default();
    let repulsion = Some(RepulsionTerms { stiffness: 0.5, smoothing: 1.5 });
    let adhesion = Some(AdhesionTerms { stiffness: 1.0, range: 3.0 });
    agrees(OutputHead::Rotation, true, alone);
    agrees(OutputHead::Rotation, false, Energies { repulsion, ..alone });
    agrees(OutputHead::Displacement, true, Energies { adhesion, ..alone });
}

#[test]
fn the_gradient_of_the_squared_error_agrees_with_finite_differences() {
    let mut set = set();
    set.drape(&Energies::default(), 1, 2);
    agrees_on(&set, OutputHead::Rotation, false, Energies::default());
}

/// Of a network with this head, with or without a history.
fn agrees(head: OutputHead, has_history: bool, energies: Energies) {
    let mut set = set();
    set.prepare(&energies);
    agrees_on(&set, head, has_history, energies);
}

fn agrees_on(set: &TrainingSet, head: OutputHead, has_history: bool, mut energies: Energies) {
    let mut options = Options { head, ..Options::default() };
    options.energies.motion.is_dynamic = has_history;
    let mut trainer = Trainer::new(options);
    // Outputs of order one.
    let [.., output, _] = trainer.network.shape().ranges();
    trainer.network.parameters_mut()[output].iter_mut().for_each(|weight| *weight *= 20.0);
    // The drape: of the motion the gradient is not that of the residual alone (`window`). It does
    // not go through the weight of style either.
    energies.motion.is_dynamic = false;
    let batch = set.draw(&mut Random::stream(3, 1), energies.have_neighbours());
    let mut workspace = Workspace::new(*trainer.network.shape());
    let simd = Simd::Auto.resolve();
    let mut energy = |network: &Network<f32>| {
        let basis = basis(100.0, 1e-4, 1.0 / 30.0);
        let goal = Goal { energies, objective: Objective::Residual, head };
        let inputs = frame_inputs(set, &batch, network.shape().shared);
        let frames = Soap::new(network.shape()).frames(simd, network.parameters(), inputs);
        let batch = Batch { set, drawn: &batch, frames: &frames };
        let energy = workspace.gradient(simd, network, &basis, &goal, &batch);
        (energy, workspace.found().gradient.to_vec())
    };
    let (_, gradient) = energy(&trainer.network);
    // Along the gradient of each part of the parameters, and along random directions.
    let mut random = Random::stream(11, 0);
    for (part, range) in trainer.network.shape().ranges().into_iter().enumerate() {
        for is_random in [false, true] {
            let mut direction = vec![0.0f64; gradient.len()];
            for k in range.clone() {
                // Near the gradient, so that the slope is not lost in rounding.
                let noise = if is_random { random.signed() } else { 0.0 };
                direction[k] = f64::from(gradient[k]) * (1.0 + noise);
            }
            let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
            let slope: f64 =
                direction.iter().zip(&gradient).map(|(d, g)| d * f64::from(*g)).sum::<f64>() / norm;
            let ends = [1e-3, -1e-3].map(|h| {
                let mut moved = trainer.network.clone();
                for (p, d) in moved.parameters_mut().iter_mut().zip(&direction) {
                    *p += (h * d / norm) as f32;
                }
                energy(&moved).0
            });
            let found = (ends[0] - ends[1]) / 2e-3;
            assert!((found / slope - 1.0).abs() < 0.02, "part {part}: {found} beside {slope}");
        }
    }
}

#[test]
fn one_seed_gives_one_network_whatever_the_threads() {
    let set = set();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut trainer = Trainer::new(Options { steps: 20, ..Options::default() });
            let energies: Vec<f64> = (0..20).map(|_| trainer.step(&set).unwrap().energy).collect();
            assert!(energies.iter().all(|energy| energy.is_finite()));
            trainer.average().parameters().to_vec()
        })
    };
    let [one, two, three] = [1, 2, 3].map(run);
    assert!(
        one.iter()
            .zip(&two)
            .zip(&three)
            .all(|((a, b), c)| a.to_bits() == b.to_bits() && a.to_bits() == c.to_bits())
    );
}

/// Half the mean square of the distances of a strand's particles from a drape.
fn error(x: &[[f32; 3]; PARTICLES], drape: &[[f32; 3]; PARTICLES]) -> f64 {
    let square = |(a, b): (&f32, &f32)| f64::from(a - b).powi(2);
    let sum: f64 = x.as_flattened().iter().zip(drape.as_flattened()).map(square).sum();
    0.5 * sum / PARTICLES as f64
}

#[test]
fn squared_error_falls_from_that_of_the_shape_at_rest_whatever_the_threads() {
    const STEPS: u32 = 60;
    let mut options =
        Options { steps: STEPS, rate: 3e-3, objective: Objective::Drapes, ..Options::default() };
    options.energies.motion.is_dynamic = false;
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut set = set();
            set.drape(&options.energies, options.seed, 2);
            let mut trainer = Trainer::new(options);
            let errors: Vec<f64> = (0..STEPS).map(|_| trainer.step(&set).unwrap().energy).collect();
            (set, errors, trainer.average().parameters().to_vec())
        })
    };
    let (set, errors, one) = run(1);
    // The network begins at the shape at rest.
    let drapes = set.drapes.as_ref().unwrap();
    let windows: Vec<f64> = (0..2)
        .map(|window| {
            let strands = drapes.strands(window);
            let all = drapes.of(window).iter().flat_map(|moment| moment.iter().zip(strands));
            let count = (MOMENTS * STRANDS) as f64;
            let of_strand = |(drape, strand): (&[[f32; 3]; PARTICLES], usize)| {
                f64::from(set.chances.weight(strand)) * error(&set.strands[strand].rest, drape)
            };
            all.map(of_strand).sum::<f64>() / count
        })
        .collect();
    let [least, most] = [f64::min, f64::max].map(|of| windows.iter().copied().reduce(of).unwrap());
    assert!(least > 0.01, "strands sag: {windows:?}");
    assert!(errors[0] > 0.9 * least && errors[0] < 1.1 * most, "{} of {windows:?}", errors[0]);
    let last = errors[errors.len() - 5..].iter().sum::<f64>() / 5.0;
    assert!(last < 0.5 * least, "{last} of {windows:?}");
    let (_, _, two) = run(2);
    assert!(one.iter().zip(&two).all(|(a, b)| a.to_bits() == b.to_bits()));
}

#[test]
fn a_network_without_lock_codes_does_not_depend_on_them() {
    let mut set = set();
    let mut trainer = Trainer::new(Options { steps: 20, lock_codes: false, ..Options::default() });
    assert!(set.strands.iter().any(|strand| strand.statics[LOCK_INPUTS].iter().any(|x| *x != 0.0)));
    trainer.prepare(&mut set);
    for _ in 0..5 {
        trainer.step(&set).unwrap();
    }
    let (shape, weights) = (trainer.options().shape(), trainer.average().parameters());
    let statics: Vec<_> = weights[shape.ranges()[0].clone()].chunks_exact(shape.width).collect();
    for (input, weights) in statics.iter().enumerate() {
        assert_eq!(weights.iter().all(|x| *x == 0.0), LOCK_INPUTS.contains(&input), "input {input}");
    }
}

#[test]
fn what_cannot_be_trained_with_is_refused() {
    let set = set();
    let refused = |strands: &[TrainingStrand], clips: &[Clip]| {
        TrainingSet::new(strands.to_vec(), &[strands.len()], clips.to_vec(), ball(1.0)).unwrap_err()
    };
    assert_eq!(refused(&[], &set.clips), SetError::NoStrands);
    assert_eq!(refused(&set.strands, &[]), SetError::NoMotions);
    let short = [set.clips[0].clone(), set.clips[1][1..].to_vec()];
    assert_eq!(refused(&set.strands, &short), SetError::Short { clip: 1, frames: MOMENTS - 1 });
    let mut folded = set.strands.clone();
    folded[3].rest = [[0.0; 3]; PARTICLES];
    assert_eq!(refused(&folded, &set.clips), SetError::Strand { strand: 3 });
    let mut broken = set.clips.clone();
    broken[1][2].velocity[5] = f32::NAN;
    assert_eq!(refused(&set.strands, &broken), SetError::Frame { clip: 1, frame: 2 });
}

#[test]
fn the_rate_rises_over_at_most_a_tenth_of_the_steps() {
    let rise = |steps: u32, done: u32| Options { steps, ..Options::default() }.rise_at(done);
    assert_eq!([0, 149, 299, 5_000].map(|done| rise(18_000, done)), [1.0 / 300.0, 0.5, 1.0, 1.0]);
    assert_eq!([0, 1, 2].map(|done| rise(20, done)), [0.5, 1.0, 1.0]);
    assert_eq!([0, 1].map(|steps| rise(steps, 0)), [1.0, 1.0]);
}

#[test]
fn the_extra_margin_counts_in_training_alone() {
    let options = Options { extra_margin: 0.3, steps: 100, ..Options::default() };
    let margin = options.energies.body.margin;
    assert_eq!([0, 99].map(|done| options.energies_at(done).body.margin), [margin + 0.3; 2]);
    assert_eq!(options.energies.terms().body.margin, margin);
}
