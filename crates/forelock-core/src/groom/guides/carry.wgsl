
// The skinning data of a particle: on each guide the index in `motions` of the particle before it
// (the next particle's entry is one row later) and the fraction between both; the guides' weights.
struct Carried {
    entries: vec4u,
    fractions: vec4f,
    weights: vec4f,
    rest: vec3f,
    pad_0: f32,
}

@group(0) @binding(23) var<storage, read> carried: array<Carried>;
// Three numbers for each particle.
@group(0) @binding(24) var<storage, read_write> placed: array<f32>;

fn moved_by(at: u32, rest: vec3f) -> vec3f {
    return rotated(motions[2u * at], rest) + motions[2u * at + 1u].xyz;
}

// Σ_g w_g ((1 − t) T_g,j + t T_g,j+1) x̄. Each thread processes one particle per iteration.
@compute @workgroup_size(CELLS_GROUP)
fn carry_strands(@builtin(global_invocation_id) id: vec3u) {
    for (var p = id.x; p < skin.count; p += CELLS_THREADS) {
        let rest = carried[p].rest;
        var sum = vec3f();
        for (var guide = 0u; guide < 4u; guide++) {
            let weight = carried[p].weights[guide];
            if weight > 0.0 {
                let at = carried[p].entries[guide];
                sum += weight * mix(moved_by(at, rest), moved_by(at + LANES, rest), carried[p].fractions[guide]);
            }
        }
        placed[3u * p] = sum.x;
        placed[3u * p + 1u] = sum.y;
        placed[3u * p + 2u] = sum.z;
    }
}
