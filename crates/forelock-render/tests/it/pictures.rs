//! What pictures must show, checked on scenes whose answer is known.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use forelock_core::{body::TriMesh, pose::Pose};
use forelock_render::{
    Ambient, Backdrop, Body, Camera, HairColour, Image, Light, RenderError, Scene, Settings, Strands, render,
};
use glam::{DQuat, DVec3, Vec3};

pub const SIDE: u32 = 128;
/// One pixel at the target's distance, metres.
pub const PX: f32 = 0.001;

/// Looks along −z at the origin; a pixel is `PX` wide there.
fn camera() -> Camera {
    let fov_y = 2.0 * (SIDE as f32 * 0.5 * PX).atan();
    Camera { eye: Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_y }
}

fn grey_backdrop() -> Backdrop {
    Backdrop { top: Vec3::splat(0.5), bottom: Vec3::splat(0.5), vignette: 0.0 }
}

/// Strands exactly as they are, with nothing but ambient light `ambient` from all around.
pub fn plain<'a>(strands: Vec<Strands<'a>>, bodies: Vec<Body<'a>>, ambient: f32) -> (Scene<'a>, Settings) {
    let ambient = Ambient { sky: Vec3::splat(ambient), ground: Vec3::splat(ambient) };
    let scene =
        Scene { bodies, strands, camera: camera(), lights: Vec::new(), ambient, backdrop: grey_backdrop() };
    let settings = Settings {
        width: SIDE,
        height: SIDE,
        width_scale: Some(1.0),
        children: Some(1),
        thinnest: 0.0,
        ..Settings::default()
    };
    (scene, settings)
}

