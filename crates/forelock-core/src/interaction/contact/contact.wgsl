// Shared by the kernels of contacts: the GPU counterpart of `contact::{Displacements, MeanMotion,
// Histogram}`.
//
// A particle has a number: its place in the whole model × LANES + lane, whatever its batch; the
// number of a segment is that of its lower particle. `work` holds bits of floats and integers: rows
// of the end position and the residual motion of each particle; from `contacts.bodies` on data that
// is needed one after the other: nodes of the mean motion, entries of cells, rows of bodies. Then
// lists: the contacts found of each active segment, two numbers each; the joints, field by field;
// the sides of joints.

const RESIDUAL_MOTION: u32 = 3u;
const NOTHING: u32 = 0xffffffffu;
// Flag in the segment number of an entry: the segment is active.
const ACTIVE: u32 = 0x80000000u;
// Bits of the segment number in a found contact; the slice is in the higher bits.
const SLICE_BITS: u32 = 30u;
const SEGMENT: u32 = (1u << SLICE_BITS) - 1u;

struct Contacts {
    // Maps positions to the frame of the head, at the start and at the end of the frame.
    from_start: mat4x4f,
    from_end: mat4x4f,
    // Length scale of the search, contact distance, approach in a frame below which contacts are
    // ignored. Metres.
    edge: f32,
    distance: f32,
    slip: f32,
    friction: f32,
    // Minimum length of strand that a contact bends; length of the frame; violation of the gap at
    // which rounds stop; distance from the centre beyond which hair is ignored in the box.
    spread: f32,
    dt: f32,
    close: f32,
    far: f32,
    // Minimum distance between nodes of the mean motion; inverse of the longest piece; inverse of
    // the number of particles.
    spacing: f32,
    inverse_piece: f32,
    inverse_particles: f32,
    // Displacement relative to the mean motion that friction holds in a frame, metres.
    hold: f32,
    // Maximum number of contacts in a frame; maximum number of active particles; number of
    // particles that may exceed the residual motion for which slices are chosen.
    budget: u32,
    most_active: u32,
    few: u32,
    per_segment: u32,
    rounds: u32,
    clamped: u32,
    // Number of cells, a power of two; number of entries.
    cells: u32,
    entries: u32,
    // Count of particle numbers; where in `work` bodies, found contacts, joints and sides begin.
    numbers: u32,
    bodies: u32,
    found: u32,
    joints: u32,
    sides: u32,
    // Capacity for active segments and for joints; number of strands, including inactive lanes.
    most_actives: u32,
    most_joints: u32,
    strands: u32,
}

struct Touch {
    // Bounding box of the hair at the start and at the end of the frame, and the nodes of the mean
    // motion in it.
    low: vec3f,
    spacing: f32,
    high: vec3f,
    // Number of slices of the frame, 0 if there is no residual motion; the current slice.
    slices: u32,
    dims: vec3u,
    slice: u32,
    // Smallest and largest coordinates, ordered as integers.
    extent: array<atomic<u32>, 6>,
    // Sum of the squared residual motions relative to an edge, in units of 2⁻¹⁶; bits of the
    // largest.
    squares: array<atomic<u32>, 2>,
    fastest: atomic<u32>,
    // Length of the list of active segments; number of kept contacts; number of reserved entries of
    // a list.
    actives: atomic<u32>,
    joints: atomic<u32>,
    taken: atomic<u32>,
    // A segment is active if its residual motion exceeds `least` and lies above a bin of the
    // histogram, or in that bin for a fraction of the segments.
    least: f32,
    bin: u32,
    share: f32,
    // The same for found contacts.
    found_bin: u32,
    found_share: f32,
    // Rounds: momentum of this round, its number, whether it is the last, whether all are done.
    momentum: f32,
    round: u32,
    last: u32,
    done: u32,
    // Bits of the largest violation of a pair, and of the largest distance that a particle was
    // moved.
    lack: atomic<u32>,
    farthest: atomic<u32>,
    // Whether entries are stored; in the first pass they are only counted.
    stores_entries: u32,
    bins: array<atomic<u32>, BINS>,
    // Numbers of the active segments.
    list: array<u32>,
}

