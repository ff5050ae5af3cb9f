// Straight pieces of the curve between two particles: the twin of `Hair::gather`.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(2) var<storage, read> curves: array<Curve>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(9) var<storage, read> points: array<vec4f>;

struct Edge {
    p0: vec4f,
    p1: vec4f,
    p2: vec4f,
    p3: vec4f,
    // 0 if it cannot be drawn.
    pieces: u32,
    is_first: bool,
    is_last: bool,
}

struct Piece {
    start: vec2f,
    end: vec2f,
    nearness: f32,
    half_width: f32,
}

fn edge_from(point: u32) -> Edge {
    let curve = curves[owners[point]];
    let i = point - curve.start;
    var edge = Edge(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0), 0u, false, false);
    if i + 1u >= curve.count {
        return edge;
    }
    edge.is_first = i == 0u;
    edge.is_last = i + 2u == curve.count;
    edge.p1 = points[point];
    edge.p2 = points[point + 1u];
    edge.p0 = 2.0 * edge.p1 - edge.p2;
    edge.p3 = 2.0 * edge.p2 - edge.p1;
    var usable = edge.p1.z > 0.0 && edge.p2.z > 0.0;
    if !edge.is_first {
        edge.p0 = points[point - 1u];
        usable = usable && edge.p0.z > 0.0;
    }
    if !edge.is_last {
        edge.p3 = points[point + 2u];
        usable = usable && edge.p3.z > 0.0;
    }
    if usable {
        let pieces = ceil(distance(edge.p1.xy, edge.p2.xy) / PIECE_PX);
        edge.pieces = u32(clamp(pieces, 1.0, MAX_PIECES));
    }
    return edge;
}

// The place on the edge at `t`, pixels.
fn on_edge(edge: Edge, t: f32) -> vec2f {
    let t2 = t * t;
    let t3 = t2 * t;
    return edge.p0.xy * (t2 - 0.5 * (t3 + t))
        + edge.p1.xy * (1.0 + 1.5 * t3 - 2.5 * t2)
        + edge.p2.xy * (2.0 * t2 - 1.5 * t3 + 0.5 * t)
        + edge.p3.xy * (0.5 * (t3 - t2));
}

// The direction across which the pieces that meet at `t` divide the pixels: the slope of the curve.
// At a particle both edges compute it from the same two points.
fn slope_on_edge(edge: Edge, t: f32) -> vec2f {
    if t <= 0.0 {
        return edge.p2.xy - edge.p0.xy;
    }
    if t >= 1.0 {
        return edge.p3.xy - edge.p1.xy;
    }
    let t2 = t * t;
    return edge.p0.xy * (2.0 * t - 1.5 * t2 - 0.5)
        + edge.p1.xy * (4.5 * t2 - 5.0 * t)
        + edge.p2.xy * (4.0 * t - 4.5 * t2 + 0.5)
        + edge.p3.xy * (1.5 * t2 - t);
}

fn piece_of(edge: Edge, i: u32) -> Piece {
    let count = f32(edge.pieces);
    let t = vec2f(f32(i), f32(i + 1u)) / count;
    let middle = mix(edge.p1, edge.p2, 0.5 * (t.x + t.y));
    return Piece(on_edge(edge, t.x), on_edge(edge, t.y), middle.z, middle.w);
}
