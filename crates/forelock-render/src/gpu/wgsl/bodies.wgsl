// What is behind the hair, one thread a pixel: bodies over the backdrop, by four samples. The twin
// of `Solids::surface_point` and `Lighting::of_body`.

@group(0) @binding(0) var<uniform> frame: Frame;
// For each tile, the inverse depth behind which bodies hide everything.
@group(0) @binding(14) var<storage, read_write> horizon: array<f32>;
@group(0) @binding(16) var behind: texture_storage_2d<rgba32float, write>;
// The number of the nearest triangle at each sample and 1, 0 for none.
@group(0) @binding(17) var ids: texture_2d<u32>;

struct Surface {
    position: vec3f,
    normal: vec3f,
    paint: Paint,
}

var<workgroup> lowest: atomic<u32>;

// `x` clamped to 0–1; 0 for what is no number.
fn unit(x: f32) -> f32 {
    return select(0.0, min(x, 1.0), x > 0.0);
}

fn surface_at(face: u32, pixel: vec2f, near: f32) -> Surface {
    let slope = vec2f(pixel.x - frame.centre.x, frame.centre.y - pixel.y) / frame.focal;
    let seen = frame.eye + (frame.forward + frame.right * slope.x + frame.up * slope.y) / near;
    let a = corner_of(face, 0u);
    let b = corner_of(face, 1u);
    let c = corner_of(face, 2u);
    let flat = cross(b.position - a.position, c.position - a.position);
    let twice = max(dot(flat, flat), 1.2e-38);
    let u = unit(dot(cross(c.position - b.position, seen - b.position), flat) / twice);
    let v = min(unit(dot(cross(a.position - c.position, seen - c.position), flat) / twice), 1.0 - u);
    let w = 1.0 - u - v;
    var surface: Surface;
    surface.position = a.position * u + b.position * v + c.position * w;
    let up = vec3f(0.0, 1.0, 0.0);
    surface.normal = normalize_or(a.normal * u + b.normal * v + c.normal * w, normalize_or(flat, up));
    let skin = a.skin * u + b.skin * v + c.skin * w;
    if a.has_face > 0.0 {
        let rest = a.rest * u + b.rest * v + c.rest * w;
        surface.paint = paint(rest, skin, vec3f(a.brow_red, a.brow_green, a.brow_blue));
    } else {
        surface.paint = Paint(skin, 22.0);
    }
    return surface;
}

fn of_body(surface: Surface) -> vec3f {
    let position = surface.position;
    let normal = surface.normal;
    let polish = surface.paint.polish;
    let to_eye = normalize_or(frame.eye - position, vec3f(0.0, 0.0, 1.0));
    var diffuse = vec3f(0.0);
    var gloss = vec3f(0.0);
    for (var n = 0u; n < frame.lights; n += 1u) {
        let light = lights[n];
        let cosine = dot(normal, light.direction);
        let wrap = vec3f(WRAP_RED, WRAP_GREEN, WRAP_BLUE);
        let wrapped = max(vec3f(cosine) + wrap, vec3f(0.0)) / (1.0 + wrap);
        if all(wrapped <= vec3f(0.0)) {
            continue;
        }
        var lit = 1.0;
        if light.heights != NONE {
            let out = position + (normal * 2.5 + light.direction * 2.0) * light.texel;
            lit = visibility(light, out, 2);
        }
        if light.grid != NONE {
            let at = (position - frame.shadow_origin) / frame.shadow_cell;
            lit *= exp(-EXTINCTION * sample_grid(light.grid, frame.shadow_size, at));
        }
        let arriving = light.colour * lit;
        diffuse += arriving * wrapped * wrapped;
        let half = normalize_or(light.direction + to_eye, normal);
        let m = 1.0 - clamp(dot(to_eye, half), 0.0, 1.0);
        let fresnel = 0.028 + 0.972 * (m * m) * (m * m) * m;
        let lobe = pow(max(dot(normal, half), 0.0), polish) * (0.125 * (polish + 2.0));
        gloss += arriving * (lobe * fresnel * max(cosine, 0.0));
    }
    var open = 1.0;
    if frame.open_cell > 0.0 {
        let at = (position - frame.open_origin) / frame.open_cell + normal * 1.6;
        open = min(1.5 * sample_grid(frame.open_start, frame.open_size, at), 1.0);
    }
    let ambient = mix(frame.ground, frame.sky, 0.5 + 0.5 * normal.y);
    return surface.paint.albedo * (diffuse + ambient * open) + gloss;
}

fn backdrop_at(pixel: vec2f) -> vec3f {
    let place = pixel / vec2f(frame.size);
    let offset = place - 0.5;
    let v = place.y;
    let colour = mix(frame.backdrop_top, frame.backdrop_bottom, v * v * (3.0 - 2.0 * v));
    return colour * (1.0 - frame.vignette * dot(offset, offset) * 2.0);
}

// The mean light of four samples at `centre`, and the share of them that is opaque. They are given
// by the numbers of their triangles and 1, and inverse depths.
fn light_behind(centre: vec2f, found: vec4u, nearness: vec4f) -> vec4f {
    var sum = vec4f(0.0);
    for (var i = 0u; i < 4u; i += 1u) {
        if found[i] == 0u {
            if frame.target_near == 0.0 {
                sum += vec4f(backdrop_at(centre), 1.0) * 0.25;
            }
            continue;
        }
        // Each triangle is lit once, at the mean place of its samples.
        var at = vec2f(0.0);
        var near = 0.0;
        var count = 0.0;
        var is_first = true;
        for (var j = 0u; j < 4u; j += 1u) {
            if found[j] == found[i] {
                is_first = is_first && j >= i;
                at += vec2f(f32(j & 1u), f32(j >> 1u));
                near += nearness[j];
                count += 1.0;
            }
        }
        if is_first {
            let place = centre + (at / count + 0.5) * 0.5 - 0.5;
            let light = of_body(surface_at(found[i] - 1u, place, near / count));
            sum += vec4f(light, 1.0) * (0.25 * count);
        }
    }
    return sum;
}

@compute @workgroup_size(THREADS)
fn bodies(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = group.xy * TILE + vec2u(local % TILE, local / TILE);
    let centre = vec2f(pixel) + 0.5;
    let inside = all(pixel < frame.size);
    if local == 0u {
        // The largest finite number.
        atomicStore(&lowest, 0x7f7fffffu);
    }
    workgroupBarrier();
    if inside {
        var found = vec4u(0u);
        for (var i = 0u; i < 4u; i += 1u) {
            found[i] = textureLoad(ids, 2u * pixel + vec2u(i & 1u, i >> 1u), 0).x;
        }
        let near = nearness_at(pixel);
        textureStore(behind, pixel, light_behind(centre, found, near));
        let least = min(min(near.x, near.y), min(near.z, near.w));
        // Inverse depths are not negative, so their bits have the same order.
        atomicMin(&lowest, bitcast<u32>(least));
    }
    workgroupBarrier();
    if local == 0u {
        horizon[group.y * frame.tiles.x + group.x] = bitcast<f32>(atomicLoad(&lowest));
    }
}
