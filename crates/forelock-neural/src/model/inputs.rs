//! From strands at rest to the network's inputs.

use super::Model;
use crate::codes::encoder::INPUTS;
use crate::codes::{LocksError, RootFrameError, crown_uv, encoder_inputs, static_inputs};
use crate::network::inference::Positions;
use forelock_core::lane::Simd;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// A strand at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandAtRest {
    /// Its particles, root first: cm, canonical space.
    pub particles: Positions,
    /// The scalp's outward normal at the root, of any positive length; canonical axes.
    pub normal: DVec3,
    /// From the head's centre to the root, of any positive length; canonical axes.
    pub direction: DVec3,
}

/// Why strands have no inputs.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InputsError {
    /// A strand has no frame, or no place on the head.
    #[error("strand {strand}: {error}")]
    Strand {
        /// Number of the strand, from 0.
        strand: usize,
        /// What is wrong with it.
        error: RootFrameError,
    },
    /// The strands have no locks.
    #[error(transparent)]
    Locks(#[from] LocksError),
}

impl Model {
    /// The static inputs of the strands of one groom, `[strands, statics]`, as
    /// [`Predictor::prepare`](crate::network::inference::Predictor::prepare) takes them: uv, code
    /// and mean code of the lock. Locks are formed over all strands of the list.
    ///
    /// # Errors
    /// If there are no strands, or one has a particle that is not finite, or a normal or direction
    /// without a length.
    ///
    /// # Panics
    /// If the processor does not support `simd`.
    pub fn strand_inputs(&self, strands: &[StrandAtRest], simd: Simd) -> Result<Vec<f32>, InputsError> {
        let one = |(strand, rest): (usize, &StrandAtRest)| {
            uv_and_shape(rest).map_err(|error| InputsError::Strand { strand, error })
        };
        let all = strands.par_iter().enumerate().map(one).collect::<Vec<_>>();
        // The first strand that is wrong, whatever the threads.
        let all = all.into_iter().collect::<Result<Vec<_>, _>>()?;
        let (uv, shapes): (Vec<_>, Vec<_>) = all.into_iter().unzip();
        let codes = self.encoder.encode(&shapes, simd);
        Ok(static_inputs(&uv, &codes, self.info.code_deviation as f32)?)
    }
}

/// The root's uv and the encoder's inputs of a strand.
fn uv_and_shape(strand: &StrandAtRest) -> Result<([f64; 2], [f32; INPUTS]), RootFrameError> {
    let points = strand.particles.map(|x| Vec3::from(x).as_dvec3());
    Ok((crown_uv(strand.direction)?, encoder_inputs(&points, strand.normal)?))
}
