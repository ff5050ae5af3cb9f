use super::*;
use crate::network::head::OutputHead;
use crate::train::Objective;
use crate::train::tests::set;

fn trainer(set: &TrainingSet, options: Options) -> MapTrainer {
    MapTrainer::new(options, MapStrands::new(&set.strands).unwrap())
}

/// The drape's goal: of the motion the gradient is not that of the residual alone.
fn drape(head: OutputHead) -> Goal {
    let mut energies = Options::default().energies;
    energies.motion.is_dynamic = false;
    Goal { energies, objective: Objective::Residual, head }
}

#[test]
fn the_gradient_of_every_layer_agrees_with_finite_differences() {
    let set = set();
    // Outputs of order one; small displacements, for stretch is stiff.
    for (head, size, step) in [(OutputHead::Rotation, 20.0, 1e-3), (OutputHead::Displacement, 1.0, 2e-4)] {
        let mut trainer = trainer(&set, Options { head, ..Options::default() });
        let [output, _] = ranges(DEPTH - 1);
        trainer.network.parameters[output].iter_mut().for_each(|weight| *weight *= size);
        let (goal, batch) = (drape(head), Batch::draw(&set, &mut Random::stream(3, 1)));
        let (_, gradient) = trainer.gradient(&trainer.network, &goal, &batch);
        let mut random = Random::stream(11, 0);
        for range in (0..DEPTH).flat_map(ranges) {
            let mut direction = vec![0.0f64; gradient.len()];
            // Near the gradient, so that the slope is not lost in rounding.
            range.clone().for_each(|k| direction[k] = f64::from(gradient[k]) * (1.0 + random.signed()));
            let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
            let slope = direction.iter().zip(&gradient).map(|(d, g)| d * f64::from(*g)).sum::<f64>() / norm;
            let ends = [step, -step].map(|h| {
                let mut moved = trainer.network.clone();
                for (p, d) in moved.parameters.iter_mut().zip(&direction) {
                    *p += (h * d / norm) as f32;
                }
                trainer.gradient(&moved, &goal, &batch).0
            });
            let found = (ends[0] - ends[1]) / (2.0 * step);
            assert!((found / slope - 1.0).abs() < 0.02, "{head:?} {range:?}: {found} beside {slope}");
        }
    }
}

#[test]
fn the_energy_falls_and_one_seed_gives_one_network_whatever_the_threads() {
    const STEPS: u32 = 40;
    let set = set();
    let options = Options { steps: STEPS, rate: 2e-3, warm_start: 1.0, ..Options::default() };
    let run = |threads: usize, rate: f64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut trainer = trainer(&set, Options { rate, ..options });
            let (goal, batch) = (drape(OutputHead::Rotation), Batch::draw(&set, &mut Random::stream(3, 1)));
            let first = trainer.gradient(&trainer.network, &goal, &batch).0;
            for _ in 0..STEPS {
                trainer.step(&set).unwrap();
            }
            let last = trainer.gradient(&trainer.network, &goal, &batch).0;
            (first - last, trainer.average().parameters().to_vec())
        })
    };
    let (fall, one) = run(1, options.rate);
    let (_, two) = run(2, options.rate);
    assert!(fall > 0.25, "{fall}");
    assert!(one.iter().zip(&two).all(|(a, b)| a.to_bits() == b.to_bits()));
    assert_eq!(run(2, 0.0).0, 0.0);
}
