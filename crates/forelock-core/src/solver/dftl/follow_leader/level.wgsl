// Dynamic follow the leader with preserved shape, level by level. The kernels of all schedules
// share this text, the GPU counterpart of `follow_leader::advance`.
//
// There are three schedules. Fused: a thread steps its strand from root to tip, holds frames in
// registers, and reads and writes the state once. Strands: a kernel predicts all particles, then a
// thread steps its strand. Particles: after the prediction, one dispatch per level; between two
// dispatches normals are stored in the rows of the velocities.
//
// For this solver rows 4 to 6 of the model hold rest edges, in the frame of the particle before
// each edge, and for a root the normal of its frame. They replace the rest lengths to the second
// and third next particle and the inverse rest length. The array of velocities is followed by the
// positions of the step before.

// State that a level passes to the next.
struct Carried {
    // The particle before: its position now and at the step's start.
    leader: vec3f,
    leader_was: vec3f,
    // Its frame.
    tangent: vec3f,
    normal: vec3f,
}

fn local_at(strand: Strand, i: u32) -> vec3f {
    let at = entry(strand, i, MODEL_ROWS, 4u);
    return vec3f(model[at], model[at + LANES], model[at + 2u * LANES]);
}

// The frame turned to the next edge's direction: the normal.
fn turned_normal(tangent: vec3f, normal: vec3f, next: vec3f) -> vec3f {
    let s = tangent + next;
    let share = dot(normal, s) / max(dot(s, s), 1e-24);
    return normal - (share + share) * s;
}

fn direction_of(edge: vec3f) -> vec3f {
    return edge / sqrt(max(dot(edge, edge), 1e-24));
}

fn ghost_at(strand: Strand, i: u32) -> vec3f {
    return rest_at_end(strand, rest_at(strand, i));
}

// Places the root.
fn begin_strand(strand: Strand) -> Carried {
    let first = rest_at(strand, 0u);
    let along = direction_of(rest_at(strand, 1u) - first);
    let leader = rest_at_end(strand, first);
    return Carried(
        leader,
        position_at(strand, 0u) + substep.shift,
        turned_at_end(strand, along),
        turned_at_end(strand, local_at(strand, 0u)),
    );
}

// Eq. 1: the position of particle i without constraints.
fn predicted_at(strand: Strand, i: u32, was: vec3f) -> vec3f {
    var a = frame.gravity;
    if has(SAG_FREE) {
        a -= carried_weight(strand);
    }
    var kick = frame.h * a;
    // A wind field has changed velocities already (`apply_wind`).
    if frame.drag > 0.0 && !has(WIND) {
        let u = (was - previous_at(strand, i) - substep.shift) * frame.inverse_h;
        kick += min(frame.drag / mass_at(strand, i), 1.0) * (frame.air - u);
    }
    return was + frame.h * (velocity_at(strand, i) + kick);
}

// Shares by which the global and the local shape of particle i are restored in this step.
fn shape_shares(strand: Strand, i: u32) -> vec2f {
    let fraction = f32(i) / f32(strand.particles - 1u);
    let tips = 1.0 + (vec2f(frame.tip_global, frame.tip_local) - 1.0) * fraction;
    return min(vec2f(frame.shape_global, frame.shape_local) * tips * strand_stiffness(strand), vec2f(1.0));
}

// Eqs. 11 to 14: places particle i, which was at `was` and is predicted at `predicted`, and
// completes the step of the particle before it.
fn follow_level(strand: Strand, i: u32, was: vec3f, predicted: vec3f, carried: Carried) -> Carried {
    let ghost = ghost_at(strand, i);
    let length = rest_length(strand, i - 1u, 1u);
    let leader = carried.leader;
    var x = ghost;
    var direction = direction_of(ghost - leader);
    var correction = vec3f(0.0);
    if i >= frame.clamped {
        let shares = shape_shares(strand, i);
        x = predicted + shares.x * (ghost - predicted);
        let edge = local_at(strand, i);
        let binormal = cross(carried.tangent, carried.normal);
        let bound = leader + edge.x * carried.tangent + edge.y * carried.normal + edge.z * binormal;
        x += shares.y * (bound - x);
        direction = direction_of(x - leader);
        x = leader + length * direction;
        correction = x - predicted;
        if has(LEVEL_SOLIDS) && query.count > 0u {
            let resolved = level_solids(strand, i, was, x, leader, length);
            if any(resolved.xyz != x) {
                direction = direction_of(resolved.xyz - leader);
                x = resolved.xyz;
            }
        }
    }
    end_particle(strand, i - 1u, carried, correction);
    set_position(strand, i, x);
    return Carried(x, was, direction, turned_normal(carried.tangent, carried.normal, direction));
}

// Velocities are derived from positions.
fn friction_moves() -> bool {
    return true;
}

// Resolves the collisions of particle i, which moves from `was` to `start`. With rechecks the
// length is restored last.
fn level_solids(strand: Strand, i: u32, was: vec3f, start: vec3f, leader: vec3f, length: f32) -> vec4f {
    let at = entry(strand, i, 2u, 1u);
    let last = memory[at];
    let left = clearance_left(start, was, last);
    if left.x > 0.0 {
        memory[at] = left.x;
        return vec4f(start, 0.0);
    }
    var found = query_solids(start, (start - was) * frame.inverse_h, was, left.y, last);
    var x = select(start, found.x, found.touches);
    var v = found.v;
    var clearance = found.clearance;
    var depth = -(clearance + query.thickness);
    if any(x != start) && frame.recheck > 0u {
        for (var round = 0u; round <= frame.recheck; round++) {
            let back = leader + length * direction_of(x - leader);
            let moved = distance(back, x);
            depth = max(depth, moved - clearance - query.thickness);
            // Below zero it is a depth, not a distance.
            clearance = select(clearance, max(clearance - moved, 0.0), clearance >= 0.0);
            x = back;
            if round < frame.recheck && clearance <= 0.0 {
                let again = query_solids(x, v, x, 0.0, clearance);
                clearance = again.clearance;
                depth = max(depth, -(clearance + query.thickness));
                if again.touches {
                    x = again.x;
                    v = again.v;
                }
            }
        }
    }
    memory[at] = clearance;
    report_contact(found.touches, depth);
    return vec4f(x, 0.0);
}

// Eq. 14: the velocity of a particle that has been placed, with the correction of the particle
// after it.
fn end_particle(strand: Strand, i: u32, carried: Carried, correction: vec3f) {
    let v = (carried.leader - carried.leader_was) * frame.inverse_h;
    set_velocity(strand, i, v - frame.length_damping * frame.inverse_h * correction);
    set_previous(strand, i, carried.leader_was);
}
