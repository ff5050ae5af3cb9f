// Acceleration of particles in addition to gravity: the GPU counterpart of `frame::Acceleration`.

// A lattice around the hair.
struct Lattice {
    // The first node, relative to the origin of positions.
    low: vec3f,
    // One over the side of a cell, 1/m.
    per_metre: f32,
}

// Three rows per particle, m/s².
@group(0) @binding(17) var<storage, read_write> acceleration: array<f32>;
// Acceleration at the nodes of the lattice, x fastest.
@group(0) @binding(18) var<storage, read> nodes: array<vec4f>;
@group(0) @binding(20) var<uniform> lattice: Lattice;

fn node_at(x: u32, y: u32, z: u32) -> vec3f {
    let side = LATTICE + 1u;
    return nodes[x + side * (y + side * z)].xyz;
}

// Interpolates the field at each particle, linearly in each direction.
@compute @workgroup_size(WORKGROUP)
fn sample_acceleration(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let place = (position_at(strand, i) - lattice.low) * lattice.per_metre;
        let at = clamp(place, vec3f(0.0), vec3f(f32(LATTICE)));
        let cell = min(vec3u(at), vec3u(LATTICE - 1u));
        let t = at - vec3f(cell);
        let next = cell + vec3u(1u);
        let low = mix(
            mix(node_at(cell.x, cell.y, cell.z), node_at(next.x, cell.y, cell.z), t.x),
            mix(node_at(cell.x, next.y, cell.z), node_at(next.x, next.y, cell.z), t.x),
            t.y,
        );
        let high = mix(
            mix(node_at(cell.x, cell.y, next.z), node_at(next.x, cell.y, next.z), t.x),
            mix(node_at(cell.x, next.y, next.z), node_at(next.x, next.y, next.z), t.x),
            t.y,
        );
        let a = mix(low, high, t.z);
        let to = entry(strand, i, 3u, 0u);
        acceleration[to] = a.x;
        acceleration[to + LANES] = a.y;
        acceleration[to + 2u * LANES] = a.z;
    }
}

// Adds h a to velocities, before a substep.
@compute @workgroup_size(WORKGROUP)
fn accelerate(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let at = entry(strand, i, 3u, 0u);
        let a = vec3f(acceleration[at], acceleration[at + LANES], acceleration[at + 2u * LANES]);
        set_velocity(strand, i, velocity_at(strand, i) + frame.h * a);
    }
}
