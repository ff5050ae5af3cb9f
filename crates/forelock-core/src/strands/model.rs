//! Model: constant data derived once from a groom and the parameters.

use super::masses::MASS_RANGE;
use super::strand_frame::rest_edges;
use crate::curve::hilbert;
use crate::groom::Groom;
use crate::lane::{LANES, Real, Row};
use crate::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Strands of equal particle count, one a lane.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Place of the first particle: component `c` of particle `i` of the block is in row
    /// `3 (first + i) + c`.
    pub first: usize,
    /// Particles per strand.
    pub particles: usize,
    /// The groom's strand in each lane. Lanes from `live` on repeat the last strand and are ignored
    /// on output.
    pub strands: [u32; LANES],
    /// Lanes that hold a strand; the others are padding.
    pub live: usize,
}

impl Block {
    /// The block's places in arrays of one row a particle.
    pub fn range(&self) -> Range<usize> {
        self.first..self.first + self.particles
    }
}

/// Strands as plain arrays, the input of [`Model::new`].
#[derive(Clone, Copy, Debug)]
pub struct Strands<'a, T> {
    /// Rest positions in the head's frame, `[P]`.
    pub positions: &'a [[T; 3]],
    /// Offsets, `[S + 1]`.
    pub offsets: &'a [u32],
    /// Stiffness of each strand's springs and ties relative to the parameters', `[S]`; none = 1.
    pub stiffness: Option<&'a [f32]>,
    /// Mass of each particle relative to the unit mass of the parameters' rates, `[P]`, each in
    /// [`MASS_RANGE`]; none = 1. See [`Model::masses`].
    pub masses: Option<&'a [f32]>,
}

impl<'a, T> Strands<'a, T> {
    /// Strands of equal stiffness whose particles have equal masses.
    pub fn new(positions: &'a [[T; 3]], offsets: &'a [u32]) -> Self {
        Self { positions, offsets, stiffness: None, masses: None }
    }
}

impl<'a> From<&'a Groom> for Strands<'a, f32> {
    fn from(groom: &'a Groom) -> Self {
        Self {
            positions: bytemuck::cast_slice(groom.positions()),
            offsets: groom.strand_offsets(),
            stiffness: groom.stiffness.as_deref(),
            masses: None,
        }
    }
}

/// The particles of the groom between which a simulated one lies ([`Model::in_groom`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceInGroom {
    /// Index in the groom of the nearest of its particles on the root's side. A particle of the
    /// groom is its own neighbour on both sides.
    pub before: usize,
    /// The same on the tip's side.
    pub after: usize,
    /// Fraction of the particles of the edge that have been passed, 0 at `before`, less than 1.
    pub share: f32,
}

/// [`Model::reach`] over the hair's own radius at rest.
const REACH: f64 = 1.15;

/// Packed strands at rest. The arrays hold rows of [`LANES`] strands: see [`Block::first`].
#[derive(Clone, Debug)]
pub struct Model<T> {
    /// Blocks in memory order.
    pub blocks: Vec<Block>,
    /// Rest positions relative to `centre`, head frame, `[3 × places]` rows, metres.
    pub rest: Vec<Row<T>>,
    /// Rest lengths to the next, second and third next particle, `[3 × places]` rows, metres; 0
    /// past the tip.
    pub rest_lengths: Vec<Row<T>>,
    /// One over the rest length to the next particle, `[places]` rows, 1/m; 0 past the tip.
    pub inverse_edges: Vec<Row<T>>,
    /// The rest edge to each particle in the frame of the particle before it, and for roots the
    /// normal of their frame: `[3 × places]` rows, metres, from [`rest_edges`]. Empty until
    /// [`Model::find_frames`].
    pub local: Vec<Row<T>>,
    /// Strand lengths, a row a block, metres.
    pub strand_lengths: Vec<Row<T>>,
    /// Relative stiffnesses of strands, a row a block.
    pub stiffness: Vec<Row<T>>,
    /// Masses relative to the unit mass of the parameters' rates, `[places]` rows; empty: 1. They
    /// count in the strand solve, for drag and in the length pass. Interactions between strands
    /// count hair by its length.
    pub masses: Vec<Row<T>>,
    /// The smallest of them.
    pub least_mass: f64,
    /// The origin of stored rest positions in the head's frame: the centre of their bounding box.
    /// It keeps coordinates small, so that float32 resolves edges anywhere in the world.
    pub centre: [f64; 3],
    /// Radius of a ball about `centre` that contains the hair at rest with a margin, metres.
    pub reach: f64,
    /// Radius of a ball about `centre` that contains the hair in any pose, metres: the largest sum
    /// of a root's distance and the length of its strand, with a margin.
    pub bound: f64,
    /// Counted from the root, every `every`-th particle of a strand is from the groom. The solver
    /// has added the others ([`Model::refined`]).
    pub every: u32,
    /// Strands of the groom, S.
    pub strand_count: usize,
    /// Particles of the groom, P.
    pub particle_count: usize,
    /// Index of each strand's first particle in the groom's order, `[S + 1]`.
    pub offsets: Vec<u32>,
}

