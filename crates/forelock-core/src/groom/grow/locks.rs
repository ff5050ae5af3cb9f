//! Locks: strands that join the middle strand of their lock, and the cut.

use rayon::prelude::*;

use super::curve::Curve;
use super::roots::Root;
use super::strand::{Field, Traits};

/// The middle strand of each lock.
pub(super) struct Locks {
    /// For each strand the index of its lock's curve.
    lock: Vec<u32>,
    /// The curves of the middle strands.
    curves: Vec<Curve>,
}

impl Locks {
    /// Grows the middle strand of each lock. A lock ends at the parting, and hair that is tucked
    /// behind an ear is not in a lock with hair that falls over it.
    pub(super) fn new(field: &Field, roots: &[Root], traits: &[Traits]) -> Self {
        if field.params.clump == 0.0 {
            return Self { lock: Vec::new(), curves: Vec::new() };
        }
        let key = |strand: u32| {
            let strand = strand as usize;
            (roots[strand].lock.key, traits[strand].side < 0.0, traits[strand].tucked)
        };
        let distance = |strand: u32| roots[strand as usize].lock.distance_squared;
        let mut order: Vec<u32> = (0..field.params.strands).collect();
        order.par_sort_unstable_by(|&a, &b| {
            key(a).cmp(&key(b)).then(distance(a).total_cmp(&distance(b))).then(a.cmp(&b))
        });
        let mut lock = vec![0u32; roots.len()];
        let mut middles = Vec::new();
        for strands in order.chunk_by(|&a, &b| key(a) == key(b)) {
            let middle = strands.iter().find(|&&s| !traits[s as usize].stray).unwrap_or(&strands[0]);
            for &strand in strands {
                lock[strand as usize] = middles.len() as u32;
            }
            middles.push(*middle as usize);
        }
        let grown = |&middle: &usize| {
            let mut curve = Curve::default();
            field.grow(&roots[middle], &traits[middle], &mut curve);
            curve
        };
        Self { lock, curves: middles.par_iter().map(grown).collect() }
    }

    /// Moves the curve of `strand` towards the middle of its lock, increasingly towards the tip,
    /// and returns whether it was moved.
    pub(super) fn join(&self, field: &Field, strand: usize, traits: &Traits, curve: &mut Curve) -> bool {
        let Some(middle) = self.lock.get(strand).map(|&lock| &self.curves[lock as usize]) else {
            return false;
        };
        if traits.stray {
            return false;
        }
        let last = (curve.points.len() - 1) as f32;
        // A strand does not leave its neighbourhood to follow its lock.
        let reach = (3.0 * field.params.lock_size).powi(2);
        for i in 1..curve.points.len() {
            let fraction = i as f32 / last;
            let away = middle.at(curve.spacing * i as f32) - curve.points[i];
            let near = reach / (reach + away.length_squared());
            let shift = away * (field.params.clump * fraction * (2.0 - fraction) * near);
            curve.points[i] = if 0.7 * curve.gaps[i] > shift.length() + field.params.margin {
                curve.points[i] + shift
            } else {
                field.outside(curve.points[i], shift, curve.spacing * i as f32)
            };
        }
        true
    }
}

impl Field<'_> {
    /// The fraction of `curve` that remains after the cut.
    pub(super) fn cut(&self, traits: &Traits, curve: &Curve) -> f32 {
        let p = self.params;
        if p.cut == 0.0 {
            return 1.0;
        }
        let middle = 0.5 * (self.low.x + self.high.x);
        let height = self.high.y - p.cut * (self.high.y - self.low.y);
        let over = |i: usize| {
            let x = curve.points[i];
            x.y - curve.sags[i] - (height + p.cut_slope * (x.x - middle))
        };
        let Some(crossing) = (1..curve.points.len()).find(|&i| over(i) < 0.0) else { return 1.0 };
        let (before, after) = (over(crossing - 1), over(crossing));
        let kept = (crossing - 1) as f32 + (before / (before - after)).clamp(0.0, 1.0);
        // Half of the strand's variation in length is kept, so that the tips do not form a straight
        // line.
        let variation = traits.step / p.step;
        (kept / (curve.points.len() - 1) as f32 * (0.5 + 0.5 * variation)).max(0.05)
    }
}
