// Peak rates of a device: a copy, and independent fused multiply–adds.

@group(0) @binding(0) var<storage, read> source: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> target_: array<vec4f>;

@compute @workgroup_size(256)
fn copy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var at = id.x; at < arrayLength(&source); at += 256u * groups.x) {
        target_[at] = source[at];
    }
}

// Eight independent chains of four numbers.
@compute @workgroup_size(256)
fn multiply_add(@builtin(global_invocation_id) id: vec3u) {
    let a = source[0] + 0.999;
    let b = source[1] + 0.001;
    var x0 = vec4f(f32(id.x));
    var x1 = x0 + 1.0;
    var x2 = x0 + 2.0;
    var x3 = x0 + 3.0;
    var x4 = x0 + 4.0;
    var x5 = x0 + 5.0;
    var x6 = x0 + 6.0;
    var x7 = x0 + 7.0;
    for (var round = 0u; round < ROUNDS; round++) {
        x0 = fma(x0, a, b);
        x1 = fma(x1, a, b);
        x2 = fma(x2, a, b);
        x3 = fma(x3, a, b);
        x4 = fma(x4, a, b);
        x5 = fma(x5, a, b);
        x6 = fma(x6, a, b);
        x7 = fma(x7, a, b);
    }
    // Never true, which the compiler cannot know.
    let sum = x0 + x1 + x2 + x3 + x4 + x5 + x6 + x7;
    if sum.x == -1.0 {
        target_[id.x % arrayLength(&target_)] = sum;
    }
}
