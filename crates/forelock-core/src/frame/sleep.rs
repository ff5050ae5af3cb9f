//! What lets strands sleep and what wakes them: stillness of the head, the air and the strands, and
//! the reach of colliders that move.
//!
//! # Limitations
//! An acceleration in addition to gravity keeps strands awake, even a constant one: see
//! [`Acceleration`].

use super::acceleration::Acceleration;
use super::input::FrameInput;
use crate::body::{ColliderFrame, Shape};
use crate::lane::{LANES, Real, Row};
use crate::pose::Pose;
use crate::strands::{Model, SLEEP_SECS, SleepPlace, number};
use glam::DVec3;

/// Motion in a frame that counts as rounding, metres.
pub const ROUNDING_M: f64 = 1e-9;
/// Distance beyond the thickness of the skin at which a moving collider is within reach, metres.
const MARGIN_M: f64 = 1e-3;
/// Largest distance of a head from where its strands have been still, metres.
pub const PLACE_M: f64 = 1e-6;

/// Largest distance between the places to which two poses take a ball about `centre` with `radius`.
fn distance(a: &Pose, b: &Pose, centre: DVec3, radius: f64) -> f64 {
    let turn = a.rotation.inverse() * b.rotation;
    let angle = 2.0 * turn.xyz().length().atan2(turn.w.abs());
    a.transform_point(centre).distance(b.transform_point(centre)) + radius * angle
}

impl FrameInput<'_> {
    /// Where the strands of `model` can be still in this frame; none if the head moves, the air
    /// moves, or there is an acceleration in addition to gravity.
    pub fn sleep_place<T>(&self, model: &Model<T>) -> Option<SleepPlace> {
        let [from, to] = self.roots.head();
        let wind = self.air.field;
        let wind_is_steady = wind.is_none_or(|wind| wind.modes.is_none());
        let air = self.air.velocity + wind.map_or(DVec3::ZERO, |wind| wind.mean);
        let is_still = air == DVec3::ZERO
            && wind_is_steady
            && matches!(self.acceleration, Acceleration::None)
            && !self.roots.bends()
            && distance(from, to, model.centre.into(), model.bound) <= ROUNDING_M;
        is_still.then_some(SleepPlace { head: *to, gravity: self.gravity })
    }
}

impl SleepPlace {
    /// Whether strands of `model` that are still here are still at `other` too.
    pub fn continues<T>(&self, other: &Self, model: &Model<T>) -> bool {
        self.gravity == other.gravity
            && distance(&self.head, &other.head, model.centre.into(), model.bound) <= PLACE_M
    }
}

/// A box in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    low: DVec3,
    high: DVec3,
}

impl Reach {
    /// Everywhere.
    const EVERYWHERE: Self = Self { low: DVec3::NEG_INFINITY, high: DVec3::INFINITY };
    /// Nowhere.
    const NOWHERE: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    /// The ball about `centre` with `radius`.
    pub fn ball(centre: DVec3, radius: f64) -> Self {
        Self { low: centre - radius, high: centre + radius }
    }

    /// The box of the first `live` lanes of `positions`, three rows a particle, relative to
    /// `origin`.
    pub(crate) fn of_rows<T: Real>(positions: &[Row<T>], live: usize, origin: DVec3) -> Self {
        let mut low = [T::infinity(); 3];
        let mut high = [T::neg_infinity(); 3];
        for rows in positions.chunks_exact(3) {
            for (c, row) in rows.iter().enumerate() {
                for &x in &row.0[..live] {
                    (low[c], high[c]) = (low[c].min(x), high[c].max(x));
                }
            }
        }
        let vector = |x: [T; 3]| origin + DVec3::from_array(x.map(|x| x.to_f64().unwrap_or(0.0)));
        Self { low: vector(low), high: vector(high) }
    }

    /// Whether the boxes overlap.
    pub fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    fn hold(&mut self, point: DVec3) {
        (self.low, self.high) = (self.low.min(point), self.high.max(point));
    }

