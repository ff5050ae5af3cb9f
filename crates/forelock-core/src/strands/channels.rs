//! Channels: state of particles that only their solver understands, stored beside positions and
//! velocities.
//!
//! # Practice
//! A solver asks for channels with [`Channels::extra`](crate::frame::Channels::extra), and reads
//! and writes them in [`BlockView::extra`](super::BlockView::extra). Snapshots, teleports, edits of
//! the groom and the reset of strands treat them as their [`ChannelKind`] says.
//!
//! A channel starts in the first frame that solves strands after the solver has asked for it: then
//! all its values become the initial one, rotated with the head. Before that it has no values.

use super::{Model, SnapshotError, State, number};
use crate::lane::{LANES, Real, Row};
use glam::{DQuat, DVec3, DVec4};
use std::collections::BTreeMap;

/// State of particles that a solver asks for in addition to positions and velocities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    /// The name in snapshots; different from those of the solver's other channels.
    pub name: &'static str,
    /// What the values are.
    pub kind: ChannelKind,
    /// Values per particle, 1 or more.
    pub values: usize,
}

impl Channel {
    /// Rows per particle.
    pub const fn rows(&self) -> usize {
        self.values * self.kind.rows()
    }

    /// The rows of a particle at the initial value, with the head rotated by `head`.
    pub fn initial_rows(&self, head: DQuat) -> impl Iterator<Item = f64> {
        let (initial, rows) = (self.kind.initial(head).to_array(), self.kind.rows());
        (0..self.rows()).map(move |row| initial[row % rows])
    }

    /// For each row of a particle, which component of a value it is.
    pub fn components(&self) -> impl Iterator<Item = usize> {
        let rows = self.kind.rows();
        (0..self.rows()).map(move |row| row % rows)
    }

    /// Whether values of `other` are values of this channel.
    fn continues(&self, other: &Self) -> bool {
        let same_kind = std::mem::discriminant(&self.kind) == std::mem::discriminant(&other.kind);
        same_kind && self.name == other.name && self.values == other.values
    }

    /// Writes to `out` the rows of a particle between two with the rows `before` and `after`, at
    /// fraction `t` of the way. Rotations take the shorter way.
    pub(crate) fn interpolate(&self, [before, after]: [&[f32]; 2], t: f64, out: &mut [f32]) {
        // Exact at both ends.
        if t == 0.0 || t == 1.0 {
            out.copy_from_slice(if t == 0.0 { before } else { after });
            return;
        }
        let rows = self.kind.rows();
        let ends = before.chunks_exact(rows).zip(after.chunks_exact(rows));
        for ((a, b), out) in ends.zip(out.chunks_exact_mut(rows)) {
            let [a, b] = [padded(a), padded(b)];
            let value = match self.kind {
                ChannelKind::Rotation(_) => DQuat::from_vec4(a).lerp(DQuat::from_vec4(b), t).into(),
                ChannelKind::Scalar(_) | ChannelKind::Vector(_) => a.lerp(b, t),
            };
            for (row, x) in out.iter_mut().zip(value.to_array()) {
                *row = number(x);
            }
        }
    }
}

/// What the values of a [`Channel`] are, and their initial value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChannelKind {
    /// Numbers, one row each. A teleport does not change them.
    Scalar(f64),
    /// Vectors in world axes, three rows each. The initial value is in the axes of the head at
    /// rest. A teleport rotates them.
    Vector(DVec3),
    /// Rotations from some material axes to world axes: unit quaternions x, y, z, w, four rows
    /// each. The initial value maps to the axes of the head at rest. A teleport rotates them.
    Rotation(DQuat),
}

impl ChannelKind {
    /// Rows per value.
    pub const fn rows(self) -> usize {
        match self {
            Self::Scalar(_) => 1,
            Self::Vector(_) => 3,
            Self::Rotation(_) => 4,
        }
    }

    /// The initial value with the head rotated by `head`, padded with zeros.
    fn initial(self, head: DQuat) -> DVec4 {
        match self {
            Self::Scalar(x) => DVec4::new(x, 0.0, 0.0, 0.0),
            Self::Vector(v) => (head * v).extend(0.0),
            Self::Rotation(q) => (head * q).into(),
        }
    }

    /// `value` after a rotation of the world.
    fn rotated(self, value: DVec4, by: DQuat) -> DVec4 {
        match self {
            Self::Scalar(_) => value,
            Self::Vector(_) => (by * value.truncate()).extend(0.0),
            Self::Rotation(_) => (by * DQuat::from_vec4(value)).into(),
        }
    }
}

/// Up to four numbers as a vector, padded with zeros.
fn padded(numbers: &[f32]) -> DVec4 {
    let mut padded = DVec4::ZERO;
    for (c, x) in numbers.iter().enumerate() {
        padded[c] = f64::from(*x);
    }
    padded
}

