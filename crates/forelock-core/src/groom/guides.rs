//! Linear hair skinning: a few simulated guides carry all the strands of a groom.
//!
//! # Theory
//! Each particle of a guide carries a rigid motion T_g,j: x ↦ c_j + R_j (x − c̄_j), from its place c̄_j at rest to where it is now, c_j. The
//! rotations follow the strand without twist: at the root R is the head's rotation, and from each edge to the next it is
//! turned by the smallest rotation that takes the edge, as it would be, to the edge as it is. A strand's particle at rest place x̄
//! and fraction s of its length comes to lie at
//!
//! x = Σ_g w_g ((1 − t) T_g,j + t T_g,j+1) x̄,
//!
//! where s falls on edge j of guide g at fraction t. The weights of a strand's k nearest guides, by the distance d of their roots, are
//! those of Franke and Little, w ∝ ((D − d)/(D d))² with D the distance of the next guide after them, and sum to 1: they do not jump from one strand to
//! its neighbour where a guide leaves the set.
//!
//! Rigid motions rather than mere displacements, x̄ + Σ w (c − c̄): a displacement keeps the offset of a strand from its guide as it was at
//! rest, so hair that swings up loses its volume and the far side of a lock passes through the near one. With rotations the whole lock turns.
//! They cost little, for they are computed for guides only.
//!
//! At rest every T is the identity, and when head and guides move as one rigid body every T is that motion: strands come out exactly, to rounding.
//!
//! # Practice
//! [`Skinning::new`] chooses guides by farthest-point sampling of the roots (Gonzalez 1985), so that no root is far from one, and
//! finds every strand's guides once; [`Skinning::guides`] is the groom to simulate; [`Skinning::skin`] places all strands, in parallel,
//! without allocating. Guides and strands may have any numbers of particles.
//!
//! # Limitations
//! The mean of rigid motions that differ is not rigid: strands between guides that part are shortened, and nothing keeps them out of solids. Guides are
//! near by their roots alone: a strand beside a parting follows guides on both sides of it.

use glam::{DQuat, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use super::Groom;
use super::grow::random::Random;
use super::nearest::Nearest;
use crate::pose::Pose;

/// Guides that a strand follows, at most.
pub const GUIDES_PER_STRAND: usize = 4;

/// Strands that one task places.
const STRANDS_PER_TASK: usize = 64;

/// Why a groom cannot be carried by guides.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GuidesError {
    /// No guides were asked for.
    #[error("hair needs 1 guide or more to follow")]
    None,
    /// A strand that nothing can follow or carry.
    #[error("strand {0} has fewer than 2 particles, or one that is not finite: repair the groom first")]
    Strand(usize),
}

/// Which guides a strand follows.
#[derive(Clone, Copy, Debug, Default)]
struct Influence {
    guides: [u32; GUIDES_PER_STRAND],
    weights: [f32; GUIDES_PER_STRAND],
}

/// Where on each of its guides a particle is carried: the particle before it, among all guides', and the fraction of the edge.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    particles: [u32; GUIDES_PER_STRAND],
    fractions: [f32; GUIDES_PER_STRAND],
}

/// The motion of a guide's particle: x ↦ `turn` x + `shift`.
#[derive(Clone, Copy, Debug, Default)]
struct Motion {
    turn: Mat3,
    shift: Vec3,
}

/// A groom and the guides that carry it.
#[derive(Clone, Debug)]
pub struct Skinning {
    chosen: Vec<usize>,
    guides: Groom,
    /// Of the whole groom.
    rest: Vec<Vec3>,
    offsets: Vec<u32>,
    influences: Vec<Influence>,
    places: Vec<Place>,
    /// Workspace, one a guide's particle.
    motions: Vec<Motion>,
}

/// `count` strands of `groom` whose roots cover it evenly: each the farthest from those before it, the first one drawn with `seed`.
///
/// All strands, in their order, if there are no more than `count`.
pub fn choose_guides(groom: &Groom, count: usize, seed: u64) -> Vec<usize> {
    let strands = groom.strand_count();
    if count >= strands {
        return (0..strands).collect();
    }
    let roots: Vec<Vec3> = groom.strands().map(|s| s.first().copied().unwrap_or(Vec3::NAN)).collect();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the strands")]
    let mut next = ((Random::new(seed, 0).unit() * strands as f32) as usize).min(strands - 1);
    let mut distances = vec![f32::INFINITY; strands];
    let mut chosen = Vec::with_capacity(count);
    while chosen.len() < count {
        chosen.push(next);
        // Never again, even where all that is left lies in one place.
        distances[next] = f32::NEG_INFINITY;
        let root = roots[next];
        let farthest = |a: (f32, usize), b: (f32, usize)| {
            if a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)).is_ge() { a } else { b }
        };
        let looked = distances.par_iter_mut().zip(&roots).enumerate().map(|(strand, (distance, other))| {
            *distance = distance.min(root.distance_squared(*other));
            (*distance, strand)
        });
        next = looked.reduce(|| (f32::NEG_INFINITY, usize::MAX), farthest).1;
    }
    chosen.sort_unstable();
    chosen
}

