//! Contacts between strands on the GPU, against the same on the CPU.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails where it cannot be set up, and tells how near it came"
)]

use crate::common::{self, little, rms::rms};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{FrameInput, Roots};
use forelock_core::interaction::contact::{ContactParams, ContactReport};
use forelock_core::interaction::grid::GridParams;
use forelock_core::lane::LANES;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use forelock_core::solver::ams::Inextensibility;
use forelock_core::strands::{SCRATCH_ROWS, Snapshot, Strands};
use forelock_gpu::{Choice, Gpu, GpuError, GpuSimulation};
use glam::{DQuat, DVec3};
use std::ops::Range;

const FPS: f64 = 60.0;
/// Strands along a wisp's side.
const SIDE: usize = 10;
const PARTICLES: usize = 20;
/// Of a position 0.2 m from the origin in float32, some times, metres.
const ROUNDING: f64 = 1e-7;

/// Two wisps that cross at a right angle, 3 cm apart. A few strands of each have edges four times
/// as long, which are searched in pieces.
struct Wisps {
    positions: Vec<[f32; 3]>,
    offsets: Vec<u32>,
    /// Strands of one of them.
    count: usize,
}

impl Wisps {
    fn new(side: usize) -> Self {
        let (wisp_strands, middle) = (side * side, 0.5 * (side - 1) as f64);
        let (mut positions, mut offsets) = (Vec::new(), vec![0]);
        for k in 0..2 * wisp_strands {
            let (wisp, k) = (k / wisp_strands, k % wisp_strands);
            let sign = 2.0 * wisp as f64 - 1.0;
            let down = DQuat::from_rotation_x(0.25 * std::f64::consts::PI * sign) * DVec3::NEG_Y;
            let across = down.cross(DVec3::X);
            let (u, v) = ((k % side) as f64 - middle, (k / side) as f64 - middle);
            // About 1.5 mm apart, not in rows that fit each other.
            let jitter = 0.3e-3 * (k as f64 * 12.9898 + sign).sin();
            let root = -0.1 * down + across * (1.5e-3 * u + jitter) + DVec3::X * (0.015 * sign + 1.5e-3 * v);
            let (count, edge) = if k % 7 == 3 { (PARTICLES / 4, 0.04) } else { (PARTICLES, 0.01) };
            positions.extend((0..count).map(|i| (root + down * (edge * i as f64)).as_vec3().to_array()));
            offsets.push(positions.len() as u32);
        }
        Self { positions, offsets, count: wisp_strands }
    }

    fn strands(&self) -> Strands<'_, f32> {
        Strands::new(&self.positions, &self.offsets)
    }

    /// All of one wisp thrown at the other, each strand a little differently.
    fn thrown(&self, mut snapshot: Snapshot<f32>) -> Snapshot<f32> {
        for (strand, range) in self.offsets.windows(2).enumerate() {
            let way = if strand < self.count { 1.2 } else { -1.2 };
            for v in &mut snapshot.velocities[range[0] as usize..range[1] as usize] {
                *v = [way + 0.1 * (strand as f32).sin(), 0.05 * (3.0 * strand as f32).sin(), 0.0];
            }
        }
        snapshot
    }
}

/// The head swings all hair about.
fn head(frame: u32) -> Pose {
    let t = f64::from(frame) / FPS;
    Pose::new(DQuat::from_rotation_y(2.0 * t), DVec3::new(0.0, 0.3 * t * t, 0.5 * t))
}

fn frame(number: u32) -> FrameInput<'static> {
    FrameInput {
        roots: Roots::Rigid([head(number), head(number + 1)]),
        gravity: DVec3::new(0.0, -9.81, 0.0),
        dt_secs: 1.0 / FPS,
        ..FrameInput::default()
    }
}

fn options() -> Options {
    Options { rest_pose: head(0), ..Options::default() }
}

/// Contacts without the friction between neighbours.
fn contacts_alone() -> ContactParams {
    ContactParams { hold: 0.0, slip: 0.01, ..ContactParams::default() }
}

