//! Strands that are still fall asleep, stay where the awake ones would be, and wake on each cause.

use super::counting::counting;
use crate::rig::{DT, GRAVITY, Rig, Strand, assert_one_hash, helix, largest, shake, tuft};
use forelock_core::air::WindField;
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{Acceleration, Air, FrameInput, FrameReport, Roots};
use forelock_core::interaction::Interactions;
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::lane::{LANES, Simd};
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Teleport};
use forelock_core::solver::{AmsParams, DftlParams, Solver};
use glam::{DQuat, DVec3, Vec3};

/// A change of a frame.
type FrameChange<'s> = dyn for<'a> Fn(&mut FrameInput<'a>) + 's;
/// A change of a scene.
type RigChange<'s> = dyn Fn(&mut Rig<f32>) + 's;

/// The sleep speed of these tests, m/s.
const SPEED: f64 = 1e-3;
const STILL: [Pose; 2] = [Pose::IDENTITY; 2];

fn options(simd: Simd, sleep_speed: f64) -> Options {
    Options { simd, rest_gravity: GRAVITY, sleep_speed, ..Options::default() }
}

/// Three blocks of hair on a head at rest.
fn hair(solver: impl Into<Solver<f32>>, sleep_speed: f64) -> Rig<f32> {
    Rig::with_options(&tuft(3 * LANES, 12), solver, &options(Simd::Auto, sleep_speed))
}

/// Frames until everything sleeps; at most `most`.
fn frames_to_sleep(rig: &mut Rig<f32>, most: u32) -> Option<u32> {
    let strands = rig.simulation.model().strand_count;
    (1..=most).find(|_| {
        rig.step(rig.head);
        rig.simulation.sleeping_strands() == strands
    })
}

/// Hair that has fallen asleep.
fn asleep() -> Rig<f32> {
    let mut rig = hair(&AmsParams::default(), SPEED);
    let frames = frames_to_sleep(&mut rig, 70);
    // Sixty sixtieths in float32 may be less than a second.
    assert!(frames.is_some_and(|frames| (60..=61).contains(&frames)), "a second: {frames:?}");
    rig
}

/// Strands that sleep in a frame with `change` made to its input.
fn sleeping(rig: &mut Rig<f32>, change: impl FnOnce(&mut FrameInput<'_>)) -> u32 {
    let mut frame =
        FrameInput { roots: STILL.into(), gravity: GRAVITY, dt_secs: DT, ..FrameInput::default() };
    change(&mut frame);
    rig.simulation.step_frame(&frame).unwrap().sleeping_strands
}

/// After a shake of 4 g, two seconds long.
fn shaken(solver: &Solver<f32>, sleep_speed: f64) -> Rig<f32> {
    let mut rig = hair(solver, sleep_speed);
    rig.play(2.0, |t| shake(4.0, 2.0, t));
    rig
}

/// 10 s after the shake hair sleeps, and is within 0.1 mm of hair that never sleeps, then and 10 s
/// later. Hair that is stopped at once, with the same bound, is not.
#[test]
fn hair_sleeps_after_a_shake_where_it_would_have_come_to_rest() {
    let solvers: [(&str, Solver<f32>); 2] =
        [("ams", (&AmsParams::default()).into()), ("dftl", (&DftlParams::default()).into())];
    for (name, solver) in &solvers {
        let [mut sleeper, mut awake] = [SPEED, 0.0].map(|speed| shaken(solver, speed));
        let stopped = sleeper.positions();
        let frames = frames_to_sleep(&mut sleeper, 600);
        assert_eq!(frames_to_sleep(&mut awake, 1200), None);
        let apart = largest(&sleeper.positions(), &awake.positions());
        println!("{name}: asleep after {frames:?} frames, {:.4} mm from awake hair", apart * 1e3);
        assert!(frames.is_some(), "{name}");
        assert!(apart < 1e-4, "{name}: {apart}");
        assert!(largest(&stopped, &awake.positions()) > 1e-3, "{name}: the bound means nothing");
    }
}

/// A strand in syrup creeps towards its rest shape. It sleeps only once it is slower than the
/// bound: from there it has less than the bound of the module's documentation to go.
#[test]
fn a_strand_that_creeps_is_not_stopped_on_its_way() {
    let params = AmsParams { drag: 100.0, ..AmsParams::default() };
    let bound = (2.0 / 1.0 + params.drag) * SPEED / params.k_integrity;
    let mut rig = hair(&params, SPEED);
    let rest = rig.positions();
    rig.gravity = DVec3::new(6.0, -5.0, 0.0);
    (0..120).for_each(|_| {
        rig.step(Pose::IDENTITY);
    });
    rig.gravity = GRAVITY;
    let away = largest(&rest, &rig.positions());
    let frames = frames_to_sleep(&mut rig, 1200).unwrap();
    let left = largest(&rest, &rig.positions());
    println!(
        "{:.2} mm away, asleep after {frames} frames, {:.3} of {:.3} mm left",
        away * 1e3,
        left * 1e3,
        bound * 1e3
    );
    assert!(away > 0.02 && left < bound, "{away} {left} {bound}");
    // It was far from there a second before it slept: the second matters.
    assert!(frames > 120);
}

/// Friction between neighbours holds hair away from its rest shape after a gentle motion, still for
/// more than a second. It does not sleep before friction has faded and it is back, except for pairs
/// that press on each other.
#[test]
fn hair_that_friction_holds_does_not_sleep_away_from_its_rest_shape() {
    let strands = tuft(300, 12);
    let mut rig = Rig::<f32>::with_options(&strands, &AmsParams::default(), &options(Simd::Auto, SPEED));
    rig.simulation.set_contacts(Some(&ContactParams::default())).unwrap();
    let rest = rig.positions();
    rig.play(1.0, |t| shake(0.2, 2.0, t));
    let rest: Vec<_> = rest.iter().map(|x| rig.head.transform_point(*x)).collect();
    let share_away = |rig: &Rig<f32>| {
        let now = rig.positions();
        let away = rest.iter().zip(&now).filter(|(rest, now)| rest.distance(**now) > 1e-4);
        away.count() as f64 / now.len() as f64
    };
    assert_eq!(frames_to_sleep(&mut rig, 120), None);
    let held = share_away(&rig);
    let frames = frames_to_sleep(&mut rig, 600);
    let asleep = share_away(&rig);
    println!("farther than 0.1 mm: {held:.3} after 2 s, {asleep:.4} asleep, {frames:?} frames later");
    assert!(frames.is_some() && held > 0.5 && asleep < 0.01, "{held} {asleep} {frames:?}");
}

/// Friction between neighbours does not move hair that is at rest, however few strands there are.
#[test]
fn hair_at_rest_stays_at_rest_with_contacts() {
    for count in [12, 48, 300, 1000] {
        let strands = tuft(count, 12);
        let mut rig = Rig::<f32>::with_options(&strands, &AmsParams::default(), &options(Simd::Auto, 0.0));
        rig.simulation.set_contacts(Some(&ContactParams::default())).unwrap();
        let rest = rig.positions();
        (0..240).for_each(|_| {
            rig.step(Pose::IDENTITY);
        });
        let moved = largest(&rest, &rig.positions());
        println!("{count} strands: moved {moved:.1e} m");
        assert!(moved < 1e-5, "{count} strands: {moved}");
    }
}

/// A frame in which all hair sleeps advances no block and runs no interaction.
#[test]
fn a_sleeping_frame_does_nothing() {
    let grid_and_contacts = Interactions {
        grid: Some(GridParams::default()),
        contacts: Some(ContactParams::default()),
        ..Interactions::default()
    };
    for interactions in [Interactions::default(), grid_and_contacts] {
        let (solver, blocks) = counting();
        let mut rig = hair(&solver, SPEED);
        rig.simulation.set_interactions(&interactions).unwrap();
        let advanced = || blocks.swap(0, std::sync::atomic::Ordering::Relaxed);
        let frames = frames_to_sleep(&mut rig, 240).unwrap();
        assert_eq!(advanced(), 3 * frames);
        let state = rig.simulation.state_hash();
        let report = rig.step(Pose::IDENTITY);
        assert_eq!((report.sleeping_strands, advanced()), (48, 0));
        assert_eq!(report.stages.iter().count(), 0, "{:?}", report.stages);
        assert_eq!(rig.simulation.state_hash(), state);
        rig.simulation.wake();
        assert_eq!((rig.step(Pose::IDENTITY).sleeping_strands, advanced()), (0, 3));
    }
}

/// Each change of the surroundings wakes all hair in its first frame, and the same frame without it
/// does not.
#[test]
fn surroundings_that_change_wake_all() {
    let moved = |x: f64| Pose { translation: DVec3::X * x, ..Pose::IDENTITY };
    let wind = WindField { mean: DVec3::X, ..WindField::default() };
    let still_wind = WindField { mean: DVec3::ZERO, ..WindField::default() };
    let pushes = vec![Vec3::ZERO; 3 * LANES * 12];
    let field = |_: DVec3| DVec3::ZERO;
    let turned = Pose { rotation: DQuat::from_rotation_y(1e-6), ..Pose::IDENTITY };
    let causes: [(&str, &FrameChange<'_>); 7] = [
        ("the head moves", &|frame| frame.roots = Roots::Rigid([Pose::IDENTITY, moved(1e-6)])),
        ("the head turns", &|frame| frame.roots = Roots::Rigid([Pose::IDENTITY, turned])),
        ("the head is elsewhere", &|frame| frame.roots = Roots::Rigid([moved(1e-4); 2])),
        ("gravity", &|frame| frame.gravity *= 1.001),
        ("wind", &|frame| frame.air = Air::uniform(DVec3::X * 1e-3)),
        ("a falling frame", &|frame| frame.gravity = DVec3::ZERO),
        ("the head comes back", &|frame| frame.roots = Roots::Rigid([moved(1e-3), Pose::IDENTITY])),
    ];
    let mut rig = asleep();
    let state = rig.simulation.snapshot();
    for (name, change) in causes {
        rig.simulation.restore(&state).unwrap();
        assert_eq!(sleeping(&mut rig, |_| ()), 48, "asleep without: {name}");
        assert_eq!(sleeping(&mut rig, |frame| change(frame)), 0, "{name}");
    }
    let mut frame =
        FrameInput { roots: STILL.into(), gravity: GRAVITY, dt_secs: DT, ..FrameInput::default() };
    for (name, air, acceleration, expected) in [
        ("still field", Air { velocity: DVec3::ZERO, field: Some(&still_wind) }, Acceleration::None, 48),
        ("wind field", Air { velocity: DVec3::ZERO, field: Some(&wind) }, Acceleration::None, 0),
        ("accelerations", Air::default(), Acceleration::PerParticle(&pushes), 0),
        ("accelerating field", Air::default(), Acceleration::Field(&field), 0),
    ] {
        rig.simulation.restore(&state).unwrap();
        (frame.air, frame.acceleration) = (air, acceleration);
        let found = rig.simulation.step_frame(&frame).unwrap().sleeping_strands;
        assert_eq!(found, expected, "{name}");
    }
    // Rounding of the head's pose, and other lengths of frames, do not.
    rig.simulation.restore(&state).unwrap();
    assert_eq!(sleeping(&mut rig, |frame| frame.roots = Roots::Rigid([moved(1e-13); 2])), 48);
    assert_eq!(sleeping(&mut rig, |frame| frame.dt_secs = 1.0 / 24.0), 48);
}

/// A head that creeps does not leave its hair behind, however slowly it moves.
#[test]
fn hair_is_not_left_behind_by_a_head_that_creeps() {
    for step in [9e-10, 1e-8, 1e-6] {
        let mut rig = asleep();
        let rest = rig.positions();
        for frame in 1..=3000 {
            rig.step(Pose { translation: DVec3::X * (step * f64::from(frame)), ..Pose::IDENTITY });
        }
        let moved: Vec<_> = rest.iter().map(|x| *x + DVec3::X * (step * 3000.0)).collect();
        let behind = largest(&moved, &rig.positions());
        println!("{step:e} m a frame: {behind:.1e} m behind");
        assert!(behind < 2.5e-6, "{step}: {behind}");
    }
}

/// What is done to a simulation between frames wakes all hair.
#[test]
fn changes_of_the_simulation_wake_all() {
    let params = AmsParams::default();
    let contacts = ContactParams::default();
    let causes: [(&str, &RigChange<'_>); 9] = [
        ("parameters", &|rig| rig.simulation.set_params(&params).unwrap()),
        ("contacts", &|rig| rig.simulation.set_contacts(Some(&contacts)).unwrap()),
        ("grid", &|rig| rig.simulation.set_grid(Some(&GridParams::default())).unwrap()),
        ("no interactions", &|rig| rig.simulation.set_interactions(&Interactions::default()).unwrap()),
        ("other colliders", &|rig| rig.simulation.forget_solids()),
        ("teleport", &|rig| rig.simulation.teleport(&STILL[0], &STILL[0], Teleport::CarryShape)),
        ("reset", &|rig| rig.simulation.teleport(&STILL[0], &STILL[0], Teleport::Reset)),
        ("state", &|rig| {
            rig.simulation.state_mut();
        }),
        ("another speed", &|rig| rig.simulation.set_sleep_speed(2.0 * SPEED)),
    ];
    for (name, change) in causes {
        let mut rig = asleep();
        assert_eq!(sleeping(&mut rig, |_| ()), 48);
        change(&mut rig);
        assert_eq!(sleeping(&mut rig, |_| ()), 0, "{name}");
        assert!(frames_to_sleep(&mut rig, 240).is_some(), "{name}: asleep again");
    }
    let mut rig = asleep();
    let awake = hair(&params, SPEED).simulation.snapshot();
    rig.simulation.restore(&awake).unwrap();
    assert_eq!(sleeping(&mut rig, |_| ()), 0, "a state in which it was awake");
    let mut rig = asleep();
    let plan = rig.simulation.plan_for(DT);
    let frame = FrameInput { roots: STILL.into(), gravity: GRAVITY, dt_secs: DT, ..FrameInput::default() };
    let report = rig.simulation.step_part(&frame, &plan.steps()[..1]).unwrap();
    assert_eq!(report.sleeping_strands, 0, "a part of a frame");
}

/// Strands in rows of blocks along x, 10 cm from one block to the next.
fn rows_of_blocks(blocks: usize) -> Vec<Strand> {
    let strand = |s: usize| {
        let root = DVec3::new(0.1 * (s / LANES) as f64 + 1e-3 * (s % LANES) as f64, 0.0, 0.0);
        helix(12).iter().map(|&p| (root + DVec3::from(p)).to_array()).collect()
    };
    (0..blocks * LANES).map(strand).collect()
}

/// A ball that goes through the hair from `from` to `to` in a frame.
fn ball<'a>(shape: &'a Shape, from: DVec3, to: DVec3) -> ColliderFrame<'a> {
    let [from, to] = [from, to].map(|translation| Pose { translation, ..Pose::IDENTITY });
    ColliderFrame { shape, local: Pose::IDENTITY, from, to, friction: 0.3 }
}

/// A hand that comes near wakes the strands within its reach, before it touches them, and no
/// others. One that passes far away, and one that rests among the hair, wake none.
#[test]
fn a_collider_wakes_what_is_near() {
    let shape = Shape::Sphere { radius: 0.03 };
    let mut rig =
        Rig::<f32>::with_options(&rows_of_blocks(5), &AmsParams::default(), &options(Simd::Auto, SPEED));
    let far = DVec3::new(0.0, -0.15, 0.5);
    let before = rig.positions();
    for _ in 0..61 {
        rig.step_among(Pose::IDENTITY, &[ball(&shape, far, far)]);
    }
    let asleep = |report: FrameReport| report.sleeping_strands;
    let mut at = far;
    let mut go = |rig: &mut Rig<f32>, to: DVec3| {
        let report = rig.step_among(Pose::IDENTITY, &[ball(&shape, at, to)]);
        at = to;
        report
    };
    // It passes at 10 cm.
    assert_eq!(asleep(go(&mut rig, far)), 80);
    for x in 1..=20 {
        assert_eq!(asleep(go(&mut rig, DVec3::new(0.02 * f64::from(x), -0.15, 0.14))), 80);
    }
    // It comes to the third block and stays in it.
    let mut frames = 0;
    for z in (0..=28).rev() {
        let report = go(&mut rig, DVec3::new(0.2, -0.15, 5e-3 * f64::from(z)));
        frames += u32::from(asleep(report) == 64);
        assert!([64, 80].contains(&asleep(report)), "{}", asleep(report));
        assert!(report.touching == 0 || asleep(report) == 64);
    }
    assert!(frames >= 8, "{frames}");
    let after = rig.positions();
    let moved = |block: usize| largest(&before[block * 192..][..192], &after[block * 192..][..192]);
    assert!(moved(2) > 0.01, "{}", moved(2));
    assert!([0, 1, 3, 4].into_iter().all(|block| moved(block) < 1e-5));
    // It moves back a little, the strands fall asleep against it, and wake when it leaves.
    let here = DVec3::new(0.2, -0.15, 0.035);
    let rested = (0..1200).any(|_| asleep(go(&mut rig, here)) == 80);
    assert!(rested, "the strands on the ball do not come to rest");
    assert_eq!(asleep(go(&mut rig, here + DVec3::Z * 1e-4)), 64, "it leaves");
    // A ball that is suddenly there was not announced: all wake.
    let report = rig.step_among(Pose::IDENTITY, &[ball(&shape, far, far)]);
    assert_eq!(asleep(report), 0, "it jumped");
}

/// One block swings against another that sleeps: with contacts the sleeper wakes when it is hit,
/// and not before. Where the other swings free of it, and without contacts, it sleeps on.
#[test]
fn strands_that_are_awake_wake_those_they_push() {
    let contacts = Interactions { contacts: Some(ContactParams::default()), ..Interactions::default() };
    let of = |interactions: &Interactions, gap: f64| {
        let mut strands = rows_of_blocks(2);
        for strand in &mut strands[LANES..] {
            strand.iter_mut().for_each(|p| p[0] += gap - 0.1);
        }
        let mut rig = Rig::<f32>::with_options(&strands, &AmsParams::default(), &options(Simd::Auto, SPEED));
        rig.simulation.set_interactions(interactions).unwrap();
        frames_to_sleep(&mut rig, 240).unwrap();
        // The first block is thrown towards the second.
        rig.edit(|snapshot| {
            let sleep = snapshot.sleep.as_mut().unwrap();
            sleep.still_secs[..LANES].fill(0.0);
            for (k, v) in snapshot.velocities[..LANES * 12].iter_mut().enumerate() {
                *v = [0.1 * (k % 12) as f32, 0.0, 0.0];
            }
        });
        let mut slept = 0;
        let mut met = 0;
        for _ in 0..20 {
            let report = rig.step(Pose::IDENTITY);
            slept += u32::from(report.sleeping_strands == 16);
            met += report.strand_contacts.contacts;
        }
        (slept, met)
    };
    let (slept, met) = of(&contacts, 0.04);
    println!("hit: asleep in {slept} of 20 frames, {met} contacts");
    assert!((1..15).contains(&slept) && met > 0, "{slept} {met}");
    assert_eq!(of(&contacts, 0.3), (20, 0), "out of reach");
    assert_eq!(of(&Interactions::default(), 0.04), (20, 0), "without contacts");
}

/// Hair that wakes goes on from where it slept, without a jump.
#[test]
fn waking_does_not_pop() {
    for solver in [Solver::from(&AmsParams::default()), (&DftlParams::default()).into()] {
        let mut rig = shaken(&solver, SPEED);
        frames_to_sleep(&mut rig, 600).unwrap();
        let before = rig.positions();
        rig.simulation.wake();
        rig.step(rig.head);
        let jump = largest(&before, &rig.positions());
        println!("{}: {jump:.1e} m in the first frame", solver.name());
        assert!(jump <= SPEED * DT, "{jump}");
    }
}

/// A snapshot of hair that sleeps, or is about to, goes on bit for bit; one without sleep is awake.
#[test]
fn snapshots_hold_sleep() {
    let solver = (&AmsParams::default()).into();
    let mut whole = shaken(&solver, SPEED);
    let hashes: Vec<u64> = (0..400)
        .map(|_| {
            whole.step(whole.head);
            whole.simulation.state_hash()
        })
        .collect();
    for cut in [20, 150, 399] {
        let mut first = shaken(&solver, SPEED);
        (0..cut).for_each(|_| {
            first.step(first.head);
        });
        let snapshot = first.simulation.snapshot();
        let mut second = hair(&solver, SPEED);
        second.simulation.restore(&snapshot).unwrap();
        assert_eq!(second.simulation.snapshot(), snapshot);
        second.head = first.head;
        for (frame, &hash) in hashes.iter().enumerate().skip(cut) {
            second.step(second.head);
            assert_eq!(second.simulation.state_hash(), hash, "cut {cut}, frame {frame}");
        }
    }
    let mut rig = asleep();
    let mut snapshot = rig.simulation.snapshot();
    let hash = snapshot.hash();
    let secs = |snapshot: &mut forelock_core::strands::Snapshot<f32>| {
        snapshot.sleep.as_mut().unwrap().still_secs.pop();
    };
    let mut other = snapshot.clone();
    secs(&mut other);
    assert!(rig.simulation.restore(&other).is_err(), "the sleep of other hair");
    snapshot.sleep = None;
    assert_ne!(snapshot.hash(), hash);
    rig.simulation.restore(&snapshot).unwrap();
    assert_eq!(sleeping(&mut rig, |_| ()), 0);
}

/// Sleep depends neither on threads nor on the width: half a block, blocks that sleep and wake, and
/// contacts among them.
#[test]
fn threads_and_widths_leave_sleep_alone() {
    assert_one_hash(|simd| {
        let mut strands = rows_of_blocks(3);
        strands.truncate(2 * LANES + 5);
        let mut rig = Rig::<f32>::with_options(&strands, &AmsParams::default(), &options(simd, SPEED));
        rig.play(0.5, |t| shake(2.0, 2.0, t));
        let shape = Shape::Sphere { radius: 0.02 };
        let mut counts = Vec::new();
        for frame in 0..600 {
            let z = |frame: i32| DVec3::new(0.2, -0.2, 0.06 - 5e-4 * f64::from((frame - 450).clamp(0, 100)));
            let report = rig.step_among(rig.head, &[ball(&shape, z(frame), z(frame + 1))]);
            counts.push(report.sleeping_strands);
        }
        assert!(counts.contains(&37) && counts.contains(&32), "{counts:?}");
        rig.simulation.state_hash()
    });
}

/// Without a sleep speed nothing is recorded and nothing changes.
#[test]
fn hair_without_a_sleep_speed_stays_awake() {
    let mut rig = hair(&AmsParams::default(), 0.0);
    assert_eq!(frames_to_sleep(&mut rig, 90), None);
    assert_eq!(rig.simulation.snapshot().sleep, None);
    let mut sleeper = hair(&AmsParams::default(), SPEED);
    rig = hair(&AmsParams::default(), 0.0);
    for own in [&mut rig, &mut sleeper] {
        own.play(1.0, |t| shake(1.0, 2.0, t));
    }
    assert_eq!(rig.simulation.state_hash(), sleeper.simulation.state_hash(), "in motion");
}
