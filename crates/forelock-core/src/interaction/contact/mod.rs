//! Contacts between segments of different strands: what they are found in, and what they are.
//!
//! # Theory
//! The grid keeps dense hair from being pressed together, but locks that cross slip through it. So segments meet one by
//! one as well (AMS, Sec. 3.2, after McAdams 2009): those that come too near in a frame are found
//! (`stage::find_contacts`), and what brought them there is taken from their motion, without
//! bounce and with Coulomb friction (`stage::resolve_contacts`).
//!
//! # Practice
//! Between frames hair moves much farther than it is thick, so what counts is the way of each pair from the frame's
//! start to its end, in the head's frame, taken as straight. Most of that way is common to neighbours: `Drift` is a
//! smooth field of it. Only what a segment moves against the drift makes it reach farther in the search, so that hair
//! that swings together costs no more than hair at rest. Contacts are sought only of segments that stray from the drift faster
//! than half of [`ContactParams::slip`], fastest first, and [`ContactParams::budget`] bounds the work.
//!
//! # Limitations
//! Strands do not meet themselves. Where more than [`RUN_SEGMENTS`] segments lie side by side in a row of cells, those at the ends are left to the grid.

pub mod drift;
mod exchange;
pub mod fastest;
pub mod find_contacts;
mod params;
pub mod resolve_contacts;
mod ways;

pub use crate::frame::ContactReport;
pub(crate) use drift::{Drift, Farthest};
pub(crate) use exchange::ContactInteraction;
pub use exchange::EXCHANGE;
pub(crate) use fastest::Histogram;
pub use params::ContactParams;
pub(crate) use ways::{Ways, closest};

use crate::lane::Simd;
use crate::lane::{LANES, Real, Row};
use crate::pose::Pose;
use crate::strands::Model;
use glam::Vec3;

/// WGSL that the kernels of contacts share.
pub const WGSL: &str = include_str!("contact.wgsl");
/// WGSL that lays out a table of cells by counting; the neighbour search of SPH uses it too.
pub const TABLE_WGSL: &str = include_str!("table.wgsl");

/// Segments in a row of cells of the search that one segment is tested against, at most.
pub const RUN_SEGMENTS: usize = 4096;
/// No segment, no particle.
pub(crate) const NONE: u32 = u32::MAX;

/// Two segments that come too near. A segment bears the number of its lower particle: its place × [`LANES`] + lane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Contact {
    /// The segments, the lower number first.
    pub segments: [u32; 2],
    /// Where on each they meet, 0 to 1.
    pub along: [f32; 2],
    /// From the second to the first, of length one, in the head's frame.
    pub normal: Vec3,
    /// How far apart they must stay along the normal, metres.
    pub gap: f32,
    /// When they meet, as a fraction of the frame.
    pub when: f32,
    /// How far they would approach in the whole frame, metres.
    pub approach: f32,
}

impl Contact {
    /// The particles, and the share that each has in the distance of the two points.
    pub fn particles(&self) -> [(u32, f32); 4] {
        let ([a, b], [s, t]) = (self.segments, self.along);
        let next = LANES as u32;
        [(a, 1.0 - s), (a + next, s), (b, t - 1.0), (b + next, -t)]
    }
}

/// Positions, velocities and clearances of the state, `[3 × places]`, `[3 × places]` and `[places]` rows.
pub type Rows<'a, T> = (&'a mut [Row<T>], &'a mut [Row<T>], &'a mut [Row<T>]);

/// Contacts and their scratch.
#[derive(Debug)]
pub struct Contacts {
    params: ContactParams,
    ways: Ways,
    drift: Drift,
    finder: find_contacts::Finder,
    resolver: resolve_contacts::Resolver,
}

impl Contacts {
    /// Contacts for the strands of `model`, found with the instruction set `simd`.
    pub fn new<T: Real>(model: &Model<T>, params: &ContactParams, simd: Simd) -> Self {
        Self {
            params: params.clone(),
            ways: Ways::new(model),
            drift: Drift::default(),
            finder: find_contacts::Finder::new(model, params, simd),
            resolver: resolve_contacts::Resolver::default(),
        }
    }

    /// Their parameters.
    pub fn params(&self) -> &ContactParams {
        &self.params
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.ways.bytes() + self.drift.bytes() + self.finder.bytes() + self.resolver.bytes()
    }

    /// Notes where the hair is at the frame's start. `head` brings the head's frame, about the model's centre, to where
    /// positions are.
    pub fn note_start<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], head: &Pose) {
        self.ways.note_start(model, positions, head);
    }

    /// Finds what met since the start was noted and resolves it: changes positions and velocities of all particles but
    /// the first `clamped` of each strand, and takes what they moved from their clearance. `head` as it is now; the frame took `dt_secs`.
    pub fn resolve<T: Real>(
        &mut self,
        model: &Model<T>,
        (positions, velocities, clearance): Rows<'_, T>,
        head: &Pose,
        (clamped, dt_secs): (usize, f64),
    ) -> ContactReport {
        let clock = std::time::Instant::now();
        self.ways.note_end(model, positions, head);
        self.drift.measure(model, &mut self.ways);
        let found = self.finder.find(model, (&self.params, dt_secs), &self.ways, &self.drift);
        let secs = clock.elapsed().as_secs_f64();
        let mut report = self.resolver.resolve(
            &self.params,
            (model, found, &self.ways),
            (positions, velocities, clearance),
            head,
            (clamped, dt_secs),
        );
        report.secs = [secs, clock.elapsed().as_secs_f64() - secs];
        report
    }
}
