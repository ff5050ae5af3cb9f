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

// Sums of a workgroup in its own memory, a hash table of nodes: strands that lie side by side meet
// at the same nodes. Only its sums go to `cells`, so an atomic addition to memory stands for
// many samples. Samples that find no slot are added to `cells` directly. Sums of integers do not
// depend on which way they go.

// The node of a slot plus one; 0 if it is free.
var<workgroup> keys: array<atomic<u32>, SLOTS>;
// Six numbers a slot, number by number.
var<workgroup> slot_sums: array<atomic<i32>, SLOT_NUMBERS>;

// The slot of a node, or SLOTS if there is none. A node may have two slots: both are added up.
fn slot_of(node: u32) -> u32 {
    let key = node + 1u;
    var slot = (node * 2654435769u) / (0xffffffffu / SLOTS + 1u);
    for (var probe = 0u; probe < PROBES; probe++) {
        var held = atomicLoad(&keys[slot]);
        if held == 0u {
            let exchange = atomicCompareExchangeWeak(&keys[slot], 0u, key);
            held = select(exchange.old_value, key, exchange.exchanged);
        }
        if held == key {
            return slot;
        }
        slot = (slot + 1u) % SLOTS;
    }
    return SLOTS;
}

// Adds a number of the slot `slot`, or of the node `node` if there is none.
fn add(number: u32, slot: u32, node: u32, value: f32) {
    let share = i32(round(value * SCALE));
    if slot < SLOTS {
        atomicAdd(&slot_sums[number * SLOTS + slot], share);
    } else {
        atomicAdd(&cells[plane(number, node)], share);
    }
}

fn splat_sample(at: vec3f, mass: f32, velocity: vec3f, volume: vec2f) {
    let share = mass / grid.unit * vec4f(velocity, 1.0);
    let volumes = volume / grid.volumes;
    let own = stencil(at);
    for (var corner = 0u; corner < 8u; corner++) {
        let node = corner_place(own, corner);
        let slot = slot_of(node);
        let weight = corner_weight(own.f, corner);
        for (var number = 0u; number < 4u; number++) {
            add(MOMENTUM + number, slot, node, weight * share[number]);
        }
        add(FILLED, slot, node, weight * volumes.x);
        add(AT_REST, slot, node, weight * volumes.y);
    }
}

// Adds the sums of the workgroup to `cells`, and clears them.
fn flush_sums(thread: u32) {
    for (var slot = thread; slot < SLOTS; slot += WORKGROUP) {
        let key = atomicExchange(&keys[slot], 0u);
        if key == 0u {
            continue;
        }
        for (var number = 0u; number < SLOT_NUMBERS / SLOTS; number++) {
            let sum = atomicExchange(&slot_sums[number * SLOTS + slot], 0);
            if sum != 0 {
                atomicAdd(&cells[plane(MOMENTUM + number, key - 1u)], sum);
            }
        }
    }
}

// Splats the samples of the edge that starts at particle `edge`.
fn splat_edge(strand: Strand, edge: u32) {
    let points = blocks[strand.block].points;
    let share = 1.0 / f32(points);
    let x = array(position_at(strand, edge), position_at(strand, edge + 1u));
    let ends = array(in_cells(x[0]), in_cells(x[1]));
    let velocities = array(
        on_grid(x[0], velocity_at(strand, edge)),
        on_grid(x[1], velocity_at(strand, edge + 1u)),
    );
    let mass = rest_length(strand, edge, 1u) * share;
    let row = entry(strand, edge, 2u, 0u);
    let volume = vec2f(volumes[row], volumes[row + LANES]) * share;
    for (var point = 0u; point < points; point++) {
        let along = (f32(point) + 0.5) * share;
        let at = ends[0] + along * (ends[1] - ends[0]);
        let velocity = velocities[0] + along * (velocities[1] - velocities[0]);
        if all_finite(velocity) && holds(at) {
            splat_sample(at, mass, clamp(velocity, vec3f(-FASTEST), vec3f(FASTEST)), volume);
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn splat_segments(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3u,
) {
    let strand = strand_of(id.x);
    for (var slot = thread; slot < SLOTS; slot += WORKGROUP) {
        atomicStore(&keys[slot], 0u);
    }
    for (var at = thread; at < SLOT_NUMBERS; at += WORKGROUP) {
        atomicStore(&slot_sums[at], 0);
    }
    workgroupBarrier();
    // The most particles of a strand of the workgroup: the same for all of its threads.
    var most = 0u;
    for (var lane = 0u; lane < WORKGROUP; lane += LANES) {
        most = max(most, blocks[min((group.x * WORKGROUP + lane) / LANES, arrayLength(&blocks) - 1u)].particles);
    }
    for (var first = 0u; first + 1u < most; first += FLUSH_EDGES) {
        for (var edge = first; strand.here && edge < first + FLUSH_EDGES && edge + 1u < strand.particles; edge++) {
            splat_edge(strand, edge);
        }
        workgroupBarrier();
        flush_sums(thread);
        workgroupBarrier();
    }
}
