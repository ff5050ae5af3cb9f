// Optical depths that light crosses up to each cell, slab by slab, one workgroup a direction: the
// twin of `Grid::sweep`.

@group(0) @binding(7) var<storage, read_write> grids: array<f32>;
@group(0) @binding(23) var<storage, read> deposits: array<u32>;
@group(0) @binding(25) var<storage, read> sweeps: array<Sweep>;

struct Sweep {
    direction: vec3f,
    // Its first cell in `deposits`.
    cells: u32,
    size: vec3u,
    // Its first cell in `grids`.
    depths: u32,
}

// The weights of the two cells around `cell + offset`, |offset| ≤ 1; 0 for those outside.
struct Taps {
    place: vec2u,
    weight: vec2f,
}

fn taps(cell: u32, offset: f32, size: u32) -> Taps {
    let base = floor(offset);
    let f = offset - base;
    let first = i32(cell) + i32(base);
    let at = vec2i(first, first + 1);
    let inside = at >= vec2i(0) & at < vec2i(i32(size));
    return Taps(vec2u(select(vec2i(i32(cell)), at, inside)), select(vec2f(0.0), vec2f(1.0 - f, f), inside));
}

fn deposited(cell: u32) -> f32 {
    return f32(min(deposits[cell], FULL_CELL)) / DEPOSIT_UNIT;
}

@compute @workgroup_size(THREADS)
fn sweep(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let own = sweeps[group.x];
    var size = own.size;
    var strides = vec3u(1u, size.x, size.x * size.y);
    var direction = own.direction;
    let along = abs(direction);
    // The axis nearest to the direction comes first.
    if along.y > along.x && along.y >= along.z {
        size = size.yxz;
        strides = strides.yxz;
        direction = direction.yxz;
    } else if along.z > along.x && along.z > along.y {
        size = size.zxy;
        strides = strides.zxy;
        direction = direction.zxy;
    }
    let back = -direction.yz / abs(direction.x);
    let path = sqrt(1.0 + dot(back, back));
    let slab = size.y * size.z;
    let forward = direction.x > 0.0;
    for (var k = 0u; k < size.x; k += 1u) {
        let to_slab = select(size.x - 1u - k, k, forward) * strides.x;
        let from_slab = select(size.x - k, k - 1u, forward) * strides.x;
        for (var n = local; n < slab; n += THREADS) {
            let place = vec2u(n % size.y, n / size.y);
            let cell = place.x * strides.y + place.y * strides.z;
            var depth = 0.0;
            if k > 0u {
                depth = 0.5 * path * deposited(own.cells + to_slab + cell);
                let x = taps(place.x, back.x, size.y);
                let y = taps(place.y, back.y, size.z);
                for (var i = 0u; i < 4u; i += 1u) {
                    let weight = x.weight[i & 1u] * y.weight[i >> 1u];
                    let tap = from_slab + x.place[i & 1u] * strides.y + y.place[i >> 1u] * strides.z;
                    let crossed = 0.5 * path * deposited(own.cells + tap);
                    depth += weight * (grids[own.depths + tap] + crossed);
                }
            }
            grids[own.depths + to_slab + cell] = depth;
        }
        storageBarrier();
    }
}
