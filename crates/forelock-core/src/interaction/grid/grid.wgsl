// The grid of hair–hair interaction, as in `grid`: cells of a box that moves with the head.
//
// `cells` has planes of `grid.capacity` numbers, x fastest: first MOMENTUM along each axis, MASS
// and the volumes FILLED and AT_REST of the cell, as integers while hair is splat; then MOMENTUM,
// MASS (or SOLID) and DENSITY, as bits of floats; LACK (the right-hand side), PRESSURE and WALL
// (the solid) of the cell, likewise; and a LIST of the cells where pressure can act, red ones from
// its start, black ones from its end.

const MOMENTUM: u32 = 0u;
const MASS: u32 = 3u;
const FILLED: u32 = 4u;
const DENSITY: u32 = 4u;
const AT_REST: u32 = 5u;
const LACK: u32 = 6u;
const PRESSURE: u32 = 7u;
const WALL: u32 = 8u;
const LIST: u32 = 9u;

// The mass of a cell inside a solid.
const SOLID: f32 = -1.0;

// A solid: the maps from cells to its local space and to its velocity relative to the grid.
struct GridSolid {
    local: mat4x4f,
    velocity: mat4x4f,
}

struct Grid {
    // Cells from positions.
    place: mat4x4f,
    // Velocity of the grid along its axes, from positions.
    motion: mat4x4f,
    // Grid axes from world axes.
    axes: mat4x4f,
    cell: f32,
    // Fraction of PIC.
    pic: f32,
    // Side of a cell over the length of the frame, m/s.
    slack: f32,
    // Fraction of an excess volume that expands in the frame.
    expand: f32,
    // Length of hair below which a face is closed, metres.
    least: f32,
    // Metres of hair to the unit of the sums of mass.
    unit: f32,
    tolerance: f32,
    // Maximum number of cells.
    capacity: u32,
    solids: u32,
    relaxation: f32,
    // Cells to the unit of the sums of volume: FILLED and AT_REST.
    volumes: vec2f,
    each: array<GridSolid, MOST_SOLIDS>,
}

// The box of cells, and the results of the frame.
struct Bounds {
    // The first cell, in cells from the grid's origin.
    low: vec3i,
    count: u32,
    dims: vec3u,
    layer: u32,
    // Smallest and largest coordinates of the hair in cells, ordered as integers.
    extent: array<atomic<u32>, 6>,
    // Bits of the density of the densest cell, of the largest right-hand side, and of the largest
    // change of the last sweeps.
    densest: atomic<u32>,
    lack: atomic<u32>,
    change: atomic<u32>,
    // Cells under pressure.
    held: atomic<u32>,
    // Whether the pressure has converged.
    found: u32,
    // Sweeps of all pressure solves of the frame.
    sweeps: u32,
    // Red and black cells on the list.
    listed: array<atomic<u32>, 2>,
    // The last change over the largest right-hand side; the largest of these at the end of a solve
    // of the frame.
    ratio: f32,
    residual: f32,
}

// Integers to the unit while hair is splat.
const SCALE: f32 = 4194304.0;

@group(0) @binding(14) var<storage, read_write> bounds: Bounds;
@group(0) @binding(16) var<uniform> grid: Grid;

fn clear_list() {
    atomicStore(&bounds.listed[0], 0u);
    atomicStore(&bounds.listed[1], 0u);
}

fn plane(number: u32, cell: u32) -> u32 {
    return number * grid.capacity + cell;
}

// The distance in a plane between neighbours along an axis.
fn stride(axis: u32) -> u32 {
    return vec3u(1u, bounds.dims.x, bounds.layer)[axis];
}

// The first of the eight cells around a point, and the offset from its middle along each axis.
struct Stencil {
    first: u32,
    f: vec3f,
}

// The stencil at the point `at` of the box.
fn stencil(at: vec3f) -> Stencil {
    let low = vec3u(at - 0.5);
    return Stencil(low.x + bounds.dims.x * low.y + bounds.layer * low.z, at - 0.5 - vec3f(low));
}

fn corner_place(stencil: Stencil, corner: u32) -> u32 {
    return stencil.first + corner_offset(bounds.dims.x, bounds.layer, corner);
}

// Whether the stencil of a point lies inside the box.
fn holds(at: vec3f) -> bool {
    return all_finite(at) && all(at >= vec3f(2.0)) && all(at < vec3f(bounds.dims) - 2.5);
}

// A position, in cells from the box's first.
fn in_cells(x: vec3f) -> vec3f {
    return (grid.place * vec4f(x, 1.0)).xyz - vec3f(bounds.low);
}

// Velocity relative to the grid, along its axes.
fn on_grid(x: vec3f, v: vec3f) -> vec3f {
    return (grid.axes * vec4f(v, 0.0)).xyz - (grid.motion * vec4f(x, 1.0)).xyz;
}
