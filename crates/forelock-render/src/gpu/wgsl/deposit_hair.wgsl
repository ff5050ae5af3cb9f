// The areas of chosen strands as seen from the side, one thread a strand: the twin of
// `deposit_hair`.

@group(0) @binding(4) var<storage, read> widths: array<f32>;
@group(0) @binding(24) var<storage, read> samples: array<Sample>;

struct Sample {
    // The number of its first coordinate in `positions`.
    base: u32,
    // Its first particle in `widths`.
    first: u32,
    count: u32,
    grid: u32,
    // The number of strands that it stands for.
    weight: f32,
    // The width at its root if it tapers, else 0, and `widths` has the widths.
    width: f32,
}

// The twin of `taper` in `hair.rs`.
fn taper(s: f32) -> f32 {
    let t = clamp((s - 0.6) / 0.4, 0.0, 1.0);
    return 1.0 - 0.8 * t * t;
}

@compute @workgroup_size(THREADS)
fn deposit_hair(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let thread = thread_of(group, groups, local);
    if thread >= frame.samples {
        return;
    }
    let sample = samples[thread];
    let cell = cell_of(sample.grid);
    var from_here = particle_from(sample.base, 0u);
    for (var i = 1u; i < sample.count; i += 1u) {
        let to_there = particle_from(sample.base, i);
        let length = distance(from_here, to_there);
        var width = sample.width * taper((f32(i) - 0.5) / f32(sample.count - 1u));
        if sample.width == 0.0 {
            width = 0.5 * (widths[sample.first + i - 1u] + widths[sample.first + i]);
        }
        let steps = clamp(ceil(length / (1.5 * cell)), 1.0, 64.0);
        for (var step = 0.5; step < steps; step += 1.0) {
            add(sample.grid, mix(from_here, to_there, step / steps), sample.weight * length * width / steps);
        }
        from_here = to_there;
    }
}
