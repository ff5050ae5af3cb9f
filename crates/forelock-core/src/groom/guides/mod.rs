//! Linear hair skinning: a few simulated guides determine the motion of all strands of a groom.
//!
//! # Theory
//! Each particle of a guide has a rigid motion T_g,j: x ↦ c_j + R_j (x − c̄_j), from its rest
//! position c̄_j to its current position c_j. The rotations are propagated along the guide without
//! twist: at the root R is the head's rotation, and from each edge to the next R is composed with
//! the smallest rotation from the rotated rest edge to the current edge. A strand's particle with
//! rest position x̄ at fraction s of the strand's length is placed at
//!
//! x = Σ_g w_g ((1 − t) T_g,j + t T_g,j+1) x̄,
//!
//! where s is at fraction t of edge j of guide g. The weights of the k nearest guides of a strand,
//! at distances d between the roots, are those of Franke and Little, w ∝ ((D − d)/(D d))², where D
//! is the distance of the next guide after them; they are normalised to the sum 1. The weights do
//! not jump between neighbouring strands where a guide leaves the set.
//!
//! Rigid motions are used instead of plain displacements, x̄ + Σ w (c − c̄): a displacement keeps
//! the offset of a strand from its guide as it was at rest, so that hair that swings upwards loses
//! its volume and the far side of a lock passes through the near side. With rotations the whole
//! lock rotates. Their cost is small, because they are computed for guides only.
//!
//! At rest every T is the identity, and if the head and the guides move as one rigid body, every T
//! is that motion: the skinned strands are then exact, up to rounding.
//!
//! # Practice
//! [`Skinning::new`] selects guides by farthest-point sampling of the roots (Gonzalez 1985), so
//! that every root is close to a guide, and computes each strand's guides once.
//! [`Skinning::guides`] is the groom to simulate. [`Skinning::skin`] places all strands, in
//! parallel and without allocation. Guides and strands may have any numbers of particles.
//!
//! # Limitations
//! The mean of different rigid motions is not rigid: strands between guides that move apart become
//! shorter, and skinned strands may penetrate solids. Guides are selected by the distance of the
//! roots only: a strand beside a parting follows guides on both sides of it.

mod choose;
#[cfg(test)]
mod tests;

use glam::{Affine3A, DQuat, DVec3, Vec3, Vec3A};
use rayon::prelude::*;

use super::Groom;
use super::nearest::Nearest;
use crate::pose::Pose;

pub use choose::choose_guides;
use choose::{fractions, influence, place};

/// WGSL that both kernels of guides share.
pub const WGSL: &str = include_str!("skin.wgsl");
/// WGSL of the motion of each guide particle.
pub const FOLLOW_WGSL: &str = include_str!("follow.wgsl");
/// WGSL that places every strand by its guides.
pub const CARRY_WGSL: &str = include_str!("carry.wgsl");

/// Maximum number of guides that a strand follows.
pub const GUIDES_PER_STRAND: usize = 4;

/// Number of strands in one task.
const STRANDS_PER_TASK: usize = 64;

/// Why a groom cannot be skinned by guides.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GuidesError {
    /// No guides were requested.
    #[error("skinning needs at least 1 guide")]
    None,
    /// A strand has fewer than two particles, or a particle that is not finite.
    #[error(
        "strand {0} has fewer than 2 particles, or a particle that is not finite: `groom::repair` and \
         `forelock convert` drop such strands"
    )]
    Strand(usize),
}

/// The guides of a strand and their weights.
#[derive(Clone, Copy, Debug, Default)]
struct Influence {
    guides: [u32; GUIDES_PER_STRAND],
    weights: [f32; GUIDES_PER_STRAND],
}

/// The position of a particle on each of its guides: the guide particle before it (an index into
/// all guides' particles) and the fraction of the edge.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    particles: [u32; GUIDES_PER_STRAND],
    fractions: [f32; GUIDES_PER_STRAND],
}

/// The skinning data of a particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carried {
    /// Rest position in the head's space, metres.
    pub rest: Vec3,
    /// Weights of the guides; they sum to 1.
    pub weights: [f32; GUIDES_PER_STRAND],
    /// The particle before it on each guide, an index into all guides' particles.
    pub particles: [u32; GUIDES_PER_STRAND],
    /// The fraction of the edge that starts at that particle.
    pub fractions: [f32; GUIDES_PER_STRAND],
}

