//! A trained model: network, head, encoder and what there is to know about them, in one file.
//!
//! # The file
//! A model is a [safetensors](https://huggingface.co/docs/safetensors) file: eight bytes with the
//! length of a JSON header, the header, and the tensors one after the other in the order of their
//! names, all float32. Matrices are row-major, `[inputs, outputs]`. By default the simulator's part
//! takes 1.1 MB.
//!
//! | tensor | shape by default | what |
//! | --- | --- | --- |
//! | `simulator.static`, `….bias` | `[66, 256]`, `[256]` | the first layer: a strand's inputs, bias |
//! | `simulator.shared` | `[682, 256]` | the first layer: a frame's inputs |
//! | `simulator.hidden`, `….bias` | `[256, 256]`, `[256]` | the second layer |
//! | `simulator.output`, `….bias` | `[256, 72]`, `[72]` | the last layer |
//! | `simulator.basis` | `[24, 24]` | B of the rotation head |
//! | `encoder.0.weight`, `….0.bias` | `[75, 256]`, `[256]` | the encoder's first layer |
//! | `encoder.1.weight`, `….1.bias` | `[256, 256]`, `[256]` | the second |
//! | `encoder.2.weight`, `….2.bias` | `[256, 32]`, `[32]` | the last: a strand's code |
//!
//! The header's metadata has two texts. `forelock` is the JSON of [`ModelInfo`].
//! `forelock.checksum` are 16 hexadecimal digits: the 64-bit FNV-1a hash of the JSON text and of
//! each tensor in the order of the names: its name, its sizes as 64-bit numbers, its bytes, all
//! little-endian. So the checksum holds where another tool writes the same contents again.
//!
//! # Practice
//! The same model gives the same bytes. Reading takes nothing on trust: sizes are compared with the
//! bytes at hand before a tensor is allocated, all shapes must suit each other, and all numbers are
//! finite. Unknown fields and tensors are passed over.
//!
//! # Limitations
//! The checksum finds damage, not intent: a file of another's making is only as good as its maker.
//!
//! ```
//! use forelock_neural::model::Model;
//!
//! let error = Model::from_bytes(b"not a model").unwrap_err();
//! assert!(error.to_string().contains("no whole safetensors file"));
//! ```

mod error;
mod file;
mod info;
mod inputs;
mod rest;

pub use crate::network::head::OutputHead;
pub use error::ModelError;
pub use file::MOST_BYTES;
pub use info::{
    AdhesionInfo, EnergyInfo, FORMAT_VERSION, InputScales, ModelInfo, ModelKind, RepulsionInfo, StyleInfo,
    TrainingInfo, UNITS, UvMap,
};
pub use inputs::{InputsError, StrandAtRest};
pub use rest::strands_at_rest;

use crate::codes::Encoder;
use crate::network::inference::Predictor;
use crate::network::rotation::Basis;
use crate::network::{Network, OUTPUTS, Shape};
use forelock_core::lane::Simd;

/// A trained model.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    network: Network<f32>,
    basis: Basis,
    encoder: Encoder,
    info: ModelInfo,
}

impl Model {
    /// A model of its parts. The numbers of `basis` are rounded to float32, as in the file.
    ///
    /// # Errors
    /// If the network's inputs are not those of the encoder's codes and of the history in `info`,
    /// its outputs are not three an edge, a number is not finite, or a field of `info` has a value
    /// that cannot be.
    pub fn new(
        network: Network<f32>,
        basis: &Basis,
        encoder: Encoder,
        info: ModelInfo,
    ) -> Result<Self, ModelError> {
        info.check()?;
        let Shape { statics, shared, width, outputs } = *network.shape();
        let expected = [
            ("simulator.static", [statics, width], Some(2 + 2 * encoder.code_len())),
            ("simulator.shared", [shared, width], info.shared_inputs()),
        ];
        for (tensor, found, inputs) in expected {
            if inputs != Some(found[0]) {
                let inputs = inputs.map_or("fewer".into(), |inputs| inputs.to_string());
                let expected = format!("[{inputs}, {width}]");
                return Err(ModelError::Shape { tensor: tensor.into(), found: found.into(), expected });
            }
        }
        if width == 0 {
            let (tensor, expected) = ("simulator.hidden".into(), "[any, any] of at least 1".into());
            return Err(ModelError::Shape { tensor, found: vec![0, 0], expected });
        }
        if outputs != OUTPUTS {
            return Err(output_shape([width, outputs]));
        }
        let basis = basis.map(|row| row.map(|x| f64::from(x as f32)));
        let model = Self { network, basis, encoder, info };
        for (name, tensor) in model.tensors() {
            tensor.check_finite(&name)?;
        }
        Ok(model)
    }

    /// The network.
    pub fn network(&self) -> &Network<f32> {
        &self.network
    }

    /// B of the rotation head; its numbers are float32.
    pub fn basis(&self) -> &Basis {
        &self.basis
    }

    /// The encoder of strand codes.
    pub fn encoder(&self) -> &Encoder {
        &self.encoder
    }

    /// What there is to know about the model.
    pub fn info(&self) -> &ModelInfo {
        &self.info
    }

    /// The network made ready for inference.
    ///
    /// # Errors
    /// If the network has not three outputs an edge.
    pub fn predictor(&self, simd: Simd) -> Result<Predictor, ModelError> {
        let Shape { width, outputs, .. } = *self.network.shape();
        let predictor = match self.info.head {
            OutputHead::Rotation => Predictor::new(&self.network, &self.basis, simd),
            OutputHead::Displacement => Predictor::displacing(&self.network, simd),
        };
        predictor.map_err(|_| output_shape([width, outputs]))
    }
}

/// The last layer has another number of outputs than three an edge.
fn output_shape(found: [usize; 2]) -> ModelError {
    let expected = format!("[{}, {OUTPUTS}]", found[0]);
    ModelError::Shape { tensor: "simulator.output".into(), found: found.into(), expected }
}
