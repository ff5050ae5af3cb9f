//! Atomic writing of files: a file is complete or absent.

use std::{
    fs,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use tempfile::NamedTempFile;

use crate::error::WriteError;

/// What the names of temporary files begin and end with.
const TEMPORARY: [&str; 2] = [".forelock-", ".part"];

/// The temporary files and locks of this process.
static TEMPORARIES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn temporaries() -> MutexGuard<'static, Vec<PathBuf>> {
    TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file that [`remove_temporaries`] removes as long as this value lives.
#[derive(Debug)]
pub(crate) struct Temporary(PathBuf);

impl Temporary {
    pub fn new(path: PathBuf) -> Self {
        temporaries().push(path.clone());
        Self(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Removes the file. From then on another process may have one of this name, so it is struck
    /// off the list at the same moment.
    pub fn remove(&self) {
        let mut temporaries = temporaries();
        let _ = fs::remove_file(&self.0);
        temporaries.retain(|own| *own != self.0);
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        temporaries().retain(|own| *own != self.0);
    }
}

/// Removes the temporary files of all writes that are under way in this process, and its locks. The
/// process must end after this: those writes fail.
pub fn remove_temporaries() {
    let mut temporaries = temporaries();
    for path in temporaries.drain(..) {
        let _ = fs::remove_file(path);
    }
    // Writes that fail now wait for the end instead of reporting an error.
    std::mem::forget(temporaries);
}

/// Removes the temporary files that killed processes have left in `folder`. Those of processes that
/// still write are locked, and stay.
pub fn remove_leftovers(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let is_temporary = name.starts_with(TEMPORARY[0]) && name.ends_with(TEMPORARY[1]);
        if is_temporary && !is_locked(&entry.path()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Whether another open file holds a lock on the file at `path`.
fn is_locked(path: &Path) -> bool {
    let lock = fs::File::open(path).map(|file| file.try_lock());
    matches!(lock, Ok(Err(fs::TryLockError::WouldBlock)))
}

/// Writes a file through `write`. The bytes go to a temporary file in the same folder, which is
/// renamed to `path` when it is complete. After an error the temporary file is removed, and an
/// existing file at `path` is unchanged. The folder must exist.
///
/// # Errors
/// [`WriteError`] if the operating system reports an error, `write` fails, or `path` exists and is
/// not a regular file.
pub fn atomic_write(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    check_target(path)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY[0]).suffix(TEMPORARY[1]);
    // Temporary files are private by default. This one becomes an ordinary file, with the
    // permissions that the umask gives.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let file = builder.tempfile_in(folder(path)).map_err(WriteError::io(path))?;
    let _temporary = Temporary::new(file.path().to_path_buf());
    // Without locks, [`remove_leftovers`] of another process may remove the file, and this write
    // ends with an error.
    let _ = file.as_file().try_lock();
    let written = fill(file, write).and_then(|file| Ok(file.persist(path)?));
    written.map(drop).map_err(WriteError::io(path))
}

/// Writes `file` through `write`.
fn fill(
    file: NamedTempFile,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<NamedTempFile> {
    let mut buffered = BufWriter::with_capacity(1 << 16, file);
    write(&mut buffered)?;
    buffered.into_inner().map_err(io::IntoInnerError::into_error)
}

/// The folder that contains `path`.
fn folder(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.into(),
        _ => ".".into(),
    }
}

/// Returns an error if a rename to `path` would replace something other than a file, such as a
/// device.
pub(crate) fn check_target(path: &Path) -> Result<(), WriteError> {
    match fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => {
            Err(WriteError::NotAFile { path: path.into(), what: kind(&metadata) })
        }
        _ => Ok(()),
    }
}

/// A description, for error messages, of something that is not a regular file.
pub(crate) fn kind(metadata: &fs::Metadata) -> &'static str {
    if metadata.is_dir() { "this is a folder" } else { "this is a device or a pipe" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leftovers_are_removed_but_not_files_under_way() {
        let folder = tempfile::tempdir().unwrap();
        let left = folder.path().join(".forelock-left.part");
        fs::write(&left, "half").unwrap();
        let path = folder.path().join("whole");
        atomic_write(&path, |file| {
            file.write_all(b"all")?;
            remove_leftovers(folder.path());
            Ok(())
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"all");
        assert!(!left.exists());
    }
}
