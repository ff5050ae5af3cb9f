// Contacts, as far as they are sought among all strands at once: nodes of the drift, cells, pairs; the twin of `find_contacts`.
//
// Nothing depends on the order in which threads come: sums are of integers, what is kept of a list is its greatest, and lists that come in any order are only gone through as a whole.

fn rest_of(number: u32) -> vec3f {
    let at = row_of(number, MODEL_ROWS, 0u);
    return vec3f(rest[at], rest[at + LANES], rest[at + 2u * LANES]);
}

// Pieces in which a segment is entered.
fn own_pieces_of(segment: u32) -> u32 {
    return pieces_of(rest[row_of(segment, MODEL_ROWS, 3u)]);
}

// The box of the frame, and nothing found.
@compute @workgroup_size(1)
fn fit_drift() {
    var low = vec3f();
    var high = vec3f();
    for (var c = 0u; c < 3u; c++) {
        low[c] = unordered(atomicExchange(&touch.extent[c], NOTHING));
        high[c] = unordered(atomicExchange(&touch.extent[3u + c], 0u));
    }
    // Nothing was near.
    if !all(low <= high) {
        low = vec3f();
        high = vec3f();
    }
    let size = high - low;
    touch.low = low;
    touch.high = high;
    touch.spacing = max(meet.spacing, max(size.x, max(size.y, size.z)) / f32(DRIFT_NODES - 2u));
    touch.dims = min(vec3u(size / touch.spacing) + 2u, vec3u(DRIFT_NODES + 1u));
    touch.slices = 0u;
    touch.slice = 0u;
    atomicStore(&touch.squares[0], 0u);
    atomicStore(&touch.squares[1], 0u);
    atomicStore(&touch.fastest, 0u);
    atomicStore(&touch.actives, 0u);
    atomicStore(&touch.joints, 0u);
    atomicStore(&touch.farthest, 0u);
    atomicStore(&report.contacts, 0u);
}

fn node_count() -> u32 {
    return touch.dims.x * touch.dims.y * touch.dims.z;
}

@compute @workgroup_size(CELLS_GROUP)
fn clear_drift(@builtin(global_invocation_id) id: vec3u) {
    for (var at = id.x; at < 8u * node_count(); at += LIST_THREADS) {
        atomicStore(&table[at], 0u);
    }
}

// A sum that `add_wide` made.
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

// Sums become means over the nodes about each.
@compute @workgroup_size(CELLS_GROUP)
fn smooth_drift(@builtin(global_invocation_id) id: vec3u) {
    let side = side_of_box();
    for (var at = id.x; at < node_count(); at += LIST_THREADS) {
        let node = vec3u(at % touch.dims.x, at / touch.dims.x % touch.dims.y, at / (touch.dims.x * touch.dims.y));
        let first = max(node, vec3u(1u)) - 1u;
        let last = min(node + 1u, touch.dims - 1u);
        var sum = vec4f();
        for (var z = first.z; z <= last.z; z++) {
            for (var y = first.y; y <= last.y; y++) {
                for (var x = first.x; x <= last.x; x++) {
                    let own = 8u * (x + touch.dims.x * (y + touch.dims.y * z));
                    sum += vec4f(wide(own), wide(own + 2u), wide(own + 4u), wide(own + 6u));
                }
            }
        }
        let mean = sum.xyz * (side / max(sum.w, 1.0));
        let to = meet.bodies + 4u * at;
        for (var c = 0u; c < 3u; c++) {
            set_real(to + c, mean[c]);
        }
    }
}

// Where the largest end: the last bin, how many of it belong, and how many are in it.
var<workgroup> last_of: vec3u;

const OWN_BINS: u32 = BINS / CELLS_GROUP;

