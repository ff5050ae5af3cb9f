//! Which segments are near which cells.

use super::Slice;
use super::pairs::{Entry, Group, Test};
use crate::contact::{CELL_SEGMENTS, Contact, Drift, Ways};
use crate::lane::{LANES, Real};
use crate::model::Model;
use crate::scratch::fill;
use glam::Vec3;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Parts of the blocks, and of the layers: fixed counts, for results must not depend on threads.
const CHUNKS: usize = 64;
const SLABS: usize = 64;
/// Cells at most.
const CELLS: usize = 1 << 28;
/// How far an active segment reaches into cells at most, and how far another one, in cells: others stray less, but where
/// there are more than the budget has room for.
const REACH: [f32; 2] = [1.0, 0.2];

/// The box of cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cells {
    low: Vec3,
    /// Side of a cell, metres.
    pub side: f32,
    dims: [usize; 3],
    /// Layers along z of a slab.
    layers: usize,
}

impl Cells {
    /// Cells that hold the box from `low` to `high`: of `side` metres, or larger where that would be more than [`CELLS`].
    pub fn around([low, high]: [Vec3; 2], side: f32) -> Self {
        let size = high - low;
        let mut cells = Self { low, side, dims: [1; 3], layers: 1 };
        loop {
            let counts =
                (size / cells.side).to_array().map(|count| count.clamp(0.0, CELLS as f32) as usize + 1);
            if counts.into_iter().fold(1, usize::saturating_mul) <= CELLS {
                cells.dims = counts;
                break;
            }
            cells.side *= 1.25;
        }
        cells.layers = cells.dims[2].div_ceil(SLABS);
        cells
    }

    /// How many slabs there are.
    pub fn slabs(&self) -> usize {
        self.dims[2].div_ceil(self.layers)
    }

    /// The slab of a cell, its place in it, and what is there.
    #[inline]
    fn place(&self, [x, y, z]: [usize; 3], number: u32) -> [u32; 3] {
        let slab = z / self.layers;
        let cell = x + self.dims[0] * (y + self.dims[1] * (z - slab * self.layers));
        [slab as u32, cell as u32, number]
    }

    /// Where a cell of slab `slab` is, in cells.
    fn corner(&self, slab: usize, cell: usize) -> Vec3 {
        let (x, rest) = (cell % self.dims[0], cell / self.dims[0]);
        let (y, z) = (rest % self.dims[1], rest / self.dims[1] + slab * self.layers);
        Vec3::new(x as f32, y as f32, z as f32)
    }

    /// Calls `f` with all cells of the box nearer than `entry.reach` to the entry's segment, and some more.
    #[inline]
    fn cover(&self, entry: &Entry, mut f: impl FnMut([usize; 3])) {
        let (p, e, r) = (entry.at.to_array(), entry.edge.to_array(), entry.reach);
        let steep = entry.edge.abs();
        let main = if steep.x >= steep.y && steep.x >= steep.z {
            0
        } else if steep.y >= steep.z {
            1
        } else {
            2
        };
        let (one, two) = ((main + 1) % 3, (main + 2) % 3);
        let span = |axis: usize, from: f32, to: f32| -> Range<usize> {
            let (x, y) = (p[axis] + from * e[axis], p[axis] + to * e[axis]);
            let (low, high) = (x.min(y) - r, x.max(y) + r);
            if high < 0.0 {
                return 0..0;
            }
            low.max(0.0) as usize..(high as usize + 1).min(self.dims[axis])
        };
        let inverse = 1.0 / e[main];
        for k in span(main, 0.0, 1.0) {
            let ends = [(k as f32 - r - p[main]) * inverse, (k as f32 + 1.0 + r - p[main]) * inverse];
            let from = ends[0].min(ends[1]).clamp(0.0, 1.0);
            let to = ends[0].max(ends[1]).clamp(0.0, 1.0);
            let (from, to) = if from <= to { (from, to) } else { (0.0, 1.0) };
            for i in span(one, from, to) {
                for j in span(two, from, to) {
                    let mut cell = [k; 3];
                    cell[one] = i;
                    cell[two] = j;
                    f(cell);
                }
            }
        }
    }
}

/// Bits of [`Marks`], a power of two.
const MARKS: usize = 1 << 20;

/// Cells that are marked, by a hash of their place: some others may seem to be.
#[derive(Debug, Default)]
pub(crate) struct Marks(Vec<AtomicU32>);

impl Marks {
    pub fn bytes(&self) -> usize {
        4 * self.0.capacity()
    }

