// Restores the lengths of edges that collisions stretched: the GPU counterpart of `lay_along`.

fn at_distance(leader: vec3f, x: vec3f, length: f32) -> vec3f {
    let edge = x - leader;
    return leader + edge * (length / max(sqrt(dot(edge, edge)), 1e-37));
}

// The point of an edge that is inside a solid and needs the largest turn.
struct Inside {
    found: bool,
    sine: f32,
    number: u32,
    t: f32,
    gradient: vec3f,
    skin: f32,
    depth: f32,
}

// The search for a place of a particle at `length` from its leader.
struct Turn {
    leader: vec3f,
    length: f32,
    // A place that the edge cuts off, and towards which it turns.
    corner: vec3f,
    has_corner: bool,
    is_root: bool,
}

// Tests the edge with the particle at x against a solid. Returns the particle's clearance.
fn test_edge(number: u32, turn: Turn, x: vec3f, inside: ptr<function, Inside>) -> f32 {
    let bound = distance(x, query.solids[number].ball) - query.solids[number].ball_radius - query.thickness;
    if bound > turn.length {
        return bound;
    }
    let map = query.solids[number].at_end;
    let samples = sample_edge(number, map, 1.0, turn.leader, x, true);
    var clearance = 0.0;
    for (var k = 0u; k < samples.count; k++) {
        let t = samples.parameters[k];
        let is_particle = k + 1u == samples.count;
        let kept = select(SKIN_SHARE * query.thickness, query.thickness, is_particle);
        let sigma = samples.distances[k] - kept;
        if is_particle {
            clearance = max(sigma, 0.0) / lipschitz(number);
        }
        let sine = -sigma / (t * turn.length);
        // Rounding does not count.
        if !(-sigma > 1e-6) || ((*inside).found && (*inside).sine >= sine) {
            continue;
        }
        // Roots may be inside a solid, and so may be the start of their edges.
        if turn.is_root && !is_particle && t < 0.5 {
            continue;
        }
        *inside = Inside(true, sine, number, t, samples.gradients[k], kept, -sigma);
    }
    return clearance;
}

// Attempts to place a particle: straight to its goal, along the old curve, the same without a turn
// to the corner of that way, on the surface nearly at its length, and at shorter lengths.
const STRAIGHT = 0u;
const ALONG_CURVE = 1u;
const PAST_CORNER = 2u;
const ON_SURFACE = 3u;
const SHORTER = 4u;

// A place and its clearance.
struct Place {
    found: bool,
    x: vec3f,
    clearance: f32,
}

// Tests the edge with the particle at x against all solids. Returns the particle's clearance.
fn test_all(turn: Turn, x: vec3f, inside: ptr<function, Inside>) -> f32 {
    var clearance = FAR;
    for (var number = 0u; number < query.count; number++) {
        clearance = min(clearance, test_edge(number, turn, x, inside));
    }
    return clearance;
}

// The normal of the surface through which the edge with the particle at x enters the solid that its
// point `inside` is in, seen from the leader.
fn entry_normal(turn: Turn, x: vec3f, inside: Inside) -> vec3f {
    let map = query.solids[inside.number].at_end;
    // Near the surface of a rigid field no other one is nearer; parts of a body that bends may
    // press into each other.
    let solid = &query.solids[inside.number];
    if (*solid).kind == FIELD && inside.depth < SHALLOW * (*solid).thinness {
        return turned(map, inside.gradient);
    }
    skin = inside.skin;
    let point = local(map, mix(turn.leader, x, inside.t));
    let touch = sweep(inside.number, local(map, turn.leader), point, 0u);
    return turned(map, select(inside.gradient, touch.normal, touch.found));
}

// Searches from the direction of `start`, in so many `steps`. If no direction is free, the place is
// the last one.
fn find_turn(turn: Turn, start: vec3f, steps: u32) -> Place {
    var x = start;
    for (var step = 0u; step < steps; step++) {
        var inside = Inside();
        let clearance = test_all(turn, x, &inside);
        if !inside.found {
            return Place(true, x, clearance);
        }
        let normal = entry_normal(turn, x, inside);
        let d = (x - turn.leader) / turn.length;
        var e = normal - dot(normal, d) * d;
        var limit = 0.7;
        if turn.has_corner {
            let to_corner = turn.corner - turn.leader;
            e = to_corner - dot(to_corner, d) * d;
            limit = min(sqrt(dot(e, e) / dot(to_corner, to_corner)), 0.7);
        }
        let size = sqrt(dot(e, e));
        // The edge points straight into the surface or at the corner.
        if !(size > select(1e-3, 0.0, turn.has_corner)) {
            break;
        }
        let rise = max(dot(e, normal) / size, 0.25);
        let sine = min(inside.sine / rise + LEAST_TURN, limit);
        x = at_distance(turn.leader, turn.leader + sqrt(1.0 - sine * sine) * d + (sine / size) * e, turn.length);
    }
    return Place(false, x, 0.0);
}

