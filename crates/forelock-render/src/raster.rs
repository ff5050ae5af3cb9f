//! One tile of the picture: bodies by sampling, strands by exact coverage from front to back.
//!
//! # Theory
//! A strand is nearly always thinner than a pixel. What a pixel should show is its share under the pixel filter: for a straight
//! strand of width w at distance d from the pixel's centre, F(d + w/2) − F(d − w/2), with F the integral of the filter across
//! the strand (Gupta & Sproull 1981, *Filtering edges for gray-scale displays*). The filter is a tent whose radius is a pixel's side as seen
//! along the nearer axis, max(|cos|, |sin|) of the strand's angle: pixels of one column (or row) then share each strand out
//! exactly, at every angle and offset. This share is the fragment's opacity; pieces, sorted by depth, are laid under one another from front to back:
//! C += T a c, T ← T (1 − a) (Porter & Duff 1984).
//!
//! # Practice
//! A pixel belongs to the piece on whose length its centre falls, so joints are neither doubled nor missing; only
//! where a strand ends does its last pixel count in part. A pixel that lets less than 1/100 through takes no more
//! fragments and is scaled to full opacity, and a piece that no pixel shows is never lit. Bodies keep n × n depths a pixel; a fragment counts by
//! the share of them behind it.
//!
//! # Limitations
//! Pieces a few pixels long that pass through each other are not split at the crossing.

use glam::{Vec2, Vec3};

use crate::camera::View;
use crate::colour::{film_curve, srgb_encode};
use crate::hair::{FILTER_RADIUS, Hair, Piece};
use crate::lighting::Lighting;
use crate::scene::{Backdrop, Settings};
use crate::solids::{ScreenTriangle, Solids};
use crate::tiles::TILE;

/// Pixels in a tile.
const PIXELS: usize = (TILE * TILE) as usize;
/// A pixel that lets less through is done.
const OPAQUE: f32 = 0.01;
/// No triangle.
const NONE: u32 = u32::MAX;

/// All that drawing a tile needs.
pub(crate) struct Frame<'a> {
    pub settings: Settings,
    pub view: View,
    pub backdrop: Backdrop,
    pub solids: Solids,
    pub hair: Hair<'a>,
    pub lighting: Lighting,
}

/// Buffers of one tile, used again for the next.
#[derive(Default)]
pub(crate) struct Tile {
    /// Nearest triangle and inverse depth of each sample, pixel by pixel.
    samples: Vec<(u32, f32)>,
    pixels: Vec<Pixel>,
    pieces: Vec<Piece>,
    /// Light from each point that pieces share, once one is seen.
    lit: Vec<Option<Vec3>>,
    order: Vec<u64>,
}

/// What strands have done to a pixel so far.
#[derive(Clone, Copy)]
struct Pixel {
    /// Light gathered.
    gathered: Vec3,
    /// The share of what is behind that still comes through.
    through: f32,
    /// Least and greatest inverse depth of the bodies' samples.
    bodies: [f32; 2],
}

impl Tile {
    /// The pixels of the tile in column `column`, row `row`, sRGB, row by row.
    pub fn draw(&mut self, frame: &Frame<'_>, index: usize, column: u32, row: u32) -> Vec<[u8; 4]> {
        let corner = [column * TILE, row * TILE];
        self.draw_solids(frame, index, corner);
        self.draw_hair(frame, index, corner);
        (0..PIXELS).map(|i| self.resolve(frame, corner, i)).collect()
    }

    fn draw_solids(&mut self, frame: &Frame<'_>, index: usize, corner: [u32; 2]) {
        let n = frame.settings.samples;
        self.samples.clear();
        self.samples.resize(PIXELS * (n * n) as usize, (NONE, 0.0));
        for &triangle in frame.solids.bins.of(index) {
            self.draw_triangle(&frame.solids.screen[triangle as usize], n, corner);
        }
    }

    fn draw_triangle(&mut self, triangle: &ScreenTriangle, n: u32, corner: [u32; 2]) {
        // In samples from the tile's corner, with the samples' centres on whole numbers.
        let origin = Vec2::new(corner[0] as f32, corner[1] as f32);
        let [a, b, c] = triangle.corners.map(|p| {
            let at = (Vec2::new(p.x, p.y) - origin) * n as f32 - 0.5;
            at.extend(p.z)
        });
        let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let side = TILE * n;
        let range =
            |lo: f32, hi: f32| lo.ceil().max(0.0) as u32..((hi.floor() + 1.0).max(0.0) as u32).min(side);
        let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
        for y in range(lo.y, hi.y) {
            for x in range(lo.x, hi.x) {
                let (px, py) = (x as f32, y as f32);
                let u = ((b.x - px) * (c.y - py) - (b.y - py) * (c.x - px)) / area;
                let v = ((c.x - px) * (a.y - py) - (c.y - py) * (a.x - px)) / area;
                let w = 1.0 - u - v;
                if u >= 0.0 && v >= 0.0 && w >= 0.0 {
                    let nearness = u * a.z + v * b.z + w * c.z;
                    let pixel = (y / n * TILE + x / n) * n * n + (y % n) * n + x % n;
                    let sample = &mut self.samples[pixel as usize];
                    if nearness > sample.1 {
                        *sample = (triangle.source, nearness);
                    }
                }
            }
        }
    }

