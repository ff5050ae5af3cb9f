//! The simulator of a trained model.

use std::sync::Arc;
use std::time::Instant;

use forelock_core::frame::{Acceleration, Air, FrameInput, FramePlan, FrameReport, Solver};
use forelock_core::groom::edit::Source;
use forelock_core::groom::{Groom, RootFrames};
use forelock_core::interaction::Interactions;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Teleport};
use forelock_core::simulator::{Positions, Simulator, SimulatorError};
use forelock_core::solver::PrescribedParams;
use forelock_core::solver::prescribed::TARGET;
use forelock_core::strands::{Between, Model, Snapshot};
use forelock_neural::features::{Features, PoseHistory};
use forelock_neural::network::inference::Predictor;
use glam::Vec3;

use super::host::{Host, Learnt, OnGpu};
use super::past::{self, rigid};
use super::{Learned, NeuralError, STAGE};
use crate::player::PlayerError;

/// A simulation whose strands go where a network says.
#[derive(Debug)]
pub(crate) struct NeuralSimulator {
    host: Host,
    learned: Arc<Learned>,
    simd: Simd,
    predictor: Predictor,
    features: Features,
    /// None until the next frame: then the head has always been where that begins.
    history: Option<PoseHistory>,
}

impl From<NeuralError> for SimulatorError {
    fn from(error: NeuralError) -> Self {
        Self::Device(Box::new(error))
    }
}

impl NeuralSimulator {
    /// The simulator of `groom` under `solver`, which goes where it is told, as it hangs on a head
    /// at rest; on the CPU, or `on` a GPU.
    pub(crate) fn new(
        groom: &Groom,
        solver: &Solver<f32>,
        learned: &Arc<Learned>,
        options: &Options,
        on: Option<OnGpu<'_>>,
    ) -> Result<Self, PlayerError> {
        learned.check_gravity(options.rest_gravity)?;
        let simd = options.simd.resolve();
        let (predictor, features) = (learned.predictor(simd)?, learned.features()?);
        let inputs = learned.inputs(groom, simd)?;
        let still =
            PoseHistory::still(rigid(learned.joint(&options.rest_pose))).map_err(NeuralError::from)?;
        let shared = learned.shared(&still, &features);
        // The network answers for all strands in every frame.
        let options = Options { sleep_speed: 0.0, ..*options };
        let learnt = Learnt { predictor: &predictor, inputs: &inputs, halved: learned.halved };
        let host = Host::new(groom, solver, &options, learnt, &shared, on)?;
        Ok(Self { host, learned: Arc::clone(learned), simd, features, predictor, history: None })
    }

    /// Notes that the head moves through `poses` in a frame of `dt_secs`.
    fn note(
        [from, to]: [Pose; 2],
        dt_secs: f64,
        history: &mut Option<PoseHistory>,
    ) -> Result<(), NeuralError> {
        match history {
            Some(history) => history.push(rigid(to), dt_secs)?,
            None => {
                let mut own = PoseHistory::still(rigid(from))?;
                own.push(rigid(to), dt_secs)?;
                *history = Some(own);
            }
        }
        Ok(())
    }

    /// Tells the strands where to go, with the head at `head` at the frame's end.
    fn predict(&mut self, head: &Pose) {
        let Some(history) = &self.history else { return };
        let shared = self.learned.shared(history, &self.features);
        self.host.predict(&self.predictor, &shared, head);
    }
}

impl Simulator for NeuralSimulator {
    fn step(&mut self, frame: &FrameInput<'_>) -> Result<FrameReport, SimulatorError> {
        let head = *frame.roots.head();
        self.learned.check_gravity(frame.gravity)?;
        let poses = head.each_ref().map(|head| self.learned.joint(head));
        Self::note(poses, frame.dt_secs, &mut self.history)?;
        let began = Instant::now();
        self.predict(&head[1]);
        // Stages report the time of all threads.
        let secs = began.elapsed().as_secs_f64() * rayon::current_num_threads() as f64;
        // Nothing that the network does not know acts on the strands.
        let frame = FrameInput { air: Air::default(), acceleration: Acceleration::None, ..*frame };
        let mut report = self.host.simulator().step(&frame)?;
        // A device has the time of its own kernels.
        if self.host.as_simulator().device().is_none() {
            report.stages.add(STAGE, secs);
        }
        Ok(report)
    }

