// A light, and the heights in its shadow map.

struct Light {
    direction: vec3f,
    texel: f32,
    colour: vec3f,
    // The first value of its shadow map in `heights`, or NONE.
    heights: u32,
    right: vec3f,
    // The first value of its grid in `grids`, or NONE.
    grid: u32,
    up: vec3f,
    // Texels along a side of its shadow map.
    side: u32,
    origin: vec3f,
    unused: u32,
}

// Numbers in the same order as their floats, so that integers can be compared. 0 is below all.
fn ordered(height: f32) -> u32 {
    let bits = bitcast<u32>(height);
    return select(bits | 0x80000000u, ~bits, (bits & 0x80000000u) != 0u);
}
