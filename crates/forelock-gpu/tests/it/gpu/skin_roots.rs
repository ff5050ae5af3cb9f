//! Roots on a skin whose motions the device computes from the pose of its bones, against the
//! specification on the CPU.

#![expect(clippy::unwrap_used, reason = "a test fails where it cannot be set up")]

use crate::common::{
    self, little,
    shaken::{self, apart, options},
};
use forelock_core::body::character::{
    BlendShape, Bone, Character, CharacterParts, Joint, Performance, Playback, PosingBuffers, Skeleton, Skin,
    SkinPose, Skinning, Transform,
};
use forelock_core::body::{TriMesh, Walker};
use forelock_core::frame::{FrameInput, Roots, Solver};
use forelock_core::groom::edit::Source;
use forelock_core::groom::{FrameBuffers, Groom, RootBinding, RootFrames, SkinnedRoots, SurfaceRoots};
use forelock_core::params::ParamsError;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::{AmsParams, DftlParams, XpbdParams};
use forelock_core::strands::Teleport;
use forelock_gpu::{Gpu, GpuError, GpuSimulation, Skinner};
use glam::{DQuat, DVec3, Quat, Vec3};
use std::sync::Arc;

const DT: f64 = 1.0 / 60.0;
/// How far motions may be from those of the CPU for the same places of vertices, radians and
/// metres, on a body of human size.
const TOLERANCES: [f64; 2] = [1e-5, 1e-6];
/// The same where each has its own places: 1e-6 m over the sides of small triangles.
const OWN_PLACES: [f64; 2] = [3e-4, 2e-6];
/// Columns of the strip.
const COLUMNS: usize = 12;

/// Strands of 8 to 12 particles that leave every `step`-th triangle of the mesh at rest, and their
/// roots.
fn hair(character: &Arc<Character>, step: usize) -> (Groom, Arc<SkinnedRoots>) {
    let (groom, surface) = hair_on(character.rest(), step);
    (groom, Arc::new(SkinnedRoots::new(surface, character.clone())))
}

fn hair_on(mesh: &TriMesh, step: usize) -> (Groom, SurfaceRoots) {
    let (mut strands, mut bindings) = (Vec::new(), Vec::new());
    for (number, triangle) in (0..mesh.triangles.len()).step_by(step).enumerate() {
        let [a, b, c] = mesh.triangles[triangle].map(|v| mesh.positions[v as usize]);
        let u = 0.1 + 0.07 * (number % 10) as f32;
        let barycentric = [u, 0.6 * (1.0 - u), 0.4 * (1.0 - u)];
        let [x, y, z] = barycentric;
        let out = (b - a).cross(c - a).normalize_or(Vec3::Y);
        let root = a * x + b * y + c * z + 0.001 * out;
        let particle = |i: usize| root + 0.012 * i as f32 * out - Vec3::Y * 0.001 * (i * i) as f32;
        strands.push((0..8 + number % 5).map(particle).collect::<Vec<_>>());
        bindings.push(RootBinding { triangle: triangle as u32, barycentric, distance: 0.001 });
    }
    let roots: Vec<Vec3> = strands.iter().map(|strand| strand[0]).collect();
    let surface = SurfaceRoots::new(&roots, &bindings, mesh);
    (Groom::from_strands(strands).unwrap(), surface)
}

/// The places of the vertices of `character` in `pose` on the device.
fn places(gpu: &Gpu, character: &Character, pose: &SkinPose) -> Vec<Vec3> {
    let mut skinner = Skinner::new(gpu, character.skin(), character.shaped(pose)).unwrap();
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    skinner.encode(&mut encoder, &pose.palette, pose.skinning).unwrap();
    gpu.queue().submit([encoder.finish()]);
    skinner.read().unwrap()
}

