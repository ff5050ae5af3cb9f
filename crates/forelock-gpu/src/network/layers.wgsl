// The layers of a network of strands. A workgroup takes a packet, 64 strands: four blocks.
//
// The second layer's sums, 64 strands × 256 units, are in registers: a thread has four strands and
// 16 units, the quads u + 16 j of four units each. Both factors pass through workgroup memory,
// eight inputs at a time: 8 × 64 activations and 8 × 256 weights. The last layer takes the units 16
// at a time from the threads that have them: 192 threads have four strands and six outputs each.

// Activations before the first ReLU: sums of a strand and sums of the frame.
@group(0) @binding(41) var<storage, read> strand_sums: array<Packed>;
@group(0) @binding(42) var<storage, read> frame_sums: array<f32>;
// Weights of the second layer, then of the last: six outputs and two zeros for each of 12 threads.
@group(0) @binding(43) var<storage, read> weights: array<Packed>;
@group(0) @binding(44) var<storage, read> biases: array<vec4f>;
// Of each packet, a row of 64 strands for each output.
@group(0) @binding(45) var<storage, read_write> outputs: array<vec4f>;

const QUADS: u32 = WIDTH / 4u;
// Rows of weights of the last layer, in quads.
const LAST: u32 = 24u;
const OUTPUTS: u32 = 72u;
const INPUTS: u32 = 8u;

var<workgroup> tile: array<vec4f, 640>;

@compute @workgroup_size(256)
fn predict_outputs(@builtin(local_invocation_index) id: u32, @builtin(workgroup_id) group: vec3u) {
    let u = id % 16u;
    let strands = id / 16u;
    var sums: array<vec4f, 16>;
    for (var j = 0u; j < 4u; j++) {
        let bias = biases[u + 16u * j];
        for (var s = 0u; s < 4u; s++) {
            sums[4u * j + s] = bias;
        }
    }
    for (var first = 0u; first < WIDTH; first += INPUTS) {
        if id < 16u * INPUTS {
            let k = first + id / 16u;
            let sum = unpacked(strand_sums[(group.x * WIDTH + k) * 16u + id % 16u]);
            tile[id] = max(sum + frame_sums[k], vec4f(0.0));
        }
        for (var part = 0u; part < INPUTS * QUADS; part += 256u) {
            tile[16u * INPUTS + part + id] = unpacked(weights[first * QUADS + part + id]);
        }
        workgroupBarrier();
        for (var k = 0u; k < INPUTS; k++) {
            let x = tile[16u * k + strands];
            for (var j = 0u; j < 4u; j++) {
                let w = tile[16u * INPUTS + k * QUADS + u + 16u * j];
                sums[4u * j] += x.x * w;
                sums[4u * j + 1u] += x.y * w;
                sums[4u * j + 2u] += x.z * w;
                sums[4u * j + 3u] += x.w * w;
            }
        }
        workgroupBarrier();
    }
    // The last layer: this thread's six outputs of four strands.
    let g = id % 12u;
    let column = id / 12u;
    var found: array<vec4f, 6>;
    for (var o = 0u; o < 6u; o++) {
        found[o] = vec4f(biases[QUADS + 2u * g + o / 4u][o % 4u]);
    }
    for (var j = 0u; j < 4u; j++) {
        let units = array(sums[4u * j], sums[4u * j + 1u], sums[4u * j + 2u], sums[4u * j + 3u]);
        for (var quarter = 0u; quarter < 4u; quarter++) {
            if u / 4u == quarter {
                for (var c = 0u; c < 4u; c++) {
                    let x = vec4f(units[0][c], units[1][c], units[2][c], units[3][c]);
                    tile[(4u * (u % 4u) + c) * 16u + strands] = max(x, vec4f(0.0));
                }
            }
            let first = QUADS * WIDTH + (64u * j + 16u * quarter) * LAST;
            for (var at = id; at < 16u * LAST; at += 256u) {
                tile[256u + at] = unpacked(weights[first + at]);
            }
            workgroupBarrier();
            if id < 192u {
                for (var k = 0u; k < 16u; k++) {
                    let x = tile[16u * k + column];
                    let a = tile[256u + LAST * k + 2u * g];
                    let b = tile[256u + LAST * k + 2u * g + 1u];
                    found[0] += x * a.x;
                    found[1] += x * a.y;
                    found[2] += x * a.z;
                    found[3] += x * a.w;
                    found[4] += x * b.x;
                    found[5] += x * b.y;
                }
            }
            workgroupBarrier();
        }
    }
    if id < 192u {
        for (var o = 0u; o < 6u; o++) {
            outputs[(group.x * OUTPUTS + 6u * g + o) * 16u + column] = found[o];
        }
    }
}
