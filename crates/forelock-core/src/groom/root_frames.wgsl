// Roots on a surface that bends: the GPU counterpart of `groom::root_frames`, after `surface.wgsl`.
// A rotation of zeros stands for none.

struct Root {
    // The corners of its triangle in the mesh, and among the corners.
    corners: vec3u,
    pad_0: u32,
    own: vec3u,
    pad_1: u32,
    barycentric: vec3f,
    pad_2: f32,
    // The root at rest, from the point that it is bound to.
    offset: vec3f,
    pad_3: f32,
}

// The corners of each triangle in the mesh.
@group(0) @binding(43) var<storage, read> triangles: array<u32>;
// For each corner the first entry of its list, and the end; then the lists: of triangles, and of
// corners.
@group(0) @binding(44) var<storage, read> fans: array<u32>;
@group(0) @binding(45) var<storage, read> neighbours: array<u32>;
// Three numbers for each vertex of the mesh, at rest and bent.
@group(0) @binding(46) var<storage, read> at_rest: array<f32>;
@group(0) @binding(47) var<storage, read> bent: array<f32>;
// A root for each lane of each block.
@group(0) @binding(48) var<storage, read> roots: array<Root>;
// The rotation of each triangle times its area at rest, then that of each corner.
@group(0) @binding(49) var<storage, read_write> turns: array<vec4f>;

// A triangle from its first corner: `Corner`.
struct Corner {
    // Its first edge, the direction across that in its plane, and its normal.
    frame: vec4f,
    // The length of the first edge; 0 if the triangle is next to degenerate.
    first: f32,
    // The second edge, along the first and across it.
    second: vec2f,
}

// A mean of rotations: the first, and the sum with the signs nearest to that.
struct Mean {
    first: vec4f,
    sum: vec4f,
}

fn rest_vertex(vertex: u32) -> vec3f {
    return vec3f(at_rest[3u * vertex], at_rest[3u * vertex + 1u], at_rest[3u * vertex + 2u]);
}

fn bent_vertex(vertex: u32) -> vec3f {
    return vec3f(bent[3u * vertex], bent[3u * vertex + 1u], bent[3u * vertex + 2u]);
}

// The rotation with the columns `x`, `y` and `z`, by the largest of its four components.
fn quaternion(x: vec3f, y: vec3f, z: vec3f) -> vec4f {
    if z.z <= 0.0 {
        let difference = y.y - x.x;
        if difference <= 0.0 {
            let four = 1.0 - z.z - difference;
            return vec4f(four, x.y + y.x, x.z + z.x, y.z - z.y) * (0.5 / sqrt(four));
        }
        let four = 1.0 - z.z + difference;
        return vec4f(x.y + y.x, four, y.z + z.y, z.x - x.z) * (0.5 / sqrt(four));
    }
    let sum = y.y + x.x;
    if sum <= 0.0 {
        let four = 1.0 + z.z - sum;
        return vec4f(x.z + z.x, y.z + z.y, four, x.y - y.x) * (0.5 / sqrt(four));
    }
    let four = 1.0 + z.z + sum;
    return vec4f(y.z - z.y, z.x - x.z, x.y - y.x, four) * (0.5 / sqrt(four));
}

fn corner_of(a: vec3f, b: vec3f, c: vec3f) -> Corner {
    let edge = b - a;
    let other = c - a;
    let normal = cross(edge, other);
    let size = sqrt(dot(normal, normal));
    let first = sqrt(dot(edge, edge));
    if size <= FLAT_TRIANGLE * first * sqrt(dot(other, other)) || !all_finite(normal) {
        return Corner(vec4f(), 0.0, vec2f());
    }
    let along = edge / first;
    let out = normal / size;
    let across = cross(out, along);
    return Corner(quaternion(along, across, out), first, vec2f(dot(other, along), dot(other, across)));
}

// The square of the longer of the edges from the first corner.
fn longest_squared(corner: Corner) -> f32 {
    return max(corner.first * corner.first, dot(corner.second, corner.second));
}

// Whether the triangle has no rotation: it is next to degenerate, or collapses as it bends.
fn has_collapsed(rest: Corner, now: Corner) -> bool {
    if rest.first == 0.0 || now.first == 0.0 {
        return true;
    }
    let grown = longest_squared(now) / longest_squared(rest);
    return grown < COLLAPSED_TRIANGLE * COLLAPSED_TRIANGLE
        || now.first * now.second.y < COLLAPSED_TRIANGLE * grown * rest.first * rest.second.y;
}

