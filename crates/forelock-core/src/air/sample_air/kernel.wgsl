// The air at every particle, once a frame: the GPU counterpart of `sample_air::sample`, `air::Wake`
// and `air::Canopy`.

struct Mode {
    // Wave vector, turns a metre.
    wave: vec3f,
    // Phase at the origin of the frame, turns.
    phase: f32,
    amplitude: vec3f,
    pad_0: f32,
}

struct Air {
    // Maps positions to nodes of the wake.
    to_wake: mat4x4f,
    // Maps nodes of the wake to positions.
    from_wake: mat4x4f,
    // Axes of the wind: two across it, one along it.
    axes: mat4x4f,
    mean: vec3f,
    // Fraction of the wind that solids block in their wake.
    shelter: f32,
    // Shift of positions to the origin of the frame.
    shift: vec3f,
    // Side of a cell of the wake, metres.
    wake_cell: f32,
    // Rest density of the hair times the penetration depth of the wind, 1/m; 0 if hair gives no
    // shelter.
    stop: f32,
    // Integers to a metre of hair in sums.
    scale: f32,
    modes: u32,
    solids: u32,
    each: array<Mode, MOST_MODES>,
}

// The nodes of the canopy.
struct Canopy {
    // The first node, in nodes from the origin.
    low: vec3f,
    cell: f32,
    dims: vec3u,
    pad_0: u32,
    // Extent of the hair along the axes of the wind, ordered as integers.
    extent: array<atomic<u32>, 6>,
    pad_1: u32,
    pad_2: u32,
}

const WAKE_LAYER: u32 = WAKE_NODES * WAKE_NODES;
const WAKE_COUNT: u32 = WAKE_LAYER * WAKE_NODES;
// Nodes of a layer that one thread handles.
const WAKE_EACH: u32 = (WAKE_LAYER + CELLS_GROUP - 1u) / CELLS_GROUP;
const CANOPY_COUNT: u32 = CANOPY_NODES * CANOPY_NODES * CANOPY_NODES;

// Arrays in `nodes`, one after the other: solid fraction and velocity deficit at nodes of the wake;
// length of hair (as an integer) and fraction of the wind at nodes of the canopy.
const SOLID: u32 = 0u;
const DEFICIT: u32 = WAKE_COUNT;
const LENGTHS: u32 = 2u * WAKE_COUNT;
const OPEN: u32 = LENGTHS + CANOPY_COUNT;

@group(0) @binding(17) var<storage, read_write> wind: array<f32>;
@group(0) @binding(18) var<storage, read_write> nodes: array<atomic<u32>>;
@group(0) @binding(19) var<storage, read_write> canopy: Canopy;
@group(0) @binding(20) var<uniform> air: Air;

fn node(at: u32) -> f32 {
    return bitcast<f32>(atomicLoad(&nodes[at]));
}

fn set_node(at: u32, value: f32) {
    atomicStore(&nodes[at], bitcast<u32>(value));
}

// Solid fraction of the cells of the wake at the start of the frame.
@compute @workgroup_size(WORKGROUP)
fn fill_wake(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= WAKE_COUNT {
        return;
    }
    let at = vec3u(id.x % WAKE_NODES, id.x / WAKE_NODES % WAKE_NODES, id.x / WAKE_LAYER);
    let place = local(air.from_wake, vec3f(at));
    var share = 0.0;
    for (var number = 0u; number < air.solids; number++) {
        let found = sample_shape(number, local(query.solids[number].at_start, place), 0.0);
        share = max(share, clamp(0.5 - found.w / air.wake_cell, 0.0, 1.0));
    }
    set_node(SOLID + id.x, share);
}

var<workgroup> upwind: array<f32, WAKE_LAYER>;

