//! Where roots are in a frame: one rigid head, or a rigid motion a strand.
//!
//! # Theory
//! On a body that bends, the rest shape of a strand with the root x₀ has the motion
//!
//! ```text
//! x ↦ H(s) (x₀ + d(s) + Q(s) (x − x₀))
//! ```
//!
//! at the share s of a frame: the pose H of the joint that carries the hair, interpolated as the
//! pose of a rigid head is, after the strand's own [`RootFrames`]. Between the ends of a frame d is
//! linear, and Q the normalised mean of the two rotations. Where the body does not bend, d is zero
//! and Q the identity, and the result has the bits of a rigid head.

use super::context::FrameContext;
use crate::body::character::SkinPose;
use crate::groom::{RootFrames, SkinnedRoots};
use crate::lane::{LANES, Lane, Mat3, Quat, Real, Row, V3};
use crate::params::ParamsError;
use crate::pose::Pose;
use crate::strands::{BlockView, Model, State, number};
use glam::{DQuat, DVec3};
use std::sync::Arc;

/// The motion of roots during a frame: poses at its start and end.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Roots<'a> {
    /// All roots are on one rigid head.
    Rigid([Pose; 2]),
    /// Each root has its own motion, relative to a head.
    PerStrand {
        /// The pose of what carries the hair. Positions are stored relative to it.
        head: [Pose; 2],
        /// The motion of each strand before that pose, in the groom's order.
        frames: [&'a RootFrames; 2],
    },
    /// The same where the motions are those of a skin in two poses. A device computes them from the
    /// poses; the CPU makes [`Roots::PerStrand`] of it in each frame, which takes memory.
    OnSkin {
        /// The pose of what carries the hair.
        head: [Pose; 2],
        /// The roots. A device takes them as others than those of the frame before if the pointer
        /// is another one.
        roots: &'a Arc<SkinnedRoots>,
        /// The poses of the skin before that of the head, at the frame's start and end.
        poses: [&'a SkinPose; 2],
    },
}

impl<'a> Roots<'a> {
    /// The head's pose at the frame's start and end.
    pub fn head(&self) -> &[Pose; 2] {
        match self {
            Self::Rigid(head) | Self::PerStrand { head, .. } | Self::OnSkin { head, .. } => head,
        }
    }

    /// Whether all roots move with the head.
    pub fn are_rigid(&self) -> bool {
        matches!(self, Self::Rigid(_))
    }

    /// The strands' own motion at the frame's start and end, if it is given.
    pub fn frames(&self) -> Option<[&'a RootFrames; 2]> {
        match self {
            Self::Rigid(_) | Self::OnSkin { .. } => None,
            Self::PerStrand { frames, .. } => Some(*frames),
        }
    }

    /// Checks that there is one motion a strand of `model`, if each has its own.
    ///
    /// # Errors
    /// [`ParamsError::Count`] if there is not.
    pub fn check<T>(&self, model: &Model<T>) -> Result<(), ParamsError> {
        let expected = model.strand_count;
        let lengths = |own: &RootFrames| [own.rotations.len(), own.shifts.len()];
        let wrong = |&found: &usize| found != expected;
        let found = match self {
            Self::Rigid(_) => None,
            Self::PerStrand { frames, .. } => frames.iter().flat_map(|own| lengths(own)).find(wrong),
            Self::OnSkin { roots, poses, .. } => {
                let character = roots.character();
                for pose in poses {
                    let [bones, vertices] = [character.skin().bones().len(), character.skin().vertices()];
                    let shaped = if pose.shaped.is_empty() { vertices } else { pose.shaped.len() };
                    let counts = [
                        ("bones of a pose", pose.palette.matrices.len(), bones, "the skin's bones"),
                        ("vertices of a pose", shaped, vertices, "the skin's vertices"),
                    ];
                    if let Some((name, found, expected, of)) = counts.into_iter().find(|own| own.1 != own.2) {
                        return Err(ParamsError::Count { name, found, expected, of });
                    }
                }
                Some(roots.surface().roots().len()).filter(wrong)
            }
        };
        match found {
            None => Ok(()),
            Some(found) => Err(ParamsError::Count { name: "root frames", found, expected, of: "strands" }),
        }
    }

    /// Whether roots move relative to the head in the frame, or, where poses are given, any bone.
    pub fn bends(&self) -> bool {
        match self {
            Self::Rigid(_) => false,
            Self::PerStrand { frames: [from, to], .. } => !std::ptr::eq(*from, *to) && from != to,
            Self::OnSkin { poses: [from, to], .. } => !std::ptr::eq(*from, *to) && from != to,
        }
    }
}

impl From<[Pose; 2]> for Roots<'_> {
    fn from(head: [Pose; 2]) -> Self {
        Self::Rigid(head)
    }
}

