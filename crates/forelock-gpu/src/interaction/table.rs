//! The table of cells that contacts and SPH share: entries are sorted by counting.

use crate::kernel::{CELLS_GROUP, Constant, Threads};

/// Cells of a row: entries of one row are adjacent.
pub const ROW_CELLS: u32 = 1024;
/// Workgroups that scan rows.
const ROW_GROUPS: u32 = 256;
/// Threads that scan rows.
pub const ROWS: Threads = Threads::Workgroups(ROW_GROUPS);

/// Constants of the text.
pub const CONSTANTS: &[Constant] = &[
    Constant::u32("ROW_CELLS", ROW_CELLS),
    Constant::u32("ROW_GROUPS", ROW_GROUPS),
    Constant::u32("OWN_CELLS", ROW_CELLS / CELLS_GROUP),
];
