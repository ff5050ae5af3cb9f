//! Positions that are on the device already.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use super::agreement::{ball, mane, mean_difference};
use super::{gpu, renderer};
use forelock_core::frame::Solver;
use forelock_core::frame::{FrameInput, Roots};
use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use forelock_core::simulation::Options;
use forelock_core::solver::{AmsParams, MassSpringParams};
use forelock_gpu::{DevicePositions, GpuSimulation};
use forelock_render::gpu::{GpuRenderError, SharedPositions};
use forelock_render::{Body, Camera, HairColour, Scene, Settings, Strands};
use glam::{DQuat, DVec3, Vec3};

fn settings() -> Settings {
    Settings { width: 96, height: 80, ..Settings::default() }
}

fn camera() -> Camera {
    Camera::framing((Vec3::splat(-0.2), Vec3::splat(0.2)), 0.3, 0.2)
}

/// `points` relative to `origin` in two buffers, each in its own order.
fn shared(points: &[Vec3], origin: Vec3) -> SharedPositions {
    let device = gpu().device().clone();
    let mut shared = SharedPositions::new(origin);
    for (half, stride) in [(0, 16), (1, 3)] {
        let mut numbers = vec![f32::NAN; 64 * points.len()];
        let mut places = Vec::new();
        for (i, point) in points.iter().enumerate().filter(|(i, _)| i % 2 == half).rev() {
            let place = 48 * (points.len() - 1 - i) + i % 3;
            for (axis, number) in (*point - origin).to_array().into_iter().enumerate() {
                numbers[place + axis * stride] = number;
            }
            places.push([place as u32, i as u32]);
        }
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 4 * numbers.len() as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        gpu().queue().write_buffer(&buffer, 0, bytemuck::cast_slice(&numbers));
        shared.add(&device, &buffer, stride as u32, &places).unwrap();
    }
    shared
}

