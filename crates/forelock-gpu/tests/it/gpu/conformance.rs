//! The kernels against the same stages on the CPU, both in float32: same scene, same frames.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails where it cannot be set up, and tells how near it came"
)]

use super::strays::strays;
use crate::common::{
    self, little,
    shaken::{self, GRAVITY, ROUNDED_STARTS, apart, errors_of_strands, options, rounded},
};
use forelock_core::body::{ClosedMesh, ColliderFrame, Head, Morph, Sdf, Shape, TriMesh};
use forelock_core::frame::{Air, FrameInput, Roots};
use forelock_core::pose::Pose;
use forelock_core::simulation::Simulation;
use forelock_core::solver::ams::{AngularForm, Inextensibility, IntegrityForm, Jacobian};
use forelock_core::solver::{AmsParams, MassSpringParams};
use forelock_core::strands::{Snapshot, Strands};
use forelock_gpu::{Choice, Gpu, GpuSimulation};
use glam::{DQuat, DVec3};
use std::sync::Arc;

pub const FPS: f64 = 60.0;

/// The largest allowed ratio of the GPU's distance from float64 to the CPU's own float32 distance,
/// for a frame. Both round in their own order, the CPU fuses multiply–adds, and a driver's
/// divisions and roots may be wrong by two units in the last place.
const FACTOR: f64 = 3.0;
/// What never counts, over the strand's length: a few units in the last place of a position.
const FLOOR: f64 = 2e-6;

pub fn frame(number: u32) -> FrameInput<'static> {
    FrameInput {
        roots: Roots::Rigid([head(number), head(number + 1)]),
        gravity: GRAVITY,
        air: Air::uniform(DVec3::new(1.0, 0.0, -2.0)),
        dt_secs: 1.0 / FPS,
        ..FrameInput::default()
    }
}

/// Curls a millimetre apart, which lean.
pub fn tuft(count: u32, particles: impl Fn(u32) -> u32) -> (Vec<[f32; 3]>, Vec<u32>) {
    shaken::tuft(count, particles, [0.001, 0.01])
}

fn head(frame: u32) -> Pose {
    shaken::head(f64::from(frame) / FPS)
}

/// A solid that moves from its pose at rest by `by` metres a second, in the head's space or in the
/// world.
pub struct Solid<'a> {
    /// One a frame, of which the last stays.
    shapes: &'a [Shape],
    local: Pose,
    by: DVec3,
    on_head: bool,
    friction: f64,
}

impl<'a> Solid<'a> {
    fn new(shape: &'a Shape, at: [f64; 3], by: [f64; 3]) -> Self {
        Self::changing(std::slice::from_ref(shape), at, by)
    }

    /// The same with a shape a frame.
    fn changing(shapes: &'a [Shape], at: [f64; 3], by: [f64; 3]) -> Self {
        let turned = DQuat::from_rotation_x(0.3);
        Self { shapes, local: Pose::new(turned, at.into()), by: by.into(), on_head: true, friction: 0.4 }
    }

    pub fn frame(&self, number: u32) -> ColliderFrame<'a> {
        let carrier = |frame: u32| {
            let moved = Pose::new(DQuat::IDENTITY, self.by * f64::from(frame) / FPS);
            if self.on_head { head(frame).after(&moved) } else { moved }
        };
        let [from, to] = [number, number + 1].map(carrier);
        let shape = &self.shapes[(number as usize).min(self.shapes.len() - 1)];
        ColliderFrame { shape, local: self.local, from, to, friction: self.friction }
    }
}

/// Distance from the float64 CPU after `frames` frames, over the length of a strand: of the GPU,
/// and of the float32 CPU. `params` are the GPU's and the CPU's. After one frame it is that of the
/// worst strand; after more that of the median strand, since single strands may fall to either side
/// of a threshold (a tie breaks or holds, a curl flips).
fn errors(gpu: &Gpu, strands: &Strands<'_, f32>, params: [&AmsParams; 2], frames: u32) -> [f64; 2] {
    errors_among(&[], gpu, strands, params, frames)
}

