// The light scattering of a single hair: the twin of `fibre.rs`, term by term.

const PI: f32 = 3.14159265;

struct Fibre {
    tangent: vec3f,
    to_eye: vec3f,
    log_albedo: vec3f,
    tint: vec3f,
    fading: vec3f,
    tilt: f32,
}

fn normalize_or(v: vec3f, other: vec3f) -> vec3f {
    let square = dot(v, v);
    return select(other, v * inverseSqrt(max(square, 1e-37)), square > 1e-37);
}

fn luminance(colour: vec3f) -> f32 {
    return dot(colour, vec3f(0.2126, 0.7152, 0.0722));
}

fn gaussian(x: f32, deviation: f32) -> f32 {
    return exp(-0.5 * x * x / (deviation * deviation)) / (deviation * 2.5066283);
}

fn fresnel(cosine: f32) -> f32 {
    let m = clamp(1.0 - cosine, 0.0, 1.0);
    return FRESNEL_0 + (1.0 - FRESNEL_0) * (m * m) * (m * m) * m;
}

fn fibre_of(tangent: vec3f, to_eye: vec3f, given: vec3f, tilt: f32) -> Fibre {
    let albedo = max(given, vec3f(1e-4));
    let log_albedo = log(albedo);
    let tint = exp(log_albedo * REMAINDER_POWER);
    let fading = 0.75 - 0.12 * min(albedo / luminance(albedo), vec3f(2.0));
    return Fibre(tangent, to_eye, log_albedo, tint, fading, SCALE_TILT + tilt);
}

fn scatter(fibre: Fibre, l: vec3f, depth: f32) -> vec3f {
    let t = fibre.tangent;
    let v = fibre.to_eye;
    let sin_l = dot(t, l);
    let sin_v = dot(t, v);
    let cos_l = sqrt(max(1.0 - sin_l * sin_l, 0.0));
    let cos_v = sqrt(max(1.0 - sin_v * sin_v, 0.0));
    let cos_d = sqrt(max(0.5 + 0.5 * (cos_l * cos_v + sin_l * sin_v), 1e-4));
    let cos_phi = dot(l - t * sin_l, v - t * sin_v) / max(cos_l * cos_v, 1e-4);
    let cos_half = sqrt(max(0.5 + 0.5 * cos_phi, 0.0));
    let sum = sin_l + sin_v;
    let tilt = fibre.tilt;

    let m_r = gaussian(sum + 2.0 * tilt, ROUGHNESS);
    let r = m_r * 0.25 * cos_half * fresnel(sqrt(max(0.5 + 0.5 * dot(v, l), 0.0)));

    let m_tt = gaussian(sum - tilt, ROUGHNESS);
    let index = 1.19 / cos_d + 0.36 * cos_d;
    let h = cos_half * (1.0 + (0.6 - 0.8 * cos_phi) / index);
    let f_tt = fresnel(cos_d * sqrt(max(1.0 - h * h, 0.0)));
    let through = 0.5 * sqrt(max(1.0 - (h / index) * (h / index), 0.0)) / cos_d;
    let tt = exp(fibre.log_albedo * through)
        * (m_tt * (1.0 - f_tt) * (1.0 - f_tt) * exp(-3.65 * cos_phi - 3.98));

    let m_trt = gaussian(sum - 4.0 * tilt, 2.0 * ROUGHNESS);
    let f = fresnel(0.5 * cos_d);
    let trt = exp(fibre.log_albedo * (0.8 / cos_d))
        * (m_trt * (1.0 - f) * (1.0 - f) * f * exp(17.0 * cos_phi - 16.78));

    return (vec3f(r) + tt + trt) * (exp(-depth) * cos_l) + remainder(fibre, l, v - t * sin_v, depth);
}

fn remainder(fibre: Fibre, to_light: vec3f, facing: vec3f, depth: f32) -> vec3f {
    let normal = normalize_or(facing, fibre.to_eye);
    let wrapped = 0.25 * (1.0 + dot(normal, to_light));
    return fibre.tint * exp(fibre.fading * -depth) * (wrapped / PI);
}
