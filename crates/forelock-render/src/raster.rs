//! Drawing of one tile: bodies by sampling, strands by exact coverage from front to back.
//!
//! # Theory
//! A strand is nearly always thinner than a pixel, so its opacity in a pixel is its coverage under
//! the pixel filter. For a straight strand of width w at distance d from the centre of the pixel,
//! the coverage is F(d + w/2) − F(d − w/2), where F is the integral of the filter across the strand
//! (Gupta & Sproull 1981, *Filtering edges for gray-scale displays*). The filter is a tent. Its
//! radius is max(|cos|, |sin|) of the strand's angle, in pixels. With this radius, the coverages in
//! a column (or row) of pixels sum to the width exactly, at every angle and offset. Pieces are
//! sorted by depth and composited from front to back: C += T a c, T ← T (1 − a) (Porter & Duff
//! 1984).
//!
//! # Practice
//! A pixel belongs to the piece whose length contains its centre, so a joint of two pieces is drawn
//! once. Only the last pixel of a strand is weighted by the part that the strand covers. A pixel
//! with a transmittance below 1/100 takes no more fragments and is scaled to full opacity. A piece
//! that is invisible in all pixels is not lit. Bodies have n × n depth samples per pixel. A
//! fragment is weighted by the share of samples behind it.
//!
//! # Limitations
//! Pieces (a few pixels long) that intersect are not split at the intersection.

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
/// The transmittance below which a pixel takes no more fragments.
pub(crate) const OPAQUE: f32 = 0.01;
/// The index that stands for no triangle.
const NONE: u32 = u32::MAX;

/// The data that drawing a tile needs.
pub(crate) struct Frame<'a> {
    pub settings: Settings,
    pub view: View,
    pub backdrop: Backdrop,
    pub solids: Solids<'a>,
    pub hair: Hair<'a>,
    pub lighting: Lighting,
}

/// Buffers for one tile, reused for the next.
#[derive(Default)]
pub(crate) struct Tile {
    /// The depth samples, pixel by pixel.
    samples: Vec<Sample>,
    pixels: Vec<Pixel>,
    pieces: Vec<Piece>,
    /// The light from each shared point of the pieces, once it is computed.
    lit: Vec<Option<Vec3>>,
    order: Vec<u64>,
}

/// What the bodies show at a sample.
#[derive(Clone, Copy)]
struct Sample {
    /// The nearest triangle, or [`NONE`].
    triangle: u32,
    /// Its inverse depth; 0 without a triangle.
    nearness: f32,
}

/// A pixel while strands are composited into it.
#[derive(Clone, Copy)]
struct Pixel {
    /// The light of the strands so far.
    gathered: Vec3,
    /// The transmittance: the share of the light from behind that is still visible.
    through: f32,
    /// The smallest and largest inverse depth of the samples of bodies.
    bodies: [f32; 2],
}

impl Tile {
    /// Draws the tile in column `column` and row `row`. Returns its pixels in sRGB, row by row.
    pub fn draw(&mut self, frame: &Frame<'_>, index: usize, column: u32, row: u32) -> Vec<[u8; 4]> {
        let corner = [column * TILE, row * TILE];
        self.draw_solids(frame, index, corner);
        self.draw_hair(frame, index, corner);
        (0..PIXELS).map(|i| self.resolve(frame, corner, i)).collect()
    }

    fn draw_solids(&mut self, frame: &Frame<'_>, index: usize, corner: [u32; 2]) {
        let n = frame.settings.samples;
        self.samples.clear();
        self.samples.resize(PIXELS * (n * n) as usize, Sample { triangle: NONE, nearness: 0.0 });
        for &triangle in frame.solids.bins.of(index) {
            self.draw_triangle(&frame.solids.screen[triangle as usize], n, corner);
        }
    }

