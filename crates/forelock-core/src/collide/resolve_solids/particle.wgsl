// The query of all solids at one particle, shared by several kernels: the GPU counterpart of
// `resolve_solids::clearance_left` and of a particle's part in `Queue::resolve_packet`.

struct Particle {
    x: vec3f,
    v: vec3f,
    // Clearance after the last query.
    last_clearance: f32,
}

// Distance kept from surfaces: of particles, or of edges.
var<private> skin: f32;
// Whether solids are at rest at the substep's end during the displacements; otherwise these began
// at the substep's start.
var<private> at_rest: bool = false;

// Removes the velocity at which the particle approaches the solid, and applies Coulomb friction.
fn apply_friction(number: u32, normal: vec3f, particle: ptr<function, Particle>, is_ccd_hit: bool) {
    let arm = (*particle).x - query.solids[number].pivot;
    var gone = query.solids[number].travel + cross(query.solids[number].spin, arm);
    if CHANGES && query.solids[number].swell > 0.0 {
        let place = local(query.solids[number].at_end, (*particle).x);
        gone += (sample_shape(number, place, 0.0).w - sample_shape(number, place, 1.0).w) * normal;
    }
    let solid_velocity = gone * frame.inverse_h;
    let relative = (*particle).v - solid_velocity;
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
    (*particle).v = solid_velocity + kept * along;
    // Where velocities are derived from positions, friction changes positions too. A particle
    // stopped on its path has no tangential displacement left to reduce.
    if friction_moves() && !is_ccd_hit {
        (*particle).x -= frame.h * (1.0 - kept) * along;
    }
}

// Pushes a particle out of one solid and applies friction; `found` is the sample at the particle.
// Returns the distance to the solid's skin that is left.
fn resolve_penetration(number: u32, found: vec4f, particle: ptr<function, Particle>) -> f32 {
    var sigma = found.w - skin;
    var gradient = found.xyz;
    if !(sigma < 0.0) {
        return sigma;
    }
    let map = query.solids[number].at_end;
    apply_friction(number, turned(map, gradient), particle, false);
    let cell = query.solids[number].cell;
    let small_push = select(FAR, 0.1 * cell, cell > 0.0);
    for (var k = 0u; k < MAX_PUSHES; k++) {
        var allowed = 0.0;
        if (*particle).last_clearance < 0.0 {
            allowed = min(max((*particle).last_clearance, sigma) + query.max_push_out, 0.0);
        }
        let push = allowed - sigma;
        if push <= 0.0 {
            return sigma;
        }
        (*particle).x += push * turned(map, gradient);
        if push < small_push {
            return allowed;
        }
        let there = sample_shape(number, local(map, (*particle).x), 1.0);
        sigma = there.w - skin;
        gradient = there.xyz;
        if !(sigma < 0.0) {
            return sigma;
        }
    }
    return sigma;
}

// Pushes a particle out of one solid after the other until it is outside all. Returns the clearance
// that is left.
fn resolve_penetrations(particle: ptr<function, Particle>) -> f32 {
    var clearance = FAR;
    for (var round = 0u; round <= PROJECTION_ROUNDS; round++) {
        clearance = FAR;
        for (var number = 0u; number < query.count; number++) {
            let found = sample_shape(number, local(query.solids[number].at_end, (*particle).x), 1.0);
            let sigma = found.w - skin;
            clearance = min(clearance, sigma / select(1.0, lipschitz(number), sigma > 0.0));
            // The last round only measures.
            if round < PROJECTION_ROUNDS && sigma < 0.0 {
                let left = resolve_penetration(number, found, particle);
            }
        }
        // Outside, up to rounding.
        if clearance > -1e-6 {
            return max(clearance, 0.0);
        }
    }
    return clearance;
}

// From positions to the solid's local space where the displacements began, and the fraction of the
// substep there.
fn map_at_start(number: u32) -> mat4x4f {
    if at_rest {
        return query.solids[number].at_end;
    }
    return query.solids[number].at_start;
}