    /// Where `solid` is in the frame, with a `margin`, if it moves or changes its shape.
    fn of_moving(solid: &ColliderFrame<'_>, margin: f64) -> Option<Self> {
        let ends = [solid.pose(0.0), solid.pose(1.0)];
        let changes = match solid.shape {
            Shape::Morph { phases: [from, to], .. } => from != to,
            Shape::Bending(field) => field.changes(),
            _ => false,
        };
        let Some((low, high)) = solid.shape.bounds() else {
            let moves = distance(&ends[0], &ends[1], DVec3::ZERO, 1.0) > ROUNDING_M;
            return (moves || changes).then_some(Self::EVERYWHERE);
        };
        let (mut reach, mut far, mut moved) = (Self::NOWHERE, 0.0f64, 0.0f64);
        for corner in 0..8 {
            let pick = |bit: i32, low: f32, high: f32| f64::from(if corner & bit == 0 { low } else { high });
            let point = DVec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z));
            let [from, to] = ends.map(|pose| pose.transform_point(point));
            moved = moved.max(from.distance(to));
            far = far.max(solid.local.transform_point(point).length());
            reach.hold(from);
            reach.hold(to);
        }
        if moved <= ROUNDING_M && !changes {
            return None;
        }
        // Points move on arcs about the carrier's origin, which leave their chords by this much.
        let turn = solid.from.rotation.inverse() * solid.to.rotation;
        let half_angle = turn.xyz().length().atan2(turn.w.abs());
        let grown = margin + far * (1.0 - half_angle.cos());
        Some(Self { low: reach.low - grown, high: reach.high + grown })
    }

    /// Writes to `out` where the colliders of `frame` are that move or change their shape, as far
    /// as they reach beyond a skin of `skin_thickness` metres.
    pub fn moving(frame: &FrameInput<'_>, skin_thickness: f64, out: &mut Vec<Self>) {
        out.clear();
        let margin = skin_thickness + MARGIN_M;
        out.extend(frame.colliders.iter().filter_map(|solid| Self::of_moving(solid, margin)));
    }
}

/// The colliders at the end of the frame before, to notice that others are there.
#[derive(Clone, Debug, Default)]
pub struct LastSolids {
    /// Where they were, and their friction.
    solids: Vec<(Pose, f64)>,
    is_known: bool,
}

impl LastSolids {
    /// Forgets them: the colliders of the next frame are taken as they are.
    pub fn forget(&mut self) {
        self.is_known = false;
    }

    /// Whether the colliders of `frame` begin where those of the frame before ended; remembers
    /// those of `frame`.
    pub fn continue_in(&mut self, frame: &FrameInput<'_>) -> bool {
        let same = |((pose, friction), solid): (&(Pose, f64), &ColliderFrame<'_>)| {
            *friction == solid.friction && distance(pose, &solid.pose(0.0), DVec3::ZERO, 1.0) <= ROUNDING_M
        };
        let continue_here =
            self.solids.len() == frame.colliders.len() && self.solids.iter().zip(frame.colliders).all(same);
        let are_same = !self.is_known || continue_here;
        self.solids.clear();
        self.solids.extend(frame.colliders.iter().map(|solid| (solid.pose(1.0), solid.friction)));
        self.is_known = true;
        are_same
    }
}

/// How far strands may move in a frame in which they are still.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stillness<T> {
    /// The square of that distance, m².
    farthest_squared: T,
    dt_secs: T,
    longest_secs: T,
}

impl<T: Real> Stillness<T> {
    /// At `speed` in a frame of `dt_secs`.
    pub fn new(speed: f64, dt_secs: f64) -> Self {
        Self {
            farthest_squared: number((speed * dt_secs).powi(2)),
            dt_secs: number(dt_secs),
            longest_secs: number(SLEEP_SECS),
        }
    }

    /// Advances the times for which the strands of a block have been still, by a frame in which its
    /// particles moved from `start` to `positions`.
    pub fn advance(&self, still_secs: &mut Row<T>, start: &[Row<T>], positions: &[Row<T>]) {
        let farthest = farthest_squared(start, positions);
        for (secs, farthest) in still_secs.0.iter_mut().zip(farthest) {
            let is_still = farthest <= self.farthest_squared;
            *secs = if is_still { (*secs + self.dt_secs).min(self.longest_secs) } else { T::zero() };
        }
    }
}

/// The square of the largest distance between the vectors of `a` and `b`, three rows each, a lane.
pub(crate) fn farthest_squared<T: Real>(a: &[Row<T>], b: &[Row<T>]) -> [T; LANES] {
    let mut farthest = [T::zero(); LANES];
    for (a, b) in a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0) {
        for (k, farthest) in farthest.iter_mut().enumerate() {
            let d = [0, 1, 2].map(|c| b[c].0[k] - a[c].0[k]);
            let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            // What is not finite counts as far.
            *farthest = if squared <= *farthest { *farthest } else { squared };
        }
    }
    farthest
}
