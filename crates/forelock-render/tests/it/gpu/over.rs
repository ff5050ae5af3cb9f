//! Drawing over what an engine has drawn.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use super::agreement::{ball, mane};
use super::target::{SIDE, read, texture};
use super::{gpu, renderer};
use forelock_core::pose::Pose;
use forelock_render::gpu::{GpuRenderError, GpuRenderer, Target};
use forelock_render::{Backdrop, Body, Camera, HairColour, Scene, Settings, Strands};
use glam::{DQuat, DVec3, Vec3, Vec4};
use half::f16;

const LIGHT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// The near plane of targets, metres.
const NEAR: f32 = 0.05;

fn camera() -> Camera {
    Camera::framing((Vec3::splat(-0.15), Vec3::splat(0.15)), 0.3, 0.2)
}

/// So dark that the film curve changes nothing.
fn settings() -> Settings {
    Settings { width: SIDE, height: SIDE, exposure: 0.1, ..Settings::default() }
}

/// The textures of an engine.
struct Textures {
    colour: wgpu::Texture,
    depth: wgpu::Texture,
}

impl Textures {
    /// All pixels show `colour` and have the depth `depth`.
    fn new(format: wgpu::TextureFormat, colour: f64, depth: f32) -> Self {
        let own = Self { colour: texture(format), depth: texture(DEPTH) };
        let colour = wgpu::Color { r: colour, g: colour, b: colour, a: 1.0 };
        let mut encoder = gpu().device().create_command_encoder(&Default::default());
        let [target, depths] = [&own.colour, &own.depth].map(|own| own.create_view(&Default::default()));
        let store = wgpu::StoreOp::Store;
        drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(colour), store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depths,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(depth), store }),
                stencil_ops: None,
            }),
            ..Default::default()
        }));
        gpu().queue().submit([encoder.finish()]);
        own
    }

    fn draw(&self, renderer: &mut GpuRenderer, scene: &Scene<'_>) -> Result<(), GpuRenderError> {
        let [colour, depth] = [&self.colour, &self.depth].map(|own| own.create_view(&Default::default()));
        let target = Target { colour: &colour, format: self.colour.format(), depth: &depth, near: NEAR };
        renderer.render_over(scene, &settings(), &target)
    }

    /// Linear light of pixels of half floats.
    fn light(&self) -> Vec<Vec4> {
        let numbers = read(&self.colour);
        let numbers = numbers.chunks_exact(2).map(|own| f16::from_le_bytes([own[0], own[1]]).to_f32());
        numbers.collect::<Vec<_>>().chunks_exact(4).map(Vec4::from_slice).collect()
    }

    fn depths(&self) -> Vec<f32> {
        bytemuck::pod_collect_to_vec(&read(&self.depth))
    }
}

/// How much of each pixel `scene` hides, and its depth there, over targets of a colour that `over`
/// makes.
fn hidden(
    renderer: &mut GpuRenderer,
    scene: &Scene<'_>,
    mut over: impl FnMut(&mut GpuRenderer, f64) -> Textures,
) -> (Vec<f32>, Vec<f32>) {
    let [black, white] = [0.0, 1.0].map(|colour| {
        let target = over(renderer, colour);
        target.draw(renderer, scene).unwrap();
        target
    });
    let pairs = white.light().into_iter().zip(black.light());
    (pairs.map(|(white, black)| 1.0 - (white.x - black.x)).collect(), black.depths())
}

/// The same over one depth.
fn hidden_over(renderer: &mut GpuRenderer, scene: &Scene<'_>, depth: f32) -> (Vec<f32>, Vec<f32>) {
    hidden(renderer, scene, |_, colour| Textures::new(LIGHT, colour, depth))
}

