//! Files for other programs, made from the finished cache of a run.

use std::path::{Path, PathBuf};

use forelock_core::groom::{Groom, Import};
use forelock_io::animation::{AnimationError, AnimationReader, convert};

use super::RunError;
use crate::progress::{Observer, Progress};
use crate::scene::Scene;

/// Where they go.
pub(super) fn paths(scene: &Scene, out: &Path) -> Vec<PathBuf> {
    scene.output.exports.iter().map(|name| out.join(name)).collect()
}

/// Writes them from the cache at `cache`, with the attributes of `groom`.
///
/// # Errors
/// [`RunError::Export`].
pub(super) fn write(
    scene: &Scene,
    groom: &Groom,
    cache: &Path,
    out: &Path,
    observer: &mut Observer<'_>,
) -> Result<Vec<PathBuf>, RunError> {
    let paths = paths(scene, out);
    for path in &paths {
        // A folder that cannot be made is told by the writer.
        let _ = path.parent().map(std::fs::create_dir_all);
        let reader = AnimationReader::open(cache, &Import::default()).map_err(AnimationError::from)?;
        let mut reader = reader.with_attributes_of(groom);
        let total = reader.times_secs().len() as u64;
        observer(&Progress::Begin { what: "exporting", done: 0, total });
        convert(&mut reader, path, true, &mut |_| observer(&Progress::Step))?;
        observer(&Progress::End);
    }
    Ok(paths)
}
