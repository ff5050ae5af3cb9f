// The radiance of points on each edge towards the eye: the twin of `Lighting::of_hair`.

struct Light {
    direction: vec3f,
    texel: f32,
    colour: vec3f,
    // The first value of its shadow map in `heights`, or NONE.
    heights: u32,
    right: vec3f,
    // The first value of its grid in `grids`, or NONE.
    grid: u32,
    up: vec3f,
    // Texels along a side of its shadow map.
    side: u32,
    origin: vec3f,
    unused: u32,
}

@group(0) @binding(5) var<storage, read> albedos: array<vec4f>;
@group(0) @binding(6) var<storage, read> lights: array<Light>;
// The optical depths towards each light, and the share of ambient light.
@group(0) @binding(7) var<storage, read> grids: array<f32>;
// Shadow maps.
@group(0) @binding(8) var<storage, read> heights: array<f32>;
// Red and green, blue and nothing, in half precision.
@group(0) @binding(10) var<storage, read_write> radiance: array<vec2u>;

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

fn visibility(light: Light, point: vec3f) -> f32 {
    let offset = point - light.origin;
    let p = vec3f(dot(offset, light.right), dot(offset, light.up), 0.0) / light.texel;
    let height = dot(offset, light.direction);
    if min(p.x, p.y) < 1.0 || max(p.x, p.y) > f32(light.side) - 2.0 {
        return 1.0;
    }
    let corner = vec2u(p.xy - 0.5);
    let f = p.xy - 0.5 - vec2f(corner);
    let first = light.heights + corner.y * light.side + corner.x;
    let lower = vec2f(vec2<bool>(heights[first] <= height, heights[first + 1u] <= height));
    let next = first + light.side;
    let upper = vec2f(vec2<bool>(heights[next] <= height, heights[next + 1u] <= height));
    return mix(mix(lower.x, lower.y, f.x), mix(upper.x, upper.y, f.x), f.y);
}

// The twin of `Group::albedo`.
fn albedo_of(curve: Curve, i: u32, t: f32, s: f32) -> vec3f {
    if curve.has_colours != 0u {
        let next = min(i + 1u, curve.count - 1u);
        let given = mix(albedos[curve.first + i].xyz, albedos[curve.first + next].xyz, t);
        return clamp(given, vec3f(0.002), vec3f(0.95));
    }
    let root = 1.0 + 0.22 * (1.0 - min(s / 0.25, 1.0));
    let power = root * (1.0 + 0.13 * curve.bright) * (1.04 - 0.12 * s);
    let varied = exp(curve.log_albedo * power);
    let grey = vec3f(luminance(varied));
    return clamp(mix(varied, grey, 0.06 + 0.06 * curve.grey), vec3f(0.002), vec3f(0.95));
}

// Whether no piece within `length` metres of `position` can be in the picture.
fn is_out_of_sight(position: vec3f, length: f32) -> bool {
    let offset = position - frame.eye;
    let depth = dot(offset, frame.forward);
    if depth <= frame.near + length {
        return depth < frame.near - length;
    }
    let place = vec2f(dot(offset, frame.right), dot(offset, frame.up)) * (frame.focal / depth);
    let margin = frame.focal * length / (depth - length) * 2.0 + 64.0;
    return any(abs(place) > frame.centre + margin);
}

@compute @workgroup_size(THREADS)
fn shade(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let thread = thread_of(group, groups, local);
    let point = thread / frame.lit_each;
    if point >= frame.points {
        return;
    }
    let curve = curves[owners[point]];
    let i = point - curve.start;
    let step = thread % frame.lit_each;
    let t = f32(step) / f32(frame.lit_each);
    let last = curve.count - 1u;
    if i == last && step > 0u {
        return;
    }
    let s = (f32(i) + t) / f32(last);
    let near = particles_around(curve, i);
    let position = blend(near, catmull_rom(t)) + offset_at(curve, s);
    if is_out_of_sight(position, distance(near.p1, near.p2)) {
        radiance[thread] = vec2u(0u);
        return;
    }
    let straight = normalize_or(near.p2 - near.p1, vec3f(0.0, 1.0, 0.0));
    let tangent = normalize_or(blend(near, catmull_rom_slope(t)), straight);
    let to_eye = normalize_or(frame.eye - position, vec3f(0.0, 0.0, 1.0));
    var open = 1.0;
    if frame.open_cell > 0.0 {
        let at = (position - frame.open_origin) / frame.open_cell;
        open = sample_grid(frame.open_start, frame.open_size, at);
    }
    let fibre = fibre_of(tangent, to_eye, albedo_of(curve, i, t, s), curve.tilt, open);
    var sum = vec3f(0.0);
    for (var n = 0u; n < frame.lights; n += 1u) {
        let light = lights[n];
        var lit = 1.0;
        if light.heights != NONE {
            lit = visibility(light, position + light.direction * (4.0 * light.texel));
        }
        if lit > 0.0 {
            var depth = 0.0;
            if light.grid != NONE {
                let at = (position - frame.shadow_origin) / frame.shadow_cell;
                depth = sample_grid(light.grid, frame.shadow_size, at);
            }
            sum += light.colour * scatter(fibre, light.direction, depth) * (lit * PI);
        }
    }
    let up = vec3f(0.0, 1.0, 0.0);
    let facing = normalize_or(to_eye - tangent * dot(tangent, to_eye) + up * 0.5, up);
    sum += mix(frame.ground, frame.sky, 0.5 + 0.5 * facing.y) * ambient(fibre, open);
    let kept = clamp(sum, vec3f(0.0), vec3f(60000.0));
    radiance[thread] = vec2u(pack2x16float(kept.xy), pack2x16float(vec2f(kept.z, 0.0)));
}
