// Which triangle of bodies is nearest at each of the four samples of a pixel: a render pass with
// two texels along each side of a pixel. The twin of `Tile::draw_triangle`.

@group(0) @binding(0) var<uniform> frame: Frame;

struct Corner {
    @builtin(position) place: vec4f,
    @location(0) @interpolate(flat) face: u32,
}

// Whether all corners are finite and not too far away.
fn is_usable(face: u32) -> bool {
    let a = abs(place_of(face, 0u));
    let b = abs(place_of(face, 1u));
    let c = abs(place_of(face, 2u));
    return all(a < vec3f(1e18)) && all(b < vec3f(1e18)) && all(c < vec3f(1e18));
}

@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let face = index / 3u;
    if !is_usable(face) {
        // Outside the clip volume, so that nothing is drawn.
        return Corner(vec4f(0.0, 0.0, -1.0, 1.0), face);
    }
    let offset = place_of(face, index % 3u) - frame.eye;
    let place = vec2f(dot(offset, frame.right), dot(offset, frame.up)) * (2.0 * frame.focal);
    // The depth is that of the near plane over the vertex's.
    return Corner(vec4f(place / vec2f(frame.size), frame.near, dot(offset, frame.forward)), face);
}

// The number of the triangle and 1; 0 is none.
@fragment
fn cover(corner: Corner) -> @location(0) u32 {
    return corner.face + 1u;
}
