//! Hair on bodies that bend: a file of two joints with clips, and a `.bvh` file for the same
//! joints.

#![expect(clippy::unwrap_used, reason = "a test that cannot build its scene fails")]

use std::path::{Path, PathBuf};

use base64::Engine as _;
use forelock::core::body::character::{SkinPose, Skinning};
use forelock::core::body::{ClosedMesh, Motion, TriMesh};
use forelock::core::groom::edit::{Operation, Trim};
use forelock::core::groom::{Import, bind_roots};
use forelock::core::pose::Pose;
use forelock::core::simulation::Teleport;
use forelock::player::HistoryOptions;
use forelock::scene::{BEARD_SCENE, Override};
use forelock::{Player, Scene};
use glam::{DQuat, DVec3, Vec3};
use serde_json::{Value, json};

use crate::positions;

/// Rings and columns of the ball.
const RINGS: u32 = 10;
const COLUMNS: u32 = 16;
/// Its radius, metres.
const RADIUS: f32 = 0.1;

/// The numbers of a file, and the accessors to them.
#[derive(Default)]
struct Numbers {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Numbers {
    fn add(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        self.views.push(view);
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let own = json!({ "bufferView": self.views.len() - 1, "componentType": component, "type": kind,
            "count": count });
        self.accessors.push(own);
        self.accessors.len() - 1
    }

