//! Where the strands of a learned simulator are: on the CPU or on a GPU.

use forelock_core::body::ColliderFrame;
use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::simulator::{HostPositions, Simulator, SimulatorError};
use forelock_core::solver::Solver;
use forelock_core::strands::Model;
use forelock_gpu::network::BlendEntry;
use forelock_gpu::{Gpu, GpuError, GpuSimulation, StrandNetwork};
use forelock_neural::model::OutputHead;
use forelock_neural::network::inference::Predictor;
use forelock_neural::network::packed::{PackedFrame, PackedStrands, Workspace};

use super::NeuralError;
use crate::player::PlayerError;

/// A GPU to run on, and how.
#[derive(Clone, Copy)]
pub(crate) struct OnGpu<'a> {
    pub gpu: &'a Gpu,
    /// The colliders of the first frame.
    pub solids: &'a [ColliderFrame<'a>],
}

/// The strands and the network where they are.
#[derive(Debug)]
pub(super) enum Host {
    Cpu(Box<CpuHost>),
    Gpu(Box<GpuSimulation>),
}

/// Those of the CPU.
#[derive(Debug)]
pub(super) struct CpuHost {
    simulation: HostPositions,
    strands: PackedStrands,
    workspace: Workspace,
}

/// What a host needs of the network.
#[derive(Clone, Copy)]
pub(super) struct Learnt<'a> {
    pub predictor: &'a Predictor,
    /// Static inputs of the strands in the groom's order.
    pub inputs: &'a [f32],
    /// Whether a GPU stores weights in 16 bits.
    pub halved: bool,
}

impl Host {
    /// The strands of `groom` at the rest that the network predicts from `shared`, the inputs of a
    /// head that has always been at `options.rest_pose`.
    pub fn new(
        groom: &Groom,
        solver: &Solver<f32>,
        options: &Options,
        learnt: Learnt<'_>,
        shared: &[f32],
        on: Option<OnGpu<'_>>,
    ) -> Result<Self, PlayerError> {
        let mut simulation = Simulation::new(groom, solver, options)?;
        let prepared = learnt.predictor.prepare_packed(simulation.model(), learnt.inputs);
        let strands = prepared.map_err(NeuralError::from)?;
        let mut workspace = learnt.predictor.workspace();
        let (model, state) = simulation.parts_mut();
        let pose = model.about_centre(&options.rest_pose, state.origin);
        let mut rows = state.positions.clone();
        let frame = PackedFrame { shared, rest: &model.rest, pose };
        learnt.predictor.predict_packed(&strands, &frame, &mut workspace, &mut rows);
        if rows.iter().flat_map(|row| row.0).all(f32::is_finite) {
            state.positions = rows;
        }
        let Some(OnGpu { gpu, solids }) = on else {
            let simulation = HostPositions::new(simulation);
            return Ok(Self::Cpu(Box::new(CpuHost { simulation, strands, workspace })));
        };
        let mut simulation = Box::new(GpuSimulation::continuing(gpu, &simulation)?);
        give_network(&mut simulation, &strands, learnt)?;
        simulation.hold(solids)?;
        simulation.time_stages(true);
        Ok(Self::Gpu(simulation))
    }

    /// The strands as a simulator.
    pub fn simulator(&mut self) -> &mut dyn Simulator {
        match self {
            Self::Cpu(own) => &mut own.simulation,
            Self::Gpu(simulation) => &mut **simulation,
        }
    }

    /// The same, to look at.
    pub fn as_simulator(&self) -> &dyn Simulator {
        match self {
            Self::Cpu(own) => &own.simulation,
            Self::Gpu(simulation) => &**simulation,
        }
    }

    /// Tells the strands where to be at the end of the next frame, with the inputs `shared` and the
    /// head at `head` then.
    pub fn predict(&mut self, predictor: &Predictor, shared: &[f32], head: &Pose) {
        let pose = |model: &Model<f32>| {
            let origin = head.transform_point(model.centre.into());
            model.about_centre(head, origin)
        };
        match self {
            Self::Cpu(own) => {
                let CpuHost { simulation, strands, workspace } = &mut **own;
                let (model, state) = simulation.simulation_mut().parts_mut();
                let frame = PackedFrame { shared, rest: &model.rest, pose: pose(model) };
                predictor.predict_packed(strands, &frame, workspace, state.extra.rows_mut());
                state.extra.set_started([true]);
            }
            Self::Gpu(simulation) => {
                let pose = pose(simulation.model());
                simulation.predict(&predictor.shared_sums(shared), &pose);
            }
        }
    }

    /// Prepares the network for the strands after an edit, of which `learnt` has the inputs.
    pub fn prepare(&mut self, learnt: Learnt<'_>) -> Result<(), SimulatorError> {
        let prepared = learnt.predictor.prepare_packed(self.as_simulator().model(), learnt.inputs);
        let prepared = prepared.map_err(NeuralError::from)?;
        match self {
            Self::Cpu(own) => own.strands = prepared,
            Self::Gpu(simulation) => give_network(simulation, &prepared, learnt)?,
        }
        Ok(())
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let strands = if let Self::Cpu(own) = self { own.strands.bytes() as u64 } else { 0 };
        self.as_simulator().bytes() + strands
    }
}

/// Uploads the network and what it knows of `strands`.
fn give_network(
    simulation: &mut GpuSimulation,
    strands: &PackedStrands,
    learnt: Learnt<'_>,
) -> Result<(), GpuError> {
    let [.., hidden, hidden_bias, output, output_bias] = learnt.predictor.network().parts();
    let blends = strands.blends().map(|blend| BlendEntry {
        first: blend.first,
        count: blend.count,
        weights: blend.weights,
    });
    let network = StrandNetwork {
        hidden,
        hidden_bias,
        output,
        output_bias,
        displaces: learnt.predictor.head() == OutputHead::Displacement,
        sums: strands.sums(),
        blend_starts: &strands.blend_starts().collect::<Vec<_>>(),
        blends: &blends.collect::<Vec<_>>(),
        blend_weights: strands.blend_weights(),
    };
    simulation.set_network(&network, learnt.halved)
}
