//! How much of the picture strands cover.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use super::renderer;
use crate::pictures::{PX, SIDE, line, linear, plain};
use forelock_render::gpu::GpuRenderer;
use forelock_render::{HairColour, Image, Light, Settings, Strands};
use glam::Vec3;

/// Black lines, `width_px` wide, over grey.
fn draw_lines(renderer: &mut GpuRenderer, lines: &[Vec<Vec3>], width_px: f32) -> Image {
    let positions = lines.concat();
    let mut offsets = vec![0];
    offsets.extend(lines.iter().scan(0, |end, line| {
        *end += line.len() as u32;
        Some(*end)
    }));
    let widths = vec![width_px * PX; positions.len()];
    let strands = Strands { widths: Some(&widths), ..Strands::new(&positions, &offsets, HairColour::BLACK) };
    let (scene, settings) = plain(vec![strands], Vec::new(), 0.0);
    renderer.render(&scene, &settings).unwrap()
}

/// Pixels' worth of grey that is hidden.
fn covered(image: &Image, empty: &Image) -> f32 {
    let pairs = image.rgba().chunks_exact(4).zip(empty.rgba().chunks_exact(4));
    pairs.map(|(seen, behind)| (linear(behind[1]) - linear(seen[1])) / 0.5).sum()
}

/// A black line lit from the camera, far away, so that its surface reflects equally much everywhere
/// and other hair passes no light on; in front of black. Returns the sum of the green light of all
/// pixels, and that of the one in the middle.
fn bright_line(renderer: &mut GpuRenderer, positions: &[Vec3], width_px: f32, exposure: f32) -> [f32; 2] {
    let offsets = [0, positions.len() as u32];
    let widths = vec![width_px * PX; positions.len()];
    let colours = vec![[0.0; 3]; positions.len()];
    let plain_strands = Strands::new(positions, &offsets, HairColour::BLACK);
    let strands = Strands { widths: Some(&widths), colours: Some(&colours), ..plain_strands };
    let (mut scene, settings) = plain(vec![strands], Vec::new(), 0.0);
    (scene.backdrop.top, scene.backdrop.bottom) = (Vec3::ZERO, Vec3::ZERO);
    scene.lights = vec![Light { direction: Vec3::Z, colour: Vec3::ONE, shadows: false }];
    scene.camera.eye = Vec3::Z * 30.0;
    scene.camera.fov_y = 2.0 * (SIDE as f32 * 0.5 * PX / 30.0).atan();
    let image = renderer.render(&scene, &Settings { exposure, ..settings }).unwrap();
    let all = image.rgba().chunks_exact(4).map(|pixel| linear(pixel[1])).sum();
    [all, linear(image.pixel(SIDE / 2, SIDE / 2)[1])]
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn a_strand_covers_its_exact_area_at_any_angle_and_place() {
    let mut renderer = renderer();
    // The light of a pixel that is covered wholly, from all such pixels of a wide strand.
    let wide = line(0.0, 0.0, 0.0, 2.2 * SIDE as f32, 2);
    let [_, roughly] = bright_line(&mut renderer, &wide, 21.0, 0.1);
    let exposed = 0.5 * 0.1 / roughly;
    let full = bright_line(&mut renderer, &wide, 21.0, exposed)[0] / (21.0 * SIDE as f32) / exposed;
    for width in [0.1_f32, 0.4, 0.9, 2.5, 21.0] {
        for angle in [0.0, 7.0, 30.0, 45.0, 63.0, 80.0, 90.0, 110.0, 159.0] {
            let (sin, cos) = f32::to_radians(angle).sin_cos();
            for offset in [0.0, 0.13, 0.5, 0.77] {
                let mut expected = width * SIDE as f32 / sin.abs().max(cos.abs());
                if angle == 45.0 {
                    // The parts beyond the corners of the picture.
                    let sides = [0.5 * width + offset, 0.5 * width - offset];
                    expected -= sides.map(|side| side * side.abs()).iter().sum::<f32>();
                }
                // From one side of the picture to the other.
                let strand = line(offset * sin, -offset * cos, angle, 2.2 * SIDE as f32, 29);
                // Below the bend of the tone curve.
                let exposure = 0.35 / full / width.min(1.0);
                let [light, _] = bright_line(&mut renderer, &strand, width, exposure);
                let error = light / (full * exposure * expected) - 1.0;
                assert!(error.abs() < 0.01, "{error}: {width} px at {angle}° {offset}");
            }
        }
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn a_strand_with_both_ends_in_the_picture_covers_its_area() {
    let mut renderer = renderer();
    let empty = draw_lines(&mut renderer, &[], 1.0);
    for width in [0.4, 0.9, 2.5] {
        for angle in [0.0, 30.0, 45.0, 80.0, 90.0] {
            for offset in [0.0, 0.25, 0.77] {
                let strand = line(offset, offset, angle, 90.3, 2);
                let found = covered(&draw_lines(&mut renderer, &[strand], width), &empty);
                // The ends are exact only along rows and columns, as on the CPU.
                let error = (found / (width * 90.3) - 1.0).abs();
                assert!(error < 0.01 + 0.005, "{error}: {width} px at {angle}° {offset}");
            }
        }
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "needs a GPU")]
fn no_pixel_is_bald_within_a_sheet_of_hair() {
    let mut renderer = renderer();
    for (angle, width, spacing) in [(0.0, 1.5, 0.4), (33.0, 1.2, 0.4), (90.0, 1.5, 0.4), (62.0, 30.0, 9.0)] {
        let (sin, cos) = f32::to_radians(angle).sin_cos();
        let count = (2.0 * SIDE as f32 / spacing) as i32;
        let lines: Vec<_> = (-count / 2..count / 2)
            .map(|n| n as f32 * spacing)
            .map(|at| line(-at * sin, at * cos, angle, 2.0 * SIDE as f32, 12))
            .collect();
        let image = draw_lines(&mut renderer, &lines, width);
        let brightest = image.rgba().chunks_exact(4).map(|pixel| pixel[1]).max();
        assert!(brightest <= Some(24), "{brightest:?} at {angle}°");
    }
}
