// Vertices that follow several bones: the GPU counterpart of `body::character::skin`. One vertex is
// one thread.

struct Skinned {
    // Vertices, and the bones that each follows.
    vertices: u32,
    influences: u32,
    pad_0: u32,
    pad_1: u32,
}

// A bone that a vertex follows.
struct Influence {
    bone: u32,
    weight: f32,
}

@group(0) @binding(37) var<uniform> skinned: Skinned;
// The motions of the bones: three rows each for `blend_matrices`; the two quaternions and the
// columns of the stretch for `blend_duals`.
@group(0) @binding(38) var<storage, read> bones: array<vec4f>;
// The first of each vertex, then the second of each.
@group(0) @binding(39) var<storage, read> influences: array<Influence>;
// Three numbers for each vertex.
@group(0) @binding(40) var<storage, read> bound: array<f32>;
@group(0) @binding(41) var<storage, read_write> posed: array<f32>;

fn bound_at(vertex: u32) -> vec3f {
    return vec3f(bound[3u * vertex], bound[3u * vertex + 1u], bound[3u * vertex + 2u]);
}

fn set_posed(vertex: u32, x: vec3f) {
    posed[3u * vertex] = x.x;
    posed[3u * vertex + 1u] = x.y;
    posed[3u * vertex + 2u] = x.z;
}

// x = (Σ w_b M_b) v.
@compute @workgroup_size(CELLS_GROUP)
fn blend_matrices(@builtin(global_invocation_id) id: vec3u) {
    for (var vertex = id.x; vertex < skinned.vertices; vertex += LIST_THREADS) {
        var x = vec4f();
        var y = vec4f();
        var z = vec4f();
        for (var i = 0u; i < skinned.influences; i++) {
            let own = influences[i * skinned.vertices + vertex];
            let at = LINEAR_VECTORS * own.bone;
            x += own.weight * bones[at];
            y += own.weight * bones[at + 1u];
            z += own.weight * bones[at + 2u];
        }
        let v = vec4f(bound_at(vertex), 1.0);
        set_posed(vertex, vec3f(dot(x, v), dot(y, v), dot(z, v)));
    }
}

// x = (Σ w_b D_b / |Σ w_b D_b|) Σ w_b A_b v.
@compute @workgroup_size(CELLS_GROUP)
fn blend_duals(@builtin(global_invocation_id) id: vec3u) {
    for (var vertex = id.x; vertex < skinned.vertices; vertex += LIST_THREADS) {
        let v = bound_at(vertex);
        var real = vec4f();
        var dual = vec4f();
        var stretched = vec3f();
        for (var i = 0u; i < skinned.influences; i++) {
            let own = influences[i * skinned.vertices + vertex];
            let at = DUAL_VECTORS * own.bone;
            // The sign that is nearest to the sum so far.
            let weight = select(own.weight, -own.weight, dot(real, bones[at]) < 0.0);
            real += weight * bones[at];
            dual += weight * bones[at + 1u];
            let stretch = mat3x3f(bones[at + 2u].xyz, bones[at + 3u].xyz, bones[at + 4u].xyz);
            stretched += own.weight * (stretch * v);
        }
        let inverse = 1.0 / sqrt(dot(real, real));
        real *= inverse;
        dual *= inverse;
        let twice = 2.0 * cross(real.xyz, stretched);
        let turned = stretched + real.w * twice + cross(real.xyz, twice);
        // Twice the vector of the dual part times the conjugate of the real part.
        let shift = real.w * dual.xyz - dual.w * real.xyz + cross(real.xyz, dual.xyz);
        set_posed(vertex, turned + 2.0 * shift);
    }
}