impl Skinning {
    /// `groom` carried by `count` of its strands, chosen with `seed`.
    ///
    /// # Errors
    /// [`GuidesError`] if there are to be no guides, or a strand can neither carry nor follow.
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
            let at = self::fractions(strand);
            (influence, at.iter().map(|&at| place(&guides, &fractions, &influence, at)).collect::<Vec<_>>())
        });
        let (influences, places): (Vec<Influence>, Vec<Vec<Place>>) = found.unzip();
        Ok(Self {
            chosen,
            rest: groom.positions().to_vec(),
            offsets: groom.strand_offsets().to_vec(),
            influences,
            places: places.concat(),
            motions: vec![Motion::default(); guides.particle_count()],
            guides,
        })
    }

    /// The guides, as a groom to be simulated.
    pub fn guides(&self) -> &Groom {
        &self.guides
    }

    /// Which strands of the groom the guides are, in order.
    pub fn chosen(&self) -> &[usize] {
        &self.chosen
    }

    /// The guides that strand `strand` follows, by their number among the guides, and their weights, which sum to 1.
    ///
    /// # Panics
    /// If there is no such strand.
    pub fn follows(&self, strand: usize) -> impl Iterator<Item = (usize, f32)> {
        let Influence { guides, weights } = self.influences[strand];
        guides.into_iter().map(|g| g as usize).zip(weights).filter(|&(_, weight)| weight > 0.0)
    }

    /// Places all strands into `out` (metres, world space, the groom's order) when the head is at `head` and the guides' particles at `guides`
    /// (metres, world space, the guides' order). Allocates nothing if `out` has the room.
    ///
    /// # Panics
    /// If `guides` are not as many particles as the guides have.
    pub fn skin(&mut self, head: &Pose, guides: &[Vec3], out: &mut Vec<Vec3>) {
        assert_eq!(guides.len(), self.motions.len(), "one position for each of the guides' particles");
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

    /// Bytes held.
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
fn carried(motions: &[Motion], weights: &[f32; GUIDES_PER_STRAND], place: &Place, rest: Vec3) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for ((&weight, &j), &t) in weights.iter().zip(&place.particles).zip(&place.fractions) {
        if weight == 0.0 {
            break;
        }
        let by = |motion: &Motion| motion.turn * rest + motion.shift;
        sum += weight * by(&motions[j as usize]).lerp(by(&motions[j as usize + 1]), t);
    }
    sum
}

/// Calls `work(strand, its part of the values)` for every strand, over the threads of the pool; allocates nothing.
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
        let (own, after) = rest.split_at_mut((offsets[strand + 1] - offsets[strand]) as usize);
        work(strand, own);
        rest = after;
    }
}

/// The motion of each particle of a guide from `rest` in the head's space to `now` in the world.
fn follow(rest: &[Vec3], now: &[Vec3], head: &Pose, motions: &mut [Motion]) {
    let edge = |points: &[Vec3], i: usize| (points[i + 1] - points[i]).as_dvec3().normalize_or_zero();
    let motion = |turn: DQuat, i: usize| {
        let shift = now[i].as_dvec3() - turn * rest[i].as_dvec3();
        Motion { turn: Mat3::from_quat(turn.as_quat()), shift: shift.as_vec3() }
    };
    // The root is on the head, and so is the hair around it.
    motions[0] = motion(head.rotation, 0);
    let mut before = turned(head.rotation, edge(rest, 0), edge(now, 0));
    for (i, out) in motions.iter_mut().enumerate().skip(1) {
        let mut after = before;
        if i + 1 < rest.len() {
            after = turned(before, edge(rest, i), edge(now, i));
        }
        // Both are within half a turn of each other, as unit quaternions of the same sign.
        *out = motion((before + after).normalize(), i);
        before = after;
    }
}

/// The rotation `turn` followed by the smallest that takes the turned `rest` to `now`.
fn turned(turn: DQuat, rest: DVec3, now: DVec3) -> DQuat {
    if rest == DVec3::ZERO || now == DVec3::ZERO {
        return turn;
    }
    (DQuat::from_rotation_arc((turn * rest).normalize(), now) * turn).normalize()
}

