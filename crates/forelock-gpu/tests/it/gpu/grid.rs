//! Hair against hair on the GPU's grid, against the same on the CPU's.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails where it cannot be set up, and tells how near it came"
)]

use crate::common::{self, little};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{FrameInput, FrameReport, Roots};
use forelock_core::interaction::grid::GridParams;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use forelock_core::strands::Snapshot;
use forelock_core::strands::Strands;
use forelock_gpu::{Choice, Gpu, GpuError, GpuSimulation};
use glam::{DQuat, DVec3, Vec3};
use std::ops::Range;

const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);
const FPS: f64 = 60.0;
/// Of a velocity, whose momentum is summed in steps of 2e-7 of a full cell's mass times m/s, and of
/// a position 0.2 m from the origin in float32, twice; m/s and metres.
const ROUNDING: [f64; 2] = [2e-6, 3e-8];

/// A bundle of `count` wavy strands, so close that they meet at once when shaken. One in three has
/// long edges, which are sampled more often.
fn bundle(count: u32, particles: u32) -> (Vec<[f32; 3]>, Vec<u32>) {
    let (mut positions, mut offsets) = (Vec::new(), vec![0]);
    for strand in 0..count {
        // A sunflower's lattice.
        let (radius, angle) =
            (0.03 * (f64::from(strand) / f64::from(count)).sqrt(), 2.399_963 * f64::from(strand));
        let root = DVec3::new(radius * angle.cos(), 0.0, radius * angle.sin());
        let particles = if strand % 3 == 2 { particles / 3 } else { particles };
        for i in 0..particles {
            let s = f64::from(i) / f64::from(particles - 1);
            let wave = DVec3::new((9.0 * s + angle).cos(), 0.0, (9.0 * s + angle).sin()) * (0.004 * s);
            positions.push((root * (1.0 + 0.5 * s) + wave - DVec3::Y * 0.2 * s).as_vec3().to_array());
        }
        offsets.push(positions.len() as u32);
    }
    (positions, offsets)
}

fn head(frame: u32) -> Pose {
    let t = f64::from(frame) / FPS;
    let turn = DQuat::from_rotation_y((3.0 * t).sin()) * DQuat::from_rotation_x(0.5 * (5.0 * t).sin());
    Pose::new(turn, DVec3::new(0.06 * (9.0 * t).sin(), 0.0, 0.5 * t * t))
}

fn options() -> Options {
    Options { rest_pose: head(0), rest_gravity: GRAVITY, ..Options::default() }
}

/// The pressure as exact as it gets, so that how it was found does not matter.
fn exact() -> GridParams {
    GridParams { tolerance: 1e-6, iterations: 80, resolution: 32, ..GridParams::default() }
}

fn frame(number: u32) -> FrameInput<'static> {
    FrameInput {
        roots: Roots::Rigid([head(number), head(number + 1)]),
        gravity: GRAVITY,
        dt_secs: 1.0 / FPS,
        ..FrameInput::default()
    }
}

/// A ball on the head, and a box that overlaps it and moves against it.
struct Solids([Shape; 2]);

impl Solids {
    fn new() -> Self {
        Self([Shape::Sphere { radius: 0.04 }, Shape::Box { half_extents: DVec3::new(0.05, 0.02, 0.03) }])
    }

    fn at(&self, number: u32) -> [ColliderFrame<'_>; 2] {
        let turned = DQuat::from_rotation_x(0.3);
        let places =
            [Pose::new(turned, DVec3::new(0.05, -0.1, 0.0)), Pose::new(turned, DVec3::new(0.0, -0.13, 0.0))];
        std::array::from_fn(|k| {
            let carrier = |frame: u32| {
                let t = f64::from(frame) / FPS;
                let gone = Pose::new(DQuat::from_rotation_y(4.0 * t), DVec3::new(0.1 * t, 0.05 * t, 0.0));
                if k == 0 { head(frame) } else { head(frame).after(&gone) }
            };
            let [from, to] = [number, number + 1].map(carrier);
            ColliderFrame { shape: &self.0[k], local: places[k], from, to, friction: 0.3 }
        })
    }
}

/// Steps `frames`, each among the solids if there are any.
fn play(own: &mut GpuSimulation, solids: Option<&Solids>, mut frames: Range<u32>) -> Result<(), GpuError> {
    frames.try_for_each(|number| {
        let solids: Vec<_> = solids.into_iter().flat_map(|solids| solids.at(number)).collect();
        own.step_frame(&FrameInput { colliders: &solids, ..frame(number) })
    })
}

