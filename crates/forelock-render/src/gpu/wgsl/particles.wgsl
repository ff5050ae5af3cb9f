// Reads particles, world space.

@group(0) @binding(1) var<storage, read> positions: array<f32>;

// Particle `i` of the strand whose first coordinate is number `base` in `positions`.
fn particle_from(base: u32, i: u32) -> vec3f {
    let at = base + 3u * i;
    return vec3f(positions[at], positions[at + 1u], positions[at + 2u]);
}