    fn draw_hair(&mut self, frame: &Frame<'_>, index: usize, corner: [u32; 2]) {
        let per_pixel = self.samples.len() / PIXELS;
        self.pixels.clear();
        self.pixels.extend(self.samples.chunks_exact(per_pixel).map(|samples| {
            let range = |f: fn(f32, f32) -> f32| samples.iter().map(|s| s.1).reduce(f).unwrap_or(0.0);
            Pixel { gathered: Vec3::ZERO, through: 1.0, bodies: [range(f32::min), range(f32::max)] }
        }));
        let farthest = self.pixels.iter().map(|p| p.bodies[0]).fold(f32::INFINITY, f32::min);
        let origin = Vec2::new(corner[0] as f32, corner[1] as f32);
        self.pieces.clear();
        let points = frame.hair.gather(index, origin, farthest, &mut self.pieces);
        self.lit.clear();
        self.lit.resize(points, None);
        // Inverse depths are positive, so their bits order as they do; the index settles ties.
        self.order.clear();
        self.order.extend(
            self.pieces.iter().enumerate().map(|(i, p)| u64::from(!p.nearness.to_bits()) << 32 | i as u64),
        );
        self.order.sort_unstable();
        let mut open = PIXELS;
        for i in 0..self.order.len() {
            if open == 0 {
                break;
            }
            open -= self.draw_piece(frame, (self.order[i] & 0xffff_ffff) as usize, origin);
        }
    }

    /// Lays a piece under what the pixels already show; answers how many became opaque.
    fn draw_piece(&mut self, frame: &Frame<'_>, piece: usize, origin: Vec2) -> usize {
        let piece = &self.pieces[piece];
        let Some(strip) = Strip::new(piece, origin) else { return 0 };
        let per_pixel = self.samples.len() / PIXELS;
        let mut light = None;
        let mut closed = 0;
        for y in strip.rows() {
            for x in strip.columns(y) {
                let i = (y * TILE + x) as usize;
                let pixel = &mut self.pixels[i];
                if pixel.through <= OPAQUE || piece.nearness < pixel.bodies[0] {
                    continue;
                }
                let (along, mut coverage) = strip.coverage(x, y, piece.ends);
                if piece.nearness < pixel.bodies[1] {
                    let samples = &self.samples[i * per_pixel..(i + 1) * per_pixel];
                    let seen = samples.iter().filter(|s| s.1 <= piece.nearness).count();
                    coverage *= seen as f32 / per_pixel as f32;
                }
                if coverage > 0.0 {
                    let [from, to] = *light.get_or_insert_with(|| {
                        [0, 1].map(|end| {
                            *self.lit[piece.points[end] as usize]
                                .get_or_insert_with(|| frame.lighting.of_hair(&frame.hair.point(piece, end)))
                        })
                    });
                    pixel.gathered += from.lerp(to, along) * (pixel.through * coverage);
                    pixel.through *= 1.0 - coverage;
                    closed += usize::from(pixel.through <= OPAQUE);
                }
            }
        }
        closed
    }

    /// The colour of pixel `i`: hair over body over backdrop.
    fn resolve(&self, frame: &Frame<'_>, corner: [u32; 2], i: usize) -> [u8; 4] {
        let Settings { width, height, samples: n, exposure, .. } = frame.settings;
        let (x, y) = (corner[0] + i as u32 % TILE, corner[1] + i as u32 / TILE);
        let Pixel { gathered, through, .. } = self.pixels[i];
        let mut colour = gathered;
        if through <= OPAQUE {
            colour /= 1.0 - through;
        } else {
            let count = (n * n) as usize;
            let samples = &self.samples[i * count..(i + 1) * count];
            let centre = [x as f32 + 0.5, y as f32 + 0.5];
            let behind = frame.backdrop.at(centre[0] / width as f32, centre[1] / height as f32);
            colour += through * behind_hair(frame, samples, centre, behind);
        }
        let shown = film_curve(colour.max(Vec3::ZERO) * exposure);
        // Ordered noise of half a step keeps gradients from banding; it stays put from frame to frame.
        let noise = (52.982_918 * (0.067_110_56 * x as f32 + 0.005_837_15 * y as f32).fract()).fract() - 0.5;
        let byte = |v: f32| (srgb_encode(v) * 255.0 + 0.5 + 0.8 * noise).clamp(0.0, 255.0) as u8;
        [byte(shown.x), byte(shown.y), byte(shown.z), 255]
    }
}