fn start_fraction() -> f32 {
    return select(0.0, 1.0, at_rest);
}

// Upper bound of the displacement since the last query of a surface whose shape changes.
fn swell_of(number: u32) -> f32 {
    return select(0.0, query.solids[number].swell, CHANGES && !at_rest);
}

// First touch of a particle that moves straight through the solid's local space, and the normal
// there: `sweep::sweep`.
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
    var last = none;
    for (var k = 0u; k < SWEEP_STEPS; k++) {
        let point = start + share * go;
        let found = sample_shape(number, point, select(1.0, share, changes > 0.0));
        let sigma = found.w - skin;
        if sigma <= touch && (dot(found.xyz, go) < 0.0 || changes > 0.0) {
            return Touch(true, point + max(-sigma, 0.0) * found.xyz, found.xyz);
        }
        share += max(sigma, touch) / fall;
        if !(share < 1.0) {
            return none;
        }
        last = Touch(true, point, found.xyz);
    }
    // It grazes the surface.
    return last;
}

// Motion relative to a solid above which continuous collision detection is needed.
fn ccd_motion(number: u32) -> f32 {
    return query.solids[number].thinness * select(CCD_MOTION, 1.0, query.solids[number].cell > 0.0);
}

// Into how many parts the path of a point is divided to see whether it passed through a field; 0:
// it is traced.
fn parts_of(number: u32, length: f32) -> u32 {
    if query.solids[number].cell <= 0.0 || swell_of(number) > 0.0 {
        return 0u;
    }
    let parts = ceil(length / query.solids[number].thinness);
    return select(0u, u32(parts), parts <= f32(MOST_PARTS));
}

// Whether a point of the path from `start` to `end` in a solid's local space, divided into `parts`,
// is inside.
fn is_on_path(number: u32, start: vec3f, end: vec3f, parts: u32) -> bool {
    for (var part = 1u; part < parts; part++) {
        let point = start + (f32(part) / f32(parts)) * (end - start);
        if sample_shape(number, point, 1.0).w <= skin {
            return true;
        }
    }
    return false;
}

// Whether a point that ends at `sigma` over the skin may have passed through a solid, or have entered
// it elsewhere.
fn may_pass(number: u32, sigma: f32, start: vec3f, end: vec3f) -> bool {
    let length = distance(start, end) + swell_of(number);
    if sigma > length * lipschitz(number) + TOUCH * query.solids[number].thinness {
        return false;
    }
    let parts = parts_of(number, length);
    return parts == 0u || is_on_path(number, start, end, parts);
}

// Stops a particle where it touched a solid.
fn stop(number: u32, touch: Touch, particle: ptr<function, Particle>) {
    let map = query.solids[number].at_end;
    (*particle).x = turned(map, touch.place - map[3].xyz);
    apply_friction(number, turned(map, touch.normal), particle, true);
}

// Stops a particle that came from outside, and that pushes have not brought out again, where it
// entered a solid. Returns whether it did.
fn stop_at_entry(number: u32, origin: vec3f, particle: ptr<function, Particle>) -> bool {
    let start = local(map_at_start(number), origin);
    let touch = sweep(number, start, local(query.solids[number].at_end, (*particle).x));
    if touch.found {
        stop(number, touch, particle);
    }
    return touch.found;
}

