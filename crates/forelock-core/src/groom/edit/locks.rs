//! Locks: groups of strands around a few centre strands.

use std::collections::HashMap;

use glam::{IVec3, Vec3};

use crate::groom::Groom;
use crate::groom::grow::random::mix;
use crate::groom::nearest::Nearest;

/// For each selected strand, the strand at the centre of its lock; a strand that is not selected is
/// its own centre.
///
/// Centres are drawn in random order, at least `spacing` metres apart from each other (dart
/// throwing), until every strand is closer than that to a centre. A strand belongs to the nearest
/// centre.
pub(super) fn locks(groom: &Groom, selected: &[bool], spacing: f32, seed: u64) -> Vec<u32> {
    #[expect(clippy::cast_possible_truncation, reason = "offsets are 32-bit, so strand indices fit")]
    let mut locks: Vec<u32> = (0..groom.strand_count() as u32).collect();
    let mut order: Vec<u32> = locks.iter().copied().filter(|&s| selected[s as usize]).collect();
    order.sort_by_key(|&s| (mix(seed ^ mix(u64::from(s) + 1)), s));
    let root = |s: u32| groom.strand(s as usize)[0];
    // Cell indices saturate at 32 bits: an extremely fine lattice is slow, but not wrong.
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

/// The cell and its 26 neighbours.
fn neighbours(cell: IVec3) -> impl Iterator<Item = IVec3> {
    (0..27).map(move |i| cell.saturating_add(IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1)))
}
