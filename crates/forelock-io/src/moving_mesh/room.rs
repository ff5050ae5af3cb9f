//! The memory that meshes may take.

use crate::error::check_room;

/// Bytes after which the free memory is looked at again.
const STEP: u64 = 64 << 20;
/// Bytes that the meshes of any file may take.
pub(crate) const FREE: u64 = 16 << 20;

/// The memory that the meshes of a file take, and may take.
///
/// Samples of a file may share their bytes, meshes their points, and one transform may stretch a
/// mesh differently in each frame, so meshes can take much more memory than their file has bytes.
#[derive(Debug)]
pub(crate) struct Room {
    taken: u64,
    checked: u64,
    /// The multiple of the file that may be taken, beside [`FREE`] bytes.
    times: u64,
    most: u64,
}

impl Room {
    /// For a file of so many bytes, whose meshes may take `times` as many.
    pub fn new(file_bytes: u64, times: u64) -> Self {
        let most = file_bytes.saturating_mul(times).saturating_add(FREE);
        Self { taken: 0, checked: 0, times, most }
    }

    /// Counts `bytes` more.
    ///
    /// # Errors
    /// When the meshes take too much for their file, or there is not enough free memory to go on.
    pub fn take(&mut self, bytes: usize) -> Result<(), String> {
        self.taken = self.taken.saturating_add(bytes as u64);
        if self.taken > self.most {
            return Err(format!(
                "the meshes take over {} times the bytes of the file, and {} MB, in memory: many \
                 frames share samples, many meshes share points, or transforms stretch meshes; export \
                 fewer frames or meshes, or apply the transforms to the points",
                self.times,
                FREE >> 20
            ));
        }
        while self.taken > self.checked {
            check_room(STEP).map_err(|error| error.to_string())?;
            self.checked += STEP;
        }
        Ok(())
    }

    /// Counts `bytes` less, which are not held any more.
    pub fn give_back(&mut self, bytes: usize) {
        self.taken = self.taken.saturating_sub(bytes as u64);
    }
}
