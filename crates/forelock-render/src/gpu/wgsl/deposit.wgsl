// Adds areas to the grids of optical depth, as integers, so that their order does not change the
// sum: the twin of `Deposits::add`. The grid for ambient light is number 1 and follows the one for
// shadows.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(23) var<storage, read_write> deposits: array<atomic<u32>>;

fn cell_of(grid: u32) -> f32 {
    return select(frame.shadow_cell, frame.open_cell, grid == 1u);
}

fn add(grid: u32, position: vec3f, area: f32) {
    let is_open = grid == 1u;
    let cell = cell_of(grid);
    let size = select(frame.shadow_size, frame.open_size, is_open);
    let at = (position - select(frame.shadow_origin, frame.open_origin, is_open)) / cell;
    let depth = min(area / (cell * cell), MOST_DEPTH);
    if !(all(at >= vec3f(0.0)) && all(at <= vec3f(size - 1u)) && area >= 0.0) {
        return;
    }
    let base = min(vec3u(at), size - 2u);
    let f = at - vec3f(base);
    let shadow_cells = frame.shadow_size.x * frame.shadow_size.y * frame.shadow_size.z;
    let start = select(0u, shadow_cells, is_open);
    for (var i = 0u; i < 8u; i += 1u) {
        let step = vec3u(i & 1u, (i >> 1u) & 1u, i >> 2u);
        let share = select(1.0 - f, f, step == vec3u(1u));
        let place = base + step;
        let index = start + place.x + size.x * (place.y + size.y * place.z);
        // A full cell takes no more, so that its sum does not wrap around.
        if atomicLoad(&deposits[index]) < FULL_CELL {
            atomicAdd(&deposits[index], u32(depth * share.x * share.y * share.z * DEPOSIT_UNIT + 0.5));
        }
    }
}