/// Why strands cannot be packed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PackError {
    /// No strands at all.
    #[error("the groom has no strands: nothing to simulate")]
    Empty,
    /// A strand with fewer than two particles.
    #[error(
        "strand {strand} has {particles} particle(s), but a strand needs 2 or more: `groom::repair` \
         and `forelock convert` drop such strands"
    )]
    TooShort {
        /// Which strand.
        strand: usize,
        /// Particles it has.
        particles: usize,
    },
    /// A position that is not finite.
    #[error(
        "strand {strand} has a position that is not finite at its particle {particle}: `groom::repair` and \
         `forelock convert` drop such strands"
    )]
    NonFinite {
        /// Which strand.
        strand: usize,
        /// Which of its particles.
        particle: usize,
    },
    /// Masses that are not one per particle, or one out of [`MASS_RANGE`].
    #[error(
        "{found} masses for {expected} particles, or one that is not between {} and {}: give the mass of each \
         particle relative to the mean",
        MASS_RANGE.start(), MASS_RANGE.end()
    )]
    Masses {
        /// Masses given.
        found: usize,
        /// Particles.
        expected: usize,
    },
    /// Masses from widths for a groom without widths.
    #[error("masses cannot follow widths that the groom does not have: set widths, or use uniform masses")]
    NoWidths,
    /// A solver's refinement of the strands with another number of particles than it announced.
    #[error(
        "the solver refines the strands to {found} particles, but its refinement has {expected}: correct `refine`"
    )]
    Refinement {
        /// Particles given.
        found: usize,
        /// (N − 1) `every` + 1 for each strand of N, summed.
        expected: usize,
    },
    /// An edge of no length.
    #[error(
        "strand {strand} repeats a point at its particle {particle}: `groom::repair` and `forelock convert` \
         remove repeated points; of strands that were grown or resampled lower the number of particles"
    )]
    Repeated {
        /// Which strand.
        strand: usize,
        /// The second of the two particles.
        particle: usize,
    },
}

/// Numbers points along a [`hilbert`] curve.
struct Nearness {
    low: [f64; 3],
    per_metre: f64,
}

impl Nearness {
    fn new<T: Real>(positions: &[[T; 3]]) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for x in positions {
            for c in 0..3 {
                let x = x[c].to_f64().unwrap_or(0.0);
                (low[c], high[c]) = (low[c].min(x), high[c].max(x));
            }
        }
        let side = (0..3).map(|c| high[c] - low[c]).fold(f64::MIN_POSITIVE, f64::max);
        Self { low, per_metre: 1023.0 / side }
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0 to 1023, and casts saturate"
    )]
    fn code<T: Real>(&self, x: &[T; 3]) -> u32 {
        hilbert([0, 1, 2].map(|c| ((x[c].to_f64().unwrap_or(0.0) - self.low[c]) * self.per_metre) as u32))
    }
}

impl<T> Model<T> {
    /// Particles of the groom, without those that a solver added.
    pub fn groom_particles(&self) -> usize {
        self.groom_offset(self.strand_count)
    }

