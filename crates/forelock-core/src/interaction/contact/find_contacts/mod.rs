//! Finds the segments that come too near each other in a frame.
//!
//! # Theory
//! Two segments of different strands, each in linear motion from its start to its end position,
//! touch at the first time at which they are nearer than the contact distance, or at the start if
//! they are nearer already and approach. The contact distance is smaller for strands that are
//! closer at rest: hair must be able to return to its rest shape.
//!
//! # Practice
//! A frame is divided into up to four time slices. Their number is chosen so that in each slice the
//! residual motion of typical hair is shorter than an edge, and that of all but one in 512
//! particles is shorter than two edges. In the middle of a slice each active segment is bounded by
//! a capsule, and so is each other segment near one (`marks`): their margin, or reach, is half the
//! contact distance and half the residual motion in the slice. The capsules are sorted along a
//! space-filling curve into groups of sixteen, with a tree of boxes over them (`tree`). An active
//! segment visits the groups whose boxes touch its own, and is tested against sixteen segments at a
//! time: first whether capsule and ball touch, then whether the segments approach and pass each
//! other closely, then whether their distance exceeds their displacements along the line between
//! them (`pairs`). The few that remain are advanced through the slice conservatively, in steps that
//! their distance allows (`follow`). All of this runs in parallel; the order of contacts does not
//! depend on the number of threads.

mod cells;
mod chunk;
mod follow;
mod marks;
mod pairs;
mod tree;

pub use chunk::{PIECE, PIECES, REACH};
pub use follow::{CLOSE, REST_SHARE, STEPS};

use crate::interaction::contact::{
    Contact, ContactParams, Displacements, Histogram, LargestResiduals, MeanMotion,
};
use crate::lane::Real;
use crate::lane::Simd;
use crate::strands::Model;
use cells::Cells;
use chunk::{CHUNKS, Chunk, Motion};
use follow::Follower;
use marks::Marks;
use pairs::Entry;
use rayon::prelude::*;
use std::cmp::Ordering;
use tree::Tree;

/// WGSL of the kernels that run strand by strand: displacements, mean motion, entries of cells.
pub const STRANDS_WGSL: &str = include_str!("strands.wgsl");
/// WGSL that selects active segments and lays out the cells.
pub const ACTIVE_WGSL: &str = include_str!("active.wgsl");
/// WGSL that searches the pairs of a slice.
pub const PAIRS_WGSL: &str = include_str!("pairs.wgsl");
/// WGSL that selects contacts within the budget and creates their joints.
pub const BUDGET_WGSL: &str = include_str!("budget.wgsl");

/// Side of the cells that are marked near active segments, relative to [`search_edge`].
const CELL: f32 = 1.0;
/// Minimum length scale of the search, relative to the contact distance.
const EDGE_PER_DISTANCE: f64 = 8.0;
/// Maximum number of slices of a frame.
pub const SLICES: u32 = 4;
/// Contacts in the budget for each active particle.
pub const SEGMENT_CONTACTS: usize = 4;
/// One in this number of particles may exceed the residual motion for which the number of slices is
/// chosen.
pub const FEW: usize = 512;
/// Approach in a frame that is ignored, relative to the contact distance.
pub(crate) const SLOP: f32 = 2e-3;

/// Finds contacts; holds the buffers of the search.
#[derive(Debug)]
pub(crate) struct Finder {
    /// See [`search_edge`].
    edge: f32,
    simd: Simd,
    test: pairs::Test,
    chunks: Vec<Chunk>,
    /// The active segments and those near them.
    tree: Tree,
    marks: Marks,
    found: Vec<Contact>,
    approaches: Histogram,
}

/// A time slice of the frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slice {
    /// Start and end, as fractions of the frame.
    pub span: [f32; 2],
    /// The contact distance, metres.
    pub distance: f32,
    /// Approach in a frame below which contacts are ignored, metres.
    pub slip: f32,
    /// Selects the active segments, for which contacts are searched.
    pub active: LargestResiduals,
}

impl Slice {
    pub fn middle(&self) -> f32 {
        0.5 * (self.span[0] + self.span[1])
    }

    pub fn length(&self) -> f32 {
        self.span[1] - self.span[0]
    }

    /// Margin of the bounding ball of a segment: half the contact distance and half its
    /// `residual_motion` in the slice, up to a bound. Metres.
    pub fn reach(&self, residual_motion: f32, is_active: bool, edge: f32) -> f32 {
        let [base, slope, most] = self.reach_terms(is_active, edge);
        (base + slope * residual_motion).min(most)
    }

    /// The reach at a residual motion of 0, its increase with it, and its upper bound.
    fn reach_terms(&self, is_active: bool, edge: f32) -> [f32; 3] {
        // A margin: the mean motions of the two segments of a pair differ slightly.
        let slope = 1.25 * 0.5 * self.length();
        [0.5 * self.distance, slope, REACH[usize::from(!is_active)] * edge]
    }
}

impl Finder {
    pub fn new<T: Real>(model: &Model<T>, params: &ContactParams, simd: Simd) -> Self {
        Self {
            edge: search_edge(model, params),
            simd,
            test: pairs::test_for(simd),
            chunks: chunk::chunks(model),
            tree: Tree::default(),
            marks: Marks::default(),
            found: Vec::new(),
            approaches: Histogram::default(),
        }
    }

    pub fn bytes(&self) -> usize {
        let chunks: usize = self.chunks.iter().map(Chunk::bytes).sum();
        let found = self.found.capacity() * size_of::<Contact>() + self.approaches.bytes();
        chunks + self.tree.bytes() + self.marks.bytes() + found
    }

