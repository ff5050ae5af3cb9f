//! Samples along every edge of the hair.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::bounds::{mask, masked};
use super::frame::RowMap;
use super::{Bounds, GridFrame, MASS, Patch};
use crate::interaction::transpose::Rows;
use crate::lane::{LANES, Real, Row};
use crate::strands::{Block, Model};

/// One sample on an edge of each strand of a block.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Samples {
    /// Position in cells, from the first cell of the box.
    pub at: Lanes,
    /// Velocity relative to the grid, along its axes, m/s.
    pub velocity: Lanes,
    /// Length of hair that the sample represents, metres.
    pub mass: [f32; LANES],
    /// Rest volume V of this hair, cells, and V φ₀.
    pub volume: [[f32; LANES]; 2],
}

/// The hair at one time.
#[derive(Debug)]
pub(crate) struct Segments<'a, T> {
    pub model: &'a Model<T>,
    pub positions: &'a [Row<T>],
    pub velocities: &'a [Row<T>],
    pub volumes: &'a [[Row<f32>; 2]],
}

/// Maps from the rows of the state to the grid.
#[derive(Debug)]
pub(crate) struct View {
    /// Cells from positions.
    place: RowMap,
    /// Grid axes from world axes.
    axes: [[f32; 3]; 3],
    /// Velocity of the grid along its axes, from positions.
    motion: RowMap,
}

pub(crate) type Lanes = [[f32; LANES]; 3];

impl View {
    pub fn new(frame: &GridFrame, bounds: &Bounds, cell: f64) -> Self {
        let axes = frame.rotation.transpose();
        let low = -glam::DVec3::from_array(bounds.low.map(f64::from));
        Self {
            place: RowMap::new(axes * (1.0 / cell), low),
            axes: RowMap::new(axes, glam::DVec3::ZERO).rows,
            motion: RowMap::new(axes * frame.motion.matrix3, axes * frame.motion.translation),
        }
    }

    /// Writes the positions of the particles at `place` to `out`, in cells.
    #[inline(always)]
    pub fn place<T: Real>(&self, positions: &[Row<T>], place: usize, out: &mut Lanes) {
        let x: &[Row<T>; 3] = three(positions, place);
        let RowMap { rows: m, offset: b } = &self.place;
        for c in 0..3 {
            for k in 0..LANES {
                let [x, y, z] = [to_f32(x[0].0[k]), to_f32(x[1].0[k]), to_f32(x[2].0[k])];
                out[c][k] = m[c][0] * x + m[c][1] * y + m[c][2] * z + b[c];
            }
        }
    }

    /// Writes the velocities of the particles at `place` relative to the grid to `out`, along the
    /// axes of the grid.
    #[inline(always)]
    pub fn velocity<T: Real>(&self, rows: [&[Row<T>]; 2], place: usize, out: &mut Lanes) {
        let (x, v): (&[Row<T>; 3], &[Row<T>; 3]) = (three(rows[0], place), three(rows[1], place));
        let (a, RowMap { rows: m, offset: b }) = (&self.axes, &self.motion);
        for c in 0..3 {
            for k in 0..LANES {
                let [x, y, z] = [to_f32(x[0].0[k]), to_f32(x[1].0[k]), to_f32(x[2].0[k])];
                let [u, v, w] = [to_f32(v[0].0[k]), to_f32(v[1].0[k]), to_f32(v[2].0[k])];
                let along = a[c][0] * u + a[c][1] * v + a[c][2] * w;
                out[c][k] = along - (m[c][0] * x + m[c][1] * y + m[c][2] * z + b[c]);
            }
        }
    }

    /// The smallest and the largest coordinates of the hair of `block`, without the padding lanes,
    /// whose positions may differ from their strand's.
    #[inline(always)]
    pub fn extent<T: Real>(&self, positions: &[Row<T>], block: &Block) -> [[f32; 3]; 2] {
        let mut low = [[f32::INFINITY; LANES]; 3];
        let mut high = [[f32::NEG_INFINITY; LANES]; 3];
        let mut at = [[0.0; LANES]; 3];
        for place in block.range() {
            self.place(positions, place, &mut at);
            for c in 0..3 {
                for k in 0..LANES {
                    let x = at[c][k];
                    // What is not a number is left out.
                    low[c][k] = if x < low[c][k] { x } else { low[c][k] };
                    high[c][k] = if x > high[c][k] { x } else { high[c][k] };
                }
            }
        }
        let live = |row: [f32; LANES]| row.into_iter().take(block.live);
        [
            low.map(|row| live(row).fold(f32::INFINITY, f32::min)),
            high.map(|row| live(row).fold(f32::NEG_INFINITY, f32::max)),
        ]
    }

    /// Turns vectors from the axes of the grid to those of the world.
    #[inline(always)]
    pub fn to_world(&self, v: &Lanes, out: &mut Lanes) {
        let a = &self.axes;
        for c in 0..3 {
            for k in 0..LANES {
                out[c][k] = a[0][c] * v[0][k] + a[1][c] * v[1][k] + a[2][c] * v[2][k];
            }
        }
    }

