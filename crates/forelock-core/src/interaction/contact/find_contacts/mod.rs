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
//! particles is shorter than two edges. In the middle of a slice each segment is bounded by a
//! capsule: its margin, or reach, is half the contact distance and half the residual motion in the
//! slice. The active segments are sorted along a space-filling curve, with a tree of boxes over
//! them (`tree`). All other segments need no sorting, since neighbouring strands lie side by side
//! in the lanes of a row: the bounds of sixteen segments (`rows`) select the active segments near
//! them from the tree. Each of these is tested against the sixteen at a time: first whether they
//! pass each other closely, then whether they approach and capsule and ball touch, then whether
//! their distance exceeds their displacements along the line between them (`pairs`). The few that
//! remain are advanced through the slice conservatively, in steps that their distance allows
//! (`follow`). All of this runs in parallel; the order of contacts does not depend on the number of
//! threads.

mod chunk;
mod follow;
mod pairs;
mod rows;
mod tree;

pub use chunk::REACH;
pub use follow::{CLOSE, REST_SHARE, STEPS};
pub use tree::MOST_NEAR;

use crate::interaction::contact::{
    Contact, ContactParams, Displacements, Histogram, LargestResiduals, MeanMotion,
};
use crate::lane::Real;
use crate::lane::Simd;
use crate::strands::Model;
use chunk::Chunk;
use follow::Follower;
use pairs::{Entry, Search};
use rayon::prelude::*;
use rows::Motion;
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
    chunks: Vec<Chunk>,
    /// The active segments.
    tree: Tree,
    /// A buffer of active segments.
    active: Vec<Entry>,
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
            simd: simd.resolve(),
            chunks: chunk::chunks(model),
            tree: Tree::default(),
            active: Vec::new(),
            found: Vec::new(),
            approaches: Histogram::default(),
        }
    }

    pub fn bytes(&self) -> usize {
        let chunks: usize = self.chunks.iter().map(Chunk::bytes).sum();
        let found = self.found.capacity() * size_of::<Contact>() + self.approaches.bytes();
        chunks + self.tree.bytes() + self.active.capacity() * size_of::<Entry>() + found
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
        let (segments, search_place) =
            (pairs::compute_segments_for(self.simd), pairs::search_place_for(self.simd));
        for k in 0..slices {
            let span = [k, k + 1].map(|k| k as f32 / slices as f32);
            let slice = Slice { span, ..slice };
            let motion = Motion { displacements, slice: &slice, extent: mean_motion.extent, edge: self.edge };
            let chunks = &mut self.chunks;
            chunks.par_iter_mut().for_each(|chunk| chunk.collect_active(model, &motion, segments));
            let lists = chunks.iter().map(|chunk| &*chunk.active);
            self.tree.build(lists, mean_motion.extent, &mut self.active);
            if self.tree.entries.is_empty() {
                continue;
            }
            // Less, for rounding.
            let slip = 0.999 * slice.length() * slice.slip;
            let search = Search { motion, tree: &self.tree, slip };
            let follower = Follower::new(model, displacements, &slice, self.simd);
            chunks.par_iter_mut().for_each(|chunk| {
                chunk.search(model, &search, search_place, budget, &follower);
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

/// Keeps the `most` contacts with the largest approach; of those in the last bin of the histogram
/// an evenly spread share, since contacts that follow each other lie side by side. `approaches` is
/// a buffer.
fn keep_fastest(found: &mut Vec<Contact>, most: usize, approaches: &mut Histogram) {
    if found.len() <= most {
        return;
    }
    approaches.clear();
    found.iter().for_each(|contact| approaches.add(contact.approach));
    let last = approaches.cutoff(most);
    let mut seen = 0;
    found.retain(|contact| match last.compare(contact.approach) {
        Ordering::Greater => true,
        Ordering::Less => false,
        Ordering::Equal => {
            let selected = |seen: usize| seen * last.selected / last.count;
            seen += 1;
            selected(seen) > selected(seen - 1)
        }
    });
}

#[cfg(test)]
mod tests;
