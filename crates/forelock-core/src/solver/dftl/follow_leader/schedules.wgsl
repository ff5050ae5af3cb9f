// The schedules of the paper: a kernel predicts all particles, and then strands or levels are
// processed.

// The first part of a step: stores the positions of the step before and the predicted positions.
@compute @workgroup_size(WORKGROUP)
fn predict_particles(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    let i = id.y;
    if !strand.here || i >= strand.particles {
        return;
    }
    let was = position_at(strand, i) + substep.shift;
    let predicted = predicted_at(strand, i, was);
    set_previous(strand, i, was);
    set_position(strand, i, predicted);
}

// All levels of a strand in one thread, after the prediction.
@compute @workgroup_size(WORKGROUP)
fn follow_strands(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    var carried = begin_strand(strand);
    carried.leader_was = previous_at(strand, 0u);
    set_position(strand, 0u, carried.leader);
    for (var i = 1u; i < strand.particles; i++) {
        carried = follow_level(strand, i, previous_at(strand, i), position_at(strand, i), carried);
    }
    end_particle(strand, strand.particles - 1u, carried, vec3f(0.0));
}

// One level, after the prediction. The normal of the level before is stored in the row of that
// particle's velocity until the velocity is written.
@compute @workgroup_size(WORKGROUP)
fn follow_level_of_strands(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    let i = substep.level;
    if !strand.here || i >= strand.particles {
        return;
    }
    var carried = begin_strand(strand);
    if i == 1u {
        carried.leader_was = previous_at(strand, 0u);
        set_position(strand, 0u, carried.leader);
    } else {
        carried.leader = position_at(strand, i - 1u);
        carried.leader_was = previous_at(strand, i - 1u);
        carried.tangent = direction_of(carried.leader - position_at(strand, i - 2u));
        carried.normal = velocity_at(strand, i - 1u);
    }
    carried = follow_level(strand, i, previous_at(strand, i), position_at(strand, i), carried);
    if i + 1u == strand.particles {
        end_particle(strand, i, carried, vec3f(0.0));
    } else {
        set_velocity(strand, i, carried.normal);
    }
}
