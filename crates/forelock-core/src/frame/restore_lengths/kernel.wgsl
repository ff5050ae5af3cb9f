// The pass that restores the rest length of every edge, or limits their stretch, one strand a
// thread: the GPU counterpart of `restore_lengths::restore`.
//
// Scratch rows 0 to 2 of an edge hold its direction, row 3 the right side and then λ, row 4 the
// eliminated entry; rows 5 to 7 of a particle hold its position before the pass, from which
// the collision pass after it sweeps.

fn edge_of(strand: Strand, j: u32) -> vec4f {
    let d = position_at(strand, j + 1u) - position_at(strand, j);
    let length = sqrt(max(dot(d, d), 1e-24));
    return vec4f(d / length, length);
}

// The longest that edge j may be.
fn most_of(strand: Strand, j: u32) -> f32 {
    return frame.length_limit * rest_length(strand, j, 1u);
}

// Thomas' algorithm on J W Jᵀ λ = r. Row 3 holds r before and λ afterwards.
fn solve_chain(strand: Strand, first: u32) {
    var upper = 0.0;
    var partial = 0.0;
    var beside = 0.0;
    // The first edge starts at a clamped particle: it has one free end.
    var inner = 0.0;
    var direction = scratch_vector(strand, first, 0u);
    for (var j = first; j + 1u < strand.particles; j++) {
        let at = entry(strand, j, SCRATCH, 3u);
        let outer = 1.0 / mass_at(strand, j + 1u);
        let pivot = 1.0 / (inner + outer - beside * upper);
        partial = (scratch_number(at) - beside * partial) * pivot;
        var next = 0.0;
        if j + 2u < strand.particles {
            let after = scratch_vector(strand, j + 1u, 0u);
            next = -outer * dot(direction, after);
            direction = after;
        }
        upper = next * pivot;
        set_scratch_number(at, partial);
        set_scratch_number(at + LANES, upper);
        beside = next;
        inner = outer;
    }
    var lambda = 0.0;
    for (var k = 0u; k < strand.particles - 1u - first; k++) {
        let at = entry(strand, strand.particles - 2u - k, SCRATCH, 3u);
        lambda = scratch_number(at) - scratch_number(at + LANES) * lambda;
        set_scratch_number(at, lambda);
    }
}

// W Jᵀ λ of particle i.
fn push_of(strand: Strand, i: u32) -> vec3f {
    var push = scratch_number(entry(strand, i - 1u, SCRATCH, 3u)) * scratch_vector(strand, i - 1u, 0u);
    if i + 1u < strand.particles {
        push -= scratch_number(entry(strand, i, SCRATCH, 3u)) * scratch_vector(strand, i, 0u);
    }
    return push / mass_at(strand, i);
}

// Places each particle at its rest length from the particle before it; with LIMIT_LENGTHS only
// those that are farther than the limit, and at it. With `changes_velocities` the corrections also
// change velocities, as in DFTL.
fn follow_the_leader(strand: Strand, first: u32, changes_velocities: bool) {
    for (var j = first; j + 1u < strand.particles; j++) {
        let before = position_at(strand, j + 1u);
        let edge = edge_of(strand, j);
        var goal = rest_length(strand, j, 1u);
        if has(LIMIT_LENGTHS) {
            goal = most_of(strand, j);
            if edge.w <= goal {
                continue;
            }
        }
        let after = position_at(strand, j) + goal * edge.xyz;
        set_position(strand, j + 1u, after);
        if changes_velocities {
            let correction = (after - before) * substep.inverse_span;
            set_velocity(strand, j + 1u, velocity_at(strand, j + 1u) + correction);
            if j > first {
                set_velocity(strand, j, velocity_at(strand, j) - frame.length_damping * correction);
            }
        }
    }
}

fn restore(strand: Strand, first: u32) {
    let n = strand.particles;
    if has(FOLLOW_THE_LEADER) {
        follow_the_leader(strand, first, true);
        return;
    }
    for (var step = 0u; step < NEWTON_STEPS; step++) {
        for (var j = first; j + 1u < n; j++) {
            var edge = edge_of(strand, j);
            var missing = rest_length(strand, j, 1u) - edge.w;
            if has(LIMIT_LENGTHS) {
                missing = min(most_of(strand, j) - edge.w, 0.0);
                edge *= select(0.0, 1.0, edge.w > AT_LIMIT * most_of(strand, j));
            }
            set_scratch_vector(strand, j, 0u, edge.xyz);
            set_scratch_number(entry(strand, j, SCRATCH, 3u), missing);
        }
        solve_chain(strand, first);
        for (var i = first + 1u; i < n; i++) {
            set_position(strand, i, position_at(strand, i) + push_of(strand, i));
        }
    }
    follow_the_leader(strand, first, false);
    for (var j = first; j + 1u < n; j++) {
        var edge = edge_of(strand, j);
        let apart = velocity_at(strand, j + 1u) - velocity_at(strand, j);
        var closing = -dot(edge.xyz, apart);
        if has(LIMIT_LENGTHS) && (edge.w <= AT_LIMIT * most_of(strand, j) || closing >= 0.0) {
            edge = vec4f();
            closing = 0.0;
        }
        set_scratch_vector(strand, j, 0u, edge.xyz);
        set_scratch_number(entry(strand, j, SCRATCH, 3u), closing);
    }
    solve_chain(strand, first);
    for (var i = first + 1u; i < n; i++) {
        set_velocity(strand, i, velocity_at(strand, i) + push_of(strand, i));
    }
}

fn restore_strand(strand: Strand) {
    let n = strand.particles;
    let first = max(min(frame.clamped, n), 1u) - 1u;
    // One edge at least has a free end.
    if first + 1u >= n {
        return;
    }
    for (var i = first + 1u; i < n; i++) {
        set_scratch_vector(strand, i, 5u, position_at(strand, i));
    }
    restore(strand, first);
    let stretch = bitcast<u32>(largest_stretch(strand));
    if is_greatest(stretch) && stretch > atomicLoad(&report.restored) {
        atomicMax(&report.restored, stretch);
    }
}

@compute @workgroup_size(WORKGROUP)
fn restore_lengths(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if strand.here {
        restore_strand(strand);
    }
}

// Runs the pass again if contacts moved strands.
@compute @workgroup_size(WORKGROUP)
fn restore_again(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if strand.here && atomicLoad(&report.contacts) > 0u {
        restore_strand(strand);
    }
}
