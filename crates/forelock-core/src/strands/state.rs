//! State: the data that each step changes, and snapshots of it.

use super::{Block, ChannelStore, Model, Sleep, SleepSnapshot};
use crate::lane::{LANES, Real, Row};
use crate::pose::Pose;
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;

/// Treatment of the hair when the head jumps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Teleport {
    /// Resets to the rest shape, at rest.
    Reset,
    /// Moves the shape with the head and stops its motion.
    #[default]
    CarryShape,
    /// Moves the shape with the head and rotates its velocities.
    CarryShapeAndVelocity,
}

/// Packed positions, velocities and further state of particles. Rows as in [`Model`].
#[derive(Clone, Debug)]
pub struct State<T> {
    /// Positions relative to `origin`, world axes, `[3 × places]` rows, metres.
    pub positions: Vec<Row<T>>,
    /// Velocities, world axes, `[3 × places]` rows, m/s.
    pub velocities: Vec<Row<T>>,
    /// Intact share of each integrity tie, 1 to 0, `[places]` rows.
    pub integrity: Vec<Row<T>>,
    /// Lower bound of the distance to the nearest solid's skin; negative: depth inside it; −∞: not
    /// queried yet. `[places]` rows, metres.
    pub clearance: Vec<Row<T>>,
    /// Positions a step before, relative to `origin`, `[3 × places]` rows, metres; empty for
    /// solvers that do not need them.
    pub previous: Vec<Row<T>>,
    /// Channels that the solver asks for.
    pub extra: ChannelStore<T>,
    /// Which strands sleep, and for how long the others have been still.
    pub sleep: Sleep<T>,
    /// The origin of positions in the world: the position of the model's centre on the head.
    pub origin: DVec3,
}

/// A state in the groom's order. A simulation resumes from it bit for bit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot<T> {
    /// Positions relative to `origin`, `[P]`, metres.
    pub positions: Vec<[T; 3]>,
    /// Velocities, `[P]`, m/s.
    pub velocities: Vec<[T; 3]>,
    /// Intact share of each integrity tie, `[P]`.
    pub integrity: Vec<T>,
    /// Clearances, `[P]`, metres.
    pub clearance: Vec<T>,
    /// Positions a step before, relative to `origin`, `[P]`, metres; empty for solvers that do not
    /// need them.
    pub previous: Vec<[T; 3]>,
    /// The origin of positions in the world.
    pub origin: [f64; 3],
    /// Values of the channels that the solver asks for, by name, `[P × rows]`; empty for a channel
    /// that has not started ([`ChannelStore`]).
    pub extra: BTreeMap<String, Vec<T>>,
    /// Which strands sleep, and for how long the others have been still; none if their
    /// surroundings are not.
    pub sleep: Option<SleepSnapshot<T>>,
}

/// A snapshot of another groom or solver.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the snapshot holds {found} entries in `{array}`, but the strands need {expected}: it belongs to another run"
)]
pub struct SnapshotError {
    /// Which array, or which channel.
    pub array: &'static str,
    /// Entries that the strands need: one per particle, or the rows of a channel.
    pub expected: usize,
    /// Entries of the array.
    pub found: usize,
}

impl<T: Real> State<T> {
    /// At rest with the head at `pose`.
    pub fn at_rest(model: &Model<T>, pose: &Pose) -> Self {
        let places = model.places();
        let mut state = Self {
            positions: model.rest.clone(),
            velocities: vec![Row([T::zero(); LANES]); 3 * places],
            integrity: vec![Row([T::one(); LANES]); places],
            clearance: vec![Row([T::neg_infinity(); LANES]); places],
            previous: Vec::new(),
            extra: ChannelStore::empty(),
            sleep: Sleep::awake(model),
            origin: pose.transform_point(model.centre.into()),
        };
        let r = pose.matrix();
        for rows in state.positions.chunks_exact_mut(3) {
            for lane in 0..LANES {
                let local = DVec3::from_array([0, 1, 2].map(|c| rows[c].0[lane].to_f64().unwrap_or(0.0)));
                for (row, x) in rows.iter_mut().zip((r * local).to_array()) {
                    row.0[lane] = number(x);
                }
            }
        }
        state
    }

