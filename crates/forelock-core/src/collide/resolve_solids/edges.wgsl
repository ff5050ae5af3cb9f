// Collisions of the edges between particles: the GPU counterpart of `edges`.

// An edge during a query.
struct Edge {
    ends: array<vec3f, 2>,
    velocities: array<vec3f, 2>,
    origins: array<vec3f, 2>,
    inverse_masses: vec2f,
}

// A solid's field at points of an edge.
struct Samples {
    count: u32,
    distances: array<f32, PACKET>,
    // Of the points on the edge, 0 to 1.
    parameters: array<f32, PACKET>,
    // In the solid's local space.
    gradients: array<vec3f, PACKET>,
}

// Samples the edge from a to b, at b too if `with_end`. `map` and `fraction`: the solid's pose, and
// the time in the substep.
fn sample_edge(number: u32, map: mat4x4f, fraction: f32, a: vec3f, b: vec3f, with_end: bool) -> Samples {
    var own: Samples;
    let cell = query.solids[number].cell;
    // A field is smooth over a cell; primitives may have sharp edges.
    let length = distance(a, b);
    let parts = u32(clamp(ceil(length / (SKIN_SHARE * query.thickness + cell)), 2.0, f32(PACKET)));
    own.count = select(parts - 1u, parts, with_end);
    let spacing = 1.0 / f32(parts);
    var deepest = 0u;
    var slot = 0u;
    var near = 0.0;
    var far = 0.0;
    var falls = false;
    var steps = own.count;
    for (var k = 0u; k < steps; k++) {
        let refines = k >= own.count;
        let t = select(f32(k + 1u) * spacing, 0.5 * (near + far), refines);
        let found = sample_shape(number, local(map, mix(a, b, t)), fraction);
        if !refines {
            slot = k;
        }
        let is_deeper = found.w < own.distances[deepest];
        if !refines || is_deeper {
            own.parameters[slot] = t;
            own.distances[slot] = found.w;
            own.gradients[slot] = found.xyz;
        }
        if k == 0u || is_deeper {
            deepest = slot;
        }
        let falls_here = dot(turned(map, found.xyz), b - a) < 0.0;
        if refines && falls_here == falls {
            near = t;
        } else if refines {
            far = t;
        } else if k + 1u == own.count && cell <= 0.0
            && own.distances[deepest] - SKIN_SHARE * query.thickness <= 0.5 * spacing * length {
            // Move the deepest point to where the edge is deepest.
            steps += REFINEMENTS;
            falls = dot(turned(map, own.gradients[deepest]), b - a) < 0.0;
            near = own.parameters[deepest];
            far = clamp(near + select(-spacing, spacing, falls), 0.0, 1.0);
            slot = deepest;
            if with_end && deepest + 1u == own.count {
                slot = deepest - 1u;
            }
        }
    }
    return own;
}

// A collision of a point of an edge.
struct Hit {
    found: bool,
    t: f32,
    push: vec3f,
    size: f32,
    velocity_change: vec3f,
}

