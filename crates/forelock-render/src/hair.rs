//! Preparation of strands for drawing: children, widths, and curves in pixels.
//!
//! # Theory
//! Between particles a strand is the Catmull-Rom curve through their projections. The curve is
//! split into pieces of a few pixels, short enough to be sorted by the depth of their midpoints.
//!
//! A simulated strand represents many hairs. A scalp has about 1.7 million hairs per square metre
//! (100,000 on a head). If the groom has fewer roots on the same area, each drawn strand is widened
//! by n^0.7, at most by a factor of 8, where n is the number of hairs that the strand represents.
//! So the covered area is close to that of full hair, and single strands stay thin. The area is
//! half the surface of the box around the roots. [`Settings::width_scale`] overrides the factor.
//!
//! Children are copies of a strand for display only; they are not simulated. Each has a fixed
//! random offset of at most half the distance between roots, which decreases towards the tip. The
//! default number of children gives 50 drawn strands per pixel of the picture's shorter side
//! (40,000 at 800 pixels), with at most 4 drawn for each simulated strand.
//!
//! Level of detail: where the strands nearest to the camera are thinner than
//! [`Settings::thinnest`], only a share of all curves is drawn, wider in proportion, so that they
//! cover the same area. A fixed random rank of each curve says which. As the share falls, the
//! curves of the highest ranks get thinner and vanish, so none pops.
//!
//! # Practice
//! Strands are prepared in chunks of a fixed size, each with separate lists of tiles, so the result
//! does not depend on the number of threads. A piece is created, sorted and lit only in the tiles
//! that show it.
//!
//! # Limitations
//! An edge of a strand with a control point behind the near plane is dropped, not clipped. Lighting
//! is computed at the ends of a piece and interpolated linearly between them.

use std::ops::{Add, Mul};

use glam::{Vec2, Vec3, Vec3Swizzles, Vec4, Vec4Swizzles};
use rayon::prelude::*;

use crate::camera::View;
use crate::colour::luminance;
use crate::drawable::{drawable, extent, strand_count};
use crate::random;
use crate::scene::{Scene, Settings, Strands, bounds_of};
use crate::tiles::{Bins, TILE, TileGrid};

/// Hairs per square metre of scalp.
const HAIRS_PER_M2: f32 = 1.7e6;
/// The largest automatic factor for widths.
const MAX_WIDTH_SCALE: f32 = 8.0;
/// The number of drawn strands, per pixel of the picture's shorter side, for which the number of
/// children is chosen.
const DRAWN_PER_PIXEL: usize = 50;
/// Curves (strands times children) in a chunk.
const CURVES_PER_CHUNK: usize = 2048;
/// The bits for the edge in an item of a tile's list. The other bits are the index of the curve.
const EDGE_BITS: u32 = 20;
/// The largest number of particles of a strand.
pub(crate) const MAX_PARTICLES: usize = 1_000_000;
/// The largest difference of a strand's tilt of scales from the mean, radians.
const TILT_RANGE: f32 = 0.03;
/// The desired length of a piece, pixels.
pub(crate) const PIECE_PX: f32 = 7.0;
/// The largest number of pieces of an edge.
pub(crate) const MAX_PIECES: f32 = 24.0;
/// Radius of the pixel filter.
pub(crate) const FILTER_RADIUS: f32 = 1.0;

/// A strand or one of its children.
#[derive(Clone, Copy, Debug)]
struct Curve {
    strand: u32,
    child: u32,
    /// The index of its first point in [`Chunk::points`].
    start: u32,
}

/// Projected strands of one group.
#[derive(Debug)]
pub(crate) struct Chunk {
    group: usize,
    curves: Vec<Curve>,
    /// For each point: pixel x, pixel y, inverse depth, and half the width in pixels. Each curve
    /// has one extra point before its root and one after its tip. Points behind the near plane are
    /// NaN.
    points: Vec<Vec4>,
    bins: Bins,
}

/// A short straight piece of a curve in pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    pub from: Vec2,
    pub to: Vec2,
    /// Inverse depth at the midpoint.
    pub nearness: f32,
    /// Half the width at the midpoint, pixels.
    pub half_width: f32,
    chunk: u32,
    item: u32,
    /// The positions of its ends on their edge, 0–1.
    t: [f32; 2],
    /// The indices of its ends in the list of points that the pieces of a tile share.
    pub points: [u32; 2],
    /// Whether the strand ends at `from`, and at `to`.
    pub ends: [bool; 2],
}