    fn floats(&mut self, kind: &str, count: usize, numbers: &[f32]) -> usize {
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.add(5126, kind, count, &bytes)
    }
}

/// A ball about the origin whose upper half follows the joint "top", which is at the origin too,
/// and whose clips turn the whole ("turn", by 60° in a second) or bend its upper half ("nod", by
/// 50° and back in a second).
fn ball() -> Value {
    let mut numbers = Numbers::default();
    let (mut positions, mut joints, mut weights) = (Vec::new(), Vec::new(), Vec::new());
    let mut vertex = |height: f32, angle: f32| {
        let (y, r) = (RADIUS * height.sin(), RADIUS * height.cos());
        positions.extend([r * angle.sin(), y, r * angle.cos()]);
        joints.extend([0u8, 1, 0, 0]);
        let top = (0.5 + y / RADIUS).clamp(0.0, 1.0);
        weights.extend([1.0 - top, top, 0.0, 0.0]);
    };
    let pi = std::f32::consts::PI;
    vertex(-0.5 * pi, 0.0);
    for ring in 1..RINGS {
        for column in 0..COLUMNS {
            let angle = 2.0 * pi * column as f32 / COLUMNS as f32;
            vertex(pi * (ring as f32 / RINGS as f32 - 0.5), angle);
        }
    }
    vertex(0.5 * pi, 0.0);
    let count = positions.len() / 3;
    let at = |ring: u32, column: u32| 1 + (ring - 1) * COLUMNS + column % COLUMNS;
    let mut triangles = Vec::new();
    for column in 0..COLUMNS {
        triangles.extend([0, at(1, column + 1), at(1, column)]);
        for ring in 1..RINGS - 1 {
            let [a, b] = [at(ring, column), at(ring, column + 1)];
            let [c, d] = [at(ring + 1, column + 1), at(ring + 1, column)];
            triangles.extend([a, b, c, a, c, d]);
        }
        triangles.extend([at(RINGS - 1, column), at(RINGS - 1, column + 1), count as u32 - 1]);
    }
    let corners: Vec<u8> = triangles.iter().flat_map(|v| v.to_le_bytes()).collect();
    let turn = |angle: f32, axis: usize| {
        let mut q = [0.0, 0.0, 0.0, (0.5 * angle).cos()];
        q[axis] = (0.5 * angle).sin();
        q
    };
    let positions = numbers.floats("VEC3", count, &positions);
    let joints = numbers.add(5121, "VEC4", count, &joints);
    let weights = numbers.floats("VEC4", count, &weights);
    let indices = numbers.add(5125, "SCALAR", triangles.len(), &corners);
    let times = numbers.floats("SCALAR", 3, &[0.0, 0.5, 1.0]);
    let turns = [turn(0.0, 1), turn(pi / 6.0, 1), turn(pi / 3.0, 1)].concat();
    let turns = numbers.floats("VEC4", 3, &turns);
    let nods = [turn(0.0, 0), turn(50f32.to_radians(), 0), turn(0.0, 0)].concat();
    let nods = numbers.floats("VEC4", 3, &nods);
    (numbers.accessors[positions]["min"], numbers.accessors[positions]["max"]) =
        (json!(vec![-RADIUS; 3]), json!(vec![RADIUS; 3]));
    let clip = |name: &str, node: usize, output: usize| {
        json!({ "name": name, "samplers": [{ "input": times, "output": output }],
            "channels": [{ "sampler": 0, "target": { "node": node, "path": "rotation" } }] })
    };
    let data = base64::engine::general_purpose::STANDARD.encode(&numbers.bytes);
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 2] }],
        "nodes": [{ "name": "base", "children": [1] }, { "name": "top" }, { "mesh": 0, "skin": 0 }],
        "meshes": [{ "name": "Ball", "primitives": [{ "indices": indices, "attributes":
            { "POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights } }] }],
        "skins": [{ "joints": [0, 1] }],
        "animations": [clip("turn", 0, turns), clip("nod", 1, nods)],
        "accessors": numbers.accessors,
        "bufferViews": numbers.views,
        "buffers": [{ "byteLength": numbers.bytes.len(),
            "uri": format!("data:application/octet-stream;base64,{data}") }],
    })
}

/// A folder with the ball and a motion for its joints.
struct Files(tempfile::TempDir);

impl Files {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("ball.gltf"), ball().to_string()).unwrap();
        let bvh = "HIERARCHY\nROOT base\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation \
                   Yrotation Xrotation\nJOINT top\n{\nOFFSET 0 0.001 0\nCHANNELS 3 Zrotation Yrotation \
                   Xrotation\n}\n}\nMOTION\nFrames: 3\nFrame Time: 0.5\n0 0 0 0 0 0 0 0 0\n0 0 0 0 0 0 0 0 50\n\
                   0 0 0 0 0 0 0 0 0\n";
        std::fs::write(folder.path().join("nod.bvh"), bvh).unwrap();
        Self(folder)
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("scene.toml")
    }

    /// The text of a scene in which the ball has `motion`.
    fn text(motion: &str, more: &str) -> String {
        format!(
            "groom.strands = 120\ngroom.vertices_per_strand = 10\ngroom.preset = \"straight\"\n\
             groom.region_box = [[-1, 0.02, -1], [1, 1, 1]]\n{more}\n[body]\nmesh = \"ball.gltf\"\n\
             sdf_cells = 24\n{motion}"
        )
    }

    fn scene(&self, motion: &str, more: &str) -> Scene {
        Scene::parse(&Self::text(motion, more), &self.path(), &[]).unwrap()
    }

    fn player(&self, motion: &str, more: &str) -> Player {
        let history = HistoryOptions { every: 4, ..HistoryOptions::default() };
        Player::builder(self.scene(motion, more)).history(history).build().unwrap()
    }

    /// What is wrong with a scene.
    fn error(&self, motion: &str, more: &str) -> String {
        match Scene::parse(&Self::text(motion, more), &self.path(), &[]) {
            Err(error) => error.to_string(),
            Ok(scene) => Player::new(scene).map(|_| ()).unwrap_err().to_string(),
        }
    }
}

const NOD: &str = "motion = { name = \"nod\", clip = { blend_secs = 0 } }";

fn run(player: &mut Player, frames: u32) -> u64 {
    for _ in 0..frames {
        player.step().unwrap();
    }
    player.state_hash().unwrap()
}

#[test]
fn a_clip_that_turns_the_whole_is_a_rigid_motion() {
    let files = Files::new();
    let clip = "collide = false\nmotion = { name = \"turn\", clip = { blend_secs = 0, repeat = false } }";
    let still = "collide = false\nmotion = \"builtin:still\"";
    for solver in ["ams", "dftl", "mass-spring", "xpbd"] {
        let more = format!("solver.kind = \"{solver}\"\n");
        let [mut rigid, mut played] = [still, clip].map(|motion| files.player(motion, &more));
        rigid.set_motion(Motion::clone(played.assets().head_motion())).unwrap();
        let [a, b] = [&mut rigid, &mut played].map(|player| run(player, 50));
        assert_eq!(a, b, "{solver}");
        assert!(rigid.head_pose().rotation.y > 0.4);
    }
}