// Searches for the point of the edge that has to move farthest out of a solid; replaces `hit` if it
// has to move farther than that.
fn find_hit(number: u32, edge: Edge, hit: ptr<function, Hit>) {
    let map = query.solids[number].at_end;
    let map_before = map_at_start(number);
    let length = distance(edge.ends[0], edge.ends[1]);
    var moved = 0.0;
    for (var end = 0u; end < 2u; end++) {
        moved = max(moved, distance(local(map_before, edge.origins[end]), local(map, edge.ends[end])) + swell_of(number));
    }
    let middle = 0.5 * (edge.ends[0] + edge.ends[1]);
    let bound = distance(middle, query.solids[number].ball) - query.solids[number].ball_radius;
    let thinness = query.solids[number].thinness;
    if bound > 0.5 * length + moved + query.thickness || moved <= thinness * query.slow_edges {
        return;
    }
    skin = SKIN_SHARE * query.thickness;
    let samples = sample_edge(number, map, 1.0, edge.ends[0], edge.ends[1], false);
    // A point that is outside has passed through if it moved by the solid's thickness.
    var reach = skin;
    if moved > thinness + thinness {
        reach = moved * lipschitz(number) + TOUCH * thinness + skin;
    }
    let parts = parts_of(number, moved);
    for (var k = 0u; k < samples.count; k++) {
        let inside = samples.distances[k] < skin;
        var is_ccd_hit = moved > ccd_motion(number) && samples.distances[k] <= reach;
        if !inside && !is_ccd_hit {
            continue;
        }
        let t = samples.parameters[k];
        let origin = mix(edge.origins[0], edge.origins[1], t);
        let place = mix(edge.ends[0], edge.ends[1], t);
        let velocity = mix(edge.velocities[0], edge.velocities[1], t);
        let start = local(map_before, origin);
        let before = sample_shape(number, start, start_fraction()).w;
        // Roots may be inside a solid: points of their edges that start inside are left there.
        if edge.inverse_masses.x == 0.0 && before <= skin {
            continue;
        }
        let found = vec4f(samples.gradients[k], samples.distances[k]);
        var point = Particle(place, velocity, 0.0, false);
        let end = local(map, place);
        if is_ccd_hit && distance(start, end) + swell_of(number) > ccd_motion(number) {
            let touch = sweep(number, start, end, parts);
            is_ccd_hit = is_stopped(number, found, touch);
            if is_ccd_hit {
                stop(number, touch, &point);
            }
        } else {
            is_ccd_hit = false;
        }
        if !is_ccd_hit {
            if !inside {
                continue;
            }
            let left = resolve_penetration(number, found, &point);
        }
        var size = distance(point.x, place);
        if !is_ccd_hit && size > query.max_edge_push && before < 0.0 {
            // It was inside before: it comes out little by little.
            point.x = mix(place, point.x, query.max_edge_push / size);
            size = query.max_edge_push;
        }
        if !(*hit).found || size > (*hit).size {
            *hit = Hit(true, t, point.x - place, size, point.v - velocity);
        }
    }
}

fn load_edge(strand: Strand, i: u32) -> Edge {
    var masses = vec2f(1.0 / mass_at(strand, i - 1u), 1.0 / mass_at(strand, i));
    if i <= frame.clamped {
        masses.x = 0.0;
    }
    return Edge(
        array<vec3f, 2>(position_at(strand, i - 1u), position_at(strand, i)),
        array<vec3f, 2>(velocity_at(strand, i - 1u), velocity_at(strand, i)),
        array<vec3f, 2>(scratch_vector(strand, i - 1u, ORIGIN), scratch_vector(strand, i, ORIGIN)),
        masses,
    );
}

fn clearance_of(strand: Strand, i: u32) -> f32 {
    // Clamped particles are not queried: their clearance is not known.
    return select(memory[entry(strand, i, 2u, 1u)], 0.0, i < frame.clamped);
}

fn set_clearance(strand: Strand, i: u32, clearance: f32) {
    memory[entry(strand, i, 2u, 1u)] = clearance;
}

// Whether the solids are too far from the middle of the edge to particle i to touch it anywhere.
fn is_far_from_middle(strand: Strand, i: u32) -> bool {
    let a = position_at(strand, i - 1u);
    let b = position_at(strand, i);
    let edge = b - a;
    let length = sqrt(dot(edge, edge));
    let reach = 0.5 * length - max(min(clearance_of(strand, i - 1u), clearance_of(strand, i)), 0.0);
    for (var number = 0u; number < query.count; number++) {
        let map = query.solids[number].at_end;
        let found = sample_shape(number, local(map, 0.5 * (a + b)), 1.0);
        var far_enough = reach;
        if query.solids[number].cell > 0.0 {
            far_enough = 0.25 * abs(dot(turned(map, found.xyz), edge)) + length / 16.0;
        }
        if !(found.w - query.thickness > far_enough) {
            return false;
        }
    }
    return true;
}

// Pushes the edge to particle i out of the solids. Returns whether it has moved.
fn resolve_edge(strand: Strand, i: u32) -> bool {
    var edge = load_edge(strand, i);
    var moved = false;
    for (var round = 0u; round < EDGE_ROUNDS; round++) {
        var hit = Hit(false, 0.0, vec3f(), 0.0, vec3f());
        for (var number = 0u; number < query.count; number++) {
            find_hit(number, edge, &hit);
        }
        if !hit.found {
            break;
        }
        moved = true;
        let shares = vec2f(1.0 - hit.t, hit.t);
        let weights = edge.inverse_masses * shares / dot(edge.inverse_masses, shares * shares);
        for (var end = 0u; end < 2u; end++) {
            edge.ends[end] += weights[end] * hit.push;
            edge.velocities[end] += weights[end] * hit.velocity_change;
        }
    }
    if moved {
        for (var end = 0u; end < 2u; end++) {
            if edge.inverse_masses[end] > 0.0 {
                let p = i - 1u + end;
                let clearance = clearance_of(strand, p);
                if clearance >= 0.0 {
                    set_clearance(strand, p, max(clearance - distance(edge.ends[end], position_at(strand, p)), 0.0));
                }
                set_position(strand, p, edge.ends[end]);
                set_velocity(strand, p, edge.velocities[end]);
            }
        }
    }
    return moved;
}