/// The properties of a point on a strand that lighting needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StrandPoint {
    pub position: Vec3,
    /// Unit, root to tip.
    pub tangent: Vec3,
    pub albedo: Vec3,
    /// The tilt of the scales, which varies between strands, radians.
    pub tilt: f32,
}

/// All strands of a scene, prepared for drawing.
pub(crate) struct Hair<'a> {
    groups: Vec<Group<'a>>,
    pub chunks: Vec<Chunk>,
    seed: u32,
}

/// A group of strands with derived quantities.
#[derive(Clone, Copy)]
pub(crate) struct Group<'a> {
    pub strands: Strands<'a>,
    /// Whether all particles are finite.
    pub is_finite: bool,
    /// The smallest box around the strands that can be drawn: (min, max).
    pub bounds: (Vec3, Vec3),
    pub children: u32,
    pub width_scale: f32,
    /// The largest offset of a child, metres.
    pub radius: f32,
    /// Logarithms of the albedos of hairs with pigment and without.
    log_albedos: [Vec3; 2],
    /// The share of the curves that are drawn.
    pub share: f32,
    seed: u32,
}

/// Curves that are drawn however thin they are.
const FEWEST: f32 = 2000.0;
/// Of how many strands the nearest one is looked for, at least.
const NEAREST_OF: usize = 512;
/// Of the curves that are drawn, the share that is thinner than the others.
const FADING: f32 = 0.1;

impl<'a> Group<'a> {
    /// The groups of `scene`. The offsets must be valid.
    pub fn all(scene: &Scene<'a>, settings: &Settings, view: &View) -> Vec<Self> {
        let total = scene.strands.iter().map(strand_count).sum();
        let groups = scene.strands.iter().map(|&strands| Self::new(strands, total, settings));
        groups.map(|group| group.seen_from(view, settings.thinnest)).collect()
    }

    /// The group with as many curves as a picture of `view` shows.
    fn seen_from(self, view: &View, thinnest: f32) -> Self {
        let count = strand_count(&self.strands);
        let every = (count / NEAREST_OF).max(1);
        let (mut nearest, mut width) = (f32::INFINITY, 0.0_f32);
        for strand in (0..count).step_by(every) {
            for (_, particles) in self.drawable(strand..strand + 1) {
                let own = match self.strands.widths {
                    Some(widths) => widths[particles.clone()].iter().copied().fold(0.0, f32::max),
                    None => self.strands.width,
                };
                width = width.max(own * self.width_scale);
                let depths = self.strands.positions[particles].iter().map(|&p| view.to_camera(p).z);
                nearest = depths.filter(|depth| *depth > view.near).fold(nearest, f32::min);
            }
        }
        let pixels = width * view.focal / nearest;
        let share = if pixels > 0.0 && pixels < thinnest { pixels / thinnest } else { 1.0 };
        let share = share.max(FEWEST / (count as f32 * self.children as f32)).min(1.0);
        Self { share, ..self }
    }

    /// The rank of a curve, 0–1: those of the highest ranks vanish first.
    pub fn rank(&self, strand: u32, child: u32) -> f32 {
        random::unit(self.seed, strand, RANK + child)
    }

    /// The factor on the width of a curve of rank `rank`; 0 for those that are not drawn, which are
    /// those with a rank of [`share`](Self::share) and more.
    pub fn detail(&self, rank: f32) -> f32 {
        if self.share >= 1.0 {
            return 1.0;
        }
        let fading = (FADING * self.share).min(1.0 - self.share);
        let whole = 1.0 / (self.share - 0.5 * fading);
        whole * ((self.share - rank) / fading).clamp(0.0, 1.0)
    }

    fn new(strands: Strands<'a>, total: usize, settings: &Settings) -> Self {
        let count = strand_count(&strands).max(1);
        let (is_finite, bounds) = extent(&strands);
        let drawn = drawable(&strands, is_finite, 0..strand_count(&strands));
        let (lo, hi) = bounds_of(drawn.map(|(_, particles)| strands.positions[particles.start]));
        let side = (hi - lo).max(Vec3::ZERO);
        let area = side.x * side.y + side.y * side.z + side.z * side.x;
        let aim = DRAWN_PER_PIXEL * settings.width.min(settings.height) as usize;
        let automatic = (aim / total.max(1)).clamp(1, 4) as u32;
        let children = settings.children.unwrap_or(automatic);
        let hairs_each = HAIRS_PER_M2 * area / (count as f32 * children as f32);
        let width_scale = settings.width_scale.unwrap_or(hairs_each.powf(0.7).clamp(1.0, MAX_WIDTH_SCALE));
        let radius = 0.5 * (area / count as f32).sqrt();
        let log_albedos = strands.colour.albedos().map(|albedo| albedo.map(f32::ln));
        Self {
            strands,
            is_finite,
            bounds,
            children,
            width_scale,
            radius,
            log_albedos,
            share: 1.0,
            seed: settings.seed,
        }
    }

