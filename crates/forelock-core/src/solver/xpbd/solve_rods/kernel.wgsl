// One substep of Cosserat rods, one strand a thread: the GPU counterpart of `solve_rods::advance`.
//
// A pass over the strand does an iteration. The first predicts, the last writes velocities; between
// passes, scratch holds both λ of an edge, its rotation before the substep and its change. With one
// iteration scratch is not used.

// Velocity of the air at each particle, three rows; used with a wind field.
@group(0) @binding(17) var<storage, read> wind: array<f32>;

// Rows of scratch of an edge after both λ, three rows each: the two quaternions that it keeps.
const BEFORE = 6u;
const CHANGE = 10u;

struct Particle {
    x: vec3f,
    v: vec3f,
    // Inverse mass, 0 if clamped.
    w: f32,
}

struct Rotation {
    now: vec4f,
    // Its change since the substep's start.
    change: vec4f,
}

struct Edge {
    rotation: Rotation,
    // Its rotation before the substep.
    before: vec4f,
    // Inverse mass of the rotation, 0 if clamped.
    weight: f32,
    length: f32,
    // Its direction at rest.
    tangent: vec3f,
}

// The rotation of an edge after its stretch–shear constraint, and Δλ.
struct Stretched {
    rotation: Rotation,
    change: vec3f,
}

// Two rotations after their constraint, and λ.
struct Coupled {
    a: Rotation,
    b: Rotation,
    sum: vec3f,
}

// The shortest rotation between two unit vectors: `Quat::arc`.
fn arc(a: vec3f, b: vec3f) -> vec4f {
    let n = sqrt(max(2.0 * dot(a, b) + 2.0, 0.0));
    if n < 1e-4 {
        let axis = select(vec3f(0.0, -a.z, a.y), vec3f(-a.y, a.x, 0.0), a.x * a.x > 0.5);
        return vec4f(axis / sqrt(dot(axis, axis)), 0.0);
    }
    return vec4f(cross(a, b) / n, 0.5 * n);
}

// Adds `step` to a rotation and normalises: `Rotation::add`.
fn turned(rotation: Rotation, step: vec4f) -> Rotation {
    let now = rotation.now;
    let sum = now + step;
    let length = sqrt(dot(sum, sum));
    let inverse = 1.0 / (length + length * length);
    // 1/length, and the same less 1.
    let scale = (1.0 + length) * inverse;
    let longer = dot(step, now + now + step);
    return Rotation(sum * scale, rotation.change + step * scale - now * (longer * inverse));
}

fn particle_of(strand: Strand, i: u32, is_first: bool) -> Particle {
    let x = position_at(strand, i);
    let v = velocity_at(strand, i);
    let is_clamped = i < frame.clamped;
    let w = select(1.0 / mass_at(strand, i), 0.0, is_clamped);
    if !is_first {
        return Particle(x, v, w);
    }
    let start = x + substep.shift;
    if is_clamped {
        let on_head = rest_at_end(strand, rest_at(strand, i));
        return Particle(on_head, (on_head - start) * frame.inverse_h, w);
    }
    let fallen = v + frame.h * frame.gravity;
    return Particle(start + frame.h * fallen, fallen, w);
}

fn scratch_quaternion(strand: Strand, i: u32, row: u32) -> vec4f {
    let w = scratch_number(entry(strand, i, SCRATCH, row + 3u));
    return vec4f(scratch_vector(strand, i, row), w);
}

fn set_scratch_quaternion(strand: Strand, i: u32, row: u32, q: vec4f) {
    set_scratch_vector(strand, i, row, q.xyz);
    set_scratch_number(entry(strand, i, SCRATCH, row + 3u), q.w);
}

fn edge_of(strand: Strand, i: u32, is_first: bool) -> Edge {
    let inverse = inverse_rest_edge(strand, i);
    let length = rest_length(strand, i, 1u);
    let tangent = (rest_at(strand, i + 1u) - rest_at(strand, i)) * inverse;
    if i + 1u < frame.clamped {
        let head = rest_rotation(strand);
        return Edge(Rotation(head, vec4f()), head, 0.0, length, tangent);
    }
    let weight = 0.5 * frame.rotation_weight * inverse * inverse / mass_at(strand, i + 1u);
    let at = channel_entry(strand, i, ROTATION);
    let stored = vec4f(channel_vector(at), channels[at + 3u * LANES]);
    if is_first {
        let spin = channel_vector(channel_entry(strand, i, SPIN));
        let step = product(vec4f(spin, 0.0), stored) * (0.5 * frame.h);
        return Edge(turned(Rotation(stored, vec4f()), step), stored, weight, length, tangent);
    }
    let before = scratch_quaternion(strand, i, BEFORE);
    let change = scratch_quaternion(strand, i, CHANGE);
    return Edge(Rotation(stored, change), before, weight, length, tangent);
}

// Δλ of the stretch–shear constraint of an edge, 1/`inverse` long, whose ends are `apart` and have
// the inverse masses `w`, and the rotation that it leads to: `stretch_shear`.
fn stretch_shear(edge: Edge, apart: vec3f, w: vec2f, inverse: f32, alpha: f32, sum: vec3f) -> Stretched {
    let stretch = apart * inverse - rotate(edge.rotation.now, edge.tangent);
    let response = 4.0 * edge.weight + (w.x + w.y) * inverse * inverse + alpha;
    let change = (stretch + alpha * sum) * -(1.0 / response);
    let along = product(edge.rotation.now, vec4f(edge.tangent, 0.0));
    let step = product(vec4f(change, 0.0), along) * (2.0 * edge.weight);
    return Stretched(turned(edge.rotation, step), change);
}

