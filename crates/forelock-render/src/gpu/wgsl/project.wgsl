// Projects each particle: pixel x, pixel y, inverse depth, half the width in pixels. The inverse
// depth is 0 where a particle cannot be drawn.

@group(0) @binding(4) var<storage, read> widths: array<f32>;
@group(0) @binding(9) var<storage, read_write> points: array<vec4f>;

@compute @workgroup_size(THREADS)
fn project(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let point = thread_of(group, groups, local);
    if point >= frame.points {
        return;
    }
    let curve = curves[owners[point]];
    let i = point - curve.start;
    let s = f32(i) / f32(curve.count - 1u);
    let offset = particle(curve, i) + offset_at(curve, s) - frame.eye;
    let depth = dot(offset, frame.forward);
    // A comparison with a number that is not finite is false. Spare curves have no width.
    let usable = depth > frame.near && all(abs(offset) < vec3f(1e18)) && curve.detail > 0.0;
    if !usable {
        points[point] = vec4f(0.0);
        return;
    }
    let nearness = 1.0 / depth;
    let scale = frame.focal * nearness;
    let x = frame.centre.x + dot(offset, frame.right) * scale;
    let y = frame.centre.y - dot(offset, frame.up) * scale;
    points[point] = vec4f(x, y, nearness, 0.5 * curve.detail * widths[curve.first + i] * scale);
}
