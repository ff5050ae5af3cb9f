//! The colours of a face: eyes, brows and lips of the built-in head.

use forelock_core::body::Head;
use glam::Vec3;

/// The exponents of the highlights of skin, lips and wet eyes.
pub(crate) const SKIN: f32 = 22.0;
const LIPS: f32 = 40.0;
const EYES: f32 = 350.0;

const SCLERA: Vec3 = Vec3::new(0.46, 0.43, 0.41);
const IRIS: Vec3 = Vec3::new(0.05, 0.034, 0.022);
const PUPIL: Vec3 = Vec3::new(0.006, 0.005, 0.005);
const LASHES: Vec3 = Vec3::new(0.03, 0.02, 0.016);
/// What blood does to the colour of skin: on cheeks, nose and ears, and on lips.
const FLUSH: Vec3 = Vec3::new(1.05, 0.84, 0.82);
const LIP: Vec3 = Vec3::new(0.9, 0.62, 0.61);

/// The albedo and the exponent of the highlight at `point` of the built-in head, metres, for the
/// colours of skin and brows.
pub(crate) fn paint(point: Vec3, skin: Vec3, brows: Vec3) -> (Vec3, f32) {
    let face = Head::features(point);
    let skin = skin * Vec3::ONE.lerp(FLUSH, face.flush);
    let skin = skin.lerp(skin * LIP, face.lips);
    let skin = skin.lerp(brows, 0.85 * face.brow).lerp(LASHES, 0.9 * face.lashes);
    let eye = SCLERA.lerp(IRIS, face.iris).lerp(PUPIL, face.pupil) * (1.0 - 0.6 * face.lid_shadow);
    let polish = if face.eye > 0.5 { EYES } else { SKIN + (LIPS - SKIN) * face.lips };
    (skin.lerp(eye, face.eye), polish)
}
