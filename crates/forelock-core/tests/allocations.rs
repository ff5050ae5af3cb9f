//! After the first frames, a frame allocates nothing. This is a test program of its own because the
//! counter covers the whole process.

#![expect(clippy::unwrap_used, reason = "in a test a failure to build is a failure of the test")]

#[path = "it/verification/keeper.rs"]
mod keeper;

use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{Acceleration, Air, FrameInput};
use forelock_core::groom::Groom;
use forelock_core::groom::guides::Skinning;
use forelock_core::interaction::grid::GridParams;
use forelock_core::interaction::sph::SphParams;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::{AmsParams, DftlParams, Solver};
use glam::{DQuat, DVec3, Vec3};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations of forty frames against a ball, after fifty frames of warm-up in which a grid grows
/// with the hair's bounding box.
fn allocations_of_frames(solver: &Solver<f32>, grid: Option<&GridParams>, sph: Option<&SphParams>) -> usize {
    let strand = |s: u16| {
        let root = Vec3::new(f32::from(s) * 1e-3, 0.0, 0.0);
        (0..25u8).map(move |i| root + Vec3::new(0.0, -0.01 * f32::from(i), 0.0)).collect::<Vec<_>>()
    };
    let groom = Groom::from_strands((0..500).map(strand)).unwrap();
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let options = Options { rest_gravity: gravity, ..Options::default() };
    let mut simulation = Simulation::new(&groom, solver, &options).unwrap();
    simulation.set_grid(grid).unwrap();
    simulation.set_sph(sph).unwrap();
    let shape = Shape::Sphere { radius: 0.1 };
    let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.25, -0.15, 0.1));
    let pose =
        |frame: u32| Pose::new(DQuat::from_rotation_y(0.5 * (0.2 * f64::from(frame)).sin()), DVec3::ZERO);
    let mut counted = 0;
    for frame in 0..90 {
        let head = [pose(frame), pose(frame + 1)];
        let colliders = [ColliderFrame { shape: &shape, local, from: head[0], to: head[1], friction: 0.3 }];
        let air_velocity = DVec3::ZERO;
        let before = ALLOCATIONS.load(Ordering::SeqCst);
        let frame_of = FrameInput {
            roots: head.into(),
            colliders: &colliders,
            gravity,
            air: Air::uniform(air_velocity),
            acceleration: Acceleration::Field(&|x| -x),
            dt_secs: 1.0 / 60.0,
        };
        let report = simulation.step_frame(&frame_of).unwrap();
        if frame >= 50 {
            counted += ALLOCATIONS.load(Ordering::SeqCst) - before;
        }
        assert_eq!(report.quarantined_strands, 0);
    }
    counted
}

/// Allocations of thirty frames in which hair sleeps and a ball wakes a part of it, after those in
/// which it fell asleep and was woken for the first time.
fn allocations_of_sleep(grid: Option<&GridParams>) -> usize {
    let strand = |s: u16| {
        let root = Vec3::new(f32::from(s) * 1e-3, 0.0, 0.0);
        (0..25u8).map(move |i| root + Vec3::new(0.0, -0.01 * f32::from(i), 0.0)).collect::<Vec<_>>()
    };
    let groom = Groom::from_strands((0..500).map(strand)).unwrap();
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let options = Options { rest_gravity: gravity, sleep_speed: 1e-3, ..Options::default() };
    let mut simulation = Simulation::new(&groom, &AmsParams::default(), &options).unwrap();
    simulation.set_grid(grid).unwrap();
    let shape = Shape::Sphere { radius: 0.03 };
    // It comes twice, the second time not quite as far, so that the grid's box is not larger then.
    let place = |frame: u32| {
        let z = match frame {
            0..80 => 0.1,
            80..105 => 0.1 - 4e-3 * f64::from(frame - 80),
            105..130 => 4e-3 * f64::from(frame - 105),
            _ => 0.1 - 3.6e-3 * f64::from(frame - 130),
        };
        Pose { translation: DVec3::new(0.1, -0.2, z), ..Pose::IDENTITY }
    };
    let (mut counted, mut slept, mut fewest) = (0, 0, u32::MAX);
    for frame in 0..155 {
        let [from, to] = [frame, frame + 1].map(place);
        let ball = [ColliderFrame { shape: &shape, local: Pose::IDENTITY, from, to, friction: 0.3 }];
        let input = FrameInput { colliders: &ball, gravity, dt_secs: 1.0 / 60.0, ..FrameInput::default() };
        let before = ALLOCATIONS.load(Ordering::SeqCst);
        let sleeping = simulation.step_frame(&input).unwrap().sleeping_strands;
        if (70..80).contains(&frame) || frame >= 135 {
            counted += ALLOCATIONS.load(Ordering::SeqCst) - before;
        }
        (slept, fewest) = (slept.max(sleeping), if frame >= 135 { fewest.min(sleeping) } else { fewest });
    }
    assert_eq!(slept, 500);
    assert!((1..500).contains(&fewest), "{fewest}");
    counted
}

/// Allocations of ten frames of strands that follow guides, after one to make room.
fn allocations_of_skinning() -> usize {
    let strand = |s: u16| {
        let root = Vec3::new(f32::from(s) * 1e-3, 0.0, 0.0);
        (0..25u8).map(move |i| root + Vec3::new(0.0, -0.01 * f32::from(i), 0.0)).collect::<Vec<_>>()
    };
    let groom = Groom::from_strands((0..3000).map(strand)).unwrap();
    let mut skinning = Skinning::new(&groom, 200, 1).unwrap();
    let guides = skinning.guides().positions().to_vec();
    let mut out = Vec::new();
    skinning.skin(&Pose::IDENTITY, &guides, &mut out);
    let before = ALLOCATIONS.load(Ordering::SeqCst);
    (0..10).for_each(|_| skinning.skin(&Pose::IDENTITY, &guides, &mut out));
    ALLOCATIONS.load(Ordering::SeqCst) - before
}

#[test]
fn frames_allocate_nothing() {
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (ams, dftl) = ((&AmsParams::default()).into(), (&DftlParams::default()).into());
        let (on_grid, in_fluid) = (GridParams::default(), SphParams::default());
        for (solver, grid, sph) in [
            (&ams, None, None),
            (&ams, Some(&on_grid), None),
            (&dftl, None, None),
            (&dftl, None, Some(&in_fluid)),
            (&dftl, Some(&on_grid), None),
            (&keeper::keeper(), Some(&on_grid), None),
        ] {
            let counted = pool.install(|| allocations_of_frames(solver, grid, sph));
            println!("{threads} thread(s), {grid:?}, {sph:?}: {counted} allocations in 40 frames");
            assert_eq!(counted, 0, "{threads} thread(s), {grid:?}");
        }
        for grid in [None, Some(&on_grid)] {
            assert_eq!(
                pool.install(|| allocations_of_sleep(grid)),
                0,
                "sleep, {threads} thread(s), {grid:?}"
            );
        }
        assert_eq!(pool.install(allocations_of_skinning), 0, "skinning, {threads} thread(s)");
    }
    let before = ALLOCATIONS.load(Ordering::SeqCst);
    drop(std::hint::black_box(vec![1u8; 64]));
    assert_eq!(ALLOCATIONS.load(Ordering::SeqCst) - before, 1, "the counter counts");
}
