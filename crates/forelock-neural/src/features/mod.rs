//! What the network sees of the body: pose, shape and the last 27 velocities of four joints.
//!
//! # Theory
//! Strands live in the axes of the head, so all inputs are in those axes too (Neuralocks, section
//! on the pose history): with R_j, P_j the orientation and position of joint j, R_h those of the
//! head and o the origin of canonical space in the head's axes,
//!
//! | numbers | what |
//! | --- | --- |
//! | 24 of the pose | first and second column of R_hᵀR_j for root, spine, neck; R_hᵀ(0, −1, 0); R_hᵀω_h/3 |
//! | 10 of the shape | coefficients of the body's shape |
//! | 27 × 24 of the motion | newest first, 1/30 s apart: R_hᵀω_j/3, R_hᵀv_j/100 for root, spine, neck, head |
//!
//! v_j is the backward difference of P_j (for the head, of P_h + R_h o) in cm/s, ω_j the rotation
//! vector of R_j(t)R_j(t − Δt)ᵀ over Δt in 1/s, and R_h that of the velocity's own frame. Moving
//! the world, or turning it about the vertical, changes none of these numbers.
//!
//! # Practice
//! [`Features::motion`] serves training, where a whole motion is known: its first frame takes the
//! rates of the second, and frames before the first repeat it. [`PoseHistory`] serves a running
//! simulation, where frames arrive one by one, at any rate: the body is still before the first.
//!
//! # Limitations
//! A rotation of more than half a turn between two frames is taken for one along the shorter arc.

mod history;

pub use history::PoseHistory;

use forelock_core::pose::Pose;
use glam::{DMat3, DVec3};

/// Time between two entries of the history, in seconds.
pub const SPACING_SECS: f64 = 1.0 / 30.0;
/// Entries of the history.
pub const HISTORY: usize = 27;
/// Numbers of a pose.
pub const POSE_NUMBERS: usize = 24;
/// Numbers of an entry of the history.
pub const VELOCITY_NUMBERS: usize = 24;
/// Numbers of the body's shape.
pub const SHAPE_NUMBERS: usize = 10;
/// Numbers that all strands of a head share: pose, shape, history.
pub const SHARED_NUMBERS: usize = POSE_NUMBERS + SHAPE_NUMBERS + HISTORY * VELOCITY_NUMBERS;

/// The angular velocity in 1/s that becomes 1.
pub(crate) const ANGULAR_SCALE: f64 = 3.0;
/// The velocity in cm/s that becomes 1.
pub(crate) const VELOCITY_SCALE: f64 = 100.0;
/// The acceleration of gravity in cm/s², the specific force that becomes 1.
pub(crate) const GRAVITY: f64 = 981.0;
/// Joints: root, spine, neck, head.
pub(crate) const JOINTS: usize = 4;
/// The head's number among the joints.
const HEAD: usize = 3;

/// Why there are no features.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FeatureError {
    /// A motion has no frames.
    #[error("the motion has no frames: give at least one pose of the body")]
    Empty,
    /// A joint's pose is not rigid.
    #[error("frame {frame}: the pose of the {joint} is not a finite position and a unit quaternion")]
    Pose {
        /// Number of the frame; 0 for a single one.
        frame: usize,
        /// Name of the joint.
        joint: &'static str,
    },
    /// The origin of canonical space is not finite.
    #[error("the origin of canonical space in the head's axes is not finite")]
    Origin,
    /// A time is not positive and finite.
    #[error("the time between frames is {0} s: it must be positive and finite")]
    Time(f64),
    /// A motion has too many frames once resampled.
    #[error("the motion would have {0} frames at the new spacing, more than 2³² − 1")]
    TooMany(f64),
}

/// How the motion of the head's origin enters the history.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HeadMotion {
    /// Its velocity: R_hᵀv/100, the paper's form.
    #[default]
    Velocity,
    /// The specific force R_hᵀ(g − a)/981 with the acceleration a, the difference of v over Δt, and
    /// g = (0, −981, 0) cm/s². It does not change when the world moves at constant velocity.
    SpecificForce,
}

/// The poses of a body's joints at one instant: orientations, and positions in **cm**, in the
/// world, whose y axis points up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyPose {
    /// The root of the skeleton, at the hips.
    pub root: Pose,
    /// The spine, at the chest.
    pub spine: Pose,
    /// The neck.
    pub neck: Pose,
    /// The head.
    pub head: Pose,
}

impl BodyPose {
    /// The joints from the root to the head.
    pub fn joints(&self) -> [Pose; JOINTS] {
        [self.root, self.spine, self.neck, self.head]
    }

