//! The cells inside solids.

use super::fields::{HAIR, NEAR, SOLID};
use crate::body::{ColliderFrame, PACKET, Sdf, Shape};
use crate::interaction::grid::{Bounds, GridPlacement, GridSolid, RowMap, STRIP, SolidMaps};
use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Masses and walls of a layer.
pub(super) struct LayerWalls<'a> {
    pub strips: &'a mut [u8],
    pub masses: &'a mut [f32],
    pub momentum: [&'a mut [f32]; 3],
    pub walls: &'a mut [u16],
    /// The solids of the frame and their place on the grid.
    pub solids: &'a [ColliderFrame<'a>],
    pub placed: &'a [GridSolid],
    pub known: &'a [KnownCells],
    /// Side of a cell, metres.
    pub cell: f32,
}

impl LayerWalls<'_> {
    /// Finds the strips of layer `k` near `hair`, clears those without, and marks the cells next to
    /// hair that are inside solids.
    pub fn find(&mut self, bounds: &Bounds, k: usize, hair: &[u16]) {
        let [row, rows, layers] = [bounds.strips(), bounds.dims[1], bounds.dims[2]];
        let at = |s: usize, j: usize, k: usize| {
            if s < row && j < rows && k < layers { hair[row * (rows * k + j) + s] } else { 0 }
        };
        for j in 0..rows {
            for s in 0..row {
                let own = at(s, j, k);
                let beside = own << 1
                    | own >> 1
                    | at(s.wrapping_sub(1), j, k) >> 15
                    | at(s + 1, j, k) << 15
                    | at(s, j.wrapping_sub(1), k)
                    | at(s, j + 1, k)
                    | at(s, j, k.wrapping_sub(1))
                    | at(s, j, k + 1);
                let strip = row * j + s;
                self.strips[strip] = mark_of(own, beside);
                if self.strips[strip] != 0 {
                    self.set_strip(bounds, [s, j, k], own, own | beside);
                }
            }
        }
    }

    /// Clears a strip if it holds no hair (`own`), and marks the cells `near` hair that are inside
    /// solids.
    fn set_strip(&mut self, bounds: &Bounds, [s, j, k]: [usize; 3], own: u16, near: u16) {
        let strip = bounds.strips() * j + s;
        let cells = STRIP * strip..STRIP * (strip + 1);
        let walls = &mut self.walls[cells.clone()];
        walls.fill(0);
        let masses = &mut self.masses[cells.clone()];
        if own == 0 {
            masses.fill(0.0);
            self.momentum.iter_mut().for_each(|field| field[cells.clone()].fill(0.0));
        }
        let solids = self.solids.iter().zip(self.placed).zip(self.known);
        for (number, ((solid, placed), known)) in (1..=u16::MAX).zip(solids) {
            for packet in (0..STRIP).step_by(PACKET).filter(|packet| near >> packet & 0xff != 0) {
                let at = [STRIP * s + packet, j, k];
                let inside = known.find(at, bounds, || {
                    let middle = |n: usize| placed.local([0, 1, 2].map(|c| at[c] as f32 + middle_of(c, n)));
                    inside(solid.shape, self.cell, middle)
                });
                for (n, wall) in walls[packet..packet + PACKET].iter_mut().enumerate() {
                    if *wall == 0 && inside >> n & 1 != 0 {
                        *wall = number;
                    }
                }
            }
        }
        if !self.solids.is_empty() {
            for (mass, _) in masses.iter_mut().zip(walls).filter(|(_, wall)| **wall > 0) {
                *mass = SOLID;
            }
        }
    }
}

/// The mark of a strip whose cells `own` hold hair and whose cells `beside` are next to such.
fn mark_of(own: u16, beside: u16) -> u8 {
    match (own, beside) {
        (0, 0) => 0,
        (0, _) => NEAR,
        _ => HAIR | NEAR,
    }
}

/// The middle of cell `n` of a packet along an axis, from its first corner.
fn middle_of(axis: usize, n: usize) -> f32 {
    if axis == 0 { n as f32 + 0.5 } else { 0.5 }
}

/// Which cells of a packet are inside a shape, a bit a cell. `middle` is the middle of a cell in
/// the local space of the shape, metres; `cell` the side of a cell.
fn inside(shape: &Shape, cell: f32, middle: impl Fn(usize) -> [f32; 3]) -> u32 {
    if shape.sample_near(middle(PACKET / 2), cell * PACKET as f32 * 0.5).is_none() {
        return 0;
    }
    let locals: [[f32; 3]; PACKET] = std::array::from_fn(&middle);
    let points = [0, 1, 2].map(|c| locals.map(|local| local[c]));
    let (distances, _) = shape.sample_packet(&points, 1.0);
    distances.iter().enumerate().fold(0, |bits, (k, distance)| bits | u32::from(*distance < 0.0) << k)
}

