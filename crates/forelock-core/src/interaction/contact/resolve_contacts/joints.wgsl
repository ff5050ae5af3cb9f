// Resolution of contacts, joint by joint: the GPU counterpart of `resolve_contacts`. The result of
// a joint depends only on the joint and its bodies.

// Reserves a list for each segment.
@compute @workgroup_size(CELLS_GROUP)
fn reserve_lists(@builtin(global_invocation_id) id: vec3u) {
    if joint_count() == 0u {
        return;
    }
    for (var segment = id.x; segment < contacts.numbers; segment += LIST_THREADS) {
        let count = atomicLoad(&table[count_at(segment)]);
        if count > 0u {
            atomicStore(&table[cursor_at(segment)], atomicAdd(&touch.taken, count));
        }
    }
}

@compute @workgroup_size(CELLS_GROUP)
fn link_joints(@builtin(global_invocation_id) id: vec3u) {
    for (var joint = id.x; joint < joint_count(); joint += LIST_THREADS) {
        for (var side = 0u; side < 2u; side++) {
            let segment = work[field_at(joint, SEGMENTS + side)];
            let at = side_at(atomicAdd(&table[cursor_at(segment)], 1u));
            // Times are positive, so their bits have the same order.
            work[at] = work[field_at(joint, WHEN)];
            work[at + 1u] = work[field_at(joint, SEGMENTS + 1u - side)];
            work[at + 2u] = 2u * joint + side;
        }
    }
}

// Sorts the lists by time, and marks the joints that are among the first of both of their segments.
@compute @workgroup_size(CELLS_GROUP)
fn order_joints(@builtin(global_invocation_id) id: vec3u) {
    for (var joint = id.x; joint < joint_count(); joint += LIST_THREADS) {
        let when = work[field_at(joint, WHEN)];
        var kept = true;
        for (var side = 0u; side < 2u; side++) {
            let segment = work[field_at(joint, SEGMENTS + side)];
            let other = work[field_at(joint, SEGMENTS + 1u - side)];
            let list = list_of(segment);
            var rank = 0u;
            for (var k = list.x; k < list.x + list.y; k++) {
                let at = side_at(k);
                let earlier = work[at] < when || work[at] == when && work[at + 1u] < other;
                rank += select(0u, 1u, earlier);
            }
            work[sorted_at(list.x + rank)] = 2u * joint + side;
            kept = kept && rank < contacts.per_segment;
        }
        work[field_at(joint, KEPT)] = select(0u, 1u, kept);
        for (var field = LAMBDA; field < KEPT; field++) {
            set_field(joint, field, 0.0);
        }
        if !kept {
            continue;
        }
        atomicAdd(&report.contacts, 1u);
        let bend = bitcast<u32>(BEND * field_of(joint, APPROACH));
        for (var side = 0u; side < 2u; side++) {
            let segment = work[field_at(joint, SEGMENTS + side)];
            atomicMax(&table[bend_at(owners[segment / LANES] * LANES + segment % LANES)], bend);
        }
    }
}

// Particle `corner` of a joint, and its weight in the difference of the two contact points.
struct Part {
    number: u32,
    weight: f32,
}

fn part_of(joint: u32, corner: u32) -> Part {
    let side = corner / 2u;
    let upper = corner % 2u;
    let along = field_of(joint, ALONG + side);
    let weight = select(1.0 - along, along, upper == 1u);
    let number = work[field_at(joint, SEGMENTS + side)] + upper * LANES;
    return Part(number, select(weight, -weight, side == 1u));
}

@compute @workgroup_size(CELLS_GROUP)
fn weight_joints(@builtin(global_invocation_id) id: vec3u) {
    for (var joint = id.x; joint < joint_count(); joint += LIST_THREADS) {
        if work[field_at(joint, KEPT)] == 0u {
            continue;
        }
        var w = 0.0;
        for (var corner = 0u; corner < 4u; corner++) {
            let part = part_of(joint, corner);
            w += abs(part.weight) * real(body_at(part.number, SHARE));
        }
        set_field(joint, INVERSE_W, select(0.0, 1.0 / max(w, 1e-6), w > 1e-6));
    }
}

@compute @workgroup_size(CELLS_GROUP)
fn relax_joints(@builtin(global_invocation_id) id: vec3u) {
    if touch.done != 0u {
        return;
    }
    var most = 0.0;
    for (var joint = id.x; joint < joint_count(); joint += LIST_THREADS) {
        if work[field_at(joint, KEPT)] == 0u {
            continue;
        }
        var apart = vec3f();
        var u = vec3f();
        for (var corner = 0u; corner < 4u; corner++) {
            let part = part_of(joint, corner);
            apart += part.weight * work_vector(body_at(part.number, PLACE));
            u += part.weight * work_vector(body_at(part.number, VELOCITY));
        }
        let normal = field_vector(joint, NORMAL);
        let inverse = field_of(joint, INVERSE_W);
        let lack = field_of(joint, GAP) - dot(normal, apart);
        let along = dot(normal, u);
        let lambda = max(field_of(joint, LAMBDA + 1u) + lack * inverse, 0.0);
        let normal_impulse = max(field_of(joint, NORMAL_IMPULSE + 1u) - along * inverse, 0.0);
        let tangent_before = field_vector(joint, TANGENT_IMPULSE + 3u);
        var tangent = tangent_before - (u - along * normal) * inverse;
        let size = length(tangent);
        let most_tangent = contacts.friction * normal_impulse;
        if size > most_tangent {
            tangent *= most_tangent / size;
        }
        let next_lambda = lambda + touch.momentum * (lambda - field_of(joint, LAMBDA));
        let next_normal_impulse = normal_impulse + touch.momentum * (normal_impulse - field_of(joint, NORMAL_IMPULSE));
        let next_tangent = tangent + touch.momentum * (tangent - field_vector(joint, TANGENT_IMPULSE));
        set_field_vector(joint, JOINT_MOVES, (next_lambda - field_of(joint, LAMBDA + 1u)) * normal);
        set_field_vector(joint, JOINT_IMPULSES, (next_normal_impulse - field_of(joint, NORMAL_IMPULSE + 1u)) * normal + (next_tangent - tangent_before));
        set_field(joint, LAMBDA, lambda);
        set_field(joint, LAMBDA + 1u, next_lambda);
        set_field(joint, NORMAL_IMPULSE, normal_impulse);
        set_field(joint, NORMAL_IMPULSE + 1u, next_normal_impulse);
        set_field_vector(joint, TANGENT_IMPULSE, tangent);
        set_field_vector(joint, TANGENT_IMPULSE + 3u, next_tangent);
        if inverse > 0.0 {
            most = max(most, max(lack, -along * contacts.dt));
        }
    }
    // A negative zero would compare as the larger integer.
    if most > 0.0 && bitcast<u32>(most) > atomicLoad(&touch.lack) {
        atomicMax(&touch.lack, bitcast<u32>(most));
    }
}

// Momentum of Nesterov's method; the last round has none, so its result is feasible.
@compute @workgroup_size(1)
fn check_round() {
    if touch.done != 0u {
        return;
    }
    let converged = bitcast<f32>(atomicExchange(&touch.lack, 0u)) < contacts.close;
    if touch.last != 0u {
        touch.done = 1u;
        return;
    }
    touch.round += 1u;
    let last = converged || touch.round + 1u == contacts.rounds;
    touch.last = select(0u, 1u, last);
    touch.momentum = select(f32(touch.round) / f32(touch.round + 3u), 0.0, last);
}
