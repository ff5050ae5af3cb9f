//! Patches: parts of the hair, each with its own nodes, so that threads splat without waiting for
//! each other.

use super::bounds::{STRIP, strips_of};
use super::{Bounds, GridFrame, Lattice, Node, Segments, Stencils, View};
use crate::interaction::transpose::nodes_of_rows;
use crate::lane::{LANES, Real, Row, widest};
use crate::scratch::{fill, resize};
use crate::strands::{Block, Model};
use std::ops::Range;

/// A range of blocks, and the part of the box that their hair lies in.
#[derive(Debug)]
pub(crate) struct Patch {
    pub blocks: Range<usize>,
    /// Samples on each edge, one number for each block.
    pub points: Vec<usize>,
    /// The smallest and the largest coordinates of the hair, metres along the axes of the grid.
    pub extent: [[f32; 3]; 2],
    /// The first node, cells of the box; a strip begins there.
    low: [usize; 3],
    /// Clusters along x, and nodes along y and z.
    dims: [usize; 3],
    /// Zero except in marked clusters.
    nodes: Vec<Node>,
    /// 1 for each cluster to whose nodes a sample added in the first row of its stencil.
    marks: Vec<u8>,
    /// A bit for each cluster to whose nodes a sample may have added.
    touched: Vec<u32>,
}

/// Nodes side by side that a patch marks and clears together. Patches overlap, so this is less than
/// a strip.
const CLUSTER: usize = 4;
/// Clusters of a strip.
const CLUSTERS: usize = STRIP / CLUSTER;
/// Clusters of a word of bits.
const WORD: usize = 32;

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

/// Splits the blocks of `model` into patches, whose number does not depend on the number of
/// threads.
pub(crate) fn patches<T: Real>(model: &Model<T>, cell: f64) -> Vec<Patch> {
    const PATCHES: usize = 16;
    let patch = |range: Range<usize>| {
        let blocks = &model.blocks[range.clone()];
        Patch {
            points: blocks.iter().map(|block| samples_per_edge(model, block, cell)).collect(),
            blocks: range,
            extent: NOWHERE,
            low: [0; 3],
            dims: [0; 3],
            nodes: Vec::new(),
            marks: Vec::new(),
            touched: Vec::new(),
        }
    };
    model.parts(PATCHES).map(patch).collect()
}

/// The extent of no hair.
pub(crate) const NOWHERE: [[f32; 3]; 2] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// The extent of the hair of both `a` and `b`.
pub(crate) fn join(a: [[f32; 3]; 2], b: [[f32; 3]; 2]) -> [[f32; 3]; 2] {
    [[0, 1, 2].map(|c| a[0][c].min(b[0][c])), [0, 1, 2].map(|c| a[1][c].max(b[1][c]))]
}

impl Patch {
    pub fn bytes(&self) -> usize {
        let marks = self.marks.capacity() + 4 * self.touched.capacity();
        self.nodes.capacity() * size_of::<Node>() + marks + size_of_val(&*self.points)
    }

