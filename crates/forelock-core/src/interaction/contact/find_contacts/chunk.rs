//! The blocks of a chunk: their active segments, and the contacts of their segments.

use super::follow::{Follower, Paths};
use super::keep_fastest;
use super::pairs::{ComputeSegments, Entry, RowBuffers, Search, SearchPlace};
use super::rows::{Motion, lanes};
use crate::interaction::contact::{Contact, Histogram};
use crate::lane::Real;
use crate::strands::Model;
use std::ops::Range;

/// Number of chunks of blocks. It is fixed, so that results do not depend on the number of threads.
pub(super) const CHUNKS: usize = 64;
/// Number of pairs that are collected before they are followed.
const PAIRS: usize = 256;
/// Maximum margins of the bounding balls of active segments and of all others, relative to
/// [`search_edge`](super::search_edge). The margin is the difference between the radius and half
/// the length. A few active segments move farther than this bound; their contacts are found only
/// near their position in the middle of the slice. The second bound is smaller, because segments
/// that are not active have little residual motion, unless more segments move fast than the budget
/// allows.
pub const REACH: [f32; 2] = [1.25, 0.25];

/// A range of blocks.
#[derive(Debug)]
pub(crate) struct Chunk {
    blocks: Range<usize>,
    /// The active segments.
    pub active: Vec<Entry>,
    buffers: RowBuffers,
    /// Contacts of all segments with active ones.
    pub found: Vec<Contact>,
    approaches: Histogram,
}

/// Splits the blocks of `model` into chunks, whose number does not depend on the number of threads.
pub(super) fn chunks<T: Real>(model: &Model<T>) -> Vec<Chunk> {
    let chunk = |blocks| Chunk {
        blocks,
        active: Vec::new(),
        buffers: RowBuffers::default(),
        found: Vec::new(),
        approaches: Histogram::default(),
    };
    model.parts(CHUNKS).map(chunk).collect()
}

impl Chunk {
    pub fn bytes(&self) -> usize {
        self.active.capacity() * size_of::<Entry>()
            + self.buffers.bytes()
            + self.found.capacity() * size_of::<Contact>()
            + self.approaches.bytes()
    }

    /// Collects the active segments.
    pub fn collect_active<T: Real>(
        &mut self,
        model: &Model<T>,
        motion: &Motion<'_>,
        compute_segments: ComputeSegments,
    ) {
        self.active.clear();
        for block in &model.blocks[self.blocks.clone()] {
            for place in block.first..block.first + block.particles - 1 {
                let active = motion.active_lanes(place, block.live);
                if active == 0 {
                    continue;
                }
                // SAFETY: `compute_segments_for` returns only functions that the processor
                // supports.
                let counted =
                    unsafe { compute_segments(motion, [place, block.live], active, &mut self.buffers) };
                let entry = |lane| self.buffers.segments.entry(place, lane);
                self.active.extend(lanes(active & counted).map(entry));
            }
        }
    }

    /// Finds the contacts of the segments with active ones. Where more than `2 * most` are found,
    /// only the `most` with the largest approach are kept.
    pub fn search<T: Real>(
        &mut self,
        model: &Model<T>,
        search: &Search<'_>,
        search_place: SearchPlace,
        most: usize,
        follower: &Follower<'_, T>,
    ) {
        self.found.clear();
        self.buffers.pairs.clear();
        let mut paths = Paths::default();
        for block in &model.blocks[self.blocks.clone()] {
            for place in block.range() {
                // SAFETY: `search_place_for` returns only functions that the processor supports.
                unsafe { search_place(search, block, place, &mut self.buffers) };
                if self.buffers.pairs.len() >= PAIRS {
                    follower.follow(&self.buffers.pairs, &mut paths, &mut self.found);
                    self.buffers.pairs.clear();
                }
                if self.found.len() > 2 * most {
                    keep_fastest(&mut self.found, most, &mut self.approaches);
                }
            }
        }
        follower.follow(&self.buffers.pairs, &mut paths, &mut self.found);
    }
}
