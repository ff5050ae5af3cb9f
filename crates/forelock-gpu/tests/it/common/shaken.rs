//! A tuft on a head that is shaken, and how far hair is from where it should be.

use forelock_core::pose::Pose;
use forelock_core::simulation::Options;
use glam::{DQuat, DVec3};

pub const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

/// `count` curls of `particles(strand)` particles each, `spacing` metres apart, in groups of fifty.
/// Each curl leans by `lean` radians more than the one before. Also returns their offsets.
pub fn tuft(
    count: u32,
    particles: impl Fn(u32) -> u32,
    [spacing, lean]: [f64; 2],
) -> (Vec<[f32; 3]>, Vec<u32>) {
    let (mut positions, mut offsets) = (Vec::new(), vec![0]);
    for strand in 0..count {
        let turn = DQuat::from_rotation_y(2.4 * f64::from(strand))
            * DQuat::from_rotation_z(lean * f64::from(strand % 50));
        let root = DVec3::new(spacing * f64::from(strand % 40), 0.0, spacing * f64::from(strand / 40));
        let n = particles(strand);
        for i in 0..n {
            let s = f64::from(i) / f64::from(n - 1);
            let curl = DVec3::new(0.01 * (12.0 * s).cos(), -0.25 * s, 0.01 * (12.0 * s).sin());
            positions.push((root + turn * curl).as_vec3().to_array());
        }
        offsets.push(positions.len() as u32);
    }
    (positions, offsets)
}

/// A head that nods, turns and is shaken, after `t` seconds.
pub fn head(t: f64) -> Pose {
    let turn = DQuat::from_rotation_y((3.0 * t).sin()) * DQuat::from_rotation_x(0.5 * (5.0 * t).sin());
    Pose::new(turn, DVec3::new(0.1 * (9.0 * t).sin(), 0.0, 2.5 * t * t))
}

pub fn options() -> Options {
    Options { rest_pose: head(0.0), rest_gravity: GRAVITY, ..Options::default() }
}

/// How far `a` is from `b`: infinitely where it is nowhere.
pub fn apart(a: [f32; 3], b: [f64; 3]) -> f64 {
    let d = DVec3::from(a.map(f64::from)) - DVec3::from(b);
    if d.is_finite() { d.length() } else { f64::INFINITY }
}

/// The error of a strand is that of its worst particle. This is the error of the worst strand after
/// one step and of the median strand after more, since single strands may fall to either side of a
/// threshold (a tie breaks or holds, a curl flips).
pub fn error_of_strands(offsets: &[u32], of_particle: impl Fn(usize) -> f64, steps: u32) -> f64 {
    let errors = errors_of_strands(offsets, of_particle);
    if steps == 1 { errors[errors.len() - 1] } else { errors[errors.len() / 2] }
}

/// The error of each strand's worst particle, in rising order.
pub fn errors_of_strands(offsets: &[u32], of_particle: impl Fn(usize) -> f64) -> Vec<f64> {
    let of_strand = |ends: &[u32]| (ends[0]..ends[1]).map(|p| of_particle(p as usize)).fold(0.0, f64::max);
    let mut errors: Vec<f64> = offsets.windows(2).map(of_strand).collect();
    errors.sort_by(f64::total_cmp);
    errors
}

/// Starts on the CPU that differ from another one by roundings: what differs among them says where
/// rounding decides, as on which side a strand that begins in a solid leaves it.
pub const ROUNDED_STARTS: usize = 8;

/// `positions` of which some differ by a rounding.
pub fn rounded(positions: &[[f32; 3]], seed: usize) -> Vec<[f32; 3]> {
    let hash = |p: usize| (p as u32 ^ (seed as u32).wrapping_mul(0x85eb_ca6b)).wrapping_mul(0x9e37_79b9);
    let by = |p: usize| f32::EPSILON * ((hash(p) >> 16) % 3) as f32 - f32::EPSILON;
    positions.iter().enumerate().map(|(p, x)| x.map(|x| x * (1.0 + by(p)))).collect()
}