// Marches downwind layer by layer, in one workgroup.
@compute @workgroup_size(CELLS_GROUP)
fn march_wake(@builtin(local_invocation_index) id: u32) {
    for (var at = id; at < WAKE_LAYER; at += CELLS_GROUP) {
        set_node(DEFICIT + at, 0.0);
        upwind[at] = node(SOLID + at);
    }
    workgroupBarrier();
    for (var layer = 1u; layer < WAKE_NODES; layer++) {
        var next: array<f32, WAKE_EACH>;
        for (var k = 0u; k < WAKE_EACH; k++) {
            let at = id + k * CELLS_GROUP;
            if at < WAKE_LAYER {
                let here = upwind[at];
                let i = at % WAKE_NODES;
                let j = at / WAKE_NODES;
                // No flux through the sides of the grid.
                var around = select(here, upwind[max(at, 1u) - 1u], i > 0u);
                around += select(here, upwind[min(at + 1u, WAKE_LAYER - 1u)], i + 1u < WAKE_NODES);
                around += select(here, upwind[max(at, WAKE_NODES) - WAKE_NODES], j > 0u);
                around += select(here, upwind[min(at + WAKE_NODES, WAKE_LAYER - 1u)], j + 1u < WAKE_NODES);
                next[k] = here + SPREAD * (around - 4.0 * here);
            }
        }
        workgroupBarrier();
        for (var k = 0u; k < WAKE_EACH; k++) {
            let at = id + k * CELLS_GROUP;
            if at < WAKE_LAYER {
                let own = layer * WAKE_LAYER + at;
                set_node(DEFICIT + own, next[k]);
                upwind[at] = max(next[k], node(SOLID + own));
            }
        }
        workgroupBarrier();
    }
}

fn moved(strand: Strand, i: u32) -> vec3f {
    return position_at(strand, i) + air.shift;
}

fn along_wind(x: vec3f) -> vec3f {
    return (air.axes * vec4f(x, 0.0)).xyz;
}

@compute @workgroup_size(WORKGROUP)
fn measure_canopy(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let own = extent_of(strand, air.axes, air.shift);
    for (var c = 0u; c < 3u; c++) {
        let least = ordered(own.low[c]);
        if is_least(least) && least < atomicLoad(&canopy.extent[c]) {
            atomicMin(&canopy.extent[c], least);
        }
        let greatest = ordered(own.high[c]);
        if is_greatest(greatest) && greatest > atomicLoad(&canopy.extent[3u + c]) {
            atomicMax(&canopy.extent[3u + c], greatest);
        }
    }
}

@compute @workgroup_size(1)
fn fit_canopy() {
    var low = vec3f();
    var side = vec3f();
    for (var c = 0u; c < 3u; c++) {
        let least = unordered(atomicExchange(&canopy.extent[c], 0xffffffffu));
        let greatest = unordered(atomicExchange(&canopy.extent[3u + c], 0u));
        // Some coordinate was finite.
        if least <= greatest {
            low[c] = least;
            side[c] = greatest - least;
        }
    }
    let cell = max(max(side.x, max(side.y, side.z)), 1e-6) / f32(CANOPY_NODES - 1u - 2u * CANOPY_MARGIN);
    canopy.cell = cell;
    canopy.low = low / cell - f32(CANOPY_MARGIN);
    canopy.dims = min(vec3u(ceil(side / cell)) + 1u + 2u * CANOPY_MARGIN, vec3u(CANOPY_NODES));
}

@compute @workgroup_size(WORKGROUP)
fn clear_canopy(@builtin(global_invocation_id) id: vec3u) {
    if id.x < CANOPY_COUNT {
        atomicStore(&nodes[LENGTHS + id.x], 0u);
    }
}

fn in_canopy(x: vec3f) -> vec3f {
    return along_wind(x) / canopy.cell - canopy.low;
}

// The first of the eight nodes around a point, in w, and the offset from it in nodes. Points
// outside the grid are clamped to it.
fn canopy_corner(at: vec3f) -> vec4f {
    // A coordinate that is not a number becomes 0.
    let inside = select(vec3f(0.0), min(at, vec3f(canopy.dims - 1u)), at > vec3f(0.0));
    let low = min(vec3u(inside), canopy.dims - 2u);
    let first = low.x + canopy.dims.x * (low.y + canopy.dims.y * low.z);
    return vec4f(inside - vec3f(low), f32(first));
}

