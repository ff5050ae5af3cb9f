//! Where the built-in head has eyes, brows, lips and redder skin, for pictures. Lengths in this
//! file are in centimetres.

use glam::{Vec2, Vec3, vec3};

use super::implicit::{EYE, EYEBALL, MOUTH, lid_edges};
use super::region;

/// Radius of the iris, and half the width of its dark rim.
const IRIS: f32 = 0.6;
const IRIS_RIM: f32 = 0.06;
const PUPIL: f32 = 0.2;
/// How far apart the hairs of a brow are.
const BROW_HAIRS: f32 = 0.11;
/// Half the width of the mouth, and the heights of the lips in its middle.
const MOUTH_HALF: f32 = 2.35;
const LIP_HEIGHTS: [f32; 2] = [0.72, 0.85];

/// What a point of the built-in head's surface shows: shares from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Features {
    /// Eyeball.
    pub eye: f32,
    /// Iris, as a part of the eyeball.
    pub iris: f32,
    /// Pupil and the dark rim of the iris, as a part of the eyeball.
    pub pupil: f32,
    /// The shadow of the upper lid on the eyeball.
    pub lid_shadow: f32,
    /// Lashes: the edge of the upper lid.
    pub lashes: f32,
    /// Eyebrow.
    pub brow: f32,
    /// Lips.
    pub lips: f32,
    /// Skin through which blood shows: cheeks, nose, ears.
    pub flush: f32,
}

/// The features at `point` of the surface, metres.
pub fn features(point: Vec3) -> Features {
    let p = point * 100.0;
    let m = vec3(p.x.abs(), p.y, p.z);
    let mut found = Features { flush: flush(m), ..Features::default() };
    if m.z > 3.0 {
        found.brow = brow(m);
        found.lips = lips(m);
        eye(m, &mut found);
    }
    found
}

fn eye(m: Vec3, found: &mut Features) {
    let q = m - EYE;
    let distance = q.length();
    let ball = fall(distance, EYEBALL + 0.03, EYEBALL + 0.12);
    found.eye = ball;
    // Both look straight ahead.
    let off_axis = Vec2::new(q.x, q.y).length();
    found.iris = fall(off_axis, IRIS - 0.03, IRIS + 0.03);
    let rim = fall((off_axis - IRIS).abs(), 0.0, IRIS_RIM) * 0.6;
    found.pupil = fall(off_axis, PUPIL - 0.03, PUPIL + 0.03).max(rim);
    let [upper, lower] = lid_edges(q);
    found.lid_shadow = ball * rise(upper, -0.4, 0.05);
    let near = fall(distance, EYEBALL + 0.5, EYEBALL + 0.7) * (1.0 - ball) * fall(q.x.abs(), 1.45, 1.7);
    found.lashes = near * fall((upper - 0.02).abs(), 0.05, 0.16).max(0.35 * fall(lower.abs(), 0.02, 0.1));
}

/// A brow: highest at two thirds of its length, with hairs that lean outwards.
fn brow(m: Vec3) -> f32 {
    let along = (m.x - 1.15) / 4.3;
    if !(-0.1..1.1).contains(&along) {
        return 0.0;
    }
    let middle = 1.3 + 0.95 * along * (1.42 - along);
    let half = 0.36 * (1.0 - along.max(0.0).powi(2)) + 0.05;
    let up = m.y - middle;
    let across = up / half;
    let ends = rise(along, -0.03, 0.12) * fall(along, 0.85, 1.02);
    let turns = std::f32::consts::TAU / BROW_HAIRS * (m.x - 0.8 * up + 0.9 * up * up);
    let uneven = (0.37 * turns).sin() + (0.61 * turns + 9.0 * up).sin();
    let gaps = 0.8 + 0.2 * (turns + 1.3 * uneven).sin();
    ends * fall(across.abs(), 0.45, 1.15) * gaps
}

fn lips(m: Vec3) -> f32 {
    let along = (m.x / MOUTH_HALF).min(1.0);
    let round = 1.0 - along * along;
    // The upper lip is lowest in its middle.
    let bow = 1.0 - 0.22 * fall(m.x, 0.0, 0.55);
    let [upper, lower] = [MOUTH + LIP_HEIGHTS[0] * bow * round.powf(0.8), MOUTH - LIP_HEIGHTS[1] * round];
    let sides = fall(m.x, MOUTH_HALF - 0.15, MOUTH_HALF + 0.1) * rise(m.z, 6.0, 7.0);
    sides * rise(m.y, lower - 0.06, lower + 0.12) * fall(m.y, upper - 0.1, upper + 0.06)
}

fn flush(m: Vec3) -> f32 {
    let spot = |centre: Vec3, radius: f32| fall((m - centre).length(), 0.0, radius);
    let ear = rise(m.x, 6.9, 7.8) * fall((m.y + 1.5).abs(), 3.0, 4.0);
    let cheek = spot(vec3(4.4, -3.6, 6.2), 3.4);
    let nose = spot(vec3(0.0, -3.9, 10.9), 2.0);
    (0.8 * cheek).max(0.7 * nose).max(0.8 * ear)
}

/// A smooth step: 0 below `low`, 1 above `high`.
fn rise(x: f32, low: f32, high: f32) -> f32 {
    region::rise(x - low, high - low)
}

/// A smooth step: 1 below `low`, 0 above `high`.
fn fall(x: f32, low: f32, high: f32) -> f32 {
    1.0 - rise(x, low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Head;

    #[test]
    fn every_feature_is_on_the_surface_and_of_its_size() {
        let mesh = &Head::builtin().mesh;
        let mut areas = [0.0_f32; 5];
        for triangle in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(triangle);
            let area = 0.5 * (b - a).cross(c - a).length() * 1e4;
            let at = features((a + b + c) / 3.0);
            let shares = [at.eye, at.brow, at.lips, at.flush, at.lashes];
            assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)), "{at:?}");
            areas.iter_mut().zip(shares).for_each(|(sum, share)| *sum += area * share);
        }
        // Square centimetres, of both sides.
        let [eyes, brows, lips, flush, lashes] = areas;
        assert!((2.0..7.0).contains(&eyes), "{eyes}");
        assert!((2.0..8.0).contains(&brows), "{brows}");
        assert!((5.0..14.0).contains(&lips), "{lips}");
        assert!((20.0..120.0).contains(&flush), "{flush}");
        assert!((0.3..3.0).contains(&lashes), "{lashes}");
    }

    #[test]
    fn features_are_where_a_face_has_them() {
        let nose = features(vec3(0.0, -0.038, 0.113));
        assert!(nose.flush > 0.3 && nose.eye + nose.brow + nose.lips == 0.0, "{nose:?}");
        let crown = features(vec3(0.0, 0.115, -0.016));
        assert_eq!(crown, Features { iris: crown.iris, pupil: crown.pupil, ..Features::default() });
        let pupil = features((EYE + Vec3::Z * EYEBALL) * 0.01);
        assert!(pupil.eye == 1.0 && pupil.iris == 1.0 && pupil.pupil == 1.0, "{pupil:?}");
    }
}
