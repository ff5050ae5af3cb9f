//! The map's network at work.

use super::{DEPTH, MapNetwork, MapStrands, Pass, TEXELS, Weights};
use crate::network::inference::{HeadRow, Positions, edges_at_rest, place};
use crate::network::product::{PACKET, PANELS, to_panels, zero_panels};
use crate::network::{LengthError, OUTPUTS, SHARED};
use crate::{PARTICLES, network::head::OutputHead};
use forelock_core::lane::{LANES, Row, Simd};
use rayon::prelude::*;

/// A map's network made ready for the strands of a groom.
#[derive(Clone, Debug)]
pub struct MapPredictor {
    simd: Simd,
    head: OutputHead,
    weights: Weights,
    /// Roots and edges at rest, cm, a row of strands after the other: `[25, 3]` rows.
    rest: Vec<Row<f32>>,
    statics: Vec<f32>,
    texels: Vec<usize>,
}

impl MapPredictor {
    /// A predictor of `network` for `strands`.
    ///
    /// # Panics
    /// If this processor does not support `simd`.
    pub fn new(network: &MapNetwork, strands: &MapStrands, simd: Simd) -> Self {
        let simd = simd.resolve();
        assert!(simd.is_supported(), "{simd:?} is not supported by this processor");
        Self {
            simd,
            head: network.head,
            weights: Weights::new(network),
            rest: edges_at_rest(strands.rest()),
            statics: strands.statics().to_vec(),
            texels: (0..TEXELS).collect(),
        }
    }

    /// Positions of all strands in a frame with the inputs `shared`, `[682]`: cm, canonical space,
    /// `[texels]` in the order of the [quadtree](super::texel).
    ///
    /// # Errors
    /// If `shared` has another length.
    pub fn predict(&self, shared: &[f32]) -> Result<Vec<Positions>, LengthError> {
        if shared.len() != SHARED {
            return Err(LengthError { expected: SHARED, found: shared.len() });
        }
        let pass = Pass { texels: &self.texels, shared, statics: &self.statics };
        let levels = pass.forward(self.simd, &self.weights);
        let outputs = &levels[DEPTH - 1].outputs;
        let mut found = vec![[[0.0; 3]; PARTICLES]; TEXELS];
        let packets = found.par_chunks_mut(PACKET).zip(outputs.par_chunks(PACKET * OUTPUTS));
        let rest = self.rest.par_chunks(PANELS * 3 * PARTICLES);
        packets.zip(rest).for_each_init(
            || zero_panels(OUTPUTS),
            |panels, ((out, outputs), rest)| {
                to_panels(outputs.chunks_exact(OUTPUTS), panels);
                let panels = panels.chunks_exact(OUTPUTS);
                let rest = rest.chunks_exact(3 * PARTICLES);
                for (out, (rest, outputs)) in out.chunks_mut(LANES).zip(rest.zip(panels)) {
                    place(self.simd, &HeadRow { head: self.head, rest, outputs }, out);
                }
            },
        );
        Ok(found)
    }
}
