// The query of all solids at one particle, shared by several kernels: the GPU counterpart of
// `resolve_solids::clearance_left` and of a particle's part in `Queue::resolve_packet`.

struct Particle {
    x: vec3f,
    v: vec3f,
    // Clearance after the last query.
    last_clearance: f32,
    // Whether parts of a body that bends hold it in this query.
    is_held: bool,
}

// Distance kept from surfaces: of particles, or of edges.
var<private> skin: f32;
// Whether solids are at rest at the substep's end during the displacements; otherwise these began
// at the substep's start.
var<private> at_rest: bool = false;

// Displacement in the substep of the solid's surface at `x`, where its normal is `normal`: the
// rigid motion, plus that of skin that bends, or that along the normal of a shape that changes.
fn surface_displacement(number: u32, x: vec3f, normal: vec3f) -> vec3f {
    let arm = x - query.solids[number].pivot;
    var gone = query.solids[number].travel + cross(query.solids[number].spin, arm);
    if CHANGES && query.solids[number].swell > 0.0 {
        if is_bending(number) {
            let bent = displacement(number, x);
            if bent.is_known {
                return gone + bent.by;
            }
        }
        let place = local(query.solids[number].at_end, x);
        for (var time = 0u; time < 2u; time++) {
            gone += sample_shape(number, place, f32(time)).w * select(1.0, -1.0, time > 0u) * normal;
        }
    }
    return gone;
}

