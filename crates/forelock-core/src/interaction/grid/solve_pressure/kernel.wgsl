// Pressure on the grid, cell by cell: the GPU counterpart of `solve_pressure`.
//
// The same complementarity problem: P ≥ 0, ∇·u ≥ t, with equality in one of them for each cell. It
// is solved by projected successive over-relaxation in two colours (Cryer 1971, "The solution of a
// quadratic programming problem using systematic overrelaxation"), which needs neither sums over
// the grid nor an active set.

@group(0) @binding(13) var<storage, read_write> cells: array<u32>;
@group(0) @binding(15) var<storage, read_write> nodes: array<vec4f>;

// Index of a cell along each axis.
fn cell_at(cell: u32) -> vec3u {
    return vec3u(cell % bounds.dims.x, cell / bounds.dims.x % bounds.dims.y, cell / bounds.layer);
}

// Whether a cell has neighbours on all sides.
fn is_inner(at: vec3u) -> bool {
    return all(at > vec3u(0u)) && all(at + 1u < bounds.dims);
}

fn value_of(number: u32, cell: u32) -> f32 {
    return bitcast<f32>(cells[plane(number, cell)]);
}

fn put(number: u32, cell: u32, value: f32) {
    cells[plane(number, cell)] = bitcast<u32>(value);
}

fn summed(number: u32, cell: u32) -> i32 {
    return bitcast<i32>(cells[plane(number, cell)]);
}

// Marks the cells next to hair whose centres are inside a solid, with the number of the first such
// solid.
@compute @workgroup_size(CELLS_GROUP)
fn mark_solid_cells(@builtin(global_invocation_id) id: vec3u) {
    for (var cell = id.x; cell < bounds.count; cell += CELLS_THREADS) {
        var wall = 0.0;
        let at = cell_at(cell);
        if grid.solids > 0u && is_inner(at) {
            var hair = summed(MASS, cell) > 0;
            for (var axis = 0u; axis < 3u; axis++) {
                let beyond = stride(axis);
                hair = hair || summed(MASS, cell - beyond) > 0 || summed(MASS, cell + beyond) > 0;
            }
            if hair {
                let middle = vec3f(vec3i(at) + bounds.low) + 0.5;
                for (var number = 0u; number < grid.solids; number++) {
                    if sample_shape(number, local(grid.each[number].local, middle), 1.0).w < 0.0 {
                        wall = f32(number + 1u);
                        break;
                    }
                }
            }
        }
        put(WALL, cell, wall);
    }
}

// Turns sums into momenta, masses and densities.
@compute @workgroup_size(CELLS_GROUP)
fn normalize_velocity(@builtin(global_invocation_id) id: vec3u) {
    for (var cell = id.x; cell < bounds.count; cell += CELLS_THREADS) {
        for (var number = 0u; number < 4u; number++) {
            let sum = grid.unit * f32(summed(MOMENTUM + number, cell)) / SCALE;
            put(MOMENTUM + number, cell, sum);
        }
        if value_of(WALL, cell) > 0.0 {
            put(MASS, cell, SOLID);
        }
        let filled = grid.volumes.x * f32(summed(FILLED, cell)) / SCALE;
        let at_rest = grid.volumes.y * f32(summed(AT_REST, cell)) / SCALE;
        put(DENSITY, cell, select(0.0, filled * filled / at_rest, at_rest > 0.0));
    }
}

// Whether one of two cells is inside a solid.
fn is_wall(below: u32, above: u32) -> bool {
    return value_of(MASS, below) < 0.0 || value_of(MASS, above) < 0.0;
}

// The inverse mass of the face between two cells, of which at least one has hair; 0 if it is a wall
// or has almost no hair.
fn mobility(below: u32, above: u32) -> f32 {
    let sum = value_of(MASS, below) + value_of(MASS, above);
    return select(0.0, 2.0 / sum, !is_wall(below, above) && 0.5 * sum > grid.least);
}

