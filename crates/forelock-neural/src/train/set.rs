//! What a training draws from: strands, and frames of motions.

use super::chances::Chances;
use super::drapes::Drapes;
use super::{Energies, FRAMES, MOMENTS, STRANDS};
use crate::PARTICLES;
use crate::features::{
    BodyPose, FeatureError, Features, HISTORY, POSE_NUMBERS, SHAPE_NUMBERS, VELOCITY_NUMBERS,
};
use crate::losses::adhesion::{Adhesion, AdhesionTerms};
use crate::losses::body::{Body, Capsule, Near};
use crate::losses::field::SmoothField;
use crate::network::inference::Positions;
use crate::network::{LOCK_INPUTS, STATICS};
use crate::random::Random;
use forelock_core::lane::{Lane, V3};
use glam::{DMat3, DVec3};

/// A strand of a training.
#[derive(Clone, Debug)]
pub struct TrainingStrand {
    /// Positions at rest, cm, canonical space.
    pub rest: Positions,
    /// The inputs of the strand, [`STATICS`].
    pub statics: Vec<f32>,
}

/// A frame of a motion.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Rotation of canonical space.
    pub rotation: DMat3,
    /// Origin of canonical space, cm.
    pub origin: DVec3,
    /// Pose and shape of the body, as inputs.
    pub pose: [f32; POSE_NUMBERS + SHAPE_NUMBERS],
    /// The entry of the history.
    pub velocity: [f32; VELOCITY_NUMBERS],
    /// Parts of the body that move in canonical space: capsules, cm.
    pub parts: Vec<Capsule<f64>>,
}

impl Frame {
    /// The body in this frame: its rigid part is `field`.
    pub fn body<'a>(&'a self, field: &'a SmoothField) -> Bust<'a> {
        Bust { field, parts: &self.parts }
    }

    fn is_finite(&self) -> bool {
        let numbers = self.pose.iter().chain(&self.velocity);
        let parts = self.parts.iter().flat_map(|part| part.ends.map(|end| end.0));
        let mut parts = parts.flatten().chain(self.parts.iter().map(|part| part.radius));
        parts.all(f64::is_finite)
            && self.rotation.is_finite()
            && self.origin.is_finite()
            && numbers.copied().all(f32::is_finite)
    }
}

/// A motion, 1/30 s a frame.
pub type Clip = Vec<Frame>;

/// A motion of a body of mean shape whose moving parts do not collide, from its poses at every
/// frame.
///
/// # Errors
/// [`FeatureError`] if a pose is not finite, or there is none.
pub fn clip(features: &Features, poses: &[BodyPose]) -> Result<Clip, FeatureError> {
    let numbers = features.motion(poses)?;
    let numbers = numbers.pose.iter().zip(&numbers.velocity);
    let frame = |(body, (pose, velocity)): (&BodyPose, (&[f64; POSE_NUMBERS], &[f64; VELOCITY_NUMBERS]))| {
        let mut inputs = [0.0; POSE_NUMBERS + SHAPE_NUMBERS];
        inputs.iter_mut().zip(pose).for_each(|(to, x)| *to = *x as f32);
        Frame {
            rotation: DMat3::from_quat(body.head.rotation),
            origin: body.head.translation,
            pose: inputs,
            velocity: velocity.map(|x| x as f32),
            parts: Vec::new(),
        }
    };
    Ok(poses.iter().zip(numbers).map(frame).collect())
}

/// The inputs of frame `number` of a motion. Frames before the first repeat it.
pub fn shared(clip: &Clip, number: usize) -> Vec<f32> {
    let mut inputs = clip[number].pose.to_vec();
    inputs.reserve(HISTORY * VELOCITY_NUMBERS);
    (0..HISTORY).for_each(|ago| inputs.extend_from_slice(&clip[number.saturating_sub(ago)].velocity));
    inputs
}

