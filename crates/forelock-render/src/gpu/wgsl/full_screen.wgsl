// A triangle that covers all pixels.

@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    let place = vec2f(f32(index & 1u), f32(index >> 1u)) * 4.0 - 1.0;
    return vec4f(place, 0.0, 1.0);
}