    fn positions(&mut self) -> Result<Positions<'_>, SimulatorError> {
        self.host.simulator().positions()
    }

    fn read_positions(&mut self, out: &mut Vec<Vec3>) -> Result<(), SimulatorError> {
        self.host.simulator().read_positions(out)
    }

    fn read_positions_between(
        &mut self,
        moment: &Between,
        out: &mut Vec<Vec3>,
    ) -> Result<(), SimulatorError> {
        self.host.simulator().read_positions_between(moment, out)
    }

    /// The targets of the last frame are no part of it: the next frame has its own.
    fn snapshot(&mut self) -> Result<Snapshot<f32>, SimulatorError> {
        let mut snapshot = self.host.simulator().snapshot()?;
        snapshot.extra.remove(TARGET.name);
        if let Some(history) = &self.history {
            snapshot.extra.insert(past::NAME.to_owned(), past::encode(history));
        }
        Ok(snapshot)
    }

    /// After a snapshot without a history the head has always been where the next frame begins.
    fn restore(&mut self, snapshot: &Snapshot<f32>) -> Result<(), SimulatorError> {
        let history = match snapshot.extra.get(past::NAME) {
            None => None,
            Some(array) => Some(past::decode(array).ok_or_else(|| past::unfit(array))?),
        };
        let mut own = snapshot.clone();
        own.extra.insert(TARGET.name.to_owned(), Vec::new());
        self.host.simulator().restore(&own)?;
        self.history = history;
        Ok(())
    }

    /// The history is that of a head that has always been at `to`, or in
    /// [`Teleport::CarryShapeAndVelocity`] that of one that has moved there as it did here.
    fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) -> Result<(), SimulatorError> {
        self.host.simulator().teleport(from, to, mode)?;
        let history = self.history.take().filter(|_| mode == Teleport::CarryShapeAndVelocity);
        let jump = to.after(&from.inverse());
        let jump = Pose { translation: 100.0 * jump.translation, ..jump };
        let samples = history.map(|history| {
            let samples = history.samples().iter();
            samples.map(|(age, body)| (*age, rigid(jump.after(&body.head)))).collect()
        });
        self.history = samples.map(PoseHistory::from_samples).transpose().map_err(NeuralError::from)?;
        Ok(())
    }

    /// Strands hang as predicted before the first frame; their roots follow the skin in the next.
    fn rest_on(&mut self, _: &Pose, _: &RootFrames) -> Result<(), SimulatorError> {
        Ok(())
    }

    fn forget_solids(&mut self) -> Result<(), SimulatorError> {
        self.host.simulator().forget_solids()
    }

    fn set_params(&mut self, solver: &Solver<f32>) -> Result<(), SimulatorError> {
        match solver.params::<PrescribedParams>() {
            Some(_) => self.host.simulator().set_params(solver),
            None => Err(NeuralError::Replaced.into()),
        }
    }

    /// The strands never sleep.
    fn set_sleep_speed(&mut self, _: f64) {}

    /// Strands do not interact.
    fn set_interactions(&mut self, _: &Interactions) -> Result<(), SimulatorError> {
        Ok(())
    }

    fn regroom(&mut self, groom: &Groom, sources: &[Source], head: &Pose) -> Result<(), SimulatorError> {
        let inputs = self.learned.inputs(groom, self.simd)?;
        self.host.simulator().regroom(groom, sources, head)?;
        let learnt = Learnt { predictor: &self.predictor, inputs: &inputs, halved: self.learned.halved };
        self.host.prepare(learnt)
    }

    fn plan(&self) -> &FramePlan {
        self.host.as_simulator().plan()
    }

    fn model(&self) -> &Model<f32> {
        self.host.as_simulator().model()
    }

    fn device(&self) -> Option<&str> {
        self.host.as_simulator().device()
    }

    fn bytes(&self) -> u64 {
        self.host.bytes()
    }
}
