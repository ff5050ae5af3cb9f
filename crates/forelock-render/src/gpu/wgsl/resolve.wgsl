// Composites the pieces of a tile from front to back, one thread a pixel: the twin of `raster.rs`.

@group(0) @binding(10) var<storage, read> radiance: array<vec2u>;
@group(0) @binding(12) var<storage, read> offsets: array<u32>;
@group(0) @binding(13) var<storage, read> list: array<vec2u>;
// Bodies over the backdrop: linear light, and how much they hide.
@group(0) @binding(16) var behind: texture_2d<f32>;
// The bytes of a pixel. When drawing over a target: light and opacity as half floats, and the
// inverse depth.
@group(0) @binding(18) var<storage, read_write> picture: array<u32>;

// A piece as a strip of pixels, relative to the centre of the tile's first pixel.
struct Strip {
    start: vec2f,
    along: vec2f,
    length: f32,
    half_width: f32,
    radius: f32,
    nearness: f32,
    light: vec3f,
    // Bit 0: the strand ends at the start; bit 1: at the end.
    ends: u32,
    other_light: vec3f,
    unused: u32,
    end: vec2f,
    // Directions across which neighbouring pieces divide the pixels.
    start_side: vec2f,
    end_side: vec2f,
}

const BATCH: u32 = 128u;
// The largest light that is drawn over a target: half floats end at 65504.
const MOST_LIGHT: f32 = 60000.0;

var<workgroup> batch: array<Strip, BATCH>;
var<workgroup> range: vec2u;
var<workgroup> open: atomic<u32>;
var<workgroup> still_open: u32;

fn radiance_at(place: u32) -> vec3f {
    let packed = radiance[place];
    return vec3f(unpack2x16float(packed.x), unpack2x16float(packed.y).x);
}

// The radiance on the edge from `point` on, at `t`.
fn radiance_on(point: u32, t: f32) -> vec3f {
    let scaled = t * f32(frame.lit_each);
    let step = min(u32(scaled), frame.lit_each - 1u);
    let first = point * frame.lit_each + step;
    return mix(radiance_at(first), radiance_at(first + 1u), scaled - f32(step));
}

// The direction `slope`, or `along` where the curve turns back.
fn side_of(slope: vec2f, along: vec2f) -> vec2f {
    return select(along, slope, dot(slope, along) > 0.2 * length(slope));
}

// Whether a pixel belongs to the piece after a joint. Both pieces decide by the same numbers.
fn is_after(side: vec2f, joint: vec2f, place: vec2f) -> bool {
    return dot(side, place - joint) >= 0.0;
}

fn strip_of(item: u32, corner: vec2f) -> Strip {
    let point = item / PIECES_EACH;
    let i = item % PIECES_EACH;
    let edge = edge_from(point);
    let piece = piece_of(edge, i);
    let span = piece.end - piece.start;
    let length = length(span);
    var strip: Strip;
    strip.length = length;
    // An empty piece covers nothing.
    strip.half_width = select(0.0, piece.half_width, length > 1e-6);
    strip.along = span / max(length, 1e-6);
    strip.start = piece.start - corner - 0.5;
    strip.end = piece.end - corner - 0.5;
    strip.start_side = side_of(slope_on_edge(edge, f32(i) / f32(edge.pieces)), strip.along);
    strip.end_side = side_of(slope_on_edge(edge, f32(i + 1u) / f32(edge.pieces)), strip.along);
    strip.radius = max(FILTER_RADIUS * max(abs(strip.along.x), abs(strip.along.y)), 1e-6);
    strip.nearness = piece.nearness;
    strip.light = radiance_on(point, f32(i) / f32(edge.pieces));
    strip.other_light = radiance_on(point, f32(i + 1u) / f32(edge.pieces));
    let starts = edge.is_first && i == 0u;
    let finishes = edge.is_last && i + 1u == edge.pieces;
    strip.ends = u32(starts) | (u32(finishes) << 1u);
    return strip;
}

// The integral of the tent of radius 1 from minus infinity to `x`.
fn tent_integral(x: f32) -> f32 {
    let c = clamp(x, -1.0, 1.0);
    return 0.5 + c - 0.5 * c * abs(c);
}

