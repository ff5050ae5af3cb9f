//! Winding numbers of the nodes of a grid.
//!
//! # Theory
//! A ray along a row in x crosses triangles; where it enters the solid the winding number behind
//! the crossing is one more, and where it leaves one less. The test of a crossing is exact
//! ([`Bvh::winding_number`](super::super::Bvh::winding_number)), so no row leaks.

use glam::Vec3;

use super::super::bvh::crossing;
use super::triangle::Axis;

/// The crossings of rows in x with triangles, row by row.
#[derive(Debug, Default)]
pub(super) struct Crossings {
    found: Vec<(u32, f32, i32)>,
    /// Where the crossings of each row begin in `sorted`, and the number of all.
    starts: Vec<u32>,
    /// The first node's coordinate at or behind the crossing, and the change of the number there.
    sorted: Vec<(f32, i32)>,
}

impl Crossings {
    pub fn clear(&mut self) {
        self.found.clear();
    }

    /// Adds the crossings of a triangle with the rows of the plane at `z`, whose first row has the
    /// number `first`.
    #[inline(always)]
    pub fn add(&mut self, corners: &[Vec3; 3], rows: &Axis, z: f32, first: usize) {
        let [a, b, c] = corners;
        if z < a.z.min(b.z).min(c.z) || z > a.z.max(b.z).max(c.z) {
            return;
        }
        // A row that passes by a rounding error belongs to it too; the test is exact.
        let (low, high) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        let slack = 1e-3 * rows.step;
        let Some(across) = rows.between(low - slack, high + slack) else { return };
        for row in across {
            if let Some((x, sign)) = crossing(corners, rows.at(row), z) {
                // The least float32 that is not smaller.
                let near = x as f32;
                let at = if f64::from(near) < x { near.next_up() } else { near };
                self.found.push(((first + row) as u32, at, -sign));
            }
        }
    }

    /// Sorts the crossings into `rows` rows.
    pub fn sort(&mut self, rows: usize) {
        self.starts.clear();
        self.starts.resize(rows + 1, 0);
        for (row, ..) in &self.found {
            self.starts[*row as usize + 1] += 1;
        }
        for row in 0..rows {
            self.starts[row + 1] += self.starts[row];
        }
        self.sorted.clear();
        self.sorted.resize(self.found.len(), (0.0, 0));
        let mut next = self.starts.clone();
        for &(row, x, change) in &self.found {
            let place = &mut next[row as usize];
            self.sorted[*place as usize] = (x, change);
            *place += 1;
        }
    }

    /// The crossings of a row: coordinates, and the changes of the winding number at nodes of the
    /// same or a greater coordinate.
    #[inline(always)]
    pub fn of_row(&self, row: usize) -> &[(f32, i32)] {
        &self.sorted[self.starts[row] as usize..self.starts[row + 1] as usize]
    }
}
