//! What lets strands sleep and what wakes them: stillness of the head, the air and the strands,
//! friction that brings strands to rest, and the reach of colliders that move.
//!
//! # Limitations
//! An acceleration in addition to gravity keeps strands awake, even a constant one: see
//! [`Acceleration`]. Friction does not act on the rotations of rods. It holds a strand that jumps
//! by the same distance in every frame later if frames are shorter, since a dt² is smaller then.

use super::acceleration::Acceleration;
use super::input::FrameInput;
use crate::body::{ColliderFrame, Shape};
use crate::collide::resolve_solids::reduce_clearance;
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

    /// Whether something that moves in `moving` comes into the ball around the hair of `model`.
    pub fn is_disturbed<T>(&self, model: &Model<T>, moving: &[Reach]) -> bool {
        let hair = Reach::ball(self.head.transform_point(model.centre.into()), model.bound);
        moving.iter().any(|reach| reach.meets(&hair))
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

/// The speed of a strand is that of the mean of its particles, or this share of the speed of its
/// fastest particle, whichever is greater.
pub const FASTEST_SHARE: f64 = 0.125;
/// Seconds after which friction sets in where the surroundings are still.
pub const CALM_SECS: f64 = 6.0;
/// Growth of dry friction with the time for which the surroundings have been still, over the sleep
/// speed, s⁻²: after six seconds 0.12 m/s² at the default sleep speed of 2 mm/s.
pub const FRICTION_GROWTH: f64 = 10.0;
/// The share of its motion below which friction leaves a strand alone.
pub const LEAST_FRICTION: f64 = 0.01;

/// Rest in still surroundings: when strands are still, and the friction that brings them to rest.
///
/// # Theory
/// Where ties pull a strand along a solid, collisions can keep a particle in a cycle of a fraction
/// of a millimetre, or let the strand creep by millimetres a second for a minute. Real hair is
/// brought to rest by dry friction between strands and at the skin, which grows with the time of
/// contact. Here, once head, air and colliders have been still for t ≥ [`CALM_SECS`], friction
/// decelerates each strand by up to a = [`FRICTION_GROWTH`] × t × the sleep speed. With u the speed
/// of the strand, averaged over a frame of dt, and v the velocity of a particle's motion:
///
/// ```text
/// u = max(|mean Δx|, s max|Δx|) / dt      s = FASTEST_SHARE
/// v ← (1 − a dt/u) v                      u > a dt
/// v ← 0, x ← x at the frame's start       u ≤ a dt
/// ```
///
/// Since u is a mean, a cycle of single particles counts little. A strand that friction stops at
/// the time t is at most a/ω² from where it would have come to rest, with ω the frequency of its
/// softest mode: under AMS by default 0.2 mm for each second of t.
///
/// A strand is still if none of its particles is faster than the sleep speed, or if friction holds
/// it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stillness<T> {
    /// The square of the distance up to which particles of a strand that is still move in a frame,
    /// m².
    still_squared: T,
    /// The distance a dt² up to which strands are held, metres; 0: there is no friction.
    held: T,
    dt_secs: T,
    inverse_h: T,
    longest_secs: T,
}

/// The rows of a block that friction changes.
#[derive(Debug)]
pub(crate) struct RestRows<'a, T> {
    pub positions: &'a mut [Row<T>],
    pub velocities: &'a mut [Row<T>],
    /// Positions a substep before; empty: velocities are those of motion alone.
    pub previous: &'a mut [Row<T>],
    pub clearance: &'a mut [Row<T>],
}

/// The distance a dt² up to which friction holds strands in a frame of `dt_secs`, metres, where the
/// surroundings have been still for `calm_secs`.
pub fn held_distance(sleep_speed: f64, calm_secs: f64, dt_secs: f64) -> f64 {
    let a = if calm_secs < CALM_SECS { 0.0 } else { FRICTION_GROWTH * calm_secs * sleep_speed };
    a * dt_secs * dt_secs
}

impl<T: Real> Stillness<T> {
    /// At a sleep speed of `speed`, where the surroundings have been still for `calm_secs`, in a
    /// frame of `dt_secs` with substeps of `h` seconds.
    pub fn new([speed, calm_secs]: [f64; 2], dt_secs: f64, h: f64) -> Self {
        Self {
            still_squared: number((speed * dt_secs).powi(2)),
            held: number(held_distance(speed, calm_secs, dt_secs)),
            dt_secs: number(dt_secs),
            inverse_h: number(1.0 / h),
            longest_secs: number(SLEEP_SECS),
        }
    }