/// A groom and the guides that determine its motion.
#[derive(Clone, Debug)]
pub struct Skinning {
    chosen: Vec<usize>,
    guides: Groom,
    /// Rest positions of the whole groom.
    rest: Vec<Vec3>,
    offsets: Vec<u32>,
    influences: Vec<Influence>,
    places: Vec<Place>,
    /// Workspace: T for each particle of the guides.
    motions: Vec<Affine3A>,
}

impl Skinning {
    /// Skins `groom` by `count` of its strands, selected with `seed`.
    ///
    /// # Errors
    /// [`GuidesError`] if `count` is 0 or the groom is empty, or if a strand has fewer than two
    /// particles or a particle that is not finite.
    pub fn new(groom: &Groom, count: usize, seed: u64) -> Result<Self, GuidesError> {
        let usable = |s: usize| groom.strand(s).len() >= 2 && groom.strand(s).iter().all(|p| p.is_finite());
        if let Some(strand) = (0..groom.strand_count()).find(|&s| !usable(s)) {
            return Err(GuidesError::Strand(strand));
        }
        let chosen = choose_guides(groom, count, seed);
        if chosen.is_empty() {
            return Err(GuidesError::None);
        }
        let guides = groom.only(&chosen);
        let tree = Nearest::new(guides.strands().map(|s| s[0]));
        let fractions: Vec<Vec<f32>> = guides.strands().map(fractions).collect();
        let strands = (0..groom.strand_count()).into_par_iter();
        let found = strands.map(|s| {
            let strand = groom.strand(s);
            let influence = influence(&tree, strand[0], guides.strand_count());
            let at = choose::fractions(strand);
            (influence, at.iter().map(|&at| place(&guides, &fractions, &influence, at)).collect::<Vec<_>>())
        });
        let (influences, places): (Vec<Influence>, Vec<Vec<Place>>) = found.unzip();
        Ok(Self {
            chosen,
            rest: groom.positions().to_vec(),
            offsets: groom.strand_offsets().to_vec(),
            influences,
            places: places.concat(),
            motions: vec![Affine3A::IDENTITY; guides.particle_count()],
            guides,
        })
    }

    /// The guides, as a groom to be simulated.
    pub fn guides(&self) -> &Groom {
        &self.guides
    }

    /// The indices in the groom of the guides, in order.
    pub fn chosen(&self) -> &[usize] {
        &self.chosen
    }

    /// The guides that strand `strand` follows, as indices of guides, and their weights, which sum
    /// to 1.
    ///
    /// # Panics
    /// If there is no such strand.
    pub fn follows(&self, strand: usize) -> impl Iterator<Item = (usize, f32)> {
        let Influence { guides, weights } = self.influences[strand];
        guides.into_iter().map(|g| g as usize).zip(weights).filter(|&(_, weight)| weight > 0.0)
    }

    /// The skinning data of each particle, in the groom's order.
    pub fn carried(&self) -> impl Iterator<Item = Carried> {
        self.offsets.windows(2).zip(&self.influences).flat_map(move |(ends, influence)| {
            (ends[0] as usize..ends[1] as usize).map(move |p| {
                let Place { particles, fractions } = self.places[p];
                Carried { rest: self.rest[p], weights: influence.weights, particles, fractions }
            })
        })
    }

    /// The particle of the guides, as an index into all of them, that each particle of the groom
    /// follows most, in the groom's order.
    pub fn nearest(&self) -> impl Iterator<Item = usize> {
        self.carried().map(|Carried { weights, particles, fractions, .. }| {
            let most = (1..GUIDES_PER_STRAND).fold(0, |a, b| if weights[b] > weights[a] { b } else { a });
            particles[most] as usize + usize::from(fractions[most] > 0.5)
        })
    }

