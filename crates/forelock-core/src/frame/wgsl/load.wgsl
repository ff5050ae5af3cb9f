// Stores the load that velocities hold in addition to the motion before an interaction, and
// restores it afterwards. One strand a thread.

@compute @workgroup_size(WORKGROUP)
fn store_load(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let u = (position_at(strand, i) - previous_at(strand, i)) * frame.inverse_h;
        set_load(strand, i, velocity_at(strand, i) - u);
        set_velocity(strand, i, u);
    }
}

// The same after collisions that moved particles: the motion is that of the positions.
@compute @workgroup_size(WORKGROUP)
fn derive_velocities(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let u = (position_at(strand, i) - previous_at(strand, i)) * frame.inverse_h;
        set_velocity(strand, i, u + load_at(strand, i));
    }
}

@compute @workgroup_size(WORKGROUP)
fn restore_load(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        set_velocity(strand, i, velocity_at(strand, i) + load_at(strand, i));
    }
}