    /// Slows down the strands of a block, whose particles moved from `start` in a frame, by
    /// friction, and advances the times for which they have been still.
    pub fn advance(&self, still_secs: &mut Row<T>, start: &[Row<T>], rows: &mut RestRows<'_, T>) {
        let farthest = farthest_squared(start, rows.positions);
        let mut kept = [T::one(); LANES];
        if self.held > T::zero() {
            for (kept, moved) in kept.iter_mut().zip(moved_squared(start, rows.positions, &farthest)) {
                let share = self.held / moved.sqrt();
                if moved > T::zero() && share > number(LEAST_FRICTION) {
                    *kept = (T::one() - share).max(T::zero());
                }
            }
        }
        for (secs, (farthest, kept)) in still_secs.0.iter_mut().zip(farthest.into_iter().zip(kept)) {
            let is_still = farthest <= self.still_squared || kept == T::zero();
            *secs = if is_still { (*secs + self.dt_secs).min(self.longest_secs) } else { T::zero() };
        }
        if kept.iter().any(|kept| *kept < T::one()) {
            self.slow_down(&kept, start, rows);
        }
    }

    /// Leaves the share `kept` of the motion of each lane; where that is zero, positions return to
    /// `start`.
    fn slow_down(&self, kept: &[T; LANES], start: &[Row<T>], rows: &mut RestRows<'_, T>) {
        let RestRows { positions, velocities, previous, clearance } = rows;
        let has_load = !previous.is_empty();
        for (i, clearance) in clearance.iter_mut().enumerate() {
            for (k, &kept) in kept.iter().enumerate().filter(|(_, kept)| **kept < T::one()) {
                let mut back = T::zero();
                for row in 3 * i..3 * i + 3 {
                    let (x, v) = (positions[row].0[k], velocities[row].0[k]);
                    let step = if has_load { x - previous[row].0[k] } else { T::zero() };
                    let motion = if has_load { step * self.inverse_h } else { v };
                    velocities[row].0[k] = v - (T::one() - kept) * motion;
                    if kept == T::zero() {
                        let from = start[row].0[k];
                        back = back + (x - from) * (x - from);
                        positions[row].0[k] = from;
                    }
                    if has_load {
                        previous[row].0[k] = positions[row].0[k] - kept * step;
                    }
                }
                reduce_clearance(&mut clearance.0[k], back.sqrt());
            }
        }
    }
}

/// The square of the distance that each strand moved from the vectors of `a` to those of `b`, three
/// rows each: see [`Stillness`]. `farthest` is [`farthest_squared`] of them.
fn moved_squared<T: Real>(a: &[Row<T>], b: &[Row<T>], farthest: &[T; LANES]) -> [T; LANES] {
    let mut moved = farthest.map(|squared| number::<T>(FASTEST_SHARE.powi(2)) * squared);
    let mut sums = [[T::zero(); LANES]; 3];
    for (a, b) in a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0) {
        for (c, sum) in sums.iter_mut().enumerate() {
            for (k, sum) in sum.iter_mut().enumerate() {
                *sum = *sum + (b[c].0[k] - a[c].0[k]);
            }
        }
    }
    let inverse_count = number::<T>(3.0 / a.len() as f64);
    for (k, moved) in moved.iter_mut().enumerate() {
        let mean = sums.map(|sum| sum[k] * inverse_count);
        let squared = mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2];
        // What is not finite counts as far.
        *moved = if squared <= *moved { *moved } else { squared };
    }
    moved
}

