//! What a renderer keeps from one picture to the next changes no picture.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use super::agreement::{ball, mane};
use super::renderer;
use forelock_core::body::TriMesh;
use forelock_core::pose::Pose;
use forelock_render::gpu::GpuRenderer;
use forelock_render::{Body, Camera, Face, HairColour, Image, Scalp, Scene, Settings, Strands};
use glam::{DQuat, DVec3, Vec3};

/// A renderer that keeps all, and one that has forgotten all before each picture.
struct Both {
    keeps: GpuRenderer,
    forgets: GpuRenderer,
    before: Option<Image>,
}

impl Both {
    /// Draws `scene` by both: the pictures are the same, and another than the one before. Returns
    /// how many bytes were uploaded.
    fn agree(&mut self, name: &str, scene: &Scene<'_>, settings: &Settings) -> u64 {
        let picture = self.keeps.render(scene, settings).unwrap();
        // A scene that is refused.
        let refused = Camera { eye: scene.camera.target, ..scene.camera };
        assert!(self.forgets.render(&Scene { camera: refused, ..scene.clone() }, settings).is_err());
        assert!(picture == self.forgets.render(scene, settings).unwrap(), "{name}");
        assert!(self.before.as_ref() != Some(&picture), "{name} changes nothing");
        self.before = Some(picture);
        assert!(self.keeps.report().uploaded_bytes <= self.forgets.report().uploaded_bytes);
        self.keeps.report().uploaded_bytes
    }
}

/// One thing after the other changes, and shows.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn a_change_shows_whatever_was_drawn_before() {
    let (body, other) = (ball(0.1, 16), ball(0.1, 12));
    let dented = TriMesh { positions: body.positions.iter().map(|p| *p * 0.97).collect(), ..body.clone() };
    let ((points, offsets), (more, more_offsets)) = (mane(300, 0.1), mane(1300, 0.1));
    let moved: Vec<Vec3> = points.iter().map(|p| *p + Vec3::new(0.02, 0.0, 0.01)).collect();
    let mut broken = moved.clone();
    broken[37] = Vec3::NAN;
    let colours: Vec<[f32; 3]> = (0..points.len()).map(|i| [0.9, 0.1 + 0.8 * (i % 2) as f32, 0.1]).collect();
    let widths: Vec<f32> = (0..points.len()).map(|i| 2e-5 * (1 + i % 25) as f32).collect();
    let shares = [0.0, 1.0].map(|share| vec![share; body.positions.len()]);
    let camera = Camera::framing((Vec3::splat(-0.2), Vec3::splat(0.2)), 0.3, 0.2);
    let strands = Strands::new(&points, &offsets, HairColour::BLONDE);
    let mut scene = Scene::new(vec![Body::new(&body, Pose::IDENTITY)], vec![strands], camera);
    let mut settings = Settings { width: 100, height: 90, thinnest: 0.0, ..Settings::default() };
    let mut both = Both { keeps: renderer(), forgets: renderer(), before: None };

    let all = both.agree("the first picture", &scene, &settings);
    scene.strands[0].positions = &moved;
    let positions = both.agree("positions", &scene, &settings);
    assert!(positions * 5 < all * 4, "{positions} of {all} bytes");
    scene.bodies[0].pose = Pose::new(DQuat::from_rotation_y(0.4), DVec3::new(0.02, 0.0, 0.01));
    both.agree("a pose", &scene, &settings);
    scene.bodies[0].colour = Vec3::new(0.1, 0.3, 0.1);
    both.agree("the colour of a body", &scene, &settings);
    scene.bodies[0].mesh = &dented;
    both.agree("vertices of a body", &scene, &settings);
    scene.bodies[0].scalp = Some(Scalp { shares: &shares[0], colour: Vec3::X });
    scene.bodies[0].face = Some(Face { rest: &body.positions, brows: Vec3::X });
    both.agree("a face", &scene, &settings);
    scene.bodies[0].scalp = Some(Scalp { shares: &shares[1], colour: Vec3::X });
    both.agree("a scalp", &scene, &settings);
    scene.bodies.push(Body::new(&other, Pose::new(DQuat::IDENTITY, DVec3::new(0.1, 0.1, 0.1))));
    both.agree("another body", &scene, &settings);
    scene.strands[0].colour = HairColour::BLACK;
    both.agree("a colour", &scene, &settings);
    scene.strands[0].positions = &broken;
    both.agree("a strand that cannot be drawn", &scene, &settings);
    scene.strands[0].positions = &moved;
    both.agree("all strands again", &scene, &settings);
    scene.strands[0].colours = Some(&colours);
    both.agree("colours of the groom", &scene, &settings);
    scene.strands[0].widths = Some(&widths);
    both.agree("widths of the groom", &scene, &settings);
    settings.seed = 2;
    both.agree("a seed", &scene, &settings);
    settings.width_scale = Some(3.0);
    both.agree("wider strands", &scene, &settings);
    settings.children = Some(2);
    both.agree("children", &scene, &settings);
    scene.strands.push(Strands::new(&more, &more_offsets, HairColour::RED));
    both.agree("more strands", &scene, &settings);
    // Three quarters of them, then other shares.
    settings.thinnest = 2.0;
    both.agree("fewer strands", &scene, &settings);
    for step in 1..5 {
        let side = 0.2 + 0.01 * step as f32;
        scene.camera = Camera::framing((Vec3::splat(-side), Vec3::splat(side)), -0.5, 0.1);
        both.agree("a camera", &scene, &settings);
    }
    scene.strands.remove(0);
    scene.bodies.remove(0);
    both.agree("less of everything", &scene, &settings);
    (settings.width, settings.height) = (77, 130);
    both.agree("a size", &scene, &settings);
}