@compute @workgroup_size(WORKGROUP)
fn splat_canopy(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let row = canopy.dims.x;
    let layer = row * canopy.dims.y;
    var start = in_canopy(moved(strand, 0u));
    for (var i = 0u; i + 1u < strand.particles; i++) {
        let end = in_canopy(moved(strand, i + 1u));
        let edge = end - start;
        if !all_finite(edge) {
            start = end;
            continue;
        }
        let samples = u32(clamp(sqrt(dot(edge, edge)) + 0.5, 1.0, 64.0));
        let share = 1.0 / f32(samples);
        let part = rest_length(strand, i, 1u) * share * air.scale;
        for (var k = 0u; k < samples; k++) {
            let own = canopy_corner(start + ((f32(k) + 0.5) * share) * edge);
            for (var corner = 0u; corner < 8u; corner++) {
                let place = u32(own.w) + corner_offset(row, layer, corner);
                atomicAdd(&nodes[LENGTHS + place], u32(round(part * corner_weight(own.xyz, corner))));
            }
        }
        start = end;
    }
}

// One thread marches along each column downwind.
@compute @workgroup_size(WORKGROUP)
fn march_canopy(@builtin(global_invocation_id) id: vec3u) {
    let layer = canopy.dims.x * canopy.dims.y;
    if id.x >= layer {
        return;
    }
    // Half of the optical depth that a metre of hair at a node adds over a cell.
    let half = 0.5 / (canopy.cell * canopy.cell * air.stop);
    var depth = 0.0;
    var before = 0.0;
    for (var k = 0u; k < canopy.dims.z; k++) {
        let at = id.x + layer * k;
        let here = f32(atomicLoad(&nodes[LENGTHS + at])) / air.scale;
        if k > 0u {
            depth += half * (here + before);
        }
        before = here;
        set_node(OPEN + at, exp(-depth));
    }
}

fn trilinear(first: u32, row: u32, layer: u32, f: vec3f) -> f32 {
    let a = vec4f(node(first), node(first + row), node(first + layer), node(first + layer + row));
    let b = vec4f(node(first + 1u), node(first + row + 1u), node(first + layer + 1u), node(first + layer + row + 1u));
    let along_x = a + (b - a) * f.x;
    let along_y = along_x.xz + (along_x.yw - along_x.xz) * f.y;
    return along_y.x + (along_y.y - along_y.x) * f.z;
}

// The fraction of the wind that shelter leaves.
fn open_at(x: vec3f) -> f32 {
    var open = 1.0;
    if air.shelter > 0.0 && air.solids > 0u {
        let at = max(local(air.to_wake, x), vec3f(0.0));
        let low = vec3u(min(at, vec3f(f32(WAKE_NODES - 2u))));
        let first = low.x + WAKE_NODES * (low.y + WAKE_NODES * low.z);
        open -= air.shelter * trilinear(DEFICIT + first, WAKE_NODES, WAKE_LAYER, min(at - vec3f(low), vec3f(1.0)));
    }
    if air.stop > 0.0 {
        let own = canopy_corner(in_canopy(x));
        let row = canopy.dims.x;
        open *= trilinear(OPEN + u32(own.w), row, row * canopy.dims.y, own.xyz);
    }
    return open;
}

// cos 2πt, by a Taylor polynomial over a quarter turn.
fn cos_turns(turns: f32) -> f32 {
    let q = 0.25 - abs(turns - round(turns));
    let z = q * q;
    return q * ((((42.05869394489765 * z - 76.70585975306139) * z + 81.60524927607505) * z - 41.34170224039976) * z
        + 6.283185307179586);
}

@compute @workgroup_size(WORKGROUP)
fn sample_air(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let x = moved(strand, i);
        var u = air.mean;
        for (var k = 0u; k < air.modes; k++) {
            u += cos_turns(dot(air.each[k].wave, x) + air.each[k].phase) * air.each[k].amplitude;
        }
        u *= open_at(x);
        let at = entry(strand, i, 3u, 0u);
        wind[at] = u.x;
        wind[at + LANES] = u.y;
        wind[at + 2u * LANES] = u.z;
    }
}
