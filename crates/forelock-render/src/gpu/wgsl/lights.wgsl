// Lights, and what shades from them: the twin of `shadow_map.rs` and `volume.rs`.

const PI: f32 = 3.14159265;

@group(0) @binding(6) var<storage, read> lights: array<Light>;
// The optical depths towards each light, and the share of ambient light.
@group(0) @binding(7) var<storage, read> grids: array<f32>;
// Shadow maps: `ordered` heights.
@group(0) @binding(8) var<storage, read> heights: array<u32>;

fn normalize_or(v: vec3f, other: vec3f) -> vec3f {
    let square = dot(v, v);
    return select(other, v * inverseSqrt(max(square, 1e-37)), square > 1e-37);
}

fn sample_grid(start: u32, size: vec3u, at: vec3f) -> f32 {
    let scaled = clamp(at, vec3f(0.0), vec3f(size - 1u));
    let base = min(vec3u(scaled), size - 2u);
    let f = scaled - vec3f(base);
    let rows = vec2u(size.x, size.x * size.y);
    let first = start + base.x + base.y * rows.x + base.z * rows.y;
    let row0 = mix(grids[first], grids[first + 1u], f.x);
    let row1 = mix(grids[first + rows.x], grids[first + rows.x + 1u], f.x);
    let next = first + rows.y;
    let row2 = mix(grids[next], grids[next + 1u], f.x);
    let row3 = mix(grids[next + rows.x], grids[next + rows.x + 1u], f.x);
    return mix(mix(row0, row1, f.y), mix(row2, row3, f.y), f.z);
}

// The share of the light that reaches `point`, with edges of shadows `2 softness + 2` texels wide:
// the twin of `ShadowMap::visibility`.
fn visibility(light: Light, point: vec3f, softness: i32) -> f32 {
    let offset = point - light.origin;
    let p = vec2f(dot(offset, light.right), dot(offset, light.up)) / light.texel;
    let height = ordered(dot(offset, light.direction));
    let margin = f32(softness) + 1.0;
    // Also true for what is no number.
    if !(min(p.x, p.y) >= margin && max(p.x, p.y) <= f32(light.side) - margin - 1.0) {
        return 1.0;
    }
    let corner = vec2i(p - 0.5);
    let f = p - 0.5 - vec2f(corner);
    var lit = 0.0;
    for (var j = -softness; j <= softness + 1; j += 1) {
        let across = select(select(1.0, f.y, j == softness + 1), 1.0 - f.y, j == -softness);
        let row = i32(light.heights) + (corner.y + j) * i32(light.side) + corner.x;
        for (var i = -softness; i <= softness + 1; i += 1) {
            let along = select(select(1.0, f.x, i == softness + 1), 1.0 - f.x, i == -softness);
            lit += select(0.0, across * along, heights[row + i] <= height);
        }
    }
    let side = f32(2 * softness + 1);
    return lit / (side * side);
}
