//! Pictures of hair, drawn on the CPU without a GPU or system libraries, or on a GPU: stills,
//! contact sheets and short films.
//!
//! ```
//! use forelock_core::{body::TriMesh, groom::Groom, pose::Pose};
//! use forelock_render::{Body, Camera, HairColour, Scene, Settings, Strands, render};
//! use glam::Vec3;
//!
//! let point = |x: f32, i: usize| Vec3::new(x, 0.1 - 0.02 * i as f32, 0.02);
//! let strand = |x: f32| (0..8).map(|i| point(x, i)).collect::<Vec<_>>();
//! let groom = Groom::from_strands((0..40).map(|i| strand(0.002 * i as f32 - 0.04)))?;
//! let corners = [[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.0, 0.1, 0.0]];
//! let board = TriMesh::new(corners.map(Vec3::from_array).to_vec(), vec![[0, 1, 2]])?;
//!
//! let camera = Camera::framing(board.bounds(), 0.4, 0.1);
//! let bodies = vec![Body::new(&board, Pose::IDENTITY)];
//! let scene = Scene::new(bodies, vec![Strands::from_groom(&groom, HairColour::RED)], camera);
//! let image = render(&scene, &Settings { width: 96, height: 96, ..Settings::default() })?;
//! assert_eq!(image.to_png()?[1..4], *b"PNG");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Theory
//! The modules document the methods:
//!
//! - [`hair`]: curves, widths and children;
//! - `raster`: coverage and compositing order (Gupta & Sproull 1981; Porter & Duff 1984);
//! - `fibre`: scattering of a hair (Marschner et al. 2003; Karis 2016) and of all around it (Zinke
//!   et al. 2008);
//! - `volume`: hair as a medium that casts shadows on itself (after Yuksel & Keyser 2008);
//! - [`colour`]: melanin, tone curve and sRGB.
//!
//! # Practice
//! The picture is divided into tiles of 32 × 32 pixels. Projection, shadows and ambient occlusion
//! are computed first, for the whole scene. Then each tile samples its bodies, sorts its pieces of
//! strands, composites them from front to back, and lights only the visible ones. Memory grows with
//! the number of particles (16 bytes for each drawn particle), not with the number of fragments.
//!
//! The feature `gpu` adds the module `gpu`, which draws the same picture on a wgpu device.
//!
//! # Limitations
//! How much hair is behind a point is estimated from the share of ambient light that reaches it.
//! Bodies do not reflect light onto hair. There is no depth of field and no motion blur. A scaled
//! scene gives the same picture only if the widths of its strands are scaled too.

pub mod camera;
pub mod colour;
mod drawable;
mod face;
mod fibre;
pub mod film;
mod font;
#[cfg(feature = "gpu")]
pub mod gpu;
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
pub use colour::{HairColour, from_srgb};
pub use film::Film;
pub use image::{Image, ImageError, MAX_SIDE};
pub use light::{Ambient, Light};
pub use scene::{Backdrop, Body, Face, HAIR_WIDTH, RenderError, Scalp, Scene, Settings, Strands};
pub use sheet::{Labelled, contact_sheet};

use rayon::prelude::*;

/// Draws `scene`.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// [`RenderError`] for a size or setting out of range, an unusable camera, or arrays that do not
/// match each other.
pub fn render(scene: &Scene<'_>, settings: &Settings) -> Result<Image, RenderError> {
    scene.check(settings)?;
    let Settings { width, height, .. } = *settings;
    let view = camera::View::new(&scene.camera, width, height);
    let grid = tiles::TileGrid::new(width, height);
    let solids = solids::Solids::new(&scene.bodies, &view, grid)?;
    let hair = hair::Hair::new(scene, settings, &view, grid);
    let lighting = lighting::Lighting::new(scene, &solids, hair.groups(), [width, height]);
    let frame = raster::Frame { settings: *settings, view, backdrop: scene.backdrop, solids, hair, lighting };

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
