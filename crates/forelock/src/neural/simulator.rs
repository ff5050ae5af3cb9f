//! The simulator of a trained model.

use std::sync::Arc;
use std::time::Instant;

use forelock_core::frame::{Acceleration, Air, FrameInput, FramePlan, FrameReport, Roots, Solver};
use forelock_core::groom::edit::Source;
use forelock_core::groom::{Groom, RootFrames};
use forelock_core::interaction::Interactions;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation, Teleport};
use forelock_core::simulator::{HostPositions, Positions, Simulator, SimulatorError};
use forelock_core::solver::PrescribedParams;
use forelock_core::solver::prescribed::TARGET;
use forelock_core::strands::{Between, Model, Snapshot};
use forelock_neural::features::{Features, PoseHistory, SHAPE_NUMBERS};
use forelock_neural::network::inference::Predictor;
use forelock_neural::network::packed::{PackedFrame, PackedStrands, Workspace};
use glam::Vec3;

use super::past::{self, rigid};
use super::{Learned, NeuralError, STAGE};
use crate::player::PlayerError;

/// A simulation whose strands go where a network says.
#[derive(Debug)]
pub(crate) struct NeuralSimulator {
    host: HostPositions,
    learned: Arc<Learned>,
    simd: Simd,
    predictor: Predictor,
    features: Features,
    strands: PackedStrands,
    workspace: Workspace,
    /// None until the next frame: then the head has always been where that begins.
    history: Option<PoseHistory>,
}

impl From<NeuralError> for SimulatorError {
    fn from(error: NeuralError) -> Self {
        Self::Device(Box::new(error))
    }
}

impl NeuralSimulator {
    /// The simulator of `groom` at rest under `solver`, which goes where it is told.
    pub(crate) fn new(
        groom: &Groom,
        solver: &Solver<f32>,
        learned: &Arc<Learned>,
        options: &Options,
    ) -> Result<Self, PlayerError> {
        learned.check_gravity(options.rest_gravity)?;
        // The network answers for all strands in every frame.
        let simulation = Simulation::new(groom, solver, &Options { sleep_speed: 0.0, ..*options })?;
        let simd = options.simd.resolve();
        let predictor = learned.predictor(simd)?;
        let inputs = learned.inputs(groom, simd)?;
        let strands = predictor.prepare_packed(simulation.model(), &inputs).map_err(NeuralError::from)?;
        Ok(Self {
            host: HostPositions::new(simulation),
            learned: Arc::clone(learned),
            simd,
            workspace: predictor.workspace(),
            features: learned.features()?,
            predictor,
            strands,
            history: None,
        })
    }

    /// The pose of the model's head joint, cm, with the head at `head`.
    fn joint(&self, head: &Pose) -> Pose {
        let translation = 100.0 * head.transform_point(self.learned.joint);
        Pose { rotation: head.rotation.normalize(), translation }
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
        let inputs = history.inputs(&self.features, &[0.0; SHAPE_NUMBERS]);
        let (model, state) = self.host.simulation_mut().parts_mut();
        let origin = head.transform_point(model.centre.into());
        let frame = PackedFrame {
            shared: &inputs[..self.learned.shared_inputs()],
            rest: &model.rest,
            pose: model.about_centre(head, origin),
        };
        let targets = state.extra.rows_mut();
        self.predictor.predict_packed(&self.strands, &frame, &mut self.workspace, targets);
        state.extra.set_started([true]);
    }
}

impl Simulator for NeuralSimulator {
    fn step(&mut self, frame: &FrameInput<'_>) -> Result<FrameReport, SimulatorError> {
        let Roots::Rigid(head) = frame.roots else { return Err(NeuralError::Bends.into()) };
        self.learned.check_gravity(frame.gravity)?;
        let poses = head.each_ref().map(|head| self.joint(head));
        Self::note(poses, frame.dt_secs, &mut self.history)?;
        let began = Instant::now();
        self.predict(&head[1]);
        // Stages report the time of all threads.
        let secs = began.elapsed().as_secs_f64() * rayon::current_num_threads() as f64;
        // Nothing that the network does not know acts on the strands.
        let frame = FrameInput { air: Air::default(), acceleration: Acceleration::None, ..*frame };
        let mut report = self.host.step(&frame)?;
        report.stages.add(STAGE, secs);
        Ok(report)
    }

    fn positions(&mut self) -> Result<Positions<'_>, SimulatorError> {
        self.host.positions()
    }

    fn read_positions(&mut self, out: &mut Vec<Vec3>) -> Result<(), SimulatorError> {
        self.host.read_positions(out)
    }

    fn read_positions_between(
        &mut self,
        moment: &Between,
        out: &mut Vec<Vec3>,
    ) -> Result<(), SimulatorError> {
        self.host.read_positions_between(moment, out)
    }

    /// The targets of the last frame are no part of it: the next frame has its own.
    fn snapshot(&mut self) -> Result<Snapshot<f32>, SimulatorError> {
        let mut snapshot = self.host.snapshot()?;
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
        self.host.restore(&own)?;
        self.history = history;
        Ok(())
    }

    /// The history is that of a head that has always been at `to`, or in
    /// [`Teleport::CarryShapeAndVelocity`] that of one that has moved there as it did here.
    fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) -> Result<(), SimulatorError> {
        self.host.teleport(from, to, mode)?;
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

    fn rest_on(&mut self, _: &Pose, _: &RootFrames) -> Result<(), SimulatorError> {
        Err(NeuralError::Bends.into())
    }

    fn forget_solids(&mut self) -> Result<(), SimulatorError> {
        self.host.forget_solids()
    }

    fn set_params(&mut self, solver: &Solver<f32>) -> Result<(), SimulatorError> {
        match solver.params::<PrescribedParams>() {
            Some(_) => self.host.set_params(solver),
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
        self.host.regroom(groom, sources, head)?;
        let strands = self.predictor.prepare_packed(self.host.model(), &inputs);
        self.strands = strands.map_err(NeuralError::from)?;
        Ok(())
    }

    fn plan(&self) -> &FramePlan {
        self.host.plan()
    }

    fn model(&self) -> &Model<f32> {
        self.host.model()
    }

    fn bytes(&self) -> u64 {
        self.host.bytes() + self.strands.bytes() as u64
    }
}
