//! Samples along every edge of the hair, sorted by layers of cells.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::frame::RowMap;
use super::{GridFrame, MARGIN, MASS, SLAB};
use crate::lane::{LANES, Real, Row, widest};
use crate::strands::{Block, Model};
use std::ops::Range;

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

/// A sample, ready to be splat.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(16))]
pub(crate) struct Sample {
    /// Position from the first node of its stencil, cells.
    pub offset: [f32; 3],
    /// Index of this node.
    pub first: u32,
    /// What it adds to the nodes.
    pub share: [f32; 8],
}

/// Distance from the faces of the box that samples keep, cells.
const START: f32 = 2.0;
const END: f32 = 2.5;

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

    /// Nodes from the first of a stencil to the first of each of its rows.
    #[inline(always)]
    pub fn stencil_rows(&self) -> [usize; 4] {
        let [row, layer] = [self.dims[0], self.layer()];
        [0, row, layer, layer + row]
    }

    /// Whether all nodes that a sample at `at` touches lie inside the box, lane by lane.
    #[inline(always)]
    pub fn hold(&self, at: &Lanes) -> [bool; LANES] {
        let mut inside = [true; LANES];
        for c in 0..3 {
            let end = self.dims[c] as f32 - END;
            for lane in 0..LANES {
                inside[lane] &= (at[c][lane] >= START) & (at[c][lane] < end);
            }
        }
        inside
    }
}

/// The hair at one time.
#[derive(Debug)]
pub(crate) struct Segments<'a, T> {
    pub model: &'a Model<T>,
    pub positions: &'a [Row<T>],
    pub velocities: &'a [Row<T>],
    pub volumes: &'a [[Row<f32>; 2]],
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

/// Largest distance of neighbouring samples of a strand, cells. The kernel of a sample is two cells
/// wide; in dense hair, samples of neighbouring strands lie between them.
const SPACING: f64 = 2.5;

/// Samples on each edge of a block.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of 1 to 8")]
fn samples_per_edge<T: Real>(model: &Model<T>, block: &Block, cell: f64) -> usize {
    let lengths = block.range().flat_map(|place| &model.rest_lengths[3 * place].0[..block.live]);
    let longest = lengths.filter_map(num_traits::ToPrimitive::to_f64).fold(0.0, f64::max);
    (longest / (SPACING * cell)).ceil().clamp(1.0, 8.0) as usize
}

