// The initial values of channels: turned with the head, and with the strand's own motion before it.

// A row of a particle at its initial value, of which the strand's own motion has turned `turn`:
// `ChannelKind::rotated`.
fn initial_value(row: u32, turn: vec4f, at_end: bool) -> f32 {
    let own = channel_starts[row];
    if !has(ROOT_FRAMES) || own.kind == SCALAR {
        return select(own.at_start, own.at_end, at_end);
    }
    let count = select(3u, 4u, own.kind == ROTATION_VALUE);
    var value = array<f32, 4>();
    for (var c = 0u; c < count; c++) {
        let part = channel_starts[row - own.component + c];
        value[c] = select(part.at_start, part.at_end, at_end);
    }
    let v = vec3f(value[0], value[1], value[2]);
    var initial = product(turn, vec4f(v, value[3]));
    if own.kind == VECTOR {
        initial = vec4f(rotate(turn, v), 0.0);
    }
    return initial[own.component];
}