/// After a scene that is refused, the next picture is whole.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn a_refused_scene_leaves_no_trace() {
    let body = ball(0.1, 16);
    let cut = TriMesh { positions: body.positions[..20].to_vec(), ..body.clone() };
    let (points, offsets) = mane(100, 0.1);
    let camera = Camera::framing((Vec3::splat(-0.2), Vec3::splat(0.2)), 0.3, 0.2);
    let strands = Strands::new(&points, &offsets, HairColour::BLONDE);
    let scene = Scene::new(vec![Body::new(&body, Pose::IDENTITY)], vec![strands], camera);
    let bad = Scene { bodies: vec![Body::new(&cut, Pose::IDENTITY)], ..scene.clone() };
    let settings = Settings { width: 90, height: 80, ..Settings::default() };
    let mut renderer = renderer();
    let whole = renderer.render(&scene, &settings).unwrap();
    let error = renderer.render(&bad, &settings).unwrap_err().to_string();
    assert!(error.contains("triangle"), "{error}");
    assert!(renderer.render(&scene, &settings).unwrap() == whole);
}

/// Hair that could not all be drawn, and then none; particles that belong to no strand.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn hair_can_vanish_and_particles_can_be_loose() {
    let (points, offsets) = mane(60, 0.1);
    let mut broken = points.clone();
    broken[37] = Vec3::NAN;
    let camera = Camera::framing((Vec3::splat(-0.2), Vec3::splat(0.2)), 0.3, 0.2);
    let strands = Strands::new(&points, &offsets, HairColour::BLONDE);
    let settings = Settings { width: 80, height: 70, ..Settings::default() };
    let mut both = Both { keeps: renderer(), forgets: renderer(), before: None };
    let of = |strands| Scene::new(Vec::new(), strands, camera);
    both.agree("a broken strand", &of(vec![Strands { positions: &broken, ..strands }]), &settings);
    both.agree("no hair", &of(Vec::new()), &settings);
    let loose = |count: usize| Strands { positions: &points[..count], strand_offsets: &[], ..strands };
    both.agree("hair after loose particles", &of(vec![loose(30), strands]), &settings);
    // More of them change no picture.
    let more = of(vec![loose(80), strands]);
    let picture = both.keeps.render(&more, &settings).unwrap();
    assert!(Some(picture) == both.before);
}

/// Spare curves, which the level of detail hides, take no room from others.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn hidden_curves_have_no_pieces() {
    let (points, offsets) = mane(1300, 0.1);
    let strands = Strands::new(&points, &offsets, HairColour::BLONDE);
    let scene = |side: f32| {
        let camera = Camera::framing((Vec3::splat(-side), Vec3::splat(side)), 0.3, 0.2);
        Scene::new(Vec::new(), vec![strands], camera)
    };
    let settings =
        Settings { width: 90, height: 80, children: Some(4), width_scale: Some(1.0), ..Settings::default() };
    let pieces = |keeps: &mut GpuRenderer, thinnest: f32| {
        keeps.render(&scene(0.2), &Settings { thinnest, ..settings }).unwrap();
        keeps.report().pieces
    };
    let mut fresh = renderer();
    let [all, fewer] = [pieces(&mut fresh, 0.0), pieces(&mut fresh, 4.0)];
    // 2,000 of 5,200 curves are left.
    assert!(fewer * 5 < all * 2 + all / 20, "{fewer} of {all}");
}

/// Strands of one particle, which are never drawn, do not keep attributes from staying on the
/// device.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn attributes_stay_beside_strands_that_are_too_short() {
    let (mut points, mut offsets) = mane(60, 0.1);
    points.push(Vec3::ONE);
    offsets.push(points.len() as u32);
    let moved: Vec<Vec3> = points.iter().map(|p| *p + Vec3::X * 0.01).collect();
    let camera = Camera::framing((Vec3::splat(-0.2), Vec3::splat(0.2)), 0.3, 0.2);
    let of =
        |points| Scene::new(Vec::new(), vec![Strands::new(points, &offsets, HairColour::BLONDE)], camera);
    let settings = Settings { width: 80, height: 70, ..Settings::default() };
    let mut both = Both { keeps: renderer(), forgets: renderer(), before: None };
    let first = both.agree("hair", &of(&points), &settings);
    let second = both.agree("moved hair", &of(&moved), &settings);
    assert!(second * 5 < first * 4, "{second} of {first} bytes");
}