    /// The index of the first particle of `strand` in the groom.
    pub fn groom_offset(&self, strand: usize) -> usize {
        // A strand with N particles of the groom has (N − 1) every + 1 simulated particles.
        let every = self.every as usize;
        (self.offsets[strand] as usize + strand * (every - 1)) / every
    }

    /// Where particle `i` of `strand`, counted from the root, lies between those of the groom.
    pub fn in_groom(&self, strand: usize, i: usize) -> PlaceInGroom {
        let (first, every) = (self.groom_offset(strand), self.every as usize);
        #[expect(clippy::cast_precision_loss, reason = "a few particles an edge")]
        let share = (i % every) as f32 / every as f32;
        PlaceInGroom { before: first + i / every, after: first + i.div_ceil(every), share }
    }

    /// The map from rest positions relative to `centre` to positions relative to `origin`, for the
    /// head pose `head`.
    pub fn about_centre(&self, head: &Pose, origin: DVec3) -> Pose {
        let translation = head.transform_point(self.centre.into()) - origin;
        Pose { rotation: head.rotation, translation }
    }
}

impl<T: Real> Model<T> {
    /// Packs `strands` into blocks. The strands of a block have equal particle counts, and among
    /// these the middles of neighbours are close to each other, so that a block accesses few cells
    /// of a grid or a distance field.
    ///
    /// # Errors
    /// [`PackError`] if there are no strands, or one that cannot be simulated.
    pub fn new(strands: &Strands<'_, T>) -> Result<Self, PackError> {
        check(strands)?;
        Ok(Self::pack(strands, strands.masses, 1))
    }

