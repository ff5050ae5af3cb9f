//! Finds the segments that come too near each other in a frame.
//!
//! # Theory
//! Two segments of different strands, each moving straight from where it was to where it is, touch at the first time at
//! which they are nearer than the contact distance, or at the start if they are so already and approach. What counts is
//! less for strands that lie nearer at rest: hair must be able to go back to its rest shape.
//!
//! # Practice
//! A frame is cut into as many slices as it takes for hair to stray from the drift about it by less than an edge in each.
//! In the middle of a slice each active segment, and each other near one, is a ball: about its middle, as large as half its length, half the contact
//! distance and what it strays in half a slice. All are sorted by the cell of their middle, layer by layer, their fields side by side
//! ([`cells`]), so that what is within reach of an active one lies in a few runs of memory. Of the runs those pass, many at a time, whose balls meet, and
//! then whose segments are not farther apart than what they move along the line between them ([`pairs`]). The few that are left are followed through the
//! slice step by step, by no more than their distance allows ([`meet`]). All goes in parallel; the order in which contacts come does not depend on threads.

mod cells;
mod meet;
mod pairs;

use crate::contact::{Contact, ContactParams, Drift, Farthest, Histogram, Ways};
use crate::lane::Real;
use crate::model::Model;
use crate::solver::Simd;
use cells::{Cells, Chunk, Layer, Marks, Shelf};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Length of the search over the contact distance, at least.
const EDGE_PER_DISTANCE: f64 = 8.0;
/// Slices of a frame at most.
const SLICES: u32 = 4;
/// Contacts in the budget for each segment of which they are sought.
const SEGMENT_CONTACTS: usize = 8;
/// One in so many particles may stray farther than slices are made for.
const FEW: usize = 512;
/// Motion in a frame, over the contact distance, that is none.
const SLOP: f32 = 2e-3;

/// Finds contacts; holds the scratch for it.
#[derive(Debug)]
pub(crate) struct Finder {
    /// The mean length of an edge, metres.
    edge: f32,
    test: pairs::Test,
    chunks: Vec<Chunk>,
    layers: Vec<Layer>,
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
        let (mut sum, mut edges) = (0.0, 0.0);
        for block in &model.blocks {
            for lane in 0..block.live {
                let length = |place: usize| model.rest_lengths[3 * place].0[lane].to_f64().unwrap_or(0.0);
                sum += block.range().map(length).sum::<f64>();
                edges += block.particles as f64 - 1.0;
            }
        }
        let edge = f64::max(sum / f64::max(edges, 1.0), EDGE_PER_DISTANCE * params.distance);
        Self {
            edge: edge as f32,
            test: pairs::test_for(simd),
            chunks: cells::chunks(model),
            layers: Vec::new(),
            marks: Marks::default(),
            found: Vec::new(),
            approaches: Histogram::default(),
        }
    }

    pub fn bytes(&self) -> usize {
        let chunks: usize = self.chunks.iter().map(Chunk::bytes).sum();
        let layers: usize = self.layers.iter().map(Layer::bytes).sum();
        let found = self.found.capacity() * size_of::<Contact>() + self.approaches.bytes();
        chunks + layers + self.marks.bytes() + found
    }

    /// Everything that touches in the frame, slice by slice; a pair may come more than once, the first time counts.
    pub fn find<T: Real>(
        &mut self,
        model: &Model<T>,
        (params, dt_secs): (&ContactParams, f64),
        ways: &Ways,
        drift: &Drift,
    ) -> &[Contact] {
        self.found.clear();
        let distance = params.distance as f32;
        let slip = ((params.slip * dt_secs) as f32).max(SLOP * distance);
        let budget = params.budget as usize;
        let active = drift.farthest(budget / SEGMENT_CONTACTS, 0.5 * slip);
        let (typical, most) = drift.strays;
        if most <= active.least {
            return &self.found;
        }
        let most = drift.exceeded_by(model.particle_count / FEW);
        let cells = Cells::around(drift.extent, self.edge);
        let slices = (typical / self.edge).max(most / (4.0 * self.edge)).ceil().clamp(1.0, SLICES as f32);
        let count = cells.layers();
        if self.layers.len() < count {
            self.layers.resize_with(count, Layer::default);
        }
        for k in 0..slices as u32 {
            let span = [k as f32 / slices, (k + 1) as f32 / slices];
            let slice = Slice { span, distance, slip, active };
            self.marks.clear();
            let (chunks, marks) = (&mut self.chunks, &self.marks);
            chunks.par_iter_mut().for_each(|chunk| chunk.enter_active(model, ways, &slice, (&cells, marks)));
            if chunks.iter().all(Chunk::is_quiet) {
                continue;
            }
            chunks.par_iter_mut().for_each(|chunk| chunk.enter_others(model, ways, &slice, (&cells, marks)));
            let layers = &mut self.layers[..count];
            layers.par_iter_mut().enumerate().for_each(|(k, layer)| layer.take(k, chunks, &cells));
            let (shelf, test) = (Shelf { cells: &cells, layers, distance }, self.test);
            chunks.par_iter_mut().for_each(|chunk| {
                chunk.search(&shelf, test, |pair| meet::follow(model, ways, &slice, pair));
            });
            for chunk in chunks {
                self.found.extend_from_slice(&chunk.found);
            }
        }
        self.keep_fastest(budget);
        &self.found
    }

    /// Leaves at most `most` contacts: those of the greatest approach, otherwise the first.
    fn keep_fastest(&mut self, most: usize) {
        if self.found.len() <= most {
            return;
        }
        self.approaches.clear();
        self.found.iter().for_each(|contact| self.approaches.add(contact.approach));
        let last = self.approaches.last_of(most);
        let mut room = last.room;
        self.found.retain(|contact| match last.against(contact.approach) {
            Ordering::Greater => true,
            Ordering::Less => false,
            Ordering::Equal => {
                let fits = room > 0;
                room -= usize::from(fits);
                fits
            }
        });
    }
}
