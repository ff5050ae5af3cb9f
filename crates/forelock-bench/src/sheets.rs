//! The AMS paper's two explorations of growth (Figs. 13 and 14), as pictures.

use std::path::{Path, PathBuf};

use forelock_core::groom::grow::{Sheet, grow_on_head, sheets};

use crate::BenchError;
use forelock::Scene;
use forelock::{AssetError, Assets};
use forelock::{Observer, Progress};
use forelock::{Studio, labelled, write_picture};

/// Draws both sheets into `folder`, which is made if it is not there, and returns the pictures'
/// names.
///
/// # Errors
/// [`BenchError`] if the folder cannot be made or a picture not be written.
pub fn growth_sheets(folder: &Path, observer: &mut Observer<'_>) -> Result<Vec<PathBuf>, BenchError> {
    std::fs::create_dir_all(folder)
        .map_err(|error| BenchError::Folder { path: folder.to_path_buf(), error })?;
    let mut written = Vec::new();
    for sheet in &sheets() {
        let path = folder.join(format!("{}.png", sheet.name));
        observer(&Progress::Begin { what: sheet.title, done: 0, total: sheet.cells.len() as u64 });
        draw(sheet, &path, observer)?;
        observer(&Progress::End);
        written.push(path);
    }
    Ok(written)
}

fn draw(sheet: &Sheet, path: &Path, observer: &mut Observer<'_>) -> Result<(), BenchError> {
    let mut scene = Scene::default();
    (scene.output.width, scene.output.height) = (320, 320);
    let columns = sheet.columns.len();
    let mut pictures = Vec::with_capacity(sheet.cells.len());
    for (index, params) in sheet.cells.iter().enumerate() {
        let groom = grow_on_head(params).map_err(AssetError::from)?;
        let assets = Assets::around(&scene, groom)?;
        let image = Studio::new(&scene, &assets).picture(assets.groom.positions(), 0.0, 1.0)?;
        // The labels' letters are Latin.
        let label = format!("{}  {}", sheet.rows[index / columns], sheet.columns[index % columns])
            .replace('τ', "tau")
            .replace('γ', "gamma");
        pictures.push((image, label));
        observer(&Progress::Step);
    }
    let columns = u32::try_from(columns).unwrap_or(1);
    let image = labelled(&pictures, columns)?;
    Ok(write_picture(path, &image)?)
}