/// Two wisps on the CPU after some frames with contacts, and a frame without them.
struct Start<'a> {
    wisps: Wisps,
    solver: &'a AmsParams,
    /// The grid of the frames to be compared.
    grid: Option<&'a GridParams>,
    /// The number of the next frame.
    number: u32,
    cpu: Simulation,
    state: Snapshot<f32>,
    /// After a frame without contacts.
    alone: Snapshot<f32>,
}

impl<'a> Start<'a> {
    fn new(solver: &'a AmsParams, grid: Option<&'a GridParams>, after: u32) -> Self {
        let wisps = Wisps::new(SIDE);
        let mut cpu = Simulation::from_strands(&wisps.strands(), solver, &options()).unwrap();
        let thrown = wisps.thrown(cpu.snapshot());
        cpu.restore(&thrown).unwrap();
        cpu.set_contacts(Some(&contacts_alone())).unwrap();
        for number in 0..after {
            cpu.step_frame(&frame(number)).unwrap();
        }
        let state = cpu.snapshot();
        cpu.set_grid(grid).unwrap();
        cpu.set_contacts(None).unwrap();
        cpu.step_frame(&frame(after)).unwrap();
        let alone = cpu.snapshot();
        Self { wisps, solver, grid, number: after, cpu, state, alone }
    }

    /// The next frame on the CPU under `params` and on the GPU under `other`.
    fn compare(&mut self, gpu: &Gpu, [params, other]: [&ContactParams; 2]) -> Compared {
        let Self { wisps, solver, grid, number, cpu, state, alone } = self;
        cpu.restore(state).unwrap();
        cpu.set_contacts(Some(params)).unwrap();
        let on_cpu = cpu.step_frame(&frame(*number)).unwrap().strand_contacts;
        let cpu = cpu.snapshot();
        let mut own = GpuSimulation::from_strands(gpu, &wisps.strands(), *solver, &options()).unwrap();
        own.set_grid(*grid).unwrap();
        own.set_contacts(Some(other)).unwrap();
        own.restore(state).unwrap();
        own.step_frame(&frame(*number)).unwrap();
        let on_gpu = own.report().unwrap().strand_contacts.unwrap();
        let own = own.snapshot().unwrap();
        let of = |a: &Snapshot<f32>, b: &Snapshot<f32>| {
            [rms(&a.velocities, &b.velocities), rms(&a.positions, &b.positions)]
        };
        let own = Compared { given: of(&cpu, alone), apart: of(&own, &cpu), did: [on_cpu, on_gpu] };
        let [there, here] = own.did;
        println!(
            "m/s and m: given {:?}, apart {:?}; contacts {} and {}, farthest {} and {} m",
            own.given, own.apart, there.contacts, here.contacts, there.farthest_m, here.farthest_m
        );
        own
    }
}

/// A frame on both sides.
struct Compared {
    /// The change by contacts on the CPU, and the GPU's difference from it: velocities and
    /// positions, root mean squares.
    given: [f64; 2],
    apart: [f64; 2],
    /// What contacts did, there and here.
    did: [ContactReport; 2],
}

impl Compared {
    /// Whether velocities and positions are apart by less than `share` of what contacts gave.
    fn is_within(&self, share: f64) -> bool {
        let [there, here] = self.did.map(|did| did.farthest_m);
        (there - here).abs() < share.max(1e-2) * there
            && self.apart[0] < share * self.given[0]
            && self.apart[1] < share * self.given[1] + ROUNDING
    }

    /// The same, apart from contacts that only one backend has, by a rounding: root mean squares go
    /// with the root of their number.
    fn is_near(&self, share: f64) -> bool {
        let [there, here] = self.did.map(|did| did.contacts as f64);
        self.is_within(share + ((there - here).abs() / there.max(1.0)).sqrt())
    }
}

/// The cases of a comparison.
struct Cases<'a> {
    /// Frames with contacts before it.
    after: &'a [u32],
    params: &'a [ContactParams],
    solvers: &'a [AmsParams],
}