    /// The strands of `range` that can be drawn: (index, particle range).
    pub fn drawable(
        &self,
        range: std::ops::Range<usize>,
    ) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> + Clone + use<'a> {
        drawable(&self.strands, self.is_finite, range)
    }

    /// Diameter drawn at particle coordinate `at` (particle index plus fraction), `s` from root 0
    /// to tip 1.
    pub fn width(&self, first: usize, at: f32, s: f32) -> f32 {
        self.bare_width(first, at, s) * self.width_scale
    }

    /// [`width`](Self::width) without the factor for widths.
    pub fn bare_width(&self, first: usize, at: f32, s: f32) -> f32 {
        let width = match self.strands.widths {
            Some(widths) => {
                let i = first + at as usize;
                let next = widths[(i + 1).min(widths.len() - 1)];
                widths[i] + (next - widths[i]) * at.fract()
            }
            None => self.strands.width * taper(s),
        };
        if width.is_finite() { width.max(0.0) } else { 0.0 }
    }

    /// The offset of child `child` from its strand `strand` at `s`.
    fn offset(&self, seed: u32, strand: u32, child: u32, s: f32) -> Vec3 {
        if child == 0 {
            return Vec3::ZERO;
        }
        let (offset, wave) = child_draws(seed, strand, child);
        // A separate wave for each child avoids parallel curves, which look like wires.
        let wave = (wave * 3.0 + s * 9.0).sin() * 0.35;
        let profile = (0.6 + 2.0 * s).min(1.0) * (1.0 - 0.65 * s * s);
        (offset + offset.yzx() * wave * s) * (profile * self.radius)
    }

    /// The random numbers of a curve.
    #[cfg(feature = "gpu")]
    pub fn draws(&self, seed: u32, strand: u32, child: u32) -> CurveDraws {
        let (offset, wave) = if child == 0 { (Vec3::ZERO, 0.0) } else { child_draws(seed, strand, child) };
        let draw = |stream| curve_draw(seed, strand, child, stream);
        CurveDraws {
            log_albedo: self.log_albedo(draw),
            offset,
            wave,
            bright: draw(0),
            grey: draw(1),
            tilt: draw(2) * TILT_RANGE,
        }
    }
}

/// What differs between curves by chance.
#[cfg(feature = "gpu")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct CurveDraws {
    /// The offset of a child, relative to the largest one.
    pub offset: Vec3,
    pub wave: f32,
    /// Logarithm of the albedo.
    pub log_albedo: Vec3,
    pub bright: f32,
    pub grey: f32,
    /// The tilt of the scales, radians.
    pub tilt: f32,
}

/// The offset of a child relative to the largest one, and its wave.
fn child_draws(seed: u32, strand: u32, child: u32) -> (Vec3, f32) {
    let draw = |stream| random::signed(seed, strand, child * 4 + stream);
    (Vec3::new(draw(0), draw(1), draw(2)).clamp_length_max(1.0), draw(3))
}

/// The stream of random numbers of the ranks of curves.
const RANK: u32 = 1_000_000;

/// A number in [−1, 1) for a curve.
fn curve_draw(seed: u32, strand: u32, child: u32, stream: u32) -> f32 {
    random::signed(seed, strand, 1000 + child * 8 + stream)
}

/// The relative width along a strand without given widths: 1 up to s = 0.6, then decreasing to 0.2
/// at the tip.
fn taper(s: f32) -> f32 {
    let t = ((s - 0.6) / 0.4).clamp(0.0, 1.0);
    1.0 - 0.8 * t * t
}

impl<'a> Hair<'a> {
    /// Projects the strands of `scene`. The offsets must be valid.
    pub fn new(scene: &Scene<'a>, settings: &Settings, view: &View, tiles: TileGrid) -> Self {
        let groups = Group::all(scene, settings, view);
        let ranges: Vec<_> = groups
            .iter()
            .enumerate()
            .flat_map(|(index, group)| {
                let step = CURVES_PER_CHUNK / group.children as usize;
                let count = strand_count(&group.strands);
                (0..count).step_by(step).map(move |s| (index, s..(s + step).min(count)))
            })
            .collect();
        let chunks = ranges
            .into_par_iter()
            .map(|(index, range)| Chunk::new(&groups[index], index, range, settings.seed, view, tiles))
            .collect();
        Self { groups, chunks, seed: settings.seed }
    }