    /// Copies `other` without a new allocation.
    pub fn take(&mut self, other: &Self) {
        self.positions.clone_from(&other.positions);
        self.velocities.clone_from(&other.velocities);
        self.integrity.clone_from(&other.integrity);
        self.clearance.clone_from(&other.clearance);
        self.previous.clone_from(&other.previous);
        self.extra.take(&other.extra);
        self.sleep.take(&other.sleep);
        self.origin = other.origin;
    }

    /// Positions in world space and the groom's order, `[P]`, metres: see [`world_positions`].
    pub fn world_positions(&self, model: &Model<T>, out: &mut Vec<Vec3>) {
        world_positions(model, &self.positions, self.origin, out);
    }

    /// Invalidates all clearances, because colliders have jumped, and wakes all strands.
    pub fn forget_solids(&mut self) {
        self.sleep.wake();
        for row in &mut self.clearance {
            row.0.fill(T::neg_infinity());
        }
    }

    /// Moves the hair with the head when the head jumps between frames. `jump` maps the world
    /// before to the world after. Velocities are rotated, or with [`Teleport::CarryShape`] the
    /// motion is stopped; channels are rotated in both cases. `step_secs` is the step in which hair
    /// moved from `previous` to `positions`. [`Teleport::Reset`] is not handled here.
    pub fn carry(&mut self, jump: &Pose, mode: Teleport, step_secs: f64) {
        let origin = jump.transform_point(self.origin);
        let Self { positions, previous, .. } = self;
        for rows in positions.chunks_exact_mut(3).chain(previous.chunks_exact_mut(3)) {
            turn(rows, jump);
        }
        for rows in self.velocities.chunks_exact_mut(3) {
            if mode == Teleport::CarryShape && self.previous.is_empty() {
                rows.fill(Row([T::zero(); LANES]));
            } else {
                turn(rows, jump);
            }
        }
        self.extra.rotate(jump.rotation);
        self.origin = origin;
        if mode == Teleport::CarryShape {
            // Stops the motion; the load that velocities contain stays.
            self.stop(step_secs);
        }
        self.forget_solids();
    }

    /// Starts to store the positions of the step before, with zero displacement in that step. Does
    /// nothing if they are stored already.
    pub fn remember(&mut self) {
        if self.previous.len() != self.positions.len() {
            self.previous.clone_from(&self.positions);
        }
    }

    /// Drops the positions of the step before, of `h` seconds. Velocities become the velocities of
    /// the motion in that step.
    pub(crate) fn forget(&mut self, h: f64) {
        self.change_velocities(h, |_, u| u);
        self.previous = Vec::new();
    }

    /// Subtracts the motion of the step before, of `h` seconds, from the velocities. The load that
    /// they contain stays.
    pub(crate) fn stop(&mut self, h: f64) {
        if !self.previous.is_empty() {
            self.change_velocities(h, |v, u| v - u);
            self.previous.clone_from(&self.positions);
        }
    }

    /// Stops the strands of `block` after a step of `h` seconds, where they are. The load that
    /// velocities contain stays, distances to solids are not known any more.
    pub(crate) fn stop_block(&mut self, block: &Block, h: f64) {
        let rows = 3 * block.range().start..3 * block.range().end;
        let inverse_h = number::<T>(1.0 / h);
        let (velocities, positions) = (&mut self.velocities[rows.clone()], &self.positions[rows.clone()]);
        match self.previous.get_mut(rows) {
            None => velocities.fill(Row([T::zero(); LANES])),
            Some(previous) => {
                for ((v, x), before) in velocities.iter_mut().zip(positions).zip(previous) {
                    for k in 0..LANES {
                        v.0[k] = v.0[k] - (x.0[k] - before.0[k]) * inverse_h;
                    }
                    *before = *x;
                }
            }
        }
        self.clearance[block.range()].fill(Row([T::neg_infinity(); LANES]));
    }