    /// Calls `f` with the index of the edge in the block and its samples, for `points` samples on
    /// every edge of the strands of the block, all lanes together. Velocities are zero unless
    /// `moving`.
    #[inline(always)]
    pub fn visit<T: Real>(
        &self,
        hair: &Segments<'_, T>,
        block: &Block,
        points: usize,
        moving: bool,
        mut f: impl FnMut(usize, &Samples),
    ) {
        let share = 1.0 / points as f32;
        // The ends of an edge: the first particle is at its number modulo 2.
        let mut at = [[[0.0; LANES]; 3]; 2];
        let mut velocity = at;
        let mut samples = Samples::default();
        let rows = [hair.positions, hair.velocities];
        self.place(hair.positions, block.first, &mut at[0]);
        if moving {
            self.velocity(rows, block.first, &mut velocity[0]);
        }
        for edge in 0..block.particles - 1 {
            let place = block.first + edge;
            let (from, to) = (edge & 1, !edge & 1);
            self.place(hair.positions, place + 1, &mut at[to]);
            if moving {
                self.velocity(rows, place + 1, &mut velocity[to]);
            }
            let lengths = &hair.model.rest_lengths[3 * place].0;
            let volumes = &hair.volumes[place];
            for k in 0..LANES {
                samples.mass[k] = to_f32(lengths[k]) * share;
            }
            for c in 0..2 {
                for k in 0..LANES {
                    samples.volume[c][k] = volumes[c].0[k] * share;
                }
            }
            for point in 0..points {
                let along = (point as f32 + 0.5) * share;
                between(&at[from], &at[to], along, &mut samples.at);
                between(&velocity[from], &velocity[to], along, &mut samples.velocity);
                f(edge, &samples);
            }
        }
    }
}

impl Samples {
    /// Writes to `out` what the samples add to the nodes: momentum, mass and volumes. Nothing
    /// outside the box, and nothing if a velocity is not finite.
    #[inline(always)]
    pub fn shares(&self, bounds: &Bounds, out: &mut Rows) {
        let mut counts = [0; LANES];
        bounds.hold(&self.at, &mut counts);
        let [x, y, z] = &self.velocity;
        for k in 0..LANES {
            counts[k] &= mask(0.0 * (x[k] + y[k] + z[k]) == 0.0);
        }
        for c in 0..3 {
            for k in 0..LANES {
                out[c][k] = masked(self.velocity[c][k] * self.mass[k], counts[k]);
            }
        }
        for k in 0..LANES {
            out[MASS][k] = masked(self.mass[k], counts[k]);
        }
        for c in 0..2 {
            for k in 0..LANES {
                out[4 + c][k] = masked(self.volume[c][k], counts[k]);
            }
        }
    }
}

/// Interpolates linearly from `a` to `b`, lane by lane.
#[inline(always)]
pub(crate) fn between(a: &Lanes, b: &Lanes, along: f32, out: &mut Lanes) {
    for c in 0..3 {
        for k in 0..LANES {
            out[c][k] = a[c][k] + along * (b[c][k] - a[c][k]);
        }
    }
}

/// The rows of the particles at `place`.
#[inline(always)]
fn three<T>(rows: &[Row<T>], place: usize) -> &[Row<T>; 3] {
    let rows = &rows[3 * place..3 * place + 3];
    // SAFETY: there are three.
    unsafe { &*rows.as_ptr().cast() }
}

#[inline(always)]
pub(crate) fn to_f32<T: Real>(x: T) -> f32 {
    x.to_f32().unwrap_or(f32::NAN)
}

/// Positions, velocities and clearances of particles: three, three and one row a place, or no
/// clearances.
#[derive(Debug)]
pub(crate) struct ParticleRows<'a, T> {
    pub positions: &'a mut [Row<T>],
    pub velocities: &'a mut [Row<T>],
    pub clearance: &'a mut [Row<T>],
}

impl<'a, T> ParticleRows<'a, T> {
    /// Calls `f` for every patch and its rows, in parallel.
    pub fn split(self, patches: &[Patch], blocks: &[Block], f: &(impl Fn(&Patch, ParticleRows<'_, T>) + Sync))
    where
        T: Send,
    {
        match patches {
            [] => {}
            [patch] => f(patch, self),
            _ => {
                let (left, right) = patches.split_at(patches.len() / 2);
                let places = blocks[right[0].blocks.start].first - blocks[left[0].blocks.start].first;
                let [here, there] = self.split_at(places);
                rayon::join(|| here.split(left, blocks, f), || there.split(right, blocks, f));
            }
        }
    }

    /// The rows of the first `places`, and all others.
    pub fn split_at(self, places: usize) -> [ParticleRows<'a, T>; 2] {
        let (positions, positions_after) = self.positions.split_at_mut(3 * places);
        let (velocities, velocities_after) = self.velocities.split_at_mut(3 * places);
        let known = places.min(self.clearance.len());
        let (clearance, clearance_after) = self.clearance.split_at_mut(known);
        [
            ParticleRows { positions, velocities, clearance },
            ParticleRows {
                positions: positions_after,
                velocities: velocities_after,
                clearance: clearance_after,
            },
        ]
    }
}