// The bin in which the `most` largest end, from the top: thread `t` has the t-th so many bins. The barriers are the caller's.
fn find_last(t: u32, most: u32) {
    var before = 0u;
    for (var k = 0u; k < t; k++) {
        before += sums[k];
    }
    for (var k = 0u; k < OWN_BINS; k++) {
        let bin = BINS - 1u - (OWN_BINS * t + k);
        let own = atomicLoad(&touch.bins[bin]);
        if before <= most && own > most - before {
            last_of = vec3u(bin, most - before, own);
        }
        before += own;
    }
}

fn sum_bins(t: u32) {
    var own = 0u;
    for (var k = 0u; k < OWN_BINS; k++) {
        own += atomicLoad(&touch.bins[BINS - 1u - (OWN_BINS * t + k)]);
    }
    sums[t] = own;
    if t == 0u {
        last_of = vec3u();
    }
}

fn forget_bins(t: u32) {
    for (var k = 0u; k < OWN_BINS; k++) {
        atomicStore(&touch.bins[BINS - 1u - (OWN_BINS * t + k)], 0u);
    }
}

fn share_of(last: vec3u) -> f32 {
    return select(f32(last.y) / f32(max(last.z, 1u)), 1.0, last.z == 0u);
}

// Which segments are active, and how many slices the frame takes.
@compute @workgroup_size(CELLS_GROUP)
fn choose_active(@builtin(local_invocation_index) t: u32) {
    sum_bins(t);
    workgroupBarrier();
    find_last(t, meet.most_active);
    workgroupBarrier();
    if t == 0u {
        touch.least = 0.5 * meet.slip;
        touch.bin = last_of.x;
        touch.share = share_of(last_of);
    }
    workgroupBarrier();
    if t == 0u {
        last_of = vec3u();
    }
    workgroupBarrier();
    find_last(t, meet.few);
    workgroupBarrier();
    if t == 0u {
        let squares = f32(atomicLoad(&touch.squares[1])) * 4294967296.0 + f32(atomicLoad(&touch.squares[0]));
        let typical = sqrt(squares / SQUARE_UNIT * meet.inverse_particles);
        let most = bitcast<f32>((last_of.x + 1u) << BIN_BITS) / (2.0 * meet.edge);
        let quiet = bitcast<f32>(atomicLoad(&touch.fastest)) <= touch.least;
        touch.slices = select(u32(clamp(ceil(max(typical, most)), 1.0, f32(SLICES))), 0u, quiet);
    }
    forget_bins(t);
}

@compute @workgroup_size(CELLS_GROUP)
fn clear_cells(@builtin(global_invocation_id) id: vec3u) {
    if id.x == 0u {
        atomicStore(&touch.taken, 0u);
        touch.shelves = 0u;
    }
    if !is_searched() {
        return;
    }
    for (var at = id.x; at < meet.cells; at += LIST_THREADS) {
        atomicStore(&table[at], 0u);
    }
}

var<workgroup> is_quiet: u32;
// From counts to where each cell's entries start.
@compute @workgroup_size(CELLS_GROUP)
fn lay_out(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
    if t == 0u {
        is_quiet = select(1u, 0u, is_searched());
    }
    if workgroupUniformLoad(&is_quiet) != 0u {
        return;
    }
    if group.x == 0u && t == 0u {
        touch.shelves = 1u;
    }
    lay_rows(group.x, t, meet.cells);
}

// Room for so many entries.
fn take_room(count: u32) -> u32 {
    return atomicAdd(&touch.taken, count);
}

// Where two segments are nearest: the place along each, and the vector from the second's point to the first's; as `contact::closest`.
struct Closest {
    along: vec2f,
    r: vec3f,
}

fn closest(a0: vec3f, a1: vec3f, b0: vec3f, b1: vec3f) -> Closest {
    let ea = a1 - a0;
    let eb = b1 - b0;
    let r = a0 - b0;
    let aa = max(dot(ea, ea), 1e-20);
    let bb = max(dot(eb, eb), 1e-20);
    let ab = dot(ea, eb);
    let ar = dot(ea, r);
    let br = dot(eb, r);
    let across = max(aa * bb - ab * ab, 1e-6 * aa * bb);
    let first = clamp((ab * br - ar * bb) / across, 0.0, 1.0);
    let t = clamp((ab * first + br) / bb, 0.0, 1.0);
    let s = clamp((ab * t - ar) / aa, 0.0, 1.0);
    return Closest(vec2f(s, t), r + s * ea - t * eb);
}

