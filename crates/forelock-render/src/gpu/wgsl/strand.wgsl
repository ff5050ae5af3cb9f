// Particles in world space.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> positions: array<f32>;
@group(0) @binding(2) var<storage, read> curves: array<Curve>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;

fn particle(curve: Curve, i: u32) -> vec3f {
    let at = curve.base + i * frame.particle_stride;
    let step = frame.component_stride;
    return vec3f(positions[at], positions[at + step], positions[at + 2u * step]) + frame.position_origin;
}

// The offset of a child at `s`, 0 at the root and 1 at the tip.
fn offset_at(curve: Curve, s: f32) -> vec3f {
    let wave = sin(curve.wave * 3.0 + s * 9.0) * 0.35;
    let profile = min(0.6 + 2.0 * s, 1.0) * (1.0 - 0.65 * s * s);
    return (curve.offset + curve.offset.yzx * (wave * s)) * profile;
}
