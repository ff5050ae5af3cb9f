// The pairs of a slice: one workgroup for each active segment, whose threads share the entries near
// it; the GPU counterpart of `find_contacts::pairs` and `find_contacts::follow`. The text follows
// `active.wgsl`.

// The nearest points of two segments: the fraction along each, and the vector from the second point
// to the first; as `contact::closest`.
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

// A segment's ends at the frame's start, and their displacements.
struct Course {
    start: mat2x3f,
    displacement: mat2x3f,
}

fn course_of(segment: u32) -> Course {
    let start = mat2x3f(start_of(segment), start_of(segment + LANES));
    let end = mat2x3f(end_of(segment), end_of(segment + LANES));
    return Course(start, end - start);
}

// Whether two segments may touch in a slice. The vector between their nearest points in its middle
// separates them, so they cannot touch if their displacements along it are smaller than the
// distance.
fn may_touch(a: Course, b: Course) -> bool {
    let time = middle_of_slice();
    let share = 1.0 / f32(touch.slices);
    let at = a.start + time * a.displacement;
    let bt = b.start + time * b.displacement;
    let near = closest(at[0], at[1], bt[0], bt[1]);
    let displacement_a = 0.5 * share * (a.displacement[0] + a.displacement[1]);
    let displacement_b = 0.5 * share * (b.displacement[0] + b.displacement[1]);
    let spread = 0.5 * share * (distance(a.displacement[0], a.displacement[1]) + distance(b.displacement[0], b.displacement[1]));
    let square = dot(near.r, near.r);
    let along = abs(dot(near.r, displacement_a - displacement_b));
    // With the tolerance of a contact, and a margin.
    let near_by = (1.0 + 2.0 * FOLLOW_CLOSE) * contacts.distance + 0.5 * spread;
    return !(sqrt(square) * near_by + 0.5 * along < square);
}

// A contact of two segments.
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

// The contact of two segments in a slice, the lower number first, if they touch and approach:
// conservative advancement, as in `find_contacts::follow`.
fn follow(first: u32, second: u32, slice: u32) -> Contact {
    var found = Contact();
    if first % LANES == second % LANES && owners[first / LANES] == owners[second / LANES] {
        return found;
    }
    let a = course_of(first);
    let b = course_of(second);
    let until = f32(slice + 1u) / f32(touch.slices);
    var when = f32(slice) / f32(touch.slices);
    var reach = contacts.distance;
    var has_rest_distance = false;
    for (var step = 0u; step < FOLLOW_STEPS; step++) {
        let at = a.start + when * a.displacement;
        let bt = b.start + when * b.displacement;
        let near = closest(at[0], at[1], bt[0], bt[1]);
        let apart = length(near.r);
        if apart <= reach * (1.0 + FOLLOW_CLOSE) {
            if !has_rest_distance {
                reach = min(reach, REST_SHARE * rest_distance(first, second));
                has_rest_distance = true;
                if apart > reach * (1.0 + FOLLOW_CLOSE) {
                    continue;
                }
            }
            let own = a.displacement[0] + near.along.x * (a.displacement[1] - a.displacement[0]);
            let other = b.displacement[0] + near.along.y * (b.displacement[1] - b.displacement[0]);
            let relative = own - other;
            var normal = near.r / max(apart, 1e-30);
            if apart <= 1e-9 {
                // Segments that cross: the direction across both, against the approach.
                let across = cross(at[1] - at[0], bt[1] - bt[0]);
                let size = length(across);
                if !(size > 0.0) {
                    return found;
                }
                normal = across / select(size, -size, dot(across, relative) > 0.0);
            }
            let approach = -dot(normal, relative);
            return Contact(approach > contacts.slip, near.along, normal, min(apart, reach), when, approach);
        }
        let closing = max(-dot(near.r, a.displacement[0]), -dot(near.r, a.displacement[1])) + max(dot(near.r, b.displacement[0]), dot(near.r, b.displacement[1]));
        when += apart * (apart - reach) / closing;
        if !(closing > 0.0 && when < until) {
            return found;
        }
    }
    return found;
}