    /// Replaces each velocity v by `change(v, u)`, with u the velocity of the motion in the step
    /// before, of `h` seconds.
    fn change_velocities(&mut self, h: f64, change: impl Fn(T, T) -> T) {
        let inverse_h = number::<T>(1.0 / h);
        for ((v, x), y) in self.velocities.iter_mut().zip(&self.positions).zip(&self.previous) {
            for k in 0..LANES {
                v.0[k] = change(v.0[k], (x.0[k] - y.0[k]) * inverse_h);
            }
        }
    }

    /// Bytes that the state holds.
    pub fn bytes(&self) -> usize {
        let vectors = self.positions.len() + self.velocities.len() + self.previous.len();
        let rows = vectors + self.integrity.len() + self.clearance.len();
        rows * size_of::<Row<T>>() + self.extra.bytes() + self.sleep.bytes()
    }

    /// Calls `visit(particle in the groom's order, place, lane)` for every particle, block by
    /// block.
    pub fn each_particle(model: &Model<T>, mut visit: impl FnMut(usize, usize, usize)) {
        for block in &model.blocks {
            for (lane, &strand) in block.strands[..block.live].iter().enumerate() {
                let from = model.offsets[strand as usize] as usize;
                for i in 0..block.particles {
                    visit(from + i, block.first + i, lane);
                }
            }
        }
    }

    /// The state in the groom's order.
    pub fn snapshot(&self, model: &Model<T>) -> Snapshot<T> {
        let particles = model.particle_count;
        let mut snapshot = Snapshot {
            positions: vec![[T::zero(); 3]; particles],
            velocities: vec![[T::zero(); 3]; particles],
            integrity: vec![T::zero(); particles],
            clearance: vec![T::zero(); particles],
            previous: vec![[T::zero(); 3]; if self.previous.is_empty() { 0 } else { particles }],
            origin: self.origin.to_array(),
            extra: self.extra.snapshot(model),
            sleep: self.sleep.snapshot(model),
        };
        Self::each_particle(model, |p, place, lane| {
            snapshot.positions[p] = vector(&self.positions, place, lane);
            snapshot.velocities[p] = vector(&self.velocities, place, lane);
            snapshot.integrity[p] = self.integrity[place].0[lane];
            snapshot.clearance[p] = self.clearance[place].0[lane];
            if let Some(x) = snapshot.previous.get_mut(p) {
                *x = vector(&self.previous, place, lane);
            }
        });
        snapshot
    }

    /// Restores a snapshot. If the snapshot or this state has no positions of the step before, the
    /// displacement in that step is zero. Channels for which the solver does not ask are ignored.
    ///
    /// # Errors
    /// [`SnapshotError`] if it belongs to a groom of another size or lacks a channel; nothing is
    /// changed then.
    pub fn restore(&mut self, model: &Model<T>, snapshot: &Snapshot<T>) -> Result<(), SnapshotError> {
        let expected = model.particle_count;
        for (array, found) in [
            ("positions", snapshot.positions.len()),
            ("velocities", snapshot.velocities.len()),
            ("integrity", snapshot.integrity.len()),
            ("clearance", snapshot.clearance.len()),
            ("previous", if snapshot.previous.is_empty() { expected } else { snapshot.previous.len() }),
        ] {
            if found != expected {
                return Err(SnapshotError { array, expected, found });
            }
        }
        self.extra.check(model, &snapshot.extra)?;
        snapshot.sleep.as_ref().map_or(Ok(()), |sleep| sleep.check(model))?;
        self.sleep.restore(model, snapshot.sleep.as_ref());
        self.extra.restore(model, &snapshot.extra);
        self.origin = snapshot.origin.into();
        let Snapshot { positions, velocities, previous, .. } = snapshot;
        let before = if previous.is_empty() { positions } else { previous };
        for block in &model.blocks {
            for (lane, &strand) in block.strands.iter().enumerate() {
                let from = model.offsets[strand as usize] as usize;
                for (p, place) in (from..from + block.particles).zip(block.range()) {
                    for (c, ((x, v), y)) in
                        positions[p].iter().zip(&velocities[p]).zip(&before[p]).enumerate()
                    {
                        self.positions[3 * place + c].0[lane] = *x;
                        self.velocities[3 * place + c].0[lane] = *v;
                        if let Some(row) = self.previous.get_mut(3 * place + c) {
                            row.0[lane] = *y;
                        }
                    }
                    self.integrity[place].0[lane] = snapshot.integrity[p];
                    self.clearance[place].0[lane] = snapshot.clearance[p];
                }
            }
        }
        Ok(())
    }
}

