// Sets the channels that start in this frame to their initial values. One strand a thread.

@compute @workgroup_size(WORKGROUP)
fn start_channels(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    for (var row = 0u; row < frame.channel_rows; row++) {
        let initial = channel_starts[row];
        if initial.starts == 0u {
            continue;
        }
        for (var i = 0u; i < strand.particles; i++) {
            channels[channel_entry(strand, i, row)] = initial.at_start;
        }
    }
}
