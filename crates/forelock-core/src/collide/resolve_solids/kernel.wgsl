// Hair–solid collisions, one strand a thread: the GPU counterpart of `resolve_solids::resolve` and
// `resolve_solids::lay_along`.
//
// Scratch rows ORIGIN to ORIGIN + 2 of a particle hold where it came from (the length pass has
// written them where it came before), row MOVED how far it moved relative to the solids, and the
// rows from BEFORE_EDGES and from OLD_CURVE on positions in between.

// Whether velocities will be derived from positions.
fn friction_moves() -> bool {
    return (query.how & POSITIONAL) != 0u;
}

// Queries the solids at particle i, which came from `origin` since the query before and moved by
// `moved`, if its clearance `left` is used up. Returns whether it touches one.
fn resolve_particle(strand: Strand, i: u32, origin: vec3f, moved: f32, left: f32) -> bool {
    let last = clearance_of(strand, i);
    if left > 0.0 {
        set_clearance(strand, i, left);
        return false;
    }
    let found = query_solids(position_at(strand, i), velocity_at(strand, i), origin, moved, last);
    set_clearance(strand, i, found.clearance);
    if found.touches {
        set_position(strand, i, found.x);
        set_velocity(strand, i, found.v);
    }
    return found.touches;
}

// Clearance left after a displacement by `moved`; below zero it is a depth.
fn left_of(clearance: f32, moved: f32) -> f32 {
    return select(clearance - moved, clearance, clearance < 0.0);
}

// Whether a solid that is thinner than `moved` lies on the path between two points.
fn is_blocked(a: vec3f, b: vec3f, moved: f32) -> bool {
    skin = query.thickness;
    for (var number = 0u; number < query.count; number++) {
        if moved > query.solids[number].thinness
            && sweep(number, local(map_at_start(number), a), local(query.solids[number].at_end, b), 0u).found {
            return true;
        }
    }
    return false;
}

// Resolves the collisions of all particles; if `again`, of those that edges have moved. Returns
// whether one touches a solid.
fn resolve_particles(strand: Strand, again: bool) -> bool {
    let after_substep = (query.how & AFTER_SUBSTEP) != 0u;
    let displaced = (query.how & DISPLACED) != 0u;
    let began_at_rest = at_rest;
    var touched = false;
    for (var i = 0u; i < strand.particles; i++) {
        let x = position_at(strand, i);
        var origin = x;
        if again {
            origin = scratch_vector(strand, i, BEFORE_EDGES);
        } else if after_substep {
            origin = x - frame.h * velocity_at(strand, i);
        } else if displaced && i >= frame.clamped {
            origin = scratch_vector(strand, i, ORIGIN);
        }
        let last = clearance_of(strand, i);
        var left = vec2f(last, 0.0);
        if again || displaced {
            let moved = distance(x, origin);
            left = vec2f(left_of(last, moved), moved);
        } else if after_substep {
            left = clearance_left(x, origin, last);
        }
        if i < frame.clamped {
            left.y = 0.0;
        }
        if !again {
            set_scratch_vector(strand, i, ORIGIN, origin);
            set_scratch_number(entry(strand, i, SCRATCH, MOVED), left.y);
        }
        if i < frame.clamped {
            continue;
        }
        // One whose straight path since the query before is free is not swept.
        if again && !(left.x > 0.0) && !is_blocked(scratch_vector(strand, i, ORIGIN), x, left.y) {
            left.y = 0.0;
        }
        at_rest = again || began_at_rest;
        let touches = resolve_particle(strand, i, origin, left.y, left.x) && !again;
        at_rest = began_at_rest;
        touched = touched || touches;
        if !(left.x > 0.0) {
            report_contact(touches, -(clearance_of(strand, i) + query.thickness));
        }
    }
    return touched;
}

// The stretch that is compared before and after. Edges that springs may compress would hide those
// that solids stretch.
fn stretch_by_solids(strand: Strand) -> f32 {
    if has(LIMIT_LENGTHS) {
        return largest_extension(strand);
    }
    return largest_stretch(strand);
}

@compute @workgroup_size(WORKGROUP)
fn resolve_solids(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let condition = query.how & (IF_MOVED | UNLESS_MOVED);
    if condition != 0u && (condition == IF_MOVED) != (atomicLoad(&report.contacts) > 0u) {
        return;
    }
    at_rest = (query.how & AFTER_SUBSTEP) == 0u;
    let lays = query.stretch_limit < FAR;
    var before = 0.0;
    if lays && at_rest {
        before = stretch_by_solids(strand);
    }
    // One call of each function: compilers inline them.
    var touched = false;
    for (var round = 0u; round < 2u; round++) {
        touched = resolve_particles(strand, round == 1u) || touched;
        if round == 1u {
            take_back(strand);
        } else if !resolve_edges(strand) {
            break;
        } else {
            touched = true;
        }
    }
    if lays && touched {
        let stretch = stretch_by_solids(strand);
        if stretch > before && stretch > query.stretch_limit {
            at_rest = true;
            lay_along(strand);
        }
    }
}