/// The same contacts, found another way. What float64 differs from float32 on the CPU is as much.
fn touch_as_on_the_cpu(cases: &Cases<'_>) {
    let gpu = common::gpu();
    let (solver, usual) = (AmsParams::default(), contacts_alone());
    for &after in cases.after {
        let own = Start::new(&solver, None, after).compare(&gpu, [&usual; 2]);
        let [there, here] = own.did.map(|did| did.contacts);
        assert!(there > 1000 && there.abs_diff(here) < 4);
        assert!(own.given[0] > 0.02 && own.is_near(1e-3));
    }
    let mut start = Start::new(&solver, None, 8);
    for params in cases.params {
        println!("{params:?}");
        let own = start.compare(&gpu, [params; 2]);
        assert!(own.is_near(2e-3) && own.did[0].contacts.abs_diff(own.did[1].contacts) < 4);
    }
    for solver in cases.solvers {
        assert!(Start::new(solver, None, 8).compare(&gpu, [&usual; 2]).is_near(2e-3));
    }
    // On the grid two solvers find one pressure, each to its tolerance.
    let grid = GridParams::default();
    assert!(Start::new(&solver, Some(&grid), 8).compare(&gpu, [&usual; 2]).is_within(1e-2));
}

/// Early and late, and every parameter and length pass at least once.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn strands_touch_as_on_the_cpu() {
    let (usual, solver) = (contacts_alone(), AmsParams::default());
    touch_as_on_the_cpu(&Cases {
        after: &[2, 14],
        params: &[
            ContactParams { distance: 8e-4, friction: 2.0, spread: 0.3, ..usual.clone() },
            ContactParams { friction: 0.0, spread: 0.0, rounds: 1, ..usual.clone() },
            ContactParams { rounds: 100, slip: 0.3, ..usual.clone() },
            ContactParams { per_segment: 3, ..usual },
        ],
        solvers: &[
            AmsParams { clamped: 3, inextensibility: Inextensibility::Off, ..solver.clone() },
            AmsParams { inextensibility: Inextensibility::FollowTheLeader, ..solver },
        ],
    });
}

#[test]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_strands_touch_as_on_the_cpu_in_each_case() {
    let (usual, solver) = (contacts_alone(), AmsParams::default());
    touch_as_on_the_cpu(&Cases {
        after: &[2, 4, 8, 14],
        params: &[
            ContactParams { distance: 8e-4, ..usual.clone() },
            ContactParams { slip: 0.5, ..usual.clone() },
            ContactParams { friction: 0.0, spread: 0.0, ..usual.clone() },
            ContactParams { friction: 2.0, spread: 0.3, ..usual.clone() },
            ContactParams { rounds: 1, ..usual.clone() },
            ContactParams { rounds: 400, slip: 0.3, ..usual.clone() },
            ContactParams { per_segment: 3, ..usual },
        ],
        solvers: &[
            AmsParams { clamped: 3, ..solver.clone() },
            AmsParams { inextensibility: Inextensibility::Off, ..solver.clone() },
            AmsParams { inextensibility: Inextensibility::FollowTheLeader, ..solver },
        ],
    });
}

/// Where contacts exceed the budget, both backends keep the same number, the fastest ones, and get
/// about the same result. Of 64 contacts a single one that only one backend selects is 15 % of the
/// effect.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_budget_keeps_the_fastest() {
    let gpu = common::gpu();
    let solver = AmsParams::default();
    let mut start = Start::new(&solver, None, 2);
    for budget in [128, 2000] {
        let params = ContactParams { budget, ..ContactParams::default() };
        let own = start.compare(&gpu, [&params; 2]);
        let [there, here] = own.did.map(|did| did.contacts);
        assert!(there.abs_diff(here) < 6 + budget as usize / 16, "{there} {here}");
        assert!(own.is_within(0.1));
    }
    // Hair flies into each other so fast that single segments meet more than are taken up.
    let own = Start::new(&solver, None, 0).compare(&gpu, [&ContactParams::default(); 2]);
    assert!(own.is_within(0.03));
}