/// A strip of squares of 1 cm along x, three wide along z, facing up. Each column follows a joint
/// of its own, in a chain along x. One shape brings column 6 onto column 7, one all to one point.
fn strip() -> Arc<Character> {
    let at = |i: u32, j: u32| i * 4 + j;
    let positions: Vec<Vec3> =
        (0..=COLUMNS).flat_map(|i| (0..4).map(move |j| Vec3::new(i as f32, 0.0, j as f32) * 0.01)).collect();
    let squares = (0..COLUMNS as u32).flat_map(|i| (0..3).map(move |j| (i, j)));
    let triangles = squares.flat_map(|(i, j)| {
        let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
        [[a, b, c], [a, c, d]]
    });
    let joint = |i: usize| {
        let translation = if i == 0 { DVec3::ZERO } else { DVec3::X * 0.01 };
        let rest = Transform { translation, ..Transform::IDENTITY };
        Joint { name: format!("joint {i}"), parent: i.checked_sub(1), rest }
    };
    let skeleton = Skeleton::new((0..=COLUMNS).map(joint).collect()).unwrap();
    let bones = skeleton.rest_globals().into_iter().enumerate();
    let bones = bones.map(|(joint, global)| Bone { joint, inverse_bind: global.inverse() }).collect();
    let skin = Skin::new(bones, (0..positions.len()).map(|v| vec![(v / 4, 1.0)]).collect()).0;
    let onto = (24..28).map(|v| (v, positions[v as usize + 4] - positions[v as usize])).collect();
    let flat = positions.iter().zip(0..).map(|(p, v)| (v, Vec3::X * 0.05 - *p)).collect();
    let shape = |name: &str, deltas| BlendShape { name: name.into(), deltas, rest_weight: 0.0 };
    let shapes = vec![shape("onto", onto), shape("flat", flat)];
    let bound = TriMesh::new(positions, triangles.collect()).unwrap();
    let parts = CharacterParts { skeleton, bound, skin, shapes, ..CharacterParts::default() };
    Arc::new(Character::new(parts).unwrap())
}

/// The strip bent by `degrees` about z over its length and turned by `turn` as a whole, with
/// `weights` of its shapes.
fn bent(own: &Character, degrees: f64, turn: DQuat, weights: [f64; 2]) -> SkinPose {
    let mut locals = own.skeleton().rest();
    locals[0].rotation = turn;
    for local in &mut locals[1..] {
        local.rotation = DQuat::from_rotation_z((degrees / COLUMNS as f64).to_radians());
    }
    let (mut globals, mut pose) = (Vec::new(), SkinPose::default());
    own.skeleton().globals(&locals, &mut globals);
    own.pose(&globals, &weights, Skinning::Linear, &mut pose);
    pose
}

fn simulation(gpu: &Gpu, groom: &Groom) -> GpuSimulation {
    GpuSimulation::new(gpu, groom, &AmsParams::default(), &Options::default()).unwrap()
}

