// Motions of roots that the device computes, to where kernels read them: the GPU counterpart of
// `pack_frames`. After `groom::SURFACE_WGSL`.

// The buffer of the model, whose last ROOT_ROWS rows a block they are.
@group(0) @binding(51) var<storage, read_write> packed: array<f32>;

fn set_packed(at: u32, turn: vec4f, shift: vec3f) {
    for (var k = 0u; k < 4u; k++) {
        packed[at + k * LANES] = turn[k];
    }
    for (var k = 0u; k < 3u; k++) {
        packed[at + (4u + k) * LANES] = shift[k];
    }
}

// A thread is a lane of a block, also one that repeats a strand.
@compute @workgroup_size(WORKGROUP)
fn pack_frames(@builtin(global_invocation_id) id: vec3u) {
    let count = arrayLength(&blocks);
    let block = id.x / LANES;
    if block >= count {
        return;
    }
    let lane = id.x % LANES;
    let root = 2u * (blocks[block].number * LANES + lane);
    let turn = root_frames[surface.start + root];
    let turned = root_frames[surface.end + root];
    let first = arrayLength(&packed) - ROOT_ROWS * LANES * count + ROOT_ROWS * LANES * block + lane;
    set_packed(first, turn, root_frames[surface.start + root + 1u].xyz);
    let nearest = select(turned, -turned, dot(turn, turned) < 0.0);
    set_packed(first + (ROOT_ROWS / 2u) * LANES, nearest, root_frames[surface.end + root + 1u].xyz);
}
