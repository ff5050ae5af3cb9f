//! The queue of particles whose clearance is used up. They are resolved in packets.

use super::particle::{
    Particle, Sample, Solid, ccd_motion, lipschitz, resolve_ccd_hit, resolve_penetration,
    resolve_penetrations, stop_at_entry,
};
use super::sweep::may_pass;
use super::{PASSES, SolidContacts, Solids, bending, dot};
use crate::body::{PACKET, Shape};
use crate::lane::{LANES, Lane, Real, V3};
use crate::strands::BlockView;

/// The queries of a group of lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Queued<L> {
    /// Clearances after the last query.
    pub last: L,
    /// Displacements relative to the solid that moved most against the particle.
    pub moved: L,
    /// Positions before the displacement.
    pub from: V3<L>,
}

/// Particles that need a query. They are resolved [`PACKET`] at a time, so that their samples share
/// instructions and overlap their memory latencies.
#[derive(Debug)]
pub(super) struct Queue<T> {
    /// When the queued displacements began: at the substep's start (0) or at its end (1), where
    /// solids do not move any more.
    pub start: usize,
    pub len: usize,
    /// Particle of the strand, and lane of the block.
    at: [(usize, usize); PACKET + LANES],
    /// Clearance after the last query.
    last: [T; PACKET + LANES],
    /// Position before the displacement.
    from: [[T; 3]; PACKET + LANES],
    /// Displacement relative to the solid that moved most against the particle.
    moved: [T; PACKET + LANES],
}

impl<T: Real> Queue<T> {
    #[inline(always)]
    pub fn new(start: usize) -> Self {
        let none = [T::zero(); PACKET + LANES];
        let from = [[T::zero(); 3]; PACKET + LANES];
        Self { start, len: 0, at: [(0, 0); PACKET + LANES], last: none, from, moved: none }
    }

