// Sorts the list of each tile from front to back; equal depths by number of the piece. A bitonic
// network whose comparisons all point the same way, so that any length needs no padding. Blocks
// are sorted in workgroup memory.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(12) var<storage, read> offsets: array<u32>;
@group(0) @binding(13) var<storage, read_write> list: array<vec2u>;

const BLOCK: u32 = 1024u;

var<workgroup> block: array<vec2u, BLOCK>;

fn is_before(a: vec2u, b: vec2u) -> bool {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

fn order_in_block(a: u32, b: u32) {
    let first = block[a];
    let second = block[b];
    if is_before(second, first) {
        block[a] = second;
        block[b] = first;
    }
}

fn order_in_list(a: u32, b: u32, past: u32) {
    if b >= past {
        return;
    }
    let first = list[a];
    let second = list[b];
    if is_before(second, first) {
        list[a] = second;
        list[b] = first;
    }
}

fn load_block(first: u32, past: u32, local: u32) {
    for (var i = local; i < BLOCK; i += THREADS) {
        var item = vec2u(NONE);
        if first + i < past {
            item = list[first + i];
        }
        block[i] = item;
    }
    workgroupBarrier();
}

fn store_block(first: u32, past: u32, local: u32) {
    for (var i = local; i < BLOCK; i += THREADS) {
        if first + i < past {
            list[first + i] = block[i];
        }
    }
    workgroupBarrier();
}

// Compares neighbours at distances `widest`, half of it, ... 1.
fn merge_block(widest: u32, local: u32) {
    for (var step = widest; step > 0u; step /= 2u) {
        for (var i = local; i < BLOCK / 2u; i += THREADS) {
            let a = i / step * 2u * step + i % step;
            order_in_block(a, a + step);
        }
        workgroupBarrier();
    }
}

var<workgroup> range: vec2u;

@compute @workgroup_size(THREADS)
fn sort(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = group.y * groups.x + group.x;
    if local == 0u {
        range = vec2u(0u);
        if tile < frame.tiles.x * frame.tiles.y {
            range = min(vec2u(offsets[tile], offsets[tile + 1u]), vec2u(frame.capacity));
        }
    }
    let own = workgroupUniformLoad(&range);
    let length = own.y - own.x;
    if length < 2u {
        return;
    }
    for (var first = own.x; first < own.y; first += BLOCK) {
        load_block(first, own.y, local);
        for (var size = 2u; size <= BLOCK && size / 2u < length; size *= 2u) {
            let half = size / 2u;
            for (var i = local; i < BLOCK / 2u; i += THREADS) {
                let low = i / half * size;
                order_in_block(low + i % half, low + size - 1u - i % half);
            }
            workgroupBarrier();
            merge_block(half / 2u, local);
        }
        store_block(first, own.y, local);
    }
    for (var size = 2u * BLOCK; size / 2u < length; size *= 2u) {
        storageBarrier();
        let half = size / 2u;
        let pairs = (length + size - 1u) / size * half;
        for (var i = local; i < pairs; i += THREADS) {
            let low = own.x + i / half * size;
            order_in_list(low + i % half, low + size - 1u - i % half, own.y);
        }
        storageBarrier();
        for (var step = half / 2u; step >= BLOCK; step /= 2u) {
            for (var i = local; i < pairs; i += THREADS) {
                let a = own.x + i / step * 2u * step + i % step;
                order_in_list(a, a + step, own.y);
            }
            storageBarrier();
        }
        for (var first = own.x; first < own.y; first += BLOCK) {
            load_block(first, own.y, local);
            merge_block(BLOCK / 2u, local);
            store_block(first, own.y, local);
        }
    }
}