/// A channel of a [`ChannelStore`].
#[derive(Clone, Copy, Debug)]
struct Stored {
    channel: Channel,
    /// Rows of a particle before those of this channel.
    first: usize,
    /// Whether it has values.
    started: bool,
}

impl Stored {
    /// Its rows among those of a particle.
    fn range(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.channel.rows()
    }

    /// Sets its values among the rows of a particle to the initial one.
    fn reset<T: Real>(&self, particle: &mut [Row<T>], lane: usize, head: DQuat) {
        for (row, x) in particle[self.range()].iter_mut().zip(self.channel.initial_rows(head)) {
            row.0[lane] = number(x);
        }
    }
}

/// Rows of all channels per particle.
fn stride(stored: &[Stored]) -> usize {
    stored.last().map_or(0, |last| last.range().end)
}

/// The channels of a [`State`], packed: the rows of all channels of a particle, then those of the
/// next particle.
#[derive(Clone, Debug)]
pub struct ChannelStore<T> {
    stored: Vec<Stored>,
    rows: Vec<Row<T>>,
}

impl<T: Real> ChannelStore<T> {
    /// No channels.
    pub(super) fn empty() -> Self {
        Self { stored: Vec::new(), rows: Vec::new() }
    }

    /// The channels.
    pub fn channels(&self) -> impl Iterator<Item = &Channel> {
        self.stored.iter().map(|own| &own.channel)
    }

    /// All rows, those of one particle after those of another; a channel that has not started has
    /// none of meaning.
    pub fn rows(&self) -> &[Row<T>] {
        &self.rows
    }

    /// [`ChannelStore::rows`], to be changed.
    pub fn rows_mut(&mut self) -> &mut [Row<T>] {
        &mut self.rows
    }

    /// Whether each channel has values.
    pub fn started(&self) -> impl Iterator<Item = bool> {
        self.stored.iter().map(|own| own.started)
    }

    /// Sets whether each channel has values, after its rows were written.
    pub fn set_started(&mut self, started: impl IntoIterator<Item = bool>) {
        self.stored.iter_mut().zip(started).for_each(|(own, started)| own.started = started);
    }

    /// Makes room for `channels` of `places` particles. Values of a channel of the same name, kind
    /// and number of values are kept, the others start anew; channels that are not asked for are
    /// dropped.
    pub(crate) fn prepare(&mut self, channels: &[Channel], places: usize) {
        if self.channels().eq(channels) && self.rows.len() == stride(&self.stored) * places {
            return;
        }
        let old = std::mem::replace(self, Self::empty());
        let old_stride = stride(&old.stored);
        let fits = old.rows.len() == old_stride * places;
        let find = |channel: &Channel| old.stored.iter().find(|own| fits && channel.continues(&own.channel));
        for &channel in channels {
            let (first, started) = (stride(&self.stored), find(&channel).is_some_and(|own| own.started));
            self.stored.push(Stored { channel, first, started });
        }
        let stride = stride(&self.stored);
        self.rows = vec![Row([T::zero(); LANES]); stride * places];
        for own in &self.stored {
            let Some(from) = find(&own.channel) else { continue };
            let old_particles = old.rows.chunks_exact(old_stride.max(1));
            for (new, old) in self.rows.chunks_exact_mut(stride.max(1)).zip(old_particles) {
                new[own.range()].copy_from_slice(&old[from.range()]);
            }
        }
    }

    /// Sets the channels that have no values to their initial ones, where the strand that has
    /// particle `place` in `lane` is rotated by `rotation(place, lane)`.
    pub(crate) fn start(&mut self, rotation: impl Fn(usize, usize) -> DQuat) {
        let stride = stride(&self.stored);
        for own in self.stored.iter_mut().filter(|own| !own.started) {
            own.started = true;
            for (place, particle) in self.rows.chunks_exact_mut(stride.max(1)).enumerate() {
                (0..LANES).for_each(|lane| own.reset(particle, lane, rotation(place, lane)));
            }
        }
    }

    /// Rotates vectors and rotations with the world.
    pub(super) fn rotate(&mut self, by: DQuat) {
        let stride = stride(&self.stored);
        for own in &self.stored {
            let kind = own.channel.kind;
            if matches!(kind, ChannelKind::Scalar(_)) {
                continue;
            }
            for particle in self.rows.chunks_exact_mut(stride.max(1)) {
                for value in particle[own.range()].chunks_exact_mut(kind.rows()) {
                    for lane in 0..LANES {
                        let mut old = DVec4::ZERO;
                        for (c, row) in value.iter().enumerate() {
                            old[c] = row.0[lane].to_f64().unwrap_or(f64::NAN);
                        }
                        for (row, x) in value.iter_mut().zip(kind.rotated(old, by).to_array()) {
                            row.0[lane] = number(x);
                        }
                    }
                }
            }
        }
    }

