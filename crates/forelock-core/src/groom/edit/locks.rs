//! Locks: strands by the nearest of a few centres.

use std::collections::HashMap;

use glam::{IVec3, Vec3};

use crate::groom::Groom;
use crate::groom::grow::random::mix;
use crate::groom::nearest::Nearest;

/// The strand in the middle of each selected strand's lock; strands that are not selected are their own.
///
/// Centres are drawn in a random order, none within `spacing` metres of another (dart throwing), until no strand is farther than
/// that from one; a strand belongs to the nearest.
pub(super) fn locks(groom: &Groom, selected: &[bool], spacing: f32, seed: u64) -> Vec<u32> {
    #[expect(clippy::cast_possible_truncation, reason = "offsets are 32-bit, so strand numbers are")]
    let mut locks: Vec<u32> = (0..groom.strand_count() as u32).collect();
    let mut order: Vec<u32> = locks.iter().copied().filter(|&s| selected[s as usize]).collect();
    order.sort_by_key(|&s| (mix(seed ^ mix(u64::from(s) + 1)), s));
    let root = |s: u32| groom.strand(s as usize)[0];
    // Cells beyond 32 bits are at the border: far too coarse a lattice is slow, not wrong.
    let cell = |p: Vec3| (p / spacing).floor().as_ivec3();
    let mut taken: HashMap<IVec3, Vec<u32>> = HashMap::new();
    let mut centres = Vec::new();
    for &strand in &order {
        let p = root(strand);
        let close = neighbours(cell(p))
            .any(|c| taken.get(&c).is_some_and(|there| there.iter().any(|&t| root(t).distance(p) < spacing)));
        if !close {
            taken.entry(cell(p)).or_default().push(strand);
            centres.push(strand);
        }
    }
    let tree = Nearest::new(centres.iter().map(|&s| root(s)));
    for &strand in &order {
        if let Some(nearest) = tree.nearest(root(strand)) {
            locks[strand as usize] = centres[nearest as usize];
        }
    }
    locks
}

/// The cell and all that touch it.
fn neighbours(cell: IVec3) -> impl Iterator<Item = IVec3> {
    (0..27).map(move |i| cell.saturating_add(IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1)))
}
