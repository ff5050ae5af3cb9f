// Copies the picture to a colour target.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(18) var<storage, read> picture: array<u32>;

@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let place = vec2f(f32(index & 1u), f32(index >> 1u)) * 4.0 - 1.0;
    return vec4f(place, 0.0, 1.0);
}

fn colour_at(place: vec4f) -> vec4f {
    let pixel = min(vec2u(place.xy), frame.size - 1u);
    return unpack4x8unorm(picture[pixel.y * frame.size.x + pixel.x]);
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
