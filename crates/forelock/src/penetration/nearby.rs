//! Which solids a part of a strand may touch.
//!
//! # Practice
//! A strand is cut into pieces of eight edges. The box of a piece is looked up in a tree over the
//! boxes of the solids, so that the cost grows with the solids nearby and not with all of them.

use std::ops::Range;

use forelock_core::body::Bvh;
use glam::Vec3;

use super::solid::Local;

/// Edges of a piece.
const PIECE: usize = 8;

/// Error of a position in float32 and of a rounded box, as a share of its distance from the origin.
const ROUNDING: f32 = 1e-6;

/// Consecutive particles of a strand.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Span {
    /// Their indices; edges are between consecutive ones.
    pub all: Range<usize>,
    /// Whether the first one is clamped.
    pub begins_clamped: bool,
}

impl Span {
    /// The particles from the last clamped one on of the strand between two `ends`; `None` if none
    /// is free, or there is no position for them.
    pub fn of_strand(ends: &[u32], clamped: u32, positions: &[Vec3]) -> Option<Self> {
        let end = (ends[1] as usize).min(positions.len());
        let first_free = ends[0] as usize + clamped as usize;
        (first_free < end)
            .then(|| Self { all: first_free - usize::from(clamped > 0)..end, begins_clamped: clamped > 0 })
    }

    /// Those that are free.
    pub fn free(&self) -> Range<usize> {
        self.all.start + usize::from(self.begins_clamped)..self.all.end
    }

    /// Parts of at most [`PIECE`] edges; each begins at the particle at which the one before ends.
    fn pieces(&self) -> impl Iterator<Item = Self> {
        let last = self.all.end - 1;
        let starts = (self.all.start..last.max(self.all.start + 1)).step_by(PIECE);
        starts.map(move |start| Self {
            all: start..(start + PIECE).min(last) + 1,
            begins_clamped: self.begins_clamped && start == self.all.start,
        })
    }
}

/// The solids, so that those near a piece are found.
pub(super) struct Nearby {
    /// Solids without bounds.
    everywhere: Vec<usize>,
    /// Those with bounds, and the tree of their boxes.
    bounded: Vec<usize>,
    boxes: Bvh,
}

impl Nearby {
    pub fn new(solids: &[Local<'_>]) -> Self {
        let (mut everywhere, mut bounded, mut boxes) = (Vec::new(), Vec::new(), Vec::new());
        for (index, solid) in solids.iter().enumerate() {
            match solid.world_bounds() {
                None => everywhere.push(index),
                Some((low, high)) => {
                    bounded.push(index);
                    boxes.push(wider(low, high));
                }
            }
        }
        Self { everywhere, bounded, boxes: Bvh::from_boxes(&boxes) }
    }

    /// The solids near `strands`, each with the parts of the strands that may touch it.
    pub fn of_strands(&self, positions: &[Vec3], strands: &[Span]) -> Vec<(usize, Vec<Span>)> {
        let mut near: Vec<(usize, Span)> = Vec::new();
        for piece in strands.iter().flat_map(Span::pieces) {
            let (low, high) = bounds(&positions[piece.all.clone()]);
            let (low, high) = wider(low, high);
            self.boxes
                .overlapping(low, high, |index| near.push((self.bounded[index as usize], piece.clone())));
        }
        near.sort_by_key(|(solid, piece)| (*solid, piece.all.start));
        let mut found: Vec<(usize, Vec<Span>)> =
            self.everywhere.iter().map(|solid| (*solid, strands.to_vec())).collect();
        for (solid, piece) in near {
            match found.last_mut() {
                Some((last, spans)) if *last == solid => join(spans, piece),
                _ => found.push((solid, vec![piece])),
            }
        }
        found
    }
}

/// Appends `piece` to `spans`, to the last of them if it goes on from there.
fn join(spans: &mut Vec<Span>, piece: Span) {
    match spans.last_mut() {
        Some(last) if last.all.end == piece.all.start + 1 && !piece.begins_clamped => {
            last.all.end = piece.all.end;
        }
        _ => spans.push(piece),
    }
}

fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    points.iter().fold(start, |(low, high), p| (low.min(*p), high.max(*p)))
}

/// The box with a margin for rounding.
fn wider(low: Vec3, high: Vec3) -> (Vec3, Vec3) {
    let margin = (low.abs().max(high.abs()) + 1.0) * ROUNDING;
    (low - margin, high + margin)
}