/// The same among solids. After one frame the float32 CPU is the worst of several starts that
/// differ by roundings: a strand that begins in a solid leaves it by either side. One strand may
/// do so on the GPU only, so the error is then that of the worst strand but one.
fn errors_among(
    solids: &[Solid<'_>],
    gpu: &Gpu,
    strands: &Strands<'_, f32>,
    params: [&AmsParams; 2],
    frames: u32,
) -> [f64; 2] {
    let exact: Vec<[f64; 3]> = strands.positions.iter().map(|x| x.map(f64::from)).collect();
    let exact = Strands { stiffness: strands.stiffness, ..Strands::new(&exact, strands.offsets) };
    let mut own = GpuSimulation::from_strands(gpu, strands, params[0], &options()).unwrap();
    let mut cpu = Simulation::from_strands(strands, params[1], &options()).unwrap();
    let mut truth = Simulation::<f64>::from_strands(&exact, params[1], &options()).unwrap();
    for number in 0..frames {
        let colliders: Vec<_> = solids.iter().map(|solid| solid.frame(number)).collect();
        let frame = FrameInput { colliders: &colliders, ..frame(number) };
        own.step_frame(&frame).unwrap();
        truth.step_frame(&frame).unwrap();
        let expected = cpu.step_frame(&frame).unwrap();
        let report = own.report().unwrap();
        // Later the deepest particle may be one of a strand that fell to another side; `strays`
        // compares depths in every frame.
        let depth = f64::from(report.max_penetration_m);
        let is_as_deep = (depth - expected.max_penetration_m).abs() < 1e-4;
        assert!(number > 0 || is_as_deep, "{report:?}, {expected:?}");
        let (touching, of) = (f64::from(report.touching), f64::from(expected.touching));
        // What lies on a surface touches it or does not by a rounding, in float64 seldom.
        assert!((touching - of).abs() <= 10.0 + 0.25 * of, "{report:?}, {expected:?}");
    }
    let truth = truth.snapshot();
    let error = |found: Snapshot<f32>| {
        let shift: [f64; 3] = std::array::from_fn(|c| truth.origin[c] - found.origin[c]);
        let of_particle = |p: usize| {
            let x = apart(found.positions[p], std::array::from_fn(|c| truth.positions[p][c] + shift[c]));
            // A frame's worth of velocity.
            let v = apart(found.velocities[p], truth.velocities[p]) / FPS;
            (x.max(v) / 0.25).max((f64::from(found.integrity[p]) - truth.integrity[p]).abs())
        };
        let errors = errors_of_strands(strands.offsets, of_particle);
        let last = errors.len() - 1;
        match (frames, solids.is_empty()) {
            (1, true) => errors[last],
            (1, false) => errors[last - 1],
            _ => errors[errors.len() / 2],
        }
    };
    let found = own.snapshot().unwrap();
    assert_eq!(found.origin, truth.origin);
    let mut of_cpu = error(cpu.snapshot());
    if frames == 1 && !solids.is_empty() {
        for seed in 0..ROUNDED_STARTS {
            let starts = rounded(strands.positions, seed);
            let starts = Strands { stiffness: strands.stiffness, ..Strands::new(&starts, strands.offsets) };
            let mut cpu = Simulation::from_strands(&starts, params[1], &options()).unwrap();
            let colliders: Vec<_> = solids.iter().map(|solid| solid.frame(0)).collect();
            cpu.step_frame(&FrameInput { colliders: &colliders, ..frame(0) }).unwrap();
            of_cpu = of_cpu.max(error(cpu.snapshot()));
        }
    }
    [error(found), of_cpu]
}

/// Whether the GPU is as near as float32 should be.
fn is_close([gpu, cpu]: [f64; 2]) -> bool {
    gpu <= FACTOR * cpu + FLOOR
}

/// Counts about every threshold: lanes, workgroups, the shortest strands, strands of many lengths.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn any_count_of_strands_and_particles() {
    let gpu = common::gpu();
    let params = AmsParams::default();
    for (count, particles) in [
        (1, 30),
        (15, 30),
        (16, 30),
        (17, 30),
        (63, 12),
        (64, 12),
        (65, 12),
        (700, 25),
        (40, 2),
        (40, 3),
        (40, 4),
        (40, 200),
    ] {
        for mixed in [false, true] {
            let (positions, offsets) = tuft(count, |strand| particles + if mixed { strand % 7 } else { 0 });
            let strands = Strands::new(&positions, &offsets);
            let errors = errors(&gpu, &strands, [&params; 2], 1);
            assert!(is_close(errors), "{count} × {particles}, mixed {mixed}: {errors:?}");
        }
    }
}