/// The cells inside a distance field that does not move relative to the grid, as far as they have
/// been asked for. What it answers does not depend on what was asked before: the map to the field
/// is rounded, so that it is the same while the head carries the field.
#[derive(Debug, Default)]
pub(super) struct KnownCells {
    field: Option<Field>,
    /// First strip along x, and first cells along y and z, from the grid's origin.
    low: [i32; 3],
    dims: [usize; 3],
    /// Of each strip the cells inside, a bit a cell, and from bit [`STRIP`] on a bit for each
    /// packet that has been asked for.
    strips: Vec<AtomicU32>,
}

/// A field and its place.
#[derive(Debug)]
struct Field {
    sdf: Arc<Sdf>,
    /// To its local space from cells, in units of [`KnownCells::unit`].
    rounded: [i64; 12],
    local: RowMap,
    shape: Shape,
    cell: f32,
}

/// Strips at most that are kept for a solid.
const MOST_STRIPS: usize = 1 << 22;

impl KnownCells {
    pub fn bytes(&self) -> usize {
        4 * self.strips.capacity()
    }

    /// Rounding of the map, metres: over a thousand cells a ten-thousandth of one.
    fn unit(cell: f64) -> f64 {
        cell * 2.0f64.powi(-24)
    }

    /// Forgets the cells unless `solid` is the field of the frame before, at the same place.
    pub fn fit(&mut self, solid: &ColliderFrame<'_>, grid: &GridPlacement<'_>) {
        let Shape::Sdf(sdf) = solid.shape else {
            self.field = None;
            return;
        };
        let local = SolidMaps::new(solid, grid).local;
        let unit = Self::unit(grid.cell);
        #[expect(clippy::cast_possible_truncation, reason = "a cast saturates, and far solids hold no cell")]
        let rounded = local.to_cols_array().map(|x| (x / unit).round() as i64);
        if self.field.as_ref().is_some_and(|own| Arc::ptr_eq(&own.sdf, sdf) && own.rounded == rounded) {
            return;
        }
        let local = DAffine3::from_cols_array(&rounded.map(|x| x as f64 * unit));
        self.fit_box(sdf, &local);
        self.field = (!self.strips.is_empty()).then(|| Field {
            sdf: sdf.clone(),
            rounded,
            local: RowMap::new(local.matrix3, local.translation),
            shape: Shape::Sdf(sdf.clone()),
            cell: grid.cell as f32,
        });
    }

    /// Fits the box to the field; no strips if it would be too large.
    fn fit_box(&mut self, sdf: &Sdf, local: &DAffine3) {
        self.strips.clear();
        let (least, most) = sdf.bounds();
        let into = local.inverse();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in 0..8 {
            let side = |c: usize| if corner >> c & 1 == 0 { least[c] } else { most[c] };
            let at = into.transform_point3(Vec3::new(side(0), side(1), side(2)).as_dvec3());
            (low, high) = (low.min(at), high.max(at));
        }
        let size = (high - low).max_element();
        if !(low.is_finite() && high.is_finite() && size < 1e5 && low.abs().max_element() < 1e6) {
            return;
        }
        let step = DVec3::new(STRIP as f64, 1.0, 1.0);
        let (low, high) = ((low / step).floor().as_ivec3(), (high / step).floor().as_ivec3());
        self.low = low.to_array();
        self.dims = (high - low + 1).to_array().map(|cells| usize::try_from(cells).unwrap_or(0));
        let strips = self.dims.iter().product();
        if strips <= MOST_STRIPS {
            self.strips.resize_with(strips, AtomicU32::default);
        }
    }

    /// Which cells of the packet from `at` in the box are inside, a bit a cell; `ask` if the cells
    /// of this solid are not kept.
    fn find(&self, at: [usize; 3], bounds: &Bounds, ask: impl FnOnce() -> u32) -> u32 {
        let Some(field) = &self.field else { return ask() };
        let absolute = [0, 1, 2].map(|c| bounds.low[c] + i32::try_from(at[c]).unwrap_or(i32::MAX));
        let strip = [absolute[0].div_euclid(STRIP as i32), absolute[1], absolute[2]];
        let place = [0, 1, 2].map(|c| usize::try_from(strip[c] - self.low[c]).unwrap_or(usize::MAX));
        if (0..3).any(|c| place[c] >= self.dims[c]) {
            return 0;
        }
        let entry = &self.strips[place[0] + self.dims[0] * (place[1] + self.dims[1] * place[2])];
        let packet = at[0] % STRIP / PACKET;
        let (known, asked) = (entry.load(Relaxed), 1 << (STRIP + packet));
        if known & asked != 0 {
            return known >> (PACKET * packet) & 0xff;
        }
        let found = inside(&field.shape, field.cell, |n| {
            field.local.apply([0, 1, 2].map(|c| absolute[c] as f32 + middle_of(c, n)))
        });
        entry.fetch_or(found << (PACKET * packet) | asked, Relaxed);
        found
    }
}