// The index in `work` of slot `slot` of the active segment `place` of the list: the other segment
// with the slice, then the bits of the approach.
fn slot_at(place: u32, slot: u32) -> u32 {
    return contacts.found + 2u * (SLOTS * place + slot);
}

fn active_count() -> u32 {
    return min(atomicLoad(&touch.actives), contacts.most_actives);
}

var<workgroup> segments: u32;
var<workgroup> own_pieces: u32;
// The contacts of an active segment, as in its slots; their number; their number without repeated
// pairs.
var<workgroup> candidates: array<vec2u, FOUND>;
var<workgroup> candidate_count: atomic<u32>;
var<workgroup> candidates_now: u32;
var<workgroup> distinct: atomic<u32>;
// If they exceed the capacity: a histogram of the speeds of approach, from the slip on, and the
// least speed that is kept.
var<workgroup> speeds: array<atomic<u32>, SPEEDS>;
var<workgroup> threshold: u32;
var<workgroup> threshold_share: f32;

const SPEEDS: u32 = 512u;
// The passes of an active segment: take all contacts; if they exceed the capacity, count their
// speeds; take the fastest.
const TAKE_ALL: u32 = 0u;
const COUNT: u32 = 1u;
const TAKE_FASTEST: u32 = 2u;

// Threads of a workgroup to a row of cells.
const ROW_THREADS: u32 = 16u;
const ROWS: u32 = WORKGROUP / ROW_THREADS;

fn speed_of(approach: f32) -> u32 {
    return min(bin_of(approach) - bin_of(contacts.slip), SPEEDS - 1u);
}

// The search of thread `t` for a piece of an active segment.
struct Seeker {
    segment: u32,
    residual: f32,
    how: u32,
    t: u32,
    // Which of how many pieces.
    k: u32,
    pieces: u32,
    own: Course,
}

fn add_candidate(seeker: Seeker, other: u32, approach: f32) {
    let speed = speed_of(approach);
    if seeker.how == COUNT {
        atomicAdd(&speeds[speed], 1u);
        return;
    }
    if seeker.how == TAKE_FASTEST && (speed < threshold || speed == threshold && chance(other) >= threshold_share) {
        return;
    }
    let place = atomicAdd(&candidate_count, 1u);
    if place < FOUND {
        candidates[place] = vec2u(other | (touch.slice << SLICE_BITS), bitcast<u32>(approach));
    }
}

// Index of the piece at the fraction `along` of a segment that is split into `pieces`.
fn piece_at(along: f32, pieces: u32) -> u32 {
    return min(u32(along * f32(pieces)), pieces - 1u);
}

// Whether an entry whose ball is centred at `middle` is the piece of `segment` at the fraction
// `along`.
fn holds_contact(segment: u32, course: Course, middle: vec3f, along: f32) -> bool {
    let pieces = own_pieces_of(segment);
    if pieces == 1u {
        return true;
    }
    let ends = course.start + middle_of_slice() * course.displacement;
    let edge = ends[1] - ends[0];
    let fraction = dot(middle - ends[0], edge) / max(dot(edge, edge), 1e-20);
    return piece_at(max(fraction, 0.0), pieces) == piece_at(along, pieces);
}

// A piece whose contacts are searched: the largest distance of the centres of others that it can
// touch, and the rows of cells around it.
struct Around {
    piece: Piece,
    range: f32,
    first: vec2u,
    rows: vec2u,
}

fn around(piece: Piece) -> Around {
    let range = piece.radius + HALF_PIECE * contacts.edge + max(piece.reach, REACH_OTHER * contacts.edge);
    let first = cell_of(piece.middle - range).yz;
    let rows = min(cell_of(piece.middle + range).yz, cell_of(touch.high).yz) - first + 1u;
    return Around(piece, range, first, select(vec2u(), rows, in_box(piece.middle)));
}

