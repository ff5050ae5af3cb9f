// One implicit substep of a strand, one strand a thread: the GPU counterpart of
// `solve_strands::advance`.
//
// The band system is the same, but the elimination is right-looking: row i is eliminated from the
// three rows after it at once, so that only a window of rows is in work, which fits into registers.
// Row i stores L_{i+k,i} (k = 1, 2, 3) and D_i⁻¹ z_i in scratch; then
// v_i = D_i⁻¹ z_i − Σ_k L_{i+k,i}ᵀ v_{i+k}, last row first.

// Velocity of the air at each particle, three rows; used with a wind field.
@group(0) @binding(17) var<storage, read> wind: array<f32>;

// A particle's counterpart in the rest shape.
struct Ghost {
    y: vec3f,
    w: vec3f,
}

// A spring from i: h² K, h κ (l − l₀) d, 1/l.
struct Spring {
    stiffness: Sym,
    impulse: vec3f,
    inverse_length: f32,
}

// Rows i, i + 1, i + 2 and i + 3 of the system, after the elimination of all rows before i.
struct Window {
    d0: Sym,
    d1: Sym,
    d2: Sym,
    d3: Sym,
    a10: mat3x3f,
    a20: mat3x3f,
    a30: mat3x3f,
    a21: mat3x3f,
    a31: mat3x3f,
    a32: mat3x3f,
    b0: vec3f,
    b1: vec3f,
    b2: vec3f,
    b3: vec3f,
}

fn ghost_of(strand: Strand, rest: vec3f) -> Ghost {
    let y = rest_at_start(strand, rest);
    return Ghost(y, (rest_at_end(strand, rest) - y) * frame.inverse_h);
}

fn moved_position(strand: Strand, i: u32) -> vec3f {
    return position_at(strand, i) + substep.shift;
}

fn asin_polynomial(z: f32) -> f32 {
    return (((ASIN_RATIO_4 * z + ASIN_RATIO_3) * z + ASIN_RATIO_2) * z + ASIN_RATIO_1) * z + ASIN_RATIO_0;
}

// asin(u)/u, u = √square.
fn asin_ratio(square: f32) -> f32 {
    if square < 0.25 {
        return asin_polynomial(square);
    }
    let u = sqrt(square);
    let z = (1.0 - u) * 0.5;
    return (1.5707963267948966 - sqrt(z) * asin_polynomial(z) * 2.0) / max(u, 0.5);
}

// AMS Eq. 5 and its Jacobian: `springs::spring`.
fn spring(kappa: f32, d: vec3f, rest_length: f32) -> Spring {
    let inverse_length = 1.0 / sqrt(max(dot(d, d), 1e-24));
    let stretch = 1.0 - rest_length * inverse_length;
    let h2k = kappa * frame.h * frame.h;
    let tau = select(0.0, max(stretch, 0.0), has(TENSION));
    let along = h2k * (1.0 - tau) * inverse_length * inverse_length;
    return Spring(outer_plus_identity(along, d, h2k * tau), d * (kappa * frame.h * stretch), inverse_length);
}

// h² κ I, or h² κ D, on the diagonal, and the same times w on the right: `ghost::implicit_tie`.
fn tie(window: ptr<function, Window>, kappa: f32, pull: vec3f, w: vec3f) {
    let h2k = frame.h * frame.h * kappa;
    if has(DIRECTIONAL) {
        let along = outer_plus_identity(h2k / max(dot(pull, pull), 1e-24), pull, 0.0);
        (*window).d0 = sym_add((*window).d0, along);
        (*window).b0 += sym_mul(along, w);
    } else {
        (*window).d0.d += h2k;
        (*window).b0 += h2k * w;
    }
}

// The tie's intact share after this deflection: `ghost::damage`.
fn damaged(intact: f32, deflection: vec3f, length: f32) -> f32 {
    let e = sqrt(dot(deflection, deflection)) / length;
    let over = max(e - frame.elastic_limit, 0.0);
    let range = max(frame.breaking_point - frame.elastic_limit, 1e-30);
    let softened = 1.0 - over * over * (0.5 / range) / max(e, 1e-12);
    let at_break = 0.5 * (frame.breaking_point + frame.elastic_limit) / frame.breaking_point;
    let past = (e - frame.breaking_point) / frame.breaking_width;
    let broken = max(at_break * (1.0 - past), 0.0);
    let psi = select(broken, softened, past < 0.0);
    let healed = (1.0 - intact) * frame.healing + intact;
    return min(select(intact, healed, e < frame.healing_limit), psi);
}