    /// [`Model::new`] for strands with `every` − 1 further particles in each edge. `refine` gives
    /// the rest positions of all particles in the head's frame, strand after strand: (N − 1)
    /// `every` + 1 for a strand of N, metres. Masses between those of the groom are interpolated.
    ///
    /// # Errors
    /// The same errors as [`Model::new`], and [`PackError::Refinement`] for another number of
    /// positions.
    pub fn refined(
        strands: &Strands<'_, T>,
        every: u32,
        refine: impl FnOnce(&Strands<'_, T>) -> Vec<[T; 3]>,
    ) -> Result<Self, PackError> {
        check(strands)?;
        let of_strand = |(strand, offset): (u32, &u32)| (offset - strand).saturating_mul(every) + strand;
        let offsets: Vec<u32> = (0..).zip(strands.offsets).map(of_strand).collect();
        let positions = refine(strands);
        let (found, expected) = (positions.len(), offsets[offsets.len() - 1] as usize);
        if found != expected || every == 0 {
            return Err(PackError::Refinement { found, expected });
        }
        let refined = Strands { positions: &positions, offsets: &offsets, masses: None, ..*strands };
        check(&refined)?;
        Ok(Self::pack(&refined, strands.masses, every))
    }

    /// Packs strands that have been checked; `masses` are those of the groom.
    fn pack(strands: &Strands<'_, T>, masses: Option<&[f32]>, every: u32) -> Self {
        let strand_count = strands.offsets.len() - 1;
        let count = |s: u32| (strands.offsets[s as usize + 1] - strands.offsets[s as usize]) as usize;
        #[expect(clippy::cast_possible_truncation, reason = "offsets are 32-bit, so strand numbers are")]
        let mut order: Vec<u32> = (0..strand_count as u32).collect();
        let near = Nearness::new(strands.positions);
        order.sort_by_cached_key(|&s| {
            let middle = strands.offsets[s as usize] as usize + count(s) / 2;
            (count(s), near.code(&strands.positions[middle]))
        });

        let mut blocks = Vec::new();
        let mut first = 0;
        for same in order.chunk_by(|&a, &b| count(a) == count(b)) {
            for chunk in same.chunks(LANES) {
                let particles = count(chunk[0]);
                let lane = |k: usize| chunk[k.min(chunk.len() - 1)];
                blocks.push(Block {
                    first,
                    particles,
                    strands: std::array::from_fn(lane),
                    live: chunk.len(),
                });
                first += particles;
            }
        }
        let mut model = Self {
            rest: vec![Row([T::zero(); LANES]); 3 * first],
            rest_lengths: vec![Row([T::zero(); LANES]); 3 * first],
            inverse_edges: vec![Row([T::zero(); LANES]); first],
            local: Vec::new(),
            strand_lengths: vec![Row([T::zero(); LANES]); blocks.len()],
            stiffness: vec![Row([T::one(); LANES]); blocks.len()],
            least_mass: f64::from(masses.unwrap_or(&[1.0]).iter().copied().fold(f32::INFINITY, f32::min)),
            masses: vec![Row([T::one(); LANES]); if masses.is_some() { first } else { 0 }],
            centre: centre(strands.positions),
            reach: 0.0,
            bound: 0.0,
            blocks,
            every,
            strand_count,
            particle_count: strands.positions.len(),
            offsets: strands.offsets.to_vec(),
        };
        for block in 0..model.blocks.len() {
            for lane in 0..LANES {
                model.fill_lane(strands, block, lane);
                if let Some(masses) = masses {
                    model.fill_masses(masses, block, lane);
                }
            }
        }
        model.reach = REACH * model.farthest();
        model.bound = REACH * model.longest_reach();
        model
    }

    /// Fills a lane with the masses of the groom's particles.
    fn fill_masses(&mut self, masses: &[f32], index: usize, lane: usize) {
        let (range, strand) = (self.blocks[index].range(), self.blocks[index].strands[lane] as usize);
        for (i, place) in range.enumerate() {
            let PlaceInGroom { before, after, share } = self.in_groom(strand, i);
            let mass = masses[before] + (masses[after] - masses[before]) * share;
            self.masses[place].0[lane] = crate::strands::number(f64::from(mass));
        }
    }

    fn fill_lane(&mut self, strands: &Strands<'_, T>, index: usize, lane: usize) {
        let block = &self.blocks[index];
        let strand = block.strands[lane] as usize;
        let from = strands.offsets[strand] as usize;
        let points = &strands.positions[from..from + block.particles];
        for (i, point) in points.iter().enumerate() {
            for (c, x) in point.iter().enumerate() {
                let centred = x.to_f64().unwrap_or(0.0) - self.centre[c];
                self.rest[3 * (block.first + i) + c].0[lane] = T::from(centred).unwrap_or_else(T::zero);
            }
        }
        let rest = |i: usize, c: usize| self.rest[3 * (block.first + i) + c].0[lane];
        let distance = |i: usize, j: usize| {
            (0..3).fold(T::zero(), |sum, c| sum + (rest(j, c) - rest(i, c)).powi(2)).sqrt()
        };
        let mut length = T::zero();
        for i in 0..points.len() {
            for reach in 1..=3usize.min(points.len() - 1 - i) {
                self.rest_lengths[3 * (block.first + i) + reach - 1].0[lane] = distance(i, i + reach);
            }
            let edge = self.rest_lengths[3 * (block.first + i)].0[lane];
            if edge > T::zero() {
                self.inverse_edges[block.first + i].0[lane] = edge.recip();
            }
            length = length + edge;
        }
        self.strand_lengths[index].0[lane] = length;
        if let Some(scale) = strands.stiffness.and_then(|s| T::from(s[strand])) {
            self.stiffness[index].0[lane] = scale;
        }
    }

    /// Computes `local`, unless it is there already.
    pub fn find_frames(&mut self) {
        if self.local.len() == self.rest.len() {
            return;
        }
        self.local.resize(self.rest.len(), Row([T::zero(); LANES]));
        for block in &self.blocks {
            for lane in 0..LANES {
                let point = |place| {
                    crate::strands::vector(&self.rest, place, lane).map(|x| x.to_f64().unwrap_or(0.0)).into()
                };
                let points: Vec<DVec3> = block.range().map(point).collect();
                for (place, edge) in block.range().zip(rest_edges(&points)) {
                    for (c, x) in edge.to_array().into_iter().enumerate() {
                        self.local[3 * place + c].0[lane] = crate::strands::number(x);
                    }
                }
            }
        }
    }

    /// The block of each place.
    pub fn block_of_places(&self) -> Vec<u32> {
        let mut found = vec![0; self.places()];
        for (number, block) in (0..).zip(&self.blocks) {
            found[block.range()].fill(number);
        }
        found
    }

    /// The largest sum of a root's distance from the centre and the length of its strand, metres.
    fn longest_reach(&self) -> f64 {
        let number = |x: T| x.to_f64().unwrap_or(0.0);
        let of_lane = |index: usize, block: &Block, lane: usize| {
            let root = crate::strands::vector(&self.rest, block.first, lane).map(number);
            DVec3::from_array(root).length() + number(self.strand_lengths[index].0[lane])
        };
        let of_block = |(index, block): (usize, &Block)| {
            (0..block.live).map(|lane| of_lane(index, block, lane)).fold(0.0, f64::max)
        };
        self.blocks.iter().enumerate().map(of_block).fold(0.0, f64::max)
    }

    /// The largest distance of a particle at rest from the centre, metres.
    fn farthest(&self) -> f64 {
        let square = |rows: &[Row<T>], lane: usize| {
            rows.iter().map(|row| row.0[lane].to_f64().unwrap_or(0.0).powi(2)).sum::<f64>()
        };
        let squares =
            self.rest.chunks_exact(3).flat_map(|rows| (0..LANES).map(move |lane| square(rows, lane)));
        squares.fold(0.0, f64::max).sqrt()
    }

    /// The blocks in at most `count` ranges of equal length; the split does not depend on the
    /// number of threads.
    pub(crate) fn parts(&self, count: usize) -> impl Iterator<Item = Range<usize>> + use<T> {
        let blocks = self.blocks.len();
        let share = blocks.div_ceil(count).max(1);
        (0..blocks).step_by(share).map(move |from| from..(from + share).min(blocks))
    }

    /// The componentwise minimum and maximum of `at` over all places, without the padding lanes,
    /// whose positions may differ from their strand's.
    pub(crate) fn extent(&self, at: impl Fn(usize) -> [[f32; LANES]; 3] + Sync) -> [[f32; 3]; 2] {
        const NONE: [[f32; 3]; 2] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        let of = |block: &Block| {
            let mut ends = [[[f32::INFINITY; LANES]; 3], [[f32::NEG_INFINITY; LANES]; 3]];
            for place in block.range() {
                let at = at(place);
                for c in 0..3 {
                    for (k, x) in at[c].into_iter().enumerate() {
                        ends[0][c][k] = ends[0][c][k].min(x);
                        ends[1][c][k] = ends[1][c][k].max(x);
                    }
                }
            }
            let live = |row: [f32; LANES]| row.into_iter().take(block.live);
            [
                ends[0].map(|row| live(row).fold(f32::INFINITY, f32::min)),
                ends[1].map(|row| live(row).fold(f32::NEG_INFINITY, f32::max)),
            ]
        };
        let join = |a: [[f32; 3]; 2], b: [[f32; 3]; 2]| {
            [[0, 1, 2].map(|c| a[0][c].min(b[0][c])), [0, 1, 2].map(|c| a[1][c].max(b[1][c]))]
        };
        self.blocks.par_iter().with_min_len(16).map(of).reduce(|| NONE, join)
    }

    /// The number of places: particles of a lane, over all blocks.
    pub fn places(&self) -> usize {
        self.rest.len() / 3
    }

    /// Bytes that the model holds.
    pub fn bytes(&self) -> usize {
        let rows = self.rest.len()
            + self.rest_lengths.len()
            + self.inverse_edges.len()
            + self.local.len()
            + self.strand_lengths.len()
            + self.stiffness.len()
            + self.masses.len();
        rows * size_of::<Row<T>>() + size_of_val(&*self.blocks) + size_of_val(&*self.offsets)
    }

    /// The largest number of particles of a strand.
    pub fn longest(&self) -> usize {
        self.blocks.iter().map(|b| b.particles).max().unwrap_or(0)
    }
}

/// Checks that `strands` can be simulated.
pub(crate) fn check<T: Real>(strands: &Strands<'_, T>) -> Result<(), PackError> {
    if strands.offsets.len() < 2 {
        return Err(PackError::Empty);
    }
    for (strand, ends) in strands.offsets.windows(2).enumerate() {
        let points = &strands.positions[ends[0] as usize..ends[1] as usize];
        if points.len() < 2 {
            return Err(PackError::TooShort { strand, particles: points.len() });
        }
        if let Some(particle) = points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(PackError::NonFinite { strand, particle });
        }
        if let Some(edge) = points.windows(2).position(|w| w[0] == w[1]) {
            return Err(PackError::Repeated { strand, particle: edge + 1 });
        }
    }
    let (expected, masses) = (strands.positions.len(), strands.masses.unwrap_or_default());
    if strands.masses.is_some()
        && (masses.len() != expected || !masses.iter().all(|mass| MASS_RANGE.contains(mass)))
    {
        return Err(PackError::Masses { found: masses.len(), expected });
    }
    Ok(())
}

