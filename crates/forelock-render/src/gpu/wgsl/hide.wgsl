// The depths of a target, as those of bodies: for each pixel four samples of the same depth.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var target_depth: texture_depth_2d;

struct Hidden {
    @builtin(frag_depth) depth: f32,
    @location(0) face: u32,
}

@fragment
fn hide(@builtin(position) place: vec4f) -> Hidden {
    let depth = textureLoad(target_depth, vec2u(place.xy) / 2u, 0);
    return Hidden(clamp(depth * (frame.near / frame.target_near), 0.0, 1.0), 0u);
}