// Whether a solid lies between two points. One that is too thick to fit between them does not.
fn is_between(a: vec3f, b: vec3f) -> bool {
    skin = query.thickness;
    for (var number = 0u; number < query.count; number++) {
        let map = query.solids[number].at_end;
        if distance(a, b) > query.solids[number].thinness && sweep(number, local(map, a), local(map, b), 0u).found {
            return true;
        }
    }
    return false;
}

// x moved to the surfaces of the solids that it is in.
fn project(place: vec3f) -> vec3f {
    var x = place;
    for (var number = 0u; number < query.count; number++) {
        let map = query.solids[number].at_end;
        let found = sample_shape(number, local(map, x), 1.0);
        let sigma = found.w - query.thickness;
        if sigma < 0.0 {
            x -= sigma * turned(map, found.xyz);
        }
    }
    return x;
}

// Depth of x under the surfaces of the solids that it is in.
fn depth_of(x: vec3f) -> f32 {
    var depth = 0.0;
    for (var number = 0u; number < query.count; number++) {
        depth = max(depth, -sample_shape(number, local(query.solids[number].at_end, x), 1.0).w);
    }
    return depth;
}

// A place on the strand's old curve: an edge, and where on it, 0 to 1.
struct CurvePlace {
    edge: u32,
    share: f32,
    // Whether the curve is not being pushed out of a solid.
    is_outside: bool,
}

fn curve_point(strand: Strand, i: u32) -> vec3f {
    return scratch_vector(strand, i, OLD_CURVE);
}

// The place up to which the strand has been placed.
fn place_on_curve(strand: Strand, at: CurvePlace) -> vec3f {
    let last = strand.particles - 1u;
    if at.edge < last {
        return mix(curve_point(strand, at.edge), curve_point(strand, at.edge + 1u), at.share);
    }
    return curve_point(strand, last);
}

// The place one edge on. Beyond its end the curve goes on straight.
fn next_on_curve(strand: Strand, at: CurvePlace) -> vec3f {
    let last = strand.particles - 1u;
    if at.edge + 1u < last {
        return mix(curve_point(strand, at.edge + 1u), curve_point(strand, at.edge + 2u), at.share);
    }
    let beyond = f32(at.edge + 1u - last) + at.share;
    return mix(curve_point(strand, last - 1u), curve_point(strand, last), 1.0 + beyond);
}

// Where the segment from a to b leaves the sphere about `centre`, 0 to 1; b is outside.
fn leaves_sphere(centre: vec3f, radius: f32, a: vec3f, b: vec3f) -> f32 {
    let p = a - centre;
    let g = b - a;
    let square = dot(g, g);
    let half = dot(p, g);
    let rest = dot(p, p) - radius * radius;
    let root = sqrt(max(half * half - square * rest, 0.0));
    // The larger root, without cancellation.
    if half > 0.0 {
        return min(-rest / (half + root), 1.0);
    }
    return select(1.0, min((root - half) / square, 1.0), square > 0.0);
}

fn distance_to_line(a: vec3f, b: vec3f, point: vec3f) -> f32 {
    let d = b - a;
    let p = point - a;
    let across = p - (dot(p, d) / dot(d, d)) * d;
    return sqrt(dot(across, across));
}

// A place on the way along the curve, and the corner of that way that the straight edge cuts off
// most.
struct Followed {
    x: vec3f,
    corner: vec3f,
    has_corner: bool,
}

// The first place at distance `length` from the leader, on the way back to the curve and then along
// it. Beyond the curve's end the strand goes on straight, in the direction of `ahead`.
fn follow_curve(strand: Strand, at: ptr<function, CurvePlace>, leader: vec3f, ahead: vec3f, length: f32) -> Followed {
    let tip = strand.particles - 1u;
    if (*at).edge >= tip {
        return Followed(at_distance(leader, leader + ahead, length), vec3f(), false);
    }
    let back = mix(curve_point(strand, (*at).edge), curve_point(strand, (*at).edge + 1u), (*at).share);
    if distance(leader, back) > length {
        return Followed(at_distance(leader, back, length), vec3f(), false);
    }
    let passed = (*at).edge + 1u;
    var place = curve_point(strand, tip);
    while (*at).edge < tip {
        let a = curve_point(strand, (*at).edge);
        let b = curve_point(strand, (*at).edge + 1u);
        if !(dot(b - leader, b - leader) < length * length) {
            // It does not move back.
            (*at).share = max(leaves_sphere(leader, length, a, b), (*at).share);
            place = mix(a, b, (*at).share);
            break;
        }
        (*at).edge += 1u;
        (*at).share = 0.0;
    }
    var found = Followed(at_distance(leader, place, length), vec3f(), false);
    var most = 1e-3 * length;
    for (var i = passed - 1u; i <= min((*at).edge, tip - 1u); i++) {
        var point = back;
        if i >= passed {
            point = curve_point(strand, i);
        }
        let beside = distance_to_line(leader, found.x, point);
        if beside > most {
            // A turn towards the place that the leader has slipped from would fold the strand.
            let slipped = i < passed && dot(point - leader, found.x - leader) <= 0.0
                && distance(leader, point) < SLIP * length;
            found.corner = point;
            found.has_corner = !slipped;
            most = beside;
        }
    }
    return found;
}

