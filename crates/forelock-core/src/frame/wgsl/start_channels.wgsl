// Sets the channels that start in this frame to their initial values. One strand a thread.

@compute @workgroup_size(WORKGROUP)
fn start_channels(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    let turn = own_turn(strand, substep.start, substep.share_at_start);
    for (var row = 0u; row < frame.channel_rows; row++) {
        if channel_starts[row].starts == 0u {
            continue;
        }
        let initial = initial_value(row, turn, false);
        for (var i = 0u; i < strand.particles; i++) {
            channels[channel_entry(strand, i, row)] = initial;
        }
    }
}
