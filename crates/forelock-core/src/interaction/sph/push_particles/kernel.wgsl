// Accelerations by pressure and viscosity between neighbours: the GPU counterpart of
// `push_particles`.

fn pressure_at(slot: u32) -> f32 {
    let rest = bitcast<f32>(names[3u * number_at(slot) + 2u]);
    return max(fluid.pressure * (density_at(slot) - rest), 0.0);
}

// Whether the particle `number` at a squared distance is among the neighbours of the particle at
// `slot`.
fn has_neighbour(slot: u32, square: f32, number: u32) -> bool {
    let at = 9u * fluid.numbers + slot;
    let farthest = real_at(at);
    return square < farthest || (square == farthest && names[3u * number] <= cloud[at + fluid.numbers]);
}

@compute @workgroup_size(CELLS_GROUP)
fn push_particles(@builtin(global_invocation_id) id: vec3u) {
    let entries = atomicLoad(&table[2u * fluid.buckets]);
    for (var slot = id.x; slot < entries; slot += LIST_THREADS) {
        let number = number_at(slot);
        let x = vector_at(ENTRY * slot);
        let u = vector_at(ENTRY * slot + 3u);
        let pressure = pressure_at(slot);
        let list = list_of(slot);
        var force = vec3f(0.0);
        for (var n = 0u; n < fluid.neighbours; n++) {
            let other = cloud[list + n];
            if other == NO_SLOT {
                break;
            }
            let near = vector_at(ENTRY * other);
            let back = near - x;
            let square = dot(back, back);
            if fluid.mutual != 0u && !has_neighbour(other, square, number) {
                continue;
            }
            let length = sqrt(square);
            let rest = 1.0 - length / fluid.h;
            // Particles at the same position exert no pressure on each other.
            let inverse = select(0.0, 1.0 / length, length > 0.0);
            let density = density_at(other);
            let push = 0.5 * (pressure + pressure_at(other)) * fluid.mass_push * rest * rest * inverse / density;
            let drag = fluid.viscosity * fluid.mass_drag * rest / density;
            force += drag * (vector_at(ENTRY * other + 3u) - u) - push * back;
        }
        set_vector_at(acceleration_of(number), force / density_at(slot));
    }
}