// Whether the edge of `turn` with the particle at x may be made shorter: the old curve is outside
// all solids from edge `begin` to edge `end`, and where lengths have precedence, `stretch_limit` 0,
// a solid that is thin beside the edge would cut it.
fn may_shorten(strand: Strand, begin: u32, end: u32, turn: Turn, x: vec3f) -> bool {
    let last = min(end, strand.particles - 2u);
    for (var edge = min(begin, last + 1u); edge <= last + 1u; edge++) {
        let is_new = edge > last;
        var a = turn.leader;
        var b = x;
        if !is_new {
            a = curve_point(strand, edge);
            b = curve_point(strand, edge + 1u);
        }
        var meets = false;
        for (var number = 0u; number < query.count; number++) {
            let counts = !is_new || query.solids[number].thinness < THIN * turn.length;
            if counts && passes(number, query.solids[number].at_end, 1.0, a, b) {
                meets = true;
                break;
            }
        }
        if meets || is_new {
            return is_new && (meets || query.stretch_limit > 0.0);
        }
    }
    return false;
}

// Searches for a place of the next particle of `turn`, at `x` if the edge is free there. If no
// direction is free, the place is the last one at its length. `goal` is one edge on along the
// curve, `ahead` the strand's direction.
fn place_next(
    strand: Strand,
    at: ptr<function, CurvePlace>,
    turn: Turn,
    x: vec3f,
    goal: vec3f,
    leaves: bool,
    ahead: vec3f,
    has_pass: bool,
) -> Place {
    let began = *at;
    var end = began;
    var found = Place(false, x, 0.0);
    var own = turn;
    var way = Followed(goal, vec3f(), false);
    // Of the longest edge for which a direction is free, by bisection.
    var least = 0.0;
    var most = turn.length;
    // All attempts share one search: compilers inline it.
    for (var attempt = select(STRAIGHT, ALONG_CURVE, leaves); attempt < SHORTER + SHORTER_STEPS; attempt++) {
        if (attempt == PAST_CORNER && !way.has_corner) || (attempt == ON_SURFACE && !has_pass) {
            continue;
        }
        if attempt == SHORTER && !(began.is_outside && may_shorten(strand, began.edge, end.edge, turn, found.x)) {
            break;
        }
        own.length = select(turn.length, 0.5 * (least + most), attempt >= SHORTER);
        if attempt == ALONG_CURVE || attempt >= SHORTER {
            *at = began;
            way = follow_curve(strand, at, turn.leader, ahead, own.length);
        }
        own.corner = way.corner;
        // The corner may lie beside the edge on the solid's side.
        own.has_corner = way.has_corner && attempt == ALONG_CURVE;
        var start = way.x;
        var steps = SLIDE_STEPS;
        if attempt == STRAIGHT {
            start = x;
        } else if attempt == ON_SURFACE {
            // Nearly at its length.
            start = project(found.x);
            steps = 1u;
            own.length = distance(turn.leader, start);
            if !(abs(own.length - turn.length) < NEARLY * turn.length) {
                continue;
            }
        }
        var tried = find_turn(own, start, steps);
        tried.found = tried.found && !is_between(way.x, tried.x);
        if attempt == STRAIGHT && tried.found {
            (*at).edge += 1u;
        }
        if attempt < SHORTER && tried.found {
            return tried;
        }
        if attempt == ALONG_CURVE || (attempt >= SHORTER && tried.found) {
            found = tried;
            end = *at;
        }
        if tried.found {
            least = own.length;
        } else if attempt >= SHORTER {
            most = own.length;
        }
    }
    *at = end;
    return found;
}

