//! Volume and density of the built-in head's hair in motion, with and without the grid and
//! contacts.
//!
//! Volume is the number of cubes of 5 mm, fixed to the head, that a strand passes through. Density
//! is the length of hair in a cube of 20 mm, at any place in steps of 5 mm; the densest cube is
//! compared with the densest at rest. Both are printed relative to the groom at rest.
//!
//! `cargo run --release -p forelock-core --example volume -- [turn|shake|sag|settle|...] [secs]
//! [none|grid|contacts|all] [key=value ...]` with the keys resolution, pic_rate, rest_density,
//! volume_rate, hold (of contacts), strands, preset, amplitude (of the motion; at 1 the
//! shake has 4 g) and every (frames to a line). `sag` is hair without ties that falls from its rest
//! shape; `settle` is a head that is shaken, comes to rest within 2 s and is then held still;
//! strands sleep there, so the mean time of a frame includes frames without work. At its end the
//! strands of which a particle is more than 1 cm from its rest place are counted, and the volume is
//! printed as it is with these strands at their rest places.

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use std::sync::Arc;

use forelock_core::body::{ColliderFrame, Head, Motion, Sdf, Shape};
use forelock_core::frame::FrameInput;
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::{AmsParams, Solver};
use glam::{DVec3, IVec3, Vec3};

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Side of a cube that counts as volume, metres.
const VOXEL: f32 = 5e-3;
/// Side of a cube in which density is measured, voxels.
const DENSITY_CELL: i32 = 4;
/// Distance of samples along a strand, metres.
const STEP: f32 = 1e-3;

/// Distance from its rest place beyond which a strand counts as caught elsewhere, metres.
const CAUGHT: f32 = 0.01;

/// Time for which the head is shaken before hair settles.
const SHAKE_SECS: f64 = 2.0;

/// Speed below which settling hair is still, m/s: as in scenes.
const SLEEP_SPEED: f64 = 2e-3;

/// The hair at one time, relative to the head.
struct Measure {
    /// Litres.
    volume: f64,
    /// Metres of hair in the densest cube.
    densest: f32,
    /// The middle of that cube.
    at: Vec3,
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [plain, settings]: [Vec<&String>; 2] =
        [false, true].map(|keyed| arguments.iter().filter(|a| a.contains('=') == keyed).collect());
    let motion_name = plain.first().map_or("turn", |a| a.as_str());
    let secs: f64 = plain.get(1).map_or(Ok(2.0), |a| a.parse())?;
    let which = plain.get(2).map_or("all", |a| a.as_str());
    let mut grid = GridParams::default();
    let mut contacts = ContactParams::default();
    let mut every = 20;
    let (mut strands, mut preset, mut amplitude) = (10_298, "straight".to_owned(), 1.0);
    for setting in settings {
        let (key, value) = setting.split_once('=').ok_or("not of the form key=value")?;
        match key {
            "resolution" => grid.resolution = value.parse()?,
            "pic_rate" => grid.pic_rate = value.parse()?,
            "rest_density" => grid.rest_density = value.parse()?,
            "volume_rate" => grid.volume_rate = value.parse()?,
            "hold" => contacts.hold = value.parse()?,
            "every" => every = value.parse()?,
            "strands" => strands = value.parse()?,
            "preset" => preset = value.to_owned(),
            "amplitude" => amplitude = value.parse()?,
            _ => return Err(format!("no such key: {key}").into()),
        }
    }
    let sag = motion_name == "sag";
    let settle = motion_name == "settle";
    let mut motion = Motion::by_name(match motion_name {
        "sag" => "still",
        "settle" => "shake",
        name => name,
    })?;
    if let Motion::Builtin(motion) = &mut motion {
        motion.amplitude = amplitude;
        motion.rest_after_secs = settle.then_some(SHAKE_SECS);
    }
    let pose = |secs: f64| motion.pose(secs);
    let groom =
        grow_on_head(&GrowParams { strands, vertices_per_strand: 30, ..GrowParams::preset(&preset)? })?;
    let shape = Shape::Sdf(Arc::new(Sdf::from_mesh(&Head::builtin().mesh, 128, 0.02)?));
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let ties = AmsParams::default();
    let params = if sag { AmsParams { k_integrity: 0.0, k_angular: 0.0, ..ties } } else { ties };
    let sleep_speed = if settle { SLEEP_SPEED } else { 0.0 };
    let options = Options { rest_gravity: gravity, sleep_speed, ..Options::default() };
    let choices = ["none", "grid", "contacts"];
    for (index, choice) in choices.into_iter().enumerate().filter(|(_, c)| which == "all" || which == *c) {
        let mut simulation = Simulation::new(&groom, Solver::from(&params), &options)?;
        simulation.set_grid((index > 0).then_some(&grid))?;
        simulation.set_contacts((index > 1).then_some(&contacts))?;
        let mut positions = Vec::new();
        let mut on_head = |simulation: &Simulation, pose: &Pose| -> Vec<Vec3> {
            simulation.positions(&mut positions);
            let back = pose.inverse();
            positions.iter().map(|x| back.transform_point(x.as_dvec3()).as_vec3()).collect()
        };
        let offsets = groom.strand_offsets();
        let dt_secs = 1.0 / 60.0;
        let at_rest = on_head(&simulation, &pose(0.0));
        let rest = measure(&at_rest, offsets);
        let (mut least, mut most) = (f64::INFINITY, 0.0f32);
        println!(
            "{motion_name}, {choice}: rest {:.2} l, densest {:.1} m at {:.3}",
            rest.volume, rest.densest, rest.at
        );
        let frames = (secs / dt_secs).round() as u32;
        let mut frame_secs = 0.0;
        for frame in 0..frames {
            let head = [frame, frame + 1].map(|f| pose(f64::from(f) * dt_secs));
            let collider = ColliderFrame {
                shape: &shape,
                local: Pose::IDENTITY,
                from: head[0],
                to: head[1],
                friction: 0.3,
            };
            let clock = std::time::Instant::now();
            let report = simulation.step_frame(&FrameInput {
                roots: head.into(),
                colliders: &[collider],
                gravity,
                dt_secs,
                ..FrameInput::default()
            })?;
            frame_secs += clock.elapsed().as_secs_f64();
            if frame % 4 != 3 && frame + 1 != frames {
                continue;
            }
            let now = measure(&on_head(&simulation, &head[1]), offsets);
            let volume = now.volume / rest.volume;
            let density = now.densest / rest.densest;
            least = least.min(volume);
            most = most.max(density);
            if (frame + 1) % every == 0 || frame + 1 == frames {
                println!(
                    "  {:.2} s: volume {volume:.3}, density {density:.3} at {:.3}; densest cell {:.2}, {} cells, {} \
                     iterations",
                    f64::from(frame + 1) * dt_secs,
                    now.at,
                    report.grid.densest,
                    report.grid.cells,
                    report.grid.iterations,
                );
            }
        }
        if settle {
            let mut hair = on_head(&simulation, &pose(secs));
            let caught = put_back(&mut hair, &at_rest, offsets);
            let volume = measure(&hair, offsets).volume / rest.volume;
            println!(
                "  {caught} strands caught elsewhere; volume with them at their rest places {volume:.3}"
            );
        }
        println!(
            "  least volume {least:.3}, most density {most:.3}; {:.1} ms a frame",
            1e3 * frame_secs / f64::from(frames)
        );
    }
    Ok(())
}

