//! Follows two segments through a slice until they touch.

use super::Slice;
use crate::interaction::contact::{Contact, Ways, closest};
use crate::lane::{LANES, Real};
use crate::strands::Model;
use crate::strands::vec3;
use glam::Vec3;

/// Steps at most; a pair that still has not met only brushes by.
pub const STEPS: usize = 16;
/// How near the contact distance counts as there, over it.
pub const CLOSE: f32 = 0.02;
/// How near strands may come that are nearer than the contact distance at rest, over their distance there.
pub const REST_SHARE: f32 = 0.95;

/// The contact of two segments in a slice, if they touch and approach.
///
/// Conservative advancement: the vector between the nearest points of two segments separates them, so at distance D nothing can happen before the time
/// (D − d)/V, where V is what any two of their ends approach along that vector; and nothing at all if they do not.
pub(super) fn follow<T: Real>(
    model: &Model<T>,
    ways: &Ways,
    slice: &Slice,
    [a, b]: [u32; 2],
) -> Option<Contact> {
    if ways.same_strand(a, b) {
        return None;
    }
    let ([a, b], numbers) = if a < b { ([a, b], [a, b]) } else { ([b, a], [b, a]) };
    let (a, b) = (a as usize, b as usize);
    let (way_a, way_b) = ([ways.way(a), ways.way(a + LANES)], [ways.way(b), ways.way(b + LANES)]);
    let mut reach = slice.distance;
    let mut knows_rest = false;
    let mut when = slice.span[0];
    for _ in 0..STEPS {
        let segment = |p: usize| [ways.at(p, when), ways.at(p + LANES, when)];
        let (along, r) = closest(segment(a), segment(b));
        let distance = r.length();
        if distance <= reach * (1.0 + CLOSE) {
            if !knows_rest {
                reach = reach.min(REST_SHARE * rest_distance(model, a, b));
                knows_rest = true;
                if distance > reach * (1.0 + CLOSE) {
                    continue;
                }
            }
            let relative = way_a[0].lerp(way_a[1], along[0]) - way_b[0].lerp(way_b[1], along[1]);
            let normal = direction(r, distance, (segment(a), segment(b)), relative)?;
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
        let along = |ways: [Vec3; 2], side: f32| (side * r.dot(ways[0])).max(side * r.dot(ways[1]));
        let closing = along(way_a, -1.0) + along(way_b, 1.0);
        when += distance * (distance - reach) / closing;
        if closing <= 0.0 || when >= slice.span[1] {
            return None;
        }
    }
    None
}

/// The unit vector of `r`; of segments that cross, the one across both against which they approach.
fn direction(r: Vec3, distance: f32, (a, b): ([Vec3; 2], [Vec3; 2]), relative: Vec3) -> Option<Vec3> {
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
