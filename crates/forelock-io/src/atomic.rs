//! Files that appear whole or not at all.

use std::{
    fs,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use crate::error::WriteError;

/// Writes a file through `write`: beside its name first, renamed when whole. On an error nothing is left
/// behind and a file that stood there before is untouched. The folder must exist.
///
/// # Errors
/// [`WriteError`] if the folder or disk refuses, `write` fails, or the name belongs to something that is not
/// a file.
pub fn atomic_write(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    check_target(path)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(".forelock-").suffix(".part");
    // Temporary files are private by default; this one becomes an ordinary file, so the umask decides.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let file = builder.tempfile_in(folder(path)).map_err(WriteError::io(path))?;
    let mut buffered = BufWriter::with_capacity(1 << 16, file);
    write(&mut buffered).map_err(WriteError::io(path))?;
    let file = buffered.into_inner().map_err(|e| WriteError::io(path)(e.into_error()))?;
    file.persist(path).map_err(|e| WriteError::io(path)(e.error))?;
    Ok(())
}

/// The folder in which `path` lies.
fn folder(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.into(),
        _ => ".".into(),
    }
}

/// Refuses names at which a rename would replace something other than a file, a device say.
pub(crate) fn check_target(path: &Path) -> Result<(), WriteError> {
    match fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => {
            Err(WriteError::NotAFile { path: path.into(), what: kind(&metadata) })
        }
        _ => Ok(()),
    }
}

/// What something that is not a file is.
pub(crate) fn kind(metadata: &fs::Metadata) -> &'static str {
    if metadata.is_dir() { "this is a folder" } else { "this is a device or a pipe" }
}
