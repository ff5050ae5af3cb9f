//! Channels: state that only the solver understands, through frames, snapshots, teleports, edits
//! and changes of the solver.

use super::keeper::{COUNTS, FILTERED, FRAME, HALF_TURN, SUBSTEPS, keeper};
use crate::rig::{DT, GRAVITY, simds};
use forelock_core::frame::FrameInput;
use forelock_core::groom::Groom;
use forelock_core::groom::edit::{Edit, Lengthen, Operation, Source, Trim};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation, Teleport};
use forelock_core::solver::AmsParams;
use forelock_core::strands::{Snapshot, SnapshotError};
use glam::{DQuat, DVec3, Vec3};

const STRANDS: usize = 19;
/// Particles of a strand.
const EACH: usize = 8;

fn groom() -> Groom {
    let strand = |s: usize| {
        let along = Vec3::new(0.3, -1.0, 0.05 * s as f32).normalize() * 0.01;
        (0..EACH).map(move |i| Vec3::X * (0.01 * s as f32) + along * i as f32).collect::<Vec<_>>()
    };
    Groom::from_strands((0..STRANDS).map(strand)).unwrap()
}

/// The pose of the head at the start of frame `k`; the first is at rest.
fn pose(k: u32) -> Pose {
    let t = f64::from(k) * DT;
    Pose::new(DQuat::from_rotation_z(3.0 * t), DVec3::new(0.5 * t, 0.0, 0.2))
}

fn built(simd: Simd) -> Simulation {
    let options = Options { simd, rest_pose: pose(0), ..Options::default() };
    Simulation::new(&groom(), keeper(), &options).unwrap()
}

fn play(simulation: &mut Simulation, frames: std::ops::Range<u32>) -> u64 {
    for k in frames {
        let roots = [pose(k), pose(k + 1)].into();
        let frame = FrameInput { roots, gravity: GRAVITY, dt_secs: DT, ..FrameInput::default() };
        assert_eq!(simulation.step_frame(&frame).unwrap().quarantined_strands, 0);
    }
    simulation.state_hash()
}

fn after(frames: u32) -> Simulation {
    let mut simulation = built(Simd::Auto);
    play(&mut simulation, 0..frames);
    simulation
}

fn vector(snapshot: &Snapshot<f32>, p: usize) -> DVec3 {
    let all = &snapshot.extra[FILTERED.name];
    DVec3::from_array([0, 1, 2].map(|c| f64::from(all[3 * p + c])))
}

fn rotation(snapshot: &Snapshot<f32>, p: usize) -> DQuat {
    let all = &snapshot.extra[FRAME.name];
    DQuat::from_array([0, 1, 2, 3].map(|c| f64::from(all[4 * p + c])))
}

/// Distance of two rotations that accounts for their sign.
fn apart(a: DQuat, b: DQuat) -> f64 {
    (a - b).length().min((a + b).length())
}

/// Channels start at their initial values, in the head's axes, and are the solver's from then on.
#[test]
fn channels_start_with_the_first_frame() {
    let start = pose(30);
    let options = Options { rest_pose: start, ..Options::default() };
    let mut simulation = Simulation::new(&groom(), keeper(), &options).unwrap();
    assert!(simulation.snapshot().extra.values().all(Vec::is_empty), "nothing before the first frame");
    let still = FrameInput { roots: [start; 2].into(), dt_secs: DT, ..FrameInput::default() };
    for frame in 1..=3 {
        simulation.step_frame(&still).unwrap();
        let snapshot = simulation.snapshot();
        let steps = frame * SUBSTEPS;
        let expected_rotation = DQuat::from_rotation_y(2.0 * HALF_TURN * f64::from(steps)) * start.rotation;
        let expected_vector = start.rotation * DVec3::new(0.5, 0.0, 0.0) * 0.75f64.powi(steps as i32);
        let sum: f32 = (0..steps).map(|k| 2.0 + k as f32).sum::<f32>() + 2.0;
        for p in 0..STRANDS * EACH {
            assert_eq!(snapshot.extra[COUNTS.name][2 * p..][..2], [2.0 + steps as f32, sum]);
            assert!(apart(rotation(&snapshot, p), expected_rotation) < 1e-5);
            assert!(vector(&snapshot, p).distance(expected_vector) < 1e-5);
        }
    }
}

