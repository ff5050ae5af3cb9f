//! What a device can hold and do.

use super::conformance::{frame, tuft};
use crate::common::{self, shaken::options};
use forelock_core::frame::FrameInput;
use forelock_core::interaction::contact::ContactParams;
use forelock_core::solver::AmsParams;
use forelock_core::strands::Strands;
use forelock_gpu::{Choice, Gpu, GpuError, GpuSimulation};

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn what_a_gpu_cannot_do_is_said() {
    let gpu = common::gpu();
    let named = Gpu::open(&Choice::Named("a name that no one has".to_owned()));
    let text = named.unwrap_err().to_string();
    assert!(text.contains("a name that no one has") && text.contains(gpu.name()), "{text}");
    let (positions, offsets) = tuft(10, |_| 20);
    let strands = Strands::new(&positions, &offsets);
    let gpu = Gpu::open(&Choice::Named(gpu.name().to_owned())).unwrap();
    let mut simulation =
        GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let too_stiff = FrameInput { dt_secs: 1e3, ..frame(0) };
    assert!(matches!(simulation.step_frame(&too_stiff), Err(GpuError::Params(_))));
    simulation.step_frame(&frame(0)).unwrap();
    // A device that is gone, and a driver that says so while one waits.
    let gone = Gpu::open(&Choice::Named(gpu.name().to_owned())).unwrap();
    let mut on_gone =
        GpuSimulation::from_strands(&gone, &strands, &AmsParams::default(), &options()).unwrap();
    gone.device().destroy();
    assert!(matches!(on_gone.snapshot(), Err(GpuError::Failed { .. })));
    assert!(matches!(on_gone.step_frame(&frame(0)), Err(GpuError::Failed { .. })));
    gpu.lose("a cable was pulled");
    for error in [simulation.step_frame(&frame(1)).unwrap_err(), simulation.snapshot().unwrap_err()] {
        assert!(
            matches!(&error, GpuError::Failed { .. }) && error.to_string().contains("a cable was pulled"),
            "{error}"
        );
    }
}

/// 15,000 × 30, the paper's hand scene: at most 200 bytes per particle, also with contacts, without
/// their cell table.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn two_hundred_bytes_a_particle() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(15_000, |_| 30);
    let strands = Strands::new(&positions, &offsets);
    let mut simulation =
        GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let bytes = |simulation: &GpuSimulation| simulation.bytes() as f64 / positions.len() as f64;
    let alone = bytes(&simulation);
    simulation.set_contacts(Some(&ContactParams::default())).unwrap();
    let touching = bytes(&simulation);
    println!("{alone:.1} bytes a particle on the device, with contacts {touching:.1}");
    // Two numbers per cell, of which there are up to twice as many as segments.
    let table = f64::from(8 * (15_000 * 29u32).next_power_of_two()) / positions.len() as f64;
    assert!(alone <= 200.0 && touching <= 200.0 + table, "{alone} {touching}");
}
