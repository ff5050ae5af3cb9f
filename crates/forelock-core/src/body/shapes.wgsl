// Solids and their distance fields: the GPU counterpart of `body::Shape`.

// A solid during a substep. The matrices transform positions to the solid's local space.
struct Solid {
    at_end: mat4x4f,
    at_start: mat4x4f,
    // Motion of the carrier: maps positions at the substep's start to positions at its end.
    carry: mat4x4f,
    // Rotation vector of the carrier over the substep.
    spin: vec3f,
    friction: f32,
    // Translation of the carrier over the substep.
    travel: vec3f,
    // Kind of shape: SPHERE and the other constants.
    kind: u32,
    // Position of the carrier.
    pivot: vec3f,
    // A particle that moves less than this cannot pass through the solid.
    thinness: f32,
    // Sphere: radius; capsule: half length and radius; box: half extents.
    size: vec3f,
    // Side of a field's cells near the surface; 0 for exact shapes.
    cell: f32,
    // Centre of a ball that contains the solid.
    ball: vec3f,
    ball_radius: f32,
    // Field: the first node, the number of nodes and the index of its first value; of a body that
    // bends the latter at the frame's start.
    origin: vec3f,
    // Shape that changes: the index of its first field's description. Field: the index of the first
    // entry of its table of bricks, 0 if it is not refined. Body that bends: the index of the first
    // value at the frame's end.
    described: u32,
    dims: vec3u,
    first: u32,
    // Shape that changes: its positions in the sequence of fields at the substep's start and end,
    // an upper bound of its surface's motion during the substep, and the number of fields. Body
    // that bends: the shares of the frame at both.
    phases: vec2f,
    swell: f32,
    fields: u32,
    // Body that bends: the indices of the corners of its triangles, of the falls of its cells, of
    // the first value of its bricks, and of the nearest triangles of these.
    body: vec4u,
}

// The solids of a collision query and its options.
struct Query {
    count: u32,
    // AFTER_SUBSTEP: a substep has passed since the last query. DISPLACED: a pass has displaced
    // particles from stored positions. Otherwise displacements were subtracted from the clearances.
    // IF_MOVED, UNLESS_MOVED: only if contacts moved strands, or did not. LAST: the last query of
    // the frame.
    how: u32,
    // Distance that is kept from surfaces.
    thickness: f32,
    // Largest depth by which a particle that was inside may be pushed out in this query.
    max_push_out: f32,
    // Share of a solid's thinness that an edge may move in this query without being tested.
    slow_edges: f32,
    // Largest displacement in this query of a point of an edge that was inside before.
    max_edge_push: f32,
    stretch_limit: f32,
    pad_2: f32,
    solids: array<Solid, MOST_SOLIDS>,
}

// Values of all fields, one field after the other: those of its nodes, then those of its bricks,
// then for each node of a refined field the number of the brick of the cell that starts there, from
// 1, or 0. Then FIELD_NUMBERS numbers for each field of a shape that changes, and what bodies that
// bend need (`level_of`).
@group(0) @binding(10) var<storage, read> fields: array<f32>;
@group(0) @binding(11) var<uniform> query: Query;

fn local(map: mat4x4f, x: vec3f) -> vec3f {
    return (map * vec4f(x, 1.0)).xyz;
}

// Rotates a vector from the solid's local space to the world.
fn turned(map: mat4x4f, v: vec3f) -> vec3f {
    return vec3f(dot(map[0].xyz, v), dot(map[1].xyz, v), dot(map[2].xyz, v));
}

// Length and direction of a vector; the direction of a zero vector is +y.
fn unit(v: vec3f) -> vec4f {
    let length = sqrt(dot(v, v));
    if length > 1e-37 {
        return vec4f(v / length, length);
    }
    return vec4f(0.0, 1.0, 0.0, 0.0);
}

