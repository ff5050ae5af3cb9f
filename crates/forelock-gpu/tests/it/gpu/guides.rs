//! Guides that carry all strands on the GPU, against the same on the CPU.

use crate::common;
use forelock_core::frame::{Air, FrameInput};
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::groom::guides::Skinning;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use forelock_gpu::{GpuError, GpuSimulation, GpuSkinning};
use glam::{DQuat, DVec3, Vec3};

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn strands_are_carried_as_on_the_cpu() {
    let gpu = common::gpu();
    let preset = GrowParams::preset("wavy").unwrap();
    let groom = grow_on_head(&GrowParams { strands: 600, vertices_per_strand: 18, ..preset }).unwrap();
    let mut skinning = Skinning::new(&groom, 40, 7).unwrap();
    let head = |frame: u32| {
        let t = f64::from(frame) / 60.0;
        let turn = DQuat::from_rotation_y(2.0 * t) * DQuat::from_rotation_x((4.0 * t).sin());
        Pose::new(turn, DVec3::new(30.0, 1.6 + 0.1 * (9.0 * t).sin(), t * t))
    };
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let options = Options { rest_pose: head(0), rest_gravity: gravity, ..Options::default() };
    let mut cpu = Simulation::new(skinning.guides(), &AmsParams::default(), &options).unwrap();
    let (mut guides, mut expected) = (Vec::new(), Vec::new());
    for number in 0..25 {
        let head = [head(number), head(number + 1)];
        let air_velocity = DVec3::new(2.0, 0.0, 0.0);
        cpu.step_frame(&FrameInput {
            roots: head.into(),
            gravity,
            air: Air::uniform(air_velocity),
            dt_secs: 1.0 / 60.0,
            ..FrameInput::default()
        })
        .unwrap();
    }
    let own = GpuSimulation::continuing(&gpu, &cpu).unwrap();
    let carried = GpuSkinning::new(&skinning, &own).unwrap();
    carried.place(&head(25)).unwrap();
    let found = carried.read().unwrap();
    cpu.positions(&mut guides);
    skinning.skin(&head(25), &guides, &mut expected);
    assert_eq!(found.len(), expected.len());
    let origin = cpu.state().origin;
    let apart = |(a, b): (&Vec3, &Vec3)| (a.as_dvec3() + origin - b.as_dvec3()).length();
    let worst = found.iter().zip(&expected).map(apart).fold(0.0, f64::max);
    let moved = groom.positions().iter().zip(&expected);
    let moved = moved.map(|(a, b)| (head(25).transform_point(a.as_dvec3()) - b.as_dvec3()).length());
    let moved = moved.fold(0.0, f64::max);
    println!("worst {worst:.1e} m, of hair that moved {moved:.2} m against the head");
    // Guides in the world, 30 m from its origin, are float32 on the CPU. Their positions have steps
    // of 2e-6 m, which turn their edges.
    assert!(moved > 0.02 && worst < 6e-5, "{worst} of {moved}");
    // A head that is turned otherwise is seen, and guides of another groom are refused.
    carried.place(&head(20)).unwrap();
    let other = carried.read().unwrap();
    let worst = other.iter().zip(&expected).map(apart).fold(0.0, f64::max);
    assert!(worst > 2e-3, "{worst}");
    for (count, seed) in [(30, 7), (40, 8)] {
        let others = Skinning::new(&groom, count, seed).unwrap();
        assert!(matches!(GpuSkinning::new(&others, &own), Err(GpuError::Guides)), "{count} of seed {seed}");
    }
}
