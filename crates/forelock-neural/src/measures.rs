//! How close a motion of strands is to a reference.
//!
//! # Theory
//! With the deviation from rest u = x − X in canonical space, u* that of the reference, ū the mean
//! over time and Δ the difference from frame to frame,
//!
//! ```text
//! nrmse        = rms|u − u*| / rms|u*|
//! nrmse_dyn    = rms|(u − ū) − (u* − ū*)| / rms|u* − ū*|
//! motion ratio = mean|Δu| / mean|Δu*|
//! corr         = correlation of a tip's u − ū with u* − ū*, mean over the strands
//! corr_vel     = correlation of Δu with Δu*, each less its mean over time, all particles from the
//!                13th on pooled
//! ```
//!
//! `nrmse` tells how much of the pose is wrong, `nrmse_dyn` how much of the motion; the ratio tells
//! whether the hair moves too little or too much, and the correlations whether it moves in time.
//!
//! # Practice
//! The first [`SKIPPED_FRAMES`] frames are left out: they depend on how the motions start. Sums are
//! taken in float64 over all particles, roots included.
//!
//! # Limitations
//! A quotient has no value where the reference does not move. The measures are then 0 if the motion
//! agrees (1 for the motion ratio) and infinite if it does not; correlations without any motion are
//! 0.

use forelock_core::lane::Real;

/// Frames at the start of a motion that the measures leave out.
pub const SKIPPED_FRAMES: usize = 10;

/// The first particle of a strand that `corr_vel` takes into account.
const FIRST_MOVING: usize = 12;

/// Why two motions have no measures.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// The rest shape is no whole number of strands.
    #[error("the rest shape has {found} positions: give a whole number of strands of {particles} particles")]
    Rest {
        /// Positions given.
        found: usize,
        /// Particles of a strand.
        particles: usize,
    },
    /// The motions do not have the same whole number of frames.
    #[error("the motion has {motion} positions and the reference {reference}: give whole frames of {frame}")]
    Frames {
        /// Positions of the motion.
        motion: usize,
        /// Positions of the reference.
        reference: usize,
        /// Positions of a frame.
        frame: usize,
    },
    /// The motions are too short.
    #[error("the motions have {0} frames, and the first 10 are left out: give at least 12")]
    Short(usize),
    /// A position is not finite.
    #[error("frame {frame}, strand {strand}: a position is not finite")]
    Position {
        /// Number of the frame.
        frame: usize,
        /// Number of the strand.
        strand: usize,
    },
}

/// A motion beside its reference: positions in canonical space, in cm, of strands with equal
/// numbers of particles.
#[derive(Clone, Copy, Debug)]
pub struct Motions<'a, T> {
    /// Particles of a strand.
    pub particles: usize,
    /// Positions at rest, shape \[strands, particles\].
    pub rest: &'a [[T; 3]],
    /// Positions of the motion, shape \[frames, strands, particles\].
    pub motion: &'a [[T; 3]],
    /// Positions of the reference, of the same shape.
    pub reference: &'a [[T; 3]],
}

/// The measures of a motion against a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// rms|u − u*|, in cm.
    pub rmse: f64,
    /// rms|u*|, in cm.
    pub ref_rms: f64,
    /// rms|u* − ū*|, in cm.
    pub ref_dyn: f64,
    /// mean|Δu*|, in cm.
    pub ref_step: f64,
    /// rms|u − u*| / rms|u*|.
    pub nrmse: f64,
    /// rms|(u − ū) − (u* − ū*)| / rms|u* − ū*|.
    pub nrmse_dyn: f64,
    /// mean|Δu| / mean|Δu*|.
    pub motion_ratio: f64,
    /// Correlation of the tips' deviations from their means over time, −1 to 1.
    pub corr: f64,
    /// Correlation of the velocities, −1 to 1.
    pub corr_vel: f64,
}