/// Every form of every term.
fn forms() -> Vec<(&'static str, AmsParams)> {
    let default = AmsParams::default;
    let breaking = AmsParams {
        non_hookean: true,
        elastic_limit: 0.01,
        breaking_point: 0.05,
        breaking_width: 0.1,
        healing_secs: 0.5,
        healing_limit: 0.02,
        ..default()
    };
    vec![
        ("default", default()),
        ("no preload", AmsParams { sag_free: false, ..default() }),
        (
            "paper's ties",
            AmsParams { integrity: IntegrityForm::Paper, angular: AngularForm::Paper, ..default() },
        ),
        ("no angular tie", AmsParams { angular: AngularForm::Off, ..default() }),
        (
            "paper's jacobian",
            AmsParams { jacobian: Jacobian::Paper, k_edge: 1e4, k_bend: 1e4, k_torsion: 1e4, ..default() },
        ),
        ("no ties, one clamped", AmsParams { k_integrity: 0.0, k_angular: 0.0, clamped: 1, ..default() }),
        (
            "soft tips",
            AmsParams {
                tip_scale_springs: 0.2,
                tip_scale_integrity: 0.1,
                tip_scale_angular: 0.0,
                ..default()
            },
        ),
        ("breaking", breaking),
        ("follow the leader", AmsParams { inextensibility: Inextensibility::FollowTheLeader, ..default() }),
        (
            "stretching",
            AmsParams { inextensibility: Inextensibility::Off, substep_secs: 1.0 / (7.0 * FPS), ..default() },
        ),
        (
            "limited",
            AmsParams {
                inextensibility: Inextensibility::Limit,
                max_stretch: 1e-3,
                k_edge: 1e5,
                ..default()
            },
        ),
        ("all clamped", AmsParams { clamped: 1000, ..default() }),
        ("mass-spring", MassSpringParams { virtual_particles: false, ..MassSpringParams::default() }.ams()),
    ]
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn every_form_of_every_term() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(70, |strand| 20 + strand % 2);
    let stiffness: Vec<f32> = (0..70u8).map(|strand| 0.5 + f32::from(strand) / 70.0).collect();
    let strands = Strands { stiffness: Some(&stiffness), ..Strands::new(&positions, &offsets) };
    for (name, params) in forms() {
        let [one, many] = [1, 30].map(|frames| errors(&gpu, &strands, [&params; 2], frames));
        println!("{name} on {}: {one:?} after a frame, {many:?} after thirty (GPU, CPU)", gpu.name());
        assert!(is_close(one) && is_close(many), "{name}: {one:?}, {many:?}");
    }
}

/// Factors in 16 bits: velocities stay within a few thousandths of those in float64, and some are
/// rounded.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn half_factors_are_off_by_little() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(70, |strand| 20 + strand % 2);
    let exact: Vec<[f64; 3]> = positions.iter().map(|x| x.map(f64::from)).collect();
    let strands = Strands::new(&positions, &offsets);
    let exact = Strands::new(&exact, &offsets);
    for params in
        [AmsParams::default(), AmsParams { inextensibility: Inextensibility::Off, ..AmsParams::default() }]
    {
        let [mut whole, mut halved] = [false, true].map(|halves| {
            let mut own = GpuSimulation::from_strands(&gpu, &strands, &params, &options()).unwrap();
            own.set_half_factors(halves);
            own
        });
        let mut truth = Simulation::<f64>::from_strands(&exact, &params, &options()).unwrap();
        for number in 0..60 {
            whole.step_frame(&frame(number)).unwrap();
            halved.step_frame(&frame(number)).unwrap();
            truth.step_frame(&frame(number)).unwrap();
        }
        let truth = truth.snapshot();
        let off = |own: &mut GpuSimulation| {
            let own = own.snapshot().unwrap();
            let square =
                |a: &[f32; 3], b: &[f64; 3]| (0..3).map(|c| (f64::from(a[c]) - b[c]).powi(2)).sum::<f64>();
            let sum = own.positions.iter().zip(&truth.positions).map(|(a, b)| square(a, b)).sum::<f64>();
            (sum / own.positions.len() as f64).sqrt()
        };
        let [whole, halved] = [off(&mut whole), off(&mut halved)];
        println!("root mean square of positions after a second: {whole} m, with half factors {halved} m");
        assert!(whole < 1e-4 && halved < 2e-3 && halved > 2.0 * whole);
    }
}

