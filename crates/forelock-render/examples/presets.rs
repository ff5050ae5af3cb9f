//! Draws grown hair from all sides and close up.
//!
//! ```sh
//! cargo run --release -p forelock-render --example presets -- FOLDER [PRESET …]
//! ```
//!
//! writes one sheet for each preset, `FOLDER/PRESET.png`, or for the presets named. Without names
//! it writes one picture of all as well, `FOLDER/presets.jpg`, and one of the colours of hair,
//! `FOLDER/colours.jpg`.
//! `STRANDS`, `SEED` and `SIZE` in the environment change the number of strands, the seed and the
//! side of a picture in pixels.

#![expect(clippy::print_stdout, reason = "an example that says what it draws")]

use std::path::Path;

use forelock_core::body::{Head, Region};
use forelock_core::groom::Groom;
use forelock_core::groom::grow::{GrowParams, PRESETS, grow_on_head};
use forelock_core::pose::Pose;
use forelock_render::{
    Body, Camera, Face, HairColour, Image, Labelled, Scene, Settings, Strands, contact_sheet, from_srgb,
    render,
};
use glam::{Vec3, vec3};

/// A view: label, yaw and pitch in degrees, the point looked at and the height of the picture there
/// in metres.
struct View(&'static str, f32, f32, Vec3, f32);

const WHOLE: Vec3 = vec3(0.0, -0.05, -0.02);
const FACE: Vec3 = vec3(0.0, -0.01, 0.0);

/// Views of hair on the scalp.
const SCALP: [View; 12] = [
    View("front", 0.0, 3.0, WHOLE, 0.48),
    View("three quarters", 40.0, 6.0, WHOLE, 0.48),
    View("left", 90.0, 3.0, WHOLE, 0.48),
    View("back", 180.0, 6.0, WHOLE, 0.48),
    View("right", 270.0, 3.0, WHOLE, 0.48),
    View("three quarters back", 215.0, 15.0, WHOLE, 0.48),
    View("hairline", 15.0, 8.0, vec3(0.01, 0.05, 0.06), 0.18),
    View("ear and cheek", 65.0, 0.0, vec3(0.06, -0.03, 0.01), 0.2),
    View("throat", 12.0, -5.0, vec3(0.0, -0.15, 0.03), 0.26),
    View("nape", 195.0, 20.0, vec3(0.0, -0.14, -0.07), 0.3),
    View("shoulder", 120.0, 25.0, vec3(0.08, -0.16, -0.04), 0.3),
    View("crown", 200.0, 65.0, vec3(0.0, 0.08, -0.02), 0.3),
];

/// Views of the beard.
const BEARD: [View; 6] = [
    View("front", 0.0, 3.0, FACE, 0.34),
    View("three quarters", 40.0, 0.0, FACE, 0.34),
    View("left", 90.0, 3.0, FACE, 0.34),
    View("mouth", 10.0, 5.0, vec3(0.0, -0.08, 0.08), 0.16),
    View("cheek", 65.0, 0.0, vec3(0.06, -0.06, 0.03), 0.16),
    View("throat", 15.0, -25.0, vec3(0.0, -0.11, 0.05), 0.2),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (folder, names) = arguments.split_first().ok_or("name a folder")?;
    std::fs::create_dir_all(folder)?;
    if names.is_empty() {
        gallery(folder)?;
        colours(folder)?;
    }
    let all = PRESETS.map(str::to_owned);
    for name in if names.is_empty() { &all[..] } else { names } {
        let mut params = GrowParams::preset(name)?;
        params.strands = number("STRANDS")?.unwrap_or(params.strands);
        params.seed = number("SEED")?.unwrap_or(1).into();
        let started = std::time::Instant::now();
        let groom = grow_on_head(&params)?;
        println!("{name}: grown in {:.0} ms", started.elapsed().as_secs_f64() * 1e3);
        let views = if params.region == Region::Beard { &BEARD[..] } else { &SCALP[..] };
        let only = std::env::var("VIEWS").unwrap_or_default();
        let wanted = views.iter().filter(|view| only.is_empty() || only.split(',').any(|o| o == view.0));
        let pictures: Result<Vec<_>, Box<dyn std::error::Error>> =
            wanted.map(|view| Ok((picture(&groom, view)?, view.0))).collect();
        let pictures = pictures?;
        let pictures: Vec<_> = pictures.iter().map(|(image, label)| Labelled { image, label }).collect();
        for (part, pictures) in pictures.chunks(6).enumerate() {
            let path = Path::new(folder).join(format!("{name}-{part}.png"));
            std::fs::write(&path, contact_sheet(pictures, 3)?.to_png()?)?;
        }
    }
    Ok(())
}

/// One picture of each preset, filled by the hair.
fn gallery(folder: &str) -> Result<(), Box<dyn std::error::Error>> {
    let mut pictures = Vec::new();
    for name in PRESETS {
        let groom = grow_on_head(&GrowParams::preset(name)?)?;
        let yaw: f32 = if name == "ponytail" { 1.3 } else { 0.6 };
        pictures.push((draw(&groom, HairColour::CHESTNUT, framing(&groom, yaw))?, name));
    }
    write_sheet(&pictures, 3, &Path::new(folder).join("presets.jpg"))
}

/// Wavy hair in each colour, and dyed.
fn colours(folder: &str) -> Result<(), Box<dyn std::error::Error>> {
    let groom = grow_on_head(&GrowParams { strands: 10_000, ..GrowParams::preset("wavy")? })?;
    let camera = framing(&groom, 0.9);
    let dyed = HairColour { dye: from_srgb(vec3(0.2, 0.45, 0.75)), ..HairColour::WHITE };
    let named = HairColour::NAMES.iter().filter_map(|&name| Some((HairColour::by_name(name)?, name)));
    let pictures: Result<Vec<_>, Box<dyn std::error::Error>> = named
        .chain([(dyed, "dyed")])
        .map(|(colour, name)| Ok((draw(&groom, colour, camera)?, name)))
        .collect();
    write_sheet(&pictures?, 4, &Path::new(folder).join("colours.jpg"))
}

fn framing(groom: &Groom, yaw: f32) -> Camera {
    let points = groom.positions().iter();
    let bounds = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), &p| (l.min(p), h.max(p)));
    let mut camera = Camera::framing(bounds, yaw, 0.08);
    camera.eye = camera.target + 0.8 * (camera.eye - camera.target);
    camera
}

