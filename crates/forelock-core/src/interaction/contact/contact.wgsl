// What kernels of contacts share: the twins of `contact::{Ways, Drift, Histogram}`.
//
// A particle has a number: its place in the whole model × LANES + lane, whatever batch it is in; a
// segment that of its lower particle. `work` is bits of floats and numbers: of each particle where
// it is at the frame's end and how far it strays (rows), then from `contacts.bodies` on what is
// needed one after the other: nodes of the drift; entries in cells; bodies (rows). Then lists: of
// each active segment the contacts found, two numbers each; joints, field by field; their sides.

const STRAY: u32 = 3u;
const NOTHING: u32 = 0xffffffffu;
// The number of a segment in an entry, and what is set in it of an active one.
const ACTIVE: u32 = 0x80000000u;
// The number of a segment in a contact that was found, beside that of the slice.
const SLICE_BITS: u32 = 30u;
const SEGMENT: u32 = (1u << SLICE_BITS) - 1u;

struct Contacts {
    // The head's frame from positions, at the frame's start and at its end.
    from_start: mat4x4f,
    from_end: mat4x4f,
    // The length that the search is made for, the contact distance, what two may approach in a
    // frame and be let pass. Metres.
    edge: f32,
    distance: f32,
    slip: f32,
    friction: f32,
    // Length of strand that a contact bends at least, the frame's time, what a pair may lack when
    // the rounds end, hair how far out counts for the box.
    spread: f32,
    dt: f32,
    close: f32,
    far: f32,
    // Nodes of the drift at least so far apart; one over the longest piece; one over the count of
    // particles.
    spacing: f32,
    inverse_piece: f32,
    inverse_particles: f32,
    pad_0: f32,
    // Contacts in a frame at most, particles whose segments are active, particles that may stray
    // farther than slices are made for.
    budget: u32,
    most_active: u32,
    few: u32,
    per_segment: u32,
    rounds: u32,
    clamped: u32,
    // Cells, a power of two; entries in them.
    cells: u32,
    entries: u32,
    // Numbers of particles; where in `work` bodies, found contacts, joints and sides begin.
    numbers: u32,
    bodies: u32,
    found: u32,
    joints: u32,
    sides: u32,
    // Active segments and joints that there is room for; strands, with those that are not live.
    most_actives: u32,
    most_joints: u32,
    strands: u32,
}

