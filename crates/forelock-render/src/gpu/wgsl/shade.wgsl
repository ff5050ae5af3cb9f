// The radiance of points on each edge towards the eye: the twin of `Lighting::of_hair`.

@group(0) @binding(5) var<storage, read> albedos: array<vec4f>;
// Red and green, blue and nothing, in half precision.
@group(0) @binding(10) var<storage, read_write> radiance: array<vec2u>;

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
            lit = visibility(light, position + light.direction * (4.0 * light.texel), 0);
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
