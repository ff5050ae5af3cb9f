//! Distance grids, computed once a mesh and kept in the user's cache folder.
//!
//! The folder is `forelock` in `$XDG_CACHE_HOME`, `~/.cache` or `%LOCALAPPDATA%`, and files are
//! named by a hash of mesh and cell sizes. A file that is missing, damaged or of another version
//! means that the grid is computed again; a folder that cannot be written means that it is computed
//! each time. Neither fails a run.

use std::path::PathBuf;

use forelock_core::body::{ClosedMesh, Sdf, SdfError, TriMesh};

use forelock_core::meter::Meter;

use crate::hash::Fnv;

/// Cells of air around the mesh.
const MARGIN_CELLS: f32 = 4.0;

/// How fine a grid is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CellSizes {
    /// Cells along the mesh's longest side.
    pub along: u32,
    /// Largest side of a cell near the surface, metres; 0 leaves all cells alike.
    pub near: f32,
}

/// The signed distance grid of `mesh`; `meter` counts the steps of computing it.
///
/// # Errors
/// [`SdfError`] if the mesh encloses nothing.
pub(crate) fn load_or_compute(mesh: &TriMesh, cells: CellSizes, meter: &Meter) -> Result<Sdf, SdfError> {
    let path = folder().map(|folder| folder.join(file_name(mesh, cells)));
    if let Some(path) = &path {
        match std::fs::read(path).map(|bytes| Sdf::from_bytes(&bytes)) {
            Ok(Ok(sdf)) => return Ok(sdf),
            Ok(Err(error)) => {
                tracing::info!(path = %path.display(), %error, "computing a distance grid anew")
            }
            Err(error) => tracing::debug!(path = %path.display(), %error, "no distance grid kept"),
        }
    }
    let (lo, hi) = mesh.bounds();
    let padding = MARGIN_CELLS * (hi - lo).max_element() / cells.along as f32;
    let closed = ClosedMesh::new(mesh);
    let near = if cells.near > 0.0 { cells.near } else { f32::INFINITY };
    let sdf = Sdf::near_watched(&closed, cells.along, padding, near, meter)?;
    if let Some(path) = &path {
        let kept = path.parent().map(std::fs::create_dir_all).transpose().is_ok()
            && forelock_io::atomic_write(path, |file| file.write_all(&sdf.to_bytes())).is_ok();
        tracing::info!(path = %path.display(), kept, "computed a distance grid");
    }
    Ok(sdf)
}

fn folder() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute("XDG_CACHE_HOME")
        .or_else(|| absolute("HOME").map(|home| home.join(".cache")))
        .or_else(|| absolute("LOCALAPPDATA"))?;
    Some(base.join("forelock"))
}

fn file_name(mesh: &TriMesh, cells: CellSizes) -> String {
    let mut hash = Fnv::new().bytes(&cells.along.to_le_bytes()).bytes(&cells.near.to_le_bytes());
    for p in &mesh.positions {
        hash = p.to_array().iter().fold(hash, |hash, x| hash.bytes(&x.to_le_bytes()));
    }
    for corners in &mesh.triangles {
        hash = corners.iter().fold(hash, |hash, v| hash.bytes(&v.to_le_bytes()));
    }
    format!("sdf-{:016x}.bin", hash.value())
}
