// The light scattering of hair: the twin of `fibre.rs`, term by term.

struct Fibre {
    tangent: vec3f,
    to_eye: vec3f,
    albedo: vec3f,
    absorption: vec3f,
    tilt: f32,
    behind: f32,
}

struct Angles {
    sum: f32,
    cos_d: f32,
    cos_t: f32,
    cos_phi: f32,
    cos_eye: f32,
}

// The shares of the light that a fibre scatters.
struct Scattered {
    forward: vec3f,
    backward: vec3f,
}

fn luminance(colour: vec3f) -> f32 {
    return dot(colour, vec3f(0.2126, 0.7152, 0.0722));
}

fn gaussian(x: f32, variance: f32) -> f32 {
    return exp(-0.5 * x * x / variance) / (sqrt(variance) * 2.5066283);
}

fn fresnel(cosine: f32) -> f32 {
    let m = clamp(1.0 - cosine, 0.0, 1.0);
    return FRESNEL_0 + (1.0 - FRESNEL_0) * (m * m) * (m * m) * m;
}

fn around(cos_phi: f32) -> f32 {
    return (1.0 + cos_phi) * (0.5 / PI);
}

fn fibre_of(tangent: vec3f, to_eye: vec3f, given: vec3f, tilt: f32, openness: f32) -> Fibre {
    let albedo = clamp(given, vec3f(1e-4), vec3f(1.0));
    let root = log(albedo) / ALBEDO_FROM_ABSORPTION;
    let behind = -log(clamp(2.0 * openness - 1.0, 1e-12, 1.0));
    return Fibre(tangent, to_eye, albedo, root * root, SCALE_TILT + tilt, behind);
}

fn ambient(fibre: Fibre, openness: f32) -> vec3f {
    let forward = scattered(fibre, 1.0, 1.0).forward;
    return (fibre.albedo * (1.0 - REFLECTED) + REFLECTED) * exp((1.0 - forward) * log(clamp(openness, 1e-3, 1.0)));
}

fn scatter(fibre: Fibre, l: vec3f, depth: f32) -> vec3f {
    let t = fibre.tangent;
    let v = fibre.to_eye;
    let sin_l = dot(t, l);
    let sin_v = dot(t, v);
    let cos_l = sqrt(max(1.0 - sin_l * sin_l, 0.0));
    let cos_v = sqrt(max(1.0 - sin_v * sin_v, 0.0));
    let cos_d2 = max(0.5 + 0.5 * (cos_l * cos_v + sin_l * sin_v), 1e-4);
    var angles: Angles;
    angles.sum = sin_l + sin_v;
    angles.cos_d = sqrt(cos_d2);
    angles.cos_t = sqrt(1.0 - (1.0 - cos_d2) * (1.0 / (1.55 * 1.55)));
    angles.cos_phi = dot(l - t * sin_l, v - t * sin_v) / max(cos_l * cos_v, 1e-4);
    angles.cos_eye = dot(v, l);

    let shares = scattered(fibre, angles.cos_d, angles.cos_t);
    let hidden = 1.0 - exp((shares.forward - 1.0) * fibre.behind);
    let back = from_behind(shares) * hidden * HAIR_DENSITY;
    let deviation = (1.0 + HAIR_DENSITY * luminance(shares.forward * shares.forward)) * (2.06 * ROUGHNESS);
    let spread = depth * ROUGHNESS * ROUGHNESS;
    let spread_on = around(-angles.cos_phi);
    let spread_back = around(angles.cos_phi);

    let straight = exp(-depth);
    let passed = exp((shares.forward - 1.0) * depth) - straight;
    let narrow = ROUGHNESS * ROUGHNESS + spread;
    let wide = deviation * deviation;
    let one = single(fibre, angles) + back * (spread_back * gaussian(angles.sum, wide));
    let many = (shares.forward * spread_on + shares.backward * spread_back) * gaussian(angles.sum, narrow)
        + back * (spread_back * gaussian(angles.sum, wide + spread));
    return (one * straight + passed * many * HAIR_DENSITY) * cos_l;
}

fn scattered(fibre: Fibre, cos_d: f32, cos_t: f32) -> Scattered {
    let m = 1.0 - cos_d;
    let m4 = (m * m) * (m * m);
    let f = fresnel(0.5 * cos_d);
    let tt = exp(fibre.absorption * (-TT_PATH / cos_t));
    let trt = exp(fibre.absorption * (-TRT_PATH / cos_t));
    let forward = 0.037 + m * (0.055 + 0.2 * m * m) + tt * max(0.875 - 1.226 * m4, 0.0);
    let backward = REFLECTED + 0.55 * m4 + trt * (0.757 * f * (1.0 - f) * (1.0 - f));
    return Scattered(forward, backward);
}

fn from_behind(shares: Scattered) -> vec3f {
    let s = 1.0 + shares.backward * shares.backward - shares.forward * shares.forward;
    let root = sqrt(max(s * s - 4.0 * shares.backward * shares.backward, vec3f(0.0)));
    return 2.0 * shares.backward / (s + root) - shares.backward;
}

fn single(fibre: Fibre, angles: Angles) -> vec3f {
    let variance = ROUGHNESS * ROUGHNESS;
    let cos_phi = angles.cos_phi;
    let cos_d = angles.cos_d;
    let cos_half = sqrt(max(0.5 + 0.5 * cos_phi, 0.0));

    let m_r = gaussian(angles.sum + 2.0 * fibre.tilt, variance);
    let r = m_r * 0.25 * cos_half * fresnel(sqrt(max(0.5 + 0.5 * angles.cos_eye, 0.0)));

    let m_tt = gaussian(angles.sum - fibre.tilt, variance);
    let index = 1.19 / cos_d + 0.36 * cos_d;
    let h = cos_half * (1.0 + (0.6 - 0.8 * cos_phi) / index);
    let f_tt = fresnel(cos_d * sqrt(max(1.0 - h * h, 0.0)));
    let path = 2.0 * sqrt(max(1.0 - (h / index) * (h / index), 0.0));
    let tt = exp(fibre.absorption * (-path / angles.cos_t))
        * (m_tt * (1.0 - f_tt) * (1.0 - f_tt) * exp(-3.65 * cos_phi - 3.98));

    let m_trt = gaussian(angles.sum - 4.0 * fibre.tilt, 4.0 * variance);
    let f = fresnel(0.5 * cos_d);
    let trt = exp(fibre.absorption * (-TRT_PATH / angles.cos_t))
        * (m_trt * (1.0 - f) * (1.0 - f) * f * exp(17.0 * cos_phi - 16.78));
    return vec3f(r) + tt + trt;
}