// Whether the edge from a to b passes through a solid at a pose and time.
fn passes(number: u32, map: mat4x4f, fraction: f32, a: vec3f, b: vec3f) -> bool {
    let samples = sample_edge(number, map, fraction, a, b, false);
    for (var k = 0u; k < samples.count; k++) {
        if samples.distances[k] < -PASSES {
            return true;
        }
    }
    return false;
}

// Takes the edge to particle i back to where it came from, carried by the solid, if it passes
// through a solid and did not before. Returns whether it did.
fn take_edge_back(strand: Strand, i: u32) -> bool {
    let edge = load_edge(strand, i);
    let near = clearance_of(strand, i - 1u);
    let far = clearance_of(strand, i);
    if near + far >= distance(edge.ends[0], edge.ends[1]) || min(near, far) < 0.0 {
        return false;
    }
    for (var number = 0u; number < query.count; number++) {
        let map = query.solids[number].at_end;
        let map_before = map_at_start(number);
        // It passes through the solid now and did not before.
        var is_taken = false;
        for (var round = 0u; round < 2u; round++) {
            let was = round == 1u;
            var own_map = map;
            var ends = edge.ends;
            if was {
                own_map = map_before;
                ends = edge.origins;
            }
            if passes(number, own_map, select(1.0, start_fraction(), was), ends[0], ends[1]) == was {
                break;
            }
            is_taken = was;
        }
        if !is_taken {
            continue;
        }
        for (var end = 0u; end < 2u; end++) {
            if edge.inverse_masses[end] > 0.0 {
                let p = i - 1u + end;
                let place = turned(map, local(map_before, edge.origins[end]) - map[3].xyz);
                if !at_rest {
                    set_velocity(strand, p, (place - edge.origins[end]) * frame.inverse_h);
                }
                set_position(strand, p, place);
                set_clearance(strand, p, 0.0);
            }
        }
        return true;
    }
    return false;
}

fn take_back(strand: Strand) {
    for (var round = 0u; round < TAKE_BACK_ROUNDS; round++) {
        var found = false;
        for (var i = max(frame.clamped, 1u); i < strand.particles; i++) {
            if any(position_at(strand, i - 1u) != scratch_vector(strand, i - 1u, BEFORE_EDGES))
                || any(position_at(strand, i) != scratch_vector(strand, i, BEFORE_EDGES)) {
                let taken = take_edge_back(strand, i);
                found = found || taken;
            }
        }
        if !found {
            return;
        }
    }
}

// Resolves the collisions of the edges of a strand, from root to tip. Returns whether one was
// moved.
fn resolve_edges(strand: Strand) -> bool {
    var thinnest = FAR;
    for (var number = 0u; number < query.count; number++) {
        thinnest = min(thinnest, query.solids[number].thinness);
    }
    let slow = thinnest * query.slow_edges;
    var changed = false;
    for (var i = max(frame.clamped, 1u); i < strand.particles; i++) {
        let near = clearance_of(strand, i - 1u);
        let far = clearance_of(strand, i);
        let edge = position_at(strand, i) - position_at(strand, i - 1u);
        let moved = max(
            scratch_number(entry(strand, i - 1u, SCRATCH, MOVED)),
            scratch_number(entry(strand, i, SCRATCH, MOVED)),
        );
        let room = near + far;
        if !(room * room < dot(edge, edge)) || min(near, far) < 0.0 || !(slow < moved) {
            continue;
        }
        if !(thinnest < moved) && is_far_from_middle(strand, i) {
            continue;
        }
        if !changed {
            for (var k = 0u; k < strand.particles; k++) {
                set_scratch_vector(strand, k, BEFORE_EDGES, position_at(strand, k));
            }
        }
        let own = resolve_edge(strand, i);
        changed = changed || own;
    }
    return changed;
}
