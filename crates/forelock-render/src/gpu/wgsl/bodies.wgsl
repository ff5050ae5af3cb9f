// What is behind the hair, one thread a pixel: bodies over the backdrop, by four samples. The twin
// of `Tile::draw_solids`, `Solids::surface_point` and `Lighting::of_body`.

@group(0) @binding(0) var<uniform> frame: Frame;
// For each tile, the inverse depth behind which bodies hide everything.
@group(0) @binding(14) var<storage, read_write> horizon: array<f32>;
@group(0) @binding(16) var behind: texture_storage_2d<rgba32float, write>;
@group(0) @binding(17) var nearness: texture_storage_2d<rgba32float, write>;
@group(0) @binding(19) var<storage, read> triangles: array<Triangle>;
// For each tile the first of its triangles in the same array, and one number more.
@group(0) @binding(20) var<storage, read> bins: array<u32>;
@group(0) @binding(21) var<storage, read> vertices: array<Vertex>;

// A triangle on the screen: pixels and inverse depth of each corner, and its vertices.
struct Triangle {
    a: vec3f,
    va: u32,
    b: vec3f,
    vb: u32,
    c: vec3f,
    vc: u32,
}

struct Surface {
    position: vec3f,
    normal: vec3f,
    paint: Paint,
}

var<workgroup> lowest: atomic<u32>;

fn cross_of(a: vec2f, b: vec2f) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// `x` clamped to 0–1; 0 for what is no number.
fn unit(x: f32) -> f32 {
    return select(0.0, min(x, 1.0), x > 0.0);
}

fn surface_at(triangle: Triangle, pixel: vec2f, near: f32) -> Surface {
    let slope = vec2f(pixel.x - frame.centre.x, frame.centre.y - pixel.y) / frame.focal;
    let seen = frame.eye + (frame.forward + frame.right * slope.x + frame.up * slope.y) / near;
    let a = vertices[triangle.va];
    let b = vertices[triangle.vb];
    let c = vertices[triangle.vc];
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

// The mean light of four samples at `centre`, of which `found` tells triangles and inverse depths.
fn light_behind(centre: vec2f, found: vec4u, depths: vec4f) -> vec3f {
    var sum = vec3f(0.0);
    for (var i = 0u; i < 4u; i += 1u) {
        if found[i] == NONE {
            sum += backdrop_at(centre) * 0.25;
            continue;
        }
        // Each triangle is lit once, at the mean place of its samples, and one that the near plane
        // cuts, once for each of its parts.
        var at = vec2f(0.0);
        var near = 0.0;
        var count = 0.0;
        var is_first = true;
        for (var j = 0u; j < 4u; j += 1u) {
            if found[j] == found[i] {
                is_first = is_first && j >= i;
                at += vec2f(f32(j & 1u), f32(j >> 1u));
                near += depths[j];
                count += 1.0;
            }
        }
        if is_first {
            let place = centre + (at / count + 0.5) * 0.5 - 0.5;
            sum += of_body(surface_at(triangles[found[i]], place, near / count)) * (0.25 * count);
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
        let bin = group.y * frame.tiles.x + group.x;
        var found = vec4u(NONE);
        var depths = vec4f(0.0);
        for (var k = bins[bin]; k < bins[bin + 1u]; k += 1u) {
            let triangle = triangles[bins[k]];
            let a = triangle.a.xy - centre;
            let b = triangle.b.xy - centre;
            let c = triangle.c.xy - centre;
            let lo = min(a, min(b, c));
            let hi = max(a, max(b, c));
            let area = cross_of(b - a, c - a);
            if any(lo > vec2f(0.25)) || any(hi < vec2f(-0.25)) || area == 0.0 || abs(area) > 1e30 {
                continue;
            }
            for (var i = 0u; i < 4u; i += 1u) {
                let p = vec2f(f32(i & 1u), f32(i >> 1u)) * 0.5 - 0.25;
                let u = cross_of(b - p, c - p) / area;
                let v = cross_of(c - p, a - p) / area;
                let w = 1.0 - u - v;
                let near = u * triangle.a.z + v * triangle.b.z + w * triangle.c.z;
                if min(u, min(v, w)) >= 0.0 && near > depths[i] {
                    depths[i] = near;
                    found[i] = bins[k];
                }
            }
        }
        textureStore(behind, pixel, vec4f(light_behind(centre, found, depths), 1.0));
        textureStore(nearness, pixel, depths);
        let least = min(min(depths.x, depths.y), min(depths.z, depths.w));
        // Inverse depths are not negative, so their bits have the same order.
        atomicMin(&lowest, bitcast<u32>(least));
    }
    workgroupBarrier();
    if local == 0u {
        horizon[group.y * frame.tiles.x + group.x] = bitcast<f32>(atomicLoad(&lowest));
    }
}
