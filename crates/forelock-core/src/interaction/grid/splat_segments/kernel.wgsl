// Particle to grid, one strand a thread: the GPU counterpart of `splat_segments` and of
// `grid::Bounds::around`.
//
// Sums are of integers, so that they do not depend on the order of threads: 2²² to the unit in 32
// bits, that is, up to 512 units. A unit is all the hair in the densest cell at rest, or that times
// a metre a second, or the volume V or V φ₀ of the cell at rest that has most of it.

@group(0) @binding(12) var<storage, read> volumes: array<f32>;
@group(0) @binding(13) var<storage, read_write> cells: array<atomic<i32>>;

// The extent of the hair. Reading first spares most threads the atomic write.
@compute @workgroup_size(WORKGROUP)
fn measure_hair(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let own = extent_of(strand, grid.place, vec3f());
    for (var c = 0u; c < 3u; c++) {
        let least = ordered(own.low[c]);
        if is_least(least) && least < atomicLoad(&bounds.extent[c]) {
            atomicMin(&bounds.extent[c], least);
        }
        let greatest = ordered(own.high[c]);
        if is_greatest(greatest) && greatest > atomicLoad(&bounds.extent[3u + c]) {
            atomicMax(&bounds.extent[3u + c], greatest);
        }
    }
}

// The box around the hair. If it exceeds the capacity, its longest sides are cut, on the side
// farther from the origin.
@compute @workgroup_size(1)
fn fit_grid() {
    var low = vec3i();
    var high = vec3i();
    for (var c = 0u; c < 3u; c++) {
        var lowest = unordered(atomicExchange(&bounds.extent[c], 0xffffffffu));
        var highest = unordered(atomicExchange(&bounds.extent[3u + c], 0u));
        // No coordinate was finite.
        if !(lowest <= highest) {
            lowest = 0.0;
            highest = 0.0;
        }
        low[c] = i32(floor(clamp(lowest, -MOST_OUT, MOST_OUT))) - MARGIN;
        high[c] = i32(floor(clamp(highest, -MOST_OUT, MOST_OUT))) + 1 + MARGIN;
    }
    for (;;) {
        let side = high - low;
        // The product of all three may overflow.
        if u32(side.x * side.y) <= grid.capacity / u32(side.z) {
            break;
        }
        var longest = 0u;
        for (var c = 1u; c < 3u; c++) {
            if side[c] >= side[longest] {
                longest = c;
            }
        }
        if -low[longest] > high[longest] {
            low[longest] += 1;
        } else {
            high[longest] -= 1;
        }
    }
    bounds.low = low;
    bounds.dims = vec3u(high - low);
    bounds.layer = bounds.dims.x * bounds.dims.y;
    bounds.count = bounds.layer * bounds.dims.z;
    atomicStore(&bounds.densest, 0u);
    atomicStore(&bounds.held, 0u);
    bounds.sweeps = 0u;
    bounds.residual = 0.0;
    clear_list();
}

@compute @workgroup_size(CELLS_GROUP)
fn clear_grid(@builtin(global_invocation_id) id: vec3u) {
    for (var at = id.x; at < bounds.count; at += CELLS_THREADS) {
        for (var number = 0u; number <= AT_REST; number++) {
            atomicStore(&cells[plane(number, at)], 0);
        }
    }
}

fn add(number: u32, at: u32, value: f32) {
    atomicAdd(&cells[plane(number, at)], i32(round(value * SCALE)));
}

fn splat_sample(at: vec3f, mass: f32, velocity: vec3f, volume: vec2f) {
    let share = mass / grid.unit * vec4f(velocity, 1.0);
    let volumes = volume / grid.volumes;
    let own = stencil(at);
    for (var corner = 0u; corner < 8u; corner++) {
        let place = corner_place(own, corner);
        let weight = corner_weight(own.f, corner);
        for (var number = 0u; number < 4u; number++) {
            add(MOMENTUM + number, place, weight * share[number]);
        }
        add(FILLED, place, weight * volumes.x);
        add(AT_REST, place, weight * volumes.y);
    }
}

@compute @workgroup_size(WORKGROUP)
fn splat_segments(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let points = blocks[strand.block].points;
    let share = 1.0 / f32(points);
    let root = position_at(strand, 0u);
    var start = in_cells(root);
    var start_velocity = on_grid(root, velocity_at(strand, 0u));
    for (var edge = 0u; edge + 1u < strand.particles; edge++) {
        let x = position_at(strand, edge + 1u);
        let end = in_cells(x);
        let end_velocity = on_grid(x, velocity_at(strand, edge + 1u));
        let mass = rest_length(strand, edge, 1u) * share;
        let at = entry(strand, edge, 2u, 0u);
        let volume = vec2f(volumes[at], volumes[at + LANES]) * share;
        for (var point = 0u; point < points; point++) {
            let along = (f32(point) + 0.5) * share;
            let at = start + along * (end - start);
            let velocity = start_velocity + along * (end_velocity - start_velocity);
            if all_finite(velocity) && holds(at) {
                splat_sample(at, mass, clamp(velocity, vec3f(-FASTEST), vec3f(FASTEST)), volume);
            }
        }
        start = end;
        start_velocity = end_velocity;
    }
}