/// The bits are those of an uninterrupted run, for any width and any number of threads.
#[test]
fn snapshots_hold_them_bit_for_bit() {
    let whole = play(&mut built(Simd::Auto), 0..12);
    for interrupted in [0, 5] {
        let snapshot = after(interrupted).snapshot();
        let mut second = built(Simd::Auto);
        second.restore(&snapshot).unwrap();
        assert_eq!(second.snapshot(), snapshot);
        assert_eq!(play(&mut second, interrupted..12), whole, "after frame {interrupted}");
    }
    let of = |simd| play(&mut built(simd), 0..12);
    let fused = simds().filter(|simd| !matches!(simd, Simd::Scalar | Simd::Portable));
    assert!(fused.map(of).all(|hash| hash == whole));
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| play(&mut built(Simd::Auto), 0..12)), whole);
    }
    // The hash sees one bit of a channel.
    let mut snapshot = after(3).snapshot();
    let hash = snapshot.hash();
    let x = &mut snapshot.extra.get_mut(FRAME.name).unwrap()[7];
    *x = f32::from_bits(x.to_bits() ^ 1);
    assert_ne!(snapshot.hash(), hash);
    assert!(snapshot.bytes() > 4 * (3 + 3 + 1 + 1 + 9) * STRANDS * EACH);
}

#[test]
fn a_snapshot_without_a_channel_is_refused() {
    let mut simulation = after(3);
    let whole = simulation.snapshot();
    let expected = COUNTS.rows() * STRANDS * EACH;
    let mut without = whole.clone();
    without.extra.remove(COUNTS.name);
    let refused = simulation.restore(&without);
    assert_eq!(refused, Err(SnapshotError { array: "counts", expected, found: 0 }));
    without.extra.insert(COUNTS.name.to_owned(), vec![1.0; expected / 2]);
    let refused = simulation.restore(&without).unwrap_err();
    assert_eq!((refused.array, refused.found), ("counts", expected / 2));
    assert!(refused.to_string().contains("`counts`"), "{refused}");
    assert_eq!(simulation.snapshot(), whole, "nothing has changed");
    let ams = Simulation::new(&groom(), &AmsParams::default(), &Options::default()).unwrap();
    assert_eq!(ams.snapshot().extra.len(), 0);
    simulation.restore(&ams.snapshot()).unwrap_err();
}

#[test]
fn a_teleport_rotates_them() {
    let simulation = after(6);
    let before = simulation.snapshot();
    let to = Pose::new(DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0), DVec3::new(5.0, 1.0, -3.0));
    let turn = to.rotation * pose(6).rotation.inverse();
    for mode in [Teleport::CarryShape, Teleport::CarryShapeAndVelocity] {
        let mut simulation = after(6);
        simulation.teleport(&pose(6), &to, mode);
        let after = simulation.snapshot();
        assert_eq!(after.extra[COUNTS.name], before.extra[COUNTS.name]);
        for p in 0..STRANDS * EACH {
            assert!(vector(&after, p).distance(turn * vector(&before, p)) < 1e-6);
            assert!(apart(rotation(&after, p), turn * rotation(&before, p)) < 1e-6);
        }
        assert!(apart(rotation(&after, 9), rotation(&before, 9)) > 0.1, "the comparison can fail");
    }
    // Hair that is reset starts anew.
    let mut simulation = after(6);
    simulation.teleport(&pose(6), &to, Teleport::Reset);
    let still = FrameInput { roots: [to; 2].into(), dt_secs: DT, ..FrameInput::default() };
    simulation.step_frame(&still).unwrap();
    let after = simulation.snapshot();
    let expected = DQuat::from_rotation_y(2.0 * HALF_TURN * f64::from(SUBSTEPS)) * to.rotation;
    assert!(apart(rotation(&after, 9), expected) < 1e-6);
    assert_eq!(after.extra[COUNTS.name][0], 2.0 + SUBSTEPS as f32);
}

/// A strand that is not finite starts anew; the others go on.
#[test]
fn a_reset_strand_starts_anew() {
    let mut simulation = after(6);
    let mut sick = simulation.snapshot();
    sick.positions[EACH * 4 + 3][1] = f32::NAN;
    simulation.restore(&sick).unwrap();
    let [from, to] = [pose(6), pose(7)];
    let frame = FrameInput { roots: [from, to].into(), dt_secs: DT, ..FrameInput::default() };
    assert_eq!(simulation.step_frame(&frame).unwrap().quarantined_strands, 1);
    let snapshot = simulation.snapshot();
    for s in 0..STRANDS {
        let count = 2.0 + if s == 4 { 0.0 } else { 7.0 * SUBSTEPS as f32 };
        for p in EACH * s..EACH * (s + 1) {
            assert_eq!(snapshot.extra[COUNTS.name][2 * p], count, "strand {s}");
            if s == 4 {
                assert!(apart(rotation(&snapshot, p), to.rotation) < 1e-6);
                assert!(vector(&snapshot, p).distance(to.rotation * DVec3::new(0.5, 0.0, 0.0)) < 1e-6);
            }
        }
    }
}