/// Root mean square of the difference, without the farthest three in a hundred: some particles
/// between two solids go to one side or the other by a rounding error, also without a grid.
fn rms(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| f64::from(Vec3::from(*a).distance_squared(Vec3::from(*b))));
    let mut squares: Vec<f64> = squares.collect();
    squares.sort_by(f64::total_cmp);
    squares.truncate(squares.len() * 97 / 100);
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Hair that has gathered on the CPU for some frames, and a frame without a grid.
struct Start<'a> {
    positions: Vec<[f32; 3]>,
    offsets: Vec<u32>,
    among: Option<&'a Solids>,
    /// The number of the next frame.
    number: u32,
    cpu: Simulation,
    state: Snapshot<f32>,
    alone: Snapshot<f32>,
}

impl<'a> Start<'a> {
    fn new(among: Option<&'a Solids>, after: u32) -> Self {
        let (positions, offsets) = bundle(1000, 16);
        let strands = Strands::new(&positions, &offsets);
        let cpu = Simulation::from_strands(&strands, &AmsParams::default(), &options()).unwrap();
        let (state, alone) = (cpu.snapshot(), cpu.snapshot());
        let mut start = Self { positions, offsets, among, number: 0, cpu, state, alone };
        for number in 0..after {
            start.number = number;
            start.step();
        }
        start.number = after;
        start.state = start.cpu.snapshot();
        start.step();
        start.alone = start.cpu.snapshot();
        start
    }

    fn step(&mut self) -> FrameReport {
        let solids: Vec<_> = self.among.into_iter().flat_map(|solids| solids.at(self.number)).collect();
        self.cpu.step_frame(&FrameInput { colliders: &solids, ..frame(self.number) }).unwrap()
    }

    /// The changes in the next frame: on the CPU, a grid against none; and the GPU with `other`
    /// against the CPU with `params`. Velocities and positions, root mean squares.
    fn compare(&mut self, gpu: &Gpu, [params, other]: [&GridParams; 2]) -> [[f64; 2]; 2] {
        self.cpu.restore(&self.state).unwrap();
        self.cpu.set_grid(Some(params)).unwrap();
        let on_cpu = self.step().grid;
        let cpu = self.cpu.snapshot();
        let strands = Strands::new(&self.positions, &self.offsets);
        let mut own = GpuSimulation::from_strands(gpu, &strands, &AmsParams::default(), &options()).unwrap();
        own.set_grid(Some(other)).unwrap();
        own.restore(&self.state).unwrap();
        play(&mut own, self.among, self.number..self.number + 1).unwrap();
        let on_gpu = own.report().unwrap().grid.unwrap();
        let own = own.snapshot().unwrap();
        println!("CPU: {on_cpu:?}; GPU: {on_gpu:?}");
        if params == other {
            // A sample at the end of a cut box may count on one of them only.
            assert!((on_gpu.densest - on_cpu.densest).abs() < 1e-4 * (on_cpu.densest + 1.0));
        }
        let of = |a: &Snapshot<f32>, b: &Snapshot<f32>| {
            [rms(&a.velocities, &b.velocities), rms(&a.positions, &b.positions)]
        };
        [of(&cpu, &self.alone), of(&own, &cpu)]
    }
}

/// Whether two frames are the same beside what the grid changed in them.
fn is_same(apart: [f64; 2], given: [f64; 2]) -> bool {
    (0..2).all(|k| apart[k] < 1e-3 * given[k] + ROUNDING[k])
}

/// One algorithm on both, whose sums are of floats on the CPU and of integers on the GPU.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn hair_meets_as_on_the_cpu() {
    let gpu = common::gpu();
    let solids = Solids::new();
    let exact = exact();
    let mut gathered = Start::new(Some(&solids), 12);
    let (mut free, mut late) = (Start::new(None, 3), Start::new(Some(&solids), 25));
    for start in [&mut free, &mut gathered, &mut late] {
        let [given, apart] = start.compare(&gpu, [&exact; 2]);
        println!("m/s and m: given {given:?}, apart {apart:?}");
        assert!(given[0] > 2e-3 && given[1] > 5e-6, "the grid did little: {given:?}");
        assert!(is_same(apart, given), "{apart:?} of {given:?}");
    }
    // A box that is cut, and hair that may gather far beyond or far under what it has at rest.
    for other in [
        GridParams { max_cells: 5000, ..exact.clone() },
        GridParams { rest_density: 1e-3, resolution: 8, ..exact.clone() },
        GridParams { rest_density: 1e14, ..exact },
    ] {
        let [given, apart] = gathered.compare(&gpu, [&other; 2]);
        println!("{other:?}: given {given:?}, apart {apart:?}");
        assert!(given[0] > 1e-3, "the grid did little: {given:?}");
        assert!(is_same(apart, given), "{apart:?} of {given:?}");
    }
    let [given, apart] = gathered.compare(&gpu, [&GridParams::default(); 2]);
    println!("as it comes: given {given:?}, apart {apart:?}");
    // What the solvers' tolerance leaves.
    assert!(apart[0] < 5e-3 * given[0] && apart[1] < 5e-3 * given[1], "{apart:?} of {given:?}");
}