/// The guides that a strand with its root at `root` follows, nearest first.
fn influence(tree: &Nearest, root: Vec3, guides: usize) -> Influence {
    let mut found = Vec::with_capacity(GUIDES_PER_STRAND + 2);
    tree.find(root, GUIDES_PER_STRAND + 1, f32::INFINITY, &mut found);
    let distance = |k: usize| found.get(k).map_or(0.0, |&(squared, _)| squared.sqrt());
    let count = GUIDES_PER_STRAND.min(guides).min(found.len());
    let farthest = distance(count - 1);
    // Without a next guide the farthest counts a little.
    let reach = if found.len() > count { distance(count) } else { 1.5 * farthest };
    let mut influence = Influence::default();
    for (k, &(_, guide)) in found.iter().take(count).enumerate() {
        influence.guides[k] = guide;
        let d = distance(k);
        influence.weights[k] = if d > 0.0 { ((reach - d) / (reach * d)).powi(2) } else { f32::INFINITY };
    }
    let sum: f32 = influence.weights.iter().sum();
    if influence.weights[0].is_infinite() || !sum.is_normal() {
        // On a guide's root, or all of them as far: the nearest.
        influence.weights = [0.0; GUIDES_PER_STRAND];
        influence.weights[0] = 1.0;
        return influence;
    }
    influence.weights.iter_mut().for_each(|weight| *weight /= sum);
    influence
}

/// The fraction of the strand's length at each of its particles.
fn fractions(strand: &[Vec3]) -> Vec<f32> {
    let mut arc = 0.0;
    let mut arcs = vec![0.0];
    for edge in strand.windows(2) {
        arc += f64::from(edge[0].distance(edge[1]));
        arcs.push(arc);
    }
    let last = (strand.len() - 1) as f64;
    // A strand without length is taken as evenly spaced.
    let share = |(i, at): (usize, &f64)| if arc > 0.0 { at / arc } else { i as f64 / last };
    #[expect(clippy::cast_possible_truncation, reason = "fractions in [0, 1]")]
    arcs.iter().enumerate().map(|entry| share(entry) as f32).collect()
}