// The velocity of solid `wall` at a point of the box.
fn solid_velocity(wall: f32, at: vec3f) -> vec3f {
    return local(grid.each[u32(wall) - 1u].velocity, at + vec3f(bounds.low));
}

// The velocity along `axis` at the face between two cells, of which at least one has hair.
fn face_velocity(axis: u32, below: u32, above: u32) -> f32 {
    if is_wall(below, above) {
        let wall = value_of(WALL, below);
        var middle = vec3f(cell_at(above)) + 0.5;
        middle[axis] -= 0.5;
        return solid_velocity(select(value_of(WALL, above), wall, wall > 0.0), middle)[axis];
    }
    let momentum = value_of(MOMENTUM + axis, below) + value_of(MOMENTUM + axis, above);
    return momentum / (value_of(MASS, below) + value_of(MASS, above));
}

// The right-hand side of a cell; −FAR where no pressure can act.
fn right_hand_side(cell: u32, displaces: bool) -> f32 {
    let density = value_of(DENSITY, cell);
    if !displaces && density > bitcast<f32>(atomicLoad(&bounds.densest)) {
        atomicMax(&bounds.densest, bitcast<u32>(density));
    }
    if density < LOOSE || value_of(MASS, cell) < 0.0 || !is_inner(cell_at(cell)) {
        return -FAR;
    }
    var divergence = 0.0;
    for (var axis = 0u; axis < 3u; axis++) {
        let beyond = cell + stride(axis);
        divergence += face_velocity(axis, cell, beyond) - face_velocity(axis, cell - stride(axis), cell);
    }
    let excess = (density - 1.0) / density;
    if displaces {
        return grid.cell * select(excess, grid.expand * excess, excess > 0.0);
    }
    return grid.slack * min(excess, 0.0) - divergence;
}

// The entry of the list of cell number `number` of a colour.
fn listed(colour: u32, number: u32) -> u32 {
    return plane(LIST, select(number, grid.capacity - 1u - number, colour == 1u));
}

// The order within a colour does not matter: its cells are not neighbours.
fn append_cell(cell: u32) {
    let at = cell_at(cell);
    let colour = (at.x + at.y + at.z) & 1u;
    cells[listed(colour, atomicAdd(&bounds.listed[colour], 1u))] = cell;
}

fn begin_solve(id: u32, displaces: bool) {
    var largest = 0.0;
    for (var cell = id; cell < bounds.count; cell += CELLS_THREADS) {
        let lack = right_hand_side(cell, displaces);
        put(LACK, cell, lack);
        put(PRESSURE, cell, 0.0);
        largest = max(largest, lack);
        if lack > -FAR {
            append_cell(cell);
        }
    }
    if largest > bitcast<f32>(atomicLoad(&bounds.lack)) {
        atomicMax(&bounds.lack, bitcast<u32>(largest));
    }
    // Other threads read these only from the next dispatch on.
    if id == 0u {
        atomicStore(&bounds.change, 0u);
        bounds.found = 0u;
        bounds.ratio = 0.0;
    }
}

@compute @workgroup_size(CELLS_GROUP)
fn compute_divergence(@builtin(global_invocation_id) id: vec3u) {
    begin_solve(id.x, false);
}

@compute @workgroup_size(CELLS_GROUP)
fn compute_excess(@builtin(global_invocation_id) id: vec3u) {
    begin_solve(id.x, true);
}

fn pressure_at(cell: u32) -> f32 {
    return value_of(PRESSURE, cell);
}