/// Splits the blocks of `model` into chunks, whose number does not depend on the number of threads.
pub(crate) fn chunks<T: Real>(model: &Model<T>, cell: f64) -> Vec<Chunk> {
    const CHUNKS: usize = 64;
    model
        .parts(CHUNKS)
        .map(|range| {
            let blocks = &model.blocks[range.clone()];
            let points: Vec<usize> = blocks.iter().map(|b| samples_per_edge(model, b, cell)).collect();
            let samples: usize =
                blocks.iter().zip(&points).map(|(b, points)| b.live * (b.particles - 1) * points).sum();
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
    pub fn slab(&self, slab: usize) -> &[Sample] {
        &self.samples[self.starts[slab] as usize..self.starts[slab + 1] as usize]
    }

    /// Number of samples in the box, and their mass, metres of hair.
    pub fn totals(&self) -> (f64, f64) {
        let masses = self.samples.iter().map(|sample| f64::from(sample.share[MASS]));
        masses.filter(|mass| *mass > 0.0).fold((0.0, 0.0), |(n, sum), mass| (n + 1.0, sum + mass))
    }

    /// Samples the edges of the blocks and sorts the samples by slab; within a slab they keep the
    /// order of the strands.
    pub fn fill<T: Real>(&mut self, hair: &Segments<'_, T>, frame: &GridFrame, bounds: &Bounds, cell: f64) {
        widest(
            #[inline(always)]
            || self.fill_inline(hair, frame, bounds, cell),
        );
    }

    #[inline(always)]
    fn fill_inline<T: Real>(
        &mut self,
        hair: &Segments<'_, T>,
        frame: &GridFrame,
        bounds: &Bounds,
        cell: f64,
    ) {
        crate::scratch::fill(&mut self.starts, bounds.slabs() + 1, 0);
        let view = View::new(frame, bounds, cell);
        let starts = &mut self.starts[..];
        let blocks = || hair.model.blocks[self.blocks.clone()].iter().zip(&self.points);
        for (block, &points) in blocks() {
            view.visit(
                hair,
                block,
                points,
                false,
                #[inline(always)]
                |_, samples| {
                    for &slab in &samples.slabs(bounds)[..block.live] {
                        starts[slab as usize + 1] += 1;
                    }
                },
            );
        }
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        crate::scratch::resize(&mut self.samples, starts[starts.len() - 1] as usize, Sample::default());
        let sorted = &mut self.samples[..];
        for (block, &points) in blocks() {
            view.visit(
                hair,
                block,
                points,
                true,
                #[inline(always)]
                |_, samples| {
                    let slabs = samples.slabs(bounds);
                    let stencils = Stencils::new(bounds, &samples.at);
                    let shares = samples.shares(bounds);
                    for lane in 0..block.live {
                        let next = &mut starts[slabs[lane] as usize];
                        sorted[*next as usize] = Sample {
                            offset: [0, 1, 2].map(|c| stencils.offset[c][lane]),
                            first: stencils.first[lane],
                            share: [0, 1, 2, 3, 4, 5, 6, 6].map(|k| shares[k][lane]),
                        };
                        *next += 1;
                    }
                },
            );
        }
        // Each entry now holds the start of the next slab.
        starts.rotate_right(1);
        starts[0] = 0;
    }
}

/// The trilinear stencils of one sample of each strand of a block. The nodes are the middles of the
/// cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stencils {
    /// Positions from the first node, cells.
    pub offset: Lanes,
    /// Index of the first node.
    pub first: [u32; LANES],
}

impl Stencils {
    /// The stencils of samples at `at`, cells. Samples outside the box get those of the nearest
    /// point inside.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few thousand at most")]
    pub fn new(bounds: &Bounds, at: &Lanes) -> Self {
        let strides = [1, bounds.dims[0] as u32, bounds.layer() as u32];
        let mut stencils = Self { offset: [[0.0; LANES]; 3], first: [0; LANES] };
        for c in 0..3 {
            let end = bounds.dims[c] as f32 - END;
            for k in 0..LANES {
                // Coordinates are positive: a cast is the floor.
                let x = at[c][k].max(START).min(end) - 0.5;
                let low = x as i32;
                stencils.offset[c][k] = x - low as f32;
                stencils.first[k] += strides[c] * low as u32;
            }
        }
        stencils
    }

    /// The weighted sum of `f` of the nodes of a lane's stencil.
    pub fn sum(&self, bounds: &Bounds, lane: usize, f: impl Fn(usize) -> f32) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|c| [1.0 - self.offset[c][lane], self.offset[c][lane]]);
        let nodes = self.nodes(bounds, lane).into_iter().enumerate();
        nodes.map(|(n, node)| x[n & 1] * y[n >> 1 & 1] * z[n >> 2] * f(node)).sum()
    }

    /// The nodes of a lane's stencil, x fastest.
    pub fn nodes(&self, bounds: &Bounds, lane: usize) -> [usize; 8] {
        let rows = bounds.stencil_rows();
        std::array::from_fn(|n| self.first[lane] as usize + rows[n >> 1] + (n & 1))
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
    #[inline(always)]
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
    #[inline(always)]
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

    /// Turns vectors from the axes of the grid to those of the world.
    #[inline(always)]
    pub fn to_world(&self, v: &Lanes) -> Lanes {
        let a = &self.axes;
        let mut out = [[0.0; LANES]; 3];
        for c in 0..3 {
            for k in 0..LANES {
                out[c][k] = a[0][c] * v[0][k] + a[1][c] * v[1][k] + a[2][c] * v[2][k];
            }
        }
        out
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
        let still = [[0.0; LANES]; 3];
        let mut from = self.place(hair.positions, block.first);
        let mut from_velocity =
            if moving { self.velocity(hair.positions, hair.velocities, block.first) } else { still };
        for edge in 0..block.particles - 1 {
            let place = block.first + edge;
            let to = self.place(hair.positions, place + 1);
            let to_velocity =
                if moving { self.velocity(hair.positions, hair.velocities, place + 1) } else { still };
            let mass = hair.model.rest_lengths[3 * place].0.map(|l| l.to_f32().unwrap_or(0.0) * share);
            let volume = [0, 1].map(|k| hair.volumes[place][k].0.map(|volume| volume * share));
            for point in 0..points {
                let along = (point as f32 + 0.5) * share;
                let samples = Samples {
                    at: between(&from, &to, along),
                    velocity: between(&from_velocity, &to_velocity, along),
                    mass,
                    volume,
                };
                f(edge, &samples);
            }
            (from, from_velocity) = (to, to_velocity);
        }
    }
}