    /// Copies `other` without a new allocation.
    pub(super) fn take(&mut self, other: &Self) {
        self.stored.clone_from(&other.stored);
        self.rows.clone_from(&other.rows);
    }

    /// Bytes of the rows.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.rows)
    }

    /// All particles, to be split into blocks.
    pub(crate) fn all(&mut self) -> BlockChannels<'_, T> {
        BlockChannels { stored: &self.stored, rows: &mut self.rows }
    }

    /// The values in the groom's order, by name.
    pub(super) fn snapshot(&self, model: &Model<T>) -> BTreeMap<String, Vec<T>> {
        let stride = stride(&self.stored);
        let of_channel = |own: &Stored| {
            let rows = own.channel.rows();
            let particles = if own.started { model.particle_count } else { 0 };
            let mut values = vec![T::zero(); rows * particles];
            if own.started {
                State::each_particle(model, |p, place, lane| {
                    let particle = &self.rows[stride * place..][own.range()];
                    let out = values[rows * p..][..rows].iter_mut();
                    out.zip(particle).for_each(|(x, row)| *x = row.0[lane]);
                });
            }
            (own.channel.name.to_owned(), values)
        };
        self.stored.iter().map(of_channel).collect()
    }

    /// Checks that `values` has those of all channels.
    pub(super) fn check(
        &self,
        model: &Model<T>,
        values: &BTreeMap<String, Vec<T>>,
    ) -> Result<(), SnapshotError> {
        for channel in self.channels() {
            let (array, expected) = (channel.name, channel.rows() * model.particle_count);
            let found = values.get(array).map(Vec::len);
            // No values: the channel has not started.
            if found != Some(0) && found != Some(expected) {
                return Err(SnapshotError { array, expected, found: found.unwrap_or(0) });
            }
        }
        Ok(())
    }

    /// Takes the values of all channels from `values`, which has been checked.
    pub(super) fn restore(&mut self, model: &Model<T>, values: &BTreeMap<String, Vec<T>>) {
        let stride = stride(&self.stored);
        for own in &mut self.stored {
            let values = values.get(own.channel.name).map_or(&[][..], Vec::as_slice);
            own.started = !values.is_empty();
            let rows = own.channel.rows();
            for block in model.blocks.iter().filter(|_| own.started) {
                for (lane, &strand) in block.strands.iter().enumerate() {
                    let from = model.offsets[strand as usize] as usize;
                    for (p, place) in (from..).zip(block.range()) {
                        let particle = self.rows[stride * place..][own.range()].iter_mut();
                        particle.zip(&values[rows * p..]).for_each(|(row, x)| row.0[lane] = *x);
                    }
                }
            }
        }
    }
}

/// The channels of a block of strands, in the order in which the solver asks for them.
#[derive(Debug)]
pub struct BlockChannels<'a, T> {
    stored: &'a [Stored],
    rows: &'a mut [Row<T>],
}

impl<T> Default for BlockChannels<'_, T> {
    fn default() -> Self {
        Self { stored: &[], rows: &mut [] }
    }
}

impl<'a, T> BlockChannels<'a, T> {
    /// The rows of particle `i` in channel `k`: a [`ChannelKind::Vector`] is
    /// `V3::load(rows, value, first)`, a number `L::load(&rows[row], first)`.
    #[inline(always)]
    pub fn rows(&self, k: usize, i: usize) -> &[Row<T>] {
        &self.rows[stride(self.stored) * i..][self.stored[k].range()]
    }

    /// [`BlockChannels::rows`], to be changed.
    #[inline(always)]
    pub fn rows_mut(&mut self, k: usize, i: usize) -> &mut [Row<T>] {
        &mut self.rows[stride(self.stored) * i..][self.stored[k].range()]
    }

    /// The first `places` particles and the others.
    pub(crate) fn split_at(self, places: usize) -> (Self, Self) {
        let (left, right) = self.rows.split_at_mut(stride(self.stored) * places);
        (Self { stored: self.stored, rows: left }, Self { stored: self.stored, rows: right })
    }
}

impl<T: Real> BlockChannels<'_, T> {
    /// Sets the strand in `lane` to the initial values, with the head rotated by `head`.
    pub(crate) fn reset(&mut self, lane: usize, head: DQuat) {
        for particle in self.rows.chunks_exact_mut(stride(self.stored).max(1)) {
            self.stored.iter().for_each(|own| own.reset(particle, lane, head));
        }
    }
}