// Corrects the bend–twist constraint between two rotations with inverse masses `w`: `couple`.
fn couple(a: Rotation, b: Rotation, bend: vec4f, w: vec2f, alpha: f32, sum: vec3f) -> Coupled {
    let end = product(b.now, bend);
    let now = product(conjugate(a.now), end);
    let at_rest = select(bend.xyz, -bend.xyz, dot(now, bend) < 0.0);
    let change = (now.xyz - at_rest + alpha * sum) * -(1.0 / (w.x + w.y + alpha));
    let of_a = product(end, vec4f(change, 0.0)) * -w.x;
    let of_b = product(product(a.now, vec4f(change, 0.0)), conjugate(bend)) * w.y;
    return Coupled(turned(a, of_a), turned(b, of_b), sum + change);
}

// Moves a particle by its inverse mass times `by`.
fn pushed(particle: Particle, by: vec3f) -> Particle {
    let moved = by * particle.w;
    return Particle(particle.x + moved, particle.v + frame.inverse_h * moved, particle.w);
}

// Writes particle `i`, after the last pass with its velocity damped.
fn store_particle(strand: Strand, i: u32, particle: Particle, is_last: bool) {
    var v = particle.v;
    if is_last && i >= frame.clamped {
        var air = frame.air;
        if has(WIND) {
            let at = entry(strand, i, 3u, 0u);
            air = vec3f(wind[at], wind[at + LANES], wind[at + 2u * LANES]);
        }
        v = air + frame.keep * (v - air);
    }
    set_position(strand, i, particle.x);
    set_velocity(strand, i, v);
}

// Writes edge `i`, after the last pass with its angular velocity.
fn store_edge(strand: Strand, i: u32, edge: Edge, is_last: bool) {
    let at = channel_entry(strand, i, ROTATION);
    set_channel_vector(at, edge.rotation.now.xyz);
    channels[at + 3u * LANES] = edge.rotation.now.w;
    if !is_last {
        set_scratch_quaternion(strand, i, BEFORE, edge.before);
        set_scratch_quaternion(strand, i, CHANGE, edge.rotation.change);
        return;
    }
    var spin = rest_spin(strand);
    if i + 1u >= frame.clamped {
        // r r̄_old = 1 + (r − r_old) r̄_old
        let turn = product(edge.rotation.change, conjugate(edge.before));
        let scale = select(2.0, -2.0, turn.w < -1.0) * frame.inverse_h;
        spin += frame.keep * (scale * turn.xyz - spin);
    }
    set_channel_vector(channel_entry(strand, i, SPIN), spin);
}

fn iterate(strand: Strand, is_first: bool, is_last: bool) {
    let stiffness = max(strand_stiffness(strand), LEAST_STIFFNESS);
    let bend_compliance = min(frame.bend_compliance / stiffness, SOFTEST);
    let last = strand.particles - 1u;
    var lower = particle_of(strand, 0u, is_first);
    var before: Edge;
    for (var i = 0u; i < last; i++) {
        var upper = particle_of(strand, i + 1u, is_first);
        var edge = edge_of(strand, i, is_first);
        var sum_stretch = vec3f();
        var sum_bend = vec3f();
        if !is_first {
            sum_stretch = scratch_vector(strand, i, 0u);
            sum_bend = scratch_vector(strand, i, 3u);
        }
        // Stretch–shear.
        let inverse = inverse_rest_edge(strand, i);
        let alpha = frame.stretch_compliance * inverse * inverse;
        let w = vec2f(lower.w, upper.w);
        let stretched = stretch_shear(edge, upper.x - lower.x, w, inverse, alpha, sum_stretch);
        edge.rotation = stretched.rotation;
        lower = pushed(lower, stretched.change * -inverse);
        upper = pushed(upper, stretched.change * inverse);
        if !is_last {
            set_scratch_vector(strand, i, 0u, sum_stretch + stretched.change);
        }
        // Bend–twist: of the first edge against the head.
        if has(BENDS) {
            var a = Rotation(rest_rotation(strand), vec4f());
            var bend = vec4f(0.0, 0.0, 0.0, 1.0);
            var weights = vec2f(0.0, edge.weight);
            var length = edge.length;
            if i > 0u {
                a = before.rotation;
                bend = arc(before.tangent, edge.tangent);
                weights.x = before.weight;
                length += before.length;
            }
            let coupled = couple(a, edge.rotation, bend, weights, 0.5 * length * bend_compliance, sum_bend);
            before.rotation = coupled.a;
            edge.rotation = coupled.b;
            if !is_last {
                set_scratch_vector(strand, i, 3u, coupled.sum);
            }
        }
        if i > 0u {
            store_edge(strand, i - 1u, before, is_last);
        }
        before = edge;
        store_particle(strand, i, lower, is_last);
        lower = upper;
    }
    store_edge(strand, last - 1u, before, is_last);
    if is_last {
        // The tip has the values of its edge.
        store_edge(strand, last, before, is_last);
    }
    store_particle(strand, last, lower, is_last);
}

@compute @workgroup_size(WORKGROUP)
fn solve_rods(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var iteration = 0u; iteration < frame.iterations; iteration++) {
        iterate(strand, iteration == 0u, iteration + 1u == frame.iterations);
    }
}
