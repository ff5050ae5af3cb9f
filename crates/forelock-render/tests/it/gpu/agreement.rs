//! The GPU's picture against the CPU's of the same scene.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use super::renderer;
use forelock_core::body::{Head, TriMesh};
use forelock_core::pose::Pose;
use forelock_render::{Body, Camera, Face, HairColour, Image, Scalp, Scene, Settings, Strands, render};
use glam::{DQuat, DVec3, Vec3};

/// The mean difference of a channel, in 1/255.
pub fn mean_difference(a: &Image, b: &Image) -> f64 {
    let pairs = a.rgba().iter().zip(b.rgba());
    let sum: u64 = pairs.map(|(&a, &b)| u64::from(a.abs_diff(b))).sum();
    sum as f64 / (a.rgba().len() / 4 * 3) as f64
}

/// A ball of `rows` rows of triangles.
pub fn ball(radius: f32, rows: u32) -> TriMesh {
    let mut points = Vec::new();
    for i in 0..=rows {
        let polar = std::f32::consts::PI * i as f32 / rows as f32;
        for j in 0..2 * rows {
            let (sin, cos) = (std::f32::consts::PI * j as f32 / rows as f32).sin_cos();
            points.push(Vec3::new(polar.sin() * cos, polar.cos(), polar.sin() * sin) * radius);
        }
    }
    let at = |i: u32, j: u32| i * 2 * rows + j % (2 * rows);
    let cells = (0..rows).flat_map(|i| (0..2 * rows).map(move |j| (i, j)));
    let triangles = cells.flat_map(|(i, j)| {
        [[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]]
    });
    TriMesh::new(points, triangles.collect()).unwrap()
}

