//! The tiles of a picture, and the list of items that touch each tile.

/// The side of a tile, pixels.
pub(crate) const TILE: u32 = 32;

/// The number of tiles of a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TileGrid {
    pub columns: u32,
    pub rows: u32,
}

/// The tiles from `lo` to `hi` inclusive, as (column, row).
#[derive(Clone, Copy, Debug)]
pub(crate) struct TileRect {
    lo: [u32; 2],
    hi: [u32; 2],
}

impl TileGrid {
    pub fn new(width: u32, height: u32) -> Self {
        Self { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }

    pub fn len(&self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// The tiles that the box from `lo` to `hi`, in pixels, touches, if there are any.
    pub fn rect(&self, lo: [f32; 2], hi: [f32; 2]) -> Option<TileRect> {
        let side = TILE as f32;
        let (w, h) = (self.columns as f32 * side, self.rows as f32 * side);
        let touches = hi[0] >= 0.0 && hi[1] >= 0.0 && lo[0] < w && lo[1] < h;
        // Casts of floats saturate, so corners outside the picture give tiles at its border.
        let tile = |x: f32, count: u32| ((x / side) as u32).min(count - 1);
        touches.then(|| TileRect {
            lo: [tile(lo[0], self.columns), tile(lo[1], self.rows)],
            hi: [tile(hi[0], self.columns), tile(hi[1], self.rows)],
        })
    }
}

/// For each tile, the items that touch it, in the order of the items.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bins {
    offsets: Vec<u32>,
    items: Vec<u32>,
}

impl Bins {
    /// Sorts `items`, pairs of (item, tiles), into tiles by a counting sort. The iterator is used
    /// twice.
    pub fn new(grid: TileGrid, items: impl Iterator<Item = (u32, TileRect)> + Clone) -> Self {
        let tiles = |rect: TileRect| {
            (rect.lo[1]..=rect.hi[1])
                .flat_map(move |y| (rect.lo[0]..=rect.hi[0]).map(move |x| (y * grid.columns + x) as usize))
        };
        let mut offsets = vec![0_u32; grid.len() + 1];
        for (_, rect) in items.clone() {
            tiles(rect).for_each(|tile| offsets[tile + 1] += 1);
        }
        for tile in 0..grid.len() {
            offsets[tile + 1] += offsets[tile];
        }
        let mut next = offsets.clone();
        let mut sorted = vec![0; offsets[grid.len()] as usize];
        for (item, rect) in items {
            for tile in tiles(rect) {
                sorted[next[tile] as usize] = item;
                next[tile] += 1;
            }
        }
        Self { offsets, items: sorted }
    }

    /// The items that touch `tile`.
    pub fn of(&self, tile: usize) -> &[u32] {
        &self.items[self.offsets[tile] as usize..self.offsets[tile + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_touched_tile_lists_the_item() {
        let grid = TileGrid::new(100, 70);
        assert_eq!((grid.columns, grid.rows), (4, 3));
        let rects = [
            grid.rect([5.0, 5.0], [40.0, 10.0]),
            grid.rect([-9.0, -9.0], [1e9, 1e9]),
            grid.rect([-9.0, 0.0], [-1.0, 9.0]),
            grid.rect([99.0, 64.0], [99.5, 64.5]),
        ];
        assert!(rects[2].is_none());
        let items = rects.iter().enumerate().filter_map(|(i, r)| r.map(|r| (i as u32, r)));
        let bins = Bins::new(grid, items);
        assert_eq!(bins.of(0), [0, 1]);
        assert_eq!(bins.of(1), [0, 1]);
        assert_eq!(bins.of(2), [1]);
        assert_eq!(bins.of(11), [1, 3]);
    }
}
