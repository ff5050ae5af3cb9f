// From the outputs of a network of strands to the targets of particles. A thread places a strand.

struct Placing {
    // From rest positions to positions relative to the frame's origin.
    pose: mat4x4f,
    // Whether outputs are displacements; else they are rotations.
    displaces: u32,
}

@group(0) @binding(40) var<uniform> placing: Placing;
@group(0) @binding(45) var<storage, read> outputs: array<f32>;
// For each block where its blends begin; OWN where its edges are the network's.
@group(0) @binding(46) var<storage, read> blend_starts: array<u32>;
// The network's edges whose outputs an edge takes, and the first row of their weights.
@group(0) @binding(47) var<storage, read> blends: array<Blend>;
// A row of LANES for each edge that a blend takes.
@group(0) @binding(48) var<storage, read> blend_weights: array<f32>;

struct Blend {
    first: u32,
    count: u32,
    weights: u32,
}

const OUTPUTS: u32 = 72u;
const OWN: u32 = 0xffffffffu;

// The network's output of its edge `k`.
fn own_output(strand: Strand, k: u32) -> vec3f {
    let at = ((strand.block / 4u * OUTPUTS + 3u * k) * 4u + strand.block % 4u) * LANES + strand.lane;
    return vec3f(outputs[at], outputs[at + 4u * LANES], outputs[at + 8u * LANES]);
}

// The output of edge `i`.
fn output_of(strand: Strand, i: u32) -> vec3f {
    let start = blend_starts[strand.block];
    if start == OWN {
        return own_output(strand, i);
    }
    let blend = blends[start + i];
    var sum = vec3f(0.0);
    for (var k = 0u; k < blend.count; k++) {
        sum += blend_weights[(blend.weights + k) * LANES + strand.lane] * own_output(strand, blend.first + k);
    }
    return sum;
}

@compute @workgroup_size(WORKGROUP)
fn place_strands(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    var before = rest_at(strand, 0u);
    var x = (placing.pose * vec4f(before, 1.0)).xyz;
    set_channel_vector(channel_entry(strand, 0u, 0u), x);
    var arc = 0.0;
    for (var i = 1u; i < strand.particles; i++) {
        let rest = rest_at(strand, i);
        let edge = rest - before;
        let o = output_of(strand, i - 1u);
        if placing.displaces != 0u {
            arc += sqrt(dot(edge, edge));
            x = (placing.pose * vec4f(rest + arc * o, 1.0)).xyz;
        } else {
            // By 2 atan |o| about o.
            let across = cross(o, edge);
            let turned = edge + 2.0 / (1.0 + dot(o, o)) * (across + cross(o, across));
            x += (placing.pose * vec4f(turned, 0.0)).xyz;
        }
        set_channel_vector(channel_entry(strand, i, 0u), x);
        before = rest;
    }
}