// A segment's ends at the frame's start, and their ways.
struct Course {
    start: mat2x3f,
    way: mat2x3f,
}

fn course_of(segment: u32) -> Course {
    let start = mat2x3f(start_of(segment), start_of(segment + LANES));
    let end = mat2x3f(end_of(segment), end_of(segment + LANES));
    return Course(start, end - start);
}

// Whether two segments may touch in a slice: the vector between their nearest points in its middle separates them, so at its ends they are farther apart along it than what they move along it.
fn may_touch(a: Course, b: Course) -> bool {
    let time = middle_of_slice();
    let share = 1.0 / f32(touch.slices);
    let at = a.start + time * a.way;
    let bt = b.start + time * b.way;
    let near = closest(at[0], at[1], bt[0], bt[1]);
    let way_a = 0.5 * share * (a.way[0] + a.way[1]);
    let way_b = 0.5 * share * (b.way[0] + b.way[1]);
    let spread = 0.5 * share * (distance(a.way[0], a.way[1]) + distance(b.way[0], b.way[1]));
    let square = dot(near.r, near.r);
    let along = abs(dot(near.r, way_a - way_b));
    return !(sqrt(square) * (meet.distance + 0.5 * spread) + 0.5 * along < square);
}

// Two segments that come too near.
struct Contact {
    here: bool,
    along: vec2f,
    normal: vec3f,
    gap: f32,
    when: f32,
    approach: f32,
}

fn rest_distance(a: u32, b: u32) -> f32 {
    let near = closest(rest_of(a), rest_of(a + LANES), rest_of(b), rest_of(b + LANES));
    return length(near.r);
}

// The contact of two segments in a slice, the lower number first, if they touch and approach: conservative advancement, as `find_contacts::meet` has it.
fn follow(first: u32, second: u32, slice: u32) -> Contact {
    var found = Contact();
    if first % LANES == second % LANES && owners[first / LANES] == owners[second / LANES] {
        return found;
    }
    let a = course_of(first);
    let b = course_of(second);
    let until = f32(slice + 1u) / f32(touch.slices);
    var when = f32(slice) / f32(touch.slices);
    var reach = meet.distance;
    var knows_rest = false;
    for (var step = 0u; step < MEET_STEPS; step++) {
        let at = a.start + when * a.way;
        let bt = b.start + when * b.way;
        let near = closest(at[0], at[1], bt[0], bt[1]);
        let apart = length(near.r);
        if apart <= reach * (1.0 + MEET_CLOSE) {
            if !knows_rest {
                reach = min(reach, REST_SHARE * rest_distance(first, second));
                knows_rest = true;
                if apart > reach * (1.0 + MEET_CLOSE) {
                    continue;
                }
            }
            let own = a.way[0] + near.along.x * (a.way[1] - a.way[0]);
            let other = b.way[0] + near.along.y * (b.way[1] - b.way[0]);
            let relative = own - other;
            var normal = near.r / max(apart, 1e-30);
            if apart <= 1e-9 {
                // Of segments that cross, what is across both, against which they approach.
                let across = cross(at[1] - at[0], bt[1] - bt[0]);
                let size = length(across);
                if !(size > 0.0) {
                    return found;
                }
                normal = across / select(size, -size, dot(across, relative) > 0.0);
            }
            let approach = -dot(normal, relative);
            return Contact(approach > meet.slip, near.along, normal, min(apart, reach), when, approach);
        }
        let closing = max(-dot(near.r, a.way[0]), -dot(near.r, a.way[1])) + max(dot(near.r, b.way[0]), dot(near.r, b.way[1]));
        when += apart * (apart - reach) / closing;
        if !(closing > 0.0 && when < until) {
            return found;
        }
    }
    return found;
}

