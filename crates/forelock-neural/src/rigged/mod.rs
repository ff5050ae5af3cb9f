//! The rigged variant: a tiny network that turns the joints of a few chains, to which the hair is
//! bound.
//!
//! # Theory
//! Where hair moves as a few masses, such as braids and ponytails, a rig of 4 chains × 5 joints
//! stands for it, and a network of 1,452 numbers gives the joints' angles from the pose of the head
//! alone (Neuralocks, section on rigged hair). In the head's axes, with the angles θ as rotation
//! vectors, R₋₁ = 1 and the bones b,
//!
//! ```text
//! R_j = R_{j−1} exp(θ_j),   x_{j+1} = x_j + R_j b_j
//! E = −Σ m g·x + 0.05 k_b|θ|² + k_c Σ max(D − d + r, 0)³
//! ```
//!
//! d is the least distance to the head (an ellipsoid), the neck and the shoulders (capsules), r the
//! chain's radius. Training minimises the mean of E over poses; there is no data to fit.
//!
//! # Practice
//! The gradient is written by hand: the torque τ_j of all forces beyond joint j about that joint
//! gives ∂E/∂θ_j = J_r(θ_j)ᵀ R_jᵀ τ_j with the right Jacobian J_r of the exponential. A pose takes
//! 1,360 multiply–adds ([`MULTIPLY_ADDS`]).
//!
//! # Limitations
//! The variant is quasi-static, and chains do not see each other. Inside the head's centre, where
//! the distance has no gradient, nothing pushes out.
//!
//! ```
//! use forelock_neural::random::Random;
//! use forelock_neural::rigged::{PoseRange, Rig, TrainSettings, train};
//!
//! let rig: Rig<f32> = Rig::example();
//! let mut random = Random::new(1);
//! let poses: Vec<_> = (0..256).map(|_| PoseRange::default().draw(&mut random)).collect();
//! let network = train(&rig, &poses, &TrainSettings { steps: 20, ..Default::default() })?;
//! let angles = network.angles(&poses[0]);
//! let ends = rig.joints(&angles);
//! assert_eq!((ends.len(), ends[0].len()), (4, 5));
//! # Ok::<(), forelock_neural::rigged::RigError>(())
//! ```

mod chain;
mod network;
mod pose;
mod predictor;
mod train;
mod vec3;

pub use chain::{Angles, Body, Capsule, Chain, Ends, Rig, RigWeights, Torso};
pub use network::{MULTIPLY_ADDS, PoseNetwork, WEIGHTS};
pub use pose::{PoseRange, RigPose};
pub use predictor::PosePredictor;
pub use train::{TrainSettings, train};

/// Chains of a rig.
pub const CHAINS: usize = 4;
/// Joints of a chain.
pub const JOINTS: usize = 5;
/// Angles of a rig: a rotation vector a joint.
pub const ANGLES: usize = 3 * CHAINS * JOINTS;
/// Inputs of the network.
pub const INPUTS: usize = 9;

/// Why a rig, a network or a training run is not possible.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RigError {
    /// A length of the rig is not as it must be.
    #[error("the rig's {0} must be finite, and radii and half axes positive")]
    Rig(&'static str),
    /// A network has the wrong number of weights, or one is not finite.
    #[error("{0} weights were given: the network takes 1452 finite ones")]
    Weights(usize),
    /// There are no poses to train with.
    #[error("there are no poses to train with")]
    NoPoses,
    /// A pose is not finite.
    #[error("pose {0} is not finite")]
    Pose(usize),
    /// A setting of the training is out of range.
    #[error("the setting `{0}` of the training must be positive and finite")]
    Setting(&'static str),
    /// The training diverged.
    #[error("the weights are not finite after step {0}: lower the learning rate")]
    Diverged(u32),
}