/// Rows a block of strands: rotation and shift at the start, and at the end.
pub const FRAME_ROWS: usize = 14;

/// Packs the `frames` of a frame's start and end, [`FRAME_ROWS`] a block.
///
/// # Panics
/// If there are not as many as strands ([`Roots::check`]).
pub fn pack_frames<T: Real>(model: &Model<T>, frames: [&RootFrames; 2], rows: &mut Vec<Row<T>>) {
    rows.resize(FRAME_ROWS * model.blocks.len(), Row([T::zero(); LANES]));
    for (block, rows) in model.blocks.iter().zip(rows.chunks_exact_mut(FRAME_ROWS)) {
        for (lane, &strand) in block.strands.iter().enumerate() {
            let strand = strand as usize;
            let [from, mut to] = frames.map(|own| own.rotations[strand]);
            if from.dot(to) < 0.0 {
                to = -to;
            }
            let shifts = frames.map(|own| own.shifts[strand].to_array());
            let numbers = from.to_array().into_iter().chain(shifts[0]).chain(to.to_array()).chain(shifts[1]);
            for (row, x) in rows.iter_mut().zip(numbers) {
                row.0[lane] = number(f64::from(x));
            }
        }
    }
}

/// Where the rest shape of each lane's strand is, at the end of a substep.
#[derive(Clone, Copy, Debug)]
pub struct RestMotion<L> {
    /// Maps rest positions about the model's centre to positions relative to the frame's origin.
    pub map: (Mat3<L>, V3<L>),
    /// The rotation.
    pub rotation: Quat<L>,
}

impl<L: Lane> RestMotion<L> {
    /// At a pose that all strands have.
    #[inline(always)]
    pub fn rigid(pose: &Pose) -> Self {
        Self {
            map: (Mat3::splat(pose.matrix()), V3::splat(pose.translation)),
            rotation: Quat::splat(pose.rotation),
        }
    }
}

/// A strand's rotation relative to the head.
struct StrandTurn<L> {
    now: Quat<L>,
    /// From the frame's start to its end.
    change: Quat<L>,
}

impl<L: Lane> StrandTurn<L> {
    /// That of the strands in the lanes from `first` on at the `share` of a frame.
    #[inline(always)]
    fn load(view: &BlockView<'_, L::Scalar>, first: usize, share: f64) -> Self {
        let from = Quat::load(&view.root_frames[0..4], first);
        let to = Quat::load(&view.root_frames[7..11], first);
        let change = to + from.scale(-L::one());
        let now = from + change.scale(L::from_f64(share));
        Self { now: now.scale(L::one() / now.dot(now).sqrt()), change }
    }
}

