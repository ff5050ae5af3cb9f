// Hair–solid collisions, one strand a thread: the GPU counterpart of `resolve_solids::resolve` and
// `resolve_solids::lay_along`.

// Queries the solids at particle i if its clearance is used up. Returns whether it touches one.
fn resolve_particle(strand: Strand, i: u32) -> bool {
    let at = entry(strand, i, 2u, 1u);
    let last = memory[at];
    let x = position_at(strand, i);
    let v = velocity_at(strand, i);
    var origin = x;
    var left = vec2f(last, 0.0);
    if (query.how & AFTER_SUBSTEP) != 0u {
        origin = x - frame.h * v;
        left = clearance_left(x, origin, last);
    }
    if left.x > 0.0 {
        memory[at] = left.x;
        return false;
    }
    let found = query_solids(x, v, origin, left.y, last);
    memory[at] = found.clearance;
    if found.touches {
        set_position(strand, i, found.x);
        set_velocity(strand, i, found.v);
    }
    report_contact(found.touches, -(found.clearance + query.thickness));
    return found.touches;
}

// Searches for a point near `start`, at distance `length` from `leader`, that is outside a solid.
// Returns the point and its clearance. If none is found, the point is on the surface at another
// distance.
fn slide_along(number: u32, leader: vec3f, start: vec3f, length: f32) -> vec4f {
    let map = query.solids[number].at_end;
    var x = start;
    for (var round = 0u; round <= SLIDE_STEPS; round++) {
        let found = sample_shape(number, local(map, x), 1.0);
        let sigma = found.w - query.thickness;
        if !(sigma < 0.0) {
            return vec4f(x, sigma / lipschitz(number));
        }
        let out = x - sigma * turned(map, found.xyz);
        if round == SLIDE_STEPS {
            // No point was found: the collision takes precedence over the length.
            return vec4f(out, 0.0);
        }
        let edge = out - leader;
        x = leader + edge * (length / max(sqrt(dot(edge, edge)), 1e-37));
    }
    return vec4f(x, 0.0);
}

// Searches for a point that is outside all solids, in the same way. The clearance is 0 if the point
// may be inside a solid.
fn slide(leader: vec3f, start: vec3f, length: f32) -> vec4f {
    var x = start;
    // The projection out of one solid can end inside another. It is repeated if it moved the point
    // farther than the clearance from the solids before.
    for (var round = 0u; round < 3u; round++) {
        var clearance = FAR;
        var repeats = false;
        for (var number = 0u; number < query.count; number++) {
            let found = slide_along(number, leader, x, length);
            repeats = repeats || clearance < distance(found.xyz, x);
            x = found.xyz;
            clearance = min(clearance, found.w);
        }
        if !repeats {
            return vec4f(x, clearance);
        }
    }
    return vec4f(x, 0.0);
}

// Restores the lengths of edges that collisions stretched, from root to tip. A particle whose new
// position is inside a solid is moved to the surface.
fn lay_along(strand: Strand) {
    for (var i = max(frame.clamped, 1u); i < strand.particles; i++) {
        let leader = position_at(strand, i - 1u);
        let old = position_at(strand, i);
        let length = rest_length(strand, i - 1u, 1u);
        let d = old - leader;
        var x = leader + d * (length / sqrt(max(dot(d, d), 1e-24)));
        let at = entry(strand, i, 2u, 1u);
        let clearance = memory[at];
        let left = clearance - distance(old, x);
        if left > 0.0 {
            memory[at] = left;
        } else if clearance >= 0.0 {
            let found = slide(leader, x, length);
            x = found.xyz;
            memory[at] = found.w;
        }
        set_position(strand, i, x);
        let edge = unit(x - leader).xyz;
        let v = velocity_at(strand, i);
        set_velocity(strand, i, v - dot(edge, v - velocity_at(strand, i - 1u)) * edge);
    }
}

@compute @workgroup_size(WORKGROUP)
fn resolve_solids(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let lays = query.how == LAST && has(LAY_ALONG);
    var before = 0.0;
    if lays {
        before = largest_stretch(strand);
    }
    var touched = false;
    for (var i = min(frame.clamped, strand.particles); i < strand.particles; i++) {
        let touches = resolve_particle(strand, i);
        touched = touched || touches;
    }
    if lays && touched {
        let stretch = largest_stretch(strand);
        if stretch > before && stretch > STRETCHED {
            lay_along(strand);
        }
    }
}
