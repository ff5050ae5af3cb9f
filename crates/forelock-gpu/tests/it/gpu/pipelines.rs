//! Pipelines are made at first use, once a device, and only those that a frame needs.

use crate::common;
use crate::common::shaken::{GRAVITY, head, options, tuft};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{FrameInput, Roots};
use forelock_core::interaction::grid::GridParams;
use forelock_core::pose::Pose;
use forelock_core::solver::AmsParams;
use forelock_core::strands::Strands;
use forelock_gpu::{Choice, Gpu, GpuSimulation};
use glam::DVec3;

/// A frame at rest among `colliders`.
fn still<'a>(colliders: &'a [ColliderFrame<'a>]) -> FrameInput<'a> {
    let dt_secs = 1.0 / 60.0;
    FrameInput {
        roots: Roots::Rigid([head(0.0); 2]),
        colliders,
        gravity: GRAVITY,
        dt_secs,
        ..FrameInput::default()
    }
}

/// The entry points of the pipelines that `gpu` has made.
fn entries(gpu: &Gpu) -> Vec<&'static str> {
    gpu.made_pipelines().iter().map(|kernel| kernel.entry).collect()
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_frame_makes_only_the_pipelines_that_it_needs() {
    let gpu = common::gpu();
    // A device of its own: pipelines belong to the device.
    let gpu = Gpu::open(&Choice::Named(gpu.name().to_owned())).unwrap();
    let (positions, offsets) = tuft(40, |_| 8, [0.001, 0.01]);
    let strands = Strands::new(&positions, &offsets);
    let new = || GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let mut own = new();
    assert_eq!(entries(&gpu), [""; 0], "construction makes none");
    own.step_frame(&still(&[])).unwrap();
    let mut expected = vec!["solve_strands", "restore_lengths", "check_strands"];
    assert_eq!(entries(&gpu), expected);
    assert_eq!(gpu.counts().pipelines, 3);

    let ball = Shape::Sphere { radius: 0.05 };
    let pose = Pose::new(glam::DQuat::IDENTITY, DVec3::new(0.0, -0.2, 0.0));
    let local = Pose::IDENTITY;
    let solid = ColliderFrame { shape: &ball, local, from: pose, to: pose, friction: 0.3 };
    own.step_frame(&still(&[solid])).unwrap();
    expected.push("resolve_solids");
    assert_eq!(entries(&gpu), expected);

    // Another simulation on the device uses the same ones.
    new().step_frame(&still(&[])).unwrap();
    assert_eq!(entries(&gpu), expected);

    own.set_grid(Some(&GridParams { iterations: 4, ..GridParams::default() })).unwrap();
    assert_eq!(entries(&gpu), expected);
    own.step_frame(&still(&[])).unwrap();
    let made = gpu.made_pipelines();
    let grid: Vec<_> = made[expected.len()..].iter().map(|kernel| kernel.shader.stage).collect();
    assert_eq!(grid.len(), 14);
    assert!(grid.iter().all(|own| ["splat_segments", "solve_pressure", "gather_velocities"].contains(own)));
    own.step_frame(&still(&[])).unwrap();
    assert_eq!(gpu.counts().pipelines as usize, made.len(), "further frames make none");
}