@group(0) @binding(25) var<storage, read_write> starts: array<f32>;
@group(0) @binding(26) var<storage, read_write> work: array<u32>;
@group(0) @binding(27) var<storage, read_write> table: array<atomic<u32>>;
@group(0) @binding(28) var<storage, read_write> touch: Touch;
@group(0) @binding(29) var<uniform> contacts: Contacts;
// The model of all strands; the block of each place.
@group(0) @binding(30) var<storage, read> rest: array<f32>;
@group(0) @binding(31) var<storage, read> owners: array<u32>;

// Index of row `row` of a particle in an array of `rows` rows a place.
fn row_of(number: u32, rows: u32, row: u32) -> u32 {
    return (rows * (number / LANES) + row) * LANES + number % LANES;
}

fn real(at: u32) -> f32 {
    return bitcast<f32>(work[at]);
}

fn set_real(at: u32, x: f32) {
    work[at] = bitcast<u32>(x);
}

fn work_vector(at: u32) -> vec3f {
    return bitcast<vec3f>(vec3u(work[at], work[at + LANES], work[at + 2u * LANES]));
}

fn set_work_vector(at: u32, v: vec3f) {
    let bits = bitcast<vec3u>(v);
    work[at] = bits.x;
    work[at + LANES] = bits.y;
    work[at + 2u * LANES] = bits.z;
}

// Start and end position of a particle in the frame of the head.
fn start_of(number: u32) -> vec3f {
    let at = row_of(number, 3u, 0u);
    return vec3f(starts[at], starts[at + LANES], starts[at + 2u * LANES]);
}

fn end_of(number: u32) -> vec3f {
    return work_vector(row_of(number, MOTION_ROWS, 0u));
}

// Residual motion of a segment, the larger of its ends, metres.
fn residual_motion_of(segment: u32) -> f32 {
    return max(real(row_of(segment, MOTION_ROWS, RESIDUAL_MOTION)), real(row_of(segment + LANES, MOTION_ROWS, RESIDUAL_MOTION)));
}

// The longest side of the box, metres.
fn side_of_box() -> f32 {
    let size = touch.high - touch.low;
    return max(max(size.x, size.y), max(size.z, 1e-20));
}

fn in_box(at: vec3f) -> bool {
    return all_finite(at) && all(at >= touch.low) && all(at <= touch.high);
}

// A sum of 64 bits, lower half first (`add_wide`).
fn wide(at: u32) -> f32 {
    var low = atomicLoad(&table[at]);
    var high = atomicLoad(&table[at + 1u]);
    let negative = (high & 0x80000000u) != 0u;
    if negative {
        low = ~low + 1u;
        high = ~high + select(0u, 1u, low == 0u);
    }
    let sum = f32(high) * 4294967296.0 + f32(low);
    return select(sum, -sum, negative);
}

// The mean displacement of what was summed at a node.
fn mean_of_sums(node: u32) -> vec3f {
    let at = 8u * node;
    let sum = vec3f(wide(at), wide(at + 2u), wide(at + 4u));
    return sum * (side_of_box() / max(wide(at + 6u), 1.0));
}

fn bin_of(x: f32) -> u32 {
    return bitcast<u32>(x) >> BIN_BITS;
}

// A pseudo-random number in [0, 1) that selects a fraction of the last bin, evenly spread by the
// multiples of the golden ratio.
fn chance(number: u32) -> f32 {
    return f32(number * 0x9e3779b9u) * 2.3283064e-10;
}

fn is_active(segment: u32, residual: f32) -> bool {
    let bin = bin_of(residual);
    return residual > touch.least && (bin > touch.bin || bin == touch.bin && chance(segment) < touch.share);
}

// Whether this slice is searched.
fn is_searched() -> bool {
    return touch.slice < touch.slices;
}

fn middle_of_slice() -> f32 {
    return (f32(touch.slice) + 0.5) / f32(touch.slices);
}

// A piece of a segment in the middle of a slice, bounded by a ball around its centre.
struct Piece {
    middle: vec3f,
    // From the centre to the upper end.
    half: vec3f,
    radius: f32,
    reach: f32,
}

fn pieces_of(rest_length: f32) -> u32 {
    return u32(clamp(ceil(rest_length * contacts.inverse_piece), 1.0, PIECES));
}