/// The comparison can fail: each parameter is felt.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn other_contacts_are_seen() {
    let gpu = common::gpu();
    let (solver, usual) = (AmsParams::default(), contacts_alone());
    let mut start = Start::new(&solver, None, 8);
    for other in [
        ContactParams { distance: 6e-4, ..usual.clone() },
        ContactParams { slip: 0.1, ..usual.clone() },
        ContactParams { budget: 1000, ..usual.clone() },
        ContactParams { friction: 0.2, ..usual.clone() },
        ContactParams { spread: 0.06, ..usual.clone() },
        ContactParams { rounds: 12, ..usual.clone() },
        ContactParams { per_segment: 4, ..usual.clone() },
    ] {
        assert!(!start.compare(&gpu, [&usual, &other]).is_within(5e-3), "{other:?}");
    }
}

/// Particles that know of nothing but contacts.
fn free() -> AmsParams {
    AmsParams {
        k_edge: 0.0,
        k_bend: 0.0,
        k_torsion: 0.0,
        k_integrity: 0.0,
        k_angular: 0.0,
        drag: 0.0,
        clamped: 1,
        inextensibility: Inextensibility::Off,
        ..AmsParams::default()
    }
}

/// Strands across others. `count` of them are thrown at all at once, the faster the farther from
/// their roots.
fn across(count: u32, others: u32) -> (Vec<[f32; 3]>, Vec<u32>, Vec<[f32; 3]>) {
    let (mut positions, mut offsets, mut velocities) = (Vec::new(), vec![0], Vec::new());
    for k in 0..count + others {
        let thrown = k < count;
        let at = f64::from(if thrown { k } else { k - count });
        // Others lie along x, in a sheet of layers; those thrown lie across and above.
        let from = if thrown {
            DVec3::new(0.02 + 1e-3 * at, 0.02, -0.05)
        } else {
            DVec3::new(0.0, -0.02 * at / f64::from(others), -0.02 + 0.04 * (0.618_034 * at).fract())
        };
        let along = if thrown { DVec3::Z } else { DVec3::X };
        for i in 0..6u8 {
            positions.push((from + along * (0.02 * f64::from(i))).as_vec3().to_array());
            velocities.push(if thrown {
                [0.0, -[0.0, 1.0, 3.0, 4.0, 5.0, 6.0][usize::from(i)], 0.0]
            } else {
                [0.0; 3]
            });
        }
        offsets.push(positions.len() as u32);
    }
    (positions, offsets, velocities)
}

/// Segments that meet more than there is room for keep the fastest; the same whoever comes first.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_crowd_is_met_by_its_fastest() {
    const THROWN: u32 = 3;
    let gpu = common::gpu();
    let (positions, offsets, velocities) = across(THROWN, 6000);
    let strands = Strands::new(&positions, &offsets);
    let params = ContactParams { per_segment: 1024, budget: 1 << 18, hold: 0.0, ..ContactParams::default() };
    let weightless =
        FrameInput { gravity: DVec3::ZERO, roots: Roots::Rigid([Pose::IDENTITY; 2]), ..frame(0) };
    let free = free();
    let run = || {
        let mut own = GpuSimulation::from_strands(&gpu, &strands, &free, &options()).unwrap();
        own.set_contacts(Some(&params)).unwrap();
        let start = Snapshot { velocities: velocities.clone(), ..own.snapshot().unwrap() };
        own.restore(&start).unwrap();
        own.step_frame(&weightless).unwrap();
        (own.report().unwrap().strand_contacts.unwrap(), own.snapshot().unwrap(), start)
    };
    let (here, end, start) = run();
    let mut cpu = Simulation::from_strands(&strands, &free, &options()).unwrap();
    cpu.set_contacts(Some(&params)).unwrap();
    cpu.restore(&start).unwrap();
    let there = cpu.step_frame(&weightless).unwrap().strand_contacts;
    println!("{here:?}, on the CPU {there:?}");
    // Two slices at most: a segment meets far more in one than it has room for, and fills its room.
    assert!(there.contacts > 2 * 2 * 512 * THROWN as usize && here.contacts <= 4 * 64 * THROWN as usize);
    assert!(here.contacts > 2 * 64 * THROWN as usize, "{here:?}");
    // Of the particles that the second segment reaches, those farther from the root move, where it
    // is faster.
    let other = |at: usize| (THROWN as usize + at) * 6;
    let (mut all, mut moved) = ((0.0, 0.0), (0.0, 0.0));
    for at in 0..6000 {
        let z = f64::from(positions[other(at)][2]);
        let fastest = end.velocities[other(at)..other(at) + 6]
            .as_flattened()
            .iter()
            .fold(0.0f32, |s, v| s.max(v.abs()));
        if (-0.02..-0.01).contains(&z) {
            all = (all.0 + z, all.1 + 1.0);
            if fastest > 1e-4 {
                moved = (moved.0 + z, moved.1 + 1.0);
            }
        }
    }
    println!(
        "of {} strands {} were moved, {} m farther out",
        all.1,
        moved.1,
        moved.0 / moved.1 - all.0 / all.1
    );
    assert!(moved.1 > 10.0 && moved.0 / moved.1 - all.0 / all.1 > 0.002);
    assert_eq!(run().1, end);
}

