//! Fig. 8: a tiny network for hair on a rig.

use std::time::Instant;

use forelock::{Observer, Progress};
use forelock_core::lane::Simd;
use forelock_neural::random::Random;
use forelock_neural::rigged::{
    ANGLES, Angles, MULTIPLY_ADDS, PoseNetwork, PosePredictor, PoseRange, Rig, RigPose, TrainSettings,
    WEIGHTS, train,
};

use crate::BenchError;
use crate::paper::study::{Study, Table, percent};
use crate::paper::watch::mean;

/// Poses that are trained, and others that are measured.
const POSES: [usize; 2] = [4096, 256];
/// Steps of the search for the least energy of a pose.
const SEARCH: usize = 3000;
/// Poses of a timed pass, and passes.
const TIMED: [usize; 2] = [4096, 20];

/// The least energy near `angles`: steepest descent with a step that grows while it goes down.
fn least(rig: &Rig<f64>, pose: &RigPose<f64>, mut angles: Angles<f64>) -> f64 {
    let body = rig.body(pose);
    let mut gradient = [0.0; ANGLES];
    let (mut energy, mut step) = (rig.energy(&body, &angles, &mut gradient), 1e-3);
    for _ in 0..SEARCH {
        let moved: Angles<f64> = std::array::from_fn(|k| angles[k] - step * gradient[k]);
        let mut at_moved = [0.0; ANGLES];
        let found = rig.energy(&body, &moved, &mut at_moved);
        if found < energy {
            (angles, energy, gradient, step) = (moved, found, at_moved, 1.3 * step);
        } else {
            step *= 0.5;
        }
    }
    energy
}

/// Microseconds a pose, one thread: the least of several passes.
fn micros(network: &PoseNetwork<f32>, poses: &[RigPose<f32>]) -> f64 {
    let [count, passes] = TIMED;
    let network = PosePredictor::new(network, Simd::Auto);
    let pass = || {
        let began = Instant::now();
        for pose in poses.iter().cycle().take(count) {
            std::hint::black_box(network.angles(std::hint::black_box(pose)));
        }
        1e6 * began.elapsed().as_secs_f64() / count as f64
    };
    (0..passes).map(|_| pass()).fold(f64::INFINITY, f64::min)
}

/// The rigged variant, trained.
pub(super) struct Rigged {
    network: PoseNetwork<f64>,
    /// Microseconds a pose.
    pub micros: f64,
}

impl Rigged {
    /// Trains it in `steps` steps.
    pub fn train(steps: u32) -> Result<Self, BenchError> {
        let mut random = Random::new(1);
        let range = PoseRange::default();
        let poses: Vec<RigPose<f64>> = (0..POSES[0]).map(|_| range.draw(&mut random)).collect();
        let network = train(&Rig::example(), &poses, &TrainSettings { steps, ..TrainSettings::default() })?;
        let single: Vec<f32> = network.weights().iter().map(|x| *x as f32).collect();
        let poses: Vec<RigPose<f32>> = (0..256).map(|_| range.draw(&mut random)).collect();
        Ok(Self { network, micros: micros(&PoseNetwork::new(single)?, &poses) })
    }
}

/// Fig. 8.
pub(super) fn study(observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    observer(&Progress::Begin { what: "training a rig", done: 0, total: 1 });
    let began = Instant::now();
    let trained = Rigged::train(TrainSettings::default().steps)?;
    let secs = began.elapsed().as_secs_f64();
    observer(&Progress::End);
    let rig = Rig::<f64>::example();
    let mut random = Random::new(77);
    let poses: Vec<RigPose<f64>> = (0..POSES[1]).map(|_| PoseRange::default().draw(&mut random)).collect();
    let inside = |pose: &RigPose<f64>, angles: &Angles<f64>| {
        let distances = rig.distances(&rig.body(pose), &rig.joints(angles));
        let all = distances.as_flattened();
        all.iter().filter(|d| **d < 0.0).count() as f64 / all.len() as f64
    };
    let of = |angles: &dyn Fn(&RigPose<f64>) -> Angles<f64>| {
        let energy = |pose| rig.energy(&rig.body(pose), &angles(pose), &mut [0.0; ANGLES]);
        [mean(poses.iter().map(energy)), mean(poses.iter().map(|pose| inside(pose, &angles(pose))))]
    };
    let rigid = of(&|_| [0.0; ANGLES]);
    let ours = of(&|pose| trained.network.angles(pose));
    // From two starts, so that a local least does not count.
    let starts = |pose: &RigPose<f64>| [trained.network.angles(pose), [0.0; ANGLES]];
    let of_starts = |pose| starts(pose).map(|angles| least(&rig, pose, angles)).into_iter();
    let least = mean(poses.iter().map(|pose| of_starts(pose).fold(f64::INFINITY, f64::min)));
    let columns = ["", "energy over the least", "joints inside", "µs a pose", "paper, µs"];
    let mut table = Table::new("", &columns);
    let share = |energy: f64| percent((energy - least) / (rigid[0] - least));
    let row = |name: &str, [energy, inside]: [f64; 2], times: [&str; 2]| {
        vec![name.to_owned(), share(energy), percent(inside), times[0].to_owned(), times[1].to_owned()]
    };
    table.rows.push(row("rigid rig", rigid, ["–", "–"]));
    table.rows.push(row("network", ours, [&format!("{:.3}", trained.micros), "0.3 (a strand)"]));
    Ok(Study {
        title: "Neuralocks, Fig. 8: a tiny network for hair on a rig".to_owned(),
        claim: "the rigged variant runs in less than a microsecond, heeds gravity and avoids the body."
            .to_owned(),
        notes: vec![format!(
            "{WEIGHTS} weights, {MULTIPLY_ADDS} multiply–adds a pose, for 4 chains of 5 joints; trained \
             in {secs:.1} s. Energy is the mean over {} poses that were not trained, 100 % that of a rig \
             that does not bend. A joint counts as inside where it is nearer to the head, the neck or \
             the shoulders than its chain's radius. One thread.",
            POSES[1]
        )],
        tables: vec![table],
        ..Study::default()
    })
}