// The place among found contacts of slot `slot` of the active segment on place `place` of the list: the other segment with the slice, and the bits of the approach.
fn slot_at(place: u32, slot: u32) -> u32 {
    return meet.found + 2u * (SLOTS * place + slot);
}

fn active_count() -> u32 {
    return min(atomicLoad(&touch.actives), meet.most_actives);
}

var<workgroup> segments: u32;
var<workgroup> own_pieces: u32;
// What an active segment meets, as in its slots; how many that were, and of the first in time.
var<workgroup> met: array<vec2u, FOUND>;
var<workgroup> met_count: atomic<u32>;
var<workgroup> met_now: u32;
var<workgroup> distinct: atomic<u32>;
// Where there is no room for all: how many approach how fast, from the slip on; and from where on they are taken.
var<workgroup> speeds: array<atomic<u32>, SPEEDS>;
var<workgroup> bar: u32;
var<workgroup> bar_share: f32;

const SPEEDS: u32 = 512u;
// How an active segment seeks: it takes all, it counts how fast they approach, it takes the fastest.
const TAKE_ALL: u32 = 0u;
const COUNT: u32 = 1u;
const TAKE_FASTEST: u32 = 2u;

// A workgroup's threads, some to a row of cells.
const ROW_THREADS: u32 = 16u;
const ROWS: u32 = WORKGROUP / ROW_THREADS;

fn speed_of(approach: f32) -> u32 {
    return min(bin_of(approach) - bin_of(meet.slip), SPEEDS - 1u);
}

// What thread `t` finds an active segment to meet, of which that piece is sought for.
struct Seeker {
    segment: u32,
    stray: f32,
    how: u32,
    t: u32,
    // Which of how many pieces.
    k: u32,
    pieces: u32,
    own: Course,
}

fn take_met(seeker: Seeker, other: u32, approach: f32) {
    let speed = speed_of(approach);
    if seeker.how == COUNT {
        atomicAdd(&speeds[speed], 1u);
        return;
    }
    if seeker.how == TAKE_FASTEST && (speed < bar || speed == bar && chance(other) >= bar_share) {
        return;
    }
    let place = atomicAdd(&met_count, 1u);
    if place < FOUND {
        met[place] = vec2u(other | (touch.slice << SLICE_BITS), bitcast<u32>(approach));
    }
}

// The piece of so many in which a segment is met at `along`.
fn piece_at(along: f32, pieces: u32) -> u32 {
    return min(u32(along * f32(pieces)), pieces - 1u);
}

// Whether an entry whose ball is about `middle` is of the piece of `segment` that is met at `along`.
fn is_met_there(segment: u32, course: Course, middle: vec3f, along: f32) -> bool {
    let pieces = own_pieces_of(segment);
    if pieces == 1u {
        return true;
    }
    let ends = course.start + middle_of_slice() * course.way;
    let edge = ends[1] - ends[0];
    let fraction = dot(middle - ends[0], edge) / max(dot(edge, edge), 1e-20);
    return piece_at(max(fraction, 0.0), pieces) == piece_at(along, pieces);
}

// A piece that contacts are sought of: how far the middles of those can be that it meets, and the rows of cells about it.
struct Around {
    piece: Piece,
    range: f32,
    first: vec2u,
    rows: vec2u,
}

fn around(piece: Piece) -> Around {
    let range = piece.radius + HALF_PIECE * meet.edge + max(piece.reach, REACH_OTHER * meet.edge);
    let first = cell_of(piece.middle - range).yz;
    let rows = min(cell_of(piece.middle + range).yz, cell_of(touch.high).yz) - first + 1u;
    return Around(piece, range, first, select(vec2u(), rows, in_box(piece.middle)));
}

