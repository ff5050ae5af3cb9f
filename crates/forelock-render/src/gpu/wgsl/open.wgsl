// The share of ambient light that reaches each cell: the twin of `openness`.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(7) var<storage, read_write> grids: array<f32>;

@compute @workgroup_size(THREADS)
fn open(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let cell = thread_of(group, groups, local);
    let cells = frame.open_size.x * frame.open_size.y * frame.open_size.z;
    if cell >= cells {
        return;
    }
    // The depths along all directions follow the grid.
    var sum = 0.0;
    for (var n = 1u; n <= OPEN_DIRECTIONS; n += 1u) {
        sum += exp(-grids[frame.open_start + n * cells + cell]);
    }
    grids[frame.open_start + cell] = sum / f32(OPEN_DIRECTIONS);
}
