//! Pictures of hair without a GPU or any system library.

pub mod camera;
pub mod colour;
mod fibre;
mod font;
pub mod hair;
pub mod image;
pub mod light;
mod lighting;
mod random;
mod raster;
pub mod scene;
mod shadow_map;
pub mod sheet;
mod solids;
mod tiles;
mod volume;

pub use camera::Camera;
pub use colour::HairColour;
pub use image::{Image, ImageError, MAX_SIDE};
pub use light::{Ambient, Light};
pub use scene::{Backdrop, Body, HAIR_WIDTH, RenderError, Scene, Settings, Strands};
pub use sheet::{Labelled, contact_sheet};

use rayon::prelude::*;

/// Draws `scene`.
///
/// The result depends on the inputs alone, not on the number of threads.
///
/// # Errors
/// [`RenderError`] for a size or setting out of range, an unusable camera, or arrays that do not fit together.
pub fn render(scene: &Scene<'_>, settings: &Settings) -> Result<Image, RenderError> {
    settings.check()?;
    if !scene.camera.is_valid() {
        return Err(RenderError::Camera(scene.camera));
    }
    for (group, strands) in scene.strands.iter().enumerate() {
        strands.check(group)?;
    }
    let Settings { width, height, .. } = *settings;
    let view = camera::View::new(&scene.camera, width, height);
    let grid = tiles::TileGrid::new(width, height);
    let solids = solids::Solids::new(&scene.bodies, &view, grid)?;
    let hair = hair::Hair::new(scene, settings, &view, grid);
    let lighting = lighting::Lighting::new(scene, &solids, &hair);
    let frame =
        raster::Frame { settings: *settings, view, backdrop: scene.backdrop, solids, hair, lighting };

    let tiles: Vec<_> = (0..grid.len())
        .into_par_iter()
        .map_init(raster::Tile::default, |tile, index| {
            tile.draw(&frame, index, index as u32 % grid.columns, index as u32 / grid.columns)
        })
        .collect();
    let mut image = Image::filled(width, height, [0, 0, 0, 255])?;
    for (index, pixels) in tiles.into_iter().enumerate() {
        let (x, y) = (index as u32 % grid.columns * tiles::TILE, index as u32 / grid.columns * tiles::TILE);
        let tile = Image::from_rgba(tiles::TILE, tiles::TILE, pixels.into_flattened())?;
        image.paste(&tile, x, y);
    }
    Ok(image)
}