/// Strands and motions that cannot be trained with.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SetError {
    /// There are no strands.
    #[error("there are no strands to train with")]
    NoStrands,
    /// There are no motions.
    #[error("there are no motions to train with")]
    NoMotions,
    /// A motion is too short.
    #[error("motion {clip} has {frames} frames; it needs {MOMENTS}")]
    Short {
        /// The motion's number.
        clip: usize,
        /// Its frames.
        frames: usize,
    },
    /// A strand's inputs have another length.
    #[error("strand {strand} has {found} inputs, not {STATICS}")]
    Statics {
        /// Its number.
        strand: usize,
        /// Its inputs.
        found: usize,
    },
    /// A kind of hair has too few strands.
    #[error("kind {kind} of hair has {strands} strands; it needs {STRANDS}")]
    Few {
        /// Its number.
        kind: usize,
        /// Its strands.
        strands: usize,
    },
    /// A frame is not finite.
    #[error("frame {frame} of motion {clip} is not finite")]
    Frame {
        /// The motion's number.
        clip: usize,
        /// Its number in the motion.
        frame: usize,
    },
    /// A strand or its inputs are not finite, or two neighbouring particles are in one place.
    #[error("strand {strand} or its inputs are not finite, or it has an edge of no length")]
    Strand {
        /// Its number.
        strand: usize,
    },
}

/// What a training draws from.
#[derive(Debug)]
pub struct TrainingSet {
    pub(crate) strands: Vec<TrainingStrand>,
    pub(crate) clips: Vec<Clip>,
    pub(super) field: SmoothField,
    pub(super) chances: Chances,
    /// The first strand of each kind of hair, and the number of all.
    kinds: Vec<usize>,
    /// Bonds of each kind; none without adhesion.
    pub(super) adhesion: Vec<Adhesion<f32>>,
    /// The drapes of all windows that are drawn, in a training by squared error.
    pub(super) drapes: Option<Drapes>,
    /// The number of windows before each motion.
    before: Vec<usize>,
    windows: usize,
}

/// A window of a step: the newest of its [`MOMENTS`] frames, and its strands.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn {
    pub clip: usize,
    pub frame: usize,
    pub strands: [usize; STRANDS],
    /// What each counts for in the mean energy.
    pub weights: [f32; STRANDS],
    /// The number of its drapes, if it has some.
    pub drape: Option<usize>,
}

impl TrainingSet {
    /// Strands and motions to draw from, and the rigid part of the body. The strands are those of
    /// several kinds of hair, `counts` of each; strands that are neighbours in the list should be
    /// neighbours on the head, as in the order of their locks.
    ///
    /// # Errors
    /// If there are none, or fewer than [`STRANDS`] of a kind, or a motion is shorter than
    /// [`MOMENTS`], or a strand has inputs of another length than the network, is not finite or has
    /// an edge of no length.
    ///
    /// # Panics
    /// If `counts` are of another number of strands.
    pub fn new(
        strands: Vec<TrainingStrand>,
        counts: &[usize],
        clips: Vec<Clip>,
        field: SmoothField,
    ) -> Result<Self, SetError> {
        assert_eq!(counts.iter().sum::<usize>(), strands.len(), "strands of all kinds");
        if strands.is_empty() {
            return Err(SetError::NoStrands);
        }
        let mut kinds = vec![0];
        for (kind, count) in counts.iter().enumerate() {
            if *count < STRANDS {
                return Err(SetError::Few { kind, strands: *count });
            }
            kinds.push(kinds[kind] + count);
        }
        for (strand, own) in strands.iter().enumerate() {
            if own.statics.len() != STATICS {
                return Err(SetError::Statics { strand, found: own.statics.len() });
            }
            let edge = |i: usize| (0..3).map(|c| (own.rest[i][c] - own.rest[i - 1][c]).powi(2)).sum::<f32>();
            let is_finite = own.statics.iter().all(|x| x.is_finite());
            if !(is_finite && (1..PARTICLES).all(|i| edge(i).is_finite() && edge(i) > 0.0)) {
                return Err(SetError::Strand { strand });
            }
        }
        let (mut before, mut windows) = (Vec::new(), 0);
        for (clip, own) in clips.iter().enumerate() {
            if own.len() < MOMENTS {
                return Err(SetError::Short { clip, frames: own.len() });
            }
            before.push(windows);
            windows += own.len() - (MOMENTS - 1);
            if let Some(frame) = own.iter().position(|frame| !frame.is_finite()) {
                return Err(SetError::Frame { clip, frame });
            }
        }
        if clips.is_empty() {
            return Err(SetError::NoMotions);
        }
        let chances = Chances::new(strands.iter().map(|strand| &strand.rest));
        Ok(Self {
            strands,
            clips,
            field,
            chances,
            kinds,
            adhesion: Vec::new(),
            drapes: None,
            before,
            windows,
        })
    }