/// The field of a ball.
fn ball_field(radius: f32) -> Sdf {
    // Each in a box of its own size.
    let cell = 0.002 + 0.07 * radius;
    let node = |at: u32| (at as f32 - 15.5) * cell;
    let values = (0..32u32.pow(3)).map(|at| {
        let [x, y, z] = [at % 32, at / 32 % 32, at / 1024].map(node);
        (x * x + y * y + z * z).sqrt() - radius
    });
    Sdf::new(glam::UVec3::splat(32), glam::Vec3::splat(node(0)), cell, values.collect()).unwrap()
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn every_solid() {
    every_solid_for(18);
}

#[test]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_every_solid_for_longer() {
    every_solid_for(30);
}

/// Every shape over `frames`: still on the head, flying through the hair, several at once, faster
/// than a substep can sample, and with no room between them.
fn every_solid_for(frames: u32) {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(66, |strand| 20 + strand % 3);
    let strands = Strands::new(&positions, &offsets);
    let ball = Shape::Sphere { radius: 0.05 };
    let fast = Shape::Sphere { radius: 0.03 };
    let hollow = Shape::HollowSphere { radius: 0.2 };
    let capsule = Shape::Capsule { half_length: 0.1, radius: 0.02 };
    let cuboid = Shape::Box { half_extents: DVec3::new(0.05, 0.02, 0.08) };
    let mesh = Shape::Sdf(Arc::new(Sdf::from_mesh(&Head::builtin().mesh, 48, 0.02).unwrap()));
    // Three fields, of which the second is passed after two thirds of the frames; the fourth is a
    // plain one, whose numbers come after theirs.
    let morph = Arc::new(Morph::new([0.02, 0.045, 0.06].map(ball_field).into()).unwrap());
    // Two levels of cells: 12 mm, and 3 mm near the surface.
    let near = |mesh: &TriMesh| Sdf::near(&ClosedMesh::new(mesh), 16, 0.02, 0.003).unwrap();
    let refined = near(&Head::builtin().mesh);
    assert!(refined.is_refined() && refined.near_cell() == 0.003);
    let refined = Shape::Sdf(Arc::new(refined));
    let grown = [0.95f32, 1.0].map(|size| {
        let mut mesh = Head::builtin().mesh.clone();
        mesh.positions.iter_mut().for_each(|p| *p *= size);
        near(&mesh)
    });
    let grown = Arc::new(Morph::new(grown.into()).unwrap());
    let grows: Vec<Shape> = (0..frames)
        .map(|frame| Shape::Morph {
            morph: grown.clone(),
            phases: [frame, frame + 1].map(|frame| f64::from(frame) / f64::from(frames)),
        })
        .collect();
    let phase = |frame: u32| 1.5 * f64::from(frame) / f64::from(frames);
    let swelling: Vec<Shape> = (0..frames)
        .map(|frame| Shape::Morph { morph: morph.clone(), phases: [phase(frame), phase(frame + 1)] })
        .collect();
    let still = |shape, at| Solid::new(shape, at, [0.0; 3]);
    // The head sets out along z, and what is to meet it in the world goes there too.
    let flying = Solid { on_head: false, ..Solid::new(&ball, [-0.2, -0.12, 0.01], [1.0, 0.0, 0.6]) };
    let scenes: Vec<(&str, Vec<Solid<'_>>)> = vec![
        ("a ball on the head", vec![still(&ball, [0.03, -0.12, 0.0])]),
        ("a ball that flies by", vec![flying]),
        ("a capsule", vec![Solid::new(&capsule, [-0.1, -0.15, 0.0], [0.4, 0.0, 0.0])]),
        ("a box", vec![Solid::new(&cuboid, [-0.1, -0.15, 0.0], [0.4, 0.0, 0.1])]),
        ("a plane", vec![still(&Shape::Plane, [0.0, -0.2, 0.0])]),
        ("a hollow sphere", vec![still(&hollow, [0.0, -0.1, 0.0])]),
        ("a field", vec![still(&mesh, [0.0, -0.16, 0.0])]),
        ("a refined field", vec![still(&refined, [0.0, -0.16, 0.0])]),
        ("refined fields that change", vec![Solid::changing(&grows, [0.0, -0.16, 0.0], [0.0; 3])]),
        ("a ball that swells", vec![Solid::changing(&swelling, [0.02, -0.14, 0.0], [0.0; 3])]),
        (
            "a ball that swells past a field and moves",
            vec![
                Solid::changing(&swelling, [-0.1, -0.14, 0.0], [0.2, 0.0, 0.0]),
                still(&mesh, [0.05, -0.2, 0.0]),
            ],
        ),
        (
            "two fields and a ball",
            vec![
                still(&mesh, [0.12, -0.16, 0.0]),
                Solid::new(&mesh, [-0.25, -0.2, 0.02], [0.3, 0.0, 0.0]),
                Solid::new(&ball, [-0.15, -0.12, 0.01], [0.4, 0.0, 0.0]),
            ],
        ),
        ("a ball at 30 m/s", vec![Solid::new(&fast, [-1.3, -0.12, 0.0], [30.0, 0.0, 0.0])]),
        (
            "two balls that close",
            vec![
                Solid::new(&ball, [-0.1, -0.12, 0.0], [0.2, 0.0, 0.0]),
                Solid::new(&ball, [0.15, -0.12, 0.01], [-0.2, 0.0, 0.0]),
            ],
        ),
    ];
    let params = AmsParams::default();
    let free = AmsParams { inextensibility: Inextensibility::Off, ..AmsParams::default() };
    for (name, solids) in &scenes {
        for (kind, params, later) in [("lengths", &params, frames), ("stretching", &free, 2)] {
            let [one, many] =
                [1, later].map(|frames| errors_among(solids, &gpu, &strands, [params; 2], frames));
            println!("{name}, {kind}: {one:?} after a frame, {many:?} after {later} (GPU, CPU)");
            // Hair that is hit at 30 m/s diverges: only single frames of it are compared, below.
            let is_wild = *name == "a ball at 30 m/s";
            assert!(is_close(one) && (is_wild || is_close(many)), "{name}, {kind}: {one:?}, {many:?}");
        }
    }
    // Frame by frame from the CPU's state, so that nothing adds up: every particle counts. An edge
    // in a solid can turn either way, and rounding decides for some strand in some frame.
    let most = 3 + positions.len() * frames as usize / 300;
    let limited = AmsParams {
        k_edge: 1e4,
        inextensibility: Inextensibility::Limit,
        max_stretch: 0.01,
        ..AmsParams::default()
    };
    for (name, solids) in &scenes {
        for (kind, params) in &[("lengths", &params), ("limited", &limited)] {
            let off = strays(&gpu, &strands, [solids; 2], [params; 2], frames);
            println!("{name}, {kind}: {off:?} particles off, touches, depths off");
            assert!(off[0] <= most, "{name}, {kind}: {off:?}, {most} allowed");
            assert_eq!(off[2], 0, "{name}, {kind}");
            // A solid that has passed before the end of a frame touches nothing at its end. Below
            // it is shown to collide.
            assert!(off[1] > 10 || *name == "a ball at 30 m/s", "{name}, {kind}: {off:?}");
        }
    }
    // The comparison can fail: other friction, edges that are not laid along solids, a ball too
    // fast for the samples at the ends of a substep.
    let slippery = [Solid { friction: 0.0, ..Solid::new(&cuboid, [-0.1, -0.15, 0.0], [0.4, 0.0, 0.1]) }];
    let loose = AmsParams { lay_along_solids: false, ..AmsParams::default() };
    let of = |name: &str| &*scenes.iter().find(|scene| scene.0 == name).unwrap().1;
    for (name, off) in [
        ("friction", strays(&gpu, &strands, [&slippery, of("a box")], [&params; 2], frames)),
        ("laid along", strays(&gpu, &strands, [of("a plane"); 2], [&loose, &params], frames)),
        ("swept", strays(&gpu, &strands, [&[], of("a ball at 30 m/s")], [&params; 2], frames)),
    ] {
        println!("other {name}: {off:?} particles off, touches");
        assert!(off[0] > most, "{name}: {off:?}, {most} allowed");
    }
}

