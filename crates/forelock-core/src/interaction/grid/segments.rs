//! Samples along every edge of the hair, sorted by layers of cells.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::frame::RowMap;
use super::{GridFrame, MARGIN, SLAB};
use crate::lane::{LANES, Real, Row};
use crate::strands::{Block, Model};
use std::ops::Range;

/// A sample of a segment.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    /// Position in cells, from the first cell of the box.
    pub at: [f32; 3],
    /// Length of hair that the sample represents, metres.
    pub mass: f32,
    /// Velocity relative to the grid, along its axes, m/s.
    pub velocity: [f32; 3],
    /// Rest volume of this hair, cells.
    pub room: f32,
}

/// The box of cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bounds {
    /// The first cell, in cells from the grid's origin.
    pub low: [i32; 3],
    /// Cells along each axis.
    pub dims: [usize; 3],
}

impl Bounds {
    /// The box around hair that spans `extent` (metres along the axes of the grid). If it would
    /// exceed `most` cells, its longest sides are cut, on the side farther from the origin of the
    /// grid.
    pub fn around([low, high]: [[f32; 3]; 2], cell: f64, most: usize) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "clamped to what 16 bits hold")]
        let index = |x: f32| (f64::from(x) / cell).floor().clamp(-3e4, 3e4) as i32;
        let mut span: [[i32; 2]; 3] =
            [0, 1, 2].map(|c| [index(low[c]) - MARGIN, index(high[c]).max(index(low[c])) + 1 + MARGIN]);
        let count = |span: &[[i32; 2]; 3]| {
            span.iter().map(|s| i64::from(s[1] - s[0])).fold(1i64, i64::saturating_mul) as u64
        };
        while count(&span) > most as u64 {
            let longest = (0..3).max_by_key(|&c| span[c][1] - span[c][0]).unwrap_or(0);
            let side = &mut span[longest];
            if -side[0] > side[1] { side[0] += 1 } else { side[1] -= 1 }
        }
        Self { low: span.map(|s| s[0]), dims: span.map(|s| usize::try_from(s[1] - s[0]).unwrap_or(1)) }
    }

    pub fn cells(&self) -> usize {
        self.dims.iter().product()
    }

    /// Cells in a layer.
    pub fn layer(&self) -> usize {
        self.dims[0] * self.dims[1]
    }

    pub fn slabs(&self) -> usize {
        self.dims[2].div_ceil(SLAB)
    }

    /// Whether all faces and cells that a sample at `at` touches lie in the box.
    #[inline]
    pub fn holds(&self, at: [f32; 3]) -> bool {
        let inner = |c: usize| at[c] >= 2.0 && at[c] < self.dims[c] as f32 - 2.0;
        inner(0) && inner(1) && inner(2)
    }
}

/// The hair at one time.
#[derive(Debug)]
pub(crate) struct Segments<'a, T> {
    pub model: &'a Model<T>,
    pub positions: &'a [Row<T>],
    pub velocities: &'a [Row<T>],
    pub rooms: &'a [Row<f32>],
}

/// A range of blocks and the samples of their edges, sorted by slab.
#[derive(Debug)]
pub(crate) struct Chunk {
    pub blocks: Range<usize>,
    /// Samples on each edge, one number for each block.
    pub points: Vec<usize>,
    pub samples: Vec<Sample>,
    /// Index of the first sample of each slab, `[slabs + 1]`.
    pub starts: Vec<u32>,
}

/// Samples on each edge of a block: enough that neighbouring samples are at most two cells apart,
/// the width of the kernel of a sample.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of 1 to 8")]
fn samples_per_edge<T: Real>(model: &Model<T>, block: &Block, cell: f64) -> usize {
    let lengths = block.range().flat_map(|place| &model.rest_lengths[3 * place].0[..block.live]);
    let longest = lengths.filter_map(num_traits::ToPrimitive::to_f64).fold(0.0, f64::max);
    (0.5 * longest / cell).ceil().clamp(1.0, 8.0) as usize
}

/// Splits the blocks of `model` into chunks, whose number does not depend on the number of threads.
pub(crate) fn chunks<T: Real>(model: &Model<T>, cell: f64) -> Vec<Chunk> {
    const CHUNKS: usize = 64;
    model
        .parts(CHUNKS)
        .map(|range| {
            let blocks = &model.blocks[range.clone()];
            let points: Vec<usize> = blocks.iter().map(|b| samples_per_edge(model, b, cell)).collect();
            let samples = blocks
                .iter()
                .zip(&points)
                .map(|(b, points)| b.live * (b.particles - 1) * points)
                .sum::<usize>();
            Chunk { blocks: range, points, samples: Vec::with_capacity(samples), starts: Vec::new() }
        })
        .collect()
}

