// The layers of a network of strands. A workgroup takes a packet, 64 strands: four blocks.
//
// The second layer's 256 units are computed in two halves, the sums of 64 strands × 128 units in
// registers: a thread has eight strands and four units. Both factors pass through workgroup memory,
// sixteen inputs at a time: 16 × 64 activations and 16 × 128 weights, loaded while the sixteen
// before are in use. The last layer takes the units of a half, 16 at a time, from the threads that
// have them: 192 threads have four strands and six outputs each. Both halves at once would read
// the activations once only, but with twice the sums a device keeps fewer threads in flight.
//
// A column of a matrix of sums is a unit of four strands. Nothing is indexed by a variable in
// registers, which would move it to memory.

// Activations before the first ReLU: sums of a strand and sums of the frame.
@group(0) @binding(41) var<storage, read> strand_sums: array<Packed>;
@group(0) @binding(42) var<storage, read> frame_sums: array<f32>;
// Weights of the second layer, then of the last.
@group(0) @binding(43) var<storage, read> weights: array<Packed>;
@group(0) @binding(44) var<storage, read> biases: array<vec4f>;
// Of each packet, a row of 64 strands for each output.
@group(0) @binding(45) var<storage, read_write> outputs: array<vec4f>;

const QUADS: u32 = WIDTH / 4u;
const OUTPUTS: u32 = 72u;
// Outputs of a thread, which are stored as two quads of three and a zero.
const OWN: u32 = 6u;
const GROUPS: u32 = OUTPUTS / OWN;
// Weights of the last layer of a unit, in quads.
const LAST: u32 = 2u * GROUPS;
// Units of a half, in quads.
const HALF: u32 = QUADS / 2u;
const INPUTS: u32 = 16u;
// Where weights begin in workgroup memory, in either layer.
const WEIGHTS: u32 = 16u * INPUTS;

var<workgroup> tile: array<vec4f, WEIGHTS + INPUTS * HALF>;

// What a thread adds to four strands × four units of an input with the activations `x`.
fn added(s: mat4x4f, x: vec4f, w: vec4f) -> mat4x4f {
    return mat4x4f(
        fma(x, vec4f(w.x), s[0]),
        fma(x, vec4f(w.y), s[1]),
        fma(x, vec4f(w.z), s[2]),
        fma(x, vec4f(w.w), s[3]),
    );
}

// The same of four strands × three outputs.
fn added_three(s: mat3x4f, x: vec4f, w: vec4f) -> mat3x4f {
    return mat3x4f(fma(x, vec4f(w.x), s[0]), fma(x, vec4f(w.y), s[1]), fma(x, vec4f(w.z), s[2]));
}

fn biased(bias: vec4f) -> mat4x4f {
    return mat4x4f(vec4f(bias.x), vec4f(bias.y), vec4f(bias.z), vec4f(bias.w));
}

fn biased_three(bias: vec4f) -> mat3x4f {
    return mat3x4f(vec4f(bias.x), vec4f(bias.y), vec4f(bias.z));
}

// Four units of four strands after the ReLU.
fn write_units(at: u32, s: mat4x4f) {
    tile[at] = max(s[0], vec4f(0.0));
    tile[at + 16u] = max(s[1], vec4f(0.0));
    tile[at + 32u] = max(s[2], vec4f(0.0));
    tile[at + 48u] = max(s[3], vec4f(0.0));
}

fn write_outputs(at: u32, s: mat3x4f) {
    outputs[at] = s[0];
    outputs[at + 16u] = s[1];
    outputs[at + 32u] = s[2];
}

// Rows `first` to `first` + 16 of the activations, one number of four strands a thread.
fn activations(group: u32, first: u32, id: u32) -> vec4f {
    let sums = unpacked(strand_sums[(group * WIDTH + first) * 16u + id]);
    return max(sums + frame_sums[first + id / 16u], vec4f(0.0));
}

// The same rows of a half's weights, two quads a thread.
fn half_weights(half: u32, first: u32, id: u32) -> array<vec4f, 2> {
    let at = (first + id / HALF) * QUADS + half * HALF + id % HALF;
    return array(unpacked(weights[at]), unpacked(weights[at + 8u * QUADS]));
}

@compute @workgroup_size(256)
fn predict_outputs(@builtin(local_invocation_index) id: u32, @builtin(workgroup_id) group: vec3u) {
    // The thread's quad of units in a half, and the quads s and s + 1 of strands.
    let u = id % HALF;
    let s = id / HALF * 2u;
    // In the last layer a group of outputs, of a quad of strands.
    let g = id / 16u;
    let column = id % 16u;
    let places_outputs = g < GROUPS;
    let own = 2u * min(g, GROUPS - 1u);
    var c0 = biased_three(biases[QUADS + own]);
    var c1 = biased_three(biases[QUADS + own + 1u]);
    for (var half = 0u; half < 2u; half++) {
        var a0 = biased(biases[half * HALF + u]);
        var a1 = a0;
        var input = activations(group.x, 0u, id);
        var rows = half_weights(half, 0u, id);
        for (var first = 0u; first < WIDTH; first += INPUTS) {
            tile[id] = input;
            tile[WEIGHTS + id] = rows[0];
            tile[WEIGHTS + 256u + id] = rows[1];
            workgroupBarrier();
            if first + INPUTS < WIDTH {
                input = activations(group.x, first + INPUTS, id);
                rows = half_weights(half, first + INPUTS, id);
            }
            for (var k = 0u; k < INPUTS; k++) {
                let w = tile[WEIGHTS + HALF * k + u];
                a0 = added(a0, tile[16u * k + s], w);
                a1 = added(a1, tile[16u * k + s + 1u], w);
            }
            workgroupBarrier();
        }
        for (var first = 0u; first < 4u * HALF; first += 16u) {
            if u / 4u == first / 16u {
                write_units(64u * (u % 4u) + s, a0);
                write_units(64u * (u % 4u) + s + 1u, a1);
            }
            let row = QUADS * WIDTH + (4u * HALF * half + first) * LAST + id;
            tile[WEIGHTS + id] = unpacked(weights[row]);
            if id < 16u * LAST - 256u {
                tile[WEIGHTS + 256u + id] = unpacked(weights[row + 256u]);
            }
            workgroupBarrier();
            if places_outputs {
                for (var k = 0u; k < 16u; k++) {
                    let x = tile[16u * k + column];
                    c0 = added_three(c0, x, tile[WEIGHTS + LAST * k + own]);
                    c1 = added_three(c1, x, tile[WEIGHTS + LAST * k + own + 1u]);
                }
            }
            workgroupBarrier();
        }
    }
    if places_outputs {
        let at = (group.x * OUTPUTS + OWN * g) * 16u + column;
        write_outputs(at, c0);
        write_outputs(at + 48u, c1);
    }
}