/// The mean over a pixel's samples of body or backdrop; each triangle is lit once, in the middle of its samples.
fn behind_hair(frame: &Frame<'_>, samples: &[(u32, f32)], centre: [f32; 2], backdrop: Vec3) -> Vec3 {
    let n = frame.settings.samples as usize;
    let share = 1.0 / samples.len() as f32;
    let mut sum = Vec3::ZERO;
    for (i, &(source, _)) in samples.iter().enumerate() {
        if source == NONE {
            sum += backdrop * share;
        } else if samples[..i].iter().all(|s| s.0 != source) {
            let (mut at, mut nearness, mut count) = (Vec2::ZERO, 0.0, 0.0);
            for (j, sample) in samples.iter().enumerate().filter(|(_, s)| s.0 == source) {
                at += Vec2::new((j % n) as f32, (j / n) as f32);
                nearness += sample.1;
                count += 1.0;
            }
            let at = (at / count + 0.5) / n as f32 - 0.5;
            let point = frame.view.unproject(centre[0] + at.x, centre[1] + at.y, nearness / count);
            sum += frame.lighting.of_body(&frame.solids.surface_point(source, point)) * (share * count);
        }
    }
    sum
}

/// A piece as a strip of pixels in a tile.
struct Strip {
    from: Vec2,
    along: Vec2,
    length: f32,
    half_width: f32,
    /// Radius of the filter across, pixels.
    radius: f32,
}

impl Strip {
    fn new(piece: &Piece, origin: Vec2) -> Option<Self> {
        // Relative to the first pixel's centre.
        let from = piece.from - origin - 0.5;
        let span = piece.to - piece.from;
        let length = span.length();
        let along = span / length;
        let radius = FILTER_RADIUS * along.abs().max_element();
        (length > 1e-6 && length.is_finite()).then_some(Self {
            from,
            along,
            length,
            half_width: piece.half_width,
            radius,
        })
    }

    fn rows(&self) -> std::ops::Range<u32> {
        let reach = self.half_width + self.radius;
        let to = self.from.y + self.along.y * self.length;
        whole(self.from.y.min(to) - reach, self.from.y.max(to) + reach)
    }

    /// The pixels of row `y` whose centres are near enough to the line and to its length.
    fn columns(&self, y: u32) -> std::ops::Range<u32> {
        let reach = self.half_width + self.radius;
        let dy = y as f32 - self.from.y;
        let Vec2 { x: tx, y: ty } = self.along;
        // |across| ≤ reach with across = ty dx − tx dy, and −½ ≤ along ≤ length + ½ with along = tx dx + ty dy.
        let (mut lo, mut hi) = (f32::NEG_INFINITY, f32::INFINITY);
        for (slope, a, b) in
            [(ty, -reach + tx * dy, reach + tx * dy), (tx, -0.5 - ty * dy, self.length + 0.5 - ty * dy)]
        {
            if slope.abs() > 1e-6 {
                lo = lo.max((a / slope).min(b / slope));
                hi = hi.min((a / slope).max(b / slope));
            } else if a > 0.0 || b < 0.0 {
                return 0..0;
            }
        }
        whole(self.from.x + lo, self.from.x + hi)
    }

    /// How far along the strip pixel (`x`, `y`) is, 0–1, and its share under the strip.
    fn coverage(&self, x: u32, y: u32, ends: [bool; 2]) -> (f32, f32) {
        let offset = Vec2::new(x as f32, y as f32) - self.from;
        let (along, across) = (self.along.dot(offset), self.along.perp_dot(offset));
        let owned = |inside: bool| if inside { 1.0 } else { 0.0 };
        let start = if ends[0] { (along + 0.5).clamp(0.0, 1.0) } else { owned(along >= 0.0) };
        let end =
            if ends[1] { (self.length - along + 0.5).clamp(0.0, 1.0) } else { owned(along < self.length) };
        let below = |edge: f32| tent_integral((across + edge) / self.radius);
        let share = below(self.half_width) - below(-self.half_width);
        ((along / self.length).clamp(0.0, 1.0), share * start.min(end))
    }
}

/// ∫ from −∞ to `x` of the tent of radius 1.
fn tent_integral(x: f32) -> f32 {
    let x = x.clamp(-1.0, 1.0);
    0.5 + x - 0.5 * x * x.abs()
}

/// The whole numbers from `lo` to `hi` within a tile; casts that cut off stand for floor and ceil, which are slow.
fn whole(lo: f32, hi: f32) -> std::ops::Range<u32> {
    let end = if hi < 0.0 { 0 } else { (hi as u32).saturating_add(1).min(TILE) };
    let below = lo.max(0.0) as u32;
    let start = below.saturating_add(u32::from((below as f32) < lo));
    start.min(end)..end
}
