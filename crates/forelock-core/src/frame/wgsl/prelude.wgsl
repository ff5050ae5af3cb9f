// Text shared by all strand kernels: the arrays of `strands::Model` and `strands::State`, and 3×3
// algebra.
//
// A thread processes one strand: slot = block × LANES + lane. Adjacent threads of a workgroup
// access adjacent memory.

// Coefficients of a frame: `FrameTerms` on the CPU.
struct Frame {
    k_springs: vec3f,
    k_integrity: f32,
    tip_scales: vec3f,
    k_angular: f32,
    gravity: vec3f,
    k_altitude: f32,
    air: vec3f,
    // h c, for particles of unit mass.
    drag: f32,
    h: f32,
    inverse_h: f32,
    // One over the frame's time.
    inverse_dt: f32,
    length_damping: f32,
    elastic_limit: f32,
    breaking_point: f32,
    breaking_width: f32,
    healing: f32,
    healing_limit: f32,
    clamped: u32,
    // The same bits twice: see `has`.
    flags: vec2u,
    // The clearance before the first query; a device may not support infinity.
    unknown: f32,
    // Drag along a strand over that across it; growth of the drag rate with speed, times h, in 1/m.
    drag_along: f32,
    drag_quadratic: f32,
    // Follow the leader: shares by which a step restores the shape, their values at the tip over
    // those at the root, and collision queries after the first.
    shape_global: f32,
    shape_local: f32,
    tip_global: f32,
    tip_local: f32,
    recheck: u32,
    // The smallest relative mass of a particle.
    least_mass: f32,
    // With LIMIT_LENGTHS, the longest edge over its rest length.
    length_limit: f32,
    // Rods: α̃ l² of stretch and shear, α̃/L of bending and twist, the weight of rotations, the
    // share of the velocity relative to the air that a substep leaves, passes over the constraints.
    stretch_compliance: f32,
    bend_compliance: f32,
    rotation_weight: f32,
    keep: f32,
    iterations: u32,
    // Rows per particle of the solver's channels.
    channel_rows: u32,
    // Distance up to which friction holds strands in still surroundings, metres.
    held: f32,
}

// The head's pose at a substep's start and end, as maps from rest positions to positions.
struct Substep {
    start: mat4x4f,
    end: mat4x4f,
    carried_weight: vec3f,
    // The particle of each strand that a one-level kernel places.
    level: u32,
    // Added to positions before the substep, because the origin moves with the head.
    shift: vec3f,
    // The share of the frame that has passed at its start, and at its end.
    share_at_start: f32,
    // The head's rotation at its end, x y z w, and the head's angular velocity in it, s⁻¹.
    rotation: vec4f,
    spin: vec3f,
    share_at_end: f32,
    // 1 over the length of its span, s⁻¹.
    inverse_span: f32,
}

struct Block {
    first: u32,
    particles: u32,
    live: u32,
    // Samples of each edge on the grid.
    points: u32,
    // In the whole model: the place of the block's first particle, and the number of the block.
    place: u32,
    number: u32,
}

// A row of a solver's channels at its initial value, turned with the head at the frame's start and
// at its end; whether the channel starts in this frame; what its values are (SCALAR, VECTOR or
// ROTATION_VALUE), and which component of a value this row is.
struct ChannelRow {
    at_start: f32,
    at_end: f32,
    starts: u32,
    kind: u32,
    component: u32,
}