/// Channels with a gradient along the strands: numbers and vectors that are linear in the arc
/// length, rotations about x by an angle that is.
fn graded(simulation: &mut Simulation) {
    let mut snapshot = simulation.snapshot();
    let along = |p: usize| (p % EACH) as f32;
    let particles = 0..STRANDS * EACH;
    let numbers = particles.clone().flat_map(|p| [along(p), -along(p)]).collect();
    let vectors = particles.clone().flat_map(|p| [1.0, along(p), (p / EACH) as f32]).collect();
    let quaternion = |p: usize| {
        let q = DQuat::from_rotation_x(0.2 * f64::from(along(p))).as_quat().to_array();
        // Either sign is the same rotation.
        if p.is_multiple_of(2) { q } else { q.map(|x| -x) }
    };
    let rotations = particles.flat_map(quaternion).collect();
    snapshot.extra = [(COUNTS.name, numbers), (FILTERED.name, vectors), (FRAME.name, rotations)]
        .map(|(name, values)| (name.to_owned(), values))
        .into();
    simulation.restore(&snapshot).unwrap();
}

/// Cut hair has the channels of where it is; hair that is longer continues those of the old tip.
#[test]
fn edits_keep_them() {
    for operation in [
        Operation::Trim(Trim { to: 0.045, ..Trim::default() }),
        Operation::Lengthen(Lengthen { by: 0.02, ..Lengthen::default() }),
    ] {
        let mut simulation = after(3);
        graded(&mut simulation);
        let mut edited = groom();
        let sources = Edit::all(operation.clone()).apply(&mut edited, None).unwrap().sources;
        simulation.regroom(&edited, &sources, &pose(3)).unwrap();
        let snapshot = simulation.snapshot();
        let mut changed = 0;
        for s in 0..edited.strand_count() {
            let points = edited.strand(s);
            let mut arc = 0.0;
            for (i, p) in edited.range(s).enumerate() {
                arc += if i == 0 { 0.0 } else { f64::from(points[i].distance(points[i - 1])) / 0.01 };
                let t = arc.min((EACH - 1) as f64);
                changed += usize::from((t - t.round()).abs() > 0.1 || arc > t + 0.5);
                let [count, sum] = [0, 1].map(|k| f64::from(snapshot.extra[COUNTS.name][2 * p + k]));
                assert!((count - t).abs() < 1e-3 && (sum + t).abs() < 1e-3, "{operation:?} {count} {t}");
                let expected = DVec3::new(1.0, t, s as f64);
                assert!(vector(&snapshot, p).distance(expected) < 1e-3, "{operation:?}");
                let q = rotation(&snapshot, p);
                assert!((q.length() - 1.0).abs() < 1e-6, "{q}");
                assert!(apart(q, DQuat::from_rotation_x(0.2 * t)) < 1e-3, "{operation:?}: {q} {t}");
            }
        }
        assert!(changed >= STRANDS, "{operation:?}: no particle is between old ones or past the tip");
        play(&mut simulation, 3..6);
    }
    // Without a change all bits are kept; before the first frame there is nothing to keep.
    let sources: Vec<Source> = (0..STRANDS as u32).map(|strand| Source { strand, fresh: false }).collect();
    for frames in [0, 4] {
        let mut simulation = after(frames);
        let before = simulation.snapshot();
        simulation.regroom(&groom(), &sources, &pose(frames)).unwrap();
        assert_eq!(simulation.snapshot().extra, before.extra);
    }
}

/// Another solver drops the channels that it does not ask for; they start again when asked for.
#[test]
fn a_change_of_the_solver_drops_and_starts_them() {
    let mut simulation = after(5);
    let before = simulation.snapshot();
    simulation.set_params(keeper()).unwrap();
    assert_eq!(simulation.snapshot(), before, "the same channels are kept");
    simulation.set_params(&AmsParams::default()).unwrap();
    assert_eq!(simulation.snapshot().extra.len(), 0);
    play(&mut simulation, 5..7);
    simulation.set_params(keeper()).unwrap();
    play(&mut simulation, 7..8);
    let snapshot = simulation.snapshot();
    assert_eq!(snapshot.extra[COUNTS.name][0], 2.0 + SUBSTEPS as f32);
    let expected = DQuat::from_rotation_y(2.0 * HALF_TURN * f64::from(SUBSTEPS)) * pose(7).rotation;
    assert!(apart(rotation(&snapshot, 0), expected) < 1e-6);
}