impl<T: Real> FrameContext<'_, T> {
    /// The rest shape of the strands in the lanes from `first` on after `substeps` of the frame's
    /// substeps.
    #[inline(always)]
    pub fn rest_motion<L: Lane<Scalar = T>>(
        &self,
        view: &BlockView<'_, T>,
        first: usize,
        substeps: usize,
    ) -> RestMotion<L> {
        let pose = &self.poses[substeps];
        let head = RestMotion::rigid(pose);
        if view.root_frames.is_empty() {
            return head;
        }
        let share = self.share(substeps);
        let turn = StrandTurn::load(view, first, share).now;
        let from = V3::<L>::load(&view.root_frames[4..7], 0, first);
        let to = V3::<L>::load(&view.root_frames[11..14], 0, first);
        let root = V3::<L>::load(view.rest, 0, first);
        let shift = (root + from.add_scaled(L::from_f64(share), to - from)) - turn.rotate(root);
        let mut columns = [V3::zero(); 3];
        for (column, axis) in columns.iter_mut().zip(DVec3::AXES) {
            *column = head.map.0.mul(turn.rotate(V3::splat(axis)));
        }
        let [x, y, z] = columns.map(|column| column.0);
        let matrix = Mat3([[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]]);
        RestMotion { map: (matrix, head.map.1.add_mul(&head.map.0, shift)), rotation: head.rotation * turn }
    }

    /// `vector`, which turns with the rest shape, after `substeps` of the frame's substeps.
    #[inline(always)]
    pub fn turned<L: Lane<Scalar = T>>(
        &self,
        view: &BlockView<'_, T>,
        rest: &RestMotion<L>,
        substeps: usize,
        vector: DVec3,
    ) -> V3<L> {
        if view.root_frames.is_empty() {
            return V3::splat(self.poses[substeps].transform_vector(vector));
        }
        rest.map.0.mul(V3::splat(vector))
    }

    /// The angular velocity, s⁻¹, at which the rest shape of the strands in the lanes from `first`
    /// on turns in the substep that ends after `substeps` of the frame's.
    #[inline(always)]
    pub fn spin<L: Lane<Scalar = T>>(&self, view: &BlockView<'_, T>, first: usize, substeps: usize) -> V3<L> {
        let [from, to] = [substeps - 1, substeps].map(|end| self.poses[end].rotation);
        let turn = to * from.inverse();
        let head = V3::splat(DVec3::new(turn.x, turn.y, turn.z) * (2.0 / self.h).copysign(turn.w));
        if view.root_frames.is_empty() {
            return head;
        }
        // From the change over the frame: differences of float32 rotations over a substep would be
        // noise.
        let turn = StrandTurn::<L>::load(view, first, self.share(substeps));
        let relative = (turn.change * turn.now.conjugate()).v.scale(L::from_f64(2.0 / self.dt_secs));
        head.add_mul(&Mat3::splat(self.poses[substeps].matrix()), relative)
    }

    /// The share of the frame that has passed after `substeps`.
    #[expect(clippy::cast_precision_loss, reason = "a few substeps")]
    fn share(&self, substeps: usize) -> f64 {
        substeps as f64 / f64::from(self.substeps)
    }

    /// The rest shape of the strand in `lane` after `substeps` of the frame's substeps.
    pub(super) fn rest_motion_of(&self, view: &BlockView<'_, T>, lane: usize, substeps: usize) -> Pose {
        let head = &self.poses[substeps];
        if view.root_frames.is_empty() {
            return *head;
        }
        let at = |row: usize| view.root_frames[row].0[lane].to_f64().unwrap_or(0.0);
        let share = self.share(substeps);
        let [from, to] = [0, 7].map(|row| DQuat::from_xyzw(at(row), at(row + 1), at(row + 2), at(row + 3)));
        let turn = (from + (to - from) * share).normalize();
        let [from, to] = [4, 11].map(|row| DVec3::new(at(row), at(row + 1), at(row + 2)));
        let root = [0, 1, 2].map(|c: usize| view.rest[c].0[lane].to_f64().unwrap_or(0.0));
        let root = DVec3::from_array(root);
        let translation = root + from.lerp(to, share) - turn * root;
        head.after(&Pose { rotation: turn, translation })
    }
}

impl<T: Real> State<T> {
    /// At rest with the head at `head` and the strands at their own `frames`, in the groom's order.
    pub fn at_rest_on(model: &Model<T>, head: &Pose, frames: &RootFrames) -> Self {
        let mut state = Self::at_rest(model, head);
        let centre = DVec3::from(model.centre);
        for block in &model.blocks {
            for (lane, &strand) in block.strands.iter().enumerate() {
                let rest = |p: usize| {
                    let at = |c: usize| model.rest[3 * p + c].0[lane].to_f64().unwrap_or(0.0);
                    DVec3::new(at(0), at(1), at(2)) + centre
                };
                let root = rest(block.first);
                for p in block.range() {
                    let moved = frames.transform_point(strand as usize, root, rest(p));
                    let relative = (head.transform_point(moved) - state.origin).to_array();
                    for (row, x) in state.positions[3 * p..].iter_mut().zip(relative) {
                        row.0[lane] = number(x);
                    }
                }
            }
        }
        state
    }
}
