//! A trial: strands and motions that a network was not trained on, and what it makes of them.

use crate::losses::Strand;
use crate::losses::field::SmoothField;
use crate::losses::motion::Place;
use crate::measures::{MeasureError, Measures, Motions};
use crate::network::inference::{Positions, Predictor};
use crate::reference::{Terms, motion};
use crate::train::{Clip, TrainingStrand, shared};
use crate::{EDGES, PARTICLES};
use forelock_core::lane::{Mat3, V3};
use rayon::prelude::*;

/// How deep a particle has to be to count as inside the body, cm.
const INSIDE_CM: f64 = 0.1;

/// Strands of several kinds and motions, with the implicit reference of each strand in each motion.
#[derive(Debug)]
pub struct Trial {
    rest: Vec<Positions>,
    statics: Vec<f32>,
    /// Strands of each kind, one kind after the other.
    counts: Vec<usize>,
    clips: Vec<Clip>,
    field: SmoothField,
    /// `[clip][strand][frame]`.
    references: Vec<Vec<Vec<Strand<f64>>>>,
}

/// What a network makes of strands of one kind, or of all. Of several motions, sums of squares and
/// of displacements are taken over all of them, and correlations are means.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Score {
    /// [`Measures::corr`].
    pub corr: f64,
    /// [`Measures::corr_vel`].
    pub corr_vel: f64,
    /// [`Measures::nrmse`].
    pub nrmse: f64,
    /// [`Measures::nrmse_dyn`].
    pub nrmse_dyn: f64,
    /// [`Measures::motion_ratio`].
    pub motion_ratio: f64,
    /// Share of the particles deeper in the body than 1 mm.
    pub inside: f64,
    /// The largest relative change of an edge's length.
    pub stretch: f64,
}

impl Score {
    /// The score over several motions.
    fn over(motions: &[(Measures, f64, f64)]) -> Self {
        let sum = |part: &dyn Fn(&Measures) -> f64| motions.iter().map(|(own, ..)| part(own)).sum::<f64>();
        let count = motions.len().max(1) as f64;
        let share = |part: f64, of: f64| if of > 0.0 { part / of } else { 0.0 };
        let squares = |error: &dyn Fn(&Measures) -> f64, size: &dyn Fn(&Measures) -> f64| {
            let square =
                |own: &Measures| if size(own) > 0.0 { (error(own) * size(own)).powi(2) } else { 0.0 };
            share(sum(&square), sum(&|own| size(own).powi(2))).sqrt()
        };
        Self {
            corr: sum(&|own| own.corr) / count,
            corr_vel: sum(&|own| own.corr_vel) / count,
            nrmse: squares(&|own| own.nrmse, &|own| own.ref_rms),
            nrmse_dyn: squares(&|own| own.nrmse_dyn, &|own| own.ref_dyn),
            motion_ratio: share(
                sum(&|own| if own.ref_step > 0.0 { own.motion_ratio * own.ref_step } else { 0.0 }),
                sum(&|own| own.ref_step),
            ),
            inside: motions.iter().map(|(_, inside, _)| inside).sum::<f64>() / count,
            stretch: motions.iter().fold(0.0, |most, (.., stretch)| stretch.max(most)),
        }
    }

    /// The mean of the scores of several kinds, and their largest stretch.
    pub fn mean(of: &[Self]) -> Self {
        let mean = |part: fn(&Self) -> f64| of.iter().map(part).sum::<f64>() / of.len().max(1) as f64;
        Self {
            corr: mean(|own| own.corr),
            corr_vel: mean(|own| own.corr_vel),
            nrmse: mean(|own| own.nrmse),
            nrmse_dyn: mean(|own| own.nrmse_dyn),
            motion_ratio: mean(|own| own.motion_ratio),
            inside: mean(|own| own.inside),
            stretch: of.iter().fold(0.0, |most, own| own.stretch.max(most)),
        }
    }

    /// Its numbers with their names.
    pub fn numbers(&self) -> [(&'static str, f64); 7] {
        [
            ("corr", self.corr),
            ("corr_vel", self.corr_vel),
            ("nrmse", self.nrmse),
            ("nrmse_dyn", self.nrmse_dyn),
            ("motion_ratio", self.motion_ratio),
            ("inside", self.inside),
            ("stretch", self.stretch),
        ]
    }
}

impl Trial {
    /// The trial of `strands`, of which `counts` are of each kind, in motions on the body `field`.
    /// The references are computed here: a millisecond and more a strand and frame. `step` is
    /// called after each motion.
    ///
    /// # Panics
    /// If the kinds have another number of strands than there are.
    pub fn new(
        terms: &Terms,
        field: SmoothField,
        strands: &[TrainingStrand],
        counts: &[usize],
        clips: Vec<Clip>,
        step: &mut dyn FnMut(),
    ) -> Self {
        assert_eq!(counts.iter().sum::<usize>(), strands.len(), "strands of all kinds");
        let mut references = Vec::with_capacity(clips.len());
        for clip in &clips {
            let place = |frame: &crate::train::Frame| Place {
                rotation: Mat3::splat(frame.rotation),
                origin: V3::splat(frame.origin),
            };
            let places: Vec<Place<f64>> = clip.iter().map(place).collect();
            let bodies: Vec<_> = clip.iter().map(|frame| frame.body(&field)).collect();
            let of_strand = |strand: &TrainingStrand| {
                let rest = std::array::from_fn(|i| V3(strand.rest[i].map(f64::from)));
                motion(terms, &rest, &places, &bodies)
            };
            references.push(strands.par_iter().map(of_strand).collect());
            step();
        }
        Self {
            rest: strands.iter().map(|strand| strand.rest).collect(),
            statics: strands.iter().flat_map(|strand| strand.statics.iter().copied()).collect(),
            counts: counts.to_vec(),
            clips,
            field,
            references,
        }
    }