// The state of a thread: its next row; the current row, with its next and last cell; the next entry
// in a run of cells, and the end of the run.
struct Walk {
    next: u32,
    row: vec2u,
    cell: u32,
    last_cell: u32,
    at: u32,
    end: u32,
    // The share of the entries that are tested, below one in a crowded run.
    share: f32,
}

// Advances to the next run of cells, if there is one. A run ends at the end of a row of the table.
fn next_run(walk: ptr<function, Walk>, about: Around, t: u32) -> bool {
    while (*walk).cell > (*walk).last_cell {
        let next = (*walk).next;
        if next >= about.rows.x * about.rows.y {
            return false;
        }
        (*walk).next += ROWS;
        let row = about.first + vec2u(next % about.rows.x, next / about.rows.x);
        let place = about.piece.middle - touch.low;
        let low = vec2f(row) * contacts.edge;
        let apart = max(max(low - place.yz, place.yz - low - contacts.edge), vec2f());
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
    let end = min(atomicLoad(&table[contacts.cells + bucket + count - 1u]), contacts.entries);
    (*walk).cell += count;
    (*walk).at = first + t % ROW_THREADS;
    (*walk).end = end;
    (*walk).share = f32(RUN_SEGMENTS) / f32(max(end, first + 1u) - first);
    return true;
}

// Entries whose balls a piece touches: few threads find some, then all threads test them.
var<workgroup> queue: array<u32, QUEUE>;
var<workgroup> queue_count: atomic<u32>;
var<workgroup> queue_now: u32;
// Threads that have entries left.
var<workgroup> walking: atomic<u32>;
var<workgroup> goes_on: u32;

// Entries that a thread visits before the queue is processed.
const NEXT: u32 = QUEUE / WORKGROUP;

// An entry's ball: its centre and its radius.
fn ball_of(entry: u32) -> vec4f {
    let at = contacts.bodies + contacts.entries + 4u * entry;
    return bitcast<vec4f>(vec4u(work[at], work[at + 1u], work[at + 2u], work[at + 3u]));
}

// Queues those of a thread's next entries whose balls the piece touches. Returns whether entries
// are left.
fn advance_walk(walk: ptr<function, Walk>, about: Around, seeker: Seeker) -> bool {
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
        // Other rows may share the bucket.
        if !(dot(from_piece, from_piece) < within * within) || any(cell_of(ball.xyz).yz != (*walk).row) {
            continue;
        }
        let entry = work[contacts.bodies + at];
        let other = entry & ~ACTIVE;
        if (*walk).share < 1.0 && chance(other) >= (*walk).share {
            continue;
        }
        // Of two active segments, the one of the larger residual motion takes the contact.
        if entry != other {
            let other_residual = residual_motion_of(other);
            if other_residual > seeker.residual || other_residual == seeker.residual && other >= seeker.segment {
                continue;
            }
        }
        queue[atomicAdd(&queue_count, 1u)] = at;
    }
    return true;
}

// Takes the contact with an entry, if there is one.
fn test_entry(seeker: Seeker, at: u32) {
    let other = work[contacts.bodies + at] & ~ACTIVE;
    let course = course_of(other);
    if !may_touch(seeker.own, course) {
        return;
    }
    let contact = follow(min(seeker.segment, other), max(seeker.segment, other), touch.slice);
    if !contact.here {
        return;
    }
    // Only the pieces that hold the contact take it, so each contact is taken once.
    let along = select(contact.along.yx, contact.along, seeker.segment < other);
    let middle = ball_of(at).xyz;
    if piece_at(along.x, seeker.pieces) == seeker.k && holds_contact(other, course, middle, along.y) {
        add_candidate(seeker, other, contact.approach);
    }
}

// The smallest speed that is kept, in addition to the contacts of earlier slices. Only half of the
// capacity is used, because the size of a sampled bin varies; SLOTS of them are kept in the end.
fn find_threshold() {
    var room = (FOUND - SLOTS) / 2u;
    for (var speed = SPEEDS; speed > 0u; speed--) {
        let own = atomicLoad(&speeds[speed - 1u]);
        if own > room {
            threshold = speed - 1u;
            threshold_share = f32(room) / f32(own);
            return;
        }
        room -= own;
    }
    threshold = 0u;
    threshold_share = 1.0;
}