// The velocity towards which drag accelerates a particle, and h c: `drag::towards_air`.
fn drag_of(strand: Strand, i: u32, v: vec3f) -> vec4f {
    var air = frame.air;
    if has(WIND) {
        let at = entry(strand, i, 3u, 0u);
        air = vec3f(wind[at], wind[at + LANES], wind[at + 2u * LANES]);
    }
    if !has(SLENDER) {
        return vec4f(air, frame.drag);
    }
    let slip = air - v;
    let along = position_at(strand, min(i + 1u, strand.particles - 1u)) - position_at(strand, max(i, 1u) - 1u);
    let share = dot(along, slip) / max(dot(along, along), 1e-24);
    let drag = frame.drag + frame.drag_quadratic * sqrt(dot(slip, slip));
    return vec4f(air + (frame.drag_along - 1.0) * share * along, drag);
}

// Mass, air and ghost ties of row i.
fn tie_to_ghost(
    strand: Strand,
    i: u32,
    x: vec3f,
    inputs: Inputs,
    ghost: Ghost,
    kappas: vec2f,
    window: ptr<function, Window>,
) {
    let v = inputs.velocity;
    let drag = drag_of(strand, i, v);
    let mass = mass_at(strand, i);
    (*window).d0.d += mass + drag.w;
    (*window).b0 += mass * (v + frame.h * frame.gravity) + drag.w * drag.xyz;
    if has(INTEGRITY) {
        var intact = inputs.intact;
        if has(NON_HOOKEAN) {
            intact = damaged(intact, x - ghost.y, strand_length(strand));
            memory[entry(strand, i, 2u, 0u)] = intact;
        }
        let pull = ghost.y - x;
        let kappa = kappas.x * intact;
        (*window).b0 += frame.h * kappa * pull;
        var direction = pull;
        if has(SAG_FREE) {
            let weight = carried_weight(strand);
            (*window).b0 -= frame.h * intact * mass * weight;
            // The force is that of a tie to a ghost raised by m g/κ_I, so the tie points to that
            // ghost.
            direction -= mass * weight / max(kappas.x, 1e-24);
        }
        tie(window, kappa, direction, ghost.w);
    }
    if has(ANGULAR_PAPER) && i > 0u {
        let before = moved_position(strand, i - 1u);
        let pull = ghost.y - x;
        let rays = array(ghost.y - before, x - before);
        let across = cross(rays[0], rays[1]);
        let sine = sqrt(dot(across, across));
        let cosine = dot(rays[0], rays[1]);
        let theta = select(atan2(sine, cosine), 0.0, sine == 0.0 && cosine == 0.0);
        let least = rest_length(strand, i - 1u, 1u) * 1e-8;
        let a = kappas.y * theta / max(sqrt(dot(pull, pull)), least);
        (*window).b0 += frame.h * a * pull;
        tie(window, a, pull, ghost.w);
    }
}

// Adds a spring from row i to row i + reach.
fn add_spring(window: ptr<function, Window>, reach: u32, is_free: bool, w: vec3f, added: Spring) {
    let k = added.stiffness;
    var to_outer = -added.impulse;
    if is_free {
        (*window).d0 = sym_add((*window).d0, k);
        (*window).b0 += added.impulse;
    } else {
        to_outer += sym_mul(k, w);
    }
    let coupling = sym_matrix(Sym(-k.d, -k.o));
    switch reach {
        case 1u: {
            (*window).d1 = sym_add((*window).d1, k);
            (*window).b1 += to_outer;
            if is_free { (*window).a10 += coupling; }
        }
        case 2u: {
            (*window).d2 = sym_add((*window).d2, k);
            (*window).b2 += to_outer;
            if is_free { (*window).a20 += coupling; }
        }
        default: {
            (*window).d3 = sym_add((*window).d3, k);
            (*window).b3 += to_outer;
            if is_free { (*window).a30 += coupling; }
        }
    }
}