impl<T: Real> Snapshot<T> {
    /// A 64-bit hash of every bit. It does not depend on the number of threads, nor on the SIMD
    /// width within one instruction set.
    pub fn hash(&self) -> u64 {
        let mut hash = 0xcbf2_9ce4_8422_2325;
        let mut take = |bytes: &[u8]| {
            for word in bytes.chunks(8) {
                let mut padded = [0; 8];
                padded[..word.len()].copy_from_slice(word);
                // A multiply–rotate round for each word, as in wyhash: every bit affects the next
                // round.
                hash =
                    (hash ^ u64::from_le_bytes(padded)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
            }
        };
        take(bytemuck::cast_slice(&self.positions));
        take(bytemuck::cast_slice(&self.velocities));
        take(bytemuck::cast_slice(&self.integrity));
        take(bytemuck::cast_slice(&self.clearance));
        take(bytemuck::cast_slice(&self.previous));
        take(bytemuck::cast_slice(&self.origin));
        for (name, values) in &self.extra {
            take(name.as_bytes());
            take(bytemuck::cast_slice(values));
        }
        if let Some(SleepSnapshot { still_secs, place, calm_secs }) = &self.sleep {
            take(bytemuck::cast_slice(still_secs));
            take(bytemuck::cast_slice(place));
            take(bytemuck::bytes_of(calm_secs));
        }
        hash ^ (hash >> 32)
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let Self { positions, velocities, integrity, clearance, previous, origin: _, extra, sleep } = self;
        let of_channel = |(name, values): (&String, &Vec<T>)| name.len() + size_of_val(&**values);
        size_of::<Self>()
            + size_of_val(&**positions)
            + size_of_val(&**velocities)
            + size_of_val(&**integrity)
            + size_of_val(&**clearance)
            + size_of_val(&**previous)
            + extra.iter().map(of_channel).sum::<usize>()
            + sleep.as_ref().map_or(0, SleepSnapshot::bytes)
    }
}

/// Packed `positions` relative to `origin` in world space and the groom's order, `[P]`, metres.
/// Particles that a solver added ([`Model::every`]) are left out.
pub fn world_positions<T: Real>(model: &Model<T>, positions: &[Row<T>], origin: DVec3, out: &mut Vec<Vec3>) {
    let every = model.every as usize;
    out.resize(model.groom_particles(), Vec3::ZERO);
    for block in &model.blocks {
        for (lane, &strand) in block.strands[..block.live].iter().enumerate() {
            let from = model.groom_offset(strand as usize);
            for (p, place) in block.range().step_by(every).enumerate() {
                let relative = vec3(positions, place, lane);
                out[from + p] = (origin + relative.as_dvec3()).as_vec3();
            }
        }
    }
}

/// Rotates the vectors in three rows.
fn turn<T: Real>(rows: &mut [Row<T>], jump: &Pose) {
    for lane in 0..LANES {
        let v = DVec3::from_array([0, 1, 2].map(|c| rows[c].0[lane].to_f64().unwrap_or(0.0)));
        for (row, x) in rows.iter_mut().zip(jump.transform_vector(v).to_array()) {
            row.0[lane] = number(x);
        }
    }
}

/// The vector of a place and lane.
pub fn vector<T: Copy>(rows: &[Row<T>], place: usize, lane: usize) -> [T; 3] {
    [0, 1, 2].map(|c| rows[3 * place + c].0[lane])
}

/// [`vector`] in single precision; 0 for numbers that it cannot represent.
#[inline]
pub(crate) fn vec3<T: Real>(rows: &[Row<T>], place: usize, lane: usize) -> Vec3 {
    Vec3::from_array(vector(rows, place, lane).map(|x| x.to_f32().unwrap_or(0.0)))
}

/// `x` in the state's precision.
pub fn number<T: Real>(x: f64) -> T {
    T::from(x).unwrap_or_else(T::nan)
}