// Margin of a segment. The residual motion is enlarged by a quarter, because the mean motion
// differs slightly between both segments of a pair.
fn reach_of(residual: f32, is_one: bool) -> f32 {
    let most = select(REACH_OTHER, REACH_ACTIVE, is_one) * contacts.edge;
    return min(0.5 * (contacts.distance + 1.25 * residual / f32(touch.slices)), most);
}

// Piece `k` of `pieces` of the segment from `lower` to `upper`.
fn piece_of(lower: vec3f, upper: vec3f, k: u32, pieces: u32, reach: f32) -> Piece {
    let half = (upper - lower) * (0.5 / f32(pieces));
    let middle = lower + f32(2u * k + 1u) * half;
    return Piece(middle, half, min(length(half), HALF_PIECE * contacts.edge) + reach, reach);
}

// Cells are an edge wide.
fn cell_of(at: vec3f) -> vec3u {
    return vec3u(max(at - touch.low, vec3f()) / contacts.edge);
}

// Neighbouring cells along x are adjacent in the table.
fn bucket_of(cell: vec3u) -> u32 {
    return (cell.x + ((cell.y * 73856093u) ^ (cell.z * 19349663u))) & (contacts.cells - 1u);
}

// The table, while joints are linked: number of sides of joints of each segment, and index of the
// next one; length over which each strand is bent.
fn count_at(segment: u32) -> u32 {
    return segment;
}

fn cursor_at(segment: u32) -> u32 {
    return contacts.numbers + segment;
}

// First index and number of the sides of a segment in the lists, once all are linked: the index of
// the next one is then behind the last.
fn list_of(segment: u32) -> vec2u {
    let count = atomicLoad(&table[count_at(segment)]);
    return vec2u(atomicLoad(&table[cursor_at(segment)]) - count, count);
}

fn bend_at(slot: u32) -> u32 {
    return 2u * contacts.numbers + slot;
}

// Fields of a joint: its segments; the position of the contact on each; the normal from the second
// to the first; the gap; the time of the contact; the approach; the inverse of W; λ, j_N and j_T
// after the last round and as extrapolated for this one; the contributions of this round.
const SEGMENTS: u32 = 0u;
const ALONG: u32 = 2u;
const NORMAL: u32 = 4u;
const GAP: u32 = 7u;
const WHEN: u32 = 8u;
const APPROACH: u32 = 9u;
const INVERSE_W: u32 = 10u;
const LAMBDA: u32 = 11u;
const NORMAL_IMPULSE: u32 = 13u;
const TANGENT_IMPULSE: u32 = 15u;
const JOINT_MOVES: u32 = 21u;
const JOINT_IMPULSES: u32 = 24u;
// Whether both segments keep the joint.
const KEPT: u32 = 27u;

fn field_at(joint: u32, field: u32) -> u32 {
    return contacts.joints + field * contacts.most_joints + joint;
}

fn field_of(joint: u32, field: u32) -> f32 {
    return real(field_at(joint, field));
}

fn field_vector(joint: u32, field: u32) -> vec3f {
    return vec3f(field_of(joint, field), field_of(joint, field + 1u), field_of(joint, field + 2u));
}

fn set_field(joint: u32, field: u32, x: f32) {
    set_real(field_at(joint, field), x);
}

fn set_field_vector(joint: u32, field: u32, v: vec3f) {
    for (var c = 0u; c < 3u; c++) {
        set_field(joint, field + c, v[c]);
    }
}

// Sides of joints, 2 × joint + side, in lists of segments: sorted; and after all of these the time,
// the other segment and the side, in the order of insertion.
fn sorted_at(place: u32) -> u32 {
    return contacts.sides + place;
}

fn side_at(place: u32) -> u32 {
    return contacts.sides + 2u * contacts.most_joints + 3u * place;
}

fn joint_count() -> u32 {
    return min(atomicLoad(&touch.joints), contacts.most_joints);
}

// Rows of a body.
const PLACE: u32 = 0u;
const VELOCITY: u32 = 3u;
const MOVES: u32 = 6u;
const IMPULSES: u32 = 9u;
// Σ |w| of the joints, then S of that; α to the next particle; the inverse pivot.
const SHARE: u32 = 12u;
const ALPHA: u32 = 13u;
const PIVOT: u32 = 14u;

fn body_at(number: u32, row: u32) -> u32 {
    return contacts.bodies + row_of(number, BODY_ROWS, row);
}