    pub fn groups(&self) -> &[Group<'a>] {
        &self.groups
    }

    /// Adds to `pieces` all pieces that touch the tile `tile` with its upper left pixel at
    /// `corner`, except those at depths above 1/`farthest`. Returns the number of points that the
    /// pieces share.
    pub fn gather(&self, tile: usize, corner: Vec2, farthest: f32, pieces: &mut Vec<Piece>) -> usize {
        let mut points = 0;
        for (index, chunk) in self.chunks.iter().enumerate() {
            for &item in chunk.bins.of(tile) {
                let (curve, edge) = chunk.unpack(item);
                let start = chunk.curves[curve].start as usize + edge;
                let p: [Vec4; 4] = std::array::from_fn(|i| chunk.points[start + i]);
                if p[1].z.max(p[2].z) < farthest {
                    continue;
                }
                let count = (p[1].xy().distance(p[2].xy()) / PIECE_PX).ceil().clamp(1.0, MAX_PIECES);
                let is_last = edge + 1 == chunk.edges(curve);
                let mut to = p[1].xy();
                for i in 0..count as u32 {
                    let t = [i as f32 / count, (i + 1) as f32 / count];
                    let from = std::mem::replace(&mut to, blend(p, catmull_rom(t[1])).xy());
                    let middle = p[1].lerp(p[2], 0.5 * (t[0] + t[1]));
                    let pad = middle.w + FILTER_RADIUS;
                    let seen = from.min(to).cmplt(corner + (TILE as f32 + pad)).all();
                    if !(seen && from.max(to).cmpgt(corner - pad).all()) {
                        continue;
                    }
                    // Pieces are in the order of their strand: most start at the end of the
                    // previous one.
                    let follows = |p: &Piece| p.to == from && p.chunk == index as u32 && !p.ends[1];
                    points += if pieces.last().is_some_and(follows) { 1 } else { 2 };
                    pieces.push(Piece {
                        from,
                        to,
                        nearness: middle.z,
                        half_width: middle.w,
                        points: [points - 2, points - 1],
                        ends: [edge == 0 && i == 0, is_last && i + 1 == count as u32],
                        chunk: index as u32,
                        item,
                        t,
                    });
                }
            }
        }
        points as usize
    }

    /// The first (0) or last (1) point of `piece` in world space.
    pub fn point(&self, piece: &Piece, end: usize) -> StrandPoint {
        let chunk = &self.chunks[piece.chunk as usize];
        let group = &self.groups[chunk.group];
        let (curve, edge) = chunk.unpack(piece.item);
        let Curve { strand, child, .. } = chunk.curves[curve];
        let offsets = group.strands.strand_offsets;
        let (first, past) = (offsets[strand as usize] as usize, offsets[strand as usize + 1] as usize);
        let t = piece.t[end];
        let s = (edge as f32 + t) / (past - first - 1) as f32;
        let particle = |i: isize| {
            let i = (first + edge) as isize + i;
            group.strands.positions[i.clamp(first as isize, past as isize - 1) as usize]
        };
        let p = [particle(-1), particle(0), particle(1), particle(2)];
        let tangent = blend(p, catmull_rom_slope(t)).normalize_or((p[2] - p[1]).normalize_or(Vec3::Y));
        let draw = |stream| curve_draw(self.seed, strand, child, stream);
        StrandPoint {
            position: blend(p, catmull_rom(t)) + group.offset(self.seed, strand, child, s),
            tangent,
            albedo: group.albedo(first + edge, t, s, draw),
            tilt: draw(2) * TILT_RANGE,
        }
    }
}

