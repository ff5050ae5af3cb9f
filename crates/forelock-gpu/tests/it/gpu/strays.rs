//! Frames among solids on the GPU and on the CPU from the same state.

#![expect(clippy::unwrap_used, reason = "a test fails where it cannot be set up")]

use super::conformance::{FPS, Solid, frame};
use crate::common::shaken::{ROUNDED_STARTS, options, rounded};
use forelock_core::frame::{FrameInput, FrameReport};
use forelock_core::simulation::Simulation;
use forelock_core::solver::AmsParams;
use forelock_core::strands::{Snapshot, Strands};
use forelock_gpu::{Gpu, GpuSimulation};
use glam::DVec3;

/// Frames in which hair that starts inside a solid is brought out. Rounding decides on which side:
/// float32 and float64 differ by a third of the length on the CPU too.
const COMES_OUT: u32 = 3;

/// Over `frames`: the particles whose position on the GPU differs from that on the CPU a frame
/// after the same state, and from that after starts a rounding apart; the touches on the CPU; and
/// the frames in which all particles agree and the largest depths do not. The solids and the
/// parameters are the GPU's and the CPU's.
pub fn strays(
    gpu: &Gpu,
    strands: &Strands<'_, f32>,
    solids: [&[Solid<'_>]; 2],
    params: [&AmsParams; 2],
    frames: u32,
) -> [usize; 3] {
    let mut own = GpuSimulation::from_strands(gpu, strands, params[0], &options()).unwrap();
    let mut cpu = Simulation::from_strands(strands, params[1], &options()).unwrap();
    let (mut off, mut touching, mut depths) = (0, 0, 0);
    for number in 0..frames {
        own.restore(&cpu.snapshot()).unwrap();
        let [a, b] = solids.map(|solids| solids.iter().map(|s| s.frame(number)).collect::<Vec<_>>());
        if number < COMES_OUT {
            cpu.step_frame(&FrameInput { colliders: &b, ..frame(number) }).unwrap();
            continue;
        }
        let start = cpu.snapshot();
        own.report().unwrap();
        own.step_frame(&FrameInput { colliders: &a, ..frame(number) }).unwrap();
        let report = own.report().unwrap();
        let expected = cpu.step_frame(&FrameInput { colliders: &b, ..frame(number) }).unwrap();
        touching += expected.touching as usize;
        let (own, cpu) = (own.snapshot().unwrap(), cpu.snapshot());
        let apart =
            |a: [f32; 3], b: [f32; 3]| DVec3::from(a.map(f64::from)).distance(DVec3::from(b.map(f64::from)));
        let differs = |cpu: &Snapshot<f32>, p: usize| {
            let x = apart(own.positions[p], cpu.positions[p]);
            let v = apart(own.velocities[p], cpu.velocities[p]) / FPS;
            // A tenth of a millimetre, and as far in the frame to come.
            !(x < 1e-4 && v < 1e-4)
        };
        let mut strays: Vec<usize> = (0..own.positions.len()).filter(|&p| differs(&cpu, p)).collect();
        let agrees = strays.is_empty();
        // A field changes by at most √3 times as much as a position.
        let depth = f64::from(report.max_penetration_m);
        let differs_in_depth = |cpu: &FrameReport| (depth - cpu.max_penetration_m).abs() >= 2e-4;
        let mut is_as_deep = !agrees || !differs_in_depth(&expected);
        for seed in 0..ROUNDED_STARTS {
            if strays.is_empty() && is_as_deep {
                break;
            }
            let positions = rounded(&start.positions, seed);
            let mut other = Simulation::from_strands(strands, params[1], &options()).unwrap();
            other.restore(&Snapshot { positions, ..start.clone() }).unwrap();
            let of_other = other.step_frame(&FrameInput { colliders: &b, ..frame(number) }).unwrap();
            is_as_deep |= !differs_in_depth(&of_other);
            let other = other.snapshot();
            strays.retain(|&p| differs(&other, p));
        }
        off += strays.len();
        depths += usize::from(!is_as_deep);
    }
    [off, touching, depths]
}
