// How fast hair moves in a frame, and what follows a sleep. On a GPU all strands sleep together:
// the host decides by the largest speed.

// Positions at the frame's start, three rows per particle.
@group(0) @binding(17) var<storage, read_write> start: array<f32>;

// Bits of the square of the largest speed of a particle over a frame, m²/s², of strands that
// friction does not hold.
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

// Slows a strand down by friction (`Stillness`) and measures its speed over the frame. What is not
// finite counts as fast: its bits are greater.
@compute @workgroup_size(WORKGROUP)
fn measure_motion(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    var farthest = 0u;
    var sum = vec3f();
    for (var i = 0u; i < strand.particles; i++) {
        let d = position_at(strand, i) - start_at(strand, i);
        farthest = max(farthest, bitcast<u32>(dot(d, d)) & 0x7fffffffu);
        sum += d;
    }
    let mean = sum / f32(strand.particles);
    let least = FASTEST_SHARE * FASTEST_SHARE * bitcast<f32>(farthest);
    let moved = max(bitcast<u32>(least) & 0x7fffffffu, bitcast<u32>(dot(mean, mean)) & 0x7fffffffu);
    let far = sqrt(bitcast<f32>(moved));
    let speed_squared = bitcast<f32>(farthest) * frame.inverse_dt * frame.inverse_dt;
    var fastest = bitcast<u32>(speed_squared) & 0x7fffffffu;
    if is_finite(far) && far > 0.0 && frame.held > LEAST_FRICTION * far {
        let kept = max(1.0 - frame.held / far, 0.0);
        slow_down(strand, kept);
        // What friction holds is still.
        fastest = select(fastest, 0u, kept == 0.0);
    }
    if is_greatest(fastest) {
        atomicMax(&motion, fastest);
    }
}

fn start_at(strand: Strand, i: u32) -> vec3f {
    let at = entry(strand, i, 3u, 0u);
    return vec3f(start[at], start[at + LANES], start[at + 2u * LANES]);
}

// Leaves the share `kept` of the strand's motion; if that is zero, its positions return to those at
// the frame's start.
fn slow_down(strand: Strand, kept: f32) {
    let has_load = arrayLength(&velocities) > arrayLength(&positions);
    for (var i = 0u; i < strand.particles; i++) {
        let x = position_at(strand, i);
        let v = velocity_at(strand, i);
        let before = start_at(strand, i);
        let now = select(x, before, kept == 0.0);
        var u = v;
        if has_load {
            let step = x - previous_at(strand, i);
            u = step * frame.inverse_h;
            set_previous(strand, i, now - kept * step);
        }
        set_velocity(strand, i, v - (1.0 - kept) * u);
        if kept == 0.0 {
            set_position(strand, i, now);
            let at = entry(strand, i, 2u, 1u);
            let left = memory[at];
            if left > 0.0 {
                memory[at] = max(left - distance(x, before), 0.0);
            }
        }
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