// Stops a particle at the surface that it passed through on its path from `origin`. Returns whether
// it was stopped.
fn resolve_ccd_hit(number: u32, found: vec4f, origin: vec3f, particle: ptr<function, Particle>) -> bool {
    let map = query.solids[number].at_end;
    let start = local(map_at_start(number), origin);
    let end = local(map, (*particle).x);
    if distance(start, end) + swell_of(number) <= ccd_motion(number) {
        return false;
    }
    // A particle that was inside at the last query is being pushed out. One that has not been
    // queried may have been outside.
    if (*particle).last_clearance < 0.0 {
        if (*particle).last_clearance > frame.unknown {
            return false;
        }
        if sample_shape(number, start, start_fraction()).w < skin {
            return false;
        }
    }
    let touch = sweep(number, start, end);
    // Deep inside a field its gradient does not say where the particle came from.
    let sigma = found.w - skin;
    let is_shallow = sigma > -query.solids[number].thinness;
    if !touch.found || (sigma < 0.0 && is_shallow && dot(found.xyz, touch.normal) > 0.5) {
        return false;
    }
    stop(number, touch, particle);
    return true;
}

// For a particle that moved from `origin` to `x` in a substep and had clearance `last`: the
// clearance that is left, and the displacement relative to the solid that moved most against it.
fn clearance_left(x: vec3f, origin: vec3f, last: f32) -> vec2f {
    var left = FAR;
    var moved = 0.0;
    for (var number = 0u; number < query.count; number++) {
        let by = distance(x, local(query.solids[number].carry, origin)) + query.solids[number].swell;
        var far = last;
        if query.count > 1u {
            // The motion of a distant solid does not use up the clearance.
            far = max(last, distance(x, query.solids[number].ball) - query.solids[number].ball_radius - query.thickness);
        }
        left = min(left, far - by);
        moved = max(moved, by);
    }
    return vec2f(left, moved);
}

// A particle after the query of all solids.
struct Resolved {
    x: vec3f,
    v: vec3f,
    clearance: f32,
    touches: bool,
}

// Resolves the collisions of a particle that came from `origin`. `moved` is its displacement
// relative to the solid that moved most against it, `last` its clearance after the last query.
fn query_solids(x: vec3f, v: vec3f, origin: vec3f, moved: f32, last: f32) -> Resolved {
    skin = query.thickness;
    var particle = Particle(x, v, last);
    var clearance = FAR;
    var touches = false;
    var between = false;
    for (var number = 0u; number < query.count; number++) {
        let place = particle.x;
        let found = sample_shape(number, local(query.solids[number].at_end, place), 1.0);
        var own = Particle(place, particle.v, last);
        // One that has not been queried may have been outside: the solid came to it. Slower ones
        // are pushed out at once anyway.
        if last <= frame.unknown && moved > query.max_push_out && found.w < skin
            && sample_shape(number, local(map_at_start(number), origin), start_fraction()).w >= skin {
            own.last_clearance = 0.0;
        }
        var sigma = 0.0;
        var is_ccd_hit = false;
        if moved > ccd_motion(number) {
            let start = local(map_at_start(number), origin);
            let end = local(query.solids[number].at_end, place);
            if may_pass(number, found.w - skin, start, end) {
                is_ccd_hit = resolve_ccd_hit(number, found, origin, &own);
            }
        }
        if !is_ccd_hit {
            let last_clearance = own.last_clearance;
            sigma = resolve_penetration(number, found, &own);
            if sigma < -PASSES && last_clearance >= 0.0 {
                // Near the middle of a field pushes do not bring it out.
                var stopped = Particle(place, particle.v, last_clearance);
                if stop_at_entry(number, origin, &stopped) {
                    own = stopped;
                    sigma = 0.0;
                }
            }
        }
        if is_ccd_hit || found.w < query.thickness {
            touches = true;
            between = between || clearance < distance(own.x, place);
            particle.x = own.x;
            particle.v = own.v;
        }
        clearance = min(clearance, sigma / select(1.0, lipschitz(number), sigma > 0.0));
    }
    // A particle that was inside at the last query is pushed out over several substeps.
    if between && last >= 0.0 {
        particle.last_clearance = 0.0;
        clearance = resolve_penetrations(&particle);
    }
    return Resolved(particle.x, particle.v, clearance, touches);
}

// Reports contacts and depths in the frame's final collision pass.
fn report_contact(touches: bool, depth: f32) {
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