#[test]
fn roots_follow_the_skin_wherever_it_bends() {
    let files = Files::new();
    // The same motion as a clip and as a file; the skeletons have the same rest pose.
    for motion in [NOD, "motion = { name = \"nod.bvh\", clip = { blend_secs = 0 } }"] {
        let mut player = files.player(motion, "");
        let start = positions(&mut player);
        let mut largest = 0.0f32;
        let (groom, mesh) = (player.groom().clone(), player.assets().body_mesh().unwrap().clone());
        let (bindings, _) = bind_roots(&groom, &mesh, &ClosedMesh::new(&mesh));
        for frame in 1..=60u32 {
            player.step().unwrap();
            let secs = f64::from(frame) / 60.0;
            let angle = (if secs < 0.5 { 2.0 * secs } else { 2.0 - 2.0 * secs }) * 50f64.to_radians();
            let turn = DQuat::from_rotation_x(angle);
            let now = positions(&mut player);
            for (strand, binding) in bindings.iter().enumerate() {
                let from = groom.range(strand).start;
                let moved = |v: Vec3| {
                    let v = v.as_dvec3();
                    let top = (0.5 + v.y / f64::from(RADIUS)).clamp(0.0, 1.0);
                    v.lerp(turn * v, top)
                };
                let own = mesh.corners(binding.triangle as usize).into_iter().zip(binding.barycentric);
                let expected: DVec3 = own.map(|(corner, share)| moved(corner) * f64::from(share)).sum();
                let apart = now[from].as_dvec3().distance(expected) - f64::from(binding.distance.abs());
                assert!(apart < 1e-6, "{motion}, frame {frame}: {apart}");
                largest = largest.max(now[from].distance(start[from]));
            }
        }
        assert!(largest > 0.04, "{largest}");
    }
}

/// The mesh of the ball in a second of its clip "nod", `rate` times a second, as a program that
/// bakes writes it.
fn baked(files: &Files, rate: u32) -> String {
    let path = files.0.path().join("ball.gltf");
    let own = forelock::io::read_character(&path, &Import::default()).unwrap().character;
    let clip = own.clips().iter().find(|clip| clip.name == "nod").unwrap();
    let list = |of: &mut dyn Iterator<Item = String>| of.collect::<Vec<_>>().join(", ");
    let sample = |k: u32| {
        let (mut locals, mut globals, mut pose, mut points) =
            (own.skeleton().rest(), Vec::new(), SkinPose::default(), Vec::new());
        clip.sample(f64::from(k) / f64::from(rate), &mut locals, &mut []);
        own.skeleton().globals(&locals, &mut globals);
        own.pose(&globals, &[], Skinning::Linear, &mut pose);
        own.deform(&pose, &mut points);
        format!("{k}: [{}]", list(&mut points.iter().map(|p| format!("({}, {}, {})", p.x, p.y, p.z))))
    };
    let triangles = &own.rest().triangles;
    format!(
        "#usda 1.0\n(\n    metersPerUnit = 1\n    timeCodesPerSecond = {rate}\n)\ndef Mesh \"ball\"\n{{\n\
         int[] faceVertexCounts = [{}]\nint[] faceVertexIndices = [{}]\n\
         point3f[] points.timeSamples = {{ {} }}\n}}\n",
        list(&mut triangles.iter().map(|_| "3".to_owned())),
        list(&mut triangles.iter().flatten().map(u32::to_string)),
        list(&mut (0..=rate).map(sample)),
    )
}

