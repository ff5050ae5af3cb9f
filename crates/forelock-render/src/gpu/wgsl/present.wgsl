// Copies the picture to a target.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(18) var<storage, read> picture: array<u32>;

// The number of a pixel.
fn pixel_at(place: vec4f) -> u32 {
    let pixel = min(vec2u(place.xy), frame.size - 1u);
    return pixel.y * frame.size.x + pixel.x;
}

fn colour_at(place: vec4f) -> vec4f {
    return unpack4x8unorm(picture[pixel_at(place)]);
}

@fragment
fn encoded(@builtin(position) place: vec4f) -> @location(0) vec4f {
    return colour_at(place);
}

// For targets that encode sRGB themselves.
@fragment
fn linear(@builtin(position) place: vec4f) -> @location(0) vec4f {
    let colour = colour_at(place);
    let curved = pow((colour.xyz + 0.055) / 1.055, vec3f(2.4));
    return vec4f(select(curved, colour.xyz / 12.92, colour.xyz <= vec3f(0.04045)), colour.w);
}

// Linear light times opacity, and opacity, where the picture is drawn over a target.
fn light_at(place: vec4f) -> vec4f {
    let at = 3u * pixel_at(place);
    return vec4f(unpack2x16float(picture[at]), unpack2x16float(picture[at + 1u]));
}

// What a display shows of `light`, without its opacity.
fn shown(light: vec4f) -> vec3f {
    return film_curve(light.xyz / max(light.w, 1e-6));
}

// Over targets of floating-point numbers.
@fragment
fn light_over(@builtin(position) place: vec4f) -> @location(0) vec4f {
    return light_at(place);
}

// Over targets that encode sRGB themselves.
@fragment
fn linear_over(@builtin(position) place: vec4f) -> @location(0) vec4f {
    let light = light_at(place);
    return vec4f(shown(light) * light.w, light.w);
}

// Over other targets.
@fragment
fn encoded_over(@builtin(position) place: vec4f) -> @location(0) vec4f {
    let light = light_at(place);
    return vec4f(srgb_encode(shown(light)) * light.w, light.w);
}

// The depth of the target, larger where it is nearer.
@fragment
fn depth_over(@builtin(position) place: vec4f) -> @builtin(frag_depth) f32 {
    let nearness = bitcast<f32>(picture[3u * pixel_at(place) + 2u]);
    return clamp(nearness * frame.target_near, 0.0, 1.0);
}
