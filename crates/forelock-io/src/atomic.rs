//! Atomic writing of files: a file is complete or absent.

use std::{
    fs,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use crate::error::WriteError;

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
    builder.prefix(".forelock-").suffix(".part");
    // Temporary files are private by default. This one becomes an ordinary file, with the
    // permissions that the umask gives.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let file = builder.tempfile_in(folder(path)).map_err(WriteError::io(path))?;
    let mut buffered = BufWriter::with_capacity(1 << 16, file);
    write(&mut buffered).map_err(WriteError::io(path))?;
    let file = buffered.into_inner().map_err(|e| WriteError::io(path)(e.into_error()))?;
    file.persist(path).map_err(|e| WriteError::io(path)(e.error))?;
    Ok(())
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