// Angular tie of the edge d to the ghosts' edge: `ghost::angular_edge`.
fn add_couple(edge: ptr<function, Spring>, kappa: f32, d: vec3f, inverse_rest: f32, ghost: Ghost, next: Ghost) {
    let g = next.y - ghost.y;
    let cosine = dot(g, d) * inverse_rest * (*edge).inverse_length;
    let square = clamp(0.5 - 0.5 * cosine, 0.0, 1.0);
    let a = kappa * inverse_rest * asin_ratio(square);
    let stiffness = frame.h * frame.h * a;
    (*edge).stiffness.d += stiffness;
    (*edge).impulse -= frame.h * a * (g - d) + stiffness * (next.w - ghost.w);
}

// Adds a block to A_{kl}, k ≥ l, of the window.
fn add_block(window: ptr<function, Window>, k: u32, l: u32, s: Sym) {
    let m = sym_matrix(s);
    switch 4u * k + l {
        case 0u: { (*window).d0 = sym_add((*window).d0, s); }
        case 5u: { (*window).d1 = sym_add((*window).d1, s); }
        case 10u: { (*window).d2 = sym_add((*window).d2, s); }
        case 15u: { (*window).d3 = sym_add((*window).d3, s); }
        case 4u: { (*window).a10 += m; }
        case 8u: { (*window).a20 += m; }
        case 12u: { (*window).a30 += m; }
        case 9u: { (*window).a21 += m; }
        case 13u: { (*window).a31 += m; }
        default: { (*window).a32 += m; }
    }
}

fn add_impulse(window: ptr<function, Window>, k: u32, impulse: vec3f) {
    switch k {
        case 0u: { (*window).b0 += impulse; }
        case 1u: { (*window).b1 += impulse; }
        case 2u: { (*window).b2 += impulse; }
        default: { (*window).b3 += impulse; }
    }
}

// An altitude of a tetrahedron: the parallelogram's normal, a vector across, four weights.
struct Altitude {
    normal: vec3f,
    across: vec3f,
    weights: vec4f,
}

// The altitude of feature 0 to 6, numbered as in `altitude::FEATURES`.
fn altitude(p: array<vec3f, 4>, feature: u32) -> Altitude {
    var corners = array<vec4u, 7>(
        vec4u(0u, 1u, 2u, 3u),
        vec4u(1u, 0u, 3u, 2u),
        vec4u(2u, 0u, 1u, 3u),
        vec4u(3u, 0u, 2u, 1u),
        vec4u(0u, 1u, 2u, 3u),
        vec4u(0u, 2u, 3u, 1u),
        vec4u(0u, 3u, 1u, 2u),
    );
    let at = corners[feature];
    var points = p;
    let q = array<vec3f, 4>(points[at.x], points[at.y], points[at.z], points[at.w]);
    let is_face = feature < 4u;
    let e1 = select(q[1] - q[0], q[2] - q[1], is_face);
    let e2 = select(q[3] - q[2], q[3] - q[1], is_face);
    let across = select(q[2] - q[0], q[0] - q[1], is_face);
    let normal = cross(e1, e2);
    let scale = 1.0 / max(dot(normal, normal), 1e-30);
    let s = dot(cross(across, e2), normal) * scale;
    let t = dot(cross(across, e1), normal) * scale;
    // For a point and a face: 1 for the point, then β + γ − 1, −β, −γ, with β = s and γ = −t.
    let by_corner = select(vec4f(s - 1.0, -s, 1.0 - t, t), vec4f(1.0, s - t - 1.0, -s, t), is_face);
    var weights = array<f32, 4>(0.0, 0.0, 0.0, 0.0);
    weights[at.x] = by_corner.x;
    weights[at.y] = by_corner.y;
    weights[at.z] = by_corner.z;
    weights[at.w] = by_corner.w;
    return Altitude(normal, across, vec4f(weights[0], weights[1], weights[2], weights[3]));
}