fn frame(roots: Roots<'_>) -> FrameInput<'_> {
    FrameInput { roots, gravity: shaken::GRAVITY, dt_secs: DT, ..FrameInput::default() }
}

fn on_skin<'a>(roots: &'a Arc<SkinnedRoots>, poses: [&'a SkinPose; 2], number: u32) -> FrameInput<'a> {
    frame(Roots::OnSkin { head: heads(number), roots, poses })
}

fn heads(number: u32) -> [Pose; 2] {
    [number, number + 1].map(|number| shaken::head(f64::from(number) * DT))
}

/// The largest differences of two sets of motions: of rotations, radians, and of shifts, metres.
fn differences(found: &RootFrames, expected: &RootFrames) -> [f64; 2] {
    assert_eq!(found.len(), expected.len());
    let angle = |a: &Quat, b: &Quat| 2.0 * (a.as_dquat() * b.as_dquat().conjugate()).xyz().length();
    let turns = found.rotations.iter().zip(&expected.rotations).map(|(a, b)| angle(a, b));
    let far = |a: &Vec3, b: &Vec3| a.as_dvec3().distance(b.as_dvec3());
    let shifts = found.shifts.iter().zip(&expected.shifts).map(|(a, b)| far(a, b));
    assert!(found.rotations.iter().all(|q| q.is_finite() && (q.length() - 1.0).abs() < 1e-6));
    [turns.fold(0.0, f64::max), shifts.fold(0.0, f64::max)]
}

/// The largest differences from the CPU of the motions in a frame between two poses.
fn worst(own: &mut GpuSimulation, roots: &Arc<SkinnedRoots>, poses: [&SkinPose; 2]) -> [f64; 2] {
    own.step_frame(&on_skin(roots, poses, 0)).unwrap();
    let found = own.read_root_frames().unwrap().unwrap();
    let signs = found[0].rotations.iter().zip(&found[1].rotations);
    assert!(signs.clone().all(|(from, to)| from.dot(*to) >= 0.0), "a sign is not the nearest");
    let [start, end] = [0, 1].map(|k| differences(&found[k], &roots.frames(poses[k])));
    [start[0].max(end[0]), start[1].max(end[1])]
}

fn within([turn, shift]: [f64; 2], [most_turn, most_shift]: [f64; 2]) -> bool {
    turn <= most_turn && shift <= most_shift
}

/// Roots all over the walker as it jumps, in frames that follow each other, jump, stand still and
/// go back, with both kinds of skinning.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn motions_are_those_of_the_cpu() {
    let gpu = common::gpu();
    let walker = Walker::builtin();
    let (groom, roots) = hair(walker, 7);
    // The same roots, bound to the mesh at rest as the device has it.
    let rest = walker.rest_pose();
    let at_rest = TriMesh { positions: places(&gpu, walker, &rest), ..walker.rest().clone() };
    let (_, surface) = hair_on(&at_rest, 7);
    let joint = walker.skeleton().find("Spine1").unwrap();
    let clip = walker.clips().iter().find(|clip| clip.name == "jump").unwrap();
    for skinning in [Skinning::Linear, Skinning::DualQuaternion] {
        let playback = Playback { blend_secs: 0.0, ..Playback::default() };
        let own = Performance::new(walker.clone(), clip.clone(), playback, skinning, joint).unwrap();
        let mut buffers = PosingBuffers::default();
        let poses: Vec<SkinPose> = (0..6)
            .map(|step| {
                let mut pose = SkinPose::default();
                own.pose(0.15 * f64::from(step), &mut buffers, &mut pose);
                pose
            })
            .collect();
        let mut simulation = simulation(&gpu, &groom);
        for [from, to] in [[0, 1], [1, 2], [4, 5], [5, 5], [4, 4], [5, 4], [0, 2]] {
            let found = worst(&mut simulation, &roots, [&poses[from], &poses[to]]);
            let mut expected = RootFrames::default();
            let bent = places(&gpu, walker, &poses[to]);
            surface.frames(&bent, &mut FrameBuffers::default(), &mut expected);
            let [_, end] = simulation.read_root_frames().unwrap().unwrap();
            let same = differences(&end, &expected);
            println!(
                "{skinning:?}, {from} to {to}: {:.1e} rad, {:.1e} m; for the same places {:.1e}, {:.1e}",
                found[0], found[1], same[0], same[1]
            );
            assert!(within(found, OWN_PLACES), "{skinning:?}, {from} to {to}: {found:?}");
            assert!(within(same, TOLERANCES), "{skinning:?}, {from} to {to}: {same:?}");
        }
        // Motions of another pose are far away.
        let found = simulation.read_root_frames().unwrap().unwrap();
        let [turn, shift] = differences(&found[1], &roots.frames(&poses[5]));
        assert!(turn > 0.1 && shift > 0.01, "{turn}, {shift}");
    }
    // Skin at rest moves no root.
    let mut simulation = simulation(&gpu, &groom);
    assert_eq!(simulation.read_root_frames().unwrap(), None);
    simulation.step_frame(&on_skin(&roots, [&rest; 2], 0)).unwrap();
    let found = simulation.read_root_frames().unwrap().unwrap();
    let [turn, shift] = differences(&found[1], &RootFrames::identity(groom.strand_count()));
    assert!(turn < 1e-6 && shift < 1e-9, "{turn}, {shift}");
}

/// A strip that bends by 120° either way, one of whose columns falls onto the next, and that
/// becomes a point; in one batch and in many.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn degenerate_triangles_have_the_motions_of_their_neighbours() {
    let gpu = common::gpu();
    let own = strip();
    let (groom, roots) = hair(&own, 1);
    let turn = DQuat::from_rotation_x(0.7) * DQuat::from_rotation_y(3.0);
    let rest = own.rest_pose();
    for gpu in [gpu.clone(), little::binding_little(&gpu, 1 << 15)] {
        let mut simulation = simulation(&gpu, &groom);
        for (name, pose) in [
            ("bent", bent(&own, 120.0, DQuat::IDENTITY, [0.0; 2])),
            ("bent back", bent(&own, -120.0, turn, [0.0; 2])),
            ("column onto the next", bent(&own, 0.0, turn, [1.0, 0.0])),
            ("column onto the next, bent", bent(&own, 60.0, turn, [1.0, 0.0])),
            ("one point", bent(&own, 0.0, DQuat::IDENTITY, [0.0, 1.0])),
            ("rest", rest.clone()),
        ] {
            let found = worst(&mut simulation, &roots, [&rest, &pose]);
            println!("{name}: {:.1e} rad, {:.1e} m", found[0], found[1]);
            assert!(within(found, OWN_PLACES), "{name}: {found:?}");
        }
        let point = bent(&own, 0.0, DQuat::IDENTITY, [0.0, 1.0]);
        simulation.step_frame(&on_skin(&roots, [&point; 2], 0)).unwrap();
        let found = simulation.read_root_frames().unwrap().unwrap();
        assert!(found[1].rotations.iter().all(|turn| *turn == Quat::IDENTITY));
    }
}

