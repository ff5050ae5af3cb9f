// A particle against all solids: what kernels share that look at some. The twins of `resolve_solids::clearance_left` and of a particle's part in `Queue::settle`.

struct Particle {
    x: vec3f,
    v: vec3f,
    // Clearance at the last look.
    was: f32,
}

// Stops the approach to a solid at the particle, with Coulomb friction.
fn rub(number: u32, normal: vec3f, particle: ptr<function, Particle>, caught: bool) {
    let arm = (*particle).x - query.solids[number].pivot;
    var gone = query.solids[number].travel + cross(query.solids[number].spin, arm);
    if CHANGES && query.solids[number].swell > 0.0 {
        let place = local(query.solids[number].at_end, (*particle).x);
        gone += (sample_shape(number, place, 0.0).w - sample_shape(number, place, 1.0).w) * normal;
    }
    let own = gone * frame.inverse_h;
    let relative = (*particle).v - own;
    let approach = dot(relative, normal);
    if !(approach < 0.0) {
        return;
    }
    let along = relative - approach * normal;
    let speed = sqrt(dot(along, along));
    var kept = 0.0;
    if speed > 0.0 {
        kept = max(1.0 + query.solids[number].friction * approach / speed, 0.0);
    }
    (*particle).v = own + kept * along;
    // Where velocities follow from places, friction changes these too; what was stopped on its way has lost what was left of it.
    if DRAGS && !caught {
        (*particle).x -= frame.h * (1.0 - kept) * along;
    }
}

// One particle against one solid, of which `found` is the sample where it is; the distance to its skin that is left.
fn settle(number: u32, found: vec4f, particle: ptr<function, Particle>) -> f32 {
    var sigma = found.w - query.thickness;
    var gradient = found.xyz;
    if !(sigma < 0.0) {
        return sigma;
    }
    let map = query.solids[number].at_end;
    rub(number, turned(map, gradient), particle, false);
    let cell = query.solids[number].cell;
    let small_push = select(FAR, 0.1 * cell, cell > 0.0);
    for (var k = 1u; k <= LOOKS; k++) {
        var allowed = 0.0;
        if (*particle).was < 0.0 {
            allowed = min(max((*particle).was, sigma) + query.way_out, 0.0);
        }
        let push = allowed - sigma;
        if push <= 0.0 {
            return sigma;
        }
        (*particle).x += push * turned(map, gradient);
        if push < small_push || k == LOOKS {
            return allowed;
        }
        let there = sample_shape(number, local(map, (*particle).x), 1.0);
        sigma = there.w - query.thickness;
        gradient = there.xyz;
        if !(sigma < 0.0) {
            return sigma;
        }
    }
    return sigma;
}

// Takes a particle out of one solid after the other until it is in none; the clearance that is left.
fn settle_among(particle: ptr<function, Particle>) -> f32 {
    var clearance = FAR;
    for (var round = 0u; round <= ROUNDS; round++) {
        clearance = FAR;
        for (var number = 0u; number < query.count; number++) {
            let found = sample_shape(number, local(query.solids[number].at_end, (*particle).x), 1.0);
            let sigma = found.w - query.thickness;
            clearance = min(clearance, sigma / select(1.0, lipschitz(number), sigma > 0.0));
            // The last round only looks.
            if round < ROUNDS && sigma < 0.0 {
                let left = settle(number, found, particle);
            }
        }
        // Out to rounding.
        if clearance > -1e-6 {
            return max(clearance, 0.0);
        }
    }
    return clearance;
}

// How far the surface of a shape that changes may have moved since the last look.
fn swell_of(number: u32) -> f32 {
    return select(0.0, query.solids[number].swell, CHANGES && (query.how & AFTER_SUBSTEP) != 0u);
}

// Where a particle that goes straight through the solid's own space first touches it, and the normal there: `sweep::sweep`.
struct Touch {
    found: bool,
    place: vec3f,
    normal: vec3f,
}