// Where a thread is there: its next row; this row, and its next and last cell in it; its next entry in a run of cells, and the run's end.
struct Walk {
    next: u32,
    row: vec2u,
    cell: u32,
    last_cell: u32,
    at: u32,
    end: u32,
    // Of a run that is too crowded some are looked at, spread evenly.
    share: f32,
}

// The next run of cells, if there is one. A run may be cut where one row of the table ends.
fn next_run(walk: ptr<function, Walk>, about: Around, t: u32) -> bool {
    while (*walk).cell > (*walk).last_cell {
        let next = (*walk).next;
        if next >= about.rows.x * about.rows.y {
            return false;
        }
        (*walk).next += ROWS;
        let row = about.first + vec2u(next % about.rows.x, next / about.rows.x);
        let place = about.piece.middle - touch.low;
        let low = vec2f(row) * meet.edge;
        let apart = max(max(low - place.yz, place.yz - low - meet.edge), vec2f());
        let left = about.range * about.range - dot(apart, apart);
        if left > 0.0 {
            let reach = vec3f(sqrt(left), 0.0, 0.0);
            (*walk).row = row;
            (*walk).cell = cell_of(about.piece.middle - reach).x;
            (*walk).last_cell = min(cell_of(about.piece.middle + reach).x, cell_of(touch.high).x);
        }
    }
    let bucket = bucket_of(vec3u((*walk).cell, (*walk).row));
    let count = min((*walk).last_cell - (*walk).cell + 1u, ROW_CELLS - bucket % ROW_CELLS);
    let first = atomicLoad(&table[bucket]);
    let end = min(atomicLoad(&table[meet.cells + bucket + count - 1u]), meet.entries);
    (*walk).cell += count;
    (*walk).at = first + t % ROW_THREADS;
    (*walk).end = end;
    (*walk).share = f32(RUN_SEGMENTS) / f32(max(end, first + 1u) - first);
    return true;
}

// Entries whose balls a piece touches: few threads of a row find some, and then all look at them.
var<workgroup> queue: array<u32, QUEUE>;
var<workgroup> queue_count: atomic<u32>;
var<workgroup> queue_now: u32;
// Threads that have not come to their end.
var<workgroup> walking: atomic<u32>;
var<workgroup> goes_on: u32;

// Entries that a thread looks at before the queue is gone through.
const NEXT: u32 = QUEUE / WORKGROUP;

// An entry's ball: its middle and its radius.
fn ball_of(entry: u32) -> vec4f {
    let at = meet.bodies + meet.entries + 4u * entry;
    return bitcast<vec4f>(vec4u(work[at], work[at + 1u], work[at + 2u], work[at + 3u]));
}

// Puts those of a thread's next entries on the queue whose balls the piece touches; whether there are more.
fn look_on(walk: ptr<function, Walk>, about: Around, seeker: Seeker) -> bool {
    let piece = about.piece;
    let inverse = 1.0 / max(dot(piece.half, piece.half), 1e-20);
    for (var k = 0u; k < NEXT;) {
        if (*walk).at >= (*walk).end {
            if !next_run(walk, about, seeker.t) {
                return false;
            }
            continue;
        }
        let at = (*walk).at;
        (*walk).at += ROW_THREADS;
        k += 1u;
        let ball = ball_of(at);
        let r = ball.xyz - piece.middle;
        let from_piece = r - piece.half * clamp(dot(piece.half, r) * inverse, -1.0, 1.0);
        let within = piece.reach + ball.w;
        // Other rows may have the same place in the table.
        if !(dot(from_piece, from_piece) < within * within) || any(cell_of(ball.xyz).yz != (*walk).row) {
            continue;
        }
        let entry = work[meet.bodies + at];
        let other = entry & ~ACTIVE;
        if (*walk).share < 1.0 && chance(other) >= (*walk).share {
            continue;
        }
        // Of two active ones that which strays farther seeks the other.
        if entry != other {
            let strays = stray_of(other);
            if strays > seeker.stray || strays == seeker.stray && other >= seeker.segment {
                continue;
            }
        }
        queue[atomicAdd(&queue_count, 1u)] = at;
    }
    return true;
}

