//! Removing strands, or adding strands between the existing ones.
//!
//! # Theory
//! A new strand lies between a parent and two of its near neighbours, at barycentric weights drawn
//! uniformly from their triangle. It has the parent's shape, displaced by the weighted difference
//! of the flows of the three strands (a strand's points averaged over `detail`): its curls are
//! those of the parent, its course is between the three. The lengths of its edges are proportional
//! to the parent's, and its total length is the weighted mean of the three strands.

use glam::DVec3;
use rayon::prelude::*;

use super::EditError;
use super::chain::{Chain, falloff};
use super::change::{Change, NewStrand, Particle, What};
use super::error::check;
use crate::groom::Groom;
use crate::groom::grow::random::{Random, mix};
use crate::groom::nearest::Nearest;

/// Number of neighbours from which two are drawn.
const NEIGHBOURS: usize = 7;
/// Distance at which new strands are added to a strand without neighbours, metres.
const ALONE: f64 = 1e-3;

crate::documented! {
/// `density`: removes strands, or adds strands between the existing ones.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Density {
    /// Number of strands after the edit divided by the number before. No unit, default 1, range 0
    /// to 100; 0 leaves none, 2 doubles them.
    pub factor: f32,
    /// Distance of tips beyond which neighbours are not mixed, as on both sides of a parting. Unit
    /// m, default 0.05, range 0 to 1000; 0 mixes none.
    pub spread: f32,
    /// Length over which the flow of a strand is averaged. Unit m, default 0.03, range 0 to 1000; 0
    /// mixes curls too.
    pub detail: f32,
    /// Seed of all random numbers. No unit, default 1, range 0 or more; 0 is a valid seed.
    pub seed: u64,
}
}

impl Default for Density {
    fn default() -> Self {
        Self { factor: 1.0, spread: 0.05, detail: 0.03, seed: 1 }
    }
}