/// Hair on a mesh whose points a file gives at each time moves as on the character that they were
/// made from.
#[test]
fn a_baked_mesh_carries_hair_as_its_character_does() {
    let files = Files::new();
    // Collisions and interactions depend on the joint that carries the hair: "top" of the
    // character, and the motion of the whole of the mesh.
    let alone = "interaction.kind = \"none\"\ninteraction.contacts = false\n";
    let nod = format!("collide = false\n{NOD}");
    // It is neither faded in nor repeated.
    let text = Files::text("collide = false\nmotion = \"animation\"", alone);
    let text = text.replace("ball.gltf", "ball.usda");
    let means = [30, 120].map(|rate| {
        std::fs::write(files.0.path().join("ball.usda"), baked(&files, rate)).unwrap();
        let mut played = Player::new(Scene::parse(&text, &files.path(), &[]).unwrap()).unwrap();
        let mut skinned = files.player(&nod, alone);
        assert_eq!(positions(&mut played), positions(&mut skinned));
        let mut mean = 0.0f32;
        for frame in 1..=60u32 {
            played.step().unwrap();
            skinned.step().unwrap();
            let [a, b] = [&mut played, &mut skinned].map(positions);
            let roots = (0..120).map(|strand| skinned.groom().range(strand).start);
            let apart = roots.map(|root| a[root].distance(b[root])).fold(0.0, f32::max);
            // Between two samples the skin is interpolated.
            let most = if frame * rate % 60 == 0 { 1e-5 } else { 2e-4 };
            assert!(apart < most, "{rate} a second, frame {frame}: {apart}");
            let sum: f32 = a.iter().zip(&b).map(|(a, b)| a.distance(*b)).sum();
            mean = mean.max(sum / a.len() as f32);
        }
        mean
    });
    println!("particles are {means:?} m apart in the mean");
    assert!(means[0] < 5e-5 && means[1] < 0.25 * means[0], "{means:?}");
    // A run that goes on after the end says so, one that ends with it does not.
    for (frames, expected) in [(60, 0), (240, 1)] {
        let path = files.path();
        let scene = Scene::parse(&format!("time.frames = {frames}\n{text}"), &path, &[]).unwrap();
        let player = Player::new(scene).unwrap();
        let ends = |note: &&String| note.contains("ends at 1.00 s") && note.contains("`time.frames = 60`");
        assert_eq!(player.notes().iter().filter(ends).count(), expected, "{:?}", player.notes());
    }
    // Without a motion it turns as other bodies do, and says what it could play.
    let usual = text.replace("motion = \"animation\"", "");
    let usual = Player::new(Scene::parse(&usual, &files.path(), &[]).unwrap()).unwrap();
    let notes = usual.notes().join("; ");
    assert!(notes.contains("no clip is played; `body.motion` may be `animation`"), "{notes}");
}

#[test]
fn runs_on_a_body_that_bends_repeat_bit_for_bit() {
    let files = Files::new();
    for more in ["", "time.fps = 24\n", "solver.kind = \"xpbd\"\n", "solver.kind = \"dftl\"\n"] {
        let hashes: Vec<u64> = [1, 2, 3]
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| run(&mut files.player(NOD, more), 24))
            })
            .into();
        assert!(hashes.iter().all(|&own| own == hashes[0]), "threads, {more}: {hashes:x?}");
        let mut first = files.player(NOD, more);
        run(&mut first, 10);
        let state = first.state().unwrap();
        let mut resumed = files.player(NOD, more);
        resumed.resume(10, &state).unwrap();
        assert_eq!(run(&mut resumed, 14), hashes[0], "resumed, {more}");
        run(&mut first, 14);
        first.seek(5).unwrap();
        assert_eq!(run(&mut first, 19), hashes[0], "sought, {more}");
    }
}

#[test]
fn edits_drags_and_teleports_keep_hair_on_the_body() {
    let files = Files::new();
    let on_body = |player: &mut Player, what: &str| {
        let head = player.head_pose().inverse();
        let now = positions(player);
        for strand in 0..player.groom().strand_count() {
            let root = head.transform_point(now[player.groom().range(strand).start].as_dvec3());
            // The skin shrinks where it bends.
            assert!((0.06..0.102).contains(&root.length()), "{what}: {}", root.length());
        }
        assert!(now.iter().all(|p| p.is_finite()), "{what}");
    };
    let mut player = files.player(NOD, "");
    run(&mut player, 20);
    on_body(&mut player, "played");
    let before = player.head_pose();
    player.edit(Operation::Trim(Trim { to: 0.1, ..Trim::default() })).unwrap();
    run(&mut player, 3);
    on_body(&mut player, "trimmed");
    let to = Pose::new(DQuat::IDENTITY, before.translation + DVec3::X * 0.02);
    player.set_head_pose(to).unwrap();
    run(&mut player, 5);
    on_body(&mut player, "dragged");
    player.set_head_pose(Pose::new(DQuat::from_rotation_y(1.0), DVec3::X * 3.0)).unwrap();
    for mode in [Teleport::Reset, Teleport::CarryShape, Teleport::CarryShapeAndVelocity] {
        player.teleport(mode).unwrap();
        run(&mut player, 2);
        on_body(&mut player, "teleported");
        let to = player.head_pose();
        player.set_head_pose(Pose { translation: to.translation + DVec3::Z * 2.0, ..to }).unwrap();
    }
}

