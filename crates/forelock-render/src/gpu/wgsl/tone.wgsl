// From linear light to what a display shows.

fn film_curve(colour: vec3f) -> vec3f {
    let knee = 0.55;
    let peak = max(colour.x, max(colour.y, colour.z));
    if peak <= knee {
        return colour;
    }
    let room = 1.0 - knee;
    let shaped = 1.0 - room * room / (peak - knee + room);
    let kept = colour * (shaped / peak);
    return mix(kept, vec3f(shaped), 1.0 - 1.0 / (0.12 * (peak - shaped) + 1.0));
}

fn srgb_encode(linear: vec3f) -> vec3f {
    let curved = 1.055 * pow(max(linear, vec3f(1e-8)), vec3f(1.0 / 2.4)) - 0.055;
    return select(curved, linear * 12.92, linear <= vec3f(0.0031308));
}
