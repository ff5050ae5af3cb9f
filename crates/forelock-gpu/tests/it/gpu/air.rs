//! Hair in wind that is not the same everywhere, on the GPU, against the same on the CPU.

#![expect(clippy::unwrap_used, reason = "a test fails where it cannot be set up")]

use crate::common::{self, rms::rms};
use forelock_core::air::{Wind, WindField, WindParams};
use forelock_core::body::{ColliderFrame, Sdf, Shape};
use forelock_core::frame::{Air, FrameInput, Roots};
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use forelock_core::strands::{Snapshot, Strands};
use forelock_gpu::{Gpu, GpuSimulation};
use glam::{DQuat, DVec3, UVec3, Vec3};
use std::sync::Arc;

const FPS: f64 = 60.0;

/// `count` wavy strands about a ball.
fn hair(count: u32) -> (Vec<[f32; 3]>, Vec<u32>) {
    let (mut positions, mut offsets) = (Vec::new(), vec![0]);
    for strand in 0..count {
        let angle = 2.399_963 * f64::from(strand);
        let height = 1.0 - f64::from(strand) / f64::from(count);
        let flat = (1.0 - height * height).sqrt();
        let out = DVec3::new(flat * angle.cos(), height, flat * angle.sin());
        for i in 0..20 {
            let s = f64::from(i) / 19.0;
            let wave = DVec3::new((12.0 * s + angle).cos(), 0.0, (12.0 * s).sin()) * (0.004 * s);
            positions.push((0.1 * out + 0.15 * s * (out - DVec3::Y) + wave).as_vec3().to_array());
        }
        offsets.push(positions.len() as u32);
    }
    (positions, offsets)
}

/// A head that turns and runs.
fn head(frame: u32) -> Pose {
    let t = f64::from(frame) / FPS;
    Pose::new(
        DQuat::from_rotation_y((3.0 * t).sin()),
        DVec3::new(40.0 + 0.3 * t, 1.7, 0.06 * (9.0 * t).sin()),
    )
}

/// `frame` in a wind field.
fn within<'a>(frame: &FrameInput<'a>, field: Option<&'a WindField>) -> FrameInput<'a> {
    FrameInput { air: Air { field, ..frame.air }, ..*frame }
}

fn frame(number: u32) -> FrameInput<'static> {
    FrameInput {
        roots: Roots::Rigid([head(number), head(number + 1)]),
        gravity: DVec3::new(0.0, -9.81, 0.0),
        air: Air::uniform(DVec3::new(0.0, 0.5, 0.0)),
        dt_secs: 1.0 / FPS,
        ..FrameInput::default()
    }
}

/// A ball on the head, and a field of a ball beside it that moves.
struct Solids([Shape; 2]);

impl Solids {
    fn new() -> Self {
        let node = |at: u32| (f64::from(at) - 11.5) * 0.008;
        let values = (0..24u32.pow(3)).map(|at| {
            let [x, y, z] = [at % 24, at / 24 % 24, at / 576].map(node);
            ((x * x + y * y + z * z).sqrt() - 0.06) as f32
        });
        let first = Vec3::splat(node(0) as f32);
        let field = Sdf::new(UVec3::splat(24), first, 0.008, values.collect()).unwrap();
        Self([Shape::Sphere { radius: 0.1 }, Shape::Sdf(Arc::new(field))])
    }

    fn at(&self, number: u32) -> [ColliderFrame<'_>; 2] {
        std::array::from_fn(|k| {
            let [from, to] = [number, number + 1].map(|frame| {
                let aside = DVec3::new(-0.15 - 0.002 * f64::from(frame), 0.02, -0.1) * k as f64;
                head(frame).after(&Pose::new(DQuat::IDENTITY, aside))
            });
            ColliderFrame { shape: &self.0[k], local: Pose::IDENTITY, from, to, friction: 0.3 }
        })
    }
}

/// The wind of `params` in a frame.
fn field(params: &WindParams, number: u32) -> WindField {
    Wind::new(params).unwrap().at(f64::from(number) / FPS)
}

/// The number of the frame that is compared.
const NUMBER: u32 = 4;

/// Hair on the GPU after frames without wind, in a wind from elsewhere and in a wind.
struct Start<'a> {
    own: GpuSimulation,
    solids: &'a Solids,
    state: Snapshot<f32>,
    /// Velocities after the next frame on the CPU, in that wind.
    expected: Vec<[f32; 3]>,
    /// The same in its mean, with usual parameters.
    plain: Vec<[f32; 3]>,
}

