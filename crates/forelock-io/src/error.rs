//! Errors of reading and writing files. Each message states what is wrong, where, and what to do.

use std::{
    fmt, io,
    path::{Path, PathBuf},
};

use forelock_core::{body::MeshError, groom::GroomError, memory};

/// Why a file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file cannot be opened, or a read fails.
    #[error("{}: {}", path.display(), explain(error))]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        error: io::Error,
    },
    /// The path is a directory, a pipe or a device.
    #[error("{}: {what}, where a file is expected", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
        /// What it is.
        what: &'static str,
    },
    /// The file has no bytes.
    #[error("{}: the file is empty; was it cut off while being written or copied?", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The ending of the name is not that of a format that can be read.
    #[error("{}: {}; these can be read: {known}", path.display(), ending(path))]
    UnknownEnding {
        /// The file.
        path: PathBuf,
        /// The endings that are known.
        known: String,
    },
    /// The bytes do not follow the format.
    #[error("{}: {error}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        error: FormatError,
    },
    /// The file is not a character.
    #[error("{}: not a glTF 2.0 file that can be used: {problem}", path.display())]
    Character {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        problem: String,
    },
    /// The frames of moving strands do not fit together.
    #[error("{}: {problem}", path.display())]
    Animation {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// The file has no strand that can be simulated.
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
    /// The operating system reports an error.
    #[error("{}: cannot write: {}", path.display(), explain(error))]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        error: io::Error,
    },
    /// The path is a directory, a pipe or a device.
    #[error("{}: {what}, and is not replaced by a file; choose another name", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
        /// What it is.
        what: &'static str,
    },
    /// The ending of the name is not that of a format that can be written.
    #[error("{}: {}; these can be written: {known}", path.display(), ending(path))]
    UnknownEnding {
        /// The file.
        path: PathBuf,
        /// The endings that are known.
        known: String,
    },
    /// The format cannot store the data.
    #[error("{}: {problem}", path.display())]
    Unfit {
        /// The file.
        path: PathBuf,
        /// What cannot be stored, and what to do.
        problem: String,
    },
    /// Another process writes the same.
    #[error(
        "{}: another run writes here{by}; wait until it has ended, or write elsewhere",
        path.display()
    )]
    Locked {
        /// The file or folder.
        path: PathBuf,
        /// Who writes, in parentheses after a space, if that is known.
        by: String,
    },
    /// The cache cannot be resumed.
    #[error("{}: cannot go on with this cache: {problem}", path.display())]
    Resume {
        /// The cache.
        path: PathBuf,
        /// Why not, and what to do.
        problem: String,
    },
}

/// Where and why the bytes of a file do not follow their format.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub struct FormatError {
    /// The usual name of the format.
    pub format: &'static str,
    /// The offset in the file, in bytes.
    pub offset: u64,
    /// The strand, if the error occurred within one.
    pub strand: Option<usize>,
    /// What is wrong at that offset.
    pub problem: Problem,
}

impl fmt::Display for FormatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} file", self.format)?;
        // Text files have lines.
        if !matches!(&self.problem, Problem::Invalid(words) if words.starts_with("line ")) {
            write!(f, ", byte {}", self.offset)?;
        }
        if let Some(strand) = self.strand {
            write!(f, ", strand {strand}")?;
        }
        write!(f, ": {}", self.problem)
    }
}

/// The way in which bytes do not follow their format.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// The file is too short for the data that it should contain.
    #[error(
        "{what} take {needed} bytes, but {left} are left; the file is cut short, or not of this format \
         (copy or export it again)"
    )]
    Short {
        /// The data that should be there.
        what: &'static str,
        /// The bytes that this data takes.
        needed: u64,
        /// The bytes that are left.
        left: u64,
    },
    /// Another fault, described by the text.
    #[error("{0}")]
    Invalid(String),
    /// The arrays are not a valid groom.
    #[error(transparent)]
    Groom(#[from] GroomError),
    /// The arrays are not a valid mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

impl ReadError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |error| Self::Io { path: path.into(), error }
    }

    pub(crate) fn format(path: &Path) -> impl FnOnce(FormatError) -> Self + '_ {
        move |error| Self::Format { path: path.into(), error }
    }
}

impl WriteError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        move |error| Self::Io { path: path.into(), error }
    }
}

/// Checks that the `bytes` to be read fit into the memory.
pub(crate) fn check_room(bytes: u64) -> io::Result<()> {
    let remedy = "split the file, or export it again if it should be small";
    memory::check("reading", bytes, 1, remedy)
        .map_err(|error| io::Error::new(io::ErrorKind::OutOfMemory, error))
}

/// The message for an error of the operating system. For common errors it states what to do.
fn explain(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "no such file or folder; check the name".into(),
        io::ErrorKind::PermissionDenied => {
            "permission denied; check the permissions of the file and its folder".into()
        }
        io::ErrorKind::AlreadyExists => "something of this name is in the way; choose another".into(),
        io::ErrorKind::StorageFull => "the disk is full; free some space or write elsewhere".into(),
        io::ErrorKind::ReadOnlyFilesystem => "the file system is read-only; write elsewhere".into(),
        io::ErrorKind::OutOfMemory if error.get_ref().is_none() => {
            "the file is larger than the memory; split it".into()
        }
        _ => error.to_string(),
    }
}

fn ending(path: &Path) -> String {
    match path.extension() {
        Some(ending) => format!("files ending in .{} are not known", ending.to_string_lossy()),
        None => "the name has no ending, which selects the format".into(),
    }
}