/// Two long strands among short ones are sought in pieces, and each contact comes once.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn strands_meet_shorter_ones() {
    let gpu = common::gpu();
    let (mut positions, mut offsets, mut velocities) = across(12, 60);
    // Each of one edge as long as fifty others, beside each other and above all.
    for (k, height) in [0.012f32, 0.0135].into_iter().enumerate() {
        positions.extend([[-0.5, height, 0.001 * k as f32], [0.5, height, 0.0]]);
        velocities.extend([[0.0, if k == 0 { 0.4 } else { -0.4 }, 0.0]; 2]);
        offsets.push(positions.len() as u32);
    }
    let strands = Strands::new(&positions, &offsets);
    let free = free();
    let weightless =
        FrameInput { gravity: DVec3::ZERO, roots: Roots::Rigid([Pose::IDENTITY; 2]), ..frame(0) };
    let mut own = GpuSimulation::from_strands(&gpu, &strands, &free, &options()).unwrap();
    own.set_contacts(Some(&ContactParams::default())).unwrap();
    let start = Snapshot { velocities, ..own.snapshot().unwrap() };
    own.restore(&start).unwrap();
    own.step_frame(&weightless).unwrap();
    let here = own.report().unwrap().strand_contacts.unwrap();
    let mut cpu = Simulation::from_strands(&strands, &free, &options()).unwrap();
    cpu.set_contacts(Some(&ContactParams::default())).unwrap();
    cpu.restore(&start).unwrap();
    let there = cpu.step_frame(&weightless).unwrap().strand_contacts;
    println!("{here:?}, on the CPU {there:?}");
    assert!(there.contacts > 12 && here.contacts.abs_diff(there.contacts) < 2);
    assert!(rms(&own.snapshot().unwrap().positions, &cpu.snapshot().positions) < 1e-6);
}

