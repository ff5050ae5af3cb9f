// Friction between neighbouring hair, GROUP lanes per thread: the GPU counterpart of
// `contact::hold_hair`.

// The change of a particle's displacement by friction; zero if it is not held.
fn change_of(number: u32) -> vec3f {
    let start = start_of(number);
    let end = end_of(number);
    if !(in_box(start) && in_box(end)) {
        return vec3f();
    }
    let residual = residual_displacement(start, end);
    let size = length(residual);
    return select(vec3f(), -min(contacts.hold / max(size, 1e-30), 1.0) * residual, is_finite(size));
}

// The particles of a group that are held.
struct Group {
    changes: array<vec3f, GROUP>,
    // The sum of their changes, and their number.
    sum: vec4f,
    // The mean of their places in the middle of the frame.
    middle: vec3f,
}

fn group_of(strand: Strand, i: u32) -> Group {
    var group = Group();
    let first = number_of(strand, i);
    let last = min(blocks[strand.block].live - strand.lane, GROUP) - 1u;
    for (var k = 0u; k < GROUP; k++) {
        let number = first + min(k, last);
        let change = change_of(number);
        if k <= last && any(change != vec3f()) {
            group.changes[k] = change;
            group.sum += vec4f(change, 1.0);
            group.middle += 0.5 * (start_of(number) + end_of(number));
        }
    }
    group.middle /= max(group.sum.w, 1.0);
    return group;
}

// Sums the changes at the nodes around each group.
@compute @workgroup_size(WORKGROUP)
fn sum_changes(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || strand.lane % GROUP != 0u {
        return;
    }
    let unit = MEAN_MOTION_UNIT / side_of_box();
    for (var i = contacts.clamped; i < strand.particles; i++) {
        let group = group_of(strand, i);
        if group.sum.w == 0.0 {
            continue;
        }
        let own = corner_at(group.middle);
        for (var corner = 0u; corner < 8u; corner++) {
            let w = corner_weight(own.f, corner);
            let share = vec4i(round(w * vec4f(group.sum.xyz * unit, group.sum.w * MEAN_MOTION_UNIT)));
            add_wide(8u * node_of(own.first, corner), share);
        }
    }
}

// Writes the changes, from which the mean around each group is subtracted, in place of the end
// positions.
@compute @workgroup_size(WORKGROUP)
fn balance_changes(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || strand.lane % GROUP != 0u {
        return;
    }
    let side = side_of_box();
    for (var i = 0u; i < strand.particles; i++) {
        var group = Group();
        var mean = vec3f();
        if i >= contacts.clamped {
            group = group_of(strand, i);
        }
        if group.sum.w > 0.0 {
            let own = corner_at(group.middle);
            for (var corner = 0u; corner < 8u; corner++) {
                let node = 8u * node_of(own.first, corner);
                let sum = vec3f(wide(node), wide(node + 2u), wide(node + 4u));
                mean += corner_weight(own.f, corner) * (side / max(wide(node + 6u), 1.0)) * sum;
            }
        }
        for (var k = 0u; k < GROUP; k++) {
            let change = group.changes[k];
            let balanced = select(vec3f(), change - mean, any(change != vec3f()));
            set_work_vector(row_of(number_of(strand, i) + k, MOTION_ROWS, 0u), balanced);
        }
    }
}
