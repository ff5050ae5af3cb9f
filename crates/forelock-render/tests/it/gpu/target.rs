//! Drawing into a texture of the caller.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use super::agreement::mane;
use super::{gpu, renderer};
use forelock_render::{Camera, HairColour, Scene, Settings, Strands};
use glam::Vec3;

pub const SIDE: u32 = 64;

/// The bytes of a texture of `SIDE` × `SIDE` pixels.
pub fn read(texture: &wgpu::Texture) -> Vec<u8> {
    let gpu = gpu();
    let pixel = texture.format().block_copy_size(None).unwrap();
    let staging = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(pixel * SIDE * SIDE),
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(pixel * SIDE), rows_per_image: None };
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    let target = wgpu::TexelCopyBufferInfo { buffer: &staging, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), target, texture.size());
    gpu.queue().submit([encoder.finish()]);
    staging.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    gpu.wait().unwrap();
    staging.get_mapped_range(..).to_vec()
}

/// A target of `SIDE` × `SIDE` pixels.
pub fn texture(format: wgpu::TextureFormat) -> wgpu::Texture {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    let bound = if format.is_depth_stencil_format() { wgpu::TextureUsages::TEXTURE_BINDING } else { usage };
    gpu().device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: SIDE, height: SIDE, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: usage | bound,
        view_formats: &[],
    })
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn a_given_target_shows_the_same_picture() {
    let (points, offsets) = mane(500, 0.1);
    let strands = Strands::new(&points, &offsets, HairColour::CHESTNUT);
    let camera = Camera::framing((Vec3::splat(-0.15), Vec3::splat(0.15)), 0.3, 0.2);
    let scene = Scene::new(Vec::new(), vec![strands], camera);
    let settings = Settings { width: SIDE, height: SIDE, ..Settings::default() };
    let mut renderer = renderer();
    let image = renderer.render(&scene, &settings).unwrap();
    for format in [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba8UnormSrgb] {
        let texture = texture(format);
        let view = texture.create_view(&Default::default());
        renderer.render_to(&scene, &settings, &view, format).unwrap();
        let worst = read(&texture).iter().zip(image.rgba()).map(|(a, b)| a.abs_diff(*b)).max();
        // Encoding sRGB twice may round differently.
        let allowed = if format.is_srgb() { 1 } else { 0 };
        assert!(worst <= Some(allowed), "{worst:?} in {format:?}");
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn a_frame_that_is_not_waited_for_leaves_its_report_and_its_room_to_later_ones() {
    let (points, offsets) = mane(60, 0.1);
    let strands = Strands::new(&points, &offsets, HairColour::CHESTNUT);
    let camera = Camera::framing((Vec3::splat(-0.15), Vec3::splat(0.15)), 0.3, 0.2);
    let scene = Scene::new(Vec::new(), vec![strands], camera);
    // So wide that each piece touches many tiles.
    let (width_scale, children) = (Some(1000.0), Some(1));
    let settings = Settings { width: SIDE, height: SIDE, width_scale, children, ..Settings::default() };
    let format = wgpu::TextureFormat::Rgba8Unorm;
    let texture = texture(format);
    let view = texture.create_view(&Default::default());
    let mut renderer = renderer();
    let mut dropped = Vec::new();
    for _ in 0..4 {
        renderer.render_to(&scene, &settings, &view, format).unwrap();
        dropped.push(renderer.report().dropped);
        gpu().wait().unwrap();
    }
    assert!(dropped[0] == 0 && dropped[1] > 0, "{dropped:?} {:?}", renderer.report());
    assert_eq!(dropped[2..], [0, 0], "{:?}", renderer.report());
    assert!(renderer.render(&scene, &settings).unwrap().rgba() == read(&texture));
}