    /// Sets the codes of locks to 0.
    pub(super) fn hide_lock_codes(&mut self) {
        self.strands.iter_mut().for_each(|strand| strand.statics[LOCK_INPUTS].fill(0.0));
    }

    /// Prepares the set for a training with `energies`.
    pub(super) fn prepare(&mut self, energies: &Energies) {
        let of_kind = |kind: &[usize], terms: AdhesionTerms| {
            let strands = &self.strands[kind[0]..kind[1]];
            let rest: Vec<[f32; 3]> = strands.iter().flat_map(|strand| strand.rest).collect();
            Adhesion::new(terms, &rest, PARTICLES)
        };
        let kinds = self.kinds.windows(2);
        self.adhesion = energies.adhesion.map_or(Vec::new(), |own| {
            let bonds = kinds.map(|kind| of_kind(kind, own));
            bonds.map(|bonds| if energies.prints_adhesion { bonds.printed() } else { bonds }).collect()
        });
    }

    /// Computes the drapes of `count` windows, which alone are drawn from then on.
    pub(super) fn drape(&mut self, energies: &Energies, seed: u64, count: usize) {
        self.drapes = None;
        self.drapes = Some(Drapes::new(self, energies, seed, count));
    }

    /// The frames and strands of a step: draped ones, random strands, or those that are next to
    /// each other.
    pub(crate) fn draw(&self, random: &mut Random, are_neighbours: bool) -> [Drawn; FRAMES] {
        if let Some(drapes) = &self.drapes {
            return std::array::from_fn(|_| drapes.draw(random));
        }
        std::array::from_fn(|_| {
            let at = random.below(self.windows);
            let clip = self.before.partition_point(|before| *before <= at) - 1;
            let strands = if are_neighbours {
                let strand = random.below(self.strands.len());
                let kind = self.kinds.partition_point(|first| *first <= strand) - 1;
                // The last strands of a kind begin no run: the run before them is drawn.
                let first = strand.min(self.kinds[kind + 1] - STRANDS);
                std::array::from_fn(|k| first + k)
            } else {
                std::array::from_fn(|_| self.chances.draw(random))
            };
            let weights = match are_neighbours {
                true => [1.0; STRANDS],
                false => strands.map(|strand| self.chances.weight(strand)),
            };
            Drawn { clip, frame: at - self.before[clip] + (MOMENTS - 1), strands, weights, drape: None }
        })
    }

    /// The kind of neighbouring strands, and the number of the first among those of its kind.
    pub(super) fn run_of(&self, drawn: &Drawn) -> Option<(usize, usize)> {
        let [first, .., last] = drawn.strands;
        let kind = self.kinds.partition_point(|own| *own <= first) - 1;
        (last == first + STRANDS - 1 && last < self.kinds[kind + 1]).then(|| (kind, first - self.kinds[kind]))
    }
}

/// The body of a frame: a rigid part and capsules that move relative to it.
#[derive(Clone, Copy, Debug)]
pub struct Bust<'a> {
    pub(super) field: &'a SmoothField,
    pub(super) parts: &'a [Capsule<f64>],
}

impl Bust<'_> {
    /// The signed distance at `x`, cm.
    pub fn distance(&self, x: [f64; 3]) -> f64 {
        Body::<f64>::near(self, V3(x)).distance
    }
}

impl<L: Lane> Body<L> for Bust<'_> {
    #[inline(always)]
    fn near(&self, x: V3<L>) -> Near<L> {
        let mut near = self.field.near(x);
        for part in self.parts {
            // Not mapped: closures are not compiled for the instruction set of the lanes.
            let mut ends = [V3::zero(); 2];
            for (end, own) in ends.iter_mut().zip(&part.ends) {
                for c in 0..3 {
                    end.0[c] = L::from_f64(own.0[c]);
                }
            }
            near = Capsule { ends, radius: L::from_f64(part.radius) }.near(x).min(near);
        }
        near
    }
}
