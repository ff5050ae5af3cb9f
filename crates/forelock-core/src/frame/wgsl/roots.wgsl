// Where the rest shape of a strand is: the GPU counterpart of `frame::roots`. On a rigid head it
// moves with the head. With ROOT_FRAMES each strand has its own motion before that of the head, at
// the frame's start and end: the last ROOT_ROWS rows a block of the model.
//
// Quaternions are x, y, z, w.

// A strand's rotation relative to the head, and its change from the frame's start to its end.
struct StrandTurn {
    now: vec4f,
    change: vec4f,
}

// The Hamilton product.
fn product(a: vec4f, b: vec4f) -> vec4f {
    return vec4f(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}

fn conjugate(q: vec4f) -> vec4f {
    return vec4f(-q.xyz, q.w);
}

// `v` rotated by the unit quaternion `q`.
fn rotate(q: vec4f, v: vec3f) -> vec3f {
    let twice = 2.0 * cross(q.xyz, v);
    return v + q.w * twice + cross(q.xyz, twice);
}

fn root_number(strand: Strand, row: u32) -> f32 {
    let first = arrayLength(&model) - ROOT_ROWS * LANES * arrayLength(&blocks);
    return model[first + (ROOT_ROWS * strand.block + row) * LANES + strand.lane];
}

fn root_vector(strand: Strand, row: u32) -> vec3f {
    return vec3f(root_number(strand, row), root_number(strand, row + 1u), root_number(strand, row + 2u));
}

// That at the `share` of a frame: `StrandTurn::load`.
fn strand_turn(strand: Strand, share: f32) -> StrandTurn {
    let at_start = vec4f(root_vector(strand, 0u), root_number(strand, 3u));
    let at_end = vec4f(root_vector(strand, 7u), root_number(strand, 10u));
    let change = at_end - at_start;
    let now = at_start + share * change;
    return StrandTurn(now * (1.0 / sqrt(dot(now, now))), change);
}

// Where a particle with the rest position `rest` is at rest at the `share` of a frame, at which the
// head is at `head`: `rest_motion`.
fn rest_position(strand: Strand, rest: vec3f, head: mat4x4f, share: f32) -> vec3f {
    if !has(ROOT_FRAMES) {
        return (head * vec4f(rest, 1.0)).xyz;
    }
    let turn = strand_turn(strand, share).now;
    let root = rest_at(strand, 0u);
    let at_start = root_vector(strand, 4u);
    let shift = (root + at_start + share * (root_vector(strand, 11u) - at_start)) - rotate(turn, root);
    return (head * vec4f(rotate(turn, rest) + shift, 1.0)).xyz;
}

fn rest_at_start(strand: Strand, rest: vec3f) -> vec3f {
    return rest_position(strand, rest, substep.start, substep.share_at_start);
}

fn rest_at_end(strand: Strand, rest: vec3f) -> vec3f {
    return rest_position(strand, rest, substep.end, substep.share_at_end);
}

// `v`, which turns with the rest shape, at the substep's end: `turned`.
fn turned_at_end(strand: Strand, v: vec3f) -> vec3f {
    if !has(ROOT_FRAMES) {
        return (substep.end * vec4f(v, 0.0)).xyz;
    }
    return (substep.end * vec4f(rotate(strand_turn(strand, substep.share_at_end).now, v), 0.0)).xyz;
}

// The rotation of a strand before that of the head, at the `share` of a frame, in the axes of the
// world, in which the head turns rest positions by `head`.
fn own_turn(strand: Strand, head: mat4x4f, share: f32) -> vec4f {
    if !has(ROOT_FRAMES) {
        return vec4f(0.0, 0.0, 0.0, 1.0);
    }
    let turn = strand_turn(strand, share).now;
    return vec4f((head * vec4f(turn.xyz, 0.0)).xyz, turn.w);
}

// The weight at rest, turned with the rest shape.
fn carried_weight(strand: Strand) -> vec3f {
    if !has(ROOT_FRAMES) {
        return substep.carried_weight;
    }
    return rotate(own_turn(strand, substep.end, substep.share_at_end), substep.carried_weight);
}

// The rotation of the rest shape at the substep's end.
fn rest_rotation(strand: Strand) -> vec4f {
    if !has(ROOT_FRAMES) {
        return substep.rotation;
    }
    return product(substep.rotation, strand_turn(strand, substep.share_at_end).now);
}

// The angular velocity at which the rest shape turns in the substep: `spin`.
fn rest_spin(strand: Strand) -> vec3f {
    if !has(ROOT_FRAMES) {
        return substep.spin;
    }
    // From the change over the frame: differences over a substep would be noise.
    let turn = strand_turn(strand, substep.share_at_end);
    let relative = product(turn.change, conjugate(turn.now)).xyz * (2.0 * frame.inverse_dt);
    return substep.spin + (substep.end * vec4f(relative, 0.0)).xyz;
}