/// The centre of the points' bounding box.
fn centre<T: Real>(points: &[[T; 3]]) -> [f64; 3] {
    std::array::from_fn(|c| {
        let values = points.iter().filter_map(|p| p[c].to_f64());
        let (lo, hi) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)));
        0.5 * (lo + hi)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight(counts: &[usize]) -> (Vec<[f64; 3]>, Vec<u32>) {
        let mut positions = Vec::new();
        let mut offsets = vec![0];
        for (s, &n) in counts.iter().enumerate() {
            positions.extend((0..n).map(|i| [s as f64, -(i as f64), 0.0]));
            offsets.push(positions.len() as u32);
        }
        (positions, offsets)
    }

    #[test]
    fn equal_counts_share_blocks_and_every_strand_has_one_lane() {
        let counts: Vec<usize> = (0..100).map(|s| 2 + s % 3).chain([1000]).collect();
        let (positions, offsets) = straight(&counts);
        let model = Model::new(&Strands::new(&positions, &offsets)).unwrap();
        let mut seen = vec![0; counts.len()];
        for block in &model.blocks {
            for &s in &block.strands[..block.live] {
                seen[s as usize] += 1;
                assert_eq!(counts[s as usize], block.particles);
            }
        }
        assert!(seen.iter().all(|&n| n == 1));
        assert_eq!(model.longest(), 1000);
        let last = model.blocks.last().unwrap();
        assert_eq!(model.rest_lengths[3 * last.first + 2].0[0], 3.0);
        assert_eq!(model.strand_lengths.last().unwrap().0[15], 999.0);
    }

    #[test]
    fn strands_that_cannot_be_simulated_are_reported() {
        let build = |positions: &[[f64; 3]], offsets: &[u32]| {
            Model::new(&Strands::new(positions, offsets)).map(|_| ())
        };
        assert_eq!(build(&[], &[0]), Err(PackError::Empty));
        assert_eq!(build(&[[0.0; 3]], &[0, 1]), Err(PackError::TooShort { strand: 0, particles: 1 }));
        let refined = |every, count| {
            let strands = Strands::new(&[[0.0; 3], [0.0, 1.0, 0.0]], &[0, 2]);
            let points = (0..count).map(|i| [0.0, f64::from(i), 0.0]).collect();
            Model::refined(&strands, every, |_| points).map(|model| model.particle_count)
        };
        assert_eq!(refined(3, 4), Ok(4));
        assert_eq!(refined(3, 5), Err(PackError::Refinement { found: 5, expected: 4 }));
        assert_eq!(refined(0, 2), Err(PackError::Refinement { found: 2, expected: 1 }));
        let nan = [[0.0; 3], [1.0, f64::NAN, 0.0]];
        assert_eq!(build(&nan, &[0, 2]), Err(PackError::NonFinite { strand: 0, particle: 1 }));
        assert_eq!(
            build(&[[0.0; 3], [0.0; 3]], &[0, 2]),
            Err(PackError::Repeated { strand: 0, particle: 1 })
        );
    }
}
