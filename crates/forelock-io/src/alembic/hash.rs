//! The checksum of samples: MurmurHash3 for 128 bits, by Austin Appleby, in the public domain.
//!
//! # Theory
//! The bytes enter in blocks of 16, as two words k₁ and k₂. Each word is multiplied, rotated and
//! multiplied again, and joins one of the halves h₁ and h₂ of the state, which mix with each other.
//!
//! # Practice
//! Programs that read Alembic take samples of equal checksums for equal, so that the checksum must
//! be that of the library, or at least as good.
//!
//! # Limitations
//! The checksum does not protect against intent.

const C1: u64 = 0x87c3_7b91_1142_53d5;
const C2: u64 = 0x4cf5_ad43_2745_937f;

fn scramble_1(k1: u64) -> u64 {
    k1.wrapping_mul(C1).rotate_left(31).wrapping_mul(C2)
}

fn scramble_2(k2: u64) -> u64 {
    k2.wrapping_mul(C2).rotate_left(33).wrapping_mul(C1)
}

fn finish(h: u64) -> u64 {
    let h = (h ^ h >> 33).wrapping_mul(0xff51_afd7_ed55_8ccd);
    let h = (h ^ h >> 33).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    h ^ h >> 33
}

fn word(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |sum, &byte| sum << 8 | u64::from(byte))
}

/// The checksum of `bytes`.
pub(super) fn checksum(bytes: &[u8]) -> [u8; 16] {
    let (mut h1, mut h2) = (0u64, 0u64);
    let (blocks, tail) = bytes.as_chunks::<16>();
    for block in blocks {
        let [k1, k2]: [u64; 2] = bytemuck::cast(*block);
        h1 ^= scramble_1(k1);
        h1 = h1.rotate_left(27).wrapping_add(h2).wrapping_mul(5).wrapping_add(0x52dc_e729);
        h2 ^= scramble_2(k2);
        h2 = h2.rotate_left(31).wrapping_add(h1).wrapping_mul(5).wrapping_add(0x3849_5ab5);
    }
    let (low, high) = tail.split_at(tail.len().min(8));
    h2 ^= scramble_2(word(high)) ^ bytes.len() as u64;
    h1 ^= scramble_1(word(low)) ^ bytes.len() as u64;
    h1 = h1.wrapping_add(h2);
    h2 = h2.wrapping_add(h1);
    (h1, h2) = (finish(h1), finish(h2));
    h1 = h1.wrapping_add(h2);
    h2 = h2.wrapping_add(h1);
    (u128::from(h2) << 64 | u128::from(h1)).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The checksums in a file that the library wrote: of the booleans true and false, and of the
    /// bytes of an empty box.
    #[test]
    fn checksums_are_those_of_the_library() {
        let hex = |bytes: [u8; 16]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        assert_eq!(hex(checksum(&[1])), "16fe7483905cce7a85670e43e4678877");
        assert_eq!(hex(checksum(&[0])), "b55cff6ee5ab10468335f878aa2d6251");
        let empty = [f64::MAX, f64::MAX, f64::MAX, -f64::MAX, -f64::MAX, -f64::MAX];
        assert_eq!(hex(checksum(bytemuck::cast_slice(&empty))), "310488ee1c82f593c7cefeb387583dbb");
    }
}
