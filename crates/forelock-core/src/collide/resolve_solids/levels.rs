//! Collisions of one level of all strands at a time.

use super::queue::{Queue, Queued};
use super::{SolidContacts, Solids, clearance_left, reduce_clearances_of};
use crate::lane::{Lane, Real, V3};
use crate::strands::{BlockView, LaneGroup};

/// Solids for a solver that places particles level by level along the strands: the collisions of a
/// level are resolved before the next level is placed.
#[derive(Debug)]
pub struct LevelSolids<'a, T> {
    solids: Solids<'a, T>,
    queue: Queue<T>,
    /// Contacts found so far. The depth is an upper bound over all particles.
    pub contacts: SolidContacts,
}

impl<'a, T: Real> LevelSolids<'a, T> {
    /// Before the first level; `None` where there are no solids. Friction changes positions too.
    #[inline(always)]
    pub fn new(solids: Solids<'a, T>) -> Option<Self> {
        let own = Self {
            solids: Solids { friction_moves: true, ..solids },
            queue: Queue::new(0),
            contacts: SolidContacts::default(),
        };
        (!own.solids.solids.is_empty()).then_some(own)
    }

    /// Resolves the collisions of particles `i` of the lanes in `group`, which came from `from` in
    /// this substep. Returns the lanes whose positions changed.
    #[inline(always)]
    pub fn resolve<L: Lane<Scalar = T>>(
        &mut self,
        i: usize,
        from: V3<L>,
        view: &mut BlockView<'_, T>,
        group: LaneGroup,
    ) -> L::Mask {
        let LaneGroup { first, live } = group;
        let x = V3::<L>::load(view.positions, i, first);
        let last = L::load(&view.clearance[i], first);
        let (moved, left) = clearance_left(&self.solids, last, from, x);
        left.store(&mut view.clearance[i], first);
        let own = u32::MAX >> (32 - L::WIDTH.min(live - first));
        let used_up = !L::bits(L::zero().lt(left)) & own;
        self.queue.push_lanes(used_up, i, first, Queued { last, moved, from });
        self.flush(0, view);
        let by = V3::load(view.positions, i, first) - x;
        L::zero().lt(by.dot(by))
    }

    /// Resolves the lanes of `mask` once more, against solids at rest at the substep's end.
    #[inline(always)]
    pub fn resolve_again<L: Lane<Scalar = T>>(
        &mut self,
        i: usize,
        mask: L::Mask,
        view: &mut BlockView<'_, T>,
        first: usize,
    ) {
        let last = L::load(&view.clearance[i], first);
        let x = V3::<L>::load(view.positions, i, first);
        let used_up = !L::bits(L::zero().lt(last)) & L::bits(mask);
        self.queue.push_lanes(used_up, i, first, Queued { last, moved: L::zero(), from: x });
        let touching = self.contacts.touching;
        self.flush(1, view);
        self.contacts.touching = touching;
    }

    /// Moves the lanes of `mask` to `x`.
    #[inline(always)]
    pub fn move_to<L: Lane<Scalar = T>>(
        &mut self,
        i: usize,
        x: V3<L>,
        mask: L::Mask,
        view: &mut BlockView<'_, T>,
        first: usize,
    ) {
        let old = V3::<L>::load(view.positions, i, first);
        let new = V3::select(mask, x, old);
        let by = new - old;
        let moved = by.dot(by).sqrt();
        let deeper = moved - L::load(&view.clearance[i], first) - L::splat(self.solids.thickness);
        let mut lanes = L::bits(mask);
        while lanes != 0 {
            let depth = deeper.get(lanes.trailing_zeros() as usize).to_f64().unwrap_or(0.0);
            self.contacts.deepest = self.contacts.deepest.max(depth);
            lanes &= lanes - 1;
        }
        reduce_clearances_of(moved, view, i, first);
        new.store(view.positions, i, first);
    }

    /// Resolves all queued particles. `start` as in [`Queue`].
    #[inline(always)]
    fn flush(&mut self, start: usize, view: &mut BlockView<'_, T>) {
        self.queue.start = start;
        while self.queue.len > 0 {
            self.queue.resolve_packet(&self.solids, view, &mut self.contacts);
        }
    }
}