impl Group<'_> {
    /// The logarithm of the albedo of a curve: some have no pigment.
    fn log_albedo(&self, draw: impl Fn(u32) -> f32) -> Vec3 {
        let is_white = 0.5 + 0.5 * draw(3) < self.strands.colour.greying;
        self.log_albedos[usize::from(is_white)]
    }

    /// The albedo at particle `particle` plus `t`: that of the groom, or the group's colour with
    /// variation. Strands vary in brightness and redness; roots are darker and tips are lighter.
    fn albedo(&self, particle: usize, t: f32, s: f32, draw: impl Fn(u32) -> f32) -> Vec3 {
        if let Some(colours) = self.strands.colours {
            let [a, b] = [particle, particle + 1].map(|i| Vec3::from(colours[i]));
            return a.lerp(b, t).clamp(Vec3::splat(0.002), Vec3::splat(0.95));
        }
        // A power of the albedo is a factor on the square root of the absorption.
        let root = 1.0 + 0.22 * (1.0 - (s / 0.25).min(1.0));
        let power = root * (1.0 + 0.13 * draw(0)) * (1.04 - 0.12 * s);
        let varied = (self.log_albedo(&draw) * power).map(f32::exp);
        let grey = Vec3::splat(luminance(varied));
        varied.lerp(grey, 0.06 + 0.06 * draw(1)).clamp(Vec3::splat(0.002), Vec3::splat(0.95))
    }
}

impl Chunk {
    fn new(
        group: &Group<'_>,
        index: usize,
        range: std::ops::Range<usize>,
        seed: u32,
        view: &View,
        tiles: TileGrid,
    ) -> Self {
        let (mut curves, mut points) = (Vec::new(), Vec::new());
        // An upper bound of half the width in pixels, from the nearest depth and the largest width.
        let mut reach = 0.0_f32;
        for (strand, particles) in group.drawable(range) {
            let strand_points = &group.strands.positions[particles.clone()];
            let last = strand_points.len() - 1;
            for child in 0..group.children {
                let detail = group.detail(group.rank(strand as u32, child));
                if detail == 0.0 {
                    continue;
                }
                let start = points.len();
                curves.push(Curve { strand: strand as u32, child, start: start as u32 });
                points.push(Vec4::NAN);
                for (i, &p) in strand_points.iter().enumerate() {
                    let s = i as f32 / last as f32;
                    let p = view.to_camera(p + group.offset(seed, strand as u32, child, s));
                    let pixel = if p.z > view.near { view.to_pixels(p) } else { Vec3::NAN };
                    let width = detail * group.width(particles.start, i as f32, s);
                    let half_width = 0.5 * width * view.focal * pixel.z;
                    reach = reach.max(half_width);
                    points.push(pixel.extend(half_width));
                }
                points[start] = points[start + 1] * 2.0 - points[start + 2];
                points.push(points[start + last + 1] * 2.0 - points[start + last]);
            }
        }
        let mut chunk = Self { group: index, curves, points, bins: Bins::default() };
        chunk.bins = Bins::new(tiles, chunk.items(tiles, reach + FILTER_RADIUS));
        chunk
    }

    /// All visible edges, each with the tiles that it may touch.
    fn items(
        &self,
        tiles: TileGrid,
        pad: f32,
    ) -> impl Iterator<Item = (u32, crate::tiles::TileRect)> + Clone {
        (0..self.curves.len()).flat_map(move |curve| {
            let start = self.curves[curve].start as usize;
            (0..self.edges(curve)).filter_map(move |edge| {
                let p = &self.points[start + edge..start + edge + 4];
                if !p.iter().all(|p| p.is_finite()) {
                    return None;
                }
                // The curve lies inside the bounding box of its Bézier points.
                let (b, c) = (p[1] + (p[2] - p[0]) / 6.0, p[2] - (p[3] - p[1]) / 6.0);
                let lo = p[1].min(p[2]).min(b).min(c) - pad;
                let hi = p[1].max(p[2]).max(b).max(c) + pad;
                let rect = tiles.rect([lo.x, lo.y], [hi.x, hi.y])?;
                Some(((curve as u32) << EDGE_BITS | edge as u32, rect))
            })
        })
    }

    fn unpack(&self, item: u32) -> (usize, usize) {
        ((item >> EDGE_BITS) as usize, (item & ((1 << EDGE_BITS) - 1)) as usize)
    }

    /// The number of edges of a curve. Two of its points lie before the root and after the tip.
    fn edges(&self, curve: usize) -> usize {
        let end = self.curves.get(curve + 1).map_or(self.points.len(), |next| next.start as usize);
        end - self.curves[curve].start as usize - 3
    }
}

/// The weights of four points for the uniform Catmull-Rom curve from the second (t = 0) to the
/// third (t = 1).
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [t2 - 0.5 * (t3 + t), 1.0 + 1.5 * t3 - 2.5 * t2, 2.0 * t2 - 1.5 * t3 + 0.5 * t, 0.5 * (t3 - t2)]
}

