// The search of contacts among all strands, first part: the mean motion, the active segments, the
// layout of the cells. The GPU counterpart of `find_contacts`.
//
// No result depends on the order of threads: sums are of integers, a full list keeps its greatest
// entries, and a list whose order varies is only used as a whole.

fn rest_of(number: u32) -> vec3f {
    let at = row_of(number, MODEL_ROWS, 0u);
    return vec3f(rest[at], rest[at + LANES], rest[at + 2u * LANES]);
}

// The number of pieces of a segment.
fn own_pieces_of(segment: u32) -> u32 {
    return pieces_of(rest[row_of(segment, MODEL_ROWS, 3u)]);
}

// Fits the box of the frame and resets the search.
@compute @workgroup_size(1)
fn fit_mean_motion() {
    fit_nodes(contacts.spacing);
}

// The same for friction, which acts between neighbours, however long their edges are.
@compute @workgroup_size(1)
fn fit_friction() {
    fit_nodes(FRICTION_SPACING);
}

fn fit_nodes(least_spacing: f32) {
    var low = vec3f();
    var high = vec3f();
    for (var c = 0u; c < 3u; c++) {
        low[c] = unordered(atomicExchange(&touch.extent[c], NOTHING));
        high[c] = unordered(atomicExchange(&touch.extent[3u + c], 0u));
    }
    // No position was near the head.
    if !all(low <= high) {
        low = vec3f();
        high = vec3f();
    }
    let size = high - low;
    touch.low = low;
    touch.high = high;
    touch.spacing = max(least_spacing, max(size.x, max(size.y, size.z)) / f32(MEAN_MOTION_NODES - 2u));
    touch.dims = min(vec3u(size / touch.spacing) + 2u, vec3u(MEAN_MOTION_NODES + 1u));
    touch.slices = 0u;
    touch.slice = 0u;
    atomicStore(&touch.squares[0], 0u);
    atomicStore(&touch.squares[1], 0u);
    atomicStore(&touch.fastest, 0u);
    atomicStore(&touch.actives, 0u);
    atomicStore(&touch.joints, 0u);
    atomicStore(&touch.farthest, 0u);
    atomicStore(&report.contacts, 0u);
}

fn node_count() -> u32 {
    return touch.dims.x * touch.dims.y * touch.dims.z;
}

@compute @workgroup_size(CELLS_GROUP)
fn clear_mean_motion(@builtin(global_invocation_id) id: vec3u) {
    for (var at = id.x; at < 8u * node_count(); at += LIST_THREADS) {
        atomicStore(&table[at], 0u);
    }
}

fn set_node(node: u32, mean: vec3f) {
    let at = contacts.bodies + 4u * node;
    for (var c = 0u; c < 3u; c++) {
        set_real(at + c, mean[c]);
    }
}

// Turns sums into means over each node and its neighbours.
@compute @workgroup_size(CELLS_GROUP)
fn smooth_mean_motion(@builtin(global_invocation_id) id: vec3u) {
    let side = side_of_box();
    for (var at = id.x; at < node_count(); at += LIST_THREADS) {
        let node = vec3u(at % touch.dims.x, at / touch.dims.x % touch.dims.y, at / (touch.dims.x * touch.dims.y));
        let first = max(node, vec3u(1u)) - 1u;
        let last = min(node + 1u, touch.dims - 1u);
        var sum = vec4f();
        for (var z = first.z; z <= last.z; z++) {
            for (var y = first.y; y <= last.y; y++) {
                for (var x = first.x; x <= last.x; x++) {
                    let own = 8u * (x + touch.dims.x * (y + touch.dims.y * z));
                    sum += vec4f(wide(own), wide(own + 2u), wide(own + 4u), wide(own + 6u));
                }
            }
        }
        set_node(at, sum.xyz * (side / max(sum.w, 1.0)));
    }
}