fn sweep(number: u32, start: vec3f, end: vec3f) -> Touch {
    let none = Touch(false, vec3f(), vec3f());
    let touch = TOUCH * query.solids[number].thinness;
    let go = end - start;
    let changes = swell_of(number);
    let fall = sqrt(dot(go, go)) * lipschitz(number) + changes;
    if !(fall > 0.0) {
        return none;
    }
    var share = 0.0;
    for (var k = 0u; k < SWEEP_STEPS; k++) {
        let point = start + share * go;
        let found = sample_shape(number, point, select(1.0, share, changes > 0.0));
        let sigma = found.w - query.thickness;
        if sigma <= touch && (dot(found.xyz, go) < 0.0 || changes > 0.0) {
            return Touch(true, point + max(-sigma, 0.0) * found.xyz, found.xyz);
        }
        share += max(sigma, touch) / fall;
        if !(share < 1.0) {
            return none;
        }
    }
    return none;
}

// Stops a particle at the surface that it went through on its way from `origin`; whether it did.
fn catch_on_way(number: u32, found: vec4f, origin: vec3f, particle: ptr<function, Particle>) -> bool {
    // What was inside at the last look is on its way out.
    if (*particle).was < 0.0 {
        return false;
    }
    let map = query.solids[number].at_end;
    let start = local(query.solids[number].at_start, origin);
    let end = local(map, (*particle).x);
    if distance(start, end) + swell_of(number) <= query.solids[number].thinness {
        return false;
    }
    let touch = sweep(number, start, end);
    if !touch.found || (found.w < query.thickness && dot(found.xyz, touch.normal) > 0.5) {
        return false;
    }
    (*particle).x = turned(map, touch.place - map[3].xyz);
    rub(number, turned(map, touch.normal), particle, true);
    return true;
}

// What is left of the clearance of a particle that went from `origin` to `x` in a substep and was `last` from the nearest solid, and how far it moved relative to the one that moved most against it.
fn clearance_left(x: vec3f, origin: vec3f, last: f32) -> vec2f {
    var left = FAR;
    var moved = 0.0;
    for (var number = 0u; number < query.count; number++) {
        let by = distance(x, local(query.solids[number].carry, origin)) + query.solids[number].swell;
        var far = last;
        if query.count > 1u {
            // What moves far off costs nothing.
            far = max(last, distance(x, query.solids[number].ball) - query.solids[number].ball_radius - query.thickness);
        }
        left = min(left, far - by);
        moved = max(moved, by);
    }
    return vec2f(left, moved);
}

// What a look at all solids does to a particle.
struct Met {
    x: vec3f,
    v: vec3f,
    clearance: f32,
    touches: bool,
}

// Looks at a particle that came from `origin`, `moved` relative to the solid that moved most against it, and was `last` from the nearest one.
fn meet_solids(x: vec3f, v: vec3f, origin: vec3f, moved: f32, last: f32) -> Met {
    var particle = Particle(x, v, last);
    var clearance = FAR;
    var touches = false;
    var between = false;
    for (var number = 0u; number < query.count; number++) {
        let place = particle.x;
        let found = sample_shape(number, local(query.solids[number].at_end, place), 1.0);
        var own = Particle(place, particle.v, last);
        var sigma = 0.0;
        let caught = moved > query.solids[number].thinness && catch_on_way(number, found, origin, &own);
        if !caught {
            sigma = settle(number, found, &own);
        }
        if caught || found.w < query.thickness {
            touches = true;
            between = between || clearance < distance(own.x, place);
            particle.x = own.x;
            particle.v = own.v;
        }
        clearance = min(clearance, sigma / select(1.0, lipschitz(number), sigma > 0.0));
    }
    // What was inside at the last look comes out by and by.
    if between && last >= 0.0 {
        particle.was = 0.0;
        clearance = settle_among(&particle);
    }
    return Met(particle.x, particle.v, clearance, touches);
}

// Tells that particles touch, and how deep they are left, where it is the frame's last look.
fn tell_touch(touches: bool, depth: f32) {
    if (query.how & LAST) == 0u {
        return;
    }
    if touches {
        atomicAdd(&report.touching, 1u);
    }
    let deepest = select(0u, bitcast<u32>(depth), depth > 0.0);
    if is_greatest(deepest) && deepest > atomicLoad(&report.deepest) {
        atomicMax(&report.deepest, deepest);
    }
}
