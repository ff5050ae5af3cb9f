//! The state of a training as bytes, from which it goes on bit for bit.

use super::soap::Soap;
use super::{Options, Trainer};
use crate::network::{LengthError, Network};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use std::collections::HashMap;

/// The key of the metadata under which the caller's note is.
const NOTE: &str = "note";
/// That of the number of steps done.
const DONE: &str = "done";
/// The tensors: the network, its average, the state of the descent (with pending steps in the last
/// part) and the best network.
const TENSORS: [&str; 6] = ["network", "average", "first", "second", "sides", "best"];

/// Why bytes are no checkpoint of a training.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// They are no checkpoint, or damaged.
    #[error("this is no checkpoint of a training: {0}")]
    Format(String),
    /// It is one of a network of another size.
    #[error("the checkpoint is of another network: {0}")]
    Length(#[from] LengthError),
}

/// A training that goes on.
#[derive(Debug)]
pub struct Resumed {
    /// The training.
    pub trainer: Trainer,
    /// The best network so far, if there was one.
    pub best: Option<Network<f32>>,
}

fn broken(error: safetensors::SafeTensorError) -> CheckpointError {
    CheckpointError::Format(error.to_string())
}

fn missing() -> CheckpointError {
    CheckpointError::Format("something is missing".to_owned())
}

/// The text under `key` of a checkpoint's metadata.
fn text(bytes: &[u8], key: &str) -> Result<String, CheckpointError> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(broken)?;
    metadata.metadata().as_ref().and_then(|texts| texts.get(key)).cloned().ok_or_else(missing)
}

impl Trainer {
    /// The state of the training, with the best network so far and a note of the caller's.
    ///
    /// # Errors
    /// [`CheckpointError::Format`] if it is too large to be written.
    pub fn checkpoint(&self, best: Option<&Network<f32>>, note: &str) -> Result<Vec<u8>, CheckpointError> {
        let [first, second, sides] = self.descent.state();
        let none: &[f32] = &[];
        let best = best.map_or(none, Network::parameters);
        let lists = [self.network.parameters(), self.average.parameters(), &first, &second, &sides, best];
        let bytes: Vec<Vec<u8>> =
            lists.iter().map(|list| list.iter().flat_map(|x| x.to_le_bytes()).collect()).collect();
        let mut views = Vec::new();
        for ((name, list), bytes) in TENSORS.iter().zip(lists).zip(&bytes) {
            views.push((*name, TensorView::new(Dtype::F32, vec![list.len()], bytes).map_err(broken)?));
        }
        let texts = [(NOTE, note.to_owned()), (DONE, self.done.to_string())];
        let texts: HashMap<String, String> = texts.map(|(key, text)| (key.to_owned(), text)).into();
        safetensors::serialize(views, Some(texts)).map_err(broken)
    }

    /// The note that was kept with a [`checkpoint`](Self::checkpoint), also of another version.
    ///
    /// # Errors
    /// [`CheckpointError`] if the bytes are no checkpoint.
    pub fn note(bytes: &[u8]) -> Result<String, CheckpointError> {
        text(bytes, NOTE)
    }

    /// Goes on from a [`checkpoint`](Self::checkpoint) of a training with the same `options`.
    ///
    /// # Errors
    /// [`CheckpointError`] if the bytes are none, or of another network.
    ///
    /// # Panics
    /// If this processor does not support `options.simd`.
    pub fn resume(options: Options, bytes: &[u8]) -> Result<Resumed, CheckpointError> {
        let done = text(bytes, DONE)?.parse().map_err(|_| missing())?;
        let tensors = SafeTensors::deserialize(bytes).map_err(broken)?;
        let list = |name: &str| -> Result<Vec<f32>, CheckpointError> {
            let tensor = tensors.tensor(name).map_err(broken)?;
            let numbers: Vec<f32> =
                tensor.data().as_chunks().0.iter().copied().map(f32::from_le_bytes).collect();
            match numbers.iter().all(|x| x.is_finite()) && tensor.dtype() == Dtype::F32 {
                true => Ok(numbers),
                false => Err(CheckpointError::Format(format!("{name} is not finite"))),
            }
        };
        let mut trainer = Self::new(options);
        let shape = trainer.options.shape();
        let network = |name: &str| Ok::<_, CheckpointError>(Network::new(shape, list(name)?)?);
        trainer.network = network("network")?;
        trainer.average = network("average")?;
        let state = [list("first")?, list("second")?, list("sides")?];
        trainer.descent = Soap::resume(&shape, done, state).ok_or_else(missing)?;
        trainer.done = done;
        let best = list("best")?;
        let best = if best.is_empty() { None } else { Some(Network::new(shape, best)?) };
        Ok(Resumed { trainer, best })
    }
}