    /// Finds the contacts of active segments in the frame, slice by slice. A pair may appear once
    /// in each slice; the resolver uses the first.
    pub fn find<T: Real>(
        &mut self,
        model: &Model<T>,
        params: &ContactParams,
        dt_secs: f64,
        displacements: &Displacements,
        mean_motion: &MeanMotion,
    ) {
        self.found.clear();
        let budget = params.budget as usize;
        let Some((slice, slices)) = self.first_slice(model, params, dt_secs, mean_motion) else {
            return;
        };
        let cells = Cells::around(mean_motion.extent, CELL * self.edge);
        // Longer segments are in several pieces, or looked at one by one.
        let longest = (1.01 * displacements.longest).min(PIECE * self.edge);
        for k in 0..slices {
            let span = [k, k + 1].map(|k| k as f32 / slices as f32);
            let slice = Slice { span, ..slice };
            let motion = Motion { displacements, slice: &slice, cells: &cells, edge: self.edge };
            let chunks = &mut self.chunks;
            chunks.par_iter_mut().for_each(|chunk| chunk.insert_active(model, &motion));
            if chunks.iter().all(Chunk::has_no_active) {
                continue;
            }
            let widest_other = 0.5 * longest + slice.reach(slice.active.bound(), false, self.edge);
            self.marks.fit(&cells);
            let marks = &self.marks;
            chunks.par_iter().for_each(|chunk| chunk.mark(widest_other, marks));
            let near = [longest, widest_other];
            let rows = chunk::near_rows_for(self.simd);
            chunks.par_iter_mut().for_each(|chunk| chunk.insert_others(model, &motion, marks, near, rows));
            let has_pieces = chunks.iter().any(|chunk| chunk.has_pieces);
            let mut lists: [&[Entry]; 2 * CHUNKS] = [&[]; 2 * CHUNKS];
            let filled = chunks.iter().flat_map(|chunk| [&*chunk.active, &*chunk.others]);
            lists.iter_mut().zip(filled).for_each(|(list, filled)| *list = filled);
            self.tree.build(&lists, mean_motion.extent);
            let (tree, test) = (&self.tree, self.test);
            // Less, for rounding.
            let limits = [slice.distance, 0.999 * slice.length() * slice.slip];
            let follower = Follower::new(model, displacements, &slice, self.simd);
            chunks.par_iter_mut().for_each(|chunk| {
                chunk.search(tree, has_pieces, test, limits, budget, &follower);
            });
            for chunk in chunks {
                self.found.extend_from_slice(&chunk.found);
            }
            keep_fastest(&mut self.found, budget, &mut self.approaches);
        }
    }

    /// The contacts that [`find`](Self::find) found last.
    pub fn found(&self) -> &[Contact] {
        &self.found
    }

    /// The first slice of a frame, and the number of slices; `None` if there is no residual motion.
    fn first_slice<T: Real>(
        &self,
        model: &Model<T>,
        params: &ContactParams,
        dt_secs: f64,
        mean_motion: &MeanMotion,
    ) -> Option<(Slice, u32)> {
        let distance = params.distance as f32;
        let slip = params.slip_distance(dt_secs);
        let least = least_residual(params, dt_secs);
        let active = mean_motion.largest_residuals(params.budget as usize / SEGMENT_CONTACTS, least);
        let (typical, most) = (mean_motion.rms_residual, mean_motion.largest_residual);
        if most <= active.least {
            return None;
        }
        let most = mean_motion.exceeded_by(model.particle_count / FEW);
        let slices = (typical / self.edge).max(most / (2.0 * self.edge)).ceil().clamp(1.0, SLICES as f32);
        Some((Slice { span: [0.0, 1.0 / slices], distance, slip, active }, slices as u32))
    }
}

/// Residual motion in a frame of `dt_secs` up to which no contacts are searched, metres.
pub(crate) fn least_residual(params: &ContactParams, dt_secs: f64) -> f32 {
    0.5 * params.slip_distance(dt_secs)
}

/// Length scale of the search: the mean length of an edge, but at least several times the contact
/// distance. Metres.
pub fn search_edge<T: Real>(model: &Model<T>, params: &ContactParams) -> f32 {
    let (mut sum, mut edges) = (0.0, 0.0);
    for block in &model.blocks {
        for lane in 0..block.live {
            let length = |place: usize| model.rest_lengths[3 * place].0[lane].to_f64().unwrap_or(0.0);
            sum += block.range().map(length).sum::<f64>();
            edges += block.particles as f64 - 1.0;
        }
    }
    f64::max(sum / f64::max(edges, 1.0), EDGE_PER_DISTANCE * params.distance) as f32
}

/// Keeps the `most` contacts with the largest approach; of contacts with equal approach, the first.
/// `approaches` is a buffer.
fn keep_fastest(found: &mut Vec<Contact>, most: usize, approaches: &mut Histogram) {
    if found.len() <= most {
        return;
    }
    approaches.clear();
    found.iter().for_each(|contact| approaches.add(contact.approach));
    let last = approaches.cutoff(most);
    let mut room = last.selected;
    found.retain(|contact| match last.compare(contact.approach) {
        Ordering::Greater => true,
        Ordering::Less => false,
        Ordering::Equal => {
            let fits = room > 0;
            room -= usize::from(fits);
            fits
        }
    });
}

#[cfg(test)]
mod tests;
