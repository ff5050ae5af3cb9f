//! Contacts between segments of different strands: their search and their resolution.
//!
//! # Theory
//! The grid resists the compression of dense hair, but locks that cross pass through each other on
//! it. Therefore contacts between single segments are resolved as well (AMS, Sec. 3.2, after
//! McAdams 2009): segments that come too near during a frame are found ([`find_contacts`]), and
//! their approach is removed from their motion, without bounce and with Coulomb friction
//! ([`resolve_contacts`]).
//!
//! # Practice
//! In a frame hair moves much farther than it is thick, so what is tested is the displacement of
//! each pair from the start of the frame to its end, in the frame of the head, taken as linear in
//! time. Neighbours share most of that displacement: `MeanMotion` is a smooth field of it. Only the
//! residual motion of a segment, relative to the mean motion, extends its reach in the search, so
//! hair that swings together costs no more than hair at rest. Contacts are searched only for
//! segments whose residual motion is faster than half of [`ContactParams::slip`], fastest first,
//! and [`ContactParams::budget`] bounds the work. Slower hair is held by friction ([`hold_hair`]).
//!
//! # Limitations
//! There is no self-collision of strands. Sixteen neighbouring segments are tested against about
//! [`find_contacts::MOST_NEAR`] active ones at most; on a GPU each active segment is tested against
//! a bounded number of segments in a row of cells. Where hair is denser, the rest is left to the
//! grid.

mod displacements;
mod exchange;
pub mod find_contacts;
pub mod histogram;
pub mod hold_hair;
pub mod mean_motion;
mod params;
pub mod resolve_contacts;

pub use crate::frame::ContactReport;
pub(crate) use displacements::{Displacements, closest};
pub(crate) use exchange::ContactInteraction;
pub use exchange::{EXCHANGE, FRICTION};
pub(crate) use histogram::Histogram;
pub(crate) use mean_motion::{LargestResiduals, MeanMotion};
pub use params::{CREEP_SECS, ContactParams};

use crate::lane::Simd;
use crate::lane::{LANES, Real, Row};
use crate::pose::Pose;
use crate::strands::Model;
use glam::Vec3;

/// WGSL shared by the kernels of contacts.
pub const WGSL: &str = include_str!("contact.wgsl");
/// WGSL that sorts entries into a table of cells by counting; the neighbour search of SPH uses it
/// too.
pub const TABLE_WGSL: &str = include_str!("table.wgsl");

/// Marks a missing segment or particle.
pub(crate) const NONE: u32 = u32::MAX;

/// Two segments that come too near. The number of a segment is that of its lower particle: place ×
/// [`LANES`] + lane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Contact {
    /// The segments, the lower number first.
    pub segments: [u32; 2],
    /// Position of the contact on each segment, 0 to 1.
    pub along: [f32; 2],
    /// Unit normal from the second segment to the first, in the frame of the head.
    pub normal: Vec3,
    /// Minimum distance along the normal, metres.
    pub gap: f32,
    /// Time of the contact, as a fraction of the frame.
    pub when: f32,
    /// Approach along the normal over the whole frame, metres.
    pub approach: f32,
}

impl Contact {
    /// The four particles, and their weights in the difference of the two contact points.
    pub fn particles(&self) -> [(u32, f32); 4] {
        let ([a, b], [s, t]) = (self.segments, self.along);
        let next = LANES as u32;
        [(a, 1.0 - s), (a + next, s), (b, t - 1.0), (b + next, -t)]
    }
}

/// Rows of the state that contacts change.
#[derive(Debug)]
pub struct ParticleRows<'a, T> {
    /// Positions, `[3 × places]` rows.
    pub positions: &'a mut [Row<T>],
    /// Velocities, `[3 × places]` rows.
    pub velocities: &'a mut [Row<T>],
    /// Clearances, `[places]` rows.
    pub clearance: &'a mut [Row<T>],
}

/// What contacts need of a frame.
#[derive(Clone, Copy, Debug)]
pub struct ContactMoment<'a> {
    /// Pose of the head at the end of the frame, about the centre of the model.
    pub head: &'a Pose,
    /// Particles of each strand, counted from the root, that are clamped to the head.
    pub clamped: usize,
    /// Length of the frame, seconds.
    pub dt_secs: f64,
}