/// The square of the largest distance between the vectors of `a` and `b`, three rows each, a lane.
pub(crate) fn farthest_squared<T: Real>(a: &[Row<T>], b: &[Row<T>]) -> [T; LANES] {
    let mut farthest = [T::zero(); LANES];
    for (a, b) in a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0) {
        for (k, farthest) in farthest.iter_mut().enumerate() {
            let d = [0, 1, 2].map(|c| b[c].0[k] - a[c].0[k]);
            let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            // What is not finite counts as far.
            *farthest = if squared > *farthest || squared.is_nan() { squared } else { *farthest };
        }
    }
    farthest
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1.0 / 60.0;
    const SPEED: f64 = 2e-3;

    /// The rows of a block, and its positions at the frame's start.
    #[derive(Clone, PartialEq)]
    struct Moved {
        start: Vec<Row<f64>>,
        positions: Vec<Row<f64>>,
        velocities: Vec<Row<f64>>,
        previous: Vec<Row<f64>>,
        clearance: Vec<Row<f64>>,
    }

    impl Moved {
        /// Four particles a strand. In lane 0 all moved by 10 µm, in lane 1 one by 0.1 mm, in lane
        /// 2 all by 1 mm, in a frame of one substep; velocities are those of the motion and `load`.
        fn new(load: f64) -> Self {
            let rows = |value: f64| vec![Row([value; LANES]); 12];
            let [start, mut positions, mut velocities] = [rows(0.5), rows(0.5), rows(load)];
            for particle in 0..4 {
                let by = [1e-5, if particle == 2 { 1e-4 } else { 0.0 }, 1e-3];
                for (lane, by) in by.into_iter().enumerate() {
                    positions[3 * particle].0[lane] += by;
                    velocities[3 * particle].0[lane] += by / DT;
                }
            }
            let previous = if load == 0.0 { Vec::new() } else { start.clone() };
            Self { start, positions, velocities, previous, clearance: vec![Row([3e-5; LANES]); 4] }
        }

        /// The frame's end after `calm_secs`: for how long the strands have been still.
        fn advance(&mut self, calm_secs: f64) -> Row<f64> {
            let Self { start, positions, velocities, previous, clearance } = self;
            let mut still_secs = Row([0.0; LANES]);
            let mut rows = RestRows { positions, velocities, previous, clearance };
            Stillness::new([SPEED, calm_secs], DT, DT).advance(&mut still_secs, start, &mut rows);
            still_secs
        }
    }

    #[test]
    fn friction_holds_what_hardly_moves_and_slows_down_the_rest() {
        for load in [0.0, 7.0] {
            for calm_secs in [0.0, 5.9, 6.0, 12.0] {
                let before = Moved::new(load);
                let mut own = before.clone();
                let still_secs = own.advance(calm_secs);
                let is_calm = calm_secs >= CALM_SECS;
                let held = if is_calm { DT } else { 0.0 };
                assert_eq!(still_secs.0[..3], [DT, held, 0.0], "{calm_secs}");
                if !is_calm {
                    assert!(own == before, "{calm_secs}");
                    continue;
                }
                let Moved { positions, velocities, previous, clearance, .. } = own;
                for row in 0..12 {
                    assert_eq!(positions[row].0[..2], [0.5; 2]);
                    assert!(velocities[row].0[..2].iter().all(|v| (v - load).abs() < 1e-12));
                    assert_eq!(positions[row].0[2], before.positions[row].0[2]);
                    let kept = 1.0 - 10.0 * calm_secs * SPEED * DT * DT / 1e-3;
                    let expected = load + kept * (before.velocities[row].0[2] - load);
                    assert!((velocities[row].0[2] - expected).abs() < 1e-12);
                    if load != 0.0 {
                        let motion = (positions[row].0[2] - previous[row].0[2]) / DT;
                        assert_eq!(previous[row].0[..2], [0.5; 2]);
                        assert!((velocities[row].0[2] - load - motion).abs() < 1e-9);
                    }
                }
                for (particle, own) in clearance.iter().enumerate() {
                    let left = if particle == 2 { [2e-5, 0.0, 3e-5] } else { [2e-5, 3e-5, 3e-5] };
                    assert!(own.0.iter().zip(left).all(|(own, left)| (own - left).abs() < 1e-12), "{own:?}");
                }
            }
        }
    }

    /// Strands in which anything is not a number, or infinite, are left alone and never still.
    #[test]
    fn friction_leaves_what_is_not_finite_alone() {
        for wrong in [f64::NAN, f64::INFINITY] {
            let mut own = Moved::new(0.0);
            own.positions[4].0[0] = wrong;
            let before = own.velocities.clone();
            let still_secs = own.advance(60.0);
            assert_eq!(still_secs.0[0], 0.0);
            assert!(own.velocities.iter().zip(&before).all(|(now, before)| now.0[0] == before.0[0]));
        }
    }
}