struct Touch {
    // The box of hair, start and end, and the nodes of the drift in it.
    low: vec3f,
    spacing: f32,
    high: vec3f,
    // Slices of the frame, none if nothing strays; the slice that is searched.
    slices: u32,
    dims: vec3u,
    slice: u32,
    // Least and greatest coordinates, ordered as integers.
    extent: array<atomic<u32>, 6>,
    // Sum of the squares of strays, over that of an edge, in 2⁻¹⁶; the largest, as bits.
    squares: array<atomic<u32>, 2>,
    fastest: atomic<u32>,
    // How many are on the list of active segments, how many contacts were kept, how much of a list
    // is given away.
    actives: atomic<u32>,
    joints: atomic<u32>,
    taken: atomic<u32>,
    // A segment is active if its stray exceeds `least`, and lies above a bin of the histogram, or
    // in it, by a share.
    least: f32,
    bin: u32,
    share: f32,
    // The same of contacts found.
    found_bin: u32,
    found_share: f32,
    // Rounds: momentum of this one, its number, whether it is the last, whether they are done.
    momentum: f32,
    round: u32,
    last: u32,
    done: u32,
    // Bits of the most that a pair lacks, and of the farthest that a particle was moved.
    lack: atomic<u32>,
    farthest: atomic<u32>,
    // Whether entries are put where they belong, not only counted.
    shelves: u32,
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

// Where in an array of `rows` rows a place a row of a particle is.
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

// Where a particle is at the frame's start and end, in the head's frame.
fn start_of(number: u32) -> vec3f {
    let at = row_of(number, 3u, 0u);
    return vec3f(starts[at], starts[at + LANES], starts[at + 2u * LANES]);
}

fn end_of(number: u32) -> vec3f {
    return work_vector(row_of(number, WAY_ROWS, 0u));
}

// How far the segment's ends stray, metres.
fn stray_of(segment: u32) -> f32 {
    return max(real(row_of(segment, WAY_ROWS, STRAY)), real(row_of(segment + LANES, WAY_ROWS, STRAY)));
}

// The longest side of the box, metres.
fn side_of_box() -> f32 {
    let size = touch.high - touch.low;
    return max(max(size.x, size.y), max(size.z, 1e-20));
}

fn in_box(at: vec3f) -> bool {
    return all_finite(at) && all(at >= touch.low) && all(at <= touch.high);
}

fn bin_of(x: f32) -> u32 {
    return bitcast<u32>(x) >> BIN_BITS;
}

// Whether what lies in the last bin belongs: a share of all, spread evenly by the multiples of the
// golden ratio.
fn chance(number: u32) -> f32 {
    return f32(number * 0x9e3779b9u) * 2.3283064e-10;
}

fn is_active(segment: u32, stray: f32) -> bool {
    let bin = bin_of(stray);
    return stray > touch.least && (bin > touch.bin || bin == touch.bin && chance(segment) < touch.share);
}

// Whether this slice is searched.
fn is_searched() -> bool {
    return touch.slice < touch.slices;
}

fn middle_of_slice() -> f32 {
    return (f32(touch.slice) + 0.5) / f32(touch.slices);
}

// A piece of a segment in the middle of a slice: a ball about its middle.
struct Piece {
    middle: vec3f,
    // From its middle to its upper end.
    half: vec3f,
    radius: f32,
    reach: f32,
}

fn pieces_of(rest_length: f32) -> u32 {
    return u32(clamp(ceil(rest_length * contacts.inverse_piece), 1.0, PIECES));
}

// What a segment reaches beyond itself. A quarter more than it strays, for the drift is not quite
// the same for both of a pair.
fn reach_of(stray: f32, is_one: bool) -> f32 {
    let most = select(REACH_OTHER, REACH_ACTIVE, is_one) * contacts.edge;
    return min(0.5 * (contacts.distance + 1.25 * stray / f32(touch.slices)), most);
}

// Piece `k` of so many of the segment from `lower` to `upper`.
fn piece_of(lower: vec3f, upper: vec3f, k: u32, pieces: u32, reach: f32) -> Piece {
    let half = (upper - lower) * (0.5 / f32(pieces));
    let middle = lower + f32(2u * k + 1u) * half;
    return Piece(middle, half, min(length(half), HALF_PIECE * contacts.edge) + reach, reach);
}

// Cells are an edge wide.
fn cell_of(at: vec3f) -> vec3u {
    return vec3u(max(at - touch.low, vec3f()) / contacts.edge);
}

// Cells that are neighbours along x are neighbours in the table.
fn bucket_of(cell: vec3u) -> u32 {
    return (cell.x + ((cell.y * 73856093u) ^ (cell.z * 19349663u))) & (contacts.cells - 1u);
}

// The table, while joints are linked: how many sides of joints each segment has, and where the next
// of them goes; over what length each strand is bent.
fn count_at(segment: u32) -> u32 {
    return segment;
}

fn cursor_at(segment: u32) -> u32 {
    return contacts.numbers + segment;
}

// Where a segment's sides begin in the lists, and how many they are, once all are linked: where the
// next one goes is behind all of them.
fn list_of(segment: u32) -> vec2u {
    let count = atomicLoad(&table[count_at(segment)]);
    return vec2u(atomicLoad(&table[cursor_at(segment)]) - count, count);
}

fn bend_at(slot: u32) -> u32 {
    return 2u * contacts.numbers + slot;
}

// Fields of a joint: its segments, where on each they meet, the normal from the second to the
// first, the gap to keep, when they meet and how far they approach; one over W; λ, j_N and j_T
// after the last round and as extrapolated for this one; what this round adds.
const SEGMENTS: u32 = 0u;
const ALONG: u32 = 2u;
const NORMAL: u32 = 4u;
const GAP: u32 = 7u;
const WHEN: u32 = 8u;
const APPROACH: u32 = 9u;
const INVERSE_W: u32 = 10u;
const PUSH: u32 = 11u;
const PRESS: u32 = 13u;
const RUB: u32 = 15u;
const JOINT_MOVES: u32 = 21u;
const JOINT_KICKS: u32 = 24u;
// Whether both segments keep it.
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

// Sides of joints, 2 × joint + side, in lists of segments: in their order, and behind all of these
// when, other segment and side in the order in which they came.
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
const KICKS: u32 = 9u;
// Σ |w| of its joints, then S of that; α to the next particle, and one over the pivot.
const SHARE: u32 = 12u;
const ALPHA: u32 = 13u;
const PIVOT: u32 = 14u;

fn body_at(number: u32, row: u32) -> u32 {
    return contacts.bodies + row_of(number, BODY_ROWS, row);
}