/// Linear light of an 8-bit channel.
pub fn linear(byte: u8) -> f32 {
    let v = f32::from(byte) / 255.0;
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// Pixels' worth of the grey backdrop that black strands take away.
fn covered(image: &Image) -> f32 {
    let (scene, settings) = plain(Vec::new(), Vec::new(), 0.0);
    let empty = render(&scene, &settings).unwrap();
    let pairs = image.rgba().chunks_exact(4).zip(empty.rgba().chunks_exact(4));
    pairs.map(|(seen, behind)| (linear(behind[1]) - linear(seen[1])) / 0.5).sum()
}

/// A line through (`x`, `y`) pixels from the centre at an angle, in `particles` equal steps.
pub fn line(x: f32, y: f32, degrees: f32, length: f32, particles: usize) -> Vec<Vec3> {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let at = |i: usize| (i as f32 / (particles - 1) as f32 - 0.5) * length;
    (0..particles).map(|i| Vec3::new(x + at(i) * cos, y + at(i) * sin, 0.0) * PX).collect()
}

fn draw_lines(lines: &[Vec<Vec3>], width_px: f32) -> Image {
    let positions = lines.concat();
    let mut offsets = vec![0];
    offsets.extend(lines.iter().scan(0, |end, l| {
        *end += l.len() as u32;
        Some(*end)
    }));
    let widths = vec![width_px * PX; positions.len()];
    let strands = Strands { widths: Some(&widths), ..Strands::new(&positions, &offsets, HairColour::BLACK) };
    let (scene, settings) = plain(vec![strands], Vec::new(), 0.0);
    render(&scene, &settings).unwrap()
}

#[test]
fn a_strand_covers_its_width_times_its_length() {
    // The filter is exact except at the ends. Eight bits a channel have an error of a third of a
    // level, which counts for more the less a strand covers.
    for width in [0.08, 0.4, 0.9, 2.5] {
        for (angle, tolerance) in [(0.0, 0.01), (90.0, 0.01), (30.0, 0.015), (45.0, 0.015), (80.0, 0.015)] {
            for offset in [0.0, 0.13, 0.25, 0.5, 0.77] {
                let image = draw_lines(&[line(offset, offset, angle, 90.3, 2)], width);
                let (found, expected) = (covered(&image), width * 90.3);
                assert!(
                    (found / expected - 1.0).abs() < tolerance + 0.003 / width,
                    "{found} instead of {expected} at {angle}° {offset}"
                );
            }
        }
    }
}

#[test]
fn joints_between_particles_leave_no_trace() {
    for angle in [0.0, 20.0, 45.0, 100.0] {
        let whole = draw_lines(&[line(0.2, 0.3, angle, 90.0, 2)], 0.7);
        let jointed = draw_lines(&[line(0.2, 0.3, angle, 90.0, 31)], 0.7);
        let worst = whole.rgba().iter().zip(jointed.rgba()).map(|(a, b)| a.abs_diff(*b)).max();
        // A centre that falls on a joint may go to either piece; never to both or none.
        assert!(worst <= Some(2), "{worst:?} at {angle}°");
    }
}

/// A square of half side 50 pixels in front of or behind the target plane.
fn plate(z: f32) -> TriMesh {
    let corner = |x: f32, y: f32| Vec3::new(x * 50.0 * PX, y * 50.0 * PX, z);
    let corners = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    TriMesh::new(corners, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
}

#[test]
fn a_body_hides_what_is_behind_it_and_no_more() {
    let positions = line(0.0, 0.0, 0.0, 120.0, 5);
    let (offsets, widths) = ([0, 5], vec![3.0 * PX; 5]);
    let strands = Strands { widths: Some(&widths), ..Strands::new(&positions, &offsets, HairColour::BLACK) };
    let shot = |z: f32, strands: Vec<Strands<'_>>| {
        let mesh = plate(z);
        let (scene, settings) = plain(strands, vec![Body::new(&mesh, Pose::IDENTITY)], 1.0);
        render(&scene, &settings).unwrap()
    };
    let centre = |image: &Image| image.pixel(64, 64);
    let (behind, before) = (shot(0.01, vec![strands]), shot(-0.01, vec![strands]));
    assert_eq!(centre(&behind), centre(&shot(0.01, Vec::new())));
    assert!(centre(&before)[0] < centre(&shot(-0.01, Vec::new()))[0] / 2);
    // Beside the plate the strand is seen either way.
    assert!(behind.pixel(8, 64)[0].abs_diff(before.pixel(8, 64)[0]) <= 2);
    assert!(linear(behind.pixel(8, 64)[1]) < 0.1);
}

#[test]
fn the_nearer_of_two_crossing_strands_is_seen() {
    for near_is_level in [true, false] {
        let raise = if near_is_level { 0.002 } else { -0.002 };
        let mut level = line(0.0, 0.0, 0.0, 80.0, 6);
        level.iter_mut().for_each(|p| p.z += raise);
        let positions = [level, line(0.0, 0.0, 90.0, 80.0, 6)].concat();
        let (offsets, widths) = ([0, 6, 12], vec![6.0 * PX; 12]);
        let colours: Vec<_> =
            (0..12).map(|i| if i < 6 { [0.9, 0.01, 0.01] } else { [0.01, 0.9, 0.01] }).collect();
        let strands = Strands {
            widths: Some(&widths),
            colours: Some(&colours),
            ..Strands::new(&positions, &offsets, HairColour::BLACK)
        };
        let (scene, settings) = plain(vec![strands], Vec::new(), 1.0);
        let image = render(&scene, &settings).unwrap();
        let [red, green, ..] = image.pixel(64, 64);
        assert_eq!(red > 2 * green, near_is_level, "red {red}, green {green}");
        assert_eq!(green > 2 * red, !near_is_level);
    }
}

/// A block of strands along y, 40 × 40 over 60 × 60 pixels.
fn block() -> (Vec<Vec3>, Vec<u32>) {
    let strand = |i: usize| {
        let (x, z) = ((i % 40) as f32 * 1.5 - 30.0, (i / 40) as f32 * 1.5 - 30.0);
        (0..5).map(move |j| Vec3::new(x, j as f32 * 15.0 - 30.0, z) * PX)
    };
    ((0..1600).flat_map(strand).collect(), (0..=1600).map(|i| i * 5).collect())
}

#[test]
fn hair_shadows_its_far_side() {
    let (positions, offsets) = block();
    let widths = vec![0.3 * PX; positions.len()];
    let brightness = |shadows: bool| {
        let strands =
            Strands { widths: Some(&widths), ..Strands::new(&positions, &offsets, HairColour::BLONDE) };
        let (mut scene, settings) = plain(vec![strands], Vec::new(), 0.0);
        let direction = Vec3::NEG_X;
        scene.lights = vec![Light { direction, colour: Vec3::splat(2.0), shadows }];
        let image = render(&scene, &settings).unwrap();
        [40, 88].map(|x| (50..78).map(|y| linear(image.pixel(x, y)[0])).sum::<f32>())
    };
    let ([lit, dark], [left, right]) = (brightness(true), brightness(false));
    assert!(dark < 0.5 * lit, "lit side {lit}, far side {dark}");
    assert!((left / right - 1.0).abs() < 0.15, "without shadows {left} and {right}");
}

#[test]
fn hair_shadows_a_body() {
    let (mut positions, offsets) = block();
    positions.iter_mut().for_each(|p| p.y += 70.0 * PX);
    let mesh = plate(-0.01);
    let shot = |strands: Vec<Strands<'_>>| {
        let (mut scene, settings) = plain(strands, vec![Body::new(&mesh, Pose::IDENTITY)], 0.0);
        let direction = Vec3::new(0.0, 1.0, 0.6);
        scene.lights = vec![Light { direction, colour: Vec3::ONE, shadows: true }];
        linear(render(&scene, &settings).unwrap().pixel(64, 64)[1])
    };
    let shaded = shot(vec![Strands::new(&positions, &offsets, HairColour::BLACK)]);
    let thick = vec![0.6 * PX; positions.len()];
    let darker =
        shot(vec![Strands { widths: Some(&thick), ..Strands::new(&positions, &offsets, HairColour::BLACK) }]);
    assert!(darker < shaded && shaded < shot(Vec::new()) && darker < 0.5 * shot(Vec::new()));
}