// The altitude spring of the tetrahedron that starts at row i: `altitude::add`.
fn add_altitude(strand: Strand, i: u32, kappa: f32, window: ptr<function, Window>) {
    var here: array<vec3f, 4>;
    var before: array<vec3f, 4>;
    for (var k = 0u; k < 4u; k++) {
        here[k] = moved_position(strand, i + k);
        before[k] = rest_at(strand, i + k);
    }
    var feature = 0u;
    var best = altitude(here, 0u);
    for (var k = 1u; k < 7u; k++) {
        let other = altitude(here, k);
        if dot(other.normal, other.normal) > dot(best.normal, best.normal) {
            best = other;
            feature = k;
        }
    }
    let at_rest = altitude(before, feature);
    let direction = best.normal / sqrt(max(dot(best.normal, best.normal), 1e-30));
    let height = dot(at_rest.across, at_rest.normal) / sqrt(max(dot(at_rest.normal, at_rest.normal), 1e-30));
    let impulse = kappa * frame.h * (dot(best.across, direction) - height);
    let along = outer_plus_identity(kappa * frame.h * frame.h, direction, 0.0);
    var weights = array<f32, 4>(best.weights.x, best.weights.y, best.weights.z, best.weights.w);
    for (var k = 0u; k < 4u; k++) {
        if i + k < frame.clamped {
            continue;
        }
        add_impulse(window, k, -(impulse * weights[k]) * direction);
        for (var l = 0u; l < 4u; l++) {
            let share = weights[k] * weights[l];
            let block = Sym(share * along.d, share * along.o);
            if i + l < frame.clamped {
                add_impulse(window, k, -sym_mul(block, ghost_of(strand, before[l]).w));
            } else if l <= k {
                add_block(window, k, l, block);
            }
        }
    }
}

// The inverse of a positive definite matrix by its LDLᵀ factors, with pivots of at least
// PIVOT_FLOOR over the smallest mass.
fn sym_inverse(s: Sym) -> Sym {
    let least = PIVOT_FLOOR * frame.least_mass;
    let i0 = 1.0 / max(s.d.x, least);
    let l10 = s.o.x * i0;
    let l20 = s.o.y * i0;
    let i1 = 1.0 / max(s.d.y - l10 * s.o.x, least);
    let t = s.o.z - l20 * s.o.x;
    let l21 = t * i1;
    let i2 = 1.0 / max((s.d.z - l20 * s.o.y) - l21 * t, least);
    let m20 = l10 * l21 - l20;
    let n20 = m20 * i2;
    let n21 = -(l21 * i2);
    let n10 = l10 * i1;
    return Sym(
        vec3f(i0 + l10 * n10 + m20 * n20, i1 - l21 * n21, i2),
        vec3f(m20 * n21 - n10, n20, n21),
    );
}

// Eliminates row i from the rows after it and stores the factors for the backward sweep.
fn eliminate(strand: Strand, i: u32, window: ptr<function, Window>) {
    let inverse = sym_inverse((*window).d0);
    let p = sym_matrix(inverse);
    let z = (*window).b0;
    let l1 = (*window).a10 * p;
    let l2 = (*window).a20 * p;
    let l3 = (*window).a30 * p;
    (*window).d1 = sym_sub_product((*window).d1, l1, (*window).a10);
    (*window).d2 = sym_sub_product((*window).d2, l2, (*window).a20);
    (*window).d3 = sym_sub_product((*window).d3, l3, (*window).a30);
    (*window).a21 -= l2 * transpose((*window).a10);
    (*window).a31 -= l3 * transpose((*window).a10);
    (*window).a32 -= l3 * transpose((*window).a20);
    (*window).b1 -= l1 * z;
    (*window).b2 -= l2 * z;
    (*window).b3 -= l3 * z;
    for (var c = 0u; c < 3u; c++) {
        store_links(strand, i, c, l1[c], l2[c], l3[c]);
    }
    set_scratch_vector(strand, i, 27u, sym_mul(inverse, z));
}

fn advance_window(window: ptr<function, Window>) {
    (*window).d0 = (*window).d1;
    (*window).d1 = (*window).d2;
    (*window).d2 = (*window).d3;
    (*window).d3 = Sym(vec3f(), vec3f());
    (*window).a10 = (*window).a21;
    (*window).a20 = (*window).a31;
    (*window).a21 = (*window).a32;
    (*window).a30 = mat3x3f();
    (*window).a31 = mat3x3f();
    (*window).a32 = mat3x3f();
    (*window).b0 = (*window).b1;
    (*window).b1 = (*window).b2;
    (*window).b2 = (*window).b3;
    (*window).b3 = vec3f();
}

