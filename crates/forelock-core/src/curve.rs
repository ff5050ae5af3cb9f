//! Space-filling curves.

/// Bits of a coordinate.
pub(crate) const CURVE_BITS: u32 = 10;

/// The number of a cell along a Hilbert curve: consecutive cells share a face, so points of similar
/// number are close to each other. Coordinates have [`CURVE_BITS`] bits.
///
/// From the highest bit down, each bit of the coordinates reflects and exchanges the axes of the
/// cells within (Skilling 2004, "Programming the Hilbert curve").
pub(crate) fn hilbert(mut cell: [u32; 3]) -> u32 {
    for bit in (1..CURVE_BITS).rev() {
        let below = (1 << bit) - 1;
        for c in 0..3 {
            if cell[c] >> bit & 1 != 0 {
                cell[0] ^= below;
            } else {
                let exchanged = (cell[0] ^ cell[c]) & below;
                cell[0] ^= exchanged;
                cell[c] ^= exchanged;
            }
        }
    }
    // The bits so far are those of a Gray code.
    cell[1] ^= cell[0];
    cell[2] ^= cell[1];
    let flipped = (1..CURVE_BITS).fold(0, |flipped, bit| flipped ^ ((cell[2] >> bit & 1) * ((1 << bit) - 1)));
    let [x, y, z] = cell.map(|x| spread(x ^ flipped));
    x << 2 | y << 1 | z
}

/// Spreads the lowest ten bits of a number to every third bit.
#[inline(always)]
pub(crate) const fn spread(number: u32) -> u32 {
    let mut bits = number & 0x3ff;
    bits = (bits | bits << 16) & 0x0300_00ff;
    bits = (bits | bits << 8) & 0x0300_f00f;
    bits = (bits | bits << 4) & 0x030c_30c3;
    (bits | bits << 2) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn consecutive_cells_share_a_face() {
        let side = 16u32;
        let mut cells: Vec<[u32; 3]> =
            (0..side.pow(3)).map(|k| [k % side, k / side % side, k / side.pow(2)]).collect();
        cells.sort_by_key(|&cell| hilbert(cell));
        for pair in cells.windows(2) {
            let steps: u32 = (0..3).map(|c| pair[0][c].abs_diff(pair[1][c])).sum();
            assert_eq!(steps, 1, "{pair:?}");
        }
        // The curve fills each cube of a power of two before the next.
        assert!(cells.iter().map(|&cell| hilbert(cell)).eq(0..side.pow(3)));
        let most = [(1 << CURVE_BITS) - 1; 3];
        assert!(hilbert(most) < 1 << (3 * CURVE_BITS));
    }
}
