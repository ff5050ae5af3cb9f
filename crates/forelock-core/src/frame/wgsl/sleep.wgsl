// How fast hair moves in a frame, and what follows a sleep. On a GPU all strands sleep together:
// the host decides by the largest speed.

// Positions at the frame's start, three rows per particle.
@group(0) @binding(17) var<storage, read_write> start: array<f32>;

// Bits of the square of the largest speed of a particle over a frame, m²/s².
@group(0) @binding(18) var<storage, read_write> motion: atomic<u32>;

// Records where hair is at the frame's start, relative to the frame's origin.
@compute @workgroup_size(WORKGROUP)
fn record_place(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let at = entry(strand, i, 3u, 0u);
        let x = position_at(strand, i) + substep.shift;
        start[at] = x.x;
        start[at + LANES] = x.y;
        start[at + 2u * LANES] = x.z;
    }
}

// Measures the speed over the frame. What is not finite counts as fast: its bits are greater.
@compute @workgroup_size(WORKGROUP)
fn measure_motion(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    var fastest = 0u;
    for (var i = 0u; i < strand.particles; i++) {
        let at = entry(strand, i, 3u, 0u);
        let x = vec3f(start[at], start[at + LANES], start[at + 2u * LANES]);
        let u = (position_at(strand, i) - x) * frame.inverse_dt;
        fastest = max(fastest, bitcast<u32>(dot(u, u)) & 0x7fffffffu);
    }
    if is_greatest(fastest) {
        atomicMax(&motion, fastest);
    }
}

// After a sleep: distances to solids are not known, since solids may have moved.
@compute @workgroup_size(WORKGROUP)
fn forget_distances(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        memory[entry(strand, i, 2u, 1u)] = frame.unknown;
    }
}
