//! Advances two segments through a slice until they touch.

use super::Slice;
use crate::interaction::contact::{Contact, Displacements, closest};
use crate::lane::{LANES, Real};
use crate::strands::Model;
use crate::strands::vec3;
use glam::Vec3;

/// Maximum number of steps; pairs that have not touched by then only graze.
pub const STEPS: usize = 16;
/// Tolerance of the contact distance, relative to it.
pub const CLOSE: f32 = 0.02;
/// Contact distance of strands that are closer at rest, relative to their rest distance.
pub const REST_SHARE: f32 = 0.95;

/// The contact of two segments in a slice, if they touch and approach.
///
/// Conservative advancement: the vector between the nearest points of two segments separates them,
/// so at distance D they cannot touch before the time (D − d)/V, where V is the largest approach of
/// any two of their ends along that vector; if V ≤ 0 they cannot touch at all.
pub(super) fn follow<T: Real>(
    model: &Model<T>,
    displacements: &Displacements,
    slice: &Slice,
    [a, b]: [u32; 2],
) -> Option<Contact> {
    if displacements.same_strand(a, b) {
        return None;
    }
    let ([a, b], numbers) = if a < b { ([a, b], [a, b]) } else { ([b, a], [b, a]) };
    let (a, b) = (a as usize, b as usize);
    // Each step needs them, so they are read once.
    let [start_a, start_b] = [a, b].map(|p| [displacements.start(p), displacements.start(p + LANES)]);
    let [displacement_a, displacement_b] = [a, b].map(|p| [displacements.of(p), displacements.of(p + LANES)]);
    let at = |start: [Vec3; 2], displacement: [Vec3; 2], when: f32| {
        [start[0] + when * displacement[0], start[1] + when * displacement[1]]
    };
    let mut reach = slice.distance;
    let mut has_rest_distance = false;
    let mut when = slice.span[0];
    for _ in 0..STEPS {
        let (own, other) = (at(start_a, displacement_a, when), at(start_b, displacement_b, when));
        let (along, r) = closest(own, other);
        let distance = r.length();
        if distance <= reach * (1.0 + CLOSE) {
            if !has_rest_distance {
                reach = reach.min(REST_SHARE * rest_distance(model, a, b));
                has_rest_distance = true;
                if distance > reach * (1.0 + CLOSE) {
                    continue;
                }
            }
            let relative = displacement_a[0].lerp(displacement_a[1], along[0])
                - displacement_b[0].lerp(displacement_b[1], along[1]);
            let normal = direction(r, distance, own, other, relative)?;
            let approach = -normal.dot(relative);
            let gap = distance.min(reach);
            let segments = numbers;
            return (approach > slice.slip).then_some(Contact {
                segments,
                along,
                normal,
                gap,
                when,
                approach,
            });
        }
        let along = |displacements: [Vec3; 2], side: f32| {
            (side * r.dot(displacements[0])).max(side * r.dot(displacements[1]))
        };
        let closing = along(displacement_a, -1.0) + along(displacement_b, 1.0);
        when += distance * (distance - reach) / closing;
        if closing <= 0.0 || when >= slice.span[1] {
            return None;
        }
    }
    None
}

/// The direction of `r`; for segments that intersect, the direction perpendicular to both, against
/// their approach.
fn direction(r: Vec3, distance: f32, a: [Vec3; 2], b: [Vec3; 2], relative: Vec3) -> Option<Vec3> {
    const TINY: f32 = 1e-9;
    if distance > TINY {
        return Some(r / distance);
    }
    let across = (a[1] - a[0]).cross(b[1] - b[0]).try_normalize()?;
    Some(if across.dot(relative) > 0.0 { -across } else { across })
}

fn rest_distance<T: Real>(model: &Model<T>, a: usize, b: usize) -> f32 {
    let point = |p: usize| vec3(&model.rest, p / LANES, p % LANES);
    let segment = |p: usize| [point(p), point(p + LANES)];
    closest(segment(a), segment(b)).1.length()
}