/// Strands of 25 particles on the upper half of a ball, that leave it upwards and hang down.
pub fn mane(count: u32, radius: f32) -> (Vec<Vec3>, Vec<u32>) {
    let mut points = Vec::new();
    for n in 0..count {
        let height = 1.0 - 0.95 * (n as f32 + 0.5) / count as f32;
        let (sin, cos) = (n as f32 * 2.399_963).sin_cos();
        let rim = (1.0 - height * height).sqrt();
        let root = Vec3::new(rim * cos, height, rim * sin);
        let mut at = root * radius;
        let mut heading = root + Vec3::new(0.2 * sin, 0.3, 0.1);
        for i in 0..25 {
            points.push(at);
            let curl = Vec3::new((i as f32 * 0.9 + n as f32).cos(), 0.0, (i as f32 * 0.9 + n as f32).sin());
            heading = (heading + Vec3::NEG_Y * 0.12).normalize();
            at += (heading + curl * 0.15) * (0.09 * radius);
            if at.length() < 1.02 * radius {
                at = at.normalize() * (1.02 * radius);
            }
        }
    }
    (points, (0..=count).map(|n| n * 25).collect())
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn a_head_of_hair_looks_the_same_as_by_the_cpu() {
    let (body, (points, offsets)) = (ball(0.1, 24), mane(2500, 0.1));
    let mut renderer = renderer();
    let thinnest = Settings::default().thinnest;
    // In the last one less than half of the curves is drawn.
    let views = [
        ("far", 1.6, 160, thinnest),
        ("near", 0.7, 256, thinnest),
        ("close", 0.25, 256, thinnest),
        ("fewer", 1.6, 160, 0.5),
    ];
    for (name, distance, side, thinnest) in views {
        let strands = Strands::new(&points, &offsets, HairColour::CHESTNUT);
        let camera = Camera {
            eye: Vec3::new(0.3, 0.25, 1.0).normalize() * distance,
            target: Vec3::ZERO,
            up: Vec3::Y,
            fov_y: 0.5,
        };
        let scene = Scene::new(vec![Body::new(&body, Pose::IDENTITY)], vec![strands], camera);
        let settings = Settings { width: side, height: side - 21, thinnest, ..Settings::default() };
        // The comparison must see a slightly different colour.
        let mut other = scene.clone();
        other.strands[0].colour = HairColour::RED;
        let (cpu, gpu) = (render(&scene, &settings).unwrap(), renderer.render(&scene, &settings).unwrap());
        assert_eq!(renderer.report().dropped, 0);
        if let Some(folder) = std::env::var_os("FORELOCK_PICTURES") {
            let mut both = Image::filled(2 * side, side, [0, 0, 0, 255]).unwrap();
            both.paste(&cpu, 0, 0);
            both.paste(&gpu, side, 0);
            let path = std::path::Path::new(&folder).join(format!("{name}.png"));
            std::fs::write(path, both.to_png().unwrap()).unwrap();
        }
        let difference = mean_difference(&cpu, &gpu);
        println!("{name}: mean difference {difference:.3}/255, {:?}", renderer.report());
        assert!(difference <= 1.0, "{name}: {difference}");
        let control = mean_difference(&render(&other, &settings).unwrap(), &gpu);
        assert!(control > 1.0, "{name}: {control} for another colour");
    }
}

/// Bodies are drawn by the device too: faces, scalps, shadows of bodies on each other, and what the
/// near plane cuts.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn bodies_look_the_same_as_by_the_cpu() {
    let head = &Head::builtin().mesh;
    let shares: Vec<f32> = head.positions.iter().map(|p| (20.0 * p.y).clamp(0.0, 1.0)).collect();
    let brows = HairColour::RED.albedo();
    let face = Some(Face { rest: &head.positions, brows });
    let scalp = Some(Scalp { shares: &shares, colour: Vec3::new(0.1, 0.05, 0.02) });
    let body = Body { face, scalp, ..Body::new(head, Pose::new(DQuat::from_rotation_y(0.3), DVec3::ZERO)) };
    let ball = ball(0.05, 12);
    let other = Body::new(&ball, Pose::new(DQuat::IDENTITY, DVec3::new(-0.08, 0.06, 0.2)));
    let (points, offsets) = mane(400, 0.1);
    let mut renderer = renderer();
    for (name, eye, side) in [
        ("face", Vec3::new(0.2, 0.05, 0.9), 320),
        ("eye", Vec3::new(0.04, 0.0, 0.22), 256),
        ("behind", Vec3::new(-0.3, 0.5, -0.6), 200),
    ] {
        let camera = Camera { eye, target: Vec3::new(0.0, -0.02, 0.0), up: Vec3::Y, fov_y: 0.5 };
        let strands = Strands::new(&points, &offsets, HairColour::BLONDE);
        let scene = Scene::new(vec![body, other], vec![strands], camera);
        let settings = Settings { width: side, height: side - 37, ..Settings::default() };
        let (cpu, gpu) = (render(&scene, &settings).unwrap(), renderer.render(&scene, &settings).unwrap());
        let difference = mean_difference(&cpu, &gpu);
        println!("{name}: mean difference {difference:.3}/255");
        assert!(difference <= 1.0, "{name}: {difference}");
        // Few pixels differ: a feature that is missing or in another place would be seen.
        let pairs = cpu.rgba().chunks_exact(4).zip(gpu.rgba().chunks_exact(4));
        let is_off = |(a, b): (&[u8], &[u8])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 12);
        let off = pairs.filter(|pair| is_off(*pair)).count();
        assert!(off * 100 < cpu.rgba().len() / 4, "{name}: {off} pixels");
    }
}