fn srgb(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Over one colour the picture is the one with that backdrop.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn over_one_colour_it_is_the_picture_with_that_backdrop() {
    let body = ball(0.1, 16);
    let (points, offsets) = mane(300, 0.1);
    let grey = 0.9_f32;
    let strands = Strands::new(&points, &offsets, HairColour::BLONDE);
    let backdrop = Backdrop { top: Vec3::splat(grey), bottom: Vec3::splat(grey), vignette: 0.0 };
    let scene =
        Scene { backdrop, ..Scene::new(vec![Body::new(&body, Pose::IDENTITY)], vec![strands], camera()) };
    let mut renderer = renderer();
    let picture = renderer.render(&scene, &settings()).unwrap();
    let shown = f64::from(grey * settings().exposure);

    let over = Textures::new(LIGHT, shown, 0.0);
    over.draw(&mut renderer, &scene).unwrap();
    for (light, bytes) in over.light().iter().zip(picture.rgba().chunks_exact(4)) {
        for axis in 0..3 {
            let [own, byte] = [255.0 * srgb(light[axis]), f32::from(bytes[axis])];
            assert!((own - byte).abs() < 1.5, "{own} {byte}");
        }
        assert_eq!(light.w, 1.0);
    }
    // Blending is linear where the target encodes sRGB, and the eight bits of the target round.
    let over = Textures::new(wgpu::TextureFormat::Rgba8UnormSrgb, shown, 0.0);
    over.draw(&mut renderer, &scene).unwrap();
    let worst = read(&over.colour).iter().zip(picture.rgba()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(worst <= Some(2), "{worst:?}");
    // Elsewhere pixels are the same that hair and bodies hide, or that they leave.
    let (opacity, _) = hidden_over(&mut renderer, &scene, 0.0);
    let over = Textures::new(wgpu::TextureFormat::Rgba8Unorm, srgb(shown as f32).into(), 0.0);
    over.draw(&mut renderer, &scene).unwrap();
    let bytes = read(&over.colour);
    let mut compared = [0, 0];
    for (i, opacity) in opacity.iter().enumerate() {
        if *opacity > 0.01 && *opacity < 0.99 {
            continue;
        }
        compared[usize::from(*opacity > 0.5)] += 1;
        for (own, byte) in bytes[4 * i..4 * i + 3].iter().zip(&picture.rgba()[4 * i..]) {
            assert!(own.abs_diff(*byte) <= 3, "{own} {byte} at {i}");
        }
    }
    assert!(compared.iter().all(|pixels| *pixels > 200), "{compared:?}");
    // The renderer draws pictures of its own again.
    assert!(renderer.redraw().is_err());
    assert!(picture == renderer.render(&scene, &settings()).unwrap());
}

/// The depths that are written are those at which what is in front hides the hair.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn depths_hide_and_are_written() {
    let (points, offsets) = mane(600, 0.1);
    let strands = Strands::new(&points, &offsets, HairColour::CHESTNUT);
    let scene = Scene::new(Vec::new(), vec![strands], camera());
    let mut renderer = renderer();
    let (opacity, depths) = hidden_over(&mut renderer, &scene, 0.0);
    let range = points.iter().filter_map(|p| camera().project(*p, SIDE, SIDE)).map(|p| NEAR / p.z);
    let (least, most) = range.fold((1.0_f32, 0.0_f32), |(a, b), d| (a.min(d), b.max(d)));
    for (opacity, depth) in opacity.iter().zip(&depths) {
        match opacity {
            0.502.. => assert!((0.99 * least..1.01 * most).contains(depth), "{depth} {least} {most}"),
            ..0.498 => assert_eq!(*depth, 0.0),
            _ => {}
        }
    }
    let written: Vec<f32> = depths.iter().copied().filter(|depth| *depth > 0.0).collect();
    assert!(written.len() > 500, "{}", written.len());
    for share in [0.2, 0.5, 0.8] {
        let mut sorted = written.clone();
        sorted.sort_by(f32::total_cmp);
        let plane = sorted[(share * sorted.len() as f32) as usize];
        let (before, over) = hidden_over(&mut renderer, &scene, plane);
        let planes = vec![plane; before.len()];
        let counts = compare([&before, &depths, &planes, &over]);
        assert!(counts.iter().all(|pixels| *pixels > 50), "{counts:?}");
    }
    // Nothing is drawn behind what touches the eye.
    let (opacity, depths) = hidden_over(&mut renderer, &scene, 1.0);
    assert!(opacity.iter().all(|own| *own == 0.0) && depths.iter().all(|own| *own == 1.0));
}

/// Checks how much hair hides in front of something, `opacity`: at least half of a pixel where its
/// depth is larger. Then `drawn` has that depth. Returns for how many pixels it is smaller and
/// larger.
fn compare([opacity, hair, before, drawn]: [&[f32]; 4]) -> [usize; 2] {
    let mut counts = [0, 0];
    for i in 0..opacity.len() {
        // Half floats cannot tell opacities nearer to one half.
        if hair[i] == 0.0 || (opacity[i] - 0.5).abs() < 2e-3 || (hair[i] / before[i] - 1.0).abs() < 1e-5 {
            continue;
        }
        let is_nearer = hair[i] > before[i];
        assert_eq!(opacity[i] > 0.5, is_nearer, "{} at {} before {}", opacity[i], hair[i], before[i]);
        assert_eq!(drawn[i], hair[i].max(before[i]));
        counts[usize::from(is_nearer)] += 1;
    }
    counts
}

/// A body that is drawn first hides hair that is drawn over it.
#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn bodies_that_are_drawn_before_hide_hair() {
    let body = ball(0.09, 16);
    let pose = Pose::new(DQuat::IDENTITY, DVec3::new(0.05, 0.0, 0.1));
    let (points, offsets) = mane(600, 0.1);
    let strands = Strands::new(&points, &offsets, HairColour::CHESTNUT);
    let body = Scene::new(vec![Body::new(&body, pose)], Vec::new(), camera());
    let hair = Scene::new(Vec::new(), vec![strands], camera());
    let mut renderer = renderer();
    let (_, of_hair) = hidden_over(&mut renderer, &hair, 0.0);
    let (covered, of_body) = hidden_over(&mut renderer, &body, 0.0);
    let both = hidden(&mut renderer, &hair, |renderer, colour| {
        let target = Textures::new(LIGHT, 0.0, 0.0);
        target.draw(renderer, &body).unwrap();
        Textures { colour: Textures::new(LIGHT, colour, 0.0).colour, ..target }
    });
    // Where the body hides the samples of a pixel alike.
    let whole = |own: &[f32]| -> Vec<f32> {
        let pairs = own.iter().zip(&covered);
        pairs.filter(|(_, covered)| **covered == 1.0).map(|(own, _)| *own).collect()
    };
    let [opacity, of_hair, of_body, drawn] = [&both.0, &of_hair, &of_body, &both.1].map(|own| whole(own));
    let counts = compare([&opacity, &of_hair, &of_body, &drawn]);
    assert!(counts[0] > 150 && counts[1] > 10, "{counts:?}");
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn targets_that_do_not_fit_are_refused() {
    let (points, offsets) = mane(20, 0.1);
    let scene = Scene::new(Vec::new(), vec![Strands::new(&points, &offsets, HairColour::BLACK)], camera());
    let mut renderer = renderer();
    let own = Textures::new(LIGHT, 0.0, 0.0);
    let [colour, depth] = [&own.colour, &own.depth].map(|own| own.create_view(&Default::default()));
    let target = Target { colour: &colour, format: LIGHT, depth: &depth, near: NEAR };
    let larger = Settings { width: SIDE + 1, ..settings() };
    let mut refuse = |settings: &Settings, target: Target<'_>, why: &str| {
        let error = renderer.render_over(&scene, settings, &target).unwrap_err().to_string();
        assert!(error.starts_with("the target cannot be drawn over") && error.contains(why), "{error}");
    };
    refuse(&larger, target, "its colour has [64, 64] pixels, but the picture [65, 64]");
    refuse(&settings(), Target { depth: &colour, ..target }, "its depth is Rgba16Float");
    let bytes = wgpu::TextureFormat::Rgba8Unorm;
    refuse(&settings(), Target { format: bytes, ..target }, "its colour is Rgba16Float, not Rgba8Unorm");
    let numbers = texture(wgpu::TextureFormat::R32Uint);
    let numbers = numbers.create_view(&Default::default());
    let format = wgpu::TextureFormat::R32Uint;
    refuse(&settings(), Target { colour: &numbers, format, ..target }, "R32Uint cannot be blended");
    refuse(&settings(), Target { near: 0.0, ..target }, "`near` is 0");
    refuse(&settings(), Target { near: f32::NAN, ..target }, "`near` is NaN");
    renderer.render_over(&scene, &settings(), &target).unwrap();
}
