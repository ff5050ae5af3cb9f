// The contacts within the budget, and their joints. The text follows `pairs.wgsl`.

// Advances to the next slice.
@compute @workgroup_size(1)
fn next_slice() {
    touch.slice += 1u;
}

// Counts the found contacts by their speed of approach.
@compute @workgroup_size(CELLS_GROUP)
fn count_found(@builtin(global_invocation_id) id: vec3u) {
    if touch.slices == 0u {
        return;
    }
    for (var at = id.x; at < SLOTS * active_count(); at += LIST_THREADS) {
        let slot = slot_at(0u, at);
        if work[slot] != NOTHING {
            atomicAdd(&touch.bins[work[slot + 1u] >> BIN_BITS], 1u);
        }
    }
}

// Selects those within the budget, and resets the rounds.
@compute @workgroup_size(CELLS_GROUP)
fn select_found(@builtin(local_invocation_index) t: u32) {
    sum_bins(t);
    workgroupBarrier();
    find_last(t, contacts.budget);
    workgroupBarrier();
    if t == 0u {
        touch.found_bin = last_of.x;
        touch.found_share = share_of(last_of);
        atomicStore(&touch.taken, 0u);
        touch.round = 0u;
        touch.momentum = 0.0;
        touch.last = select(0u, 1u, contacts.rounds == 1u);
        touch.done = 0u;
        atomicStore(&touch.lack, 0u);
    }
    clear_bins(t);
}

// Clears the lists of joints and the bends of strands.
@compute @workgroup_size(CELLS_GROUP)
fn clear_links(@builtin(global_invocation_id) id: vec3u) {
    for (var at = id.x; at < contacts.numbers; at += LIST_THREADS) {
        atomicStore(&table[count_at(at)], 0u);
    }
    for (var slot = id.x; slot < contacts.strands; slot += LIST_THREADS) {
        atomicStore(&table[bend_at(slot)], 0u);
    }
}

// Creates the joints of the selected contacts.
@compute @workgroup_size(CELLS_GROUP)
fn create_joints(@builtin(global_invocation_id) id: vec3u) {
    if touch.slices == 0u {
        return;
    }
    for (var at = id.x; at < SLOTS * active_count(); at += LIST_THREADS) {
        let slot = slot_at(0u, at);
        let own = work[slot];
        if own == NOTHING {
            continue;
        }
        let bin = work[slot + 1u] >> BIN_BITS;
        let segment = touch.list[at / SLOTS];
        let other = own & SEGMENT;
        let is_sampled = chance(segment ^ (other * 0x85ebca6bu)) < touch.found_share;
        if !(bin > touch.found_bin || bin == touch.found_bin && is_sampled) {
            continue;
        }
        let pair = vec2u(min(segment, other), max(segment, other));
        let contact = follow(pair.x, pair.y, own >> SLICE_BITS);
        if !contact.here {
            continue;
        }
        let joint = atomicAdd(&touch.joints, 1u);
        if joint >= contacts.most_joints {
            continue;
        }
        for (var side = 0u; side < 2u; side++) {
            work[field_at(joint, SEGMENTS + side)] = pair[side];
            set_field(joint, ALONG + side, contact.along[side]);
            atomicAdd(&table[count_at(pair[side])], 1u);
        }
        set_field_vector(joint, NORMAL, contact.normal);
        set_field(joint, GAP, contact.gap);
        set_field(joint, WHEN, contact.when);
        set_field(joint, APPROACH, contact.approach);
    }
}