    /// Measures the extent of the hair, and clears the nodes.
    pub fn measure<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], frame: &GridFrame) {
        let view = View::new(frame, &Bounds::default(), 1.0);
        let blocks = &model.blocks[self.blocks.clone()];
        self.extent = widest(
            #[inline(always)]
            || blocks.iter().map(|block| view.extent(positions, block)).fold(NOWHERE, join),
        );
        self.clear();
    }

    /// Adds the samples of all edges to the nodes, which have been placed.
    pub fn splat<T: Real>(&mut self, hair: &Segments<'_, T>, frame: &GridFrame, bounds: &Bounds, cell: f64) {
        let clusters: usize = self.dims.iter().product();
        resize(&mut self.nodes, CLUSTER * clusters, Node::default());
        fill(&mut self.marks, clusters.next_multiple_of(WORD), 0);
        fill(&mut self.touched, clusters.div_ceil(WORD), 0);
        let (lattice, view) = (self.lattice(bounds, cell), View::new(frame, bounds, cell));
        widest(
            #[inline(always)]
            || self.add_samples(hair, &view, bounds, &lattice),
        );
        self.spread_marks();
    }

    /// Clears the nodes of marked clusters.
    fn clear(&mut self) {
        for cluster in ones(&self.touched) {
            self.nodes[CLUSTER * cluster..CLUSTER * (cluster + 1)].fill(Node::default());
        }
    }

    /// Places the nodes around the hair, whose extent has been measured. Returns their number.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few thousand at most")]
    pub fn place(&mut self, bounds: &Bounds, cell: f64) -> usize {
        let [start, end] = bounds.part(self.extent, cell);
        let low = start.map(|x| (x - 0.5) as usize);
        let last = end.map(|x| (x - 0.5) as usize + 1);
        self.low = [low[0] / STRIP * STRIP, low[1], low[2]];
        let [across, rows, layers] = [0, 1, 2].map(|c| last[c] + 1 - self.low[c]);
        self.dims = [CLUSTERS * strips_of(across), rows, layers];
        CLUSTER * self.dims.iter().product::<usize>()
    }

    /// Makes room for twice `most` nodes if there is none for `most`. All patches have the same
    /// room, so that none runs out of it when hair swings to the other side.
    pub fn reserve(&mut self, most: usize) {
        if self.nodes.capacity() < most {
            self.nodes.reserve_exact(2 * most - self.nodes.len());
            let clusters = (2 * most / CLUSTER).next_multiple_of(WORD);
            self.marks.reserve_exact(clusters - self.marks.len());
            self.touched.reserve_exact(clusters / WORD - self.touched.len());
        }
    }

    /// The nodes as samples find them.
    fn lattice(&self, bounds: &Bounds, cell: f64) -> Lattice {
        let [start, end] = bounds.part(self.extent, cell);
        let row = CLUSTER * self.dims[0];
        Lattice::new(start, end, self.low, [1, row, row * self.dims[1]])
    }

    /// Adds all samples to the nodes, and marks the clusters of the first row of each stencil.
    #[inline(always)]
    fn add_samples<T: Real>(
        &mut self,
        hair: &Segments<'_, T>,
        view: &View,
        bounds: &Bounds,
        lattice: &Lattice,
    ) {
        let Self { blocks, points, nodes, marks, .. } = self;
        let rows = lattice.rows();
        let (mut stencils, mut shares) = (Stencils::default(), [[0.0; LANES]; 8]);
        let mut own = [Node::default(); LANES];
        for (block, &points) in hair.model.blocks[blocks.clone()].iter().zip(&*points) {
            view.visit(
                hair,
                block,
                points,
                true,
                #[inline(always)]
                |_, samples| {
                    stencils.set(lattice, &samples.at);
                    samples.shares(bounds, &mut shares);
                    nodes_of_rows(&shares, &mut own);
                    add(&mut nodes[..], &mut marks[..], rows, &stencils, &own[..block.live]);
                },
            );
        }
    }

    /// Collects the marks and spreads them from the first row of the stencils to all four.
    fn spread_marks(&mut self) {
        let Self { marks, touched, dims: [row, rows, _], .. } = self;
        for (word, marks) in touched.iter_mut().zip(marks.chunks_exact(WORD)) {
            *word = (0..WORD).fold(0, |word, k| word | u32::from(marks[k]) << k);
        }
        for stride in [*row, *row * *rows] {
            let (words, bits) = (stride / WORD, stride % WORD);
            for k in (words..touched.len()).rev() {
                // Shifted by all bits there is nothing left.
                let below = if k > words { touched[k - words - 1] } else { 0 };
                let carried = below.checked_shr((WORD - bits) as u32).unwrap_or(0);
                touched[k] |= touched[k - words] << bits | carried;
            }
        }
    }

    /// Adds the nodes of layer `k` of the box to `nodes`, of which the strips that are not marked
    /// hold nothing yet, and marks their strips.
    #[inline(always)]
    pub fn add_layer(&self, k: usize, bounds: &Bounds, nodes: &mut [Node], marks: &mut [u8]) {
        let [row, rows, layers] = self.dims;
        let Some(layer) = k.checked_sub(self.low[2]).filter(|layer| *layer < layers) else { return };
        let (from, to) = (row * rows * layer, row * rows * (layer + 1));
        let words = &self.touched[from / WORD..to.div_ceil(WORD)];
        // The first cluster of the next row, and the first strip of this one.
        let mut next = from + row;
        let mut first = bounds.strips() * self.low[1] + self.low[0] / STRIP;
        let clusters = ones(words).map(|place| from / WORD * WORD + place);
        for cluster in clusters.skip_while(|cluster| *cluster < from).take_while(|cluster| *cluster < to) {
            while cluster >= next {
                (next, first) = (next + row, first + bounds.strips());
            }
            let place = cluster + row - next;
            let strip = first + place / CLUSTERS;
            let all = &mut nodes[STRIP * strip..STRIP * (strip + 1)];
            if marks[strip] == 0 {
                marks[strip] = 1;
                all.fill(Node::default());
            }
            let own = &self.nodes[CLUSTER * cluster..CLUSTER * (cluster + 1)];
            for (sum, node) in all[CLUSTER * (place % CLUSTERS)..].iter_mut().zip(own) {
                *sum = *sum + *node;
            }
        }
    }
}

/// The places of the ones in `words`, lowest first.
#[inline(always)]
fn ones(words: &[u32]) -> impl Iterator<Item = usize> {
    words.iter().enumerate().filter(|(_, word)| **word != 0).flat_map(|(k, word)| {
        let mut word = *word;
        std::iter::from_fn(move || {
            let place = word.trailing_zeros() as usize;
            word &= word.wrapping_sub(1);
            (place < WORD).then_some(WORD * k + place)
        })
    })
}

/// Adds a sample of each lane to the nodes of its stencil.
#[inline(always)]
fn add(nodes: &mut [Node], marks: &mut [u8], rows: [usize; 4], stencils: &Stencils, shares: &[Node]) {
    let beyond = rows[3] + 1;
    assert!(nodes.len() <= CLUSTER * marks.len(), "each cluster has a mark");
    for (lane, share) in shares.iter().enumerate() {
        let first = stencils.first[lane] as usize;
        assert!(first + beyond < nodes.len(), "a patch holds the stencils of its samples");
        // SAFETY: the last of the nodes is `beyond` the first, and each cluster has a mark.
        unsafe {
            *marks.get_unchecked_mut(first / CLUSTER) = 1;
            *marks.get_unchecked_mut((first + 1) / CLUSTER) = 1;
        }
        let weight = |n: usize| stencils.weights[n][lane];
        let (low, high) = (*share * weight(4), *share * weight(5));
        for (n, row) in rows.into_iter().enumerate() {
            // SAFETY: as above.
            let pair = unsafe { nodes.get_unchecked_mut(first + row..first + row + 2) };
            pair[0] = pair[0] + low * weight(n);
            pair[1] = pair[1] + high * weight(n);
        }
    }
}