/// Puts the strands that are caught elsewhere to their rest places, and returns their number.
fn put_back(hair: &mut [Vec3], rest: &[Vec3], offsets: &[u32]) -> usize {
    let mut caught = 0;
    for strand in offsets.windows(2) {
        let own = strand[0] as usize..strand[1] as usize;
        let off = hair[own.clone()].iter().zip(&rest[own.clone()]).map(|(x, rest)| x.distance(*rest));
        if off.fold(0.0, f32::max) > CAUGHT {
            hair[own.clone()].copy_from_slice(&rest[own]);
            caught += 1;
        }
    }
    caught
}

fn measure(positions: &[Vec3], offsets: &[u32]) -> Measure {
    let mut low = IVec3::MAX;
    let mut high = IVec3::MIN;
    let key = |x: Vec3| (x / VOXEL).floor().as_ivec3();
    for x in positions {
        (low, high) = (low.min(key(*x)), high.max(key(*x)));
    }
    low -= DENSITY_CELL;
    let dims = high - low + 1 + DENSITY_CELL;
    let strides = [1, dims.x, dims.x * dims.y];
    let index = |at: IVec3| (at - low).dot(IVec3::from_array(strides)) as usize;
    let mut lengths = vec![0.0f32; dims.as_usizevec3().element_product()];
    for strand in offsets.windows(2) {
        for edge in positions[strand[0] as usize..strand[1] as usize].windows(2) {
            let length = edge[0].distance(edge[1]);
            let samples = (length / STEP).ceil().max(1.0) as u16;
            for sample in 0..samples {
                let along = (f32::from(sample) + 0.5) / f32::from(samples);
                lengths[index(key(edge[0].lerp(edge[1], along)))] += length / f32::from(samples);
            }
        }
    }
    let voxels = lengths.iter().filter(|length| **length > 0.0).count();
    // Sums over the voxels of a cube, one axis after the other.
    let mut sums = lengths;
    for stride in strides {
        let stride = stride as usize;
        for at in 0..sums.len() - (DENSITY_CELL as usize - 1) * stride {
            sums[at] += (1..DENSITY_CELL as usize).map(|k| sums[at + k * stride]).sum::<f32>();
        }
    }
    let (at, densest) =
        sums.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map_or((0, 0.0), |(i, x)| (i as i32, *x));
    let cell = IVec3::new(at % dims.x, at / dims.x % dims.y, at / dims.x / dims.y) + low;
    Measure {
        volume: voxels as f64 * f64::from(VOXEL).powi(3) * 1e3,
        densest,
        at: (cell.as_vec3() + 0.5 * DENSITY_CELL as f32) * VOXEL,
    }
}
