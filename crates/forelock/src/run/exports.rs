//! Files for other programs, made from the finished cache of a run.

use std::path::{Path, PathBuf};

use forelock_core::groom::{Groom, Import};
use forelock_io::animation::{AnimationError, AnimationReader, convert};

use super::overwrite::check_outputs;
use super::{RunError, SNAPSHOT, cache_path};
use crate::progress::{Observer, Progress};
use crate::scene::Scene;

/// Where they go.
pub(super) fn paths(scene: &Scene, out: &Path) -> Vec<PathBuf> {
    scene.output.exports.iter().map(|name| out.join(name)).collect()
}

/// Checks that a run of `scene` into the folder `out` would write no file that it reads, and none
/// twice. It does so itself when it begins, but one of a part of the frames makes no exports, and
/// would leave these to the last part.
///
/// # Errors
/// [`RunError::Overwrites`].
pub(crate) fn check_written(scene: &Scene, out: &Path) -> Result<(), RunError> {
    let others = [Some(out.join(SNAPSHOT)), cache_path(scene, out)];
    let outputs: Vec<PathBuf> = others.into_iter().flatten().chain(paths(scene, out)).collect();
    let outputs: Vec<&Path> = outputs.iter().map(PathBuf::as_path).collect();
    check_outputs(scene, &outputs)
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
        let start_secs = f64::from(scene.output.first_frame) / scene.time.fps;
        let mut reader = reader.with_attributes_of(groom).later(start_secs);
        let total = reader.times_secs().len() as u64;
        observer(&Progress::Begin { what: "exporting", done: 0, total });
        convert(&mut reader, path, true, &mut |_| observer(&Progress::Step))?;
        observer(&Progress::End);
    }
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use forelock_core::groom::Labels;
    use forelock_io::CacheWriter;
    use glam::Vec3;

    use super::*;

    #[test]
    fn exports_have_the_attributes_of_the_groom_and_the_times_of_the_cache() {
        let folder = tempfile::tempdir().unwrap();
        let mut groom = Groom::from_strands([[Vec3::ZERO, Vec3::Y], [Vec3::X, Vec3::Z]]).unwrap();
        groom.colours = Some(vec![[0.25, 0.5, 0.75]; 4]);
        groom.labels = Labels {
            ids: Some(vec![3, 8]),
            group_ids: Some(vec![1, 2]),
            guides: Some(vec![true, false]),
            closest_guides: Some(vec![[3; 3]; 2]),
            guide_weights: Some(vec![[0.5, 0.25, 0.25]; 2]),
        };
        let cache = folder.path().join("hair.npz");
        let mut writer = CacheWriter::create(&cache, groom.strand_offsets(), &[]).unwrap();
        for frame in 4..7 {
            writer.append(f64::from(frame) / 24.0, groom.positions()).unwrap();
        }
        writer.finish().unwrap();

        let mut scene = Scene::default();
        scene.output.exports = vec!["hair.abc".into(), "for/hair.usdc".into(), "hair.glb".into()];
        (scene.output.first_frame, scene.time.fps) = (3, 24.0);
        let paths = write(&scene, &groom, &cache, folder.path(), &mut |_| {}).unwrap();
        // Tests of the writer look into a `.glb`.
        assert!(std::fs::read(&paths[2]).unwrap().starts_with(b"glTF"));
        for path in &paths[..2] {
            let reader = AnimationReader::open(path, &Import::default()).unwrap();
            assert_eq!(reader.groom().labels, groom.labels);
            assert_eq!(reader.groom().colours, groom.colours);
            for (frame, time) in (7..10).zip(reader.times_secs()) {
                assert!((time - f64::from(frame) / 24.0).abs() < 1e-9, "{}: {time}", path.display());
            }
        }
    }
}
