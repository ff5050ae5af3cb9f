// The four samples of bodies in a pixel, two along each side.

// The near plane's depth over that of the samples, 0 for none.
@group(0) @binding(26) var depths: texture_depth_2d;

// The inverse depths of the samples of `pixel`, 0 for none.
fn nearness_at(pixel: vec2u) -> vec4f {
    let corner = 2u * pixel;
    let upper = vec2f(textureLoad(depths, corner, 0), textureLoad(depths, corner + vec2u(1u, 0u), 0));
    let lower =
        vec2f(textureLoad(depths, corner + vec2u(0u, 1u), 0), textureLoad(depths, corner + 1u, 0));
    return vec4f(upper, lower) / frame.near;
}
