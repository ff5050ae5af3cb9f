// Lists of the pieces of each tile: count, sum up, fill.

@group(0) @binding(11) var<storage, read_write> counts: array<atomic<u32>>;
@group(0) @binding(12) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(13) var<storage, read_write> list: array<vec2u>;
// For each tile, the inverse depth behind which bodies hide everything.
@group(0) @binding(14) var<storage, read> horizon: array<f32>;
// Pieces in all tiles; those without room.
@group(0) @binding(15) var<storage, read_write> report: array<u32, 4>;

// The tiles that a piece may touch: columns and rows from `lo` up to `hi`, exclusive.
struct TileRect {
    lo: vec2u,
    hi: vec2u,
}

fn tiles_of(piece: Piece) -> TileRect {
    let pad = piece.half_width + FILTER_RADIUS;
    let lo = min(piece.start, piece.end) - pad;
    let hi = max(piece.start, piece.end) + pad;
    let size = vec2f(frame.size);
    // Also false where a number is not finite.
    let seen = all(hi >= vec2f(0.0)) && all(lo < size) && all(hi - lo < vec2f(1e30));
    if !seen {
        return TileRect(vec2u(0u), vec2u(0u));
    }
    let first = vec2u(max(lo, vec2f(0.0))) / TILE;
    let last = vec2u(min(hi, size - 1.0)) / TILE;
    return TileRect(first, min(last + 1u, frame.tiles));
}

fn add_saturating(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, NONE, sum < a);
}

@compute @workgroup_size(THREADS)
fn count(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let point = thread_of(group, groups, local);
    if point >= frame.points {
        return;
    }
    let edge = edge_from(point);
    for (var i = 0u; i < edge.pieces; i += 1u) {
        let piece = piece_of(edge, i);
        let rect = tiles_of(piece);
        for (var y = rect.lo.y; y < rect.hi.y; y += 1u) {
            for (var x = rect.lo.x; x < rect.hi.x; x += 1u) {
                let tile = y * frame.tiles.x + x;
                if piece.nearness >= horizon[tile] {
                    atomicAdd(&counts[tile], 1u);
                }
            }
        }
    }
}

@compute @workgroup_size(THREADS)
fn fill(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let point = thread_of(group, groups, local);
    if point >= frame.points {
        return;
    }
    let edge = edge_from(point);
    for (var i = 0u; i < edge.pieces; i += 1u) {
        let piece = piece_of(edge, i);
        let rect = tiles_of(piece);
        for (var y = rect.lo.y; y < rect.hi.y; y += 1u) {
            for (var x = rect.lo.x; x < rect.hi.x; x += 1u) {
                let tile = y * frame.tiles.x + x;
                if piece.nearness >= horizon[tile] {
                    let slot = add_saturating(offsets[tile], atomicAdd(&counts[tile], 1u));
                    if slot < frame.capacity {
                        // Inverse depths are positive, so their bits have the same order.
                        list[slot] = vec2u(~bitcast<u32>(piece.nearness), point * PIECES_EACH + i);
                    }
                }
            }
        }
    }
}

var<workgroup> sums: array<u32, THREADS>;

// One workgroup; each thread takes neighbouring tiles.
@compute @workgroup_size(THREADS)
fn sum_up(@builtin(local_invocation_index) local: u32) {
    let tiles = frame.tiles.x * frame.tiles.y;
    let share = (tiles + THREADS - 1u) / THREADS;
    let first = min(local * share, tiles);
    let past = min(first + share, tiles);
    var own = 0u;
    for (var tile = first; tile < past; tile += 1u) {
        own = add_saturating(own, atomicLoad(&counts[tile]));
    }
    sums[local] = own;
    workgroupBarrier();
    for (var step = 1u; step < THREADS; step *= 2u) {
        var before = 0u;
        if local >= step {
            before = sums[local - step];
        }
        workgroupBarrier();
        sums[local] = add_saturating(sums[local], before);
        workgroupBarrier();
    }
    var next = 0u;
    if local > 0u {
        next = sums[local - 1u];
    }
    for (var tile = first; tile < past; tile += 1u) {
        offsets[tile] = next;
        next = add_saturating(next, atomicLoad(&counts[tile]));
        atomicStore(&counts[tile], 0u);
    }
    if local == THREADS - 1u {
        let all = sums[local];
        offsets[tiles] = all;
        report[0] = all;
        report[1] = all - min(all, frame.capacity);
    }
}
