// Friction between neighbouring hair, one strand per thread: applies the changes.

@compute @workgroup_size(WORKGROUP)
fn apply_changes(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = contacts.clamped; i < strand.particles; i++) {
        let change = work_vector(row_of(number_of(strand, i), MOTION_ROWS, 0u));
        if all(change == vec3f()) {
            continue;
        }
        let by = (vec4f(change, 0.0) * contacts.from_end).xyz;
        set_position(strand, i, position_at(strand, i) + by);
        set_velocity(strand, i, velocity_at(strand, i) + by / contacts.dt);
        let at = entry(strand, i, 2u, 1u);
        if memory[at] >= 0.0 {
            memory[at] = max(memory[at] - length(change), 0.0);
        }
    }
}
