// The surfaces of bodies, one thread a triangle: the twin of `deposit_solids`.


@compute @workgroup_size(THREADS)
fn deposit_bodies(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let face = thread_of(group, groups, local);
    if face >= frame.faces || frame.open_cell == 0.0 {
        return;
    }
    let a = place_of(face, 0u);
    let u = place_of(face, 1u) - a;
    let v = place_of(face, 2u) - a;
    let area = 0.5 * length(cross(u, v));
    let longest = max(length(u), max(length(v), distance(u, v)));
    let rows = clamp(ceil(longest / frame.open_cell), 1.0, 64.0);
    let share = SURFACE_DEPTH * area / (rows * rows);
    for (var i = 0.0; i < rows; i += 1.0) {
        for (var j = 0.0; j < rows - i; j += 1.0) {
            add(1u, a + (u * (i + 1.0 / 3.0) + v * (j + 1.0 / 3.0)) / rows, share);
            if i + j + 1.0 < rows {
                add(1u, a + (u * (i + 2.0 / 3.0) + v * (j + 2.0 / 3.0)) / rows, share);
            }
        }
    }
}