// What row i of the system takes from memory, besides positions that rows before it took.
struct Inputs {
    // The position of particle i + 3 and the rest position of i + 1, or of the tip.
    x: vec3f,
    rest: vec3f,
    // Rest lengths to the next three particles, and one over the first of them.
    lengths: vec3f,
    inverse_edge: f32,
    velocity: vec3f,
    // The intact share of the tie.
    intact: f32,
}

// The inputs of row i, or of the last row.
fn inputs_of(strand: Strand, i: u32) -> Inputs {
    let tip = strand.particles - 1u;
    let own = min(i, tip);
    let at = entry(strand, own, MODEL_ROWS, 3u);
    return Inputs(
        moved_position(strand, min(i + 3u, tip)),
        rest_at(strand, min(i + 1u, tip)),
        vec3f(model[at], model[at + LANES], model[at + 2u * LANES]),
        model[at + 3u * LANES],
        velocity_at(strand, own),
        memory[entry(strand, own, 2u, 0u)],
    );
}

// The rows are read one ahead: a device hides the wait for memory behind the elimination, which it
// may not do by itself, for what is written might be what is read next.
@compute @workgroup_size(WORKGROUP)
fn solve_strands(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let n = strand.particles;
    let clamped = min(frame.clamped, n);
    let stiffness = strand_stiffness(strand);
    var window: Window;
    var ghost = ghost_of(strand, rest_at(strand, 0u));
    var inputs = inputs_of(strand, 0u);
    var x0 = moved_position(strand, 0u);
    var x1 = moved_position(strand, min(1u, n - 1u));
    var x2 = moved_position(strand, min(2u, n - 1u));
    for (var i = 0u; i < n; i++) {
        let own = inputs;
        inputs = inputs_of(strand, i + 1u);
        let fraction = f32(i) / f32(n - 1u);
        let scales = (1.0 + (frame.tip_scales - 1.0) * fraction) * stiffness;
        let is_free = i >= clamped;
        if is_free {
            let kappas = vec2f(frame.k_integrity * scales.y, frame.k_angular * scales.z);
            tie_to_ghost(strand, i, x0, own, ghost, kappas, &window);
        }
        let next = ghost_of(strand, own.rest);
        let kappas = frame.k_springs * scales.x;
        if i + 1u < n && i + 1u >= clamped {
            let d = x1 - x0;
            var edge = spring(kappas.x, d, own.lengths.x);
            if has(ANGULAR_EDGE) {
                add_couple(&edge, frame.k_angular * scales.z, d, own.inverse_edge, ghost, next);
            }
            add_spring(&window, 1u, is_free, ghost.w, edge);
        }
        if i + 2u < n && i + 2u >= clamped {
            add_spring(&window, 2u, is_free, ghost.w, spring(kappas.y, x2 - x0, own.lengths.y));
        }
        if i + 3u < n && i + 3u >= clamped {
            add_spring(&window, 3u, is_free, ghost.w, spring(kappas.z, own.x - x0, own.lengths.z));
        }
        if has(ALTITUDE) && i + 3u < n {
            add_altitude(strand, i, frame.k_altitude * scales.x, &window);
        }
        if is_free {
            eliminate(strand, i, &window);
        } else {
            set_scratch_vector(strand, i, 27u, ghost.w);
        }
        advance_window(&window);
        ghost = next;
        x0 = x1;
        x1 = x2;
        x2 = own.x;
    }
    var v1 = vec3f();
    var v2 = vec3f();
    var v3 = vec3f();
    for (var k = 0u; k < n; k++) {
        let i = n - 1u - k;
        var v = scratch_vector(strand, i, 27u);
        if i >= clamped {
            // Factors beyond the tip are zero, like the springs there.
            v -= vec3f(
                linked(strand, i, 0u, v1, v2, v3),
                linked(strand, i, 1u, v1, v2, v3),
                linked(strand, i, 2u, v1, v2, v3),
            );
            set_position(strand, i, moved_position(strand, i) + frame.h * v);
        } else {
            set_position(strand, i, rest_at_end(strand, rest_at(strand, i)));
        }
        set_velocity(strand, i, v);
        v3 = v2;
        v2 = v1;
        v1 = v;
    }
}
