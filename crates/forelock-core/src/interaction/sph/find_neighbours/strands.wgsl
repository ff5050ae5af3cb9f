// SPH particles, strand by strand: inserts them into buckets and applies their accelerations.

@compute @workgroup_size(WORKGROUP)
fn count_particles(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        atomicAdd(&table[bucket_of(cell_of(position_at(strand, i)))], 1u);
    }
}

@compute @workgroup_size(WORKGROUP)
fn insert_particles(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let has_previous = arrayLength(&velocities) > arrayLength(&positions);
    for (var i = 0u; i < strand.particles; i++) {
        let x = position_at(strand, i);
        var u = velocity_at(strand, i);
        if has_previous {
            u = (x - previous_at(strand, i)) * fluid.inverse_dt;
        }
        let number = number_of(strand, i);
        let at = ENTRY * atomicAdd(&table[fluid.buckets + bucket_of(cell_of(x))], 1u);
        set_vector_at(at, x);
        set_vector_at(at + 3u, u);
        cloud[at + 6u] = number;
        cloud[at + 7u] = names[3u * number + 1u];
    }
}

// Applies the accelerations for a step to the velocities.
@compute @workgroup_size(WORKGROUP)
fn accelerate_strands(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let a = vector_at(acceleration_of(number_of(strand, i)));
        set_velocity(strand, i, velocity_at(strand, i) + fluid.dt * a);
    }
}
