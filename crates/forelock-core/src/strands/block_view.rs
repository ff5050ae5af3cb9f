//! A stage's view of a block of strands, and the scratch memory of a thread.

use super::BlockChannels;
use crate::lane::{Lane, Real, Row, V3};

/// The arrays of one block. Rows as in [`Model`](super::Model), for this block only.
#[derive(Debug)]
pub struct BlockView<'a, T> {
    /// Particles per strand.
    pub particles: usize,
    /// Rest positions about the model's centre, head frame.
    pub rest: &'a [Row<T>],
    /// Motion of each strand relative to the head, at the frame's start and end; empty: none.
    pub root_frames: &'a [Row<T>],
    /// Rest lengths to the next three particles.
    pub rest_lengths: &'a [Row<T>],
    /// One over the rest length to the next particle.
    pub inverse_edges: &'a [Row<T>],
    /// Strand length.
    pub strand_length: &'a Row<T>,
    /// Relative stiffness of the strand.
    pub stiffness: &'a Row<T>,
    /// Relative mass of each particle; empty: 1 everywhere. See [`BlockView::mass`].
    pub masses: &'a [Row<T>],
    /// The smallest relative mass of a particle of the model.
    pub least_mass: f64,
    /// Acceleration of each particle in addition to gravity, three rows per particle; empty: none.
    /// The driver has added it to velocities before the solver's own stage.
    pub acceleration: &'a [Row<T>],
    /// Rest edges in the frames of the particles before them, three rows per particle; empty if no
    /// stage needs them.
    pub local: &'a [Row<T>],
    /// Positions relative to the frame's origin, world axes.
    pub positions: &'a mut [Row<T>],
    /// Positions a step before; empty if no stage needs them.
    pub previous: &'a mut [Row<T>],
    /// Velocities, world axes.
    pub velocities: &'a mut [Row<T>],
    /// Intact share s of each integrity tie.
    pub integrity: &'a mut [Row<T>],
    /// Lower bound on the distance to the nearest solid; negative: depth inside it; −∞: unknown.
    pub clearance: &'a mut [Row<T>],
    /// The channels that the solver asks for ([`Channels::extra`]).
    ///
    /// [`Channels::extra`]: crate::frame::Channels::extra
    pub extra: BlockChannels<'a, T>,
    /// Share of the wind that reaches each particle, a row a particle; empty: 1 everywhere.
    pub exposure: &'a [Row<T>],
    /// Velocity of the wind at each particle in this frame, three rows per particle; empty without
    /// a wind field.
    pub wind: &'a mut [Row<T>],
    /// The velocity towards which drag accelerates each particle in this substep, three rows a
    /// particle; empty: that of the air.
    pub air: &'a mut [Row<T>],
    /// h c of each particle in this substep, a row a particle; empty: the same for all.
    pub drag: &'a mut [Row<T>],
}

impl<T: Real> BlockView<'_, T> {
    /// Relative masses of particle `i` in the lanes from `first` on.
    #[inline(always)]
    pub fn mass<L: Lane<Scalar = T>>(&self, i: usize, first: usize) -> L {
        if self.masses.is_empty() { L::one() } else { L::load(&self.masses[i], first) }
    }

    /// One over [`BlockView::mass`].
    #[inline(always)]
    pub fn inverse_mass<L: Lane<Scalar = T>>(&self, i: usize, first: usize) -> L {
        inverse_mass(self.masses, i, first)
    }
}

/// One over the mass of particle `i` in the lanes from `first` on, of `masses` as in
/// [`BlockView::masses`].
#[inline(always)]
pub(crate) fn inverse_mass<L: Lane>(masses: &[Row<L::Scalar>], i: usize, first: usize) -> L {
    if masses.is_empty() { L::one() } else { L::one() / L::load(&masses[i], first) }
}

/// A group of adjacent lanes of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LaneGroup {
    /// The first lane of the group.
    pub first: usize,
    /// Lanes of the whole block that hold a strand; the lanes from `live` on are padding.
    pub live: usize,
}

/// Scratch memory of one thread for strands of up to a fixed count of particles.
#[derive(Debug)]
pub struct Scratch<T> {
    rows: Vec<Row<T>>,
    air: Vec<Row<T>>,
}

/// Rows of scratch a particle: three 3×3 links and a vector.
pub const SCRATCH_ROWS: usize = 30;

/// Rows per particle for a wind field: wind, air and drag.
pub(crate) const AIR_ROWS: usize = 7;

impl<T: Real> Scratch<T> {
    /// Scratch for strands of up to `particles`.
    pub fn new(particles: usize) -> Self {
        let rows = |count: usize| vec![Row([T::zero(); crate::lane::LANES]); count];
        Self { rows: rows(SCRATCH_ROWS * (particles + 1)), air: rows(AIR_ROWS * particles) }
    }

    /// Takes the rows for the air out, to be put back with [`Scratch::put_air`].
    pub(crate) fn take_air(&mut self) -> Vec<Row<T>> {
        std::mem::take(&mut self.air)
    }

    /// Puts the rows for the air back.
    pub(crate) fn put_air(&mut self, air: Vec<Row<T>>) {
        self.air = air;
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.rows) + size_of_val(&*self.air)
    }

    /// The scratch as vectors of lanes, one after the other.
    #[inline(always)]
    pub fn vectors<L: Lane<Scalar = T>>(&mut self) -> &mut [V3<L>] {
        let numbers: &mut [T] = bytemuck::cast_slice_mut(&mut self.rows);
        let usable = numbers.len() / (3 * L::WIDTH) * (3 * L::WIDTH);
        bytemuck::cast_slice_mut(&mut numbers[..usable])
    }
}
