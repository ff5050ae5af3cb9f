// The nearest neighbours and the density of every particle: the GPU counterpart of
// `find_neighbours`. The order of entries in a bucket is arbitrary, but lists are sorted by
// distance and number, so sums over them do not depend on it.

fn reserve_entries(count: u32) -> u32 {
    return atomicAdd(&table[2u * fluid.buckets], count);
}

@compute @workgroup_size(CELLS_GROUP)
fn clear_buckets(@builtin(global_invocation_id) id: vec3u) {
    if id.x == 0u {
        atomicStore(&table[2u * fluid.buckets], 0u);
    }
    for (var at = id.x; at < fluid.buckets; at += LIST_THREADS) {
        atomicStore(&table[at], 0u);
    }
}

@compute @workgroup_size(CELLS_GROUP)
fn scan_buckets(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
    scan_rows(group.x, t, fluid.buckets);
}

// The nearest neighbours so far, sorted by distance.
var<private> squares: array<f32, MOST_NEIGHBOURS>;
var<private> slots: array<u32, MOST_NEIGHBOURS>;
var<private> found: u32;

fn groom_number(slot: u32) -> u32 {
    return names[3u * number_at(slot)];
}

// Whether the particle at `slot` and at a squared distance comes before entry `at` of the list.
fn is_nearer(square: f32, slot: u32, at: u32) -> bool {
    return square < squares[at] || (square == squares[at] && groom_number(slot) < groom_number(slots[at]));
}

fn insert(square: f32, slot: u32) {
    var at = found;
    if found == fluid.neighbours {
        at -= 1u;
        if !is_nearer(square, slot, at) {
            return;
        }
    } else {
        found += 1u;
    }
    while at > 0u && is_nearer(square, slot, at - 1u) {
        squares[at] = squares[at - 1u];
        slots[at] = slots[at - 1u];
        at -= 1u;
    }
    squares[at] = square;
    slots[at] = slot;
}

// The squared distance from which on particles are not neighbours.
fn bound_so_far() -> f32 {
    if found == fluid.neighbours {
        return squares[found - 1u];
    }
    return fluid.h2;
}


fn search(own: u32) {
    let x = vector_at(ENTRY * own);
    let strand = cloud[ENTRY * own + 7u];
    let cell = cell_of(x);
    let from_low = x - vec3f(cell) * fluid.h;
    // Bound of the rounding error of the distance to a cell, relative to its side.
    let far = vec3f(abs(cell));
    let rounding = 1e-4 + 5e-7 * max(far.x, max(far.y, far.z));
    let below = max(from_low - rounding * fluid.h, vec3f(0.0)) * (1.0 - rounding);
    let above = max(fluid.h - from_low - rounding * fluid.h, vec3f(0.0)) * (1.0 - rounding);
    // The cell itself first, then its neighbours across faces, edges and corners.
    for (var sides = 0u; sides <= 3u; sides++) {
        for (var n = 0u; n < 27u; n++) {
            let step = vec3i(vec3u(n % 3u, n / 3u % 3u, n / 9u)) - 1;
            if u32(dot(step, step)) != sides {
                continue;
            }
            let away = select(select(vec3f(0.0), above, step > vec3i(0)), below, step < vec3i(0));
            if dot(away, away) > bound_so_far() {
                continue;
            }
            let bucket = bucket_of(cell + step);
            let end = atomicLoad(&table[fluid.buckets + bucket]);
            for (var slot = atomicLoad(&table[bucket]); slot < end; slot++) {
                let other = vector_at(ENTRY * slot);
                let d = other - x;
                let square = dot(d, d);
                if square <= bound_so_far() && square < fluid.h2 && slot != own {
                    // Particles of other cells in the same bucket are farther away than h.
                    if fluid.own_strand != 0u || cloud[ENTRY * slot + 7u] != strand {
                        insert(square, slot);
                    }
                }
            }
        }
    }
}

fn density_of(square: f32) -> f32 {
    let rest = 1.0 - square / fluid.h2;
    return fluid.mass_density * rest * rest * rest;
}

@compute @workgroup_size(CELLS_GROUP)
fn find_neighbours(@builtin(global_invocation_id) id: vec3u) {
    let entries = atomicLoad(&table[2u * fluid.buckets]);
    for (var slot = id.x; slot < entries; slot += LIST_THREADS) {
        found = 0u;
        search(slot);
        var density = density_of(0.0);
        let list = list_of(slot);
        for (var n = 0u; n < found; n++) {
            cloud[list + n] = slots[n];
            density += density_of(squares[n]);
        }
        let at = 8u * fluid.numbers + slot;
        cloud[at] = bitcast<u32>(density);
        let is_full = found == fluid.neighbours;
        // The bound of the list; a list that is not full has no bound and ends with a sentinel.
        cloud[at + fluid.numbers] = bitcast<u32>(select(FAR, bound_so_far(), is_full));
        cloud[at + 2u * fluid.numbers] = 0u;
        if is_full {
            cloud[at + 2u * fluid.numbers] = groom_number(slots[found - 1u]);
        } else {
            cloud[list + found] = NO_SLOT;
        }
    }
}