fn shown_bytes(colour: vec3f, pixel: vec2u) -> u32 {
    let shown = srgb_encode(film_curve(max(colour, vec3f(0.0)) * frame.exposure));
    let place = vec2f(pixel);
    let noise = fract(52.982918 * fract(0.06711056 * place.x + 0.00583715 * place.y)) - 0.5;
    let bytes = vec3u(clamp(shown * 255.0 + 0.5 + 0.8 * noise, vec3f(0.0), vec3f(255.0)));
    return bytes.x | (bytes.y << 8u) | (bytes.z << 16u) | (255u << 24u);
}

@compute @workgroup_size(THREADS)
fn resolve(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = group.y * frame.tiles.x + group.x;
    if local == 0u {
        range = min(vec2u(offsets[tile], offsets[tile + 1u]), vec2u(frame.capacity));
    }
    let own = workgroupUniformLoad(&range);
    let corner = group.xy * TILE;
    let in_tile = vec2u(local % TILE, local / TILE);
    let pixel = corner + in_tile;
    let place = vec2f(in_tile);
    let inside = all(pixel < frame.size);
    var bodies = vec4f(0.0);
    if inside {
        bodies = nearness_at(pixel);
    }
    let nearest = max(max(bodies.x, bodies.y), max(bodies.z, bodies.w));
    // The inverse depth at which the strands hide half of what is behind them.
    var surface = 0.0;
    var gathered = vec3f(0.0);
    var through = select(0.0, 1.0, inside);
    for (var first = own.x; first < own.y; first += BATCH) {
        let here = min(own.y - first, BATCH);
        if local == 0u {
            atomicStore(&open, 0u);
        }
        if local < here {
            batch[local] = strip_of(list[first + local].y, vec2f(corner));
        }
        workgroupBarrier();
        for (var i = 0u; i < here && through > OPAQUE; i += 1u) {
            let offset = place - batch[i].start;
            let strip_along = batch[i].along;
            let across = strip_along.x * offset.y - strip_along.y * offset.x;
            let half_width = batch[i].half_width;
            let radius = batch[i].radius;
            if abs(across) >= half_width + radius {
                continue;
            }
            let along = dot(strip_along, offset);
            let length = batch[i].length;
            let ends = batch[i].ends;
            var start = clamp(along + 0.5, 0.0, 1.0);
            if (ends & 1u) == 0u {
                start = select(0.0, 1.0, is_after(batch[i].start_side, batch[i].start, place));
            }
            var end = clamp(length - along + 0.5, 0.0, 1.0);
            if (ends & 2u) == 0u {
                end = select(1.0, 0.0, is_after(batch[i].end_side, batch[i].end, place));
            }
            let share = tent_integral((across + half_width) / radius)
                - tent_integral((across - half_width) / radius);
            var coverage = share * min(start, end);
            let depth = batch[i].nearness;
            if depth < nearest {
                coverage *= dot(vec4f(bodies <= vec4f(depth)), vec4f(0.25));
            }
            if coverage > 0.0 {
                let t = clamp(along / length, 0.0, 1.0);
                gathered += mix(batch[i].light, batch[i].other_light, t) * (through * coverage);
                let before = through;
                through *= 1.0 - coverage;
                surface = select(surface, depth, before > 0.5 && through <= 0.5);
            }
        }
        if through > OPAQUE {
            atomicAdd(&open, 1u);
        }
        workgroupBarrier();
        if local == 0u {
            still_open = atomicLoad(&open);
        }
        if workgroupUniformLoad(&still_open) == 0u {
            break;
        }
    }
    if inside {
        let index = pixel.y * frame.size.x + pixel.x;
        var colour = vec4f(gathered, 1.0 - through);
        if through <= OPAQUE {
            colour /= 1.0 - through;
        } else {
            colour += through * textureLoad(behind, pixel, 0);
        }
        if frame.target_near == 0.0 {
            picture[index] = shown_bytes(colour.xyz, pixel);
            return;
        }
        if surface == 0.0 && colour.w >= 0.5 {
            surface = nearest;
        }
        let light = colour.xyz * frame.exposure;
        // A comparison with what is no number is false.
        let usable = select(vec3f(0.0), min(light, vec3f(MOST_LIGHT)), light > vec3f(0.0));
        picture[3u * index] = pack2x16float(usable.xy);
        picture[3u * index + 1u] = pack2x16float(vec2f(usable.z, colour.w));
        picture[3u * index + 2u] = bitcast<u32>(surface);
    }
}