fn sample_box(half: vec3f, p: vec3f) -> vec4f {
    let side = select(vec3f(1.0), vec3f(-1.0), p < vec3f(0.0));
    let q = abs(p) - half;
    let out = unit(max(q, vec3f(0.0)));
    if out.w > 0.0 {
        return vec4f(side * out.xyz, out.w);
    }
    // If several faces are equally near, y is preferred to x and x to z.
    if q.y >= q.x && q.y >= q.z {
        return vec4f(0.0, side.y, 0.0, q.y);
    }
    if q.x >= q.z {
        return vec4f(side.x, 0.0, 0.0, q.x);
    }
    return vec4f(0.0, 0.0, side.z, q.z);
}

// A field: its first node, the side of a cell away from the surface, the number of nodes, the index
// of its first value, the index of the first entry of its table of bricks (0 if it has none), and
// that of the first value of brick 1.
struct Field {
    origin: vec3f,
    cell: f32,
    dims: vec3u,
    first: u32,
    bricks: u32,
    values: u32,
}

// A field whose bricks follow its nodes.
fn field_of(origin: vec3f, cell: f32, dims: vec3u, first: u32, bricks: u32) -> Field {
    return Field(origin, cell, dims, first, bricks, first + dims.x * dims.y * dims.z);
}

fn field_at(at: u32) -> Field {
    let origin = vec3f(fields[at], fields[at + 1u], fields[at + 2u]);
    let dims = vec3u(u32(fields[at + 4u]), u32(fields[at + 5u]), u32(fields[at + 6u]));
    return field_of(origin, fields[at + 3u], dims, index_at(at + 7u), index_at(at + 9u));
}

// An index that is stored in two halves, because a float holds 24 bits only.
fn index_at(at: u32) -> u32 {
    return u32(fields[at]) * 65536u + u32(fields[at + 1u]);
}

// Gradient (of any length) and distance, as in `Sdf::sample`.
fn sample_field(field: Field, p: vec3f) -> vec4f {
    let place = (p - field.origin) / field.cell;
    let top = vec3f(field.dims - 1u);
    let inside = clamp(place, vec3f(0.0), top);
    let low = vec3u(clamp(inside, vec3f(0.0), top - 1.0));
    var f = inside - vec3f(low);
    var row = field.dims.x;
    var layer = row * field.dims.y;
    var first = field.first + low.x + row * low.y + layer * low.z;
    var cell = field.cell;
    if field.bricks != 0u {
        // The brick's number, if the cell has one.
        let brick = u32(fields[field.bricks + first - field.first]);
        if brick != 0u {
            let within = f * f32(REFINEMENT);
            let low_within = vec3u(clamp(within, vec3f(0.0), vec3f(f32(REFINEMENT - 1u))));
            f = within - vec3f(low_within);
            let start = field.values + (brick - 1u) * BRICK_NODES;
            row = REFINEMENT + 1u;
            layer = row * row;
            first = start + low_within.x + row * low_within.y + layer * low_within.z;
            cell /= f32(REFINEMENT);
        }
    }
    let a = vec4f(fields[first], fields[first + row], fields[first + layer], fields[first + layer + row]);
    let b = vec4f(
        fields[first + 1u], fields[first + row + 1u], fields[first + layer + 1u], fields[first + layer + row + 1u],
    );
    let dx = b - a;
    let v = a + dx * f.x;
    let dy = v.yw - v.xz;
    let on_layer = v.xz + dy * f.y;
    let dx_layer = dx.xz + (dx.yw - dx.xz) * f.y;
    let value = on_layer.x + (on_layer.y - on_layer.x) * f.z;
    var slope = vec3f(
        dx_layer.x + (dx_layer.y - dx_layer.x) * f.z,
        dy.x + (dy.y - dy.x) * f.z,
        on_layer.y - on_layer.x,
    ) / cell;
    if dot(slope, slope) <= 1e-12 {
        slope = vec3f(0.0, 1.0, 0.0);
    }
    if all(place == inside) {
        return vec4f(slope, value);
    }
    // Outside the grid.
    let away = (place - inside) * field.cell;
    let distance = sqrt(dot(away, away) + value * value);
    let along = select(vec3f(0.0), slope * max(value, 0.0), away == vec3f(0.0));
    return vec4f((away + along) / distance, distance);
}