fn is_none(turn: vec4f) -> bool {
    return dot(turn, turn) == 0.0;
}

fn extended(mean: Mean, turn: vec4f, weight: f32) -> Mean {
    if is_none(turn) {
        return mean;
    }
    if is_none(mean.first) {
        // Rotations without weight are no first one.
        return Mean(select(vec4f(), turn, weight > 0.0), select(vec4f(), weight * turn, weight > 0.0));
    }
    return Mean(mean.first, mean.sum + select(weight, -weight, dot(mean.first, turn) < 0.0) * turn);
}

// None if there are no rotations.
fn mean_of(mean: Mean) -> vec4f {
    if is_none(mean.first) {
        return vec4f();
    }
    let squared = dot(mean.sum, mean.sum);
    if squared > 1e-24 {
        return mean.sum * (1.0 / sqrt(squared));
    }
    return mean.first * (1.0 / sqrt(dot(mean.first, mean.first)));
}

// The rotation of each triangle: `turn_to`.
@compute @workgroup_size(CELLS_GROUP)
fn turn_triangles(@builtin(global_invocation_id) id: vec3u) {
    for (var own = id.x; own < surface.triangles; own += LIST_THREADS) {
        let v = vec3u(triangles[3u * own], triangles[3u * own + 1u], triangles[3u * own + 2u]);
        let rest = corner_of(rest_vertex(v.x), rest_vertex(v.y), rest_vertex(v.z));
        let now = corner_of(bent_vertex(v.x), bent_vertex(v.y), bent_vertex(v.z));
        if has_collapsed(rest, now) {
            turns[own] = vec4f();
            continue;
        }
        // F = [[stretch, shear], [0, trace − stretch]], of which the rotation is by the angle
        // atan2(−shear, trace), within a right angle.
        let stretch = now.first / rest.first;
        let shear = (now.second.x - stretch * rest.second.x) / rest.second.y;
        let trace = stretch + now.second.y / rest.second.y;
        let half = vec2f(-shear, trace + sqrt(shear * shear + trace * trace));
        let unit = half * (1.0 / sqrt(dot(half, half)));
        let in_plane = vec4f(0.0, 0.0, unit.x, unit.y);
        let turn = product(product(now.frame, in_plane), conjugate(rest.frame));
        turns[own] = turn * (0.5 * rest.first * rest.second.y);
    }
}

// The mean of the triangles around each corner, by their areas.
@compute @workgroup_size(CELLS_GROUP)
fn turn_corners(@builtin(global_invocation_id) id: vec3u) {
    for (var corner = id.x; corner < surface.corners; corner += LIST_THREADS) {
        var mean = Mean();
        for (var i = fans[corner]; i < fans[corner + 1u]; i++) {
            mean = extended(mean, turns[fans[i]], 1.0);
        }
        turns[surface.triangles + corner] = mean_of(mean);
    }
}

// The rotation of a corner: without one of its own, the mean of its neighbours.
fn known_turn(corner: u32) -> vec4f {
    let own = turns[surface.triangles + corner];
    if !is_none(own) {
        return own;
    }
    var mean = Mean();
    for (var i = neighbours[corner]; i < neighbours[corner + 1u]; i++) {
        mean = extended(mean, turns[surface.triangles + neighbours[i]], 1.0);
    }
    return mean_of(mean);
}

// The motion of each root.
@compute @workgroup_size(CELLS_GROUP)
fn move_roots(@builtin(global_invocation_id) id: vec3u) {
    for (var own = id.x; own < surface.roots; own += LIST_THREADS) {
        let root = roots[own];
        var mean = Mean();
        var moved = vec3f();
        for (var k = 0u; k < 3u; k++) {
            mean = extended(mean, known_turn(root.own[k]), root.barycentric[k]);
            let vertex = root.corners[k];
            moved += root.barycentric[k] * (bent_vertex(vertex) - rest_vertex(vertex));
        }
        var turn = mean_of(mean);
        if is_none(turn) {
            turn = vec4f(0.0, 0.0, 0.0, 1.0);
        }
        // The offset in the rotated frame, less that at rest.
        let twice = 2.0 * cross(turn.xyz, root.offset);
        let shift = moved + turn.w * twice + cross(turn.xyz, twice);
        root_frames[surface.frames + 2u * own] = turn;
        root_frames[surface.frames + 2u * own + 1u] = vec4f(shift, 0.0);
    }
}
