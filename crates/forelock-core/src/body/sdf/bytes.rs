//! A distance field as bytes, for a cache on disk.
//!
//! All numbers are little-endian: 8 bytes of magic including the version, `dims` 3 × u32, `origin`
//! 3 × f32, `cell` f32, `thinness` f32, the number of bricks u32, the cells that have them u32, the
//! values f32 (those of the nodes, then those of the bricks), and a 64-bit FNV-1a hash of all
//! preceding 32-bit words.

use glam::{UVec3, Vec3};

use super::{BRICK_NODES, Sdf, SdfError, node_count};

/// Identifies the format and its version.
const MAGIC: &[u8; 8] = b"FLSDF\0\0\x02";
const HEADER: usize = 8 + 9 * 4;
const TRAILER: usize = 8;

/// Why bytes are not a valid distance field.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SdfBytesError {
    /// The bytes do not begin with the magic number of this version.
    #[error("not a distance field of version {}", MAGIC[7])]
    Magic,
    /// There are too few or too many bytes.
    #[error("a distance field of this size has {expected} bytes, but {found} were given")]
    Length {
        /// Number of bytes that the header implies.
        expected: u64,
        /// Number of bytes found.
        found: usize,
    },
    /// The bytes were changed since they were written.
    #[error("the checksum of the distance field does not match: the data is damaged")]
    Checksum,
    /// The bytes are complete, but do not describe a field.
    #[error(transparent)]
    Field(#[from] SdfError),
}

impl Sdf {
    /// The field as bytes; [`Sdf::from_bytes`] restores it bit for bit.
    pub fn to_bytes(&self) -> Vec<u8> {
        let refined: Vec<u32> = self.bricks.cells().collect();
        let numbers = refined.len() + self.values.len();
        let mut bytes = Vec::with_capacity(HEADER + numbers * 4 + TRAILER);
        bytes.extend_from_slice(MAGIC);
        self.dims.to_array().iter().for_each(|n| bytes.extend_from_slice(&n.to_le_bytes()));
        let frame = self.origin.to_array().into_iter().chain([self.cell, self.thinness]);
        frame.for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        let counted = std::iter::once(refined.len() as u32).chain(refined);
        counted.for_each(|n| bytes.extend_from_slice(&n.to_le_bytes()));
        self.values.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        let hash = checksum(&bytes);
        bytes.extend_from_slice(&hash.to_le_bytes());
        bytes
    }

    /// Reads a field written by [`Sdf::to_bytes`].
    ///
    /// # Errors
    /// [`SdfBytesError`]. Nothing is allocated before the length has been checked.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SdfBytesError> {
        let wrong = |expected| SdfBytesError::Length { expected, found: bytes.len() };
        let Some(header) = bytes.get(..HEADER) else {
            return Err(if bytes.starts_with(MAGIC) { wrong(HEADER as u64) } else { SdfBytesError::Magic });
        };
        if !header.starts_with(MAGIC) {
            return Err(SdfBytesError::Magic);
        }
        let words = words(&header[8..]);
        let dims = UVec3::new(words[0], words[1], words[2]);
        let [x, y, z, cell, thinness] = [3, 4, 5, 6, 7].map(|at| f32::from_bits(words[at]));
        let nodes = node_count(dims).ok_or(SdfError::Dims(dims))?;
        let bricks = words[8] as usize;
        let numbers = nodes as u64 + bricks as u64 * (BRICK_NODES as u64 + 1);
        let expected = numbers * 4 + (HEADER + TRAILER) as u64;
        if bytes.len() as u64 != expected {
            return Err(wrong(expected));
        }
        let (body, trailer) = bytes.split_at(bytes.len() - TRAILER);
        if trailer != checksum(body).to_le_bytes() {
            return Err(SdfBytesError::Checksum);
        }
        let (refined, values) = body[HEADER..].split_at(bricks * 4);
        let values = self::words(values).into_iter().map(f32::from_bits).collect();
        Ok(Self::with_bricks(dims, Vec3::new(x, y, z), cell, thinness, values, &self::words(refined))?)
    }
}

/// Splits `bytes` into little-endian words.
fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

/// FNV-1a over words of four bytes.
fn checksum(bytes: &[u8]) -> u64 {
    let step = |hash: u64, word: &[u8; 4]| {
        (hash ^ u64::from(u32::from_le_bytes(*word))).wrapping_mul(0x0000_0100_0000_01b3)
    };
    bytes.as_chunks().0.iter().fold(0xcbf2_9ce4_8422_2325, step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn field() -> Sdf {
        let values = (0..24).map(|i| i as f32 * 0.25 - 3.0).collect();
        Sdf::new(UVec3::new(2, 3, 4), Vec3::new(0.5, -1.0, 2.0), 0.125, values).unwrap()
    }

    /// The same with bricks in two of its six cells.
    fn refined() -> Sdf {
        let values = (0..24 + 250).map(|i| i as f32 * 0.125 - 3.0).collect();
        Sdf::with_bricks(UVec3::new(2, 3, 4), Vec3::ZERO, 0.125, 0.5, values, &[2, 14]).unwrap()
    }

    #[test]
    fn bytes_give_the_same_field() {
        for field in [field(), refined()] {
            assert_eq!(Sdf::from_bytes(&field.to_bytes()), Ok(field));
        }
    }

    #[test]
    fn cut_or_changed_bytes_are_refused() {
        for field in [field(), refined()] {
            refuse_damaged(&field.to_bytes());
        }
    }

    fn refuse_damaged(bytes: &[u8]) {
        for length in 0..bytes.len() {
            assert!(Sdf::from_bytes(&bytes[..length]).is_err(), "{length} bytes");
        }
        for at in 0..bytes.len() {
            let mut changed = bytes.to_vec();
            changed[at] ^= 0x10;
            assert!(Sdf::from_bytes(&changed).is_err(), "byte {at}");
        }
    }

    #[test]
    fn a_header_of_four_billion_nodes_allocates_nothing() {
        let mut bytes = field().to_bytes();
        bytes[8..20].fill(0xff);
        assert!(matches!(Sdf::from_bytes(&bytes), Err(SdfBytesError::Field(SdfError::Dims(_)))));
    }

    proptest! {
        #[test]
        fn random_bytes_never_panic(tail in prop::collection::vec(any::<u8>(), 0..200)) {
            let bytes = [&MAGIC[..], &tail].concat();
            prop_assert!(Sdf::from_bytes(&tail).is_err());
            prop_assert!(Sdf::from_bytes(&bytes).is_err());
        }
    }
}
