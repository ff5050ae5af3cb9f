//! Each stage of a frame, and what prepares it: `cargo bench -p forelock-core`.
//!
//! The stages of a frame run fused, block by block, so each is measured as the difference between a
//! frame with it and one without it.

#![expect(clippy::expect_used, reason = "a bench fails where its input cannot be made")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use forelock_core::body::{ColliderFrame, Head, Sdf, Shape};
use forelock_core::frame::FrameInput;
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::groom::{Groom, resample};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use forelock_core::solver::ams::Inextensibility;
use glam::{DQuat, DVec3, Vec3};
use std::hint::black_box;
use std::sync::Arc;

const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

fn groom() -> Groom {
    let preset = GrowParams::preset("straight").expect("a preset by that name");
    grow_on_head(&GrowParams { strands: 1024, vertices_per_strand: 30, ..preset })
        .expect("a head that hair grows on")
}

fn head_field() -> Shape {
    Shape::Sdf(Arc::new(Sdf::from_mesh(&Head::builtin().mesh, 64, 0.02).expect("a closed head")))
}

/// Frames of a head that turns to and fro by a little.
fn bench_frame(c: &mut Criterion, name: &str, params: &AmsParams, simd: Simd, solid: Option<&Shape>) {
    let options = Options { simd, rest_gravity: GRAVITY, ..Options::default() };
    let groom = groom();
    let mut simulation = Simulation::new(&groom, params, &options).expect("parameters in range");
    let mut group = c.benchmark_group("frame");
    group.throughput(Throughput::Elements(groom.particle_count() as u64));
    let poses = [Pose::IDENTITY, Pose::new(DQuat::from_rotation_y(0.01), DVec3::ZERO)];
    let mut forth = false;
    group.bench_function(format!("{name}/{simd:?}"), |b| {
        b.iter(|| {
            forth = !forth;
            let head = if forth { poses } else { [poses[1], poses[0]] };
            let collider = solid.map(|shape| ColliderFrame {
                shape,
                local: Pose::IDENTITY,
                from: head[0],
                to: head[1],
                friction: 0.3,
            });
            let frame = FrameInput {
                roots: head.into(),
                colliders: collider.as_slice(),
                gravity: GRAVITY,
                dt_secs: 1.0 / 60.0,
                ..FrameInput::default()
            };
            black_box(simulation.step_frame(&frame).expect("a frame that can be stepped"))
        });
    });
}

fn frames(c: &mut Criterion) {
    let solve_only = AmsParams { inextensibility: Inextensibility::Off, ..AmsParams::default() };
    for simd in Simd::ALL.into_iter().filter(|s| s.is_supported()) {
        bench_frame(c, "solve_strands", &solve_only, simd, None);
    }
    bench_frame(c, "solve_strands + restore_lengths", &AmsParams::default(), Simd::Auto, None);
    let field = head_field();
    bench_frame(c, "solve_strands + resolve_solids", &solve_only, Simd::Auto, Some(&field));
    bench_frame(c, "all stages", &AmsParams::default(), Simd::Auto, Some(&field));
}

fn preparation(c: &mut Criterion) {
    let Shape::Sdf(field) = head_field() else { unreachable!("made as a field above") };
    c.bench_function("sdf/sample", |b| {
        let mut k = 0u32;
        b.iter(|| {
            k = k.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let unit = |shift: u32| (k >> shift & 0xff) as f32 / 1275.0 - 0.1;
            black_box(field.sample(Vec3::new(unit(0), unit(8), unit(16))))
        });
    });
    let groom = groom();
    c.bench_function("resample 30 → 25", |b| b.iter(|| black_box(resample(&groom, 25))));
    c.bench_function("grow 1024 × 30", |b| b.iter(self::groom));
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(std::time::Duration::from_secs(2));
    targets = frames, preparation
}
criterion_main!(benches);
