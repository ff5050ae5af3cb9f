//! Single constraints of rods in WGSL against reference results in float64: entry points of this
//! test call the functions of the kernel.

#![expect(clippy::unwrap_used, reason = "a test fails where its file is not as expected")]

use crate::common;
use crate::golden::load;
use forelock_gpu::Gpu;
use serde_json::Value;

/// Numbers of a case and of its solution, each padded to this.
const ROOM: usize = 24;

const ENTRY_POINTS: &str = "
@group(0) @binding(90) var<storage, read> cases: array<f32>;
@group(0) @binding(91) var<storage, read_write> solved: array<f32>;

fn case_vector(at: u32) -> vec3f {
    return vec3f(cases[at], cases[at + 1u], cases[at + 2u]);
}

fn solve_vector(at: u32, v: vec3f) {
    solved[at] = v.x;
    solved[at + 1u] = v.y;
    solved[at + 2u] = v.z;
}

@compute @workgroup_size(1)
fn one_stretch_shear(@builtin(workgroup_id) id: vec3u) {
    let at = id.x * ROOM;
    let q = vec4f(case_vector(at + 6u), cases[at + 9u]);
    let sum = case_vector(at + 10u);
    let inverse = 1.0 / cases[at + 13u];
    let w = vec2f(cases[at + 14u], cases[at + 15u]);
    // Frames at rest along z, as the file's.
    let edge = Edge(Rotation(q, vec4f()), q, cases[at + 16u], cases[at + 13u], vec3f(0.0, 0.0, 1.0));
    let ends = array<vec3f, 2>(case_vector(at), case_vector(at + 3u));
    let found = stretch_shear(edge, ends[1] - ends[0], w, inverse, cases[at + 17u], sum);
    solve_vector(at, ends[0] - found.change * (w.x * inverse));
    solve_vector(at + 3u, ends[1] + found.change * (w.y * inverse));
    solve_vector(at + 6u, found.rotation.now.xyz);
    solved[at + 9u] = found.rotation.now.w;
    solve_vector(at + 10u, sum + found.change);
}

@compute @workgroup_size(1)
fn one_bend_twist(@builtin(workgroup_id) id: vec3u) {
    let at = id.x * ROOM;
    // The frame of `a` at rest is the identity, that of `b` the file's Ω⁰.
    let bend = vec4f(case_vector(at + 8u), cases[at + 11u]);
    let a = vec4f(case_vector(at), cases[at + 3u]);
    let b = product(vec4f(case_vector(at + 4u), cases[at + 7u]), conjugate(bend));
    let w = vec2f(cases[at + 15u], cases[at + 16u]);
    let sum = case_vector(at + 12u);
    let found = couple(Rotation(a, vec4f()), Rotation(b, vec4f()), bend, w, cases[at + 17u], sum);
    solve_vector(at, found.a.now.xyz);
    solved[at + 3u] = found.a.now.w;
    let end = product(found.b.now, bend);
    solve_vector(at + 4u, end.xyz);
    solved[at + 7u] = end.w;
    solve_vector(at + 8u, found.sum);
}
";

fn number(value: &Value) -> f32 {
    value.as_f64().unwrap() as f32
}

fn vector(value: &Value) -> impl Iterator<Item = f32> {
    [0, 1, 2].map(|k| number(&value[k])).into_iter()
}

/// A quaternion w, x, y, z as x, y, z, w.
fn quaternion(value: &Value) -> impl Iterator<Item = f32> {
    [1, 2, 3, 0].map(|k| number(&value[k])).into_iter()
}

/// The numbers of a case and of its solution.
type Case = (Vec<f32>, Vec<f32>);
/// Reads a case.
type Reader = fn(&Value) -> Case;