#[test]
fn an_empty_scene_is_its_backdrop() {
    let (scene, settings) = plain(Vec::new(), Vec::new(), 1.0);
    let empty = render(&scene, &settings).unwrap();
    assert!(empty.rgba().chunks_exact(4).all(|p| p[..3].iter().all(|v| v.abs_diff(188) <= 1)));
    // Nothing that can be drawn: behind the camera, not finite, one particle, none.
    let behind = line(0.0, 0.0, 10.0, 50.0, 4).into_iter().map(|p| p + Vec3::Z * 1.5);
    let broken = [Vec3::ZERO, Vec3::new(f32::NAN, 0.0, 0.0), Vec3::X * PX];
    let single = [Vec3::ZERO];
    let positions: Vec<_> = behind.chain(broken).chain(single).collect();
    let strands = Strands::new(&positions, &[0, 4, 7, 8, 8], HairColour::BLACK);
    let none = Strands::new(&[], &[], HairColour::BLACK);
    let (scene, settings) = plain(vec![strands, none], Vec::new(), 1.0);
    assert!(render(&scene, &settings).unwrap() == empty);
}

#[test]
fn absurd_sizes_do_no_harm() {
    for size in [1e-30, 1e12, 1e25, 3e38] {
        let positions = [Vec3::ZERO, Vec3::X * size, Vec3::NEG_ONE * size, Vec3::ZERO];
        let strands = Strands::new(&positions, &[0, 2, 4], HairColour::RED);
        let corners = vec![Vec3::NEG_ONE * size, Vec3::X * size, Vec3::Y * size];
        let mesh = TriMesh::new(corners, vec![[0, 1, 2], [0, 0, 1]]).unwrap();
        for camera in [camera(), Camera::framing(mesh.bounds(), 0.3, 0.2)] {
            let scene = Scene::new(vec![Body::new(&mesh, Pose::IDENTITY)], vec![strands], camera);
            let result = render(&scene, &Settings { width: 40, height: 40, ..Settings::default() });
            assert!(matches!(result, Ok(_) | Err(RenderError::Camera(_))));
        }
    }
}

#[test]
fn a_wide_strand_is_whole_across_tiles() {
    let image = draw_lines(&[line(3.0, 0.0, 90.0, 200.0, 9)], 38.0);
    let row: Vec<_> = (0..SIDE).map(|x| linear(image.pixel(x, 70)[1]) < 0.1).collect();
    assert_eq!(row.iter().filter(|&&dark| dark).count(), 38);
}

#[test]
fn threads_do_not_change_the_picture() {
    let (positions, offsets) = block();
    let mesh = plate(-0.02);
    let pose = Pose::new(DQuat::from_rotation_y(0.4), DVec3::new(0.01, 0.0, 0.0));
    let groups = [HairColour::RED, HairColour::WHITE].map(|c| Strands::new(&positions, &offsets, c));
    let scene = Scene::new(vec![Body::new(&mesh, pose)], groups.to_vec(), camera());
    let settings = Settings { width: 130, height: 70, ..Settings::default() };
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render(&scene, &settings)).unwrap()
    });
    assert!(one == three);
    let other = render(&scene, &Settings { seed: 2, ..settings }).unwrap();
    assert!(one != other, "the seed varies strands");
}

