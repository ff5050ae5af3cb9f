//! Training of the network with the energies alone (Neuralocks, Sec. 4.4): no simulated data.
//!
//! # Theory
//! A step draws windows of consecutive frames and strands for each, and predicts every strand in
//! every frame. In the first part of the training it lowers the strands' energy without inertia and
//! drag: the network learns the drape. From then on it lowers the residual of the equation of
//! motion (`train/window.rs`), with gradients through all frames of a window.
//!
//! With repulsion or adhesion the strands of a window are neighbours on the head, and act on each
//! other in each frame.
//!
//! Where strands do not act on each other, long ones are drawn more often than short ones, and
//! count for less (`train/chances.rs`). The result is a running average of the network over some
//! hundred steps. Units that no longer react to any input get new weights now and then
//! (`train/dormant.rs`).
//!
//! # Practice
//! Everything is ours, so that the energies run in lanes as text that the reference results check.
//! On one machine the result depends on the seed and the instruction set, not on the number of
//! threads: a step is eight packets of 64 strands, and each sum has its own order. A step of 512
//! strands in four frames takes some hundredths of a second.
//!
//! # Limitations
//! Training runs on the CPU. The residual is what the network cannot express, weighted by the
//! strands' compliance: it tells progress, not quality. Measures against the
//! [reference](crate::reference) do.

pub(crate) mod adam;
mod axes;
mod between;
mod chances;
mod checkpoint;
mod compliance;
mod dormant;
mod drapes;
pub(crate) mod gradient;
pub(crate) mod layers;
pub mod motions;
pub(crate) mod set;
mod soap;
pub(crate) mod window;

pub use checkpoint::{CheckpointError, Resumed};
pub use drapes::WINDOWS as DRAPED;
pub use set::{Bust, Clip, Frame, SetError, TrainingSet, TrainingStrand, clip, shared};
pub use window::Objective;

use crate::features::{POSE_NUMBERS, SHAPE_NUMBERS};
use crate::losses::adhesion::AdhesionTerms;
use crate::losses::body::BodyTerms;
use crate::losses::elastic::ElasticTerms;
use crate::losses::motion::MotionTerms;
use crate::losses::repulsion::RepulsionTerms;
use crate::losses::style::StyleTerms;
use crate::network::head::OutputHead;
use crate::network::rotation::{Basis, basis};
use crate::network::{LOCK_INPUTS, Network, Shape};
use crate::random::Random;
use crate::reference::Terms;
use axes::CHANGE_EVERY;
use forelock_core::lane::Simd;
use gradient::{Batch, Workspace, frame_inputs};
use soap::Soap;
use window::Goal;

/// Windows of a step.
pub const FRAMES: usize = 16;
/// Consecutive frames of a window.
pub const MOMENTS: usize = 4;
/// Strands of a window.
pub const STRANDS: usize = 32;
/// Steps over which the learning rate rises from 0, at most a tenth of all. The descent does not
/// know its axes and mean squares then; large steps leave many units that react to no input.
const RISE: u32 = 300;
/// A norm of the gradient whose square could exceed the range of float32.
const OVERFLOW: f64 = 1e15;
/// What the running average keeps of itself in a step.
const AVERAGE: f64 = 0.998;

/// Coefficients of the energies that training lowers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// Stretch and bend–twist. The rotation head does not stretch.
    pub elastic: ElasticTerms,
    /// Gravity, inertia, drag.
    pub motion: MotionTerms,
    /// Collision with the body.
    pub body: BodyTerms,
    /// Style; none by default.
    pub style: Option<StyleTerms>,
    /// Repulsion of neighbouring strands; none by default.
    pub repulsion: Option<RepulsionTerms>,
    /// Adhesion of neighbouring strands; none by default.
    pub adhesion: Option<AdhesionTerms>,
    /// Whether adhesion is the paper's, which pulls neighbours together ([`Adhesion::printed`]).
    ///
    /// [`Adhesion::printed`]: crate::losses::adhesion::Adhesion::printed
    pub prints_adhesion: bool,
}

impl Energies {
    /// Those of the [reference](crate::reference): style, repulsion and adhesion have no part in
    /// it.
    pub fn terms(&self) -> Terms {
        Terms { elastic: self.elastic, motion: self.motion, body: self.body }
    }

