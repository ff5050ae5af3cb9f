//! Strands at a frame between two steps of a solver that does not store the step before.
//!
//! # Theory
//! As [`State::positions_between`](forelock_core::strands::State::positions_between): directions
//! and lengths of edges are interpolated relative to the head, so that roots stay on it and
//! strands do not shrink between steps.

use forelock_core::strands::{Between, Model};
use glam::{Mat3, Vec3};

/// The name under which the positions before the last step are in a copy of the state.
pub(super) const CHANNEL: &str = "shown_before";

/// Moves `now`, positions after the last step, to `moment`; `before` are those before the step.
/// All are in world space and the order of the groom of `model`, metres.
pub(super) fn interpolate(model: &Model<f32>, before: &[Vec3], moment: &Between, now: &mut [Vec3]) {
    let Between { share, heads, now: head } = moment;
    let turns = heads.map(|own| Mat3::from_quat((head.rotation * own.rotation.conjugate()).as_quat()));
    let backs = heads.map(|own| own.inverse());
    for strand in 0..model.strand_count {
        let range = model.groom_offset(strand)..model.groom_offset(strand + 1);
        let (a, b) = (&before[range.clone()], &mut now[range]);
        let [from, to] = [0, 1].map(|end: usize| backs[end].transform_point([a[0], b[0]][end].as_dvec3()));
        let root = head.transform_point(from.lerp(to, f64::from(*share)));
        let (mut x, mut last) = (Vec3::ZERO, b[0]);
        b[0] = root.as_vec3();
        for i in 1..b.len() {
            let [from, to] = [turns[0] * (a[i] - a[i - 1]), turns[1] * (b[i] - last)];
            let length = from.length() + (to.length() - from.length()) * share;
            x += from.lerp(to, *share).normalize_or_zero() * length;
            last = b[i];
            b[i] = (root + x.as_dvec3()).as_vec3();
        }
    }
}