// Takes the contact with an entry, if there is one.
fn meet_entry(seeker: Seeker, at: u32) {
    let other = work[meet.bodies + at] & ~ACTIVE;
    let course = course_of(other);
    if !may_touch(seeker.own, course) {
        return;
    }
    let contact = follow(min(seeker.segment, other), max(seeker.segment, other), touch.slice);
    if !contact.here {
        return;
    }
    // Of the pieces of both those meet that hold the contact: so each contact comes once.
    let along = select(contact.along.yx, contact.along, seeker.segment < other);
    let middle = ball_of(at).xyz;
    if piece_at(along.x, seeker.pieces) == seeker.k && is_met_there(other, course, middle, along.y) {
        take_met(seeker, other, contact.approach);
    }
}

// From where on there is room for what approaches so fast, beside what earlier slices found; half of it, for chance gives now more, now less, and only SLOTS of them stay.
fn find_bar() {
    var room = (FOUND - SLOTS) / 2u;
    for (var speed = SPEEDS; speed > 0u; speed--) {
        let own = atomicLoad(&speeds[speed - 1u]);
        if own > room {
            bar = speed - 1u;
            bar_share = f32(room) / f32(own);
            return;
        }
        room -= own;
    }
    bar = 0u;
    bar_share = 1.0;
}

// Lets each active segment meet what is near it in the slice: a workgroup each. Of what it meets in the frame the SLOTS of the greatest approach are kept, with each other segment the first. Where it meets more
// in a slice than there is room for, it counts how fast they approach, and then takes the fastest.
@compute @workgroup_size(WORKGROUP)
fn meet_segments(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
    if t == 0u {
        segments = select(0u, active_count(), is_searched());
    }
    let count = workgroupUniformLoad(&segments);
    for (var number = group.x; number < count; number += MEET_GROUPS) {
        let segment = touch.list[number];
        let stray = stray_of(segment);
        let own = course_of(segment);
        let ends = own.start + middle_of_slice() * own.way;
        let reach = reach_of(stray, true);
        if t == 0u {
            own_pieces = own_pieces_of(segment);
        }
        let pieces = workgroupUniformLoad(&own_pieces);
        for (var how = TAKE_ALL; how <= TAKE_FASTEST; how++) {
            if t == 0u {
                atomicStore(&met_count, 0u);
                atomicStore(&distinct, 0u);
                atomicStore(&queue_count, 0u);
                atomicStore(&walking, 0u);
            }
            for (var speed = t; speed < SPEEDS && how == COUNT; speed += WORKGROUP) {
                atomicStore(&speeds[speed], 0u);
            }
            workgroupBarrier();
            // What was found in earlier slices.
            if t < SLOTS && touch.slice > 0u && how != COUNT {
                let at = slot_at(number, t);
                if work[at] != NOTHING {
                    met[atomicAdd(&met_count, 1u)] = vec2u(work[at], work[at + 1u]);
                }
            }
            workgroupBarrier();
            for (var k = 0u; k < pieces; k++) {
                let about = around(piece_of(ends[0], ends[1], k, pieces, reach));
                let seeker = Seeker(segment, stray, how, t, k, pieces, own);
                var walk = Walk();
                walk.next = t / ROW_THREADS;
                walk.cell = 1u;
                loop {
                    if look_on(&walk, about, seeker) {
                        atomicStore(&walking, 1u);
                    }
                    workgroupBarrier();
                    if t == 0u {
                        queue_now = atomicExchange(&queue_count, 0u);
                        goes_on = atomicExchange(&walking, 0u);
                    }
                    let waiting = workgroupUniformLoad(&queue_now);
                    for (var place = t; place < waiting; place += WORKGROUP) {
                        meet_entry(seeker, queue[place]);
                    }
                    workgroupBarrier();
                    if workgroupUniformLoad(&goes_on) == 0u {
                        break;
                    }
                }
            }
            workgroupBarrier();
            if t == 0u {
                met_now = atomicLoad(&met_count);
                if how == COUNT {
                    find_bar();
                }
            }
            if workgroupUniformLoad(&met_now) <= FOUND && how != COUNT {
                break;
            }
        }
        let now = min(workgroupUniformLoad(&met_now), FOUND);
        // Of a pair the first in time.
        var twice = 0u;
        for (var i = t; i < now; i += WORKGROUP) {
            let mine = met[i].x;
            for (var j = 0u; j < now; j++) {
                let other = met[j].x;
                if ((other ^ mine) & SEGMENT) == 0u && other < mine {
                    twice |= 1u << (i / WORKGROUP);
                }
            }
        }
        workgroupBarrier();
        for (var i = t; i < now; i += WORKGROUP) {
            if (twice & (1u << (i / WORKGROUP))) != 0u {
                met[i] = vec2u(NOTHING, 0u);
            } else {
                atomicAdd(&distinct, 1u);
            }
        }
        workgroupBarrier();
        for (var i = t; i < now; i += WORKGROUP) {
            let mine = met[i];
            if mine.x == NOTHING {
                continue;
            }
            var rank = 0u;
            for (var j = 0u; j < now; j++) {
                let other = met[j];
                rank += select(0u, 1u, other.y > mine.y || other.y == mine.y && other.x < mine.x);
            }
            if rank < SLOTS {
                let at = slot_at(number, rank);
                work[at] = mine.x;
                work[at + 1u] = mine.y;
            }
        }
        if t < SLOTS && t >= atomicLoad(&distinct) {
            work[slot_at(number, t)] = NOTHING;
        }
        workgroupBarrier();
    }
}