/// A strand with positions that are not numbers, one infinitely far away, one 3e18 m away, and few
/// free strands or none: the others are unharmed.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn hair_out_of_bounds_harms_no_one() {
    let gpu = common::gpu();
    let wisps = Wisps::new(4);
    let least = ContactParams { budget: 8, rounds: 1, per_segment: 1, ..contacts_alone() };
    let run = |broken: bool, params: &ContactParams, solver: &AmsParams| {
        let mut own = GpuSimulation::from_strands(&gpu, &wisps.strands(), solver, &options()).unwrap();
        own.set_contacts(Some(params)).unwrap();
        let mut start = wisps.thrown(own.snapshot().unwrap());
        if broken {
            for (strand, x) in [f32::NAN, f32::INFINITY, 3e18].into_iter().enumerate() {
                start.positions[wisps.offsets[strand] as usize + 2][0] = x;
            }
        }
        own.restore(&start).unwrap();
        let mut contacts = 0;
        let mut quarantined = 0;
        for number in 0..2 {
            own.step_frame(&frame(number)).unwrap();
            let report = own.report().unwrap();
            contacts = contacts.max(report.strand_contacts.unwrap().contacts);
            quarantined += report.quarantined_strands;
        }
        assert!(own.snapshot().unwrap().positions.as_flattened().iter().all(|x| x.is_finite()));
        (contacts, quarantined)
    };
    let usual = AmsParams::default();
    let (contacts, quarantined) = run(true, &ContactParams::default(), &usual);
    assert!(contacts > 20 && (2..=3).contains(&quarantined), "{contacts} {quarantined}");
    let (contacts, quarantined) = run(false, &least, &usual);
    assert!((1..=8).contains(&contacts) && quarantined == 0, "{contacts} {quarantined}");
    assert_eq!(run(false, &least, &AmsParams { clamped: 100, ..usual }), (0, 0));
}

/// Displacement by contacts counts against the clearance: a solid beside the hair is detected in
/// the same frame.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn hair_that_contacts_move_still_sees_solids() {
    let gpu = common::gpu();
    let wisps = Wisps::new(SIDE);
    let ball = Shape::Sphere { radius: 0.03 };
    let solids = |number: u32| {
        let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.0, 0.02, 0.0));
        ColliderFrame { shape: &ball, local, from: head(number), to: head(number + 1), friction: 0.3 }
    };
    let mut cpu = Simulation::from_strands(&wisps.strands(), &AmsParams::default(), &options()).unwrap();
    cpu.set_contacts(Some(&ContactParams::default())).unwrap();
    let thrown = wisps.thrown(cpu.snapshot());
    cpu.restore(&thrown).unwrap();
    for number in 0..6 {
        cpu.step_frame(&FrameInput { colliders: &[solids(number)], ..frame(number) }).unwrap();
    }
    let mut own =
        GpuSimulation::from_strands(&gpu, &wisps.strands(), &AmsParams::default(), &options()).unwrap();
    own.set_contacts(Some(&ContactParams::default())).unwrap();
    own.restore(&cpu.snapshot()).unwrap();
    let last = [solids(6)];
    let there = cpu.step_frame(&FrameInput { colliders: &last, ..frame(6) }).unwrap();
    own.step_frame(&FrameInput { colliders: &last, ..frame(6) }).unwrap();
    let here = own.report().unwrap();
    println!("{there:?} {here:?}");
    assert!(there.touching > 50 && there.strand_contacts.contacts > 100);
    assert!(here.touching.abs_diff(there.touching) < 3 + there.touching / 100);
    assert!(f64::from(here.max_penetration_m) < there.max_penetration_m + 1e-6);
}