// Finds the contacts of each active segment in the slice, a workgroup each. Of the contacts of the
// frame the SLOTS of the fastest approach are kept, of each pair the first in time. If a slice has
// more than there is room for, a second pass counts their speeds and a third takes the fastest.
@compute @workgroup_size(WORKGROUP)
fn find_pairs(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
    if t == 0u {
        segments = select(0u, active_count(), is_searched());
    }
    let count = workgroupUniformLoad(&segments);
    for (var number = group.x; number < count; number += PAIR_GROUPS) {
        let segment = touch.list[number];
        let residual = residual_motion_of(segment);
        let own = course_of(segment);
        let ends = own.start + middle_of_slice() * own.displacement;
        let reach = reach_of(residual, true);
        if t == 0u {
            own_pieces = own_pieces_of(segment);
        }
        let pieces = workgroupUniformLoad(&own_pieces);
        for (var how = TAKE_ALL; how <= TAKE_FASTEST; how++) {
            if t == 0u {
                atomicStore(&candidate_count, 0u);
                atomicStore(&distinct, 0u);
                atomicStore(&queue_count, 0u);
                atomicStore(&walking, 0u);
            }
            for (var speed = t; speed < SPEEDS && how == COUNT; speed += WORKGROUP) {
                atomicStore(&speeds[speed], 0u);
            }
            workgroupBarrier();
            // The contacts of earlier slices.
            if t < SLOTS && touch.slice > 0u && how != COUNT {
                let at = slot_at(number, t);
                if work[at] != NOTHING {
                    candidates[atomicAdd(&candidate_count, 1u)] = vec2u(work[at], work[at + 1u]);
                }
            }
            workgroupBarrier();
            for (var k = 0u; k < pieces; k++) {
                let about = around(piece_of(ends[0], ends[1], k, pieces, reach));
                let seeker = Seeker(segment, residual, how, t, k, pieces, own);
                var walk = Walk();
                walk.next = t / ROW_THREADS;
                walk.cell = 1u;
                loop {
                    if advance_walk(&walk, about, seeker) {
                        atomicStore(&walking, 1u);
                    }
                    workgroupBarrier();
                    if t == 0u {
                        queue_now = atomicExchange(&queue_count, 0u);
                        goes_on = atomicExchange(&walking, 0u);
                    }
                    let waiting = workgroupUniformLoad(&queue_now);
                    for (var place = t; place < waiting; place += WORKGROUP) {
                        test_entry(seeker, queue[place]);
                    }
                    workgroupBarrier();
                    if workgroupUniformLoad(&goes_on) == 0u {
                        break;
                    }
                }
            }
            workgroupBarrier();
            if t == 0u {
                candidates_now = atomicLoad(&candidate_count);
                if how == COUNT {
                    find_threshold();
                }
            }
            if workgroupUniformLoad(&candidates_now) <= FOUND && how != COUNT {
                break;
            }
        }
        let now = min(workgroupUniformLoad(&candidates_now), FOUND);
        // Keeps the first of each pair.
        var repeated = 0u;
        for (var i = t; i < now; i += WORKGROUP) {
            let mine = candidates[i].x;
            for (var j = 0u; j < now; j++) {
                let other = candidates[j].x;
                if ((other ^ mine) & SEGMENT) == 0u && other < mine {
                    repeated |= 1u << (i / WORKGROUP);
                }
            }
        }
        workgroupBarrier();
        for (var i = t; i < now; i += WORKGROUP) {
            if (repeated & (1u << (i / WORKGROUP))) != 0u {
                candidates[i] = vec2u(NOTHING, 0u);
            } else {
                atomicAdd(&distinct, 1u);
            }
        }
        workgroupBarrier();
        for (var i = t; i < now; i += WORKGROUP) {
            let mine = candidates[i];
            if mine.x == NOTHING {
                continue;
            }
            var rank = 0u;
            for (var j = 0u; j < now; j++) {
                let other = candidates[j];
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
