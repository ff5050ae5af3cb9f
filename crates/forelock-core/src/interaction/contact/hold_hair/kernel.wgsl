// Friction between neighbouring hair, GROUP lanes per thread: the GPU counterpart of
// `contact::hold_hair`.

// Neighbouring lanes of a place.
struct Group {
    // Bits of the lanes that are held.
    held: u32,
    // The middle of their particles, halfway through the frame.
    middle: vec3f,
}

fn middle_of(number: u32) -> vec3f {
    return 0.5 * (start_of(number) + end_of(number));
}

fn is_held(group: Group, k: u32) -> bool {
    return ((group.held >> k) & 1u) != 0u;
}

// The group of the lanes from that of the strand on, at its particle `i`.
fn group_of(strand: Strand, i: u32) -> Group {
    var group = Group();
    let first = number_of(strand, i);
    let count = min(blocks[strand.block].live - strand.lane, GROUP);
    for (var k = 0u; k < count; k++) {
        if in_box(start_of(first + k)) && in_box(end_of(first + k)) {
            group.held |= 1u << k;
            group.middle += middle_of(first + k);
        }
    }
    group.middle /= max(f32(countOneBits(group.held)), 1.0);
    for (var k = 0u; k < count; k++) {
        let away = middle_of(first + k) - group.middle;
        if is_held(group, k) && dot(away, away) >= FRICTION_SPACING * FRICTION_SPACING {
            group.held &= ~(1u << k);
        }
    }
    return group;
}

// The change of a particle that is held, given the mean motion of its group.
fn change_of(number: u32, mean: vec3f) -> vec3f {
    let residual = end_of(number) - start_of(number) - mean;
    return -min(contacts.hold / max(length(residual), 1e-30), 1.0) * residual;
}

// Distributes a sum over the particles of a group to the nodes around it.
fn add_to_nodes(group: Group, sum: vec3f) {
    let unit = MEAN_MOTION_UNIT / side_of_box();
    let count = f32(countOneBits(group.held));
    let own = corner_at(group.middle);
    for (var corner = 0u; corner < 8u; corner++) {
        let w = corner_weight(own.f, corner);
        let share = vec4i(round(w * vec4f(sum * unit, count * MEAN_MOTION_UNIT)));
        add_wide(8u * node_of(own.first, corner), share);
    }
}

// Sums the displacements at the nodes around each group.
@compute @workgroup_size(WORKGROUP)
fn sum_motion(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || strand.lane % GROUP != 0u {
        return;
    }
    for (var i = contacts.clamped; i < strand.particles; i++) {
        let group = group_of(strand, i);
        if group.held == 0u {
            continue;
        }
        var sum = vec3f();
        for (var k = 0u; k < GROUP; k++) {
            if is_held(group, k) {
                let number = number_of(strand, i) + k;
                sum += end_of(number) - start_of(number);
            }
        }
        add_to_nodes(group, sum);
    }
}

// Sums the changes at the nodes around each group.
@compute @workgroup_size(WORKGROUP)
fn sum_changes(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || strand.lane % GROUP != 0u {
        return;
    }
    for (var i = contacts.clamped; i < strand.particles; i++) {
        let group = group_of(strand, i);
        if group.held == 0u {
            continue;
        }
        let mean = mean_motion_at(group.middle);
        var sum = vec3f();
        for (var k = 0u; k < GROUP; k++) {
            if is_held(group, k) {
                sum += change_of(number_of(strand, i) + k, mean);
            }
        }
        add_to_nodes(group, sum);
    }
}

// The mean at a point, from the sums at the nodes.
fn mean_of_sums_at(at: vec3f) -> vec3f {
    let own = corner_at(at);
    var mean = vec3f();
    for (var corner = 0u; corner < 8u; corner++) {
        mean += corner_weight(own.f, corner) * mean_of_sums(node_of(own.first, corner));
    }
    return mean;
}

// Writes the changes, from which their mean at each group is subtracted, in place of the end
// positions.
@compute @workgroup_size(WORKGROUP)
fn balance_changes(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || strand.lane % GROUP != 0u {
        return;
    }
    for (var i = contacts.clamped; i < strand.particles; i++) {
        let group = group_of(strand, i);
        var motion = vec3f();
        var mean_change = vec3f();
        if group.held != 0u {
            motion = mean_motion_at(group.middle);
            mean_change = mean_of_sums_at(group.middle);
        }
        for (var k = 0u; k < GROUP; k++) {
            let number = number_of(strand, i) + k;
            var balanced = vec3f();
            if is_held(group, k) {
                balanced = change_of(number, motion) - mean_change;
            }
            set_work_vector(row_of(number, MOTION_ROWS, 0u), balanced);
        }
    }
}