    /// Whether strands act on each other.
    pub fn have_neighbours(&self) -> bool {
        self.repulsion.is_some() || self.adhesion.is_some()
    }
}

/// How to train.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Steps.
    pub steps: u32,
    /// Learning rate at the start. [`Trainer`] rises to it from 0 over at most 300 steps.
    pub rate: f64,
    /// The learning rate in the end, over that at the start.
    pub last_rate: f64,
    /// Largest norm of a step's gradient.
    pub largest_gradient: f64,
    /// Share of the steps without inertia and drag.
    pub warm_start: f64,
    /// Coefficients of the energies. Without inertia and drag the network has no history
    /// (quasi-static).
    pub energies: Energies,
    /// Added to the distance at which the body begins to push, cm, so that the network's errors
    /// leave less hair inside the body. References and computed drapes do not have it.
    pub extra_margin: f64,
    /// What motions are trained towards.
    pub objective: Objective,
    /// What the network's outputs are.
    pub head: OutputHead,
    /// Whether the network sees the mean code of a strand's lock. Without, its weights are 0.
    pub lock_codes: bool,
    /// The instruction set. The result depends on it.
    pub simd: Simd,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            seed: 1,
            steps: 21_000,
            rate: 2e-3,
            last_rate: 0.02,
            largest_gradient: 1.0,
            warm_start: 0.03,
            energies: Energies::default(),
            extra_margin: 0.02,
            objective: Objective::default(),
            head: OutputHead::default(),
            lock_codes: true,
            simd: Simd::Auto,
        }
    }
}

impl Options {
    /// The sizes of the network: a quasi-static one sees no history.
    pub fn shape(&self) -> Shape {
        let shape = Shape::default();
        if self.energies.motion.is_dynamic {
            shape
        } else {
            Shape { shared: POSE_NUMBERS + SHAPE_NUMBERS, ..shape }
        }
    }

    /// The share of the steps that is done after `done`.
    fn share(&self, done: u32) -> f64 {
        f64::from(done) / f64::from(self.steps.max(1))
    }

    /// The energies of the step after `done`, with the extra margin; without inertia and drag at
    /// first.
    pub(crate) fn energies_at(&self, done: u32) -> Energies {
        let mut energies = self.energies;
        energies.body.margin += self.extra_margin;
        energies.motion.is_dynamic &= self.share(done) >= self.warm_start;
        energies
    }

    /// The part of the learning rate that the step after `done` uses, while it rises.
    fn rise_at(&self, done: u32) -> f64 {
        (f64::from(done + 1) / f64::from(RISE.min(self.steps / 10).max(1))).min(1.0)
    }

    /// The learning rate of the step after `done`, once it has risen.
    pub(crate) fn rate_at(&self, done: u32) -> f64 {
        let cosine = 0.5 + 0.5 * (std::f64::consts::PI * self.share(done).min(1.0)).cos();
        self.rate * (self.last_rate + (1.0 - self.last_rate) * cosine)
    }
}

/// Moves the running `average` towards `parameters`, after `done` steps, once every `every` steps.
pub(crate) fn average(average: &mut [f32], parameters: &[f32], done: u32, every: u32) {
    // Short at first, so that the random start is forgotten.
    let start = f64::from(done) / f64::from(done + 10 * every);
    let keep = AVERAGE.powi(every as i32).min(start) as f32;
    for (mean, now) in average.iter_mut().zip(parameters) {
        *mean = keep * *mean + (1.0 - keep) * now;
    }
}

/// A training.
#[derive(Debug)]
pub struct Trainer {
    options: Options,
    basis: Basis,
    network: Network<f32>,
    average: Network<f32>,
    descent: Soap,
    done: u32,
    workspace: Workspace,
}

/// What a step reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport {
    /// Mean energy of a strand, g cm² s⁻²: of the drape, then the residual's.
    pub energy: f64,
    /// Norm of the gradient, before it was limited.
    pub gradient: f64,
    /// The learning rate.
    pub rate: f64,
}

/// A step whose energy or gradient is not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("step {step}: the energy or its gradient is not finite; lower the learning rate or the stiffnesses")]
pub struct NotFinite {
    /// Steps done before.
    pub step: u32,
}