    /// Places all strands into `out` (`[P]`, metres, world space, in the groom's order), for the
    /// head's pose `head` and the positions `guides` of the guides' particles (metres, world space,
    /// in the guides' order). Does not allocate if `out` has the capacity.
    ///
    /// # Panics
    /// If the number of `guides` differs from the number of the guides' particles.
    pub fn skin(&mut self, head: &Pose, guides: &[Vec3], out: &mut Vec<Vec3>) {
        assert_eq!(
            guides.len(),
            self.motions.len(),
            "there must be one position for each particle of the guides"
        );
        out.resize(self.rest.len(), Vec3::ZERO);
        let strands = 0..self.guides.strand_count();
        each(strands, self.guides.strand_offsets(), &mut self.motions, &|strand, motions| {
            let range = self.guides.range(strand);
            follow(&self.guides.positions()[range.clone()], &guides[range], head, motions);
        });
        let strands = 0..self.influences.len();
        each(strands, &self.offsets, out, &|strand, points| {
            let from = self.offsets[strand] as usize;
            let Influence { weights, .. } = &self.influences[strand];
            let places = &self.places[from..from + points.len()];
            for ((point, place), &rest) in points.iter_mut().zip(places).zip(&self.rest[from..]) {
                *point = carried(&self.motions, weights, place, rest);
            }
        });
    }

    /// Size of the buffers in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.rest)
            + size_of_val(&*self.offsets)
            + size_of_val(&*self.influences)
            + size_of_val(&*self.places)
            + size_of_val(&*self.motions)
            + size_of_val(self.guides.positions())
    }
}

/// Σ_g w_g ((1 − t) T_g,j + t T_g,j+1) x̄.
fn carried(motions: &[Affine3A], weights: &[f32; GUIDES_PER_STRAND], place: &Place, rest: Vec3) -> Vec3 {
    let rest = Vec3A::from(rest);
    let mut sum = Vec3A::ZERO;
    for ((&weight, &j), &t) in weights.iter().zip(&place.particles).zip(&place.fractions) {
        if weight == 0.0 {
            break;
        }
        let by = |motion: &Affine3A| motion.transform_point3a(rest);
        sum += weight * by(&motions[j as usize]).lerp(by(&motions[j as usize + 1]), t);
    }
    sum.into()
}

/// Calls `work(strand, values of the strand)` for every strand, on the threads of the pool; does
/// not allocate.
fn each<T: Send>(
    strands: std::ops::Range<usize>,
    offsets: &[u32],
    values: &mut [T],
    work: &(impl Fn(usize, &mut [T]) + Sync),
) {
    if strands.len() > STRANDS_PER_TASK {
        let middle = strands.start + strands.len() / 2;
        let (left, right) = values.split_at_mut((offsets[middle] - offsets[strands.start]) as usize);
        rayon::join(
            || each(strands.start..middle, offsets, left, work),
            || each(middle..strands.end, offsets, right, work),
        );
        return;
    }
    let mut rest = values;
    for strand in strands {
        let (of_strand, after) = rest.split_at_mut((offsets[strand + 1] - offsets[strand]) as usize);
        work(strand, of_strand);
        rest = after;
    }
}

/// The motion of each particle of a guide from `rest` in the head's space to `now` in the world.
fn follow(rest: &[Vec3], now: &[Vec3], head: &Pose, motions: &mut [Affine3A]) {
    let edge = |points: &[Vec3], i: usize| (points[i + 1] - points[i]).as_dvec3().normalize_or_zero();
    let motion = |turn: DQuat, i: usize| {
        let shift = now[i].as_dvec3() - turn * rest[i].as_dvec3();
        Affine3A::from_rotation_translation(turn.as_quat(), shift.as_vec3())
    };
    // The root moves with the head, and so does the hair around it.
    motions[0] = motion(head.rotation, 0);
    let mut before = turned(head.rotation, edge(rest, 0), edge(now, 0));
    for (i, out) in motions.iter_mut().enumerate().skip(1) {
        let mut after = before;
        if i + 1 < rest.len() {
            after = turned(before, edge(rest, i), edge(now, i));
        }
        // Both quaternions have the same sign, because they differ by less than half a turn.
        *out = motion((before + after).normalize(), i);
        before = after;
    }
}

/// The rotation `turn`, followed by the smallest rotation from the rotated `rest` to `now`.
fn turned(turn: DQuat, rest: DVec3, now: DVec3) -> DQuat {
    if rest == DVec3::ZERO || now == DVec3::ZERO {
        return turn;
    }
    (DQuat::from_rotation_arc((turn * rest).normalize(), now) * turn).normalize()
}