impl<'a> Start<'a> {
    fn new(gpu: &Gpu, solids: &'a Solids, params: &AmsParams, wind: &WindParams) -> Self {
        let (positions, offsets) = hair(400);
        let strands = Strands::new(&positions, &offsets);
        let options = Options { rest_pose: head(0), ..Options::default() };
        let elsewhere =
            WindParams { velocity: DVec3::new(-1.0, 2.0, 1.0), shelter: 1.0, hair_depth: 0.2, ..windy() };
        let mut own = GpuSimulation::from_strands(gpu, &strands, params, &options).unwrap();
        for (number, wind) in (0..NUMBER).zip([None, Some(&elsewhere), None, Some(wind)]) {
            let wind = wind.map(|wind| field(wind, number));
            let frame = FrameInput { colliders: &solids.at(number), ..frame(number) };
            own.step_frame(&within(&frame, wind.as_ref())).unwrap();
        }
        let state = own.snapshot().unwrap();
        let on_cpu = |params: &AmsParams, field: &WindField| {
            let mut cpu = Simulation::from_strands(&strands, params, &options).unwrap();
            cpu.restore(&state).unwrap();
            let frame = FrameInput { colliders: &solids.at(NUMBER), ..frame(NUMBER) };
            cpu.step_frame(&within(&frame, Some(field))).unwrap();
            cpu.snapshot().velocities
        };
        let expected = on_cpu(params, &field(wind, NUMBER));
        let mean = WindField { mean: field(wind, NUMBER).mean, ..WindField::default() };
        let plain = on_cpu(&AmsParams::default(), &mean);
        Self { own, solids, state, expected, plain }
    }

    /// The changes in a frame: by parameters and wind on the CPU, against the mean wind; and on the
    /// GPU, in the wind of `other`, against the CPU. Velocities, root mean squares, m/s.
    fn compare(&mut self, other: &WindParams) -> [f64; 2] {
        let frame = FrameInput { colliders: &self.solids.at(NUMBER), ..frame(NUMBER) };
        self.own.restore(&self.state).unwrap();
        self.own.step_frame(&within(&frame, Some(&field(other, NUMBER)))).unwrap();
        let found = self.own.snapshot().unwrap().velocities;
        [rms(&self.expected, &self.plain), rms(&found, &self.expected)]
    }
}

fn windy() -> WindParams {
    WindParams { velocity: DVec3::new(4.0, 0.0, 3.0), gust_strength: 0.2, ..WindParams::default() }
}

/// Turbulence, the shelter of solids and of hair, drag by angle and speed, and all together.
fn cases() -> [(&'static str, AmsParams, WindParams); 6] {
    let plain = AmsParams::default();
    let slender = AmsParams { drag_along: 0.5, drag_quadratic: 2.0, ..AmsParams::default() };
    let all =
        WindParams { turbulence: 0.3, shelter: 0.8, hair_depth: 0.05, turbulence_scale: 0.2, ..windy() };
    [
        ("turbulence", plain.clone(), WindParams { turbulence: 0.4, turbulence_scale: 0.1, ..windy() }),
        ("shelter", plain.clone(), WindParams { shelter: 0.9, ..windy() }),
        ("hair_depth", plain.clone(), WindParams { hair_depth: 0.03, ..windy() }),
        ("all", plain, all.clone()),
        ("slender", slender.clone(), windy()),
        ("slender in all", slender, all),
    ]
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn wind_is_as_on_the_cpu() {
    let gpu = common::gpu();
    let solids = Solids::new();
    for (name, params, wind) in cases() {
        let [given, apart] = Start::new(&gpu, &solids, &params, &wind).compare(&wind);
        println!("{name}: {given:.1e} m/s given, {apart:.1e} apart");
        assert!(given > 1e-2, "{name} did little: {given}");
        // What is in touch with the ball goes either way by a rounding.
        assert!(apart < 3e-4 * given, "{name}: {apart} of {given}");
    }
}

/// The comparison can fail: each parameter is felt.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn another_wind_is_seen() {
    let gpu = common::gpu();
    let ((_, params, wind), solids) = (&cases()[3], Solids::new());
    let mut start = Start::new(&gpu, &solids, params, wind);
    for other in [
        WindParams { turbulence: 0.31, ..wind.clone() },
        WindParams { turbulence_scale: 0.21, ..wind.clone() },
        WindParams { shelter: 0.85, ..wind.clone() },
        WindParams { hair_depth: 0.06, ..wind.clone() },
        WindParams { seed: 1, ..wind.clone() },
        WindParams { velocity: DVec3::new(4.0, 0.0, 3.1), ..wind.clone() },
    ] {
        let [given, apart] = start.compare(&other);
        assert!(apart > 1e-3 * given, "{other:?}: {apart} of {given}");
    }
}

/// Twice the same bits, and a frame makes nothing once there was wind.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn wind_is_the_same_bits_and_makes_nothing() {
    let gpu = common::gpu();
    // A device of its own, for counts are a device's.
    let gpu = Gpu::open(&forelock_gpu::Choice::Named(gpu.name().to_owned())).unwrap();
    let (positions, offsets) = hair(150);
    let strands = Strands::new(&positions, &offsets);
    let options = Options { rest_pose: head(0), ..Options::default() };
    let ((_, params, wind), solids) = (&cases()[5], Solids::new());
    let run = || {
        let mut own = GpuSimulation::from_strands(&gpu, &strands, params, &options).unwrap();
        let step = |own: &mut GpuSimulation, number: u32| {
            let colliders = solids.at(number);
            let frame = FrameInput { colliders: &colliders, ..frame(number) };
            own.step_frame(&within(&frame, Some(&field(wind, number)))).unwrap();
        };
        step(&mut own, 0);
        let before = gpu.counts();
        (1..4).for_each(|number| step(&mut own, number));
        assert_eq!(gpu.counts(), before);
        own.state_hash().unwrap()
    };
    assert_eq!(run(), run());
}
