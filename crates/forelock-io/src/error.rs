//! What can go wrong with a file, said so that a person knows what to do.

use std::{
    fmt, io,
    path::{Path, PathBuf},
};

use forelock_core::{body::MeshError, groom::GroomError};

/// Why a file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// It cannot be opened, or reading fails on the way.
    #[error("{}: {}", path.display(), explain(source))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// It is a directory, a pipe or a device.
    #[error("{}: {what}, where a file is expected", path.display())]
    NotAFile {
        /// What was named.
        path: PathBuf,
        /// What it is.
        what: &'static str,
    },
    /// It has no byte.
    #[error("{}: the file is empty; was it cut off while being written or copied?", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Its ending names no format that can be read.
    #[error("{}: {}; these can be read: {known}", path.display(), ending(path))]
    UnknownEnding {
        /// The file.
        path: PathBuf,
        /// The endings that are known.
        known: String,
    },
    /// Its bytes are not what its format says.
    #[error("{}: {source}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        source: FormatError,
    },
    /// No strand is left that could be simulated.
    #[error("{}: no usable strand in the file ({found})", path.display())]
    NoStrands {
        /// The file.
        path: PathBuf,
        /// What was found instead.
        found: String,
    },
}

/// Why a file cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The system refuses.
    #[error("{}: cannot write: {}", path.display(), explain(source))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The name belongs to a directory, a pipe or a device.
    #[error("{}: {what}, and is not replaced by a file; choose another name", path.display())]
    NotAFile {
        /// What was named.
        path: PathBuf,
        /// What it is.
        what: &'static str,
    },
    /// Its ending names no format that can be written.
    #[error("{}: {}; these can be written: {known}", path.display(), ending(path))]
    UnknownEnding {
        /// The file.
        path: PathBuf,
        /// The endings that are known.
        known: String,
    },
    /// The format cannot hold what is to be written.
    #[error("{}: {problem}", path.display())]
    Unfit {
        /// The file.
        path: PathBuf,
        /// What does not fit, and what to do.
        problem: String,
    },
    /// The cache to be resumed is not one that can be.
    #[error("{}: cannot go on with this cache: {problem}", path.display())]
    Resume {
        /// The cache.
        path: PathBuf,
        /// Why not, and what to do.
        problem: String,
    },
}

/// Where and why bytes do not follow their format.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub struct FormatError {
    /// The format, as people call it.
    pub format: &'static str,
    /// Where in the file, in bytes.
    pub offset: u64,
    /// The strand, if one was being read.
    pub strand: Option<usize>,
    /// What is wrong there.
    pub problem: Problem,
}

impl fmt::Display for FormatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} file, byte {}", self.format, self.offset)?;
        if let Some(strand) = self.strand {
            write!(f, ", strand {strand}")?;
        }
        write!(f, ": {}", self.problem)
    }
}

/// What is wrong with bytes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// More is announced than the file holds.
    #[error(
        "{what} take {needed} bytes, but {left} are left; the file is cut short, or not of this format \
         (copy or export it again)"
    )]
    Short {
        /// What was to be read.
        what: &'static str,
        /// Bytes it takes.
        needed: u64,
        /// Bytes there are.
        left: u64,
    },
    /// Something else; the sentence says what.
    #[error("{0}")]
    Invalid(String),
    /// The arrays do not make a groom.
    #[error(transparent)]
    Groom(#[from] GroomError),
    /// The arrays do not make a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

impl ReadError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |source| Self::Io { path: path.into(), source }
    }

    pub(crate) fn format(path: &Path) -> impl FnOnce(FormatError) -> Self + '_ {
        move |source| Self::Format { path: path.into(), source }
    }
}

impl WriteError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |source| Self::Io { path: path.into(), source }
    }
}

/// The usual errors of the system, with what to do about them.
fn explain(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "no such file or folder; check the name".into(),
        io::ErrorKind::PermissionDenied => {
            "permission denied; check the rights of the file and its folder".into()
        }
        io::ErrorKind::StorageFull => "the disk is full; free some space or write elsewhere".into(),
        io::ErrorKind::ReadOnlyFilesystem => "the file system is read-only; write elsewhere".into(),
        io::ErrorKind::OutOfMemory => "the file is larger than the memory".into(),
        _ => error.to_string(),
    }
}

fn ending(path: &Path) -> String {
    match path.extension() {
        Some(ending) => format!("files ending in .{} are not known", ending.to_string_lossy()),
        None => "the name has no ending that says the format".into(),
    }
}