fn write_sheet(
    pictures: &[(Image, &str)],
    columns: u32,
    path: &Path,
) -> Result<(), Box<dyn std::error::Error>> {
    let pictures: Vec<_> = pictures.iter().map(|(image, label)| Labelled { image, label }).collect();
    Ok(std::fs::write(path, contact_sheet(&pictures, columns)?.to_jpeg()?)?)
}

fn number(variable: &str) -> Result<Option<u32>, std::num::ParseIntError> {
    std::env::var(variable).ok().map(|text| text.parse()).transpose()
}

fn picture(groom: &Groom, view: &View) -> Result<Image, Box<dyn std::error::Error>> {
    let &View(_, yaw, pitch, target, height) = view;
    let (yaw, pitch) = (yaw.to_radians(), pitch.to_radians());
    let fov_y = 0.42f32;
    let direction = vec3(yaw.sin() * pitch.cos(), pitch.sin(), yaw.cos() * pitch.cos());
    let distance = 0.5 * height / (0.5 * fov_y).tan();
    let camera = Camera { eye: target + direction * distance, target, up: Vec3::Y, fov_y };
    draw(groom, HairColour::CHESTNUT, camera)
}

fn draw(groom: &Groom, colour: HairColour, camera: Camera) -> Result<Image, Box<dyn std::error::Error>> {
    let head = &Head::builtin().mesh;
    let face = Some(Face { rest: &head.positions, brows: colour.albedo() });
    let body = Body { face, ..Body::new(head, Pose::IDENTITY) };
    let scene = Scene::new(vec![body], vec![Strands::from_groom(groom, colour)], camera);
    let size = number("SIZE")?.unwrap_or(480);
    Ok(render(&scene, &Settings { width: size, height: size, ..Settings::default() })?)
}