impl Chunk {
    pub fn bytes(&self) -> usize {
        self.samples.capacity() * size_of::<Sample>()
            + self.starts.capacity() * 4
            + size_of_val(&*self.points)
    }

    /// The samples of a slab.
    #[inline]
    pub fn slab(&self, slab: usize) -> &[Sample] {
        &self.samples[self.starts[slab] as usize..self.starts[slab + 1] as usize]
    }

    /// Samples the edges of the blocks and sorts the samples by slab; within a slab they keep the
    /// order of the strands.
    pub fn fill<T: Real>(&mut self, hair: &Segments<'_, T>, frame: &GridFrame, bounds: &Bounds, cell: f64) {
        let slab = |at: [f32; 3]| at[2] as usize / SLAB;
        let starts = &mut self.starts;
        crate::scratch::fill(starts, bounds.slabs() + 1, 0);
        let view = View::new(frame, bounds, cell);
        for (block, &points) in hair.model.blocks[self.blocks.clone()].iter().zip(&self.points) {
            view.visit(hair, block, points, false, |_, _, sample| {
                if bounds.holds(sample.at) {
                    starts[slab(sample.at) + 1] += 1;
                }
            });
        }
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        crate::scratch::fill(&mut self.samples, starts[starts.len() - 1] as usize, Sample::default());
        let samples = &mut self.samples;
        for (block, &points) in hair.model.blocks[self.blocks.clone()].iter().zip(&self.points) {
            view.visit(hair, block, points, true, |_, _, sample| {
                if bounds.holds(sample.at) {
                    let next = &mut starts[slab(sample.at)];
                    samples[*next as usize] = *sample;
                    *next += 1;
                }
            });
        }
        // Each entry now holds the start of the next slab.
        starts.rotate_right(1);
        starts[0] = 0;
    }
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

    /// Positions of the particles at `place`, in cells.
    #[inline]
    pub fn place<T: Real>(&self, positions: &[Row<T>], place: usize) -> Lanes {
        let x = load(positions, place);
        let RowMap { rows: m, offset: b } = &self.place;
        let mut out = [[0.0; LANES]; 3];
        for c in 0..3 {
            for k in 0..LANES {
                out[c][k] = m[c][0] * x[0][k] + m[c][1] * x[1][k] + m[c][2] * x[2][k] + b[c];
            }
        }
        out
    }

    /// Velocities of the particles at `place` relative to the grid, along the axes of the grid.
    #[inline]
    pub fn velocity<T: Real>(&self, positions: &[Row<T>], velocities: &[Row<T>], place: usize) -> Lanes {
        let (x, v) = (load(positions, place), load(velocities, place));
        let (a, RowMap { rows: m, offset: b }) = (&self.axes, &self.motion);
        let mut out = [[0.0; LANES]; 3];
        for c in 0..3 {
            for k in 0..LANES {
                let along = a[c][0] * v[0][k] + a[c][1] * v[1][k] + a[c][2] * v[2][k];
                out[c][k] = along - (m[c][0] * x[0][k] + m[c][1] * x[1][k] + m[c][2] * x[2][k] + b[c]);
            }
        }
        out
    }

    /// Turns a vector from the axes of the grid to those of the world.
    #[inline]
    pub fn to_world(&self, v: [f32; 3]) -> [f32; 3] {
        let a = &self.axes;
        [0, 1, 2].map(|c| a[0][c] * v[0] + a[1][c] * v[1] + a[2][c] * v[2])
    }