/// Where on its guides a particle at fraction `at` of its strand is carried; `fractions` are the guides'.
fn place(guides: &Groom, fractions: &[Vec<f32>], influence: &Influence, at: f32) -> Place {
    let mut place = Place::default();
    for (k, &guide) in influence.guides.iter().enumerate() {
        let along = &fractions[guide as usize];
        let edge = along.partition_point(|&f| f <= at).saturating_sub(1).min(along.len() - 2);
        let width = along[edge + 1] - along[edge];
        #[expect(clippy::cast_possible_truncation, reason = "offsets are 32-bit, and so are particles")]
        let particle = (guides.range(guide as usize).start + edge) as u32;
        place.particles[k] = particle;
        place.fractions[k] = if width > 0.0 { ((at - along[edge]) / width).clamp(0.0, 1.0) } else { 0.0 };
    }
    place
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::groom::grow::{GrowParams, grow_on_head};

    fn hair() -> Groom {
        let params = GrowParams { strands: 600, ..GrowParams::preset("wavy").unwrap() };
        let grown = grow_on_head(&params).unwrap();
        // Mixed lengths and counts.
        let strands = grown.strands().enumerate().map(|(s, points)| points[..5 + s % 20].to_vec());
        Groom::from_strands(strands.collect::<Vec<_>>()).unwrap()
    }

    fn farthest(a: &[Vec3], b: &[Vec3]) -> f32 {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
    }

    #[test]
    fn at_rest_and_under_rigid_motions_strands_come_out_exactly() {
        let groom = hair();
        let mut skinning = Skinning::new(&groom, 40, 1).unwrap();
        let mut out = Vec::new();
        let half = std::f64::consts::PI * 0.97;
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), half);
        for pose in [Pose::IDENTITY, Pose::new(turn, DVec3::new(0.7, -0.2, 0.4))] {
            let moved = |p: &Vec3| pose.transform_point(p.as_dvec3()).as_vec3();
            let guides: Vec<Vec3> = skinning.guides().positions().iter().map(moved).collect();
            skinning.skin(&pose, &guides, &mut out);
            let expected: Vec<Vec3> = groom.positions().iter().map(moved).collect();
            // Float32 positions of the guides, 6e-8 at a metre, turn their edges of 1 cm by 1e-5; a strand is centimetres from its guide.
            assert!(farthest(&out, &expected) < 2e-6, "{} at {pose:?}", farthest(&out, &expected));
        }
    }

    #[test]
    fn guides_are_followed_by_themselves_and_neighbours() {
        let groom = hair();
        let mut skinning = Skinning::new(&groom, 40, 1).unwrap();
        // Each guide swings about its root by its own angle.
        let mut guides = skinning.guides().clone();
        for g in 0..guides.strand_count() {
            let root = guides.strand(g)[0];
            let turn = glam::Quat::from_rotation_x(0.3 + 0.2 * root.x / 0.1);
            let range = guides.range(g);
            guides.positions_mut()[range].iter_mut().for_each(|p| *p = root + turn * (*p - root));
        }
        let mut out = Vec::new();
        skinning.skin(&Pose::IDENTITY, guides.positions(), &mut out);
        for (g, &strand) in skinning.chosen().iter().enumerate() {
            let range = groom.range(strand);
            assert!(farthest(&out[range], guides.strand(g)) < 1e-6, "guide {g}");
        }
        for s in 0..groom.strand_count() {
            let range = groom.range(s);
            let (points, rest) = (&out[range], groom.strand(s));
            assert!(points[0].distance(rest[0]) < 1e-6, "root {s} has left the head");
            let turn = glam::Quat::from_rotation_x(0.3 + 0.2 * rest[0].x / 0.1);
            let last = rest.len() - 1;
            let expected = rest[0] + turn * (rest[last] - rest[0]);
            let swing = expected.distance(rest[last]);
            assert!(points[last].distance(expected) < 0.15 * swing + 0.01, "strand {s}");
        }
    }

    #[test]
    fn weights_sum_to_one_and_do_not_jump() {
        let row = |n: usize, step: f32| {
            Groom::from_strands(
                (0..n).map(|i| [Vec3::X * (step * i as f32), Vec3::new(step * i as f32, -0.1, 0.0)]),
            )
            .unwrap()
        };
        let groom = row(4001, 2.5e-5);
        let skinning = Skinning::new(&groom, 12, 3).unwrap();
        let weights = |s: usize| {
            let mut all = vec![0.0f32; 12];
            skinning.follows(s).for_each(|(g, w)| all[g] += w);
            all
        };
        let mut before = weights(0);
        for s in 1..4001 {
            let now = weights(s);
            assert!((now.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            let jump = now.iter().zip(&before).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(jump < 0.02, "strand {s}: {jump}");
            before = now;
        }
    }

    #[test]
    fn guides_cover_the_roots_evenly_and_are_seeded() {
        let groom = hair();
        let chosen = choose_guides(&groom, 50, 7);
        assert_eq!(chosen, choose_guides(&groom, 50, 7));
        assert_ne!(chosen, choose_guides(&groom, 50, 8));
        let distance = |a: usize, b: usize| groom.strand(a)[0].distance(groom.strand(b)[0]);
        let far =
            (0..600).map(|s| chosen.iter().map(|&g| distance(s, g)).fold(1.0, f32::min)).fold(0.0, f32::max);
        let pairs =
            chosen.iter().flat_map(|&a| chosen.iter().filter(move |&&b| b != a).map(move |&b| (a, b)));
        let apart = pairs.map(|(a, b)| distance(a, b)).fold(1.0, f32::min);
        // Gonzalez: no root is farther from a guide than guides are from each other.
        assert!(far <= apart, "{far} {apart}");
        assert_eq!(choose_guides(&groom, 1000, 1).len(), 600);
        // Many strands with one root: no strand is chosen twice.
        let same = groom.only(&[3; 9]);
        assert_eq!(choose_guides(&same, 5, 1).len(), 5);
        assert!(choose_guides(&same, 5, 1).windows(2).all(|w| w[0] < w[1]));
    }

    #[test]
    fn any_numbers_of_guides_and_particles() {
        let one = Groom::from_strands([[Vec3::ZERO, Vec3::NEG_Y]]).unwrap();
        for count in [1, 2, 9] {
            let mut skinning = Skinning::new(&one, count, 1).unwrap();
            let mut out = Vec::new();
            skinning.skin(&Pose::IDENTITY, &[Vec3::ZERO, Vec3::X], &mut out);
            assert!(farthest(&out, &[Vec3::ZERO, Vec3::X]) < 1e-6);
        }
        assert!(matches!(Skinning::new(&one, 0, 1), Err(GuidesError::None)));
        let short = Groom::from_strands([vec![Vec3::ZERO]]).unwrap();
        assert!(matches!(Skinning::new(&short, 1, 1), Err(GuidesError::Strand(0))));
        let groom = hair();
        for count in [1, 2, 3, 4, 5, 599, 600] {
            let mut skinning = Skinning::new(&groom, count, 1).unwrap();
            let guides = skinning.guides().positions().to_vec();
            let mut out = Vec::new();
            skinning.skin(&Pose::IDENTITY, &guides, &mut out);
            assert!(farthest(&out, groom.positions()) < 1e-6, "{count} guides");
        }
    }
}