    /// Takes all marks away.
    pub fn clear(&mut self) {
        self.0.clear();
        self.0.resize_with(MARKS / 32, AtomicU32::default);
    }

    #[inline]
    fn bit(cells: &Cells, [x, y, z]: [usize; 3]) -> (usize, u32) {
        let place = (x + cells.dims[0] * (y + cells.dims[1] * z)) % MARKS;
        (place / 32, 1 << (place % 32))
    }

    #[inline]
    fn set(&self, cells: &Cells, cell: [usize; 3]) {
        let (word, bit) = Self::bit(cells, cell);
        if self.0[word].load(Relaxed) & bit == 0 {
            self.0[word].fetch_or(bit, Relaxed);
        }
    }

    #[inline]
    fn has(&self, cells: &Cells, cell: [usize; 3]) -> bool {
        let (word, bit) = Self::bit(cells, cell);
        self.0[word].load(Relaxed) & bit != 0
    }
}

/// Some blocks and the cells near their segments.
#[derive(Debug)]
pub(crate) struct Chunk {
    blocks: Range<usize>,
    entries: Vec<Entry>,
    /// Slab, cell in the slab, entry; as they come.
    unsorted: Vec<[u32; 3]>,
    /// Cell in the slab, entry; slab by slab.
    sorted: Vec<[u32; 2]>,
    /// Where each slab starts, `[slabs + 1]`.
    starts: Vec<u32>,
}

/// The blocks of `model` in a number of chunks that does not depend on threads.
pub(super) fn chunks<T: Real>(model: &Model<T>) -> Vec<Chunk> {
    let chunk = |blocks| Chunk {
        blocks,
        entries: Vec::new(),
        unsorted: Vec::new(),
        sorted: Vec::new(),
        starts: Vec::new(),
    };
    model.parts(CHUNKS).map(chunk).collect()
}

impl Chunk {
    pub fn bytes(&self) -> usize {
        self.entries.capacity() * size_of::<Entry>()
            + 12 * self.unsorted.capacity()
            + 8 * self.sorted.capacity()
            + 4 * self.starts.capacity()
    }

    /// Enters the active segments, and marks the cells near them.
    pub fn enter_active<T: Real>(
        &mut self,
        model: &Model<T>,
        ways: &Ways,
        slice: &Slice,
        (cells, marks): (&Cells, &Marks),
    ) {
        self.entries.clear();
        self.unsorted.clear();
        self.each_segment(model, |chunk, a| {
            if is_active(ways, slice, a)
                && let Some(entry) = entry(ways, slice, cells, a)
            {
                let number = chunk.entries.len() as u32;
                chunk.entries.push(entry);
                cells.cover(&entry, |cell| {
                    marks.set(cells, cell);
                    chunk.unsorted.push(cells.place(cell, number));
                });
            }
        });
    }

    /// Enters those of the others that are in cells with active ones, and sorts.
    pub fn enter_others<T: Real>(
        &mut self,
        model: &Model<T>,
        (ways, drift): (&Ways, &Drift),
        slice: &Slice,
        (cells, marks): (&Cells, &Marks),
    ) {
        self.each_segment(model, |chunk, a| {
            if !is_active(ways, slice, a)
                && (drift.stirs(ways.at(a, 0.5), slice.active.least)
                    || drift.stirs(ways.at(a + LANES, 0.5), slice.active.least))
                && let Some(entry) = entry(ways, slice, cells, a)
            {
                let number = chunk.entries.len() as u32;
                let before = chunk.unsorted.len();
                cells.cover(&entry, |cell| {
                    if marks.has(cells, cell) {
                        chunk.unsorted.push(cells.place(cell, number));
                    }
                });
                if chunk.unsorted.len() > before {
                    chunk.entries.push(entry);
                }
            }
        });
        self.sort(cells);
    }

    fn each_segment<T: Real>(&mut self, model: &Model<T>, mut f: impl FnMut(&mut Self, usize)) {
        for block in &model.blocks[self.blocks.clone()] {
            for place in block.first..block.first + block.particles - 1 {
                for lane in 0..block.live {
                    f(self, LANES * place + lane);
                }
            }
        }
    }