// Results of a frame over all strands.
struct Report {
    // Bits of the largest |l/l₀ − 1|.
    stretch: atomic<u32>,
    quarantined: atomic<u32>,
    // Particles that touch a solid in the frame's final collision pass; bits of the largest depth
    // left.
    touching: atomic<u32>,
    deepest: atomic<u32>,
    // Bits of the largest |l/l₀ − 1| after the lengths were restored.
    restored: atomic<u32>,
    // Contacts between strands in the last frame.
    contacts: atomic<u32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> substep: Substep;
@group(0) @binding(2) var<storage, read> blocks: array<Block>;
// Rows of LANES numbers, seven rows per particle: rest position, rest lengths to the next three
// particles, one over the first of these lengths. With MASSES a row a particle follows: the
// relative masses. With ROOT_FRAMES the last ROOT_ROWS rows a block are the motions of strands
// relative to the head: rotation (four rows) and shift at the frame's start, the same at its end.
@group(0) @binding(3) var<storage, read> model: array<f32>;
// Two rows a block: strand lengths and relative stiffnesses.
@group(0) @binding(4) var<storage, read> strands: array<f32>;
// Three rows per particle each. For solvers that keep them, the velocities are followed by the
// positions of the step before and by room for the load that velocities contain.
@group(0) @binding(5) var<storage, read_write> positions: array<f32>;
@group(0) @binding(6) var<storage, read_write> velocities: array<f32>;
// Two rows per particle: integrity and clearance.
@group(0) @binding(7) var<storage, read_write> memory: array<f32>;
// SCRATCH rows per particle: numbers as bits.
@group(0) @binding(8) var<storage, read_write> scratch: array<u32>;
@group(0) @binding(9) var<storage, read_write> report: Report;

// The channels of a solver: `channel_rows` rows per particle.
@group(0) @binding(35) var<storage, read_write> channels: array<f32>;
// The rows of a particle.
@group(0) @binding(36) var<storage, read> channel_starts: array<ChannelRow>;

// This thread's strand.
struct Strand {
    // Place of its first particle.
    first: u32,
    lane: u32,
    particles: u32,
    block: u32,
    here: bool,
}

fn strand_of(slot: u32) -> Strand {
    let count = arrayLength(&blocks);
    let number = min(slot / LANES, count - 1u);
    let block = blocks[number];
    let lane = slot % LANES;
    return Strand(block.first, lane, block.particles, number, slot / LANES < count && lane < block.live);
}

// The number of particle `i` of a strand in the whole model.
fn number_of(strand: Strand, i: u32) -> u32 {
    return (blocks[strand.block].place + i) * LANES + strand.lane;
}

// The entry of row `row` (of `rows` a particle) of particle `i`.
fn entry(strand: Strand, i: u32, rows: u32, row: u32) -> u32 {
    return (rows * (strand.first + i) + row) * LANES + strand.lane;
}

// The entry of a row of the channels of particle `i`.
fn channel_entry(strand: Strand, i: u32, row: u32) -> u32 {
    return entry(strand, i, frame.channel_rows, row);
}

fn channel_vector(at: u32) -> vec3f {
    return vec3f(channels[at], channels[at + LANES], channels[at + 2u * LANES]);
}

fn set_channel_vector(at: u32, v: vec3f) {
    channels[at] = v.x;
    channels[at + LANES] = v.y;
    channels[at + 2u * LANES] = v.z;
}

fn rest_at(strand: Strand, i: u32) -> vec3f {
    let at = entry(strand, i, MODEL_ROWS, 0u);
    return vec3f(model[at], model[at + LANES], model[at + 2u * LANES]);
}

fn position_at(strand: Strand, i: u32) -> vec3f {
    let at = entry(strand, i, 3u, 0u);
    return vec3f(positions[at], positions[at + LANES], positions[at + 2u * LANES]);
}

fn velocity_at(strand: Strand, i: u32) -> vec3f {
    let at = entry(strand, i, 3u, 0u);
    return vec3f(velocities[at], velocities[at + LANES], velocities[at + 2u * LANES]);
}

fn set_position(strand: Strand, i: u32, x: vec3f) {
    let at = entry(strand, i, 3u, 0u);
    positions[at] = x.x;
    positions[at + LANES] = x.y;
    positions[at + 2u * LANES] = x.z;
}

fn set_velocity(strand: Strand, i: u32, v: vec3f) {
    let at = entry(strand, i, 3u, 0u);
    velocities[at] = v.x;
    velocities[at + LANES] = v.y;
    velocities[at + 2u * LANES] = v.z;
}

// The index of an entry in one of the arrays stored after the velocities: 1 the first, 2 the
// second.
fn later_entry(strand: Strand, i: u32, array: u32) -> u32 {
    return array * (arrayLength(&velocities) / 3u) + entry(strand, i, 3u, 0u);
}

fn later_vector(at: u32) -> vec3f {
    return vec3f(velocities[at], velocities[at + LANES], velocities[at + 2u * LANES]);
}

fn set_later_vector(at: u32, v: vec3f) {
    velocities[at] = v.x;
    velocities[at + LANES] = v.y;
    velocities[at + 2u * LANES] = v.z;
}

fn previous_at(strand: Strand, i: u32) -> vec3f {
    return later_vector(later_entry(strand, i, 1u));
}

fn set_previous(strand: Strand, i: u32, x: vec3f) {
    set_later_vector(later_entry(strand, i, 1u), x);
}

fn load_at(strand: Strand, i: u32) -> vec3f {
    return later_vector(later_entry(strand, i, 2u));
}

fn set_load(strand: Strand, i: u32, v: vec3f) {
    set_later_vector(later_entry(strand, i, 2u), v);
}

// Rest length from particle `i` to `i + reach`, 1 to 3.
fn rest_length(strand: Strand, i: u32, reach: u32) -> f32 {
    return model[entry(strand, i, MODEL_ROWS, 2u + reach)];
}

fn inverse_rest_edge(strand: Strand, i: u32) -> f32 {
    return model[entry(strand, i, MODEL_ROWS, 6u)];
}

// The relative mass of particle `i`.
fn mass_at(strand: Strand, i: u32) -> f32 {
    if !has(MASSES) {
        return 1.0;
    }
    // Positions have three rows per particle.
    return model[MODEL_ROWS * (arrayLength(&positions) / 3u) + entry(strand, i, 1u, 0u)];
}

fn strand_length(strand: Strand) -> f32 {
    return strands[(2u * strand.block) * LANES + strand.lane];
}

fn strand_stiffness(strand: Strand) -> f32 {
    return strands[(2u * strand.block + 1u) * LANES + strand.lane];
}

fn scratch_vector(strand: Strand, i: u32, row: u32) -> vec3f {
    let at = entry(strand, i, SCRATCH, row);
    return bitcast<vec3f>(vec3u(scratch[at], scratch[at + LANES], scratch[at + 2u * LANES]));
}

fn set_scratch_vector(strand: Strand, i: u32, row: u32, v: vec3f) {
    let at = entry(strand, i, SCRATCH, row);
    let bits = bitcast<vec3u>(v);
    scratch[at] = bits.x;
    scratch[at + LANES] = bits.y;
    scratch[at + 2u * LANES] = bits.z;
}

fn scratch_number(at: u32) -> f32 {
    return bitcast<f32>(scratch[at]);
}

fn set_scratch_number(at: u32, x: f32) {
    scratch[at] = bitcast<u32>(x);
}

// Whether the frame has a flag. The index is not constant: where a condition depends on nothing but
// uniforms at constant places, the software driver of Mesa 22 may compile the kernel anew in each
// dispatch and keep every copy: memory grew by 7 MB a frame.
fn has(flag: u32) -> bool {
    return (frame.flags[frame.clamped & 1u] & flag) != 0u;
}

// Whether a number is finite, by its bits: compilers may assume that floats are finite.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

fn all_finite(v: vec3f) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

// Maps floats to integers of the same order, and back.
fn ordered(x: f32) -> u32 {
    let bits = bitcast<u32>(x);
    return select(bits | 0x80000000u, ~bits, (bits & 0x80000000u) != 0u);
}

fn unordered(bits: u32) -> f32 {
    return bitcast<f32>(select(~bits, bits & 0x7fffffffu, (bits & 0x80000000u) != 0u));
}

// Smallest and largest coordinates of a strand. Positions that are not finite are skipped.
struct Extent {
    low: vec3f,
    high: vec3f,
}

// The extent of a strand's positions, translated by `shift` and then mapped.
fn extent_of(strand: Strand, map: mat4x4f, shift: vec3f) -> Extent {
    var own = Extent(vec3f(FAR), vec3f(-FAR));
    for (var i = 0u; i < strand.particles; i++) {
        let at = (map * vec4f(position_at(strand, i) + shift, 1.0)).xyz;
        if all_finite(at) {
            own.low = min(own.low, at);
            own.high = max(own.high, at);
        }
    }
    return own;
}

// Corner 0 to 7 of a cell: its trilinear weight for a point at `f`, and its index relative to
// corner 0.
fn corner_weight(f: vec3f, corner: u32) -> f32 {
    let w = select(1.0 - f, f, (vec3u(corner) & vec3u(1u, 2u, 4u)) != vec3u(0u));
    return w.x * w.y * w.z;
}

fn corner_offset(row: u32, layer: u32, corner: u32) -> u32 {
    return (corner & 1u) + select(0u, row, (corner & 2u) != 0u) + select(0u, layer, (corner & 4u) != 0u);
}

// The largest |l/l₀ − 1| of a strand's edges. Edges that are not finite are skipped.
fn largest_stretch(strand: Strand) -> f32 {
    return largest_change(strand, 1.0);
}

// The largest l/l₀ − 1, at least 0: compressed edges do not count.
fn largest_extension(strand: Strand) -> f32 {
    return largest_change(strand, 0.0);
}

// The largest l/l₀ − 1, or 1 − l/l₀ times `shorter`.
fn largest_change(strand: Strand, shorter: f32) -> f32 {
    var largest = 0.0;
    var before = position_at(strand, 0u);
    for (var i = 1u; i < strand.particles; i++) {
        let x = position_at(strand, i);
        let d = x - before;
        let stretch = sqrt(max(dot(d, d), 1e-24)) / rest_length(strand, i - 1u, 1u) - 1.0;
        let change = max(stretch, -shorter * stretch);
        largest = max(largest, select(0.0, change, all_finite(x) && all_finite(before)));
        before = x;
    }
    return largest;
}

// A symmetric matrix: its diagonal, and xy, xz, yz.
struct Sym {
    d: vec3f,
    o: vec3f,
}

fn sym_add(a: Sym, b: Sym) -> Sym {
    return Sym(a.d + b.d, a.o + b.o);
}

fn sym_mul(s: Sym, v: vec3f) -> vec3f {
    return vec3f(
        s.d.x * v.x + s.o.x * v.y + s.o.y * v.z,
        s.o.x * v.x + s.d.y * v.y + s.o.z * v.z,
        s.o.y * v.x + s.o.z * v.y + s.d.z * v.z,
    );
}

fn sym_matrix(s: Sym) -> mat3x3f {
    return mat3x3f(s.d.x, s.o.x, s.o.y, s.o.x, s.d.y, s.o.z, s.o.y, s.o.z, s.d.z);
}

// a d dᵀ + b I.
fn outer_plus_identity(a: f32, d: vec3f, b: f32) -> Sym {
    let e = a * d;
    return Sym(e * d + b, e.xxy * d.yzz);
}

// s − Σ_k l_k a_kᵀ, which is symmetric.
fn sym_sub_product(s: Sym, l: mat3x3f, a: mat3x3f) -> Sym {
    return Sym(
        s.d - l[0] * a[0] - l[1] * a[1] - l[2] * a[2],
        s.o - l[0].xxy * a[0].yzz - l[1].xxy * a[1].yzz - l[2].xxy * a[2].yzz,
    );
}