// The next slice.
@compute @workgroup_size(1)
fn next_slice() {
    touch.slice += 1u;
}

// How fast what was found approaches.
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

// Which of them there is a budget for; and the rounds before they begin.
@compute @workgroup_size(CELLS_GROUP)
fn choose_found(@builtin(local_invocation_index) t: u32) {
    sum_bins(t);
    workgroupBarrier();
    find_last(t, meet.budget);
    workgroupBarrier();
    if t == 0u {
        touch.found_bin = last_of.x;
        touch.found_share = share_of(last_of);
        atomicStore(&touch.taken, 0u);
        touch.round = 0u;
        touch.momentum = 0.0;
        touch.last = select(0u, 1u, meet.rounds == 1u);
        touch.done = 0u;
        atomicStore(&touch.lack, 0u);
    }
    forget_bins(t);
}

// Lists of joints, and how far strands are bent.
@compute @workgroup_size(CELLS_GROUP)
fn clear_links(@builtin(global_invocation_id) id: vec3u) {
    for (var at = id.x; at < meet.numbers; at += LIST_THREADS) {
        atomicStore(&table[count_at(at)], 0u);
    }
    for (var slot = id.x; slot < meet.strands; slot += LIST_THREADS) {
        atomicStore(&table[bend_at(slot)], 0u);
    }
}

// Joints of what there is a budget for.
@compute @workgroup_size(CELLS_GROUP)
fn take_up(@builtin(global_invocation_id) id: vec3u) {
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
        let lucky = chance(segment ^ (other * 0x85ebca6bu)) < touch.found_share;
        if !(bin > touch.found_bin || bin == touch.found_bin && lucky) {
            continue;
        }
        let pair = vec2u(min(segment, other), max(segment, other));
        let contact = follow(pair.x, pair.y, own >> SLICE_BITS);
        if !contact.here {
            continue;
        }
        let joint = atomicAdd(&touch.joints, 1u);
        if joint >= meet.most_joints {
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
