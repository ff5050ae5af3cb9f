// The colours of a face: the twin of `face.rs` and of the head's features. Lengths in centimetres.

struct Paint {
    albedo: vec3f,
    polish: f32,
}

fn rise(x: f32, low: f32, high: f32) -> f32 {
    let t = clamp((x - low) / (high - low), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

fn fall(x: f32, low: f32, high: f32) -> f32 {
    return 1.0 - rise(x, low, high);
}

fn flush_at(m: vec3f) -> f32 {
    let ear = rise(m.x, 6.9, 7.8) * fall(abs(m.y + 1.5), 3.0, 4.0);
    let cheek = fall(distance(m, vec3f(4.4, -3.6, 6.2)), 0.0, 3.4);
    let nose = fall(distance(m, vec3f(0.0, -3.9, 10.9)), 0.0, 2.0);
    return max(max(0.8 * cheek, 0.7 * nose), 0.8 * ear);
}

fn brow_at(m: vec3f) -> f32 {
    let along = (m.x - 1.15) / 4.3;
    if along < -0.1 || along >= 1.1 {
        return 0.0;
    }
    let middle = 1.3 + 0.95 * along * (1.42 - along);
    let inner = max(along, 0.0);
    let half = 0.36 * (1.0 - inner * inner) + 0.05;
    let up = m.y - middle;
    let ends = rise(along, -0.03, 0.12) * fall(along, 0.85, 1.02);
    let turns = 2.0 * PI / 0.11 * (m.x - 0.8 * up + 0.9 * up * up);
    let uneven = sin(0.37 * turns) + sin(0.61 * turns + 9.0 * up);
    let gaps = 0.8 + 0.2 * sin(turns + 1.3 * uneven);
    return ends * fall(abs(up / half), 0.45, 1.15) * gaps;
}

fn lips_at(m: vec3f) -> f32 {
    let along = min(m.x / 2.35, 1.0);
    let round = 1.0 - along * along;
    let bow = 1.0 - 0.22 * fall(m.x, 0.0, 0.55);
    let upper = -7.12 + 0.72 * bow * pow(max(round, 0.0), 0.8);
    let lower = -7.12 - 0.85 * round;
    let sides = fall(m.x, 2.2, 2.45) * rise(m.z, 6.0, 7.0);
    return sides * rise(m.y, lower - 0.06, lower + 0.12) * fall(m.y, upper - 0.1, upper + 0.06);
}

// The albedo and the exponent of the highlight at `rest` of the built-in head, metres.
fn paint(rest: vec3f, bare: vec3f, brows: vec3f) -> Paint {
    let m = vec3f(abs(rest.x), rest.yz) * 100.0;
    var skin = bare * mix(vec3f(1.0), vec3f(1.05, 0.84, 0.82), flush_at(m));
    if m.z <= 3.0 {
        return Paint(skin, 22.0);
    }
    let lips = lips_at(m);
    let q = m - vec3f(3.15, -0.1, 6.75);
    let ball = fall(length(q), 1.31, 1.4);
    let off_axis = length(q.xy);
    let rim = fall(abs(off_axis - 0.6), 0.0, 0.06) * 0.6;
    let pupil = max(fall(off_axis, 0.17, 0.23), rim);
    let t = (q.x - 0.05) / 1.5;
    let open = 1.0 - t * t;
    let tilted = q.y - 0.1 * q.x;
    let upper = tilted - 0.55 * open + 0.1;
    let lower = 0.1 - tilted - 0.45 * open;
    let shadow = ball * rise(upper, -0.4, 0.05);
    let near = fall(length(q), 1.78, 1.98) * (1.0 - ball) * fall(abs(q.x), 1.45, 1.7);
    let lashes = near * max(fall(abs(upper - 0.02), 0.05, 0.16), 0.35 * fall(abs(lower), 0.02, 0.1));

    skin = mix(skin, skin * vec3f(0.9, 0.62, 0.61), lips);
    skin = mix(skin, brows, 0.85 * brow_at(m));
    skin = mix(skin, vec3f(0.03, 0.02, 0.016), 0.9 * lashes);
    var eye = mix(vec3f(0.46, 0.43, 0.41), vec3f(0.05, 0.034, 0.022), fall(off_axis, 0.57, 0.63));
    eye = mix(eye, vec3f(0.006, 0.005, 0.005), pupil) * (1.0 - 0.6 * shadow);
    return Paint(mix(skin, eye, ball), select(22.0 + 18.0 * lips, 350.0, ball > 0.5));
}