/// The strip after `number` steps, as it bends and closes.
fn swaying(own: &Character, number: u32) -> SkinPose {
    let t = f64::from(number) * DT;
    bent(own, 120.0 * (9.0 * t).sin(), DQuat::from_rotation_x(2.0 * t), [0.2 * (5.0 * t).sin().abs(), 0.0])
}

fn solvers() -> [Solver<f32>; 3] {
    let rods = XpbdParams { substep_secs: DT / 20.0, ..XpbdParams::default() };
    [(&AmsParams::default()).into(), (&DftlParams::default()).into(), (&rods).into()]
}

/// Hair on the strip goes where it goes with the motions that the CPU computes; also after a jump
/// to rest on the CPU's motions, and with steps of either kind between the others. A run that is
/// broken and one in many batches have the same bits.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn hair_moves_as_with_motions_of_the_cpu() {
    let gpu = common::gpu();
    let little = little::binding_little(&gpu, 1 << 15);
    let own = strip();
    let (groom, roots) = hair(&own, 1);
    for solver in solvers() {
        let run = |gpu: &Gpu, uploads: fn(u32) -> bool, broken: Option<u32>| {
            let new = || GpuSimulation::new(gpu, &groom, &solver, &options()).unwrap();
            let mut simulation = new();
            let start = roots.frames(&swaying(&own, 0));
            simulation.rest_on(&heads(0)[0], &start).unwrap();
            for number in 0..8 {
                if broken == Some(number) {
                    let snapshot = simulation.snapshot().unwrap();
                    simulation = new();
                    simulation.restore(&snapshot).unwrap();
                }
                // In step 5 the skin jumps, and hair with it.
                let first = if number < 5 { number } else { number + 20 };
                let poses = [first, first + 1].map(|number| swaying(&own, number));
                let frames = poses.each_ref().map(|pose| roots.frames(pose));
                if number == 5 {
                    let head = heads(number)[0];
                    simulation.teleport(&head, &head, Teleport::Reset).unwrap();
                    simulation.rest_on(&head, &frames[0]).unwrap();
                }
                let [from, to] = &frames;
                let roots = if uploads(number) {
                    Roots::PerStrand { head: heads(number), frames: [from, to] }
                } else {
                    Roots::OnSkin { head: heads(number), roots: &roots, poses: [&poses[0], &poses[1]] }
                };
                simulation.step_frame(&frame(roots)).unwrap();
                assert_eq!(simulation.report().unwrap().quarantined_strands, 0);
            }
            simulation.snapshot().unwrap()
        };
        let (computed, uploaded) = (run(&gpu, |_| false, None), run(&gpu, |_| true, None));
        let some = run(&gpu, |number| number % 3 == 1, None);
        let name = solver.name();
        let far = |other: &forelock_core::strands::Snapshot<f32>| {
            let pairs = computed.positions.iter().zip(&other.positions);
            let mut far: Vec<f64> = pairs.map(|(a, b)| apart(*a, b.map(f64::from))).collect();
            far.sort_by(f64::total_cmp);
            far[far.len() * 99 / 100]
        };
        println!("{name}: {:.1e} m from uploaded motions, {:.1e} m from some", far(&uploaded), far(&some));
        assert!(far(&uploaded) < 1e-5 && far(&some) < 1e-5, "{name}: {:e}, {:e}", far(&uploaded), far(&some));
        assert_eq!(run(&gpu, |_| false, Some(3)), computed, "{name}");
        assert_eq!(run(&little, |_| false, Some(6)), computed, "{name}");
    }
}