/// The derivatives of [`catmull_rom`].
fn catmull_rom_slope(t: f32) -> [f32; 4] {
    let t2 = t * t;
    [2.0 * t - 1.5 * t2 - 0.5, 4.5 * t2 - 5.0 * t, 4.0 * t - 4.5 * t2 + 0.5, 1.5 * t2 - t]
}

fn blend<V: Copy + Add<Output = V> + Mul<f32, Output = V>>(p: [V; 4], w: [f32; 4]) -> V {
    p[0] * w[0] + p[1] * w[1] + p[2] * w[2] + p[3] * w[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_pass_through_their_points_without_a_kink() {
        let p = [Vec3::ZERO, Vec3::X, Vec3::new(2.0, 1.0, 0.0), Vec3::new(2.0, 3.0, 1.0), Vec3::Z];
        let (first, second) = ([p[0], p[1], p[2], p[3]], [p[1], p[2], p[3], p[4]]);
        assert_eq!(blend(first, catmull_rom(0.0)), p[1]);
        assert_eq!(blend(first, catmull_rom(1.0)), p[2]);
        assert_eq!(blend(first, catmull_rom_slope(1.0)), blend(second, catmull_rom_slope(0.0)));
        let step = (blend(first, catmull_rom(0.501)) - blend(first, catmull_rom(0.499))) / 0.002;
        assert!(step.distance(blend(first, catmull_rom_slope(0.5))) < 1e-3);
    }

    #[test]
    fn the_curves_that_are_left_cover_the_same_area() {
        let (points, offsets) = ([Vec3::ZERO, Vec3::Y], [0, 2]);
        let strands = Strands::new(&points, &offsets, crate::HairColour::RED);
        let group = Group::new(strands, 1, &Settings::default());
        let mut before = vec![1.0_f32; 40_000];
        for share in [1.0, 0.999, 0.97, 0.95, 0.6, 0.3, 0.1, 0.02] {
            let group = Group { share, ..group };
            let now: Vec<f32> = (0..40_000).map(|strand| group.detail(group.rank(strand, 1))).collect();
            let mean = now.iter().sum::<f32>() / now.len() as f32;
            assert!((mean - 1.0).abs() < 0.05 / share.sqrt(), "{share}: {mean}");
            let drawn = now.iter().filter(|detail| **detail > 0.0).count() as f32 / now.len() as f32;
            assert!((drawn - share).abs() < 0.01, "{share}: {drawn}");
            // What has vanished does not come back.
            assert!(now.iter().zip(&before).all(|(now, before)| *before > 0.0 || *now == 0.0));
            before = now;
        }
        // A slightly smaller share changes no width by much.
        let [a, b] = [0.5, 0.499].map(|share| Group { share, ..group });
        let ranks = (0..40_000).map(|strand| group.rank(strand, 0));
        let change = ranks.map(|rank| (a.detail(rank) - b.detail(rank)).abs()).fold(0.0, f32::max);
        assert!(change < 0.05 * a.detail(0.0).max(2.0));
    }

    #[test]
    fn fewer_strands_are_drawn_wider_and_with_children() {
        // A scalp of about 20 × 15 cm with `side`² straight hairs.
        let scalp = |side: usize| -> (Vec<Vec3>, Vec<u32>) {
            let root =
                |i: usize| Vec3::new((i % side) as f32 * 0.2, 0.0, (i / side) as f32 * 0.15) / side as f32;
            let points = (0..side * side).flat_map(|i| [root(i), root(i) + Vec3::Y * 0.1]).collect();
            (points, (0..=(side * side) as u32).map(|i| i * 2).collect())
        };
        let derived = |side, settings: &Settings| {
            let (points, offsets) = scalp(side);
            let strands = Strands::new(&points, &offsets, crate::HairColour::RED);
            let group = Group::new(strands, side * side, settings);
            (group.children, group.width_scale, group.radius)
        };
        let settings = Settings::default();
        let (few, some, all) = (derived(30, &settings), derived(100, &settings), derived(300, &settings));
        assert_eq!((few.0, some.0, all.0), (4, 4, 1));
        assert!(few.1 > some.1 && some.1 > all.1 && all.1 == 1.0, "{few:?} {some:?} {all:?}");
        assert!((some.2 - 0.5 * 0.03_f32.sqrt() / 100.0).abs() < 1e-5);
        let fixed = Settings { width_scale: Some(3.0), children: Some(2), ..settings };
        assert_eq!(derived(30, &fixed).0, 2);
        assert_eq!(derived(30, &fixed).1, 3.0);
    }
}