impl<T: Real> Motions<'_, T> {
    /// Measures the motion against the reference.
    ///
    /// # Errors
    /// If a length does not suit the others, there are fewer than [`SKIPPED_FRAMES`] + 2 frames, or
    /// a position is not finite.
    pub fn measure(&self) -> Result<Measures, MeasureError> {
        let frame = self.rest.len();
        let frames = self.check()?;
        let mut sums = Sums::default();
        let (mut corr, mut velocities) = (0.0, Products::default());
        let mut tracks = Tracks::default();
        for place in 0..frame {
            for kept in SKIPPED_FRAMES..frames {
                tracks.push(
                    deviation(self.motion[kept * frame + place], self.rest[place]),
                    deviation(self.reference[kept * frame + place], self.rest[place]),
                );
            }
            tracks.add_to(&mut sums);
            let particle = place % self.particles;
            if particle >= FIRST_MOVING {
                velocities.add_track(&steps(&tracks.motion), &steps(&tracks.reference));
            }
            if particle + 1 == self.particles {
                let mut tip = Products::default();
                tip.add_track(&tracks.motion, &tracks.reference);
                corr += tip.correlation();
            }
            tracks.motion.clear();
            tracks.reference.clear();
        }
        let kept = (frames - SKIPPED_FRAMES) as f64 * frame as f64;
        let rms = |sum: f64| (sum / kept).sqrt();
        Ok(Measures {
            rmse: rms(sums.error),
            ref_rms: rms(sums.reference),
            ref_dyn: rms(sums.reference_about_mean),
            ref_step: sums.reference_path / (kept - frame as f64),
            nrmse: quotient(rms(sums.error), rms(sums.reference), 0.0),
            nrmse_dyn: quotient(rms(sums.error_about_mean), rms(sums.reference_about_mean), 0.0),
            motion_ratio: quotient(sums.path, sums.reference_path, 1.0),
            corr: corr / (frame / self.particles) as f64,
            corr_vel: velocities.correlation(),
        })
    }

    /// Checks the lengths and positions; the number of frames.
    fn check(&self) -> Result<usize, MeasureError> {
        let frame = self.rest.len();
        if frame == 0 || self.particles == 0 || !frame.is_multiple_of(self.particles) {
            return Err(MeasureError::Rest { found: frame, particles: self.particles });
        }
        let (motion, reference) = (self.motion.len(), self.reference.len());
        if motion != reference || !motion.is_multiple_of(frame) {
            return Err(MeasureError::Frames { motion, reference, frame });
        }
        let frames = motion / frame;
        if frames < SKIPPED_FRAMES + 2 {
            return Err(MeasureError::Short(frames));
        }
        for positions in [self.rest, self.motion, self.reference] {
            if let Some(at) = positions.iter().position(|x| !x.iter().all(|c| c.is_finite())) {
                let strand = at % frame / self.particles;
                return Err(MeasureError::Position { frame: at / frame, strand });
            }
        }
        Ok(frames)
    }
}

/// The deviations of one particle over time.
#[derive(Default)]
struct Tracks {
    motion: Vec<[f64; 3]>,
    reference: Vec<[f64; 3]>,
}

impl Tracks {
    fn push(&mut self, motion: [f64; 3], reference: [f64; 3]) {
        self.motion.push(motion);
        self.reference.push(reference);
    }

    fn add_to(&self, sums: &mut Sums) {
        let (mean, reference_mean) = (mean(&self.motion), mean(&self.reference));
        for (&u, &reference) in self.motion.iter().zip(&self.reference) {
            let about_mean = minus(reference, reference_mean);
            sums.error += square(minus(u, reference));
            sums.reference += square(reference);
            sums.error_about_mean += square(minus(minus(u, mean), about_mean));
            sums.reference_about_mean += square(about_mean);
        }
        sums.path += steps(&self.motion).into_iter().map(|d| square(d).sqrt()).sum::<f64>();
        sums.reference_path += steps(&self.reference).into_iter().map(|d| square(d).sqrt()).sum::<f64>();
    }
}

/// Sums over particles and frames.
#[derive(Default)]
struct Sums {
    error: f64,
    reference: f64,
    error_about_mean: f64,
    reference_about_mean: f64,
    path: f64,
    reference_path: f64,
}

/// Sums of products of two signals, each less its mean.
#[derive(Default)]
struct Products {
    mixed: f64,
    motion: f64,
    reference: f64,
}

impl Products {
    fn add_track(&mut self, motion: &[[f64; 3]], reference: &[[f64; 3]]) {
        let (motion_mean, reference_mean) = (mean(motion), mean(reference));
        for (&a, &b) in motion.iter().zip(reference) {
            let (a, b) = (minus(a, motion_mean), minus(b, reference_mean));
            self.mixed += a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            self.motion += square(a);
            self.reference += square(b);
        }
    }

    fn correlation(&self) -> f64 {
        let norm = self.motion.sqrt() * self.reference.sqrt();
        if norm > 0.0 { (self.mixed / norm).clamp(-1.0, 1.0) } else { 0.0 }
    }
}

/// a/b; where both are 0, `agreed`.
fn quotient(a: f64, b: f64, agreed: f64) -> f64 {
    if a == 0.0 && b == 0.0 { agreed } else { a / b }
}

fn deviation<T: Real>(x: [T; 3], rest: [T; 3]) -> [f64; 3] {
    let wide = |v: [T; 3]| v.map(|c| c.to_f64().unwrap_or(f64::NAN));
    minus(wide(x), wide(rest))
}

fn steps(track: &[[f64; 3]]) -> Vec<[f64; 3]> {
    track.windows(2).map(|pair| minus(pair[1], pair[0])).collect()
}

/// The mean over time, exact for a constant.
fn mean(track: &[[f64; 3]]) -> [f64; 3] {
    let first = track.first().copied().unwrap_or_default();
    let sum = track.iter().map(|&x| minus(x, first)).fold([0.0; 3], plus);
    plus(first, sum.map(|c| c / track.len().max(1) as f64))
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn square(a: [f64; 3]) -> f64 {
    a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
}
