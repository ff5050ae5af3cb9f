// Strands that go where they are told: the GPU counterpart of `PrescribedParams::solve`. The
// targets are the only channel of the solver.

@compute @workgroup_size(WORKGROUP)
fn follow_targets(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var i = 0u; i < strand.particles; i++) {
        let was = position_at(strand, i) + substep.shift;
        let x = channel_vector(channel_entry(strand, i, 0u));
        set_position(strand, i, x);
        set_velocity(strand, i, (x - was) * frame.inverse_h);
    }
}