// Turns sums into means at each node alone.
@compute @workgroup_size(CELLS_GROUP)
fn average_nodes(@builtin(global_invocation_id) id: vec3u) {
    for (var at = id.x; at < node_count(); at += LIST_THREADS) {
        set_node(at, mean_of_sums(at));
    }
}

// The last bin of the largest entries, how many of its entries are selected, and how many it has.
var<workgroup> last_of: vec3u;

const OWN_BINS: u32 = BINS / CELLS_GROUP;

// Finds the bin in which the `most` largest entries end, from the top: thread `t` has OWN_BINS
// bins. The caller places the barriers.
fn find_last(t: u32, most: u32) {
    var before = 0u;
    for (var k = 0u; k < t; k++) {
        before += sums[k];
    }
    for (var k = 0u; k < OWN_BINS; k++) {
        let bin = BINS - 1u - (OWN_BINS * t + k);
        let own = atomicLoad(&touch.bins[bin]);
        if before <= most && own > most - before {
            last_of = vec3u(bin, most - before, own);
        }
        before += own;
    }
}

fn sum_bins(t: u32) {
    var own = 0u;
    for (var k = 0u; k < OWN_BINS; k++) {
        own += atomicLoad(&touch.bins[BINS - 1u - (OWN_BINS * t + k)]);
    }
    sums[t] = own;
    if t == 0u {
        last_of = vec3u();
    }
}

fn clear_bins(t: u32) {
    for (var k = 0u; k < OWN_BINS; k++) {
        atomicStore(&touch.bins[BINS - 1u - (OWN_BINS * t + k)], 0u);
    }
}

fn share_of(last: vec3u) -> f32 {
    return select(f32(last.y) / f32(max(last.z, 1u)), 1.0, last.z == 0u);
}

// Selects the active segments and the number of slices of the frame.
@compute @workgroup_size(CELLS_GROUP)
fn select_active(@builtin(local_invocation_index) t: u32) {
    sum_bins(t);
    workgroupBarrier();
    find_last(t, contacts.most_active);
    workgroupBarrier();
    if t == 0u {
        touch.least = 0.5 * contacts.slip;
        touch.bin = last_of.x;
        touch.share = share_of(last_of);
    }
    workgroupBarrier();
    if t == 0u {
        last_of = vec3u();
    }
    workgroupBarrier();
    find_last(t, contacts.few);
    workgroupBarrier();
    if t == 0u {
        let squares = f32(atomicLoad(&touch.squares[1])) * 4294967296.0 + f32(atomicLoad(&touch.squares[0]));
        let typical = sqrt(squares / SQUARE_UNIT * contacts.inverse_particles);
        let most = bitcast<f32>((last_of.x + 1u) << BIN_BITS) / (2.0 * contacts.edge);
        let quiet = bitcast<f32>(atomicLoad(&touch.fastest)) <= touch.least;
        touch.slices = select(u32(clamp(ceil(max(typical, most)), 1.0, f32(SLICES))), 0u, quiet);
    }
    clear_bins(t);
}

@compute @workgroup_size(CELLS_GROUP)
fn clear_cells(@builtin(global_invocation_id) id: vec3u) {
    if id.x == 0u {
        atomicStore(&touch.taken, 0u);
        touch.stores_entries = 0u;
    }
    if !is_searched() {
        return;
    }
    for (var at = id.x; at < contacts.cells; at += LIST_THREADS) {
        atomicStore(&table[at], 0u);
    }
}

var<workgroup> is_quiet: u32;
// Turns the counts of cells into their first entries.
@compute @workgroup_size(CELLS_GROUP)
fn scan_cells(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
    if t == 0u {
        is_quiet = select(1u, 0u, is_searched());
    }
    if workgroupUniformLoad(&is_quiet) != 0u {
        return;
    }
    if group.x == 0u && t == 0u {
        touch.stores_entries = 1u;
    }
    scan_rows(group.x, t, contacts.cells);
}

// Reserves `count` entries and returns the index of the first.
fn reserve_entries(count: u32) -> u32 {
    return atomicAdd(&touch.taken, count);
}
