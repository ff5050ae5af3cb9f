// Collisions with a body that bends: the GPU counterpart of `resolve_solids::bending`.

// Whether no direction leads out: two parts of the body press into each other there.
fn leads_nowhere(gradient: vec3f) -> bool {
    return dot(gradient, gradient) < NOWHERE;
}

// The clearance of a particle that parts of the body hold: that of one which is being pushed out,
// so that its strand is not laid around the body. Where the skin touched it first in the substep
// there is no room any more, so it is not stopped there.
fn held(sigma: f32, particle: ptr<function, Particle>) -> f32 {
    (*particle).is_held = true;
    return min(sigma, -HELD * skin);
}

// Whether hair may be held between parts of a body.
fn may_hold() -> bool {
    if !MAY_BEND {
        return false;
    }
    var found = false;
    for (var number = 0u; number < query.count; number++) {
        found = found || is_bending(number);
    }
    return found;
}

// The clearance at `x` at the substep's end; below zero a depth.
fn clearance_at(x: vec3f) -> f32 {
    var clearance = FAR;
    for (var number = 0u; number < query.count; number++) {
        let sigma = sample_shape(number, local(query.solids[number].at_end, x), 1.0).w - query.thickness;
        clearance = min(clearance, sigma / select(1.0, lipschitz(number), sigma > 0.0));
    }
    return clearance;
}

// The distance from skin that bends at `x`.
fn distance_from_skin(x: vec3f) -> f32 {
    var least = FAR;
    for (var number = 0u; number < query.count; number++) {
        if is_bending(number) {
            least = min(least, sample_shape(number, local(query.solids[number].at_end, x), 1.0).w);
        }
    }
    return least;
}

// Displacement in the substep of the skin nearest to `x` relative to the body, in the world's axes.
fn displacement(number: u32, x: vec3f) -> Displacement {
    let map = query.solids[number].at_end;
    let bent = skin_displacement(number, local(map, x));
    let phases = query.solids[number].phases;
    return Displacement(bent.is_known, turned(map, bent.by * (phases.y - phases.x)));
}

// How far the distance from a solid falls at most in the frame, for a particle at `origin` at its
// start; 0 in later substeps and for a solid that does not bend.
fn fall(number: u32, origin: vec3f) -> f32 {
    if !is_bending(number) || query.solids[number].phases.x != 0.0 {
        return 0.0;
    }
    return max(fall_at(number, local(query.solids[number].at_start, origin)), 0.0);
}

// A lower bound of the clearance at `x` from a body that bends, from now until the frame's end.
fn clearance_at_end_of(number: u32, x: vec3f) -> f32 {
    return sample_end(number, local(query.solids[number].at_end, x)) - query.thickness;
}

// The clearance at `x` from bodies that bend at the frame's end, 0 inside.
fn clearance_at_end(x: vec3f) -> f32 {
    var clearance = FAR;
    for (var number = 0u; number < query.count; number++) {
        if is_bending(number) {
            clearance = min(clearance, max(clearance_at_end_of(number, x), 0.0) / lipschitz(number));
        }
    }
    return clearance;
}