    /// The pose at `fraction` of the way from `self` to `to`: positions linearly, orientations
    /// along the shorter arc. Equal poses give the same pose exactly.
    pub fn interpolate(&self, to: &Self, fraction: f64) -> Self {
        if self == to {
            return *self;
        }
        let between =
            |from: &Pose, to: &Pose| if from == to { *from } else { from.interpolate(to, fraction) };
        Self {
            root: between(&self.root, &to.root),
            spine: between(&self.spine, &to.spine),
            neck: between(&self.neck, &to.neck),
            head: between(&self.head, &to.head),
        }
    }

    fn check(&self, frame: usize) -> Result<(), FeatureError> {
        for (pose, joint) in self.joints().iter().zip(["root", "spine", "neck", "head"]) {
            if !pose.is_finite() || (pose.rotation.length_squared() - 1.0).abs() > 1e-6 {
                return Err(FeatureError::Pose { frame, joint });
            }
        }
        Ok(())
    }
}

/// Resamples a motion whose frames are `dt` seconds apart to frames [`SPACING_SECS`] apart, from
/// its first frame to the last that it covers. Frames that coincide are taken over as they are.
///
/// # Errors
/// If there are no frames, a pose is not rigid, `dt` is not positive and finite, or the result has
/// more than 2³² − 1 frames.
pub fn resample(poses: &[BodyPose], dt: f64) -> Result<Vec<BodyPose>, FeatureError> {
    check_motion(poses)?;
    check_time(dt)?;
    // The allowance keeps the last frame where rounding puts it just outside.
    let last = ((poses.len() - 1) as f64 * dt / SPACING_SECS + 1e-9).floor();
    if last >= f64::from(u32::MAX) {
        return Err(FeatureError::TooMany(last + 1.0));
    }
    let at = |frame: u32| {
        let place = f64::from(frame) * SPACING_SECS / dt;
        let nearest = place.round();
        let (index, fraction) = if (place - nearest).abs() < 1e-9 {
            (nearest as usize, 0.0)
        } else {
            (place as usize, place.fract())
        };
        match (poses.get(index), poses.get(index + 1)) {
            (Some(from), Some(to)) => from.interpolate(to, fraction),
            _ => poses[poses.len() - 1],
        }
    };
    Ok((0..=last as u32).map(at).collect())
}

/// What the numbers of a body depend on besides its motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    origin_in_head: DVec3,
    head_motion: HeadMotion,
}

impl Features {
    /// Features of a head in whose axes the origin of canonical space lies at `origin_in_head`, in
    /// cm.
    ///
    /// # Errors
    /// If the origin is not finite.
    pub fn new(origin_in_head: DVec3, head_motion: HeadMotion) -> Result<Self, FeatureError> {
        if origin_in_head.is_finite() {
            Ok(Self { origin_in_head, head_motion })
        } else {
            Err(FeatureError::Origin)
        }
    }

    /// The numbers of every frame of a motion whose frames are [`SPACING_SECS`] apart (see
    /// [`resample`]). The first frame takes the rates of the second; the only frame of a motion is
    /// still.
    ///
    /// # Errors
    /// If there are no frames, or a pose is not rigid.
    pub fn motion(&self, poses: &[BodyPose]) -> Result<MotionFeatures, FeatureError> {
        check_motion(poses)?;
        let rates = |frame: usize| match poses.get(frame.max(1)) {
            Some(now) => self.rates(now, &poses[frame.max(1) - 1]),
            None => Rates::default(),
        };
        let mut features = MotionFeatures { pose: Vec::new(), velocity: Vec::new() };
        let mut before = rates(0);
        for (frame, pose) in poses.iter().enumerate() {
            let now = rates(frame);
            features.pose.push(pose_numbers(pose, &now));
            features.velocity.push(self.velocity_numbers(pose, &now, &before));
            before = now;
        }
        Ok(features)
    }

    /// The rates between two poses [`SPACING_SECS`] apart.
    fn rates(&self, now: &BodyPose, before: &BodyPose) -> Rates {
        let (now, before) = (now.joints(), before.joints());
        let mut rates = Rates::default();
        for joint in 0..JOINTS {
            let place = |pose: &Pose| match joint {
                HEAD => pose.transform_point(self.origin_in_head),
                _ => pose.translation,
            };
            rates.velocity[joint] = (place(&now[joint]) - place(&before[joint])) / SPACING_SECS;
            rates.angular[joint] = rotation_between(&before[joint], &now[joint]) / SPACING_SECS;
        }
        rates
    }