/// An edited groom is bound anew, and the CPU takes poses as it takes motions.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn an_edited_groom_is_bound_anew() {
    let gpu = common::gpu();
    let own = strip();
    let (groom, roots) = hair(&own, 1);
    let (edited, fewer) = hair(&own, 2);
    let mut simulation = simulation(&gpu, &groom);
    let poses = [0, 1, 2].map(|number| swaying(&own, number));
    simulation.step_frame(&on_skin(&roots, [&poses[0], &poses[1]], 0)).unwrap();
    let sources: Vec<Source> =
        (0..edited.strand_count() as u32).map(|strand| Source { strand: 2 * strand, fresh: false }).collect();
    simulation.regroom(&edited, &sources, &heads(0)[1]).unwrap();
    // The roots of before the edit are refused, and nothing breaks.
    simulation.step_frame(&on_skin(&roots, [&poses[1], &poses[2]], 1)).unwrap_err();
    let found = worst(&mut simulation, &fewer, [&poses[1], &poses[2]]);
    assert!(within(found, OWN_PLACES), "{found:?}");
    // A pose of another character is refused, and the next frame is right again.
    let mut other = poses[0].clone();
    other.palette.matrices.pop();
    let before = simulation.snapshot().unwrap();
    let refused = simulation.step_frame(&on_skin(&fewer, [&poses[2], &other], 1));
    let is_count = |error: &ParamsError| matches!(error, ParamsError::Count { name: "bones of a pose", .. });
    assert!(matches!(&refused, Err(GpuError::Params(error)) if is_count(error)), "{refused:?}");
    assert_eq!(simulation.snapshot().unwrap(), before);
    let found = worst(&mut simulation, &fewer, [&poses[2], &poses[0]]);
    assert!(within(found, OWN_PLACES), "{found:?}");

    let new = || Simulation::new(&groom, &AmsParams::default(), &options()).unwrap();
    let [mut by_pose, mut by_motions] = [new(), new()];
    let refused = by_pose.step_frame(&on_skin(&roots, [&poses[2], &other], 0));
    assert!(refused.as_ref().is_err_and(is_count), "{refused:?}");
    for number in 0..2 {
        let ends = [&poses[number as usize], &poses[number as usize + 1]];
        by_pose.step_frame(&on_skin(&roots, ends, number)).unwrap();
        let [from, to] = ends.map(|pose| roots.frames(pose));
        let given = Roots::PerStrand { head: heads(number), frames: [&from, &to] };
        by_motions.step_frame(&frame(given)).unwrap();
    }
    assert_eq!(by_pose.snapshot(), by_motions.snapshot());
}