    /// Sorts what was entered by slab.
    fn sort(&mut self, cells: &Cells) {
        fill(&mut self.starts, cells.slabs() + 1, 0);
        for [slab, ..] in &self.unsorted {
            self.starts[*slab as usize + 1] += 1;
        }
        for k in 1..self.starts.len() {
            self.starts[k] += self.starts[k - 1];
        }
        fill(&mut self.sorted, self.unsorted.len(), [0; 2]);
        for &[slab, cell, number] in &self.unsorted {
            let next = &mut self.starts[slab as usize];
            self.sorted[*next as usize] = [cell, number];
            *next += 1;
        }
        // Each start now stands where the next slab starts.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    fn slab(&self, slab: usize) -> &[[u32; 2]] {
        &self.sorted[self.starts[slab] as usize..self.starts[slab + 1] as usize]
    }
}

/// Whether contacts of segment `a` are sought.
#[inline]
fn is_active(ways: &Ways, slice: &Slice, a: usize) -> bool {
    slice.active.has(a, ways.stray[a].max(ways.stray[a + LANES]))
}

/// Segment `a` in the middle of the slice, in cells, if it is somewhere.
#[inline]
fn entry(ways: &Ways, slice: &Slice, cells: &Cells, a: usize) -> Option<Entry> {
    let (lower, upper) = (ways.at(a, slice.middle()), ways.at(a + LANES, slice.middle()));
    if !(lower.is_finite() && upper.is_finite()) {
        return None;
    }
    let (scale, active) = (1.0 / cells.side, is_active(ways, slice, a));
    // A quarter more, for the drift is not quite the same for both of a pair.
    let stray = 1.25 * ways.stray[a].max(ways.stray[a + LANES]);
    let reach = 0.5 * (slice.distance + slice.length() * stray) * scale;
    let share = slice.length() * scale;
    let (way, next) = (share * ways.way(a), share * ways.way(a + LANES));
    Some(Entry {
        segment: a as u32,
        active,
        at: (lower - cells.low) * scale,
        edge: (upper - lower) * scale,
        inverse: 1.0 / ((upper - lower) * scale).length_squared().max(1e-12),
        reach: reach.min(REACH[usize::from(!active)]),
        way: 0.5 * (way + next),
        spread: 0.5 * way.distance(next),
    })
}

/// Some layers of cells.
#[derive(Debug, Default)]
pub(crate) struct Slab {
    /// Cell, chunk and entry of all that is in the slab: 32 bits, then [`CHUNK_BITS`], then the rest.
    order: Vec<u64>,
    group: Group,
    /// What was found in the slab.
    pub found: Vec<Contact>,
}

/// Bits of a chunk's number.
const CHUNK_BITS: u32 = CHUNKS.ilog2();
const NUMBER_BITS: u32 = 32 - CHUNK_BITS;

impl Slab {
    pub fn bytes(&self) -> usize {
        8 * self.order.capacity() + self.group.bytes() + self.found.capacity() * size_of::<Contact>()
    }

    /// Lets the segments in each cell of slab `k` meet: `meet` says of the pairs that pass the test what becomes of them.
    pub fn search(
        &mut self,
        k: usize,
        (chunks, cells): (&[Chunk], &Cells),
        (test, distance): (Test, f32),
        meet: impl Fn([u32; 2]) -> Option<Contact>,
    ) {
        self.order.clear();
        for (chunk, c) in chunks.iter().zip(0u64..) {
            let key =
                |&[cell, number]: &[u32; 2]| u64::from(cell) << 32 | c << NUMBER_BITS | u64::from(number);
            self.order.extend(chunk.slab(k).iter().map(key));
        }
        // By cell, otherwise in the order of strands: no two are the same.
        self.order.sort_unstable();
        self.found.clear();
        for own in self.order.chunk_by(|a, b| a >> 32 == b >> 32).filter(|own| own.len() > 1) {
            let entry = |key: &u64| {
                let (chunk, number) = (*key as u32 >> NUMBER_BITS, *key as u32 & (u32::MAX >> CHUNK_BITS));
                &chunks[chunk as usize].entries[number as usize]
            };
            // Active ones first: each pair has one.
            self.group.clear();
            for entry in own.iter().map(entry).filter(|entry| entry.active).take(CELL_SEGMENTS) {
                self.group.push(entry);
            }
            let active = self.group.len();
            if active == 0 {
                continue;
            }
            let others = own.iter().map(entry).filter(|entry| !entry.active);
            for entry in others.take(CELL_SEGMENTS - active) {
                self.group.push(entry);
            }
            let corner = cells.corner(k, (own[0] >> 32) as usize);
            self.found.extend(self.group.pairs(test, active, (corner, distance)).filter_map(&meet));
        }
    }
}
