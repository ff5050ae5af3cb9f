//! The times of stages by the device's clock.

use crate::common;
use crate::common::shaken::{GRAVITY, head, options, tuft};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{Acceleration, FrameInput};
use forelock_core::pose::Pose;
use forelock_core::solver::AmsParams;
use forelock_core::strands::Strands;
use forelock_gpu::GpuSimulation;
use glam::{DVec3, Vec3};

const DT: f64 = 1.0 / 60.0;
const BALL: Shape = Shape::Sphere { radius: 0.05 };

/// A ball on the head.
fn ball(number: u32) -> ColliderFrame<'static> {
    let local = Pose { translation: DVec3::new(0.03, -0.12, 0.0), ..Pose::IDENTITY };
    let [from, to] = [number, number + 1].map(|number| head(f64::from(number) * DT));
    ColliderFrame { shape: &BALL, local, from, to, friction: 0.4 }
}

fn frame(number: u32) -> FrameInput<'static> {
    let roots = [number, number + 1].map(|number| head(f64::from(number) * DT)).into();
    FrameInput { roots, gravity: GRAVITY, dt_secs: DT, ..FrameInput::default() }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn stages_are_timed_and_bits_stay_the_same() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(200, |_| 20, [0.001, 0.01]);
    let strands = Strands::new(&positions, &offsets);
    let run = |timed: bool| {
        let mut own = GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
        let can = own.time_stages(timed);
        for number in 0..5 {
            own.step_frame(&FrameInput { colliders: &[ball(number)], ..frame(number) }).unwrap();
        }
        let secs = own.report().unwrap().secs;
        assert_eq!(secs.is_some(), can);
        let ran = ["solve_strands", "resolve_solids", "restore_lengths", "check_strands"];
        if let Some(secs) = secs {
            let names: Vec<_> = secs.stages.iter().map(|(name, _)| *name).collect();
            assert_eq!(names, ran);
            assert!(secs.stages.iter().all(|(_, secs)| *secs > 0.0 && *secs < 10.0), "{secs:?}");
            assert!(secs.whole >= 0.999 * secs.stages.iter().map(|(_, secs)| secs).sum::<f64>(), "{secs:?}");
        }
        own.state_hash().unwrap()
    };
    assert_eq!(run(true), run(false));
}

/// A frame with more passes than the clock can time reports no times, and frames after it are timed
/// again.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_frame_of_too_many_passes_is_not_timed() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(1, |_| 4, [0.001, 0.01]);
    let strands = Strands::new(&positions, &offsets);
    let few = AmsParams::default();
    let mut own = GpuSimulation::from_strands(&gpu, &strands, &few, &options()).unwrap();
    let can = own.time_stages(true);
    let pushed = [Vec3::X; 4];
    let mut number = 0;
    let mut is_timed = |own: &mut GpuSimulation| {
        let acceleration = Acceleration::PerParticle(&pushed);
        own.step_frame(&FrameInput { colliders: &[ball(number)], acceleration, ..frame(number) }).unwrap();
        number += 1;
        let report = own.report().unwrap();
        assert_eq!(report.quarantined_strands, 0);
        report.secs.is_some()
    };
    assert_eq!(is_timed(&mut own), can);
    // Three stages a substep.
    own.set_params(&AmsParams { substep_secs: 1.0 / 60e3, ..few.clone() }).unwrap();
    assert!(!is_timed(&mut own));
    own.set_params(&few).unwrap();
    assert_eq!(is_timed(&mut own), can);
}
