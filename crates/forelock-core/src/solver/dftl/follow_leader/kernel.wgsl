// A step of follow the leader in one kernel: a thread steps its strand from root to tip, holds
// frames in registers, and reads and writes the state once.

@compute @workgroup_size(WORKGROUP)
fn follow_leader(@builtin(global_invocation_id) id: vec3u) {
    let strand = strand_of(id.x);
    if !strand.here {
        return;
    }
    var carried = begin_strand(strand);
    set_position(strand, 0u, carried.leader);
    for (var i = 1u; i < strand.particles; i++) {
        let was = position_at(strand, i) + substep.shift;
        carried = follow_level(strand, i, was, predicted_at(strand, i, was), carried);
    }
    end_particle(strand, strand.particles - 1u, carried, vec3f(0.0));
}
