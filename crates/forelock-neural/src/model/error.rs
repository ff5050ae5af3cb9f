//! Why there is no model.

use super::{FORMAT_VERSION, MOST_BYTES};
use std::fmt::Display;
use std::io;
use std::path::PathBuf;

/// Why a model cannot be made, written, read or used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The operating system reports an error.
    #[error("{path}: cannot {action}: {error}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// `read` or `write`.
        action: &'static str,
        /// The system's error.
        error: io::Error,
    },
    /// A file holds no model that can be used.
    #[error("{path}: {error}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        error: Box<Self>,
    },
    /// There are more bytes than a model has.
    #[error(
        "{bytes} bytes are more than the {MOST_BYTES} of the largest model: this is another kind of file"
    )]
    TooLarge {
        /// Bytes of the file.
        bytes: u64,
    },
    /// The bytes are not those of a safetensors file.
    #[error("the {bytes} bytes are no whole safetensors file ({reason}): copy the model again")]
    Format {
        /// Bytes of the file.
        bytes: usize,
        /// What does not hold.
        reason: String,
    },
    /// A safetensors file of something else.
    #[error("there is no metadata `{key}`: the safetensors file holds no model of Forelock")]
    Foreign {
        /// The key that is missing.
        key: &'static str,
    },
    /// The format has another version.
    #[error(
        "the model has format version {found}, and this program reads version {FORMAT_VERSION}: \
         take the Forelock that wrote it, or train again"
    )]
    Version {
        /// The model's version.
        found: u64,
    },
    /// The checksum does not suit the contents.
    #[error("the checksum is {stated}, that of the contents {found}: the file is damaged, copy it again")]
    Checksum {
        /// The checksum in the file.
        stated: String,
        /// The checksum of what is in the file.
        found: String,
    },
    /// The metadata is not the JSON text of a model.
    #[error("metadata `forelock`: {0}; export the model again")]
    Metadata(String),
    /// A field of the metadata has a value that cannot be.
    #[error("metadata `forelock`, field `{field}`: {problem}")]
    Info {
        /// The field.
        field: String,
        /// What is wrong with it.
        problem: String,
    },
    /// There is no such tensor.
    #[error("there is no tensor `{0}`: the file is damaged or was edited")]
    Missing(String),
    /// A tensor has numbers of another type.
    #[error("tensor `{tensor}` has the type {found}, not F32: export the model as float32")]
    Type {
        /// Its name.
        tensor: String,
        /// Its type.
        found: String,
    },
    /// A tensor has sizes that do not suit the others.
    #[error("tensor `{tensor}` has the shape {found:?}, not {expected}: it is of another network")]
    Shape {
        /// Its name.
        tensor: String,
        /// Its sizes.
        found: Vec<usize>,
        /// The sizes that the rest of the model needs.
        expected: String,
    },
    /// A weight is not finite.
    #[error("tensor `{tensor}`, number {index}{at}: {value} is not finite; train again", at = at(*byte))]
    NotFinite {
        /// The tensor's name.
        tensor: String,
        /// The number's place in the tensor, from 0.
        index: usize,
        /// Its place in the file, where there is one.
        byte: Option<usize>,
        /// The weight.
        value: f32,
    },
}

/// The words for a place in a file.
fn at(byte: Option<usize>) -> String {
    byte.map(|byte| format!(" (byte {byte} of the file)")).unwrap_or_default()
}

/// A text that may hold parts of a file, as a part of one line: at most 200 characters, none of
/// them a control character.
pub(super) fn one_line(text: &impl Display) -> String {
    let shown = |c: char| if c.is_control() { '\u{FFFD}' } else { c };
    text.to_string().chars().take(200).map(shown).collect()
}