/// Two runs of `frames` give the same bits: also after an interruption, with timed stages, and in
/// many batches on a device with small bindings. With a grid too if hair `meets`.
fn are_the_same_bits(meets: bool, frames: u32) {
    // With fewer strands a device that binds so little has all in one batch.
    const LITTLE: u64 = 3_900_000;
    let gpu = common::gpu();
    let wisps = Wisps::new(31);
    // So few that it matters which.
    let params = ContactParams { budget: 1500, ..ContactParams::default() };
    let new = |gpu: &Gpu| {
        let mut own =
            GpuSimulation::from_strands(gpu, &wisps.strands(), &AmsParams::default(), &options()).unwrap();
        own.set_contacts(Some(&params)).unwrap();
        let grid = GridParams { max_cells: 5000, resolution: 24, iterations: 12, ..GridParams::default() };
        own.set_grid(meets.then_some(&grid)).unwrap();
        let thrown = wisps.thrown(own.snapshot().unwrap());
        own.restore(&thrown).unwrap();
        own
    };
    let run = |mut own: GpuSimulation, frames: Range<u32>| {
        frames.for_each(|number| own.step_frame(&frame(number)).unwrap());
        own
    };
    let mut whole = run(new(&gpu), 0..frames / 2);
    let half = whole.snapshot().unwrap();
    let mut whole = run(whole, frames / 2..frames);
    let contacts = whole.report().unwrap().strand_contacts.unwrap();
    assert!(contacts.contacts > 100, "{contacts:?}");
    let whole = whole.state_hash().unwrap();
    assert_eq!(run(new(&gpu), 0..frames).state_hash().unwrap(), whole);
    let mut resumed = new(&gpu);
    resumed.restore(&half).unwrap();
    resumed.time_stages(true);
    let scratch = 4 * (SCRATCH_ROWS * LANES * resumed.model().places()) as u64;
    assert_eq!(run(resumed, frames / 2..frames).state_hash().unwrap(), whole);
    assert!(scratch > LITTLE, "all in one batch");
    let small = little::binding_little(&gpu, LITTLE);
    assert_eq!(run(new(&small), 0..frames).state_hash().unwrap(), whole);
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn contacts_are_the_same_bits_whatever_the_order() {
    are_the_same_bits(true, 4);
}

#[test]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_contacts_are_the_same_bits_for_longer_and_without_a_grid() {
    for meets in [false, true] {
        are_the_same_bits(meets, 8);
    }
}

/// Nothing is made or read in a steady frame, and what is too large is said to be.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_steady_frame_with_contacts_makes_nothing_and_reads_nothing_back() {
    let gpu = common::gpu();
    // A device of its own, for counts are a device's.
    let gpu = Gpu::open(&Choice::Named(gpu.name().to_owned())).unwrap();
    let wisps = Wisps::new(4);
    let mut own =
        GpuSimulation::from_strands(&gpu, &wisps.strands(), &AmsParams::default(), &options()).unwrap();
    let wrong = ContactParams { distance: 0.0, ..ContactParams::default() };
    assert!(matches!(own.set_contacts(Some(&wrong)), Err(GpuError::Params(_))));
    own.set_contacts(Some(&ContactParams { rounds: 4, ..ContactParams::default() })).unwrap();
    let thrown = wisps.thrown(own.snapshot().unwrap());
    own.restore(&thrown).unwrap();
    own.step_frame(&frame(0)).unwrap();
    let before = gpu.counts();
    (1..4).for_each(|number| own.step_frame(&frame(number)).unwrap());
    assert_eq!(gpu.counts(), before);
    own.set_contacts(None).unwrap();
    own.step_frame(&frame(4)).unwrap();
    assert_eq!(own.report().unwrap().strand_contacts, None);
    let (small, wisps) = (little::binding_little(&gpu, 1 << 18), Wisps::new(SIDE));
    let mut own =
        GpuSimulation::from_strands(&small, &wisps.strands(), &AmsParams::default(), &options()).unwrap();
    assert!(matches!(own.set_contacts(Some(&ContactParams::default())), Err(GpuError::TooLarge { .. })));
}

/// Friction holds on the GPU what it holds on the CPU, and the comparison sees how strong it is.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn friction_holds_as_on_the_cpu() {
    let gpu = common::gpu();
    let solver = AmsParams::default();
    let mut start = Start::new(&solver, None, 8);
    // No contact is resolved, so that friction alone acts.
    let alone = |hold| ContactParams { hold, slip: 1000.0, ..ContactParams::default() };
    for hold in [0.3, 1.5, 20.0] {
        let own = start.compare(&gpu, [&alone(hold); 2]);
        assert_eq!(own.did.map(|did| did.contacts), [0; 2]);
        assert!(own.given[0] > 3e-3 * hold.min(1.0), "{hold}");
        assert!(own.apart[0] < 2e-3 * own.given[0] && own.apart[1] < 2e-3 * own.given[1] + ROUNDING);
    }
    let other = start.compare(&gpu, [&alone(1.5), &alone(1.4)]);
    assert!(other.apart[0] > 2e-2 * other.given[0]);
}