    fn draw_triangle(&mut self, triangle: &ScreenTriangle, n: u32, corner: [u32; 2]) {
        // Coordinates in samples, relative to the tile's corner. Samples are at whole numbers.
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
                    if nearness > sample.nearness {
                        *sample = Sample { triangle: triangle.source, nearness };
                    }
                }
            }
        }
    }

    fn draw_hair(&mut self, frame: &Frame<'_>, index: usize, corner: [u32; 2]) {
        let per_pixel = self.samples.len() / PIXELS;
        self.pixels.clear();
        self.pixels.extend(self.samples.chunks_exact(per_pixel).map(|samples| {
            let range = |f: fn(f32, f32) -> f32| {
                samples.iter().map(|sample| sample.nearness).reduce(f).unwrap_or(0.0)
            };
            Pixel { gathered: Vec3::ZERO, through: 1.0, bodies: [range(f32::min), range(f32::max)] }
        }));
        let farthest = self.pixels.iter().map(|p| p.bodies[0]).fold(f32::INFINITY, f32::min);
        let origin = Vec2::new(corner[0] as f32, corner[1] as f32);
        self.pieces.clear();
        let points = frame.hair.gather(index, origin, farthest, &mut self.pieces);
        self.lit.clear();
        self.lit.resize(points, None);
        // Inverse depths are positive, so their bit patterns have the same order. Ties are sorted
        // by index.
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

    /// Composites a piece behind the earlier ones. Returns how many pixels became opaque.
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
                    let seen = samples.iter().filter(|sample| sample.nearness <= piece.nearness).count();
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

    /// The colour of pixel `i`: hair over bodies over the backdrop.
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
        // Ordered dithering of half a step avoids banding. The pattern is the same in each frame.
        let noise = (52.982_918 * (0.067_110_56 * x as f32 + 0.005_837_15 * y as f32).fract()).fract() - 0.5;
        let byte = |v: f32| (srgb_encode(v) * 255.0 + 0.5 + 0.8 * noise).clamp(0.0, 255.0) as u8;
        [byte(shown.x), byte(shown.y), byte(shown.z), 255]
    }
}

/// The mean colour of bodies or backdrop over the samples of a pixel. Each triangle is lit once, at
/// the mean position of its samples.
fn behind_hair(frame: &Frame<'_>, samples: &[Sample], centre: [f32; 2], backdrop: Vec3) -> Vec3 {
    let n = frame.settings.samples as usize;
    let share = 1.0 / samples.len() as f32;
    let mut sum = Vec3::ZERO;
    for (i, &Sample { triangle, .. }) in samples.iter().enumerate() {
        if triangle == NONE {
            sum += backdrop * share;
        } else if samples[..i].iter().all(|sample| sample.triangle != triangle) {
            let (mut at, mut nearness, mut count) = (Vec2::ZERO, 0.0, 0.0);
            for (j, sample) in samples.iter().enumerate().filter(|(_, sample)| sample.triangle == triangle) {
                at += Vec2::new((j % n) as f32, (j / n) as f32);
                nearness += sample.nearness;
                count += 1.0;
            }
            let at = (at / count + 0.5) / n as f32 - 0.5;
            let point = frame.view.unproject(centre[0] + at.x, centre[1] + at.y, nearness / count);
            sum += frame.lighting.of_body(&frame.solids.surface_point(triangle, point)) * (share * count);
        }
    }
    sum
}

/// A piece as a strip of pixels of a tile.
struct Strip {
    from: Vec2,
    along: Vec2,
    length: f32,
    half_width: f32,
    /// Radius of the filter across the strip, pixels.
    radius: f32,
}

impl Strip {
    fn new(piece: &Piece, origin: Vec2) -> Option<Self> {
        // Relative to the centre of the first pixel.
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

    /// The pixels of row `y` whose centres are within the strip.
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

    /// The position of pixel (`x`, `y`) along the strip, 0–1, and its coverage.
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

/// The whole numbers from `lo` to `hi` within a tile. Truncating casts replace `floor` and `ceil`,
/// which are slow.
fn whole(lo: f32, hi: f32) -> std::ops::Range<u32> {
    let end = if hi < 0.0 { 0 } else { (hi as u32).saturating_add(1).min(TILE) };
    let below = lo.max(0.0) as u32;
    let start = below.saturating_add(u32::from((below as f32) < lo));
    start.min(end)..end
}
