// The search of contacts, strand by strand, one per thread: displacements of particles, mean
// motion, entries of cells; the GPU counterpart of `contact::{displacements, mean_motion}`. A CPU
// has no cells: it looks up active segments in a tree.

@compute @workgroup_size(WORKGROUP)
fn record_start(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let x = (contacts.from_start * vec4f(position_at(strand, i), 1.0)).xyz;
        let at = row_of(number_of(strand, i), 3u, 0u);
        starts[at] = x.x;
        starts[at + LANES] = x.y;
        starts[at + 2u * LANES] = x.z;
    }
}

fn is_near(x: vec3f) -> bool {
    return all_finite(x) && dot(x, x) < contacts.far * contacts.far;
}

// Records the end positions, and measures the extent of the start and end positions. Distant
// outliers are excluded, because they would make the nodes coarse.
@compute @workgroup_size(WORKGROUP)
fn record_end(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    var own = Extent(vec3f(FAR), vec3f(-FAR));
    for (var i = 0u; i < strand.particles; i++) {
        let number = number_of(strand, i);
        let end = (contacts.from_end * vec4f(position_at(strand, i), 1.0)).xyz;
        let start = start_of(number);
        set_work_vector(row_of(number, MOTION_ROWS, 0u), end);
        if is_near(end) {
            own = Extent(min(own.low, end), max(own.high, end));
        }
        if is_near(start) {
            own = Extent(min(own.low, start), max(own.high, start));
        }
    }
    for (var c = 0u; c < 3u; c++) {
        let least = ordered(own.low[c]);
        if is_least(least) && least < atomicLoad(&touch.extent[c]) {
            atomicMin(&touch.extent[c], least);
        }
        let greatest = ordered(own.high[c]);
        if is_greatest(greatest) && greatest > atomicLoad(&touch.extent[3u + c]) {
            atomicMax(&touch.extent[3u + c], greatest);
        }
    }
}

// The node of the mean motion below a point, and the offset from it in nodes.
struct Corner {
    first: u32,
    f: vec3f,
}

fn corner_at(at: vec3f) -> Corner {
    let last = vec3f(touch.dims - 2u);
    let u = max((at - touch.low) / touch.spacing, vec3f());
    let node = min(floor(u), last);
    let below = vec3u(node);
    return Corner(below.x + touch.dims.x * (below.y + touch.dims.y * below.z), min(u - node, vec3f(1.0)));
}

fn node_of(first: u32, corner: u32) -> u32 {
    return first + corner_offset(touch.dims.x, touch.dims.x * touch.dims.y, corner);
}

fn mean_motion_at(at: vec3f) -> vec3f {
    let own = corner_at(at);
    var mean = vec3f();
    for (var corner = 0u; corner < 8u; corner++) {
        let node = contacts.bodies + 4u * node_of(own.first, corner);
        mean += corner_weight(own.f, corner) * vec3f(real(node), real(node + 1u), real(node + 2u));
    }
    return mean;
}

// A displacement relative to the mean motion.
fn residual_displacement(start: vec3f, end: vec3f) -> vec3f {
    return end - start - mean_motion_at(0.5 * (start + end));
}

// Adds to four 64-bit sums, which begin at `at`: lower halves first, with the carries to the upper
// halves. The order of additions does not matter, and the four do not wait for each other.
fn add_wide(at: u32, x: vec4i) {
    if all(x == vec4i()) {
        return;
    }
    let low = bitcast<vec4u>(x);
    let before = vec4u(
        atomicAdd(&table[at], low.x),
        atomicAdd(&table[at + 2u], low.y),
        atomicAdd(&table[at + 4u], low.z),
        atomicAdd(&table[at + 6u], low.w),
    );
    let carry = select(vec4u(), vec4u(1u), before + low < before);
    let high = select(vec4u(), vec4u(NOTHING), x < vec4i()) + carry;
    for (var c = 0u; c < 4u; c++) {
        if high[c] != 0u {
            atomicAdd(&table[at + 1u + 2u * c], high[c]);
        }
    }
}

// Sums for the eight nodes around some consecutive particles.
struct NodeSums {
    first: u32,
    count: u32,
    nodes: array<vec4i, 8>,
}

fn flush_sums(sum: ptr<function, NodeSums>) {
    for (var corner = 0u; corner < 8u && (*sum).count > 0u; corner++) {
        add_wide(8u * node_of((*sum).first, corner), (*sum).nodes[corner]);
    }
    *sum = NodeSums();
}

