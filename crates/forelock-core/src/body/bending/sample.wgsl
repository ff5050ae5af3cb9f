// The field of a body that bends: the GPU counterpart of `body::BendingField`.

fn is_bending(number: u32) -> bool {
    return MAY_BEND && query.solids[number].kind == BENDING;
}

// The field of a body at the step's start (0) or at its end (1). Its nodes are followed by its
// table of bricks and by the corners of its triangles.
fn level_of(number: u32, end: u32) -> Field {
    let dims = query.solids[number].dims;
    let first = select(query.solids[number].first, query.solids[number].described, end == 1u);
    let bricks = first + dims.x * dims.y * dims.z;
    let cell = query.solids[number].cell * f32(REFINEMENT);
    return Field(query.solids[number].origin, cell, dims, first, bricks, query.solids[number].body.z);
}

// The index of the cell that holds `place`, in cells from the first node, in a grid of so many
// `entries` along x and y.
fn cell_index(dims: vec3u, place: vec3f, entries: vec2u) -> u32 {
    let cell = vec3u(clamp(place, vec3f(0.0), vec3f(dims - 2u)));
    return cell.x + entries.x * (cell.y + entries.y * cell.z);
}

// How far the field falls at most in the step in the cell of `p`; STILL where it does not change.
fn fall_at(number: u32, p: vec3f) -> f32 {
    let dims = query.solids[number].dims;
    let cell = query.solids[number].cell * f32(REFINEMENT);
    let place = (p - query.solids[number].origin) / cell;
    return fields[query.solids[number].body.y + cell_index(dims, place, dims.xy - 1u)];
}

// Whether the field is the same at both ends of the step in the cell of `p`.
fn is_still(number: u32, p: vec3f) -> bool {
    return fall_at(number, p) == STILL;
}

// The distance at the step's end.
fn sample_end(number: u32, p: vec3f) -> f32 {
    return sample_field(level_of(number, 1u), p).w;
}

// The factor that makes a gradient a unit vector, or a shorter one where the field is flat.
fn shorten(gradient: vec3f) -> f32 {
    return 1.0 / max(sqrt(dot(gradient, gradient)), FLAT_GRADIENT);
}

fn corner_of(number: u32, level: Field, triangle: u32, corner: u32) -> vec3f {
    let named = u32(fields[query.solids[number].body.x + 3u * triangle + corner]);
    let at = level.bricks + level.dims.x * level.dims.y * level.dims.z + 3u * named;
    return vec3f(fields[at], fields[at + 1u], fields[at + 2u]);
}

fn ratio(part: f32, whole: f32) -> f32 {
    return select(0.0, clamp(part / whole, 0.0, 1.0), whole > 0.0);
}

// Barycentric coordinates of the point of a triangle nearest to `p`: `bvh::nearest_barycentric`.
fn nearest_barycentric(a: vec3f, b: vec3f, c: vec3f, p: vec3f) -> vec3f {
    let ab = b - a;
    let ac = c - a;
    let d1 = dot(ab, p - a);
    let d2 = dot(ac, p - a);
    if d1 <= 0.0 && d2 <= 0.0 {
        return vec3f(1.0, 0.0, 0.0);
    }
    let d3 = dot(ab, p - b);
    let d4 = dot(ac, p - b);
    if d3 >= 0.0 && d4 <= d3 {
        return vec3f(0.0, 1.0, 0.0);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = ratio(d1, d1 - d3);
        return vec3f(1.0 - t, t, 0.0);
    }
    let d5 = dot(ab, p - c);
    let d6 = dot(ac, p - c);
    if d6 >= 0.0 && d5 <= d6 {
        return vec3f(0.0, 0.0, 1.0);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = ratio(d2, d2 - d6);
        return vec3f(1.0 - t, 0.0, t);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = ratio(d4 - d3, (d4 - d3) + (d5 - d6));
        return vec3f(0.0, 1.0 - t, t);
    }
    let area = va + vb + vc;
    let v = ratio(vb, area);
    let w = ratio(vc, area);
    return vec3f(1.0 - v - w, v, w);
}

// A displacement, if one is known.
struct Displacement {
    is_known: bool,
    by: vec3f,
}

// The displacement over the whole step of the skin nearest to `p`: `BendingField::displacement`.
fn skin_displacement(number: u32, p: vec3f) -> Displacement {
    if is_still(number, p) {
        return Displacement(true, vec3f());
    }
    let after = level_of(number, 1u);
    let place = (p - after.origin) / after.cell;
    let brick = u32(fields[after.bricks + cell_index(after.dims, place, after.dims.xy)]);
    if brick == 0u {
        return Displacement(false, vec3f());
    }
    // The node of the brick nearest to it.
    let low = floor(clamp(place, vec3f(0.0), vec3f(after.dims - 2u)));
    let node = vec3u(clamp(floor((place - low) * f32(REFINEMENT) + 0.5), vec3f(0.0), vec3f(f32(REFINEMENT))));
    let at = node.x + (REFINEMENT + 1u) * (node.y + (REFINEMENT + 1u) * node.z);
    let triangle = fields[query.solids[number].body.w + (brick - 1u) * BRICK_NODES + at];
    if triangle < 0.0 {
        return Displacement(false, vec3f());
    }
    let before = level_of(number, 0u);
    var now: array<vec3f, 3>;
    var moved: array<vec3f, 3>;
    for (var corner = 0u; corner < 3u; corner++) {
        now[corner] = corner_of(number, after, u32(triangle), corner);
        moved[corner] = now[corner] - corner_of(number, before, u32(triangle), corner);
    }
    let shares = nearest_barycentric(now[0], now[1], now[2], p);
    return Displacement(true, moved[0] * shares.x + moved[1] * shares.y + moved[2] * shares.z);
}