fn lay_along(strand: Strand) {
    let first = max(frame.clamped, 1u);
    let limit = query.stretch_limit;
    // The old curve of a strand that is being pushed out of a solid is not outside: it waits, if
    // another pass keeps its lengths.
    let has_pass = limit > 0.0 && limit <= STRETCHED;
    var at = CurvePlace(first - 1u, 0.0, true);
    for (var i = first; i < strand.particles; i++) {
        at.is_outside = at.is_outside && !(clearance_of(strand, i) < -query.thickness);
    }
    // Hair that parts of a body that bends hold between them has no other place.
    let holds = may_hold();
    if at.is_outside || !(has_pass || holds) {
        lay_curve(strand, at, has_pass);
    } else if !holds {
        return;
    }
    if holds {
        limit_stretch(strand);
    }
    for (var i = first; i < strand.particles; i++) {
        let edge = unit(position_at(strand, i) - position_at(strand, i - 1u)).xyz;
        let v = velocity_at(strand, i);
        set_velocity(strand, i, v - dot(edge, v - velocity_at(strand, i - 1u)) * edge);
    }
}

// Limits the stretch of the strand's edges: `bending::limit_stretch`.
fn limit_stretch(strand: Strand) {
    let first = max(frame.clamped, 1u);
    let by = max(query.stretch_limit, PINCHED);
    var has_moved = false;
    for (var i = first; i < strand.particles; i++) {
        let leader = position_at(strand, i - 1u);
        var x = position_at(strand, i);
        let rest = rest_length(strand, i - 1u, 1u);
        let now = distance(leader, x);
        let length = clamp(now, (1.0 - by) * rest, (1.0 + by) * rest);
        // What was brought out lies at the skin's thickness.
        if length == now || !(has_moved || distance_from_skin(x) < rest + query.thickness) {
            continue;
        }
        has_moved = true;
        if now < COINCIDENT * rest {
            // It has no direction of its own: that of the edge before, if there is one.
            x = 2.0 * leader - position_at(strand, max(i, 2u) - 2u);
        }
        x = at_distance(leader, x, length);
        for (var round = 0u; round < EXACT_ROUNDS; round++) {
            x = at_distance(leader, project(x), length);
        }
        set_position(strand, i, x);
        var clearance = clearance_at(x);
        report_contact(false, -(clearance + query.thickness));
        if clearance > 0.0 {
            clearance = min(clearance, clearance_at_end(x));
        }
        set_clearance(strand, i, clearance);
    }
}

// Lays the strand along the solids: `lay_along::lay_strand`.
fn lay_curve(strand: Strand, place: CurvePlace, has_pass: bool) {
    let first = max(frame.clamped, 1u);
    let limit = query.stretch_limit;
    var at = place;
    for (var i = 0u; i < strand.particles; i++) {
        set_scratch_vector(strand, i, OLD_CURVE, position_at(strand, i));
    }
    var thinnest = FAR;
    for (var number = 0u; number < query.count; number++) {
        thinnest = min(thinnest, query.solids[number].thinness);
    }
    var leader = position_at(strand, first - 1u);
    var before = position_at(strand, max(first, 2u) - 2u);
    for (var i = first; i < strand.particles; i++) {
        var length = rest_length(strand, i - 1u, 1u);
        if limit > STRETCHED {
            let now = distance(curve_point(strand, i - 1u), curve_point(strand, i));
            length = clamp(now, length * (1.0 - limit), length * (1.0 + limit));
        }
        let goal = next_on_curve(strand, at);
        var x = at_distance(leader, goal, length);
        // Where the strand has slipped, the goal is between two particles of the old curve.
        let is_known = at.edge + 1u == i && at.share == 0.0;
        let known = select(0.0, memory[entry(strand, i, 2u, 1u)], is_known);
        // A leader that has slipped past its place would fold the strand; between one that is far
        // from its place and the goal, the way along the curve may lead around a solid.
        let leaves = distance(leader, goal) < FOLDS * length
            || (distance(leader, place_on_curve(strand, at)) > LAG * length && thinnest >= THIN * length);
        var clearance = known - distance(x, goal);
        if known < 0.0 {
            at.edge += 1u;
            clearance = known;
        } else if clearance <= 0.0 || clearance + clearance_of(strand, i - 1u) <= length || leaves {
            let turn = Turn(leader, length, vec3f(), false, i <= frame.clamped);
            let own = place_next(strand, &at, turn, x, goal, leaves, leader - before, has_pass);
            x = own.x;
            clearance = own.clearance;
            // Where no direction is free the length has precedence, unless a pass restores it.
            for (var round = 0u; !own.found && round < select(EXACT_ROUNDS, 1u, has_pass); round++) {
                x = project(x);
                if !has_pass {
                    x = at_distance(leader, x, length);
                }
            }
            if !own.found && !has_pass {
                report_contact(false, depth_of(x));
            }
        } else {
            at.edge += 1u;
        }
        set_clearance(strand, i, clearance);
        set_position(strand, i, x);
        before = leader;
        leader = x;
    }
}