/// Contacts and their buffers.
#[derive(Debug)]
pub struct Contacts {
    params: ContactParams,
    displacements: Displacements,
    mean_motion: MeanMotion,
    friction: hold_hair::Friction,
    finder: find_contacts::Finder,
    resolver: resolve_contacts::Resolver,
}

impl Contacts {
    /// Creates the contacts for the strands of `model`; the search uses the instruction set `simd`.
    pub fn new<T: Real>(model: &Model<T>, params: &ContactParams, simd: Simd) -> Self {
        let displacements = Displacements::new(model);
        let mean_motion = MeanMotion::for_edges(displacements.longest);
        Self {
            params: params.clone(),
            displacements,
            mean_motion,
            friction: hold_hair::Friction::new(model),
            finder: find_contacts::Finder::new(model, params, simd),
            resolver: resolve_contacts::Resolver::default(),
        }
    }

    /// The parameters.
    pub fn params(&self) -> &ContactParams {
        &self.params
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.displacements.bytes()
            + self.mean_motion.bytes()
            + self.friction.bytes()
            + self.finder.bytes()
            + self.resolver.bytes()
    }

    /// Records the positions at the start of the frame. `head` maps the frame of the head, about
    /// the centre of the model, to the frame of `positions`.
    pub fn record_start<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], head: &Pose) {
        self.displacements.record_start(model, positions, head);
    }

    /// Holds what moved slowly relative to its neighbours since
    /// [`record_start`](Self::record_start), up to `acceleration`, m/s²: changes positions and
    /// velocities of all particles except the clamped ones, and subtracts the distances from their
    /// clearances.
    pub fn hold<T: Real>(
        &mut self,
        model: &Model<T>,
        rows: ParticleRows<'_, T>,
        moment: &ContactMoment<'_>,
        acceleration: f64,
    ) {
        self.displacements.record_end(model, rows.positions, moment.head);
        self.friction.hold(model, &self.displacements, rows, moment, acceleration);
    }

    /// Finds the contacts since [`record_start`](Self::record_start) and resolves them: changes
    /// positions and velocities of all particles except the clamped ones, and subtracts the
    /// distances that particles moved from their clearances.
    pub fn resolve<T: Real>(
        &mut self,
        model: &Model<T>,
        rows: ParticleRows<'_, T>,
        moment: &ContactMoment<'_>,
    ) -> ContactReport {
        let found = self.find(model, rows.positions, moment);
        if found.contacts == 0 { found } else { self.resolve_found(model, rows, moment, found) }
    }

    /// Finds the contacts since [`record_start`](Self::record_start). Returns their number and the
    /// time it took.
    pub fn find<T: Real>(
        &mut self,
        model: &Model<T>,
        positions: &[Row<T>],
        moment: &ContactMoment<'_>,
    ) -> ContactReport {
        let clock = std::time::Instant::now();
        self.displacements.record_end(model, positions, moment.head);
        let least = find_contacts::least_residual(&self.params, moment.dt_secs);
        self.mean_motion.measure(model, &mut self.displacements, least);
        self.finder.find(model, &self.params, moment.dt_secs, &self.displacements, &self.mean_motion);
        let secs = [clock.elapsed().as_secs_f64(), 0.0];
        ContactReport { contacts: self.finder.found().len(), secs, ..ContactReport::default() }
    }

    /// The contacts that [`resolve_found`](Self::resolve_found) has resolved last; none if none
    /// were found since.
    pub(crate) fn resolved(&self) -> impl Iterator<Item = &Contact> {
        self.resolver.kept(self.finder.found())
    }

    /// The blocks whose strands [`resolve_found`](Self::resolve_found) has moved last; some more
    /// than once.
    pub(crate) fn moved_blocks(&self) -> impl Iterator<Item = usize> {
        self.resolver.moved_blocks()
    }

    /// Resolves the contacts that [`find`](Self::find) has just found, as
    /// [`resolve`](Self::resolve) does.
    pub fn resolve_found<T: Real>(
        &mut self,
        model: &Model<T>,
        rows: ParticleRows<'_, T>,
        moment: &ContactMoment<'_>,
        found: ContactReport,
    ) -> ContactReport {
        let clock = std::time::Instant::now();
        let Self { params, displacements, finder, resolver, .. } = self;
        let report = resolver.resolve(params, model, finder.found(), displacements, rows, moment);
        ContactReport { secs: [found.secs[0], clock.elapsed().as_secs_f64()], ..report }
    }
}
