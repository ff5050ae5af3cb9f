//! An engine simulates and draws hair on its own device: simulated positions stay there.
//!
//! `cargo run --release -p forelock --example on_device` turns a head by 60 degrees, draws each
//! frame over what the engine has drawn, checks the last one and writes it to `on-device.png`.
#![expect(clippy::print_stdout, reason = "an example prints")]

use std::error::Error;
use std::fs::File;
use std::io::BufWriter;
use std::sync::Arc;
use std::time::Instant;

use forelock::core::body::{ColliderFrame, Head, Sdf, Shape};
use forelock::core::frame::{FrameInput, Roots};
use forelock::core::groom::grow::{GrowParams, grow_on_head};
use forelock::core::pose::Pose;
use forelock::core::simulation::Options;
use forelock::core::solver::AmsParams;
use forelock_gpu::{Choice, DevicePositions, Gpu, GpuSimulation};
use forelock_render::gpu::{GpuRenderError, GpuRenderer, SharedPositions, Target};
use forelock_render::{Body, Camera, Face, HairColour, Image, Scene, Settings, Strands};
use glam::{DQuat, DVec3};

const SIDE: u32 = 320;
const FRAMES: i32 = 40;
const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
const SKY: wgpu::Color = wgpu::Color { r: 0.2, g: 0.3, b: 0.5, a: 1.0 };

/// The textures that the engine draws into.
struct Textures {
    colour: wgpu::Texture,
    depth: wgpu::Texture,
}

impl Textures {
    fn new(device: &wgpu::Device) -> Self {
        let texture = |format, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d { width: SIDE, height: SIDE, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            })
        };
        Self {
            colour: texture(COLOUR, wgpu::TextureUsages::COPY_SRC),
            depth: texture(wgpu::TextureFormat::Depth32Float, wgpu::TextureUsages::TEXTURE_BINDING),
        }
    }

    /// The engine's own picture: the sky, infinitely far away.
    fn draw_sky(&self, gpu: &Gpu, colour: &wgpu::TextureView, depth: &wgpu::TextureView) {
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        let store = wgpu::StoreOp::Store;
        drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: colour,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(SKY), store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store }),
                stencil_ops: None,
            }),
            ..Default::default()
        }));
        gpu.queue().submit([encoder.finish()]);
    }

    fn picture(&self, gpu: &Gpu) -> Result<Image, Box<dyn Error>> {
        let staging = gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(4 * SIDE * SIDE),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * SIDE), rows_per_image: None };
        let target = wgpu::TexelCopyBufferInfo { buffer: &staging, layout };
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(self.colour.as_image_copy(), target, self.colour.size());
        gpu.queue().submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |_| {});
        gpu.wait()?;
        Ok(Image::from_rgba(SIDE, SIDE, staging.get_mapped_range(..).to_vec())?)
    }
}

/// The head after `frame` frames: it turns from one side to the other.
fn pose(frame: i32) -> Pose {
    let share = f64::from(frame) / f64::from(FRAMES);
    let smooth = share * share * (3.0 - 2.0 * share);
    Pose::new(DQuat::from_rotation_y(smooth - 0.5), DVec3::ZERO)
}

/// The positions of the simulation, where they are on the device.
fn shared(gpu: &Gpu, simulation: &GpuSimulation) -> Result<SharedPositions, GpuRenderError> {
    let on_device = simulation.positions();
    let mut shared = SharedPositions::new(on_device.origin.as_vec3());
    // How far hair may swing out of the box around its rest shape, metres.
    shared.margin = 0.1;
    for (buffer, places) in on_device.buffers.iter().zip(&on_device.places) {
        shared.add(gpu.device(), buffer, DevicePositions::STRIDE, places)?;
    }
    Ok(shared)
}

fn main() -> Result<(), Box<dyn Error>> {
    // An engine that has a device passes it to `Gpu::from_device`.
    let gpu = Gpu::open(&Choice::Fastest)?;
    let head = Head::builtin();
    let groom = grow_on_head(&GrowParams { strands: 3000, ..GrowParams::preset("wavy")? })?;
    let shape = Shape::Sdf(Arc::new(Sdf::from_mesh(&head.mesh, 64, 0.02)?));
    let mut simulation = GpuSimulation::new(&gpu, &groom, &AmsParams::default(), &Options::default())?;
    let mut shared = shared(&gpu, &simulation)?;

    let mut renderer = GpuRenderer::new(gpu.device(), gpu.queue());
    let textures = Textures::new(gpu.device());
    let [colour, depth] = [&textures.colour, &textures.depth].map(|own| own.create_view(&Default::default()));
    let target = Target { colour: &colour, format: COLOUR, depth: &depth, near: 0.05 };
    let camera = Camera::framing(head.mesh.bounds(), 0.6, 0.1);
    let settings = Settings { width: SIDE, height: SIDE, ..Settings::default() };

    let mut started = Instant::now();
    for frame in 0..FRAMES {
        if frame == 1 {
            // The first frame compiles kernels.
            started = Instant::now();
        }
        let (from, to) = (pose(frame), pose(frame + 1));
        let solid = ColliderFrame { shape: &shape, local: Pose::IDENTITY, from, to, friction: 0.3 };
        simulation.step_frame(&FrameInput {
            roots: Roots::Rigid([from, to]),
            colliders: &[solid],
            gravity: DVec3::new(0.0, -9.81, 0.0),
            ..FrameInput::default()
        })?;
        textures.draw_sky(&gpu, &colour, &depth);
        // The head turns where it is, so the rest shape tells well enough where the hair is. Hair
        // of a head that travels would be moved with it here.
        let hair = Strands::new(groom.positions(), groom.strand_offsets(), HairColour::CHESTNUT);
        let brows = HairColour::CHESTNUT.albedo();
        let face = Some(Face { rest: &head.mesh.positions, brows });
        let body = Body { face, ..Body::new(&head.mesh, to) };
        let scene = Scene::new(vec![body], vec![hair], camera);
        shared.origin = simulation.positions().origin.as_vec3();
        renderer.share(0, Some(shared.clone()));
        renderer.render_over(&scene, &settings, &target)?;
        // An engine waits for its display here.
        gpu.wait()?;
    }
    let picture = textures.picture(&gpu)?;
    let ms = started.elapsed().as_secs_f64() * 1e3 / f64::from(FRAMES - 1);
    let uploaded = renderer.report().uploaded_bytes;
    println!("{}: {ms:.1} ms and {uploaded} uploaded bytes a frame", gpu.name());
    // Less than the positions, which stay on the device.
    assert!(uploaded > 0 && uploaded < size_of_val(groom.positions()) as u64);

    let sky = picture.pixel(0, 0);
    let covered = picture.rgba().chunks_exact(4).filter(|pixel| **pixel != sky).count();
    println!("{covered} of {} pixels show head and hair", SIDE * SIDE);
    assert!((20_000..80_000).contains(&covered));
    assert_eq!(simulation.report()?.quarantined_strands, 0);
    picture.write_png(BufWriter::new(File::create("on-device.png")?))?;
    Ok(())
}