impl Samples {
    /// The slab of each sample: that of the nearest point of the box for samples outside.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few thousand at most")]
    fn slabs(&self, bounds: &Bounds) -> [u32; LANES] {
        let end = bounds.dims[2] as f32 - END;
        self.at[2].map(|z| (z.max(START).min(end) - 0.5) as i32 as u32 / SLAB as u32)
    }

    /// What the samples add to the nodes: momentum, mass, volumes and zero. Nothing outside the
    /// box, and nothing if a velocity is not finite.
    #[inline(always)]
    fn shares(&self, bounds: &Bounds) -> [[f32; LANES]; 7] {
        let mut out = [[0.0; LANES]; 7];
        let inside = bounds.hold(&self.at);
        let [x, y, z] = &self.velocity;
        for k in 0..LANES {
            let counts = inside[k] & (0.0 * (x[k] + y[k] + z[k]) == 0.0);
            let all = [
                x[k] * self.mass[k],
                y[k] * self.mass[k],
                z[k] * self.mass[k],
                self.mass[k],
                self.volume[0][k],
                self.volume[1][k],
            ];
            for (row, value) in out.iter_mut().zip(all) {
                row[k] = if counts { value } else { 0.0 };
            }
        }
        out
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

#[inline(always)]
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

/// A function of the nodes of the grid at the middle of each edge of the rest shape, or the largest
/// of the nodes around it.
pub(crate) fn at_edges<T: Real>(
    model: &Model<T>,
    nodes: &[f32],
    bounds: &Bounds,
    cell: f64,
    frame: &GridFrame,
    largest: bool,
) -> Vec<Row<f32>> {
    let nothing = Row([0.0; LANES]);
    let mut out = vec![nothing; model.rest_lengths.len() / 3];
    let view = View::new(frame, bounds, cell);
    let volumes = vec![[nothing; 2]; out.len()];
    let hair = Segments { model, positions: &model.rest, velocities: &model.rest, volumes: &volumes };
    for block in &model.blocks {
        view.visit(&hair, block, 1, false, |edge, samples| {
            let inside = bounds.hold(&samples.at);
            let stencils = Stencils::new(bounds, &samples.at);
            let row = &mut out[block.first + edge].0;
            for lane in (0..block.live).filter(|&lane| inside[lane]) {
                row[lane] = if largest {
                    stencils.nodes(bounds, lane).map(|node| nodes[node]).into_iter().fold(0.0, f32::max)
                } else {
                    stencils.sum(bounds, lane, |node| nodes[node])
                };
            }
        });
    }
    out
}

/// Calls `f` for every chunk and its parts of two arrays of three rows a place, in parallel.
pub(crate) fn split_rows<T: Real>(
    chunks: &[Chunk],
    blocks: &[Block],
    [a, b]: [&mut [Row<T>]; 2],
    f: &(impl Fn(&Chunk, [&mut [Row<T>]; 2]) + Sync),
) {
    match chunks {
        [] => {}
        [chunk] => f(chunk, [a, b]),
        _ => {
            let (left, right) = chunks.split_at(chunks.len() / 2);
            let middle = 3 * (blocks[right[0].blocks.start].first - blocks[left[0].blocks.start].first);
            let ((left_a, right_a), (left_b, right_b)) = (a.split_at_mut(middle), b.split_at_mut(middle));
            rayon::join(
                || split_rows(left, blocks, [left_a, left_b], f),
                || split_rows(right, blocks, [right_a, right_b], f),
            );
        }
    }
}
