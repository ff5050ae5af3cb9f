//! Small integer hashes for variation between strands.

/// A 32-bit hash of (`seed`, `index`, `stream`), by two rounds of xor-shift and multiply.
pub(crate) fn hash(seed: u32, index: u32, stream: u32) -> u32 {
    let mix = |mut x: u32| {
        x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
        x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
        x ^ (x >> 16)
    };
    mix(mix(seed ^ stream.wrapping_mul(0x9e37_79b9)).wrapping_add(index))
}

/// A number in [0, 1) from the same hash.
pub(crate) fn unit(seed: u32, index: u32, stream: u32) -> f32 {
    (hash(seed, index, stream) >> 8) as f32 / 16_777_216.0
}

/// A number in [−1, 1) from the same hash.
pub(crate) fn signed(seed: u32, index: u32, stream: u32) -> f32 {
    2.0 * unit(seed, index, stream) - 1.0
}
