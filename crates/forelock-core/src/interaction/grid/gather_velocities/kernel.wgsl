// Grid to particle, one strand a thread: the GPU counterpart of `gather_velocities`.

@group(0) @binding(15) var<storage, read> nodes: array<vec4f>;

// What is summed over the samples of a particle: changes of velocity and displacements, along the
// axes of the grid, times weights.
struct GridSum {
    change: vec3f,
    shift: vec3f,
    weight: f32,
}

fn sample_grid(at: vec3f, velocity: vec3f) -> GridSum {
    var sum = GridSum();
    if holds(at) {
        let corners = stencil(at);
        for (var corner = 0u; corner < 8u; corner++) {
            let weight = corner_weight(corners.f, corner);
            let place = 2u * corner_place(corners, corner);
            sum.change += weight * nodes[place].xyz;
            sum.shift += weight * nodes[place + 1u].xyz;
        }
        sum.change -= grid.pic * velocity;
    }
    return sum;
}

fn add_weighted(sum: GridSum, weight: f32, sampled: GridSum) -> GridSum {
    return GridSum(sum.change + weight * sampled.change, sum.shift + weight * sampled.shift, sum.weight + weight);
}

// Adds the mean of the samples of a particle, unless it is clamped.
fn add_change(strand: Strand, i: u32, sum: GridSum, displaces: bool) {
    if i < frame.clamped {
        return;
    }
    let weight = max(sum.weight, 1e-37);
    let axes = transpose(grid.axes);
    set_velocity(strand, i, velocity_at(strand, i) + (axes * vec4f(sum.change / weight, 0.0)).xyz);
    if displaces {
        let shift = (axes * vec4f(sum.shift / weight, 0.0)).xyz;
        set_position(strand, i, position_at(strand, i) + shift);
        let at = entry(strand, i, 2u, 1u);
        if memory[at] >= 0.0 {
            memory[at] = max(memory[at] - length(shift), 0.0);
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn gather_velocities(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let displaces = bitcast<f32>(atomicLoad(&bounds.densest)) > 1.0 && grid.expand > 0.0;
    let points = blocks[strand.block].points;
    let share = 1.0 / f32(points);
    let root = position_at(strand, 0u);
    var start = in_cells(root);
    var start_velocity = on_grid(root, velocity_at(strand, 0u));
    var start_sum = GridSum();
    for (var edge = 0u; edge + 1u < strand.particles; edge++) {
        let x = position_at(strand, edge + 1u);
        let end = in_cells(x);
        let end_velocity = on_grid(x, velocity_at(strand, edge + 1u));
        var end_sum = GridSum();
        let mass = rest_length(strand, edge, 1u) * share;
        for (var point = 0u; point < points; point++) {
            let along = (f32(point) + 0.5) * share;
            let at = start + along * (end - start);
            let sampled = sample_grid(at, start_velocity + along * (end_velocity - start_velocity));
            start_sum = add_weighted(start_sum, mass * (1.0 - along), sampled);
            end_sum = add_weighted(end_sum, mass * along, sampled);
        }
        add_change(strand, edge, start_sum, displaces);
        start = end;
        start_velocity = end_velocity;
        start_sum = end_sum;
    }
    add_change(strand, strand.particles - 1u, start_sum, displaces);
}