    /// An entry of the history from the rates at a pose and those [`SPACING_SECS`] before.
    fn velocity_numbers(&self, pose: &BodyPose, now: &Rates, before: &Rates) -> [f64; VELOCITY_NUMBERS] {
        let head_from_world = pose.head.rotation.conjugate();
        let mut numbers = [0.0; VELOCITY_NUMBERS];
        for (joint, row) in numbers.chunks_exact_mut(6).enumerate() {
            let motion = match (joint, self.head_motion) {
                (HEAD, HeadMotion::SpecificForce) => {
                    let acceleration = (now.velocity[HEAD] - before.velocity[HEAD]) / SPACING_SECS;
                    (DVec3::NEG_Y * GRAVITY - acceleration) / GRAVITY
                }
                _ => now.velocity[joint] / VELOCITY_SCALE,
            };
            row[..3].copy_from_slice(&(head_from_world * (now.angular[joint] / ANGULAR_SCALE)).to_array());
            row[3..].copy_from_slice(&(head_from_world * motion).to_array());
        }
        numbers
    }
}

/// The numbers of every frame of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionFeatures {
    /// The pose of each frame.
    pub pose: Vec<[f64; POSE_NUMBERS]>,
    /// The motion at each frame.
    pub velocity: Vec<[f64; VELOCITY_NUMBERS]>,
}

impl MotionFeatures {
    /// The shared inputs of a frame: pose, `shape`, history. `None` past the last frame.
    pub fn shared(&self, frame: usize, shape: &[f64; SHAPE_NUMBERS]) -> Option<[f64; SHARED_NUMBERS]> {
        let pose = self.pose.get(frame)?;
        self.velocity.get(frame)?;
        Some(shared(pose, shape, |entry| self.velocity[frame.saturating_sub(entry)]))
    }
}

/// Velocities of the joints in the world: 1/s and cm/s.
#[derive(Clone, Copy, Debug, Default)]
struct Rates {
    angular: [DVec3; JOINTS],
    velocity: [DVec3; JOINTS],
}

fn pose_numbers(pose: &BodyPose, rates: &Rates) -> [f64; POSE_NUMBERS] {
    let head_from_world = pose.head.rotation.conjugate();
    let mut vectors = [DVec3::ZERO; POSE_NUMBERS / 3];
    for (pair, joint) in vectors.chunks_exact_mut(2).zip([pose.root, pose.spine, pose.neck]) {
        let columns = DMat3::from_quat(head_from_world * joint.rotation);
        pair.copy_from_slice(&[columns.x_axis, columns.y_axis]);
    }
    vectors[6] = head_from_world * DVec3::NEG_Y;
    vectors[7] = head_from_world * (rates.angular[HEAD] / ANGULAR_SCALE);
    let mut numbers = [0.0; POSE_NUMBERS];
    for (row, vector) in numbers.chunks_exact_mut(3).zip(vectors) {
        row.copy_from_slice(&vector.to_array());
    }
    numbers
}

/// Joins a frame's shared inputs; `entry` gives those of the history, 0 the newest.
fn shared(
    pose: &[f64; POSE_NUMBERS],
    shape: &[f64; SHAPE_NUMBERS],
    entry: impl Fn(usize) -> [f64; VELOCITY_NUMBERS],
) -> [f64; SHARED_NUMBERS] {
    let mut numbers = [0.0; SHARED_NUMBERS];
    numbers[..POSE_NUMBERS].copy_from_slice(pose);
    let (shape_row, history) = numbers[POSE_NUMBERS..].split_at_mut(SHAPE_NUMBERS);
    shape_row.copy_from_slice(shape);
    for (i, row) in history.chunks_exact_mut(VELOCITY_NUMBERS).enumerate() {
        row.copy_from_slice(&entry(i));
    }
    numbers
}

/// The rotation vector that leads from the orientation of `before` to that of `now`; exactly zero
/// where they are equal.
fn rotation_between(before: &Pose, now: &Pose) -> DVec3 {
    if before.rotation == now.rotation {
        return DVec3::ZERO;
    }
    let q = now.rotation * before.rotation.conjugate();
    let q = if q.w < 0.0 { -q } else { q };
    let axis = q.xyz();
    let sine = axis.length();
    // For tiny angles the ratio of the angle to its half's sine is 2.
    if sine < 1e-150 { 2.0 * axis } else { axis * (2.0 * sine.atan2(q.w) / sine) }
}

fn check_motion(poses: &[BodyPose]) -> Result<(), FeatureError> {
    if poses.is_empty() {
        return Err(FeatureError::Empty);
    }
    poses.iter().enumerate().try_for_each(|(frame, pose)| pose.check(frame))
}

fn check_time(dt: f64) -> Result<(), FeatureError> {
    if dt > 0.0 && dt.is_finite() { Ok(()) } else { Err(FeatureError::Time(dt)) }
}