impl Trainer {
    /// A training from random weights, with deviations √(2/inputs), those of the last layer 1e-3.
    ///
    /// # Panics
    /// If this processor does not support `options.simd`.
    pub fn new(mut options: Options) -> Self {
        options.simd = options.simd.resolve();
        assert!(options.simd.is_supported(), "{:?} is not supported by this processor", options.simd);
        let shape = options.shape();
        let mut random = Random::stream(options.seed, 0);
        let mut parameters = vec![0.0f32; shape.parameters()];
        let [statics, shared, _, hidden, _, output, _] = shape.ranges();
        let [first, second] = shape.deviations();
        for (range, deviation) in [(statics, first), (shared, first), (hidden, second), (output, 1e-3)] {
            for weight in &mut parameters[range] {
                *weight = (deviation * random.normal()) as f32;
            }
        }
        if !options.lock_codes {
            // They stay 0, for the inputs of a prepared set are 0 too.
            parameters[shape.ranges()[0].clone()][LOCK_INPUTS.start * shape.width..].fill(0.0);
        }
        let motion = options.energies.motion;
        Self {
            basis: basis(options.energies.elastic.bend_twist, motion.mass, motion.dt_secs),
            descent: Soap::new(&shape),
            average: Network::of(shape, parameters.clone()),
            network: Network::of(shape, parameters),
            done: 0,
            workspace: Workspace::new(shape),
            options,
        }
    }

    /// How it trains.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The result: the running average of the network, which follows it every ten steps.
    pub fn average(&self) -> &Network<f32> {
        &self.average
    }

    /// B of the rotation head.
    pub fn basis(&self) -> &Basis {
        &self.basis
    }

    /// Steps done.
    pub fn done(&self) -> u32 {
        self.done
    }

    /// Prepares `set` for this training: neighbouring strands are found once, and inputs that the
    /// network does not see are set to 0. For [`Objective::Drapes`] the drapes are computed: a
    /// minute or so.
    pub fn prepare(&self, set: &mut TrainingSet) {
        set.prepare(&self.options.energies);
        if !self.options.lock_codes {
            set.hide_lock_codes();
        }
        if self.options.objective == Objective::Drapes {
            set.drape(&self.options.energies, self.options.seed, DRAPED);
        }
    }

    /// A step, on a set that was [prepared](Self::prepare).
    ///
    /// # Errors
    /// If the energy or its gradient is not finite: nothing is changed then.
    pub fn step(&mut self, set: &TrainingSet) -> Result<StepReport, NotFinite> {
        let options = &self.options;
        let energies = options.energies_at(self.done);
        let mut random = Random::stream(options.seed, 1 + u64::from(self.done));
        let drawn = set.draw(&mut random, energies.have_neighbours());
        let simd = options.simd;
        let shape = *self.network.shape();
        let inputs = frame_inputs(set, &drawn, shape.shared);
        let frames = self.descent.frames(simd, self.network.parameters(), inputs);
        let batch = Batch { set, drawn: &drawn, frames: &frames };
        let goal = Goal { energies, objective: options.objective, head: options.head };
        let energy = self.workspace.gradient(simd, &self.network, &self.basis, &goal, &batch);
        let norm = self.workspace.norm();
        if !(energy.is_finite() && norm < OVERFLOW) {
            return Err(NotFinite { step: self.done });
        }
        let rate = options.rate_at(self.done) * options.rise_at(self.done);
        let scale = (options.largest_gradient / norm.max(1e-30)).min(1.0);
        let parameters = self.network.parameters_mut();
        self.descent.step(simd, parameters, self.workspace.found(), &frames, [rate, scale]);
        self.done += 1;
        let is_last = self.done == options.steps;
        if is_last {
            self.descent.settle(simd, parameters);
        }
        if is_last || self.descent.is_settled() {
            average(self.average.parameters_mut(), parameters, self.done, CHANGE_EVERY);
        }
        if dormant::is_due(self.done, options.share(self.done)) {
            let networks = [parameters, self.average.parameters_mut()];
            let mut random = Random::stream(options.seed, u64::MAX - u64::from(self.done));
            dormant::reuse(&shape, networks, self.descent.second_mut(), &mut random);
        }
        Ok(StepReport { energy, gradient: norm, rate })
    }
}

#[cfg(test)]
pub(crate) mod tests;