#[test]
fn a_reset_puts_hair_onto_the_bent_body() {
    let files = Files::new();
    let reset = "[[teleport]]\nat_secs = 0.4\nmode = \"reset\"\n";
    let text =
        format!("{}\n{reset}", Files::text(&format!("collide = false\n{NOD}"), "gravity = [0, 0, 0]\n"));
    let mut player =
        Player::builder(Scene::parse(&text, &files.path(), &[]).unwrap()).without_history().build().unwrap();
    run(&mut player, 24);
    let now = positions(&mut player);
    let Motion::Joint(own) = &**player.assets().head_motion() else { panic!("no clip") };
    assert_eq!(own.character().skeleton().joints()[own.joint()].name, "top");
    let groom = player.groom().clone();
    for strand in 0..groom.strand_count() {
        let edges = |points: &[Vec3]| points[1].distance(points[0]);
        let range = groom.range(strand);
        // At rest, turned with the skin: no edge is bent against the root's.
        let (a, b) = (&now[range.clone()], groom.strand(strand));
        assert!((edges(a) - edges(b)).abs() < 1e-4);
        let chord = |points: &[Vec3]| points[points.len() - 1].distance(points[0]);
        assert!((chord(a) - chord(b)).abs() < 0.02 * chord(b), "{} {}", chord(a), chord(b));
    }
}

#[test]
fn what_a_body_cannot_play_is_said() {
    let files = Files::new();
    let says = |motion: &str, more: &str, expected: &str| {
        let error = files.error(motion, more);
        assert!(error.contains(expected), "{error:?} does not say {expected:?}");
    };
    says("motion = \"walk\"", "", "no clip \"walk\" in the body's file; it has: turn, nod");
    says("motion = \"nod\"\njoint = \"head\"", "", "no joint \"head\"; the body has: base, top");
    says("motion = \"none.bvh\"", "", "none.bvh: no such file");
    says("motion = \"builtin:jig\"", "", "builtin:jig");
    says(NOD, "groom.guides = 10\n", "guides do not follow a body that bends yet");
    says("motion = { clip = { speed = 2 } }", "", "is for a body that plays a clip or a .bvh file");
    says("motion = { name = \"nod\", clip = { speed = -1 } }", "", "body.motion.clip.speed");
    says(
        "motion = { name = \"nod.bvh\", clip = { joints = { topp = \"top\" } } }",
        "",
        "no joint \"topp\" in the body",
    );
    let on_head = Scene::parse("[body]\nmotion = \"nod.bvh\"\n", Path::new("scene.toml"), &[]).unwrap_err();
    assert!(on_head.to_string().contains("`body.mesh` should be a .glb or .gltf file"), "{on_head}");
}

/// Share of the particles that are free that lie deeper than 1 mm inside the skin itself, over
/// `frames`, and the deepest, metres. All numbers must be finite.
fn inside_skin(player: &mut Player, frames: u32) -> (f64, f32) {
    let (mut inside, mut all, mut deepest) = (0u32, 0u32, 0.0f32);
    for frame in 1..=frames {
        player.step().unwrap();
        if frame % 15 != 0 {
            continue;
        }
        let skin = player.assets().body_mesh_at(player.time_secs()).unwrap();
        let skin = ClosedMesh::new(&skin);
        let back = player.head_pose().inverse();
        let now = positions(player);
        let groom = player.groom();
        for strand in 0..groom.strand_count() {
            for p in &now[groom.range(strand)][2..] {
                assert!(p.is_finite(), "frame {frame}");
                let depth = skin.depth(back.transform_point(p.as_dvec3()).as_vec3());
                deepest = deepest.max(depth);
                inside += u32::from(depth > 1e-3);
                all += 1;
            }
        }
    }
    (f64::from(inside) / f64::from(all), deepest)
}