/// The comparison can fail: each parameter of the grid has an effect, the tolerance through the
/// number of sweeps.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn another_grid_is_seen() {
    let gpu = common::gpu();
    let solids = Solids::new();
    let mut start = Start::new(Some(&solids), 25);
    for other in [
        GridParams { pic_rate: 6.0, ..exact() },
        GridParams { volume_rate: 10.0, ..exact() },
        GridParams { resolution: 30, ..exact() },
        GridParams { rest_density: 2e6, ..exact() },
        GridParams { max_cells: 5000, ..exact() },
    ] {
        let [given, apart] = start.compare(&gpu, [&exact(), &other]);
        assert!(!is_same(apart, given), "{other:?}: {apart:?} of {given:?}");
    }
    // Hair that is pressed together takes many sweeps.
    let other = GridParams { iterations: 4, ..exact() };
    let [given, apart] = Start::new(Some(&solids), 2).compare(&gpu, [&exact(), &other]);
    assert!(!is_same(apart, given), "{other:?}: {apart:?} of {given:?}");
}

/// Two runs give the same bits: also after an interruption, with timed stages, and in many batches
/// on a device with small bindings.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn the_grid_is_the_same_bits_whatever_the_order() {
    let gpu = common::gpu();
    let solids = Solids::new();
    let (positions, offsets) = bundle(700, 12);
    let strands = Strands::new(&positions, &offsets);
    let grid = GridParams { max_cells: 5000, resolution: 24, iterations: 12, ..GridParams::default() };
    let new = |gpu: &Gpu| {
        let mut own = GpuSimulation::from_strands(gpu, &strands, &AmsParams::default(), &options()).unwrap();
        own.set_grid(Some(&grid)).unwrap();
        own
    };
    let run = |mut own: GpuSimulation, frames: Range<u32>| {
        play(&mut own, Some(&solids), frames).unwrap();
        own
    };
    let mut whole = run(new(&gpu), 0..3);
    let half = whole.snapshot().unwrap();
    let mut whole = run(whole, 3..6);
    assert!(whole.report().unwrap().grid.unwrap().cells > 10, "strands never met");
    let whole = whole.state_hash().unwrap();
    assert_eq!(run(new(&gpu), 0..6).state_hash().unwrap(), whole);
    let mut resumed = new(&gpu);
    resumed.restore(&half).unwrap();
    resumed.time_stages(true);
    assert_eq!(run(resumed, 3..6).state_hash().unwrap(), whole);
    let small = little::binding_little(&gpu, 1 << 18);
    assert_eq!(run(new(&small), 0..6).state_hash().unwrap(), whole);
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_steady_frame_on_the_grid_makes_nothing_and_reads_nothing_back() {
    let gpu = common::gpu();
    // A device of its own, for counts are a device's.
    let gpu = Gpu::open(&Choice::Named(gpu.name().to_owned())).unwrap();
    let (positions, offsets) = bundle(200, 12);
    let strands = Strands::new(&positions, &offsets);
    let mut own = GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let wrong = GridParams { resolution: 3, ..GridParams::default() };
    assert!(matches!(own.set_grid(Some(&wrong)), Err(GpuError::Params(_))));
    own.set_grid(Some(&GridParams { iterations: 8, ..GridParams::default() })).unwrap();
    play(&mut own, None, 0..1).unwrap();
    let before = gpu.counts();
    play(&mut own, None, 1..4).unwrap();
    assert_eq!(gpu.counts(), before);
    own.set_grid(None).unwrap();
    play(&mut own, None, 4..5).unwrap();
    assert_eq!(own.report().unwrap().grid, None);
}
