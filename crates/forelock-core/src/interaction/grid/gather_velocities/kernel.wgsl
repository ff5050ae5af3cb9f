// Grid to particle, one strand a thread: the GPU counterpart of `gather_velocities`.

@group(0) @binding(15) var<storage, read> faces: array<vec2f>;

// New velocity and change of velocity at a point.
struct GridSample {
    next: vec3f,
    change: vec3f,
}

fn sample_grid(at: vec3f) -> GridSample {
    var grid_sample = GridSample();
    for (var axis = 0u; axis < 3u; axis++) {
        let corners = stencil(at, axis);
        var sum = vec2f();
        for (var corner = 0u; corner < 8u; corner++) {
            sum += corner_weight(corners.f, corner) * faces[plane(axis, corner_place(corners, corner))];
        }
        grid_sample.next[axis] = sum.x;
        grid_sample.change[axis] = sum.y;
    }
    return grid_sample;
}

// Adds the mean change of the samples of a particle, unless it is clamped.
fn add_change(strand: Strand, i: u32, sum: vec4f, displaces: bool) {
    if i < frame.clamped {
        return;
    }
    let change = (transpose(grid.axes) * vec4f(sum.xyz / max(sum.w, 1e-37), 0.0)).xyz;
    if displaces {
        set_position(strand, i, position_at(strand, i) + change);
        let at = entry(strand, i, 2u, 1u);
        if memory[at] >= 0.0 {
            memory[at] = max(memory[at] - length(change), 0.0);
        }
    } else {
        set_velocity(strand, i, velocity_at(strand, i) + change);
    }
}

fn gather(strand: Strand, displaces: bool) {
    let points = blocks[strand.block].points;
    let share = 1.0 / f32(points);
    let root = position_at(strand, 0u);
    var start = in_cells(root);
    var start_velocity = on_grid(root, velocity_at(strand, 0u));
    var start_sum = vec4f();
    for (var edge = 0u; edge + 1u < strand.particles; edge++) {
        let x = position_at(strand, edge + 1u);
        let end = in_cells(x);
        let end_velocity = on_grid(x, velocity_at(strand, edge + 1u));
        var end_sum = vec4f();
        let mass = rest_length(strand, edge, 1u) * share;
        for (var point = 0u; point < points; point++) {
            let along = (f32(point) + 0.5) * share;
            let at = start + along * (end - start);
            var change = vec3f();
            if holds(at) {
                let grid_sample = sample_grid(at);
                change = grid_sample.change;
                if !displaces {
                    let velocity = start_velocity + along * (end_velocity - start_velocity);
                    change += grid.pic * (grid_sample.next - grid_sample.change - velocity);
                }
            }
            start_sum += mass * (1.0 - along) * vec4f(change, 1.0);
            end_sum += mass * along * vec4f(change, 1.0);
        }
        add_change(strand, edge, start_sum, displaces);
        start = end;
        start_velocity = end_velocity;
        start_sum = end_sum;
    }
    add_change(strand, strand.particles - 1u, start_sum, displaces);
}

@compute @workgroup_size(WORKGROUP)
fn gather_velocities(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if strand.here {
        gather(strand, false);
    }
}

// Does nothing if no cell is over-full.
@compute @workgroup_size(WORKGROUP)
fn gather_displacements(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if strand.here && bitcast<f32>(atomicLoad(&bounds.fullest)) > 1.0 && grid.expand > 0.0 {
        gather(strand, true);
    }
}