impl Density {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[("factor", &[self.factor]), ("spread", &[self.spread]), ("detail", &[self.detail])])
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        let mut order: Vec<usize> = (0..groom.strand_count()).filter(|&s| selected[s]).collect();
        order.sort_by_key(|&s| (mix(self.seed ^ mix(s as u64 + 1)), s));
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most 100 times the number of strands"
        )]
        let wanted = (order.len() as f64 * f64::from(self.factor)).round() as usize;
        let mut keep = vec![true; groom.strand_count()];
        order.iter().skip(wanted).for_each(|&s| keep[s] = false);
        let kept = (0..groom.strand_count()).filter(|&s| keep[s]).map(NewStrand::kept);
        let tree = Nearest::new(order.iter().map(|&s| groom.strand(s)[0]));
        let new = (order.len()..wanted).into_par_iter();
        let new: Vec<NewStrand> = new
            .map(|number| self.between(groom, &order, &tree, order[number % order.len()], number))
            .collect();
        Change { what: What::Rebuilt(kept.chain(new).collect()), coarse: 0 }
    }

    /// The new strand with index `number`, between `parent` and two of its neighbours. Points of
    /// `tree` are indices into `order`.
    fn between(
        &self,
        groom: &Groom,
        order: &[usize],
        tree: &Nearest,
        parent: usize,
        number: usize,
    ) -> NewStrand {
        let mut random = Random::new(self.seed, number as u64 + 1);
        let strand = groom.strand(parent);
        let tip = strand[strand.len() - 1];
        let mut found = Vec::with_capacity(NEIGHBOURS + 2);
        tree.find(strand[0], NEIGHBOURS + 1, f32::INFINITY, &mut found);
        let near = |s: usize| groom.strand(s).last().is_some_and(|p| p.distance(tip) <= self.spread);
        let mut others: Vec<usize> = found.iter().map(|&(_, n)| order[n as usize]).collect();
        others.retain(|&s| s != parent && near(s));
        let mut draw = |others: &mut Vec<usize>| {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index")]
            let index = (random.unit() * others.len() as f32) as usize;
            (!others.is_empty()).then(|| others.swap_remove(index.min(others.len() - 1)))
        };
        let pair = [draw(&mut others), draw(&mut others)];
        let (u, v) = (random.unit(), random.unit());
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let mut parents = vec![(parent, 1.0)];
        for (other, weight) in pair.into_iter().zip([u, v]) {
            if let Some(other) = other {
                parents.push((other, weight));
                parents[0].1 -= weight;
            }
        }
        let aside = if parents.len() == 1 { random.cube().as_dvec3() * ALONE } else { DVec3::ZERO };
        let particles = self.mixed(groom, &parents, aside);
        NewStrand { source: parent, particles: Some(particles), parents: Some(parents) }
    }

    /// The particles of the strand between `parents`, the first of which determines the shape,
    /// displaced by `aside`.
    fn mixed(&self, groom: &Groom, parents: &[(usize, f32)], aside: DVec3) -> Vec<Particle> {
        let chains: Vec<(Chain, f64)> =
            parents.iter().map(|&(s, weight)| (Chain::of(groom, s), f64::from(weight))).collect();
        let first = &chains[0].0;
        let (arcs, length) = (first.arcs(), first.length());
        let flows: Vec<Flow> = chains.iter().map(|(chain, _)| Flow::new(chain, self.detail.into())).collect();
        let share = |arc: f64| if length > 0.0 { arc / length } else { 0.0 };
        let moved = |i: usize| {
            let here = flows[0].at(share(arcs[i]));
            let shift: DVec3 =
                chains.iter().zip(&flows).map(|((_, w), flow)| (flow.at(share(arcs[i])) - here) * *w).sum();
            first.points[i] + shift + aside
        };
        let targets: Vec<DVec3> = (0..arcs.len()).map(moved).collect();
        let mean: f64 = chains.iter().map(|(chain, weight)| chain.length() * weight).sum();
        let mut at = targets[0].as_vec3();
        let mut particles = vec![Particle { position: at, edge: 0, fraction: 0.0 }];
        for (i, target) in targets.iter().enumerate().skip(1) {
            let along = (*target - at.as_dvec3())
                .try_normalize()
                .unwrap_or_else(|| (first.points[i] - first.points[i - 1]).normalize_or_zero());
            at = (at.as_dvec3() + along * (mean * share(first.lengths[i - 1]))).as_vec3();
            particles.push(Particle { position: at, edge: i, fraction: 0.0 });
        }
        particles
    }
}

/// A strand's points averaged over a length, which decreases to zero towards root and tip.
struct Flow {
    chain: Chain,
    arcs: Vec<f64>,
}

impl Flow {
    fn new(chain: &Chain, reach: f64) -> Self {
        let (arcs, length) = (chain.arcs(), chain.length());
        let mut points = chain.points.clone();
        for (i, point) in points.iter_mut().enumerate() {
            let reach = reach.min(arcs[i]).min(length - arcs[i]);
            if reach <= 0.0 {
                continue;
            }
            let from = arcs.partition_point(|&a| a < arcs[i] - reach);
            let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
            for j in (from..arcs.len()).take_while(|&j| arcs[j] <= arcs[i] + reach) {
                let weight = falloff((arcs[j] - arcs[i]) / reach);
                sum += chain.points[j] * weight;
                weights += weight;
            }
            *point = sum / weights;
        }
        Self { chain: Chain { points, ..chain.clone() }, arcs }
    }

    /// The point at fraction `share` of the strand.
    fn at(&self, share: f64) -> DVec3 {
        let length = self.arcs[self.arcs.len() - 1];
        let arc = share * length;
        let edge = self.arcs.partition_point(|&a| a <= arc).saturating_sub(1).min(self.arcs.len() - 2);
        let width = self.arcs[edge + 1] - self.arcs[edge];
        let part = if width > 0.0 { ((arc - self.arcs[edge]) / width).clamp(0.0, 1.0) } else { 0.0 };
        self.chain.points[edge].lerp(self.chain.points[edge + 1], part)
    }
}