    /// The score of each kind.
    ///
    /// # Errors
    /// [`MeasureError`] if a prediction is not finite, or a motion too short.
    pub fn run(&self, predictor: &Predictor) -> Result<Vec<Score>, MeasureError> {
        self.run_with(predictor, &self.statics)
    }

    /// The same with other inputs of the strands, `[strands, statics]`.
    ///
    /// # Errors
    /// [`MeasureError`] if a prediction is not finite, a motion too short, or there are not as many
    /// inputs as strands.
    pub fn run_with(&self, predictor: &Predictor, statics: &[f32]) -> Result<Vec<Score>, MeasureError> {
        let (found, particles) = (self.rest.len() * PARTICLES, PARTICLES);
        let prepared = predictor.prepare(&self.rest, statics);
        let prepared = prepared.map_err(|_| MeasureError::Rest { found, particles })?;
        self.run_by(&mut |inputs, found| {
            // A quasi-static network has no history.
            predictor.predict(&prepared, &inputs[..predictor.shared_inputs()], found);
        })
    }

    /// The score of each kind of strands that `predict` places, given all inputs of a frame,
    /// `[682]`: cm, canonical space.
    ///
    /// # Errors
    /// [`MeasureError`] if a position is not finite, or a motion too short.
    pub fn run_by(
        &self,
        predict: &mut dyn FnMut(&[f32], &mut [Positions]),
    ) -> Result<Vec<Score>, MeasureError> {
        let mut scores = vec![Vec::new(); self.counts.len()];
        for (clip, reference) in self.clips.iter().zip(&self.references) {
            let mut found = vec![vec![[[0.0; 3]; PARTICLES]; self.rest.len()]; clip.len()];
            for (frame, found) in found.iter_mut().enumerate() {
                predict(&shared(clip, frame), found);
            }
            let mut first = 0;
            for (count, scores) in self.counts.iter().zip(&mut scores) {
                scores.push(self.score(first..first + count, clip, &found, reference)?);
                first += count;
            }
        }
        Ok(scores.iter().map(|own| Score::over(own)).collect())
    }

    /// The measures of the strands `own` in a motion, the share inside the body, the stretch.
    fn score(
        &self,
        own: std::ops::Range<usize>,
        clip: &Clip,
        found: &[Vec<Positions>],
        reference: &[Vec<Strand<f64>>],
    ) -> Result<(Measures, f64, f64), MeasureError> {
        let wide = |x: &[f32; 3]| x.map(f64::from);
        let rest: Vec<[f64; 3]> = self.rest[own.clone()].iter().flatten().map(wide).collect();
        let of_frame = |frame: &Vec<Positions>| frame[own.clone()].iter().flatten().map(wide).collect();
        let frames: Vec<Vec<[f64; 3]>> = found.iter().map(of_frame).collect();
        let expected: Vec<[f64; 3]> = (0..clip.len())
            .flat_map(|frame| own.clone().flat_map(move |s| reference[s][frame].map(|x| x.0)))
            .collect();
        let mut inside = 0usize;
        for (frame, positions) in clip.iter().zip(&frames) {
            let body = frame.body(&self.field);
            inside += positions.iter().filter(|x| body.distance(**x) < -INSIDE_CM).count();
        }
        let mut stretch = 0.0f64;
        for positions in &frames {
            for (rest, x) in rest.chunks_exact(PARTICLES).zip(positions.chunks_exact(PARTICLES)) {
                for i in 0..EDGES {
                    let length = |x: &[[f64; 3]]| glam::DVec3::from(x[i]).distance(x[i + 1].into());
                    stretch = stretch.max((length(x) / length(rest) - 1.0).abs());
                }
            }
        }
        let motion = frames.concat();
        let all = motion.len().max(1) as f64;
        let motions = Motions { particles: PARTICLES, rest: &rest, motion: &motion, reference: &expected };
        Ok((motions.measure()?, inside as f64 / all, stretch))
    }
}