#[test]
fn every_size_in_the_limits_is_drawn() {
    let (positions, offsets) = block();
    let mesh = plate(0.9);
    let strands = vec![Strands::new(&positions, &offsets, HairColour::CHESTNUT)];
    let scene = Scene::new(vec![Body::new(&mesh, Pose::IDENTITY)], strands, camera());
    for (width, height) in [(1, 1), (33, 2), (4096, 1), (1, 4096)] {
        for samples in [1, 3] {
            let image = render(&scene, &Settings { width, height, samples, ..Settings::default() }).unwrap();
            assert_eq!((image.width(), image.height()), (width, height));
        }
    }
}

/// Many thin strands cover as much when fewer of them are drawn, and change little as they become
/// fewer.
#[test]
fn fewer_strands_cover_as_much() {
    let mut points = Vec::new();
    for i in 0..20_000_u32 {
        let place = |k: u32| (i.wrapping_mul(k) >> 8) as f32 / 16_777_216.0 - 0.5;
        let at = Vec3::new(place(2_654_435_769), place(1_640_531_527), place(805_459_861)) * 0.1;
        points.extend([at, at + Vec3::new(0.003, 0.01, 0.0)]);
    }
    let offsets: Vec<u32> = (0..=20_000).map(|i| 2 * i).collect();
    let strands = Strands { width: 1e-5, ..Strands::new(&points, &offsets, HairColour::BLACK) };
    let (scene, settings) = plain(vec![strands], Vec::new(), 0.0);
    // A strand is a hundredth of a pixel wide.
    let drawn = |thinnest: f32| render(&scene, &Settings { thinnest, ..settings }).unwrap();
    let (all, some, few) = (drawn(0.0), drawn(0.03), drawn(0.08));
    let area = covered(&all);
    assert!(area > 500.0, "{area}");
    assert_ne!(all, few);
    for fewer in [&some, &few] {
        assert!((covered(fewer) / area - 1.0).abs() < 0.03, "{} of {area}", covered(fewer));
    }
    let nearly = drawn(0.0805);
    let pairs = few.rgba().iter().zip(nearly.rgba());
    assert!(pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap() < 40);
    // Close up they are half a pixel wide, and nothing is left out.
    let camera = Camera { eye: Vec3::Z * 0.07, ..scene.camera };
    let close = Scene { camera, ..scene.clone() };
    let [with, without] =
        [0.08, 0.0].map(|thinnest| render(&close, &Settings { thinnest, ..settings }).unwrap());
    assert_eq!(with, without);
}

#[test]
fn bad_input_is_named() {
    let (scene, settings) = plain(Vec::new(), Vec::new(), 1.0);
    let draw = |settings: Settings| render(&scene, &settings).unwrap_err();
    assert!(matches!(draw(Settings { width: 0, ..settings }), RenderError::Image(_)));
    assert!(matches!(draw(Settings { height: 4097, ..settings }), RenderError::Image(_)));
    let named =
        |settings, field: &str| matches!(draw(settings), RenderError::Setting { name, .. } if name == field);
    assert!(named(Settings { samples: 5, ..settings }, "samples"));
    assert!(named(Settings { children: Some(0), ..settings }, "children"));
    assert!(named(Settings { width_scale: Some(f32::NAN), ..settings }, "width_scale"));
    assert!(named(Settings { exposure: 0.0, ..settings }, "exposure"));
    assert!(named(Settings { thinnest: f32::NAN, ..settings }, "thinnest"));

    let blind = Scene { camera: Camera { eye: Vec3::ZERO, ..camera() }, ..scene.clone() };
    assert!(matches!(render(&blind, &settings), Err(RenderError::Camera(_))));
    let points = [Vec3::ZERO; 3];
    let with = |strands| render(&Scene { strands: vec![strands], ..scene.clone() }, &settings).unwrap_err();
    for offsets in [&[0, 4][..], &[0, 2], &[0, 3, 2, 3]] {
        assert!(matches!(
            with(Strands::new(&points, offsets, HairColour::RED)),
            RenderError::Offsets { group: 0 }
        ));
    }
    let short = Strands { widths: Some(&[1.0]), ..Strands::new(&points, &[0, 3], HairColour::RED) };
    assert!(matches!(
        with(short),
        RenderError::AttributeLength { name: "widths", expected: 3, found: 1, .. }
    ));
    let mesh = TriMesh { positions: vec![Vec3::ZERO], triangles: vec![[0, 0, 1]] };
    let torn = Scene { bodies: vec![Body::new(&mesh, Pose::IDENTITY)], ..scene.clone() };
    assert!(matches!(render(&torn, &settings), Err(RenderError::Triangle { body: 0, triangle: 0 })));
}
