// Draws the bodies into the shadow maps, several threads a triangle: the twin of `ShadowMap::draw`.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(6) var<storage, read> lights: array<Light>;
@group(0) @binding(8) var<storage, read_write> heights: array<atomic<u32>>;

fn place_in(light: Light, position: vec3f) -> vec3f {
    let offset = position - light.origin;
    let place = vec2f(dot(offset, light.right), dot(offset, light.up)) / light.texel;
    return vec3f(place, dot(offset, light.direction));
}

fn draw(light: Light, a: vec3f, b: vec3f, c: vec3f, slice: u32) {
    let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    // Also left out if it is not a number.
    if !(abs(area) > 0.0 && abs(area) < 1e30) {
        return;
    }
    let side = f32(light.side);
    let lo = vec2u(clamp(ceil(min(a, min(b, c)).xy - 0.5), vec2f(0.0), vec2f(side)));
    let hi = vec2u(clamp(floor(max(a, max(b, c)).xy + 0.5), vec2f(0.0), vec2f(side)));
    for (var y = lo.y + slice; y < hi.y; y += frame.slices) {
        let py = f32(y) + 0.5;
        for (var x = lo.x; x < hi.x; x += 1u) {
            let px = f32(x) + 0.5;
            let u = ((b.x - px) * (c.y - py) - (b.y - py) * (c.x - px)) / area;
            let v = ((c.x - px) * (a.y - py) - (c.y - py) * (a.x - px)) / area;
            let w = 1.0 - u - v;
            if min(u, min(v, w)) >= 0.0 {
                let height = u * a.z + v * b.z + w * c.z;
                atomicMax(&heights[light.heights + y * light.side + x], ordered(height));
            }
        }
    }
}

@compute @workgroup_size(THREADS)
fn map_shadows(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let thread = thread_of(group, groups, local);
    let face = thread / frame.slices;
    if face >= frame.faces {
        return;
    }
    let a = place_of(face, 0u);
    let b = place_of(face, 1u);
    let c = place_of(face, 2u);
    for (var n = 0u; n < frame.lights; n += 1u) {
        let light = lights[n];
        if light.heights != NONE {
            draw(light, place_in(light, a), place_in(light, b), place_in(light, c), thread % frame.slices);
        }
    }
}