// The field of a shape that does not change.
fn constant_field(number: u32) -> Field {
    let bricks = query.solids[number].described;
    let cell = query.solids[number].cell * f32(select(1u, REFINEMENT, bricks != 0u));
    return field_of(
        query.solids[number].origin, cell, query.solids[number].dims, query.solids[number].first, bricks,
    );
}

// The same for a shape that changes, as in `Morph::sample` and `BendingField::sample`; among bodies
// that bend also for one that does not.
fn sample_fields(number: u32, p: vec3f, share: f32) -> vec4f {
    var part = mix(query.solids[number].phases.x, query.solids[number].phases.y, share);
    var first = 0u;
    let bends = is_bending(number);
    let is_constant = MAY_BEND && query.solids[number].kind == FIELD;
    if !bends && !is_constant {
        let phase = clamp(part, 0.0, f32(query.solids[number].fields - 1u));
        first = query.solids[number].described + u32(phase) * FIELD_NUMBERS;
        part = fract(phase);
    }
    // Whether the field is that of one end.
    let only_end = bends && (part >= 1.0 || is_still(number, p));
    let only_start = is_constant || (!bends && part == 0.0);
    var before = vec4f();
    var found = vec4f();
    // One call: compilers inline it.
    for (var end = select(0u, 1u, only_end); end < select(2u, 1u, only_start); end++) {
        var field: Field;
        if bends {
            field = level_of(number, end);
        } else if is_constant {
            field = constant_field(number);
        } else {
            field = field_at(first + end * FIELD_NUMBERS);
        }
        before = found;
        found = sample_field(field, p);
    }
    if only_end || only_start {
        return found;
    }
    let blended = mix(before, found, part);
    // Opposite gradients cancel where the surface turns inside out.
    let flat = select(before.xyz, found.xyz, bends);
    return select(vec4f(flat, blended.w), blended, dot(blended.xyz, blended.xyz) > 1e-6);
}

// Unit gradient and distance at `p` in the solid's local space, at the fraction `share` of the
// substep, as in `Shape::sample_at`.
fn sample_shape(number: u32, p: vec3f, share: f32) -> vec4f {
    let size = query.solids[number].size;
    switch query.solids[number].kind {
        case SPHERE: {
            let out = unit(p);
            return vec4f(out.xyz, out.w - size.x);
        }
        case HOLLOW_SPHERE: {
            let out = unit(p);
            return vec4f(-out.xyz, size.x - out.w);
        }
        case CAPSULE: {
            let out = unit(vec3f(p.x, p.y - clamp(p.y, -size.x, size.x), p.z));
            return vec4f(out.xyz, out.w - size.y);
        }
        case BOX: {
            return sample_box(size, p);
        }
        case PLANE: {
            return vec4f(0.0, 1.0, 0.0, p.y);
        }
        case FIELD: {
            if !MAY_BEND {
                let found = sample_field(constant_field(number), p);
                return vec4f(found.xyz / sqrt(dot(found.xyz, found.xyz)), found.w);
            }
        }
        default: {}
    }
    // Sampling shapes that change would make all others slower by a tenth and more: such solids use
    // a separate kernel.
    if !CHANGES {
        return vec4f(0.0, 1.0, 0.0, FAR);
    }
    let found = sample_fields(number, p, share);
    if is_bending(number) {
        return vec4f(found.xyz * shorten(found.xyz), found.w);
    }
    return vec4f(found.xyz / sqrt(dot(found.xyz, found.xyz)), found.w);
}

// Lipschitz constant of the shape's field: how much faster than the distance it can rise.
fn lipschitz(number: u32) -> f32 {
    return select(1.0, 1.7320508, query.solids[number].cell > 0.0);
}
