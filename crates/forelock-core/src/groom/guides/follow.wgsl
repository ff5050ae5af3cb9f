
fn followed(a: vec4f, b: vec4f) -> vec4f {
    return vec4f(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}

// The smallest rotation from one unit vector to another.
fn arc(a: vec3f, b: vec3f) -> vec4f {
    let cosine = dot(a, b);
    if cosine < -0.999999 {
        let across = select(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), abs(a.x) > 0.7);
        return vec4f(normalize(cross(a, across)), 0.0);
    }
    return normalize(vec4f(cross(a, b), 1.0 + cosine));
}

// The rotation `turn`, followed by the smallest rotation from the rotated `rest` to `now`.
fn turned_to(turn: vec4f, rest: vec3f, now: vec3f) -> vec4f {
    if dot(rest, rest) == 0.0 || dot(now, now) == 0.0 {
        return turn;
    }
    return normalize(followed(arc(normalize(rotated(turn, rest)), normalize(now)), turn));
}

fn set_motion(strand: Strand, i: u32, turn: vec4f) {
    let at = 2u * entry(strand, i, 1u, 0u);
    motions[at] = turn;
    motions[at + 1u] = vec4f(position_at(strand, i) - rotated(turn, rest_at(strand, i)), 0.0);
}

// Computes the motion of each particle of a guide; one thread for each guide.
@compute @workgroup_size(WORKGROUP)
fn follow_guides(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    // The root moves with the head, and so does the hair around it.
    set_motion(strand, 0u, skin.head);
    var before = skin.head;
    for (var i = 0u; i < strand.particles; i++) {
        var after = before;
        if i + 1u < strand.particles {
            let rest = rest_at(strand, i + 1u) - rest_at(strand, i);
            after = turned_to(before, rest, position_at(strand, i + 1u) - position_at(strand, i));
        }
        if i > 0u {
            set_motion(strand, i, normalize(before + after));
        }
        before = after;
    }
}