/// Shadows and ambient light where something is missing, and where hair is very dense.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn shadows_are_those_of_the_cpu_whatever_casts_them() {
    let (ball, (points, offsets)) = (ball(0.1, 16), mane(600, 0.1));
    let camera = Camera::framing((Vec3::splat(-0.2), Vec3::splat(0.2)), 0.4, 0.2);
    let strands = Strands::new(&points, &offsets, HairColour::WHITE);
    let whole = Scene::new(vec![Body::new(&ball, Pose::IDENTITY)], vec![strands], camera);
    let wide = Strands { width: 0.003, ..strands };
    let mut unshaded = whole.clone();
    unshaded.lights[0].shadows = false;
    let scenes = [
        ("no hair", Scene { strands: Vec::new(), ..whole.clone() }),
        ("no body", Scene { bodies: Vec::new(), ..whole.clone() }),
        ("no light", Scene { lights: Vec::new(), ..whole.clone() }),
        ("one light without shadows", unshaded),
        ("dense", Scene { strands: vec![wide; 3], ..whole.clone() }),
    ];
    let settings = Settings { width: 120, height: 110, width_scale: Some(4.0), ..Settings::default() };
    let mut renderer = renderer();
    for (name, scene) in &scenes {
        let (cpu, gpu) = (render(scene, &settings).unwrap(), renderer.render(scene, &settings).unwrap());
        let difference = mean_difference(&cpu, &gpu);
        println!("{name}: mean difference {difference:.3}/255");
        assert!(difference <= 0.5, "{name}: {difference}");
    }
    // The comparison sees shadows that are missing.
    let mut bare = whole.clone();
    bare.lights.iter_mut().for_each(|light| light.shadows = false);
    let control =
        mean_difference(&render(&whole, &settings).unwrap(), &renderer.render(&bare, &settings).unwrap());
    assert!(control > 1.0, "{control}");
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn colours_and_widths_of_the_groom_are_those_of_the_cpu() {
    let (points, offsets) = mane(300, 0.1);
    let colours: Vec<[f32; 3]> = (0..points.len())
        .map(|i| [0.1 + 0.8 * (i % 25) as f32 / 25.0, 0.1 + (i / 25 % 5) as f32 * 0.15, 0.2])
        .collect();
    let widths: Vec<f32> = (0..points.len()).map(|i| 1e-4 * (1 + i % 25) as f32 / 5.0).collect();
    let plain = Strands::new(&points, &offsets, HairColour::BLACK);
    let rich = Strands { colours: Some(&colours), widths: Some(&widths), ..plain };
    let camera = Camera::framing((Vec3::splat(-0.2), Vec3::splat(0.2)), 0.3, 0.2);
    let scene = Scene::new(Vec::new(), vec![plain, rich], camera);
    for samples in [1, 3] {
        let settings =
            Settings { width: 150, height: 90, samples, children: Some(3), seed: 9, ..Settings::default() };
        let (cpu, gpu) = (render(&scene, &settings).unwrap(), renderer().render(&scene, &settings).unwrap());
        let difference = mean_difference(&cpu, &gpu);
        assert!(difference <= 1.0, "{difference}");
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn an_empty_scene_is_the_backdrop_and_bad_scenes_are_refused() {
    let camera = Camera::framing((Vec3::splat(-0.2), Vec3::splat(0.2)), 0.0, 0.0);
    let mut scene = Scene::new(Vec::new(), Vec::new(), camera);
    let settings = Settings { width: 33, height: 17, ..Settings::default() };
    let mut renderer = renderer();
    let (cpu, gpu) = (render(&scene, &settings).unwrap(), renderer.render(&scene, &settings).unwrap());
    assert!(mean_difference(&cpu, &gpu) < 0.05);
    let stray = [Vec3::ZERO, Vec3::NAN, Vec3::X, Vec3::Y];
    scene.strands.push(Strands::new(&stray, &[0, 2, 3, 4], HairColour::RED));
    assert_eq!(renderer.render(&scene, &settings).unwrap(), gpu, "strands that cannot be drawn");
    scene.camera.eye = scene.camera.target;
    assert!(renderer.render(&scene, &settings).is_err());
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn an_eye_within_the_hair_sees_what_it_sees_by_the_cpu() {
    let (points, offsets) = mane(40, 0.1);
    let strands = Strands::new(&points, &offsets, HairColour::RED);
    let eye = points[12] + Vec3::new(0.0, 0.001, 0.002);
    let camera = Camera { eye, target: points[312], up: Vec3::Y, fov_y: 1.2 };
    let scene = Scene::new(Vec::new(), vec![strands], camera);
    for width_scale in [1.0, 40.0, 1e5] {
        let settings =
            Settings { width: 90, height: 70, width_scale: Some(width_scale), ..Settings::default() };
        let mut renderer = renderer();
        let (cpu, gpu) = (render(&scene, &settings).unwrap(), renderer.render(&scene, &settings).unwrap());
        assert_eq!(renderer.report().dropped, 0);
        let difference = mean_difference(&cpu, &gpu);
        println!("{width_scale}: {difference}");
        // Strands that are wider than long have no picture that is right.
        assert!(difference <= 2.0 || width_scale > 1e3, "{difference} at {width_scale}");
    }
}
