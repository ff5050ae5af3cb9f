// Particles in world space.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(2) var<storage, read> curves: array<Curve>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;

fn particle(curve: Curve, i: u32) -> vec3f {
    return particle_from(curve.base, i);
}

// The particles around the edge from particle `i` on.
struct Four {
    p0: vec3f,
    p1: vec3f,
    p2: vec3f,
    p3: vec3f,
}

fn particles_around(curve: Curve, i: u32) -> Four {
    let last = curve.count - 1u;
    return Four(
        particle(curve, max(i, 1u) - 1u),
        particle(curve, i),
        particle(curve, min(i + 1u, last)),
        particle(curve, min(i + 2u, last)),
    );
}

fn blend(p: Four, w: vec4f) -> vec3f {
    return p.p0 * w.x + p.p1 * w.y + p.p2 * w.z + p.p3 * w.w;
}

// The weights of four points for the uniform Catmull-Rom curve, and their derivatives.
fn catmull_rom(t: f32) -> vec4f {
    let t2 = t * t;
    let t3 = t2 * t;
    return vec4f(
        t2 - 0.5 * (t3 + t),
        1.0 + 1.5 * t3 - 2.5 * t2,
        2.0 * t2 - 1.5 * t3 + 0.5 * t,
        0.5 * (t3 - t2),
    );
}

fn catmull_rom_slope(t: f32) -> vec4f {
    let t2 = t * t;
    return vec4f(2.0 * t - 1.5 * t2 - 0.5, 4.5 * t2 - 5.0 * t, 4.0 * t - 4.5 * t2 + 0.5, 1.5 * t2 - t);
}

// The offset of a child at `s`, 0 at the root and 1 at the tip.
fn offset_at(curve: Curve, s: f32) -> vec3f {
    let wave = sin(curve.wave * 3.0 + s * 9.0) * 0.35;
    let profile = min(0.6 + 2.0 * s, 1.0) * (1.0 - 0.65 * s * s);
    return (curve.offset + curve.offset.yzx * (wave * s)) * profile;
}
