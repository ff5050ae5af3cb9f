//! The lists of pieces: no piece is left out unnoticed, and their order is fixed.

use super::agreement::{ball, mane, mean_difference};
use super::renderer;
use forelock_core::pose::Pose;
use forelock_render::{Body, Camera, HairColour, Scene, Settings, Strands, render};
use glam::Vec3;

fn camera(distance: f32) -> Camera {
    let eye = Vec3::new(0.3, 0.25, 1.0).normalize() * distance;
    Camera { eye, target: Vec3::ZERO, up: Vec3::Y, fov_y: 0.5 }
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn the_same_picture_twice_is_the_same_bytes() {
    let (body, (points, offsets)) = (ball(0.1, 12), mane(900, 0.1));
    let strands = Strands::new(&points, &offsets, HairColour::BLONDE);
    let scene = Scene::new(vec![Body::new(&body, Pose::IDENTITY)], vec![strands], camera(0.9));
    let settings = Settings { width: 150, height: 130, ..Settings::default() };
    let first = renderer().render(&scene, &settings).unwrap();
    let mut other = renderer();
    for _ in 0..3 {
        assert!(other.render(&scene, &settings).unwrap() == first);
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn pieces_without_room_are_counted() {
    let (points, offsets) = mane(400, 0.1);
    let strands = Strands::new(&points, &offsets, HairColour::BLONDE);
    let scene = Scene::new(Vec::new(), vec![strands], camera(0.9));
    let settings = Settings { width: 100, height: 100, ..Settings::default() };
    let mut renderer = renderer();
    let whole = renderer.render(&scene, &settings).unwrap();
    let all = renderer.report().clone();
    assert_eq!(all.dropped, 0);
    assert!(all.pieces > 4000 && all.particles == 40_000, "{all:?}");
    renderer.limit_pieces(Some(1000));
    let cut = renderer.render(&scene, &settings).unwrap();
    assert_eq!(renderer.report().pieces, all.pieces);
    assert_eq!(renderer.report().dropped, all.pieces - 1000);
    assert!(cut != whole);
    renderer.limit_pieces(None);
    assert!(renderer.render(&scene, &settings).unwrap() == whole);
    assert_eq!(renderer.report().dropped, 0);
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn tiles_with_thousands_of_pieces_are_in_order() {
    // Every strand has a colour of its own, so that a wrong order shows.
    for count in [41, 330, 700, 1500] {
        let (points, offsets) = mane(count, 0.1);
        let colours: Vec<[f32; 3]> = (0..points.len())
            .map(|i| {
                [0.05 + 0.9 * ((i / 25 * 7) % 11) as f32 / 11.0, 0.3, 0.9 - 0.8 * ((i / 25) % 3) as f32 / 3.0]
            })
            .collect();
        let strands =
            Strands { colours: Some(&colours), ..Strands::new(&points, &offsets, HairColour::BLACK) };
        let scene = Scene::new(Vec::new(), vec![strands], camera(2.4));
        let settings = Settings { width: 40, height: 40, width_scale: Some(8.0), ..Settings::default() };
        let mut renderer = renderer();
        let (cpu, gpu) = (render(&scene, &settings).unwrap(), renderer.render(&scene, &settings).unwrap());
        let difference = mean_difference(&cpu, &gpu);
        println!("{difference} {:?}", renderer.report());
        assert!(difference < 0.5, "{difference} with {count} strands");
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn strands_of_equal_depth_are_in_the_order_of_the_cpu() {
    let mut points = Vec::new();
    for n in 0..600 {
        let (sin, cos) = (n as f32 * 0.77).sin_cos();
        points.extend([-0.1, 0.0, 0.1].map(|at| Vec3::new(at * cos, at * sin, 0.0)));
    }
    let offsets: Vec<u32> = (0..=600).map(|n| 3 * n).collect();
    let colours: Vec<[f32; 3]> =
        (0..1800).map(|i| if i / 3 % 2 == 0 { [0.9, 0.1, 0.1] } else { [0.1; 3] }).collect();
    let strands = Strands { colours: Some(&colours), ..Strands::new(&points, &offsets, HairColour::BLACK) };
    let camera = Camera { eye: Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_y: 0.3 };
    let scene = Scene::new(Vec::new(), vec![strands], camera);
    let settings = Settings { width: 64, height: 64, children: Some(1), ..Settings::default() };
    let (cpu, gpu) = (render(&scene, &settings).unwrap(), renderer().render(&scene, &settings).unwrap());
    let difference = mean_difference(&cpu, &gpu);
    assert!(difference < 0.3, "{difference}");
}