#[test]
fn hair_stays_outside_the_skin_of_a_figure_that_walks_and_jumps() {
    for motion in ["walk", "jump", "look"] {
        let text = format!(
            "groom.strands = 150\n[body]\nmesh = \"builtin:walker\"\nsdf_cells = 64\nmotion = \"{motion}\""
        );
        let scene = Scene::parse(&text, Path::new("scene.toml"), &[]).unwrap();
        let mut player = Player::builder(scene).without_history().build().unwrap();
        let (share, deepest) = inside_skin(&mut player, 90);
        eprintln!("{motion}: {:.4} % deeper than 1 mm, {:.2} mm at most", 100.0 * share, 1e3 * deepest);
        assert!(share <= 1e-3, "{motion}: {share}, {deepest}");
    }
}

/// A tenth of the beard of `forelock demo --scene beard` over 300 frames: it stays outside the
/// skin, its roots stay on the skin, those of the upper lip at rest, and nothing jumps where the
/// clip repeats.
#[test]
fn a_beard_follows_the_jaw() {
    let keys = ["groom.strands=600", "body.sdf_cells=64", "time.frames=300"];
    let keys: Vec<Override> = keys.iter().map(|key| Override::set(key).unwrap()).collect();
    let scene = Scene::parse(BEARD_SCENE, Path::new("scene.toml"), &keys).unwrap();
    let mut player = Player::builder(scene).without_history().build().unwrap();
    let mesh = player.assets().body_mesh().unwrap().clone();
    let (bindings, _) = bind_roots(player.groom(), &mesh, &ClosedMesh::new(&mesh));
    let start = positions(&mut player);
    let (mut inside, mut all, mut deepest) = (0u32, 0u32, 0.0f32);
    let (mut chin, mut lips) = (0.0f32, 0);
    // The largest change of a particle's displacement from frame to frame: within the clip of
    // 2.8 s, and where it repeats.
    let (mut before, mut last, mut within, mut seam) = (start.clone(), start.clone(), 0.0f32, 0.0f32);
    for frame in 1..=300u32 {
        player.step().unwrap();
        let now = positions(&mut player);
        let skin = player.assets().body_mesh_at(player.time_secs()).unwrap();
        let back = player.head_pose().inverse();
        for (strand, binding) in bindings.iter().enumerate() {
            let from = player.groom().range(strand).start;
            let root = back.transform_point(now[from].as_dvec3()).as_vec3();
            let corners = |mesh: &TriMesh| {
                let own = mesh.corners(binding.triangle as usize).into_iter().zip(binding.barycentric);
                own.map(|(corner, share)| corner * share).sum::<Vec3>()
            };
            let apart = root.distance(corners(&skin)) - binding.distance.abs();
            assert!(apart < 2e-6, "frame {frame}, strand {strand}: {apart} m off the skin");
            let rest = start[from];
            if rest.y > -0.068 && rest.z > 0.075 && rest.x.abs() < 0.015 {
                assert!(now[from].distance(rest) < 1e-6, "the upper lip moved in frame {frame}");
                lips += 1;
            }
            if rest.y < -0.095 && rest.z > 0.075 {
                chin = chin.max(now[from].distance(rest));
            }
        }
        let jerks = now.iter().zip(&last).zip(&before);
        let jerk = jerks.map(|((a, b), c)| (*a + *c - 2.0 * *b).length()).fold(0.0, f32::max);
        if (167..171).contains(&frame) {
            seam = seam.max(jerk);
        } else if frame > 60 {
            within = within.max(jerk);
        }
        (before, last) = (last, now);
        if frame % 15 == 0 {
            let skin = ClosedMesh::new(&skin);
            for strand in 0..bindings.len() {
                for p in &last[player.groom().range(strand)][2..] {
                    assert!(p.is_finite(), "frame {frame}");
                    let depth = skin.depth(back.transform_point(p.as_dvec3()).as_vec3());
                    (deepest, all) = (deepest.max(depth), all + 1);
                    inside += u32::from(depth > 1e-3);
                }
            }
        }
    }
    let share = f64::from(inside) / f64::from(all);
    eprintln!(
        "{:.4} % deeper than 1 mm, {:.2} mm at most; chin {chin} m; seam {seam} of {within} m",
        100.0 * share,
        1e3 * deepest
    );
    assert!(share <= 1e-3, "{share}, {deepest}");
    assert!(lips > 300 && chin > 0.01, "{lips} roots on the upper lip; the chin moved by {chin} m");
    assert!(seam > 0.0 && seam < 0.3 * within, "{seam} at the seam, {within} within the clip");
}
