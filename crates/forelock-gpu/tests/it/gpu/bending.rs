//! Collisions with bodies that bend, on a GPU against the same on the CPU.

#![expect(clippy::unwrap_used, reason = "a test fails where it cannot be set up")]

use crate::common::{
    self,
    shaken::{GRAVITY, ROUNDED_STARTS, apart, error_of_strands, rounded},
};
use forelock_core::body::character::{Performance, Playback, PosingBuffers, Skinning};
use forelock_core::body::{BendingBox, BendingField, ClosedMesh, ColliderFrame, Sdf, Shape, TriMesh, Walker};
use forelock_core::frame::{FrameInput, FrameReport, Roots, Solver};
use forelock_core::groom::{FrameBuffers, Groom, RootFrames, SurfaceRoots, bind_roots};
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation, SimulationReal};
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams, XpbdParams};
use forelock_core::strands::{Snapshot, Strands};
use forelock_gpu::{Gpu, GpuSimulation};
use glam::{Quat, Vec3};
use std::sync::Arc;

const DT: f64 = 1.0 / 60.0;
/// The largest allowed ratio of a strand's distance from float64 to the CPU's own float32 distance,
/// and the distance over the strand's length that is always allowed.
const FACTOR: f64 = 3.0;
const FLOOR: f64 = 2e-6;
const LENGTH: f64 = 0.3;
/// Particles of a strand, if nothing else is said.
const PARTICLES: usize = 20;

