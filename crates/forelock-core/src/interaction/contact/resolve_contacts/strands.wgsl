// Resolution of contacts, strand by strand, one per thread: the GPU counterpart of
// `resolve_contacts::spread`. Only strands with joints take part.

// Minimum length over which the joints bend the strand, metres; 0 without joints.
fn bend_of(strand: Strand) -> f32 {
    return bitcast<f32>(atomicLoad(&table[bend_at(blocks[strand.block].number * LANES + strand.lane)]));
}

// Sums over the joints of particle `i`: displacement, impulse and weight.
struct Sum {
    moves: vec3f,
    impulses: vec3f,
    weight: f32,
}

fn sum_of(strand: Strand, i: u32) -> Sum {
    var sum = Sum();
    // The segment that starts at the particle, and the one that ends at it.
    for (var upper = 0u; upper < 2u; upper++) {
        if i < upper {
            break;
        }
        let segment = number_of(strand, i - upper);
        let list = list_of(segment);
        // Later ones are not kept.
        for (var k = list.x; k < list.x + min(list.y, contacts.per_segment); k++) {
            let side = work[sorted_at(k)];
            let joint = side / 2u;
            if work[field_at(joint, KEPT)] == 0u {
                continue;
            }
            let along = field_of(joint, ALONG + side % 2u);
            let size = select(1.0 - along, along, upper == 1u);
            let weight = select(size, -size, side % 2u == 1u);
            sum.moves += weight * field_vector(joint, JOINT_MOVES);
            sum.impulses += weight * field_vector(joint, JOINT_IMPULSES);
            sum.weight += size;
        }
    }
    return sum;
}

// Factorises the matrix of the strand, and applies S to the shares.
@compute @workgroup_size(WORKGROUP)
fn prepare_strands(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let bend = bend_of(strand);
    if bend == 0.0 {
        return;
    }
    let reach = max(bend, contacts.spread);
    // Of the previous particle: α, inverse pivot, share.
    var before = vec3f();
    // The pivot without α to the next particle: a sum of positive terms, which avoids the
    // cancellation in the pivot.
    var own = 0.0;
    for (var i = 0u; i < strand.particles; i++) {
        let number = number_of(strand, i);
        var ratio = 0.0;
        if i + 1u < strand.particles {
            ratio = reach / rest_length(strand, i, 1u);
        }
        let alpha = ratio * ratio;
        var now = vec3f(alpha, 0.0, 0.0);
        if i >= contacts.clamped {
            let held = select(1.0, own * before.y, before.y > 0.0);
            own = 1.0 + before.x * held;
            now.y = 1.0 / (own + alpha);
            now.z = sum_of(strand, i).weight + before.x * before.y * before.z;
        }
        set_real(body_at(number, ALPHA), alpha);
        set_real(body_at(number, PIVOT), now.y);
        set_real(body_at(number, SHARE), now.z);
        let velocity = (contacts.from_end * vec4f(velocity_at(strand, i), 0.0)).xyz;
        set_work_vector(body_at(number, PLACE), work_vector(row_of(number, MOTION_ROWS, 0u)));
        set_work_vector(body_at(number, VELOCITY), velocity);
        before = now;
    }
    var next = 0.0;
    for (var k = 0u; k < strand.particles; k++) {
        let number = number_of(strand, strand.particles - 1u - k);
        let at = body_at(number, SHARE);
        next = (real(at) + real(body_at(number, ALPHA)) * next) * real(body_at(number, PIVOT));
        set_real(at, next);
    }
}

// Moves the strand by S of the sums over its joints.
@compute @workgroup_size(WORKGROUP)
fn gather_moves(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || touch.done != 0u || bend_of(strand) == 0.0 {
        return;
    }
    var share = 0.0;
    var moves = vec3f();
    var impulses = vec3f();
    for (var i = 0u; i < strand.particles; i++) {
        let number = number_of(strand, i);
        let sum = sum_of(strand, i);
        moves = sum.moves + share * moves;
        impulses = sum.impulses + share * impulses;
        set_work_vector(body_at(number, MOVES), moves);
        set_work_vector(body_at(number, IMPULSES), impulses);
        share = real(body_at(number, ALPHA)) * real(body_at(number, PIVOT));
    }
    moves = vec3f();
    impulses = vec3f();
    for (var k = 0u; k < strand.particles; k++) {
        let number = number_of(strand, strand.particles - 1u - k);
        let alpha = real(body_at(number, ALPHA));
        let pivot = real(body_at(number, PIVOT));
        moves = (work_vector(body_at(number, MOVES)) + alpha * moves) * pivot;
        impulses = (work_vector(body_at(number, IMPULSES)) + alpha * impulses) * pivot;
        let place = body_at(number, PLACE);
        set_work_vector(place, work_vector(place) + moves);
        let velocity = body_at(number, VELOCITY);
        set_work_vector(velocity, work_vector(velocity) + impulses);
    }
}

// Applies the result to positions and velocities.
@compute @workgroup_size(WORKGROUP)
fn apply_moves(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || bend_of(strand) == 0.0 {
        return;
    }
    var farthest = 0.0;
    for (var i = contacts.clamped; i < strand.particles; i++) {
        let number = number_of(strand, i);
        let x = position_at(strand, i);
        let v = velocity_at(strand, i);
        let moved = work_vector(body_at(number, PLACE)) - work_vector(row_of(number, MOTION_ROWS, 0u));
        let changed = work_vector(body_at(number, VELOCITY)) - (contacts.from_end * vec4f(v, 0.0)).xyz;
        if !(all_finite(moved) && all_finite(changed)) {
            continue;
        }
        set_position(strand, i, x + (vec4f(moved, 0.0) * contacts.from_end).xyz);
        set_velocity(strand, i, v + (vec4f(changed, 0.0) * contacts.from_end).xyz);
        let distance = length(moved);
        farthest = max(farthest, distance);
        let at = entry(strand, i, 2u, 1u);
        if memory[at] >= 0.0 {
            memory[at] = max(memory[at] - distance, 0.0);
        }
    }
    if bitcast<u32>(farthest) > atomicLoad(&touch.farthest) {
        atomicMax(&touch.farthest, bitcast<u32>(farthest));
    }
}
