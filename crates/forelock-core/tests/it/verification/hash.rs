//! The state's bits: the same for any number of threads, any register width, and after a restored
//! snapshot.

use crate::rig::{DT, Rig, shake, simds, tuft};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::solver::AmsParams;
use glam::{DQuat, DVec3};

const FRAMES: u32 = 16;
/// One, and a lane's worth more and less of every width.
const SIZES: [usize; 8] = [1, 7, 8, 9, 15, 16, 17, 33];

fn rig(strands: usize, simd: Simd) -> Rig<f32> {
    let params = AmsParams { non_hookean: true, healing_secs: 1.0, ..AmsParams::default() };
    let mut strands = tuft(strands, 12);
    if strands.len() > 8 {
        strands[3].truncate(5);
    }
    Rig::new(&strands, &params, simd)
}

/// Frames `from..to` of a shake against a ball under the roots.
fn play(rig: &mut Rig<f32>, from: u32, to: u32) -> u64 {
    play_against(rig, Ball { radius: 0.06, depth: 0.2 }, from..to)
}

/// A ball below the head.
struct Ball {
    radius: f64,
    depth: f64,
}

/// The same against a `ball`.
fn play_against(rig: &mut Rig<f32>, ball: Ball, frames: std::ops::Range<u32>) -> u64 {
    let Ball { radius, depth } = ball;
    let shape = Shape::Sphere { radius };
    let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.02, -depth, 0.0));
    for frame in frames {
        let pose = shake(3.0, 2.0, f64::from(frame + 1) * DT);
        let solid = ColliderFrame { shape: &shape, local, from: rig.head, to: pose, friction: 0.3 };
        rig.step_among(pose, &[solid]);
    }
    rig.simulation.state_hash()
}

#[test]
fn threads_leave_the_bits_alone() {
    for strands in SIZES {
        let mut hashes = Vec::new();
        for threads in [1, 2, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            hashes.push(pool.install(|| play(&mut rig(strands, Simd::Auto), 0, FRAMES)));
        }
        assert!(hashes.iter().all(|&h| h == hashes[0]), "{strands} strands: {hashes:x?}");
    }
}

#[test]
fn widths_leave_the_bits_alone() {
    for strands in SIZES {
        let of = |simd| play(&mut rig(strands, simd), 0, FRAMES);
        assert_eq!(of(Simd::Scalar), of(Simd::Portable), "{strands} strands");
        let fused = simds().filter(|s| !matches!(s, Simd::Scalar | Simd::Portable));
        let hashes: Vec<_> = fused.map(|simd| (simd, of(simd))).collect();
        assert!(hashes.iter().all(|h| h.1 == hashes[0].1), "{strands} strands: {hashes:x?}");
    }
}

/// Strands so long that rounding alone stretches their edges by over 1e-5, one of them on a ball: a
/// contact of one strand in a register must not change the others.
#[test]
fn a_neighbour_that_touches_leaves_the_bits_alone() {
    let long = |s: usize| -> Vec<[f64; 3]> {
        let point = |i: f64| [0.1 * s as f64 + 0.01 * (0.5 * i).cos(), -0.0087 * i, 0.01 * (0.5 * i).sin()];
        (0..600).map(|i| point(f64::from(i))).collect()
    };
    let strands: Vec<_> = (0..9).map(long).collect();
    let of = |simd| {
        let mut rig = Rig::new(&strands, &AmsParams::default(), simd);
        play_against(&mut rig, Ball { radius: 0.04, depth: 3.0 }, 0..FRAMES)
    };
    assert_eq!(of(Simd::Scalar), of(Simd::Portable));
    let fused = simds().filter(|s| !matches!(s, Simd::Scalar | Simd::Portable));
    let hashes: Vec<_> = fused.map(|simd| (simd, of(simd))).collect();
    assert!(hashes.iter().all(|h| h.1 == hashes[0].1), "{hashes:x?}");
}

#[test]
fn an_interruption_leaves_the_bits_alone() {
    for strands in SIZES {
        let whole = play(&mut rig(strands, Simd::Auto), 0, FRAMES);
        let mut first = rig(strands, Simd::Auto);
        play(&mut first, 0, FRAMES / 2);
        let mut second = rig(strands, Simd::Auto);
        second.simulation.restore(&first.simulation.snapshot()).unwrap();
        second.head = first.head;
        assert_eq!(first.simulation.state_hash(), second.simulation.state_hash());
        assert_eq!(whole, play(&mut second, FRAMES / 2, FRAMES), "{strands} strands");
    }
}

/// The hash sees one bit of any array, and where it stands.
#[test]
fn one_bit_shows() {
    let mut rig = rig(17, Simd::Auto);
    play(&mut rig, 0, 3);
    let snapshot = rig.simulation.snapshot();
    let hash = snapshot.hash();
    let next = |x: f32| f32::from_bits(x.to_bits() ^ 1);
    for p in [0, 1, 100, snapshot.positions.len() - 1] {
        let mut others = [(); 4].map(|()| snapshot.clone());
        others[0].positions[p][1] = next(snapshot.positions[p][1]);
        others[1].velocities[p][2] = next(snapshot.velocities[p][2]);
        others[2].integrity[p] = next(snapshot.integrity[p]);
        others[3].clearance[p] = next(snapshot.clearance[p]);
        assert!(others.iter().all(|s| s.hash() != hash), "particle {p}");
    }
    let mut swapped = snapshot.clone();
    swapped.positions.swap(20, 21);
    assert_ne!(swapped.hash(), hash);
}
