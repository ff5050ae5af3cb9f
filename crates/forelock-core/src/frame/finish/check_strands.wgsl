// The check at the end of a frame: the largest stretch of each strand, and the reset of strands
// that are not finite to their rest shape, moving with the head and their own motion before it.

@compute @workgroup_size(WORKGROUP)
fn check_strands(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let n = strand.particles;
    var whole = true;
    for (var i = 0u; i < n; i++) {
        whole = whole && all_finite(position_at(strand, i)) && all_finite(velocity_at(strand, i));
    }
    let stretch = bitcast<u32>(largest_stretch(strand));
    if is_greatest(stretch) && stretch > atomicLoad(&report.stretch) {
        atomicMax(&report.stretch, stretch);
    }
    if whole {
        return;
    }
    atomicAdd(&report.quarantined, 1u);
    let turn = own_turn(strand, substep.end, substep.share_at_end);
    for (var i = 0u; i < n; i++) {
        let rest = rest_at(strand, i);
        let end = rest_at_end(strand, rest);
        set_position(strand, i, end);
        let start = rest_at_start(strand, rest);
        set_velocity(strand, i, (end - start) * frame.inverse_h);
        if arrayLength(&velocities) > arrayLength(&positions) {
            set_previous(strand, i, start);
        }
        let at = entry(strand, i, 2u, 0u);
        memory[at] = 1.0;
        memory[at + LANES] = frame.unknown;
        for (var row = 0u; row < frame.channel_rows; row++) {
            channels[channel_entry(strand, i, row)] = initial_value(row, turn, true);
        }
    }
}