/// The comparison can fail: parameters that are off are seen.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_perturbed_twin_fails() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(20, |_| 20);
    let strands = Strands::new(&positions, &offsets);
    let truth = AmsParams {
        drag: 3.0,
        tip_scale_integrity: 0.5,
        inextensibility: Inextensibility::Off,
        ..AmsParams::default()
    };
    let off = |change: fn(&mut AmsParams)| {
        let mut params = truth.clone();
        change(&mut params);
        errors(&gpu, &strands, [&params, &truth], 30)
    };
    for (name, error) in [
        ("k_bend", off(|p| p.k_bend *= 0.5)),
        ("k_integrity", off(|p| p.k_integrity *= 1.01)),
        ("k_angular", off(|p| p.k_angular *= 1.01)),
        ("drag", off(|p| p.drag *= 1.01)),
        ("tip_scale_integrity", off(|p| p.tip_scale_integrity *= 1.01)),
        ("sag_free", off(|p| p.sag_free = false)),
        ("clamped", off(|p| p.clamped += 1)),
    ] {
        assert!(!is_close(error), "{name}: {error:?}");
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn two_runs_are_the_same_bits_and_a_run_that_was_interrupted_too() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(500, |strand| 10 + strand % 5);
    let strands = Strands::new(&positions, &offsets);
    let new = || GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let run = |mut simulation: GpuSimulation, frames: std::ops::Range<u32>| {
        frames.for_each(|number| simulation.step_frame(&frame(number)).unwrap());
        simulation
    };
    let whole = run(new(), 0..40).state_hash().unwrap();
    assert_eq!(run(new(), 0..40).state_hash().unwrap(), whole);
    let half = run(new(), 0..17).snapshot().unwrap();
    let mut resumed = new();
    resumed.restore(&half).unwrap();
    assert_eq!(run(resumed, 17..40).state_hash().unwrap(), whole);
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_strand_that_is_not_finite_goes_back_to_rest_and_the_others_go_on() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(50, |_| 20);
    let strands = Strands::new(&positions, &offsets);
    let (params, options) = (AmsParams::default(), options());
    let mut own = GpuSimulation::from_strands(&gpu, &strands, &params, &options).unwrap();
    let mut cpu = Simulation::from_strands(&strands, &params, &options).unwrap();
    let mut broken = cpu.snapshot();
    broken.positions[20 * 7 + 11][1] = f32::NAN;
    broken.velocities[20 * 31 + 3][2] = f32::INFINITY;
    own.restore(&broken).unwrap();
    cpu.restore(&broken).unwrap();
    own.step_frame(&frame(0)).unwrap();
    let expected = cpu.step_frame(&frame(0)).unwrap();
    let report = own.report().unwrap();
    assert_eq!((report.quarantined_strands, expected.quarantined_strands), (2, 2));
    assert!(report.max_edge_stretch < 1e-5, "{report:?}");
    assert_eq!(own.report().unwrap().quarantined_strands, 0, "a report begins anew");
    let (own, cpu) = (own.snapshot().unwrap(), cpu.snapshot());
    for (a, b) in own.positions.iter().flatten().zip(cpu.positions.iter().flatten()) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_steady_frame_makes_nothing_and_reads_nothing_back() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(100, |_| 20);
    let strands = Strands::new(&positions, &offsets);
    // A device of its own, for counts are a device's.
    let gpu = Gpu::open(&Choice::Named(gpu.name().to_owned())).unwrap();
    let mut simulation =
        GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let mesh = Shape::Sdf(Arc::new(Sdf::from_mesh(&Head::builtin().mesh, 32, 0.02).unwrap()));
    let solid = Solid::new(&mesh, [0.0, -0.16, 0.0], [0.0; 3]);
    let step = |simulation: &mut GpuSimulation, number: u32| {
        simulation.step_frame(&FrameInput { colliders: &[solid.frame(number)], ..frame(number) }).unwrap();
    };
    step(&mut simulation, 0);
    let before = gpu.counts();
    (1..20).for_each(|number| step(&mut simulation, number));
    assert_eq!(gpu.counts(), before);
    simulation.state_hash().unwrap();
    assert!(gpu.counts().read_backs > before.read_backs, "the counter counts");
}

/// Many batches are as one: on a device that binds little at once, which someone else has opened.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn many_batches_are_as_one() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(700, |strand| 12 + strand % 5);
    let strands = Strands::new(&positions, &offsets);
    let ball = Shape::Sphere { radius: 0.05 };
    let solid = Solid::new(&ball, [0.03, -0.12, 0.0], [0.0; 3]);
    let run = |gpu: &Gpu| {
        let mut own = GpuSimulation::from_strands(gpu, &strands, &AmsParams::default(), &options()).unwrap();
        for number in 0..5 {
            own.step_frame(&FrameInput { colliders: &[solid.frame(number)], ..frame(number) }).unwrap();
        }
        (own.state_hash().unwrap(), own.bytes())
    };
    let small = little::binding_little(&gpu, 1 << 18);
    let has_subgroups = |gpu: &Gpu| gpu.device().features().contains(wgpu::Features::SUBGROUP);
    println!("subgroups: {}", has_subgroups(&gpu));
    assert!(!has_subgroups(&small), "of a device that was opened without features");
    let ((one, bytes), (many, fewer)) = (run(&gpu), run(&small));
    assert_eq!(one, many);
    assert!(fewer < bytes / 2, "scratch is that of one batch of several: {fewer} of {bytes}");
}