// Sums one lane in EVERY, without particles outside the box.
@compute @workgroup_size(WORKGROUP)
fn splat_mean_motion(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || strand.lane % EVERY != 0u {
        return;
    }
    let unit = MEAN_MOTION_UNIT / side_of_box();
    var sum = NodeSums();
    for (var i = 0u; i < strand.particles; i++) {
        let number = number_of(strand, i);
        let start = start_of(number);
        let end = end_of(number);
        if !(in_box(start) && in_box(end)) {
            continue;
        }
        let displacement = end - start;
        let own = corner_at(start + 0.5 * displacement);
        // The sum of 256 values fits into 32 bits.
        if own.first != sum.first || sum.count == 256u {
            flush_sums(&sum);
            sum.first = own.first;
        }
        for (var corner = 0u; corner < 8u; corner++) {
            let w = corner_weight(own.f, corner);
            sum.nodes[corner] += vec4i(round(w * vec4f(displacement * unit, MEAN_MOTION_UNIT)));
        }
        sum.count += 1u;
    }
    flush_sums(&sum);
}

var<workgroup> bins: array<atomic<u32>, BINS>;

// Measures the residual motion of each particle.
@compute @workgroup_size(WORKGROUP)
fn measure_residual_motion(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) t: u32) {
    let strand = strand_of(id.x);
    for (var bin = t; bin < BINS; bin += WORKGROUP) {
        atomicStore(&bins[bin], 0u);
    }
    workgroupBarrier();
    var squares = 0.0;
    var fastest = 0.0;
    for (var i = 0u; i < strand.particles && strand.here; i++) {
        let number = number_of(strand, i);
        let start = start_of(number);
        let end = end_of(number);
        var residual = 0.0;
        if all_finite(start) && all_finite(end) {
            residual = length(residual_displacement(start, end));
            if !is_finite(residual) {
                residual = 0.0;
            }
            let edges = min(residual / contacts.edge, 64.0);
            squares += edges * edges;
            fastest = max(fastest, residual);
            atomicAdd(&bins[bin_of(residual)], 1u);
        }
        set_real(row_of(number, MOTION_ROWS, RESIDUAL_MOTION), residual);
    }
    workgroupBarrier();
    for (var bin = t; bin < BINS; bin += WORKGROUP) {
        let count = atomicLoad(&bins[bin]);
        if count > 0u {
            atomicAdd(&touch.bins[bin], count);
        }
    }
    if !strand.here {
        return;
    }
    // Limits the share of a few distant particles.
    let own = u32(round(min(squares, 16384.0) * SQUARE_UNIT));
    let before = atomicAdd(&touch.squares[0], own);
    if before + own < before {
        atomicAdd(&touch.squares[1], 1u);
    }
    if bitcast<u32>(fastest) > atomicLoad(&touch.fastest) {
        atomicMax(&touch.fastest, bitcast<u32>(fastest));
    }
}

@compute @workgroup_size(WORKGROUP)
fn list_active(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || touch.slices == 0u {
        return;
    }
    for (var i = 0u; i + 1u < strand.particles; i++) {
        let segment = number_of(strand, i);
        if is_active(segment, residual_motion_of(segment)) {
            let place = atomicAdd(&touch.actives, 1u);
            if place < contacts.most_actives {
                touch.list[place] = segment;
            }
        }
    }
}

// Runs twice: the first pass counts the entries of each cell, the second stores them.
@compute @workgroup_size(WORKGROUP)
fn insert_segments(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here || !is_searched() {
        return;
    }
    let time = middle_of_slice();
    var number = number_of(strand, 0u);
    var start = start_of(number);
    var upper = start + time * (end_of(number) - start);
    for (var i = 0u; i + 1u < strand.particles; i++) {
        let segment = number;
        let lower = upper;
        number += LANES;
        start = start_of(number);
        upper = start + time * (end_of(number) - start);
        let residual = residual_motion_of(segment);
        let is_one_active = is_active(segment, residual);
        let reach = reach_of(residual, is_one_active);
        let pieces = pieces_of(rest_length(strand, i, 1u));
        for (var k = 0u; k < pieces; k++) {
            let piece = piece_of(lower, upper, k, pieces, reach);
            if !in_box(piece.middle) {
                continue;
            }
            let bucket = bucket_of(cell_of(piece.middle));
            if touch.stores_entries == 0u {
                atomicAdd(&table[bucket], 1u);
                continue;
            }
            let place = atomicAdd(&table[contacts.cells + bucket], 1u);
            if place < contacts.entries {
                work[contacts.bodies + place] = segment | select(0u, ACTIVE, is_one_active);
                let ball = contacts.bodies + contacts.entries + 4u * place;
                let bits = bitcast<vec4u>(vec4f(piece.middle, piece.radius));
                work[ball] = bits.x;
                work[ball + 1u] = bits.y;
                work[ball + 2u] = bits.z;
                work[ball + 3u] = bits.w;
            }
        }
    }
}