// One colour of a sweep.
fn relax(id: u32, colour: u32) {
    if bounds.found != 0u {
        return;
    }
    var largest = 0.0;
    let count = atomicLoad(&bounds.listed[colour]);
    for (var number = id; number < count; number += LIST_THREADS) {
        let cell = cells[listed(colour, number)];
        var given = value_of(LACK, cell);
        var diagonal = 0.0;
        for (var axis = 0u; axis < 3u; axis++) {
            let beyond = stride(axis);
            let below = mobility(cell - beyond, cell);
            let above = mobility(cell, cell + beyond);
            given += below * pressure_at(cell - beyond) + above * pressure_at(cell + beyond);
            diagonal += below + above;
        }
        if !(diagonal > 0.0) {
            continue;
        }
        diagonal *= 1.0 + SLACK;
        let old = pressure_at(cell);
        let next = max(old + grid.relaxation * (given / diagonal - old), 0.0);
        put(PRESSURE, cell, next);
        largest = max(largest, abs(next - old) * diagonal);
    }
    if largest > bitcast<f32>(atomicLoad(&bounds.change)) {
        atomicMax(&bounds.change, bitcast<u32>(largest));
    }
}

@compute @workgroup_size(CELLS_GROUP)
fn relax_red(@builtin(global_invocation_id) id: vec3u) {
    relax(id.x, 0u);
}

@compute @workgroup_size(CELLS_GROUP)
fn relax_black(@builtin(global_invocation_id) id: vec3u) {
    relax(id.x, 1u);
}

// Whether the sweeps since the last check changed the pressure by less than the tolerance.
@compute @workgroup_size(1)
fn check_convergence() {
    if bounds.found != 0u {
        return;
    }
    bounds.sweeps += SWEEPS;
    let change = bitcast<f32>(atomicExchange(&bounds.change, 0u));
    let lack = bitcast<f32>(atomicLoad(&bounds.lack));
    bounds.ratio = change / max(lack, 1e-37);
    if change <= grid.tolerance * lack {
        bounds.found = 1u;
    }
}

// The change along `axis` of a cell with hair: the mean of those at its two faces, of which walls
// do not count.
fn change_along(axis: u32, cell: u32) -> f32 {
    let beyond = stride(axis);
    let own = pressure_at(cell);
    var change = 0.0;
    var count = 0.0;
    if !is_wall(cell - beyond, cell) {
        change += mobility(cell - beyond, cell) * (pressure_at(cell - beyond) - own);
        count += 1.0;
    }
    if !is_wall(cell, cell + beyond) {
        change += mobility(cell, cell + beyond) * (own - pressure_at(cell + beyond));
        count += 1.0;
    }
    return change / max(count, 1.0);
}

fn apply_pressure(id: u32, displaces: bool) {
    var held = 0u;
    for (var cell = id; cell < bounds.count; cell += CELLS_THREADS) {
        held += select(0u, 1u, pressure_at(cell) > 0.0);
        let mass = value_of(MASS, cell);
        let at = cell_at(cell);
        var change = vec3f();
        var old = vec3f();
        if mass > 0.0 && is_inner(at) {
            for (var axis = 0u; axis < 3u; axis++) {
                change[axis] = change_along(axis, cell);
                old[axis] = value_of(MOMENTUM + axis, cell) / mass;
            }
        } else if mass < 0.0 {
            old = solid_velocity(value_of(WALL, cell), vec3f(at) + 0.5);
        }
        if displaces {
            nodes[2u * cell + 1u] = vec4f(change, 0.0);
        } else {
            nodes[2u * cell] = vec4f(change + grid.pic * old, 0.0);
        }
    }
    if held > 0u && !displaces {
        atomicAdd(&bounds.held, held);
    }
    if id == 0u {
        atomicStore(&bounds.lack, 0u);
        bounds.residual = max(bounds.residual, bounds.ratio);
        clear_list();
    }
}

@compute @workgroup_size(CELLS_GROUP)
fn apply_velocity_pressure(@builtin(global_invocation_id) id: vec3u) {
    apply_pressure(id.x, false);
}

@compute @workgroup_size(CELLS_GROUP)
fn apply_displacement_pressure(@builtin(global_invocation_id) id: vec3u) {
    apply_pressure(id.x, true);
}