/// Boxes, centre and half size each, as one mesh.
fn boxes(of: &[[Vec3; 2]]) -> TriMesh {
    const FACES: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for [centre, half] in of {
        let first = positions.len() as u32;
        for corner in 0..8 {
            let sign = |bit: u32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
            positions.push(*centre + *half * Vec3::new(sign(0), sign(1), sign(2)));
        }
        for [a, b, c, d] in FACES {
            triangles.extend([[a, b, c], [a, c, d]].map(|face| face.map(|corner| first + corner)));
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

/// A column of 10 cm diameter that hangs 36 cm down from y = 2 cm.
fn column() -> TriMesh {
    const SIDES: u32 = 24;
    const RINGS: u32 = 19;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for ring in 0..RINGS {
        for side in 0..SIDES {
            let (sin, cos) = (side as f32 * std::f32::consts::TAU / SIDES as f32).sin_cos();
            positions.push(Vec3::new(0.05 * cos, 0.02 - 0.02 * ring as f32, 0.08 + 0.05 * sin));
        }
    }
    let at = |ring: u32, side: u32| ring * SIDES + side % SIDES;
    for (ring, side) in (0..RINGS - 1).flat_map(|ring| (0..SIDES).map(move |side| (ring, side))) {
        let [a, b] = [at(ring, side), at(ring, side + 1)];
        triangles.extend([[a, b, a + SIDES], [b, b + SIDES, a + SIDES]]);
    }
    for (ring, y) in [(0, 0.02), (RINGS - 1, 0.02 - 0.02 * (RINGS - 1) as f32)] {
        let centre = positions.len() as u32;
        positions.push(Vec3::new(0.0, y, 0.08));
        for side in 0..SIDES {
            let [a, b] = [at(ring, side), at(ring, side + 1)];
            triangles.push(if ring == 0 { [a, centre, b] } else { [a, b, centre] });
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

/// Strands and a body whose vertices move.
struct Scene {
    name: &'static str,
    positions: Vec<[f32; 3]>,
    offsets: Vec<u32>,
    mesh: TriMesh,
    /// Where a vertex is after so many seconds.
    at: fn(Vec3, f32) -> Vec3,
    friction: f64,
}

/// `count` strands of `particles`; where the place `at` along strand `s` is.
fn strands(count: usize, particles: usize, at: impl Fn(usize, f64) -> Vec3) -> (Vec<[f32; 3]>, Vec<u32>) {
    let place = |s: usize, i: usize| at(s, LENGTH * i as f64 / (particles - 1) as f64).to_array();
    let positions = (0..count).flat_map(|s| (0..particles).map(move |i| (s, i)));
    let positions = positions.map(|(s, i)| place(s, i)).collect();
    (positions, (0..=count).map(|s| (s * particles) as u32).collect())
}

impl Scene {
    /// Strands that lie along z on a slab whose skin slides along x at 0.3 m/s.
    fn slab(friction: f64) -> Self {
        let lying = |s: usize, at: f64| Vec3::new(0.004 * s as f32, 0.0, at as f32);
        let (positions, offsets) = strands(20, PARTICLES, lying);
        let mesh = boxes(&[[Vec3::new(0.0, -0.0953, 0.15), Vec3::new(0.4, 0.095, 0.3)]]);
        let at = |p: Vec3, secs: f32| p + Vec3::X * 0.3 * secs;
        Self { name: "slab", positions, offsets, mesh, at, friction }
    }

    /// Hanging strands, `spacing` apart in x, between two walls, each `half_gap` away, that come
    /// towards each other by 2 cm each in a quarter of a second. They part after a second.
    fn walls(half_gap: f32, spacing: f32) -> Self {
        let hanging = |s: usize, at: f64| Vec3::new(spacing * (s as f32 - 7.3), -at as f32, 0.004 * s as f32);
        let (positions, offsets) = strands(16, 30, hanging);
        let wall = |side: f32| [Vec3::new((0.04 + half_gap) * side, -0.2, 0.03), Vec3::new(0.04, 0.12, 0.15)];
        let mesh = boxes(&[wall(-1.0), wall(1.0)]);
        let at = |p: Vec3, secs: f32| {
            let share = 4.0 * secs;
            let closed = if secs < 1.0 { share.min(1.0) } else { (5.0 - share).clamp(0.0, 1.0) };
            p - Vec3::X * p.x.signum() * 0.02 * closed
        };
        Self { name: "walls", positions, offsets, mesh, at, friction: 0.3 }
    }

    /// Hanging strands beside a column that bends towards them and twists.
    fn column() -> Self {
        let hanging = |s: usize, at: f64| {
            let (sin, cos) = (0.02 * (s as f32 - 19.5)).sin_cos();
            Vec3::new(0.0515 * cos, -at as f32, 0.08 + 0.0515 * sin)
        };
        let (positions, offsets) = strands(40, PARTICLES, hanging);
        let at = |p: Vec3, secs: f32| {
            let low = (-p.y).max(0.0);
            Quat::from_rotation_y(2.0 * secs * low) * p + Vec3::X * 3.0 * secs * low * low
        };
        Self { name: "column", positions, offsets, mesh: column(), at, friction: 0.4 }
    }

    fn field(&self) -> Arc<BendingField> {
        let bounds = [Vec3::splat(-0.45), Vec3::splat(0.45)];
        let place = BendingBox { bounds, balls: Vec::new(), near: 0.004, thinness: 0.016 };
        Arc::new(BendingField::new(&self.mesh, &place).unwrap())
    }

    fn strands(&self) -> Strands<'_, f32> {
        Strands::new(&self.positions, &self.offsets)
    }

    /// The surface after `steps`.
    fn posed(&self, steps: u32) -> Vec<Vec3> {
        self.mesh.positions.iter().map(|p| (self.at)(*p, steps as f32 * DT as f32)).collect()
    }

    /// The body in the step after `steps`; if it `freezes`, as it is at the step's end.
    fn bend(&self, field: &mut Arc<BendingField>, steps: u32, freezes: bool) -> Shape {
        let own = Arc::get_mut(field).unwrap();
        if freezes {
            own.hold(&self.posed(steps + 1))
        } else {
            own.advance(&self.posed(steps + 1))
        }
        Shape::Bending(field.clone())
    }

    fn solid<'a>(&self, shape: &'a Shape) -> ColliderFrame<'a> {
        let [local, from, to] = [Pose::IDENTITY; 3];
        ColliderFrame { shape, local, from, to, friction: self.friction }
    }
}

fn frame<'a>(solids: &'a [ColliderFrame<'a>]) -> FrameInput<'a> {
    FrameInput { colliders: solids, gravity: GRAVITY, dt_secs: DT, ..FrameInput::default() }
}

fn options() -> Options {
    Options { rest_gravity: GRAVITY, ..Options::default() }
}

/// Without ties, so that hair lies on what it touches.
fn limp() -> AmsParams {
    AmsParams { k_integrity: 0.0, k_angular: 0.0, ..AmsParams::default() }
}

fn solvers<T: SimulationReal>() -> Vec<(&'static str, Solver<T>)> {
    let levels = DftlParams { level_collisions: true, ..DftlParams::default() };
    vec![
        ("ams", (&AmsParams::default()).into()),
        ("ams without ties", (&limp()).into()),
        ("mass-spring", (&MassSpringParams::default()).into()),
        ("dftl", (&DftlParams::default()).into()),
        ("dftl level by level", (&levels).into()),
        ("xpbd", (&XpbdParams { substep_secs: DT / 20.0, ..XpbdParams::default() }).into()),
    ]
}

/// Distance of `found` from `truth` over the length of a strand: see [`error_of_strands`].
fn error(offsets: &[u32], found: &Snapshot<f32>, truth: &Snapshot<f64>, steps: u32) -> f64 {
    let shift: [f64; 3] = std::array::from_fn(|c| truth.origin[c] - found.origin[c]);
    let of_particle = |p: usize| {
        let x = apart(found.positions[p], std::array::from_fn(|c| truth.positions[p][c] + shift[c]));
        let v = 0.1 * DT * apart(found.velocities[p], truth.velocities[p]);
        x.max(v) / LENGTH
    };
    error_of_strands(offsets, of_particle, steps)
}

/// Errors of the GPU, of a GPU on which the body does not move within steps, and of the float32
/// CPU. After one step the latter is the worst of several starts that differ by roundings.
fn errors(gpu: &Gpu, scene: &Scene, solver: usize, steps: u32) -> [f64; 3] {
    let strands = scene.strands();
    let exact: Vec<[f64; 3]> = strands.positions.iter().map(|x| x.map(f64::from)).collect();
    let (name, single) = solvers::<f32>().swap_remove(solver);
    let (_, double) = solvers::<f64>().swap_remove(solver);
    let new = || GpuSimulation::from_strands(gpu, &strands, &single, &options()).unwrap();
    let [mut own, mut frozen] = [new(), new()];
    let starts: Vec<Vec<[f32; 3]>> = (0..if steps == 1 { ROUNDED_STARTS } else { 0 })
        .map(|seed| rounded(strands.positions, seed))
        .chain([strands.positions.to_vec()])
        .collect();
    let mut cpus: Vec<Simulation<f32>> = starts
        .iter()
        .map(|start| {
            Simulation::from_strands(&Strands::new(start, strands.offsets), &single, &options()).unwrap()
        })
        .collect();
    let exact = Strands::new(&exact, strands.offsets);
    let mut truth = Simulation::<f64>::from_strands(&exact, &double, &options()).unwrap();
    let [mut field, mut still] = [scene.field(), scene.field()];
    for number in 0..steps {
        let shape = scene.bend(&mut field, number, false);
        let solids = [scene.solid(&shape)];
        own.step_frame(&frame(&solids)).unwrap();
        let reports: Vec<FrameReport> =
            cpus.iter_mut().map(|cpu| cpu.step_frame(&frame(&solids)).unwrap()).collect();
        let exactly = truth.step_frame(&frame(&solids)).unwrap();
        let report = own.report().unwrap();
        let expected = &reports[reports.len() - 1];
        assert_eq!(report.quarantined_strands, 0, "{name}");
        let (touching, of) = (f64::from(report.touching), f64::from(expected.touching));
        // Where a surface just touches a particle, rounding decides.
        let apart = (of - f64::from(exactly.touching)).abs();
        assert!((touching - of).abs() <= 25.0 + 0.25 * of + 2.0 * apart, "{name}: {report:?}, {expected:?}");
        let depth = f64::from(report.max_penetration_m) - expected.max_penetration_m;
        assert!(depth.abs() < 1e-3, "{name}: {report:?}, {expected:?}");
        let shape = scene.bend(&mut still, number, true);
        frozen.step_frame(&frame(&[scene.solid(&shape)])).unwrap();
    }
    let truth = truth.snapshot();
    let offsets = &own.model().offsets.clone();
    let error = |found: &Snapshot<f32>| error(offsets, found, &truth, steps);
    let of_cpu = cpus.iter().map(|cpu| error(&cpu.snapshot())).fold(0.0, f64::max);
    [error(&own.snapshot().unwrap()), error(&frozen.snapshot().unwrap()), of_cpu]
}

/// Strands meet skin that slides, squeezes and bends as nearly as on the CPU; skin that does not
/// move within a step is seen.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn skin_is_met_as_on_the_cpu() {
    let gpu = common::gpu();
    for scene in [Scene::walls(0.0061, 2.5e-4), Scene::column(), Scene::slab(0.6)] {
        for solver in 0..solvers::<f32>().len() {
            for steps in [1, 4] {
                let [own, frozen, cpu] = errors(&gpu, &scene, solver, steps);
                let name = format!("{}, {}, {steps} steps", scene.name, solvers::<f32>()[solver].0);
                println!("{name}: {own:.1e}, CPU {cpu:.1e}, frozen skin {frozen:.1e}");
                assert!(own <= FACTOR * cpu + FLOOR, "{name}: {own:e}, CPU {cpu:e}");
                let is_seen = frozen > 1e-4 && frozen > 3.0 * FACTOR * cpu;
                assert!(steps == 1 || is_seen, "{name}: skin that moves makes no difference: {frozen:e}");
            }
        }
    }
}

/// How far skin that slides at 0.3 m/s carries the tips of strands on it in 0.3 s, metres: on the
/// GPU and on the CPU.
fn carried(gpu: &Gpu, friction: f64) -> [f64; 2] {
    let scene = Scene::slab(friction);
    let mut own = GpuSimulation::from_strands(gpu, &scene.strands(), &limp(), &options()).unwrap();
    let mut cpu = Simulation::from_strands(&scene.strands(), &limp(), &options()).unwrap();
    let mut field = scene.field();
    for number in 0..18 {
        let shape = scene.bend(&mut field, number, false);
        own.step_frame(&frame(&[scene.solid(&shape)])).unwrap();
        cpu.step_frame(&frame(&[scene.solid(&shape)])).unwrap();
    }
    [own.snapshot().unwrap(), cpu.snapshot()].map(|found| {
        let tips = (PARTICLES - 1..found.positions.len()).step_by(PARTICLES);
        let moved = |p: usize| f64::from(found.positions[p][0] - scene.positions[p][0]) + found.origin[0];
        let centre = f64::from(scene.positions[0][0] - found.positions[0][0]) - found.origin[0];
        tips.map(moved).sum::<f64>() / (scene.offsets.len() - 1) as f64 + centre
    })
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn skin_that_slides_along_itself_carries_hair() {
    let gpu = common::gpu();
    let [rough, on_cpu] = carried(&gpu, 0.8);
    let [smooth, _] = carried(&gpu, 0.0);
    println!("{rough:.4} m, CPU {on_cpu:.4} m, without friction {smooth:.4} m");
    assert!(rough > 0.04 && (rough - on_cpu).abs() < 1e-3, "{rough}, CPU {on_cpu}");
    assert!(smooth.abs() < 0.1 * rough, "{smooth} beside {rough}");
}

/// Hair between walls that press 5 mm into each other is held, and comes out at bounded speed.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn hair_squeezed_between_parts_comes_out_at_bounded_speed() {
    let gpu = common::gpu();
    let scene = Scene::walls(0.015, 0.0);
    let solvers: [Solver<f32>; 3] =
        [(&AmsParams::default()).into(), (&DftlParams::default()).into(), (&XpbdParams::default()).into()];
    for solver in solvers {
        let mut own = GpuSimulation::from_strands(&gpu, &scene.strands(), &solver, &options()).unwrap();
        let mut cpu = Simulation::from_strands(&scene.strands(), &solver, &options()).unwrap();
        let mut field = scene.field();
        let mut before = [(); 2].map(|()| scene.positions.iter().map(|x| Vec3::from(*x)).collect::<Vec<_>>());
        let (mut fastest, mut deepest) = ([0.0f32; 2], [0.0f32; 2]);
        for number in 0..120 {
            let shape = scene.bend(&mut field, number, false);
            own.step_frame(&frame(&[scene.solid(&shape)])).unwrap();
            cpu.step_frame(&frame(&[scene.solid(&shape)])).unwrap();
            for (k, found) in [own.snapshot().unwrap(), cpu.snapshot()].into_iter().enumerate() {
                let origin = Vec3::from(found.origin.map(|c| c as f32));
                let after: Vec<Vec3> = found.positions.iter().map(|x| Vec3::from(*x) + origin).collect();
                assert!(after.iter().all(|x| x.is_finite()), "step {number}");
                let moved = before[k].iter().zip(&after).map(|(a, b)| a.distance(*b) / DT as f32);
                fastest[k] = moved.fold(fastest[k], f32::max);
                if number >= 90 {
                    deepest[k] = after.iter().map(|x| -field.sample_end(*x)).fold(deepest[k], f32::max);
                }
                before[k] = after;
            }
        }
        println!("{}: {fastest:?} m/s, {deepest:?} m", solver.name());
        // The walls move at 8 cm/s.
        assert!(fastest[0] < 2.0, "{}: {fastest:?} m/s", solver.name());
        assert!(deepest[0] < 1e-3, "{}: {deepest:?} m", solver.name());
    }
}

/// Hair on the walker's head: strands that leave it sidewards and hang down, on its roots.
struct OnWalker {
    performance: Performance,
    groom: Groom,
    roots: SurfaceRoots,
    posing: PosingBuffers,
}

impl OnWalker {
    fn new() -> Self {
        let walker = Walker::builtin();
        let joint = walker.skeleton().find("head").unwrap();
        let clip = walker.clips().iter().find(|clip| clip.name == "jump").unwrap();
        let playback = Playback { blend_secs: 0.0, ..Playback::default() };
        let performance =
            Performance::new(walker.clone(), clip.clone(), playback, Skinning::Linear, joint).unwrap();
        let mesh = walker.rest();
        let (_, high) = mesh.bounds();
        let on_head = mesh.positions.iter().filter(|p| p.y > high.y - 0.16).step_by(3);
        let strand = |root: &Vec3| {
            let out = Vec3::new(root.x, 0.0, root.z).normalize_or(Vec3::X);
            let at = |i: usize| 0.35 * i as f32 / (PARTICLES - 1) as f32;
            let bent = |s: f32| *root + out * 0.06 * (s / 0.06).tanh() - Vec3::Y * (s - 0.03).max(0.0);
            (0..PARTICLES).map(|i| bent(at(i))).collect::<Vec<_>>()
        };
        let groom = Groom::from_strands(on_head.map(strand)).unwrap();
        let (bindings, _) = bind_roots(&groom, mesh, &ClosedMesh::new(mesh));
        let starts: Vec<Vec3> = groom.strands().map(|strand| strand[0]).collect();
        let roots = SurfaceRoots::new(&starts, &bindings, mesh);
        Self { performance, groom, roots, posing: PosingBuffers::default() }
    }

    fn field(&self) -> Arc<BendingField> {
        let (low, high) = self.performance.character().rest().bounds();
        let bounds = [Vec3::new(-0.5, high.y - 0.7, low.z - 0.2), high + 0.2];
        let place = BendingBox { bounds, balls: Vec::new(), near: 0.004, thinness: 0.016 };
        Arc::new(BendingField::new(self.performance.character().rest(), &place).unwrap())
    }

    fn secs(number: u32) -> f64 {
        0.4 + f64::from(number) * DT
    }

    /// The head, the roots and the skin after `number` steps.
    fn at(&mut self, number: u32) -> (Pose, RootFrames, Vec<Vec3>) {
        let posed = self.performance.posed(Self::secs(number), &mut self.posing).positions.to_vec();
        let mut frames = RootFrames::default();
        self.roots.frames(&posed, &mut FrameBuffers::default(), &mut frames);
        (self.performance.carrier(Self::secs(number), &mut self.posing), frames, posed)
    }
}

/// Hair on a figure that jumps, on its roots and among its skin, as on the CPU.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn hair_on_the_walker_is_as_on_the_cpu() {
    let gpu = common::gpu();
    let mut body = OnWalker::new();
    let positions: Vec<[f32; 3]> = body.groom.strands().flatten().map(|x| x.to_array()).collect();
    let exact: Vec<[f64; 3]> = positions.iter().map(|x| x.map(f64::from)).collect();
    let offsets: Vec<u32> = (0..=body.groom.strand_count()).map(|s| (s * PARTICLES) as u32).collect();
    let steps = 8;
    for (solver, (name, single)) in solvers::<f32>().into_iter().enumerate().filter(|own| own.0 != 4) {
        let (_, double) = solvers::<f64>().swap_remove(solver);
        let mut field = body.field();
        let (head, frames, posed) = body.at(0);
        Arc::get_mut(&mut field).unwrap().hold(&posed);
        let strands = Strands::new(&positions, &offsets);
        let mut own = GpuSimulation::from_strands(&gpu, &strands, &single, &options()).unwrap();
        let mut cpu = Simulation::from_strands(&strands, &single, &options()).unwrap();
        let exact = Strands::new(&exact, &offsets);
        let mut truth = Simulation::<f64>::from_strands(&exact, &double, &options()).unwrap();
        own.rest_on(&head, &frames).unwrap();
        cpu.rest_on(&head, &frames);
        truth.rest_on(&head, &frames);
        let (mut from, mut start, mut touching) = (head, frames, [0; 2]);
        for number in 0..steps {
            let (to, end, posed) = body.at(number + 1);
            Arc::get_mut(&mut field).unwrap().advance(&posed);
            let shape = Shape::Bending(field.clone());
            let solid = ColliderFrame { shape: &shape, local: Pose::IDENTITY, from, to, friction: 0.4 };
            let roots = Roots::PerStrand { head: [from, to], frames: [&start, &end] };
            let frame = FrameInput { roots, ..frame(std::slice::from_ref(&solid)) };
            own.step_frame(&frame).unwrap();
            touching[1] += cpu.step_frame(&frame).unwrap().touching;
            truth.step_frame(&frame).unwrap();
            touching[0] += own.report().unwrap().touching;
            (from, start) = (to, end);
        }
        let truth = truth.snapshot();
        let offsets = &own.model().offsets.clone();
        let error = |found: &Snapshot<f32>| error(offsets, found, &truth, steps);
        let [found, of_cpu] = [error(&own.snapshot().unwrap()), error(&cpu.snapshot())];
        println!("{name}: {found:.1e}, CPU {of_cpu:.1e}, touching {touching:?}");
        assert!(touching[1] > 100, "{name}: nothing touches: {touching:?}");
        assert!(found <= FACTOR * of_cpu + FLOOR, "{name}: {found:e}, CPU {of_cpu:e}");
    }
}

/// Two bodies of one mesh in poses of their own beside a rigid field; a body that stands still for
/// a while; a run that resumes: the same bits, as near to the CPU as alone.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn several_bodies_and_a_restart_give_the_same_bits() {
    let gpu = common::gpu();
    let scene = Scene::column();
    let ball = boxes(&[[Vec3::new(0.0, 0.12, 0.08), Vec3::splat(0.03)]]);
    let rigid = Shape::Sdf(Arc::new(Sdf::from_mesh(&ball, 24, 0.02).unwrap()));
    let apart_by = Pose { translation: glam::DVec3::new(0.12, 0.0, 0.0), ..Pose::IDENTITY };
    let steps = 7;
    // It stands still in steps 2 and 3.
    let moment = |number: u32| if number < 2 { number } else { number.saturating_sub(2).max(2) };
    let bodies = |number: u32, fields: &mut [Arc<BendingField>; 2]| {
        let [first, second] = fields;
        Arc::get_mut(first).unwrap().set([&scene.posed(moment(number)), &scene.posed(moment(number + 1))]);
        Arc::get_mut(second).unwrap().advance(&scene.posed(2 * moment(number + 1)));
        [Shape::Bending(first.clone()), Shape::Bending(second.clone())]
    };
    let run = |broken: Option<u32>| {
        let new = || {
            let params = AmsParams::default();
            GpuSimulation::from_strands(&gpu, &scene.strands(), &params, &options()).unwrap()
        };
        let mut own = new();
        let mut cpu = Simulation::from_strands(&scene.strands(), &AmsParams::default(), &options()).unwrap();
        let first = scene.field();
        let mut fields = [Arc::new((*first).clone()), first];
        for number in 0..steps {
            if broken == Some(number) {
                let snapshot = own.snapshot().unwrap();
                own = new();
                own.restore(&snapshot).unwrap();
            }
            let shapes = bodies(number, &mut fields);
            let mut solids = [&shapes[0], &rigid, &shapes[1]].map(|shape| scene.solid(shape));
            solids[2].local = apart_by;
            own.step_frame(&frame(&solids)).unwrap();
            cpu.step_frame(&frame(&solids)).unwrap();
        }
        (own.snapshot().unwrap(), cpu.snapshot())
    };
    let (whole, cpu) = run(None);
    assert_eq!(run(Some(4)).0, whole);
    let far = |p: usize| apart(whole.positions[p], cpu.positions[p].map(f64::from)) / LENGTH;
    let median = error_of_strands(&scene.offsets, far, steps);
    println!("{median:.1e}");
    assert!(median < 1e-5, "{median:e}");
}