    /// Appends particles `i` of those lanes from `first` whose bits are set in `lanes`.
    #[inline(always)]
    pub fn push_lanes<L: Lane<Scalar = T>>(
        &mut self,
        mut lanes: u32,
        i: usize,
        first: usize,
        queued: Queued<L>,
    ) {
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            self.at[self.len] = (i, first + lane);
            self.last[self.len] = queued.last.get(lane);
            self.from[self.len] = queued.from.get(lane);
            self.moved[self.len] = queued.moved.get(lane);
            self.len += 1;
            lanes &= lanes - 1;
        }
    }

    /// Takes a packet from the end and resolves it against all solids.
    ///
    /// Not inlined: most of its time is spent in loads and friction, and inlined into the frame it
    /// takes registers from the strand solve. Compiling it for AVX2 gained only 3 %.
    #[inline(never)]
    pub fn resolve_packet(
        &mut self,
        solids: &Solids<'_, T>,
        view: &mut BlockView<'_, T>,
        contacts: &mut SolidContacts,
    ) {
        let taken = self.len.min(PACKET);
        self.len -= taken;
        let at = &self.at[self.len..self.len + taken];
        let mut x = [[T::zero(); PACKET]; 3];
        let mut v = [[T::zero(); PACKET]; 3];
        for (k, &(i, lane)) in at.iter().enumerate() {
            for c in 0..3 {
                x[c][k] = view.positions[3 * i + c].0[lane];
                v[c][k] = view.velocities[3 * i + c].0[lane];
            }
        }
        let beyond_rounding = crate::strands::number(0.999);
        let mut clearance = [T::infinity(); PACKET];
        let mut touches = [false; PACKET];
        // Whether the push out of one solid may have ended in another.
        let mut between = [false; PACKET];
        for (collider, pose) in solids.solids.iter().zip(solids.poses) {
            let solid = Solid { collider, pose };
            let thin = ccd_motion(collider.shape);
            // A sample is not needed where the displacement cannot tunnel through this solid and
            // the distance from its bounding ball exceeds the clearance from the solids before: the
            // particle cannot touch this solid, nor can its clearance fall.
            let rise = lipschitz::<T>(collider.shape);
            let is_far = |k: usize| {
                let outside = pose.distance_bound_at([x[0][k], x[1][k], x[2][k]]) - solids.thickness;
                self.moved[self.len + k] <= thin
                    && outside * beyond_rounding > clearance[k].max(T::zero()) * rise
            };
            if (0..taken).all(is_far) {
                continue;
            }
            let (distances, gradients) =
                collider.shape.sample_packet(&pose.local_packet(1, &x), pose.fractions[1]);
            for k in 0..taken {
                let place = [x[0][k], x[1][k], x[2][k]];
                let sample = Sample {
                    distance: distances[k],
                    gradient: [gradients[0][k], gradients[1][k], gradients[2][k]],
                };
                let mut last_clearance = self.last[self.len + k];
                // One that has not been queried may have been outside: the solid came to it. Slower
                // ones are pushed out at once anyway.
                if last_clearance == T::neg_infinity()
                    && self.moved[self.len + k] > solids.max_push_out
                    && sample.distance < solids.thickness
                {
                    let from = pose.local(self.start, self.from[self.len + k]);
                    let before = collider.shape.sample_at(from, pose.fractions[self.start]).0;
                    if before >= solids.thickness {
                        last_clearance = T::zero();
                    }
                }
                let velocity = [v[0][k], v[1][k], v[2][k]];
                let own = || Particle::new(place, velocity, last_clearance);
                let (mut particle, from) = (own(), self.from[self.len + k]);
                let may_hit = self.moved[self.len + k] > thin && {
                    let sigma = sample.distance - solids.thickness;
                    may_pass(
                        collider.shape,
                        solids.thickness,
                        sigma,
                        &pose.sweep_path(self.start, from, place),
                    )
                };
                let is_ccd_hit =
                    may_hit && resolve_ccd_hit(solids, solid, sample, self.start, from, &mut particle);
                let mut sigma = if is_ccd_hit {
                    T::zero()
                } else {
                    resolve_penetration(solids, solid, sample, &mut particle)
                };
                if sigma < crate::strands::number(-PASSES) && last_clearance >= T::zero() && !particle.is_held
                {
                    // Near the middle of a field pushes do not bring it out.
                    let mut stopped = own();
                    if stop_at_entry(solids, solid, self.start, from, &mut stopped) {
                        (particle, sigma) = (stopped, T::zero());
                    }
                }
                if is_ccd_hit || sample.distance < solids.thickness {
                    touches[k] = true;
                    let gone = [0, 1, 2].map(|c| particle.x[c] - place[c]);
                    between[k] |= clearance[k] < dot(gone, gone).sqrt();
                    for c in 0..3 {
                        x[c][k] = particle.x[c];
                        v[c][k] = particle.v[c];
                    }
                }
                let rise = if sigma > T::zero() { lipschitz(collider.shape) } else { T::one() };
                clearance[k] = clearance[k].min(sigma / rise);
            }
            if matches!(collider.shape, Shape::Bending(_)) && pose.fractions[1] < 1.0 {
                bending::bound_until_end(solids, solid, &x, &mut clearance);
            }
        }
        for k in 0..taken {
            // A particle that was inside at the last query is pushed out over several substeps.
            if between[k] && self.last[self.len + k] >= T::zero() {
                let (place, velocity) = ([x[0][k], x[1][k], x[2][k]], [v[0][k], v[1][k], v[2][k]]);
                let mut particle = Particle::new(place, velocity, T::zero());
                clearance[k] = resolve_penetrations(solids, &mut particle);
                if clearance[k] > T::zero() {
                    clearance[k] = clearance[k].min(bending::clearance_at_end(solids, particle.x));
                }
                for c in 0..3 {
                    x[c][k] = particle.x[c];
                    v[c][k] = particle.v[c];
                }
            }
        }
        for (k, &(i, lane)) in at.iter().enumerate() {
            view.clearance[i].0[lane] = clearance[k];
            if touches[k] {
                for c in 0..3 {
                    view.positions[3 * i + c].0[lane] = x[c][k];
                    view.velocities[3 * i + c].0[lane] = v[c][k];
                }
            }
            contacts.touching += u32::from(touches[k]);
            contacts.lanes |= u32::from(touches[k]) << lane;
            let depth = -(clearance[k] + solids.thickness).to_f64().unwrap_or(0.0);
            contacts.deepest = contacts.deepest.max(depth);
        }
    }
}
