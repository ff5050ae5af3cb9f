// The drag of a wind field, one strand a thread, before `follow_leader`: it changes velocities as
// the acceleration would.

@group(0) @binding(17) var<storage, read> wind: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn apply_wind(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let at = entry(strand, i, 3u, 0u);
        let air = vec3f(wind[at], wind[at + LANES], wind[at + 2u * LANES]);
        // Neither is relative to this frame's origin yet, so no shift is needed.
        let u = (position_at(strand, i) - previous_at(strand, i)) * frame.inverse_h;
        set_velocity(strand, i, velocity_at(strand, i) + min(frame.drag / mass_at(strand, i), 1.0) * (air - u));
    }
}