/// The strands in the opposite order: with the same bounds.
fn reversed(points: &[Vec3]) -> Vec<Vec3> {
    points.chunks(25).rev().flatten().copied().collect()
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn shared_positions_are_drawn_in_place_of_the_scenes() {
    let body = ball(0.1, 12);
    // On a grid of 2⁻¹⁶ m, so that adding the origin rounds nothing.
    let on_grid =
        |own: Vec<Vec3>| -> Vec<Vec3> { own.iter().map(|p| (*p * 65536.0).round() / 65536.0).collect() };
    let (first, offsets) = mane(200, 0.1);
    let (second, more_offsets) = mane(60, 0.12);
    let (first, second) = (on_grid(first), on_grid(second));
    let (stale, stale_second) = (reversed(&first), reversed(&second));
    let scene = |a, b| {
        let hair = vec![
            Strands::new(a, &offsets, HairColour::BLONDE),
            Strands::new(b, &more_offsets, HairColour::BLACK),
        ];
        Scene::new(vec![Body::new(&body, Pose::IDENTITY)], hair, camera())
    };
    let mut renderer = renderer();
    let right = renderer.render(&scene(&first, &second), &settings()).unwrap();
    let wrong = renderer.render(&scene(&stale, &stale_second), &settings()).unwrap();
    let uploaded = renderer.report().uploaded_bytes;
    assert!(right != wrong);
    renderer.share(0, Some(shared(&first, Vec3::new(1.0, -0.5, 0.25))));
    renderer.share(1, Some(shared(&second, Vec3::ZERO)));
    assert!(right == renderer.render(&scene(&stale, &stale_second), &settings()).unwrap());
    assert!(right == renderer.redraw().unwrap());
    let fewer = size_of_val(&*first) + size_of_val(&*second);
    assert_eq!(renderer.report().uploaded_bytes, uploaded - fewer as u64);
    // One group alone, then none.
    renderer.share(0, None);
    assert!(right == renderer.render(&scene(&first, &stale_second), &settings()).unwrap());
    renderer.share(1, None);
    assert!(wrong == renderer.render(&scene(&stale, &stale_second), &settings()).unwrap());
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn hair_outside_the_scenes_box_needs_a_margin_for_its_shadows() {
    let (points, offsets) = mane(400, 0.1);
    let nearer: Vec<Vec3> = points.iter().map(|p| *p * 0.6).collect();
    let scene = |own| Scene::new(Vec::new(), vec![Strands::new(own, &offsets, HairColour::BLONDE)], camera());
    let settings = Settings { children: Some(1), width_scale: Some(4.0), thinnest: 0.0, ..settings() };
    let mut renderer = renderer();
    let right = renderer.render(&scene(&points), &settings).unwrap();
    let [without, with] = [0.0, 0.08].map(|margin| {
        let mut shared = shared(&points, Vec3::ZERO);
        shared.margin = margin;
        renderer.share(0, Some(shared));
        mean_difference(&renderer.render(&scene(&nearer), &settings).unwrap(), &right)
    });
    assert!(with < 0.5 * without && with < 1.0, "{with} {without}");
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn positions_that_are_not_the_groups_are_refused() {
    let (points, offsets) = mane(20, 0.1);
    let scene = Scene::new(Vec::new(), vec![Strands::new(&points, &offsets, HairColour::BLACK)], camera());
    let mut renderer = renderer();
    let is_refused = |error: GpuRenderError, why: &str| {
        let text = error.to_string();
        assert!(text.starts_with("shared positions cannot be used") && text.contains(why), "{text}");
    };
    renderer.share(0, Some(shared(&points[..50], Vec3::ZERO)));
    is_refused(renderer.render(&scene, &settings()).unwrap_err(), "group 0 has 500 particles, but 50");
    renderer.share(0, None);
    renderer.render(&scene, &settings()).unwrap();

    let device = gpu().device().clone();
    let buffer = |usage| {
        let size = 4 * 1500;
        device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    };
    let mut own = shared(&points[..50], Vec3::ZERO);
    let (storage, other) = (buffer(wgpu::BufferUsages::STORAGE), buffer(wgpu::BufferUsages::COPY_DST));
    is_refused(own.add(&device, &other, 1, &[[0, 50]]).unwrap_err(), "lacks the usage STORAGE");
    is_refused(own.add(&device, &storage, 1, &[[0, 50], [3, 49]]).unwrap_err(), "particle 49 is there twice");
    is_refused(own.add(&device, &storage, 1, &[[1498, 50]]).unwrap_err(), "beyond the buffer's 1500 numbers");
    // Nothing of what is refused is added.
    let rest: Vec<[u32; 2]> = (50..500).map(|i| [3 * i, i]).collect();
    own.add(&device, &storage, 1, &rest).unwrap();
    renderer.share(0, Some(own.clone()));
    renderer.render(&scene, &settings()).unwrap();
    own.add(&device, &storage, 1, &[[0, 600]]).unwrap();
    renderer.share(0, Some(own));
    is_refused(renderer.render(&scene, &settings()).unwrap_err(), "but 501 were added");
    let mut own = shared(&points, Vec3::ZERO);
    is_refused(own.add(&device, &storage, 1, &[[0, u32::MAX]]).unwrap_err(), "no particle 4294967295");
    own.margin = f32::NAN;
    renderer.share(0, Some(own));
    is_refused(renderer.render(&scene, &settings()).unwrap_err(), "`margin` is NaN");
}

/// A simulation and a renderer share a device: what is drawn is what a read-back shows.
fn is_drawn_without_a_read_back(solver: impl Into<Solver<f32>>) {
    let (points, offsets) = mane(150, 0.1);
    let groom = Groom::new(points, offsets).unwrap();
    let mut simulation = GpuSimulation::new(&gpu(), &groom, solver, &Options::default()).unwrap();
    let pose = |step: i32| {
        let angle = 0.03 * f64::from(step);
        Pose::new(DQuat::from_rotation_y(angle), DVec3::new(angle, 0.0, 0.0))
    };
    for step in 0..10 {
        let turning = FrameInput {
            roots: Roots::Rigid([pose(step), pose(step + 1)]),
            gravity: DVec3::new(0.0, -9.81, 0.0),
            dt_secs: 1.0 / 60.0,
            ..FrameInput::default()
        };
        simulation.step_frame(&turning).unwrap();
    }
    let mut positions = Vec::new();
    let pending = simulation.begin_read();
    while !simulation.try_read(&pending, &mut positions).unwrap() {}
    let scene = |positions| {
        let hair = vec![Strands::new(positions, groom.strand_offsets(), HairColour::BLONDE)];
        Scene::new(Vec::new(), hair, camera())
    };
    let mut renderer = renderer();
    let settings = Settings { children: Some(1), width_scale: Some(3.0), ..settings() };
    let read = renderer.render(&scene(&positions), &settings).unwrap();
    let on_device = simulation.positions();
    let mut shared = SharedPositions::new(on_device.origin.as_vec3());
    for (buffer, places) in on_device.buffers.iter().zip(&on_device.places) {
        shared.add(gpu().device(), buffer, DevicePositions::STRIDE, places).unwrap();
    }
    shared.margin = 0.1;
    renderer.share(0, Some(shared));
    let same = renderer.render(&scene(&positions), &settings).unwrap();
    // The rest shape where the head is.
    let rest: Vec<Vec3> =
        groom.positions().iter().map(|p| pose(10).transform_point(p.as_dvec3()).as_vec3()).collect();
    let near = renderer.render(&scene(&rest), &settings).unwrap();
    renderer.share(0, None);
    let rest = renderer.render(&scene(&rest), &settings).unwrap();
    let [same, near, moved] = [same, near, rest].map(|own| mean_difference(&own, &read));
    assert!(same < 0.5 && near < 0.8 && moved > 5.0 * near, "{same} {near} {moved}");
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn simulated_hair_is_drawn_without_a_read_back() {
    is_drawn_without_a_read_back(&AmsParams::default());
}

/// The zigzag of this solver has particles that are not of the groom.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn particles_between_those_of_the_groom_are_not_drawn() {
    is_drawn_without_a_read_back(&MassSpringParams::default());
}
