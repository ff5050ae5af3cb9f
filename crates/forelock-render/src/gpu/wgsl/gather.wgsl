// Gathers positions from a buffer of what simulates the strands, one thread a particle.

struct Gather {
    // The point that they are relative to.
    origin: vec3f,
    // From the index of a coordinate to that of the next one.
    stride: u32,
    // The index of the group's first coordinate in `positions`.
    first: u32,
    // Particles.
    count: u32,
    unused: vec2u,
}

@group(0) @binding(0) var<uniform> own: Gather;
@group(0) @binding(1) var<storage, read_write> positions: array<f32>;
@group(0) @binding(2) var<storage, read> shared_positions: array<f32>;
// For each particle the index of its x in `shared_positions`, and its own index in the group.
@group(0) @binding(3) var<storage, read> places: array<vec2u>;

@compute @workgroup_size(THREADS)
fn gather(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let thread = thread_of(group, groups, local);
    if thread >= own.count {
        return;
    }
    let place = places[thread];
    let to = own.first + 3u * place.y;
    for (var axis = 0u; axis < 3u; axis += 1u) {
        positions[to + axis] = shared_positions[place.x + axis * own.stride] + own.origin[axis];
    }
}