    /// Calls `f` with the index of the edge in the block, the lane and the sample, for `points`
    /// samples on every edge of the strands of the block. Velocities are zero unless `moving`.
    #[inline]
    pub fn visit<T: Real>(
        &self,
        hair: &Segments<'_, T>,
        block: &Block,
        points: usize,
        moving: bool,
        mut f: impl FnMut(usize, usize, &Sample),
    ) {
        let share = 1.0 / points as f32;
        let still = [[0.0; LANES]; 3];
        let mut from = self.place(hair.positions, block.first);
        let mut from_velocity =
            if moving { self.velocity(hair.positions, hair.velocities, block.first) } else { still };
        for edge in 0..block.particles - 1 {
            let place = block.first + edge;
            let to = self.place(hair.positions, place + 1);
            let to_velocity =
                if moving { self.velocity(hair.positions, hair.velocities, place + 1) } else { still };
            let (lengths, rooms) = (&hair.model.rest_lengths[3 * place].0, &hair.rooms[place].0);
            for point in 0..points {
                let along = (point as f32 + 0.5) * share;
                let (at, velocity) =
                    (between(&from, &to, along), between(&from_velocity, &to_velocity, along));
                for lane in 0..block.live {
                    let sample = Sample {
                        at: [at[0][lane], at[1][lane], at[2][lane]],
                        mass: lengths[lane].to_f32().unwrap_or(0.0) * share,
                        velocity: [velocity[0][lane], velocity[1][lane], velocity[2][lane]],
                        room: rooms[lane] * share,
                    };
                    f(edge, lane, &sample);
                }
            }
            (from, from_velocity) = (to, to_velocity);
        }
    }
}

/// Interpolates linearly from `a` to `b`, lane by lane.
#[inline(always)]
pub(crate) fn between(a: &Lanes, b: &Lanes, along: f32) -> Lanes {
    let mut out = [[0.0; LANES]; 3];
    for c in 0..3 {
        for k in 0..LANES {
            out[c][k] = a[c][k] + along * (b[c][k] - a[c][k]);
        }
    }
    out
}

#[inline]
fn load<T: Real>(rows: &[Row<T>], place: usize) -> Lanes {
    let mut out = [[0.0; LANES]; 3];
    for c in 0..3 {
        for k in 0..LANES {
            out[c][k] = rows[3 * place + c].0[k].to_f32().unwrap_or(f32::NAN);
        }
    }
    out
}

/// The smallest and the largest coordinates of the hair along the axes of the grid, metres; zero if
/// no coordinate is finite.
pub(crate) fn extent<T: Real>(model: &Model<T>, positions: &[Row<T>], frame: &GridFrame) -> [[f32; 3]; 2] {
    let view = View::new(frame, &Bounds::default(), 1.0);
    let extent = model.extent(|place| view.place(positions, place));
    extent.map(|ends| ends.map(|x| if x.is_finite() { x } else { 0.0 }))
}

/// The mean of `at_edges` over all hair, weighted by the lengths of the edges.
pub(crate) fn mean<T: Real>(model: &Model<T>, lengths: &[Row<f32>], at_edges: &[Row<f32>]) -> f32 {
    let (mut sum, mut total) = (0.0, 0.0);
    for block in &model.blocks {
        for place in block.range() {
            for lane in 0..block.live {
                let length = f64::from(lengths[place].0[lane]);
                sum += length * f64::from(at_edges[place].0[lane]);
                total += length;
            }
        }
    }
    (sum / total) as f32
}

/// The field `filled` of the grid at the middle of each edge of the rest shape.
pub(crate) fn at_edges<T: Real>(
    model: &Model<T>,
    filled: &[f32],
    bounds: &Bounds,
    cell: f64,
    frame: &GridFrame,
) -> Vec<Row<f32>> {
    let mut out = vec![Row([0.0; LANES]); model.rest_lengths.len() / 3];
    let view = View::new(frame, bounds, cell);
    let hair = Segments { model, positions: &model.rest, velocities: &model.rest, rooms: &out.clone() };
    for block in &model.blocks {
        view.visit(&hair, block, 1, false, |edge, lane, sample| {
            if bounds.holds(sample.at) {
                out[block.first + edge].0[lane] =
                    crate::interaction::grid::splat_segments::interpolate(filled, bounds, sample.at);
            }
        });
    }
    out
}

/// Calls `f` for every chunk and its part of `rows`, which has three rows a place, in parallel.
pub(crate) fn split_rows<T: Real>(
    chunks: &[Chunk],
    blocks: &[Block],
    rows: &mut [Row<T>],
    f: &(impl Fn(&Chunk, &mut [Row<T>]) + Sync),
) {
    match chunks {
        [] => {}
        [chunk] => f(chunk, rows),
        _ => {
            let (left, right) = chunks.split_at(chunks.len() / 2);
            let middle = blocks[right[0].blocks.start].first - blocks[left[0].blocks.start].first;
            let (left_rows, right_rows) = rows.split_at_mut(3 * middle);
            rayon::join(
                || split_rows(left, blocks, left_rows, f),
                || split_rows(right, blocks, right_rows, f),
            );
        }
    }
}
