// Shared by the kernels of SPH: the GPU counterpart of `sph::Fluid` and of the data of
// `find_neighbours`.
//
// A particle has a number: its place in the whole model × LANES + lane, whatever its batch. `cloud`
// holds bits of floats and integers: the entries in sorted order, eight numbers each (position,
// velocity, number, strand); then one number for each slot of the density and of the two bounds of
// its list (the squared distance of the last neighbour, and its number, which breaks ties); the
// accelerations, three numbers for each particle; the lists of slots.

struct Fluid {
    h: f32,
    h2: f32,
    inverse_h: f32,
    dt: f32,
    // Mass of a particle times the factors of the three kernels.
    mass_density: f32,
    mass_push: f32,
    mass_drag: f32,
    pressure: f32,
    viscosity: f32,
    inverse_dt: f32,
    // Maximum number of neighbours; particles, including those of inactive lanes; buckets.
    neighbours: u32,
    numbers: u32,
    buckets: u32,
    own_strand: u32,
    mutual: u32,
    pad_0: u32,
}

const ENTRY: u32 = 8u;

@group(0) @binding(32) var<uniform> fluid: Fluid;
@group(0) @binding(33) var<storage, read_write> cloud: array<u32>;
// The number of each particle in the groom, its strand, and the bits of its rest density.
@group(0) @binding(34) var<storage, read> names: array<u32>;
// The buckets, twice; then the number of entries.
@group(0) @binding(27) var<storage, read_write> table: array<atomic<u32>>;

fn real_at(at: u32) -> f32 {
    return bitcast<f32>(cloud[at]);
}

fn vector_at(at: u32) -> vec3f {
    return bitcast<vec3f>(vec3u(cloud[at], cloud[at + 1u], cloud[at + 2u]));
}

fn set_vector_at(at: u32, v: vec3f) {
    let bits = bitcast<vec3u>(v);
    cloud[at] = bits.x;
    cloud[at + 1u] = bits.y;
    cloud[at + 2u] = bits.z;
}

fn number_at(slot: u32) -> u32 {
    return cloud[ENTRY * slot + 6u];
}

fn density_at(slot: u32) -> f32 {
    return real_at(8u * fluid.numbers + slot);
}

fn acceleration_of(number: u32) -> u32 {
    return 11u * fluid.numbers + 3u * number;
}

fn list_of(slot: u32) -> u32 {
    return 14u * fluid.numbers + fluid.neighbours * slot;
}

fn cell_of(x: vec3f) -> vec3i {
    return vec3i(floor(x * fluid.inverse_h));
}

// Spreads the lowest ten bits of each number to every third bit.
fn spread(numbers: vec3u) -> vec3u {
    var bits = numbers & vec3u(0x3ffu);
    bits = (bits | (bits << vec3u(16u))) & vec3u(0x030000ffu);
    bits = (bits | (bits << vec3u(8u))) & vec3u(0x0300f00fu);
    bits = (bits | (bits << vec3u(4u))) & vec3u(0x030c30c3u);
    return (bits | (bits << vec3u(2u))) & vec3u(0x09249249u);
}

fn bucket_of(cell: vec3i) -> u32 {
    let own = spread(bitcast<vec3u>(cell));
    return (own.x | (own.y << 1u) | (own.z << 2u)) & (fluid.buckets - 1u);
}
