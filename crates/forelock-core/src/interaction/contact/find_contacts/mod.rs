//! Finds the segments that come too near each other in a frame.
//!
//! # Theory
//! Two segments of different strands, each moving straight from where it was to where it is, touch at the first time at
//! which they are nearer than the contact distance, or at the start if they are so already and approach. What counts is
//! less for strands that lie nearer at rest: hair must be able to go back to its rest shape.
//!
//! # Practice
//! A frame is cut into as many slices, at most four, as it takes for typical hair to stray from the drift about it by less than an edge in each, and for all but one particle in 512 by less than two.
//! In the middle of a slice each active segment, and each other near one, is a ball: about its middle, as large as half its length, half the contact
//! distance and what it strays in half a slice. All are sorted by the cell of their middle, layer by layer, their fields side by side
//! (`cells`), so that what is within reach of an active one lies in a few runs of memory. Of the runs those pass, many at a time, whose balls meet, and
//! then whose segments are not farther apart than what they move along the line between them (`pairs`). The few that are left are followed through the
//! slice step by step, by no more than their distance allows (`meet`). All goes in parallel; the order in which contacts come does not depend on threads.

mod cells;
mod meet;
mod pairs;

pub use cells::{PIECE, PIECES, REACH};
pub use meet::{CLOSE, REST_SHARE, STEPS};

use crate::interaction::contact::{Contact, ContactParams, Drift, Farthest, Histogram, Ways};
use crate::lane::Real;
use crate::lane::Simd;
use crate::strands::Model;
use cells::{Cells, Chunk, Marks, Shelf};
use rayon::prelude::*;
use std::cmp::Ordering;

/// WGSL of the work strand by strand: displacements, mean motion, entries of cells.
pub const STRANDS_WGSL: &str = include_str!("strands.wgsl");
/// WGSL that selects active segments and lays out the cells.
pub const ACTIVE_WGSL: &str = include_str!("active.wgsl");
/// WGSL that searches the pairs of a slice.
pub const PAIRS_WGSL: &str = include_str!("pairs.wgsl");
/// WGSL that selects contacts within the budget and creates their joints.
pub const BUDGET_WGSL: &str = include_str!("budget.wgsl");

/// Length of the search over the contact distance, at least.
const EDGE_PER_DISTANCE: f64 = 8.0;
/// Slices of a frame at most.
pub const SLICES: u32 = 4;
/// Contacts in the budget for each particle whose segments' contacts are sought.
pub const SEGMENT_CONTACTS: usize = 8;
/// One in so many particles may stray farther than slices are made for.
pub const FEW: usize = 512;
/// Motion in a frame, over the contact distance, that is none.
pub(crate) const SLOP: f32 = 2e-3;

/// Finds contacts; holds the scratch for it.
#[derive(Debug)]
pub(crate) struct Finder {
    /// See [`search_edge`].
    edge: f32,
    test: pairs::Test,
    chunks: Vec<Chunk>,
    shelf: Shelf,
    marks: Marks,
    found: Vec<Contact>,
    approaches: Histogram,
}

/// A part of the frame, as the search sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slice {
    /// Its start and end, as fractions of the frame.
    pub span: [f32; 2],
    /// The contact distance, metres.
    pub distance: f32,
    /// What two may approach in a frame and be let pass, metres.
    pub slip: f32,
    /// Which segments are active: contacts of theirs are sought.
    pub active: Farthest,
}

impl Slice {
    pub fn middle(&self) -> f32 {
        0.5 * (self.span[0] + self.span[1])
    }

    pub fn length(&self) -> f32 {
        self.span[1] - self.span[0]
    }
}

impl Finder {
    pub fn new<T: Real>(model: &Model<T>, params: &ContactParams, simd: Simd) -> Self {
        Self {
            edge: search_edge(model, params),
            test: pairs::test_for(simd),
            chunks: cells::chunks(model),
            shelf: Shelf::default(),
            marks: Marks::default(),
            found: Vec::new(),
            approaches: Histogram::default(),
        }
    }

    pub fn bytes(&self) -> usize {
        let chunks: usize = self.chunks.iter().map(Chunk::bytes).sum();
        let found = self.found.capacity() * size_of::<Contact>() + self.approaches.bytes();
        chunks + self.shelf.bytes() + self.marks.bytes() + found
    }

    /// What touches an active segment in the frame, slice by slice; a pair may come once a slice, the first time counts.
    pub fn find<T: Real>(
        &mut self,
        model: &Model<T>,
        (params, dt_secs): (&ContactParams, f64),
        ways: &Ways,
        drift: &Drift,
    ) -> &[Contact] {
        self.found.clear();
        let budget = params.budget as usize;
        let Some((slice, slices)) = self.first_slice(model, (params, dt_secs), drift) else {
            return &self.found;
        };
        let cells = Cells::around(drift.extent, self.edge);
        for k in 0..slices {
            let span = [k, k + 1].map(|k| k as f32 / slices as f32);
            let slice = Slice { span, ..slice };
            self.marks.clear();
            let (chunks, marks) = (&mut self.chunks, &self.marks);
            chunks.par_iter_mut().for_each(|chunk| chunk.enter_active(model, ways, &slice, (&cells, marks)));
            if chunks.iter().all(Chunk::is_quiet) {
                continue;
            }
            chunks.par_iter_mut().for_each(|chunk| chunk.enter_others(model, ways, &slice, (&cells, marks)));
            self.shelf.take(chunks, &cells);
            let (shelf, how) = (&self.shelf, (self.test, slice.distance, budget));
            chunks.par_iter_mut().for_each(|chunk| {
                chunk.search(shelf, how, |pair| meet::follow(model, ways, &slice, pair));
            });
            for chunk in chunks {
                self.found.extend_from_slice(&chunk.found);
            }
            keep_fastest(&mut self.found, budget, &mut self.approaches);
        }
        &self.found
    }

    /// The first slice of a frame, and how many there are; none if nothing strays.
    fn first_slice<T: Real>(
        &self,
        model: &Model<T>,
        (params, dt_secs): (&ContactParams, f64),
        drift: &Drift,
    ) -> Option<(Slice, u32)> {
        let distance = params.distance as f32;
        let slip = params.let_pass(dt_secs);
        let active = drift.farthest(params.budget as usize / SEGMENT_CONTACTS, 0.5 * slip);
        let (typical, most) = drift.strays;
        if most <= active.least {
            return None;
        }
        let most = drift.exceeded_by(model.particle_count / FEW);
        let slices = (typical / self.edge).max(most / (2.0 * self.edge)).ceil().clamp(1.0, SLICES as f32);
        Some((Slice { span: [0.0, 1.0 / slices], distance, slip, active }, slices as u32))
    }
}

/// The length that the search is made for: the mean length of an edge, or several times the contact distance. Metres.
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

/// Leaves at most `most` contacts: those of the greatest approach, otherwise the first. `approaches` is scratch.
fn keep_fastest(found: &mut Vec<Contact>, most: usize, approaches: &mut Histogram) {
    if found.len() <= most {
        return;
    }
    approaches.clear();
    found.iter().for_each(|contact| approaches.add(contact.approach));
    let last = approaches.last_of(most);
    let mut room = last.room;
    found.retain(|contact| match last.against(contact.approach) {
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