fn stretch_shear(case: &Value) -> Case {
    let of = |side: &Value| -> Vec<f32> {
        let ends = vector(&side["x0"]).chain(vector(&side["x1"]));
        ends.chain(quaternion(&side["q"])).chain(vector(&side["lam"])).collect()
    };
    let mut given = of(&case["inp"]);
    given.extend(["l", "w0", "w1", "wq", "at"].map(|key| number(&case[key])));
    (given, of(&case["out"]))
}

fn bend_twist(case: &Value) -> Case {
    let (inp, out) = (&case["inp"], &case["out"]);
    let turns = |side: &Value| quaternion(&side["qa"]).chain(quaternion(&side["qb"])).collect::<Vec<_>>();
    let (mut given, mut expected) = (turns(inp), turns(out));
    given.extend(quaternion(inp.get("O0").unwrap_or(&case["O0"])).chain(vector(&inp["lam"])));
    given.extend(["wa", "wb", "at"].map(|key| number(&case[key])));
    expected.extend(vector(&out["lam"]));
    (given, expected)
}

/// Runs `entry` once a case.
fn run(gpu: &Gpu, entry: &str, given: &[f32]) -> Vec<f32> {
    let shader = forelock_gpu::shaders().find(|own| own.stage == "solve_rods").unwrap();
    let source = format!("{}const ROOM = {ROOM}u;\n{ENTRY_POINTS}", shader.source(false));
    let device = gpu.device();
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let bytes: &[u8] = bytemuck::cast_slice(given);
    let buffer = |usage| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes.len() as u64,
            usage,
            mapped_at_creation: false,
        })
    };
    let storage = wgpu::BufferUsages::STORAGE;
    let [cases, solved] =
        [wgpu::BufferUsages::COPY_DST, wgpu::BufferUsages::COPY_SRC].map(|own| buffer(storage | own));
    let staging = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    gpu.queue().write_buffer(&cases, 0, bytes);
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 90, resource: cases.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 91, resource: solved.as_entire_binding() },
        ],
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups((given.len() / ROOM) as u32, 1, 1);
    }
    encoder.copy_buffer_to_buffer(&solved, 0, &staging, 0, bytes.len() as u64);
    gpu.queue().submit([encoder.finish()]);
    staging.map_async(wgpu::MapMode::Read, .., |mapped| mapped.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    bytemuck::pod_collect_to_vec(&staging.get_mapped_range(..))
}

/// The largest difference from a file's solutions, over the largest number of each, where cases are
/// changed by `change` first.
fn worst(gpu: &Gpu, [file, entry]: [&str; 2], read: Reader, change: impl Fn(&mut [f32])) -> f32 {
    let file = load(file);
    let cases: Vec<Case> = file["cases"].as_array().unwrap().iter().map(read).collect();
    let mut given = Vec::new();
    for (k, (own, _)) in cases.iter().enumerate() {
        given.extend_from_slice(own);
        given.resize(ROOM * (k + 1), 0.0);
        change(&mut given[ROOM * k..]);
    }
    let solved = run(gpu, entry, &given);
    let error = |(found, (_, expected)): (&[f32], &Case)| {
        let largest = expected.iter().fold(1.0f32, |most, x| most.max(x.abs()));
        expected.iter().zip(found).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max) / largest
    };
    solved.chunks(ROOM).zip(&cases).map(error).fold(0.0, f32::max)
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn single_solves_agree_with_the_references() {
    let gpu = common::gpu();
    let all = [
        (["xpbd_1_stretch_shear", "one_stretch_shear"], stretch_shear as Reader),
        (["xpbd_2_bend_twist", "one_bend_twist"], bend_twist),
    ];
    for (names, read) in all {
        let error = worst(&gpu, names, read, |_| ());
        println!("{names:?} on {}: {error:.1e}", gpu.name());
        assert!(error <= 1e-5, "{names:?}: {error:e}");
        // A compliance that is off by a thousandth of a unit is seen.
        let off = worst(&gpu, names, read, |case| case[17] += 1e-3);
        assert!(off > 1e-5, "{names:?}: {off:e}");
    }
}