// Removes the velocity at which the particle approaches a surface that moves by `gone` in h, and
// applies Coulomb friction.
fn apply_friction(number: u32, gone: vec3f, normal: vec3f, particle: ptr<function, Particle>, is_ccd_hit: bool) {
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
    // Parts of a body that come towards each other may leave no room between them.
    let is_skin = is_bending(number);
    var bends = false;
    if is_skin {
        bends = !is_still(number, local(map, (*particle).x));
    }
    let gone = surface_displacement(number, (*particle).x, turned(map, gradient));
    if is_skin && leads_nowhere(gradient) {
        (*particle).v = gone * frame.inverse_h;
        return held(sigma, particle);
    }
    apply_friction(number, gone, turned(map, gradient), particle, false);
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
        if is_skin && leads_nowhere(gradient) {
            return held(sigma, particle);
        }
        let normal = turned(map, gradient);
        (*particle).x += push * normal;
        if push < small_push && !bends {
            return allowed;
        }
        let there = sample_shape(number, local(map, (*particle).x), 1.0);
        sigma = there.w - skin;
        if !(sigma < 0.0) {
            return select(sigma, allowed, push < small_push);
        }
        if bends && dot(there.xyz, gradient) < OPPOSITE {
            // It has passed the middle of a gap that is narrower than the skins.
            (*particle).x -= 0.5 * push * normal;
            (*particle).v = gone * frame.inverse_h;
            return held(sigma, particle);
        }
        gradient = there.xyz;
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

// With `parts` the path is traced only if one of the places that divide it into so many is inside
// (`sweep::may_pass`).
fn sweep(number: u32, start: vec3f, end: vec3f, parts: u32) -> Touch {
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
    var is_free = parts > 0u;
    // Below zero it is a place that divides the path.
    for (var k = min(1 - i32(parts), 0); k < i32(SWEEP_STEPS); k++) {
        if is_free && k >= 0 {
            return none;
        }
        if k < 0 {
            share = f32(-k) / f32(parts);
        }
        let point = start + share * go;
        let found = sample_shape(number, point, select(1.0, share, changes > 0.0));
        let sigma = found.w - skin;
        if k < 0 {
            share = 0.0;
            if sigma <= 0.0 {
                is_free = false;
                k = -1;
            }
            continue;
        }
        if sigma <= touch && (dot(found.xyz, go) < 0.0 || changes > 0.0) {
            return Touch(true, point + max(-sigma, 0.0) * found.xyz, found.xyz);
        }
        share += max(sigma, touch) / fall;
        if !(share < 1.0) {
            return none;
        }
        last = Touch(sigma > 0.0 && dot(found.xyz, go) < 0.0, point, found.xyz);
    }
    // It grazes the surface, or leaves it.
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

// Whether a particle, of which `found` is the sample, is stopped where its path touched a solid:
// otherwise pushes bring it out on that side. Deep inside a field its gradient does not say where
// the particle came from.
fn is_stopped(number: u32, found: vec4f, touch: Touch) -> bool {
    let sigma = found.w - skin;
    let is_shallow = sigma > -query.solids[number].thinness;
    return touch.found && !(sigma < 0.0 && is_shallow && dot(found.xyz, touch.normal) > 0.5);
}

// Stops a particle where it touched a solid.
fn stop(number: u32, touch: Touch, particle: ptr<function, Particle>) {
    let map = query.solids[number].at_end;
    (*particle).x = turned(map, touch.place - map[3].xyz);
    let normal = turned(map, touch.normal);
    apply_friction(number, surface_displacement(number, (*particle).x, normal), normal, particle, true);
}

// For a particle that moved from `origin` to `x` in a substep and had clearance `last`: the
// clearance that is left, and the displacement relative to the solid that moved most against it.
fn clearance_left(x: vec3f, origin: vec3f, last: f32) -> vec2f {
    var left = FAR;
    var moved = 0.0;
    for (var number = 0u; number < query.count; number++) {
        // The distance from a body that bends falls by what is known of each cell.
        let sinks = select(query.solids[number].swell, 0.0, is_bending(number));
        let by = distance(x, local(query.solids[number].carry, origin)) + sinks;
        var far = last;
        if query.count > 1u {
            // The motion of a distant solid does not use up the clearance.
            far = max(last, distance(x, query.solids[number].ball) - query.solids[number].ball_radius - query.thickness);
        }
        left = min(left, far - by - fall(number, origin));
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
    var particle = Particle(x, v, last, false);
    var clearance = FAR;
    var touches = false;
    var between = false;
    for (var number = 0u; number < query.count; number++) {
        let place = particle.x;
        let end = local(query.solids[number].at_end, place);
        let found = sample_shape(number, end, 1.0);
        let start = local(map_at_start(number), origin);
        let length = distance(start, end) + swell_of(number);
        let reach = length * lipschitz(number) + TOUCH * query.solids[number].thinness;
        var may_hit = min(moved, length) > ccd_motion(number) && !(found.w - skin > reach);
        // A particle that was inside at the last query is being pushed out. One that has not been
        // queried may have been outside: the solid came to it. Slower ones are pushed out at once
        // anyway.
        var own = Particle(place, particle.v, last, false);
        let is_taken = moved > query.max_push_out && found.w < skin;
        if last > frame.unknown {
            may_hit = may_hit && last >= 0.0;
        } else if may_hit || is_taken {
            let was_outside = sample_shape(number, start, start_fraction()).w >= skin;
            may_hit = may_hit && was_outside;
            own.last_clearance = select(last, 0.0, is_taken && was_outside);
        }
        var sigma = 0.0;
        var is_ccd_hit = false;
        for (var attempt = 0u; attempt < 2u; attempt++) {
            // Near the middle of a field pushes do not bring it out.
            let is_left_inside = sigma < -PASSES && own.last_clearance >= 0.0 && !own.is_held;
            if select(is_left_inside, may_hit, attempt == 0u) {
                let touch = sweep(number, start, end, select(0u, parts_of(number, length), attempt == 0u));
                is_ccd_hit = select(touch.found, is_stopped(number, found, touch), attempt == 0u);
                if is_ccd_hit {
                    own = Particle(place, particle.v, own.last_clearance, false);
                    stop(number, touch, &own);
                    sigma = 0.0;
                    break;
                }
            }
            if attempt == 0u {
                sigma = resolve_penetration(number, found, &own);
            }
        }
        if is_ccd_hit || found.w < query.thickness {
            touches = true;
            between = between || clearance < distance(own.x, place);
            particle.x = own.x;
            particle.v = own.v;
        }
        if is_bending(number) && sigma > 0.0 && query.solids[number].phases.y < 1.0 {
            // The clearance holds until the frame's end.
            sigma = min(sigma, max(clearance_at_end_of(number, own.x), 0.0));
        }
        clearance = min(clearance, sigma / select(1.0, lipschitz(number), sigma > 0.0));
    }
    // A particle that was inside at the last query is pushed out over several substeps.
    if between && last >= 0.0 {
        particle.last_clearance = 0.0;
        clearance = resolve_penetrations(&particle);
        if MAY_BEND && clearance > 0.0 {
            clearance = min(clearance, clearance_at_end(particle.x));
        }
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
