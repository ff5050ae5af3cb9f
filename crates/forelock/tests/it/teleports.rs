//! Jumps of the head: declared by the scene in all three modes, and not declared.

#![expect(clippy::unwrap_used, reason = "a test that cannot build its scene fails")]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use forelock::core::simulation::Teleport;
use forelock::scene::Override;
use forelock::{Backend, Player, RunOptions, Scene, simulate};
use glam::Vec3;

/// A head that stands still, jumps at 1 s by 14 m and a quarter turn, and stands still again; a box
/// and a ball are fixed to it.
const SCENE: &str = "
groom.strands = 60
groom.vertices_per_strand = 14
body.sdf_cells = 40
time.frames = 90
[[collider]]
shape = \"box\"
half_extents = [0.12, 0.1, 0.05]
position = [0.0, -0.02, -0.2]
on_body = true
[[collider]]
radius = 0.05
position = [0.18, 0.0, 0.0]
on_body = true
[body.motion]
[[body.motion.keyframe]]
[[body.motion.keyframe]]
time_secs = 1.0
jump = true
translation = [14.0, 0.5, -1.0]
rotation_degrees = [TURN, 0.0, 0.0]
";

/// No wind, wind that is the same everywhere, and gusts that the head keeps off.
const WINDS: [&str; 3] = [
    "",
    "[wind]\nvelocity = [1.5, 0.0, 1.0]\ngust_strength = 0.0\nshelter = 0.0\n",
    "[wind]\nvelocity = [1.5, 0.0, 1.0]\nturbulence = 0.4\nshelter = 0.5\n",
];
const SOLVERS: [&str; 2] = ["ams", "dftl"];
/// The frame whose step holds the jump.
const JUMP: u32 = 60;

fn scene(solver: &str, more: &str) -> Scene {
    let sets = [Override::set(&format!("solver.kind={solver}")).unwrap()];
    // A head that turns would feel the wind from another side.
    let turn = if more.contains("[wind]") { "0" } else { "90" };
    let text = format!("{}\n{more}", SCENE.replace("TURN", turn));
    Scene::parse(&text, Path::new("scene.toml"), &sets).unwrap()
}

fn player(solver: &str, more: &str) -> Player {
    Player::builder(scene(solver, more)).without_history().build().unwrap()
}

/// All strands in the head's space.
fn local(player: &mut Player) -> Vec<Vec3> {
    let positions = crate::positions(player);
    let head = player.head_pose().inverse();
    positions.iter().map(|p| head.transform_point(p.as_dvec3()).as_vec3()).collect()
}

/// The farthest that two sets of positions are apart, metres.
fn apart(a: &[Vec3], b: &[Vec3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
}

/// What hair does relative to the head about the jump.
struct Seen {
    /// Largest speed of a particle in the first 20 frames of all, m/s.
    start: f32,
    /// Largest speed of a particle in the 20 frames before, m/s.
    before: f32,
    /// In the 20 frames after the jump's frame; that frame counts too if the hair keeps its shape.
    after: f32,
    /// Farthest that a particle is after the jump's frame from where it was before, metres.
    changed: f32,
    /// The same from where the rest shape has it.
    from_rest: f32,
    /// Where strands are after 20 frames more.
    end: Vec<Vec3>,
}

fn watch(player: &mut Player) -> Seen {
    let fps = player.scene().time.fps as f32;
    let rest = player.assets().groom.positions().to_vec();
    let mut seen =
        Seen { start: 0.0, before: 0.0, after: 0.0, changed: 0.0, from_rest: 0.0, end: local(player) };
    while player.frame() < JUMP + 20 {
        let report = player.step().unwrap();
        let now = local(player);
        let moved = apart(&now, &seen.end);
        let is_reset = report.teleports.iter().any(|jump| jump.mode == Teleport::Reset);
        match player.frame() {
            // The way back to rest is no speed.
            _ if is_reset => {}
            frame if frame >= JUMP => seen.after = seen.after.max(moved * fps),
            frame if frame <= 20 => seen.start = seen.start.max(moved * fps),
            frame if frame >= JUMP - 20 => seen.before = seen.before.max(moved * fps),
            _ => {}
        }
        if player.frame() == JUMP {
            (seen.changed, seen.from_rest) = (moved, apart(&now, &rest));
        }
        seen.end = now;
    }
    assert_eq!(player.counters().quarantined_strands, 0);
    seen
}

/// The largest speed of a particle without a jump, from the 20 frames before on to the 40 after,
/// m/s. The head jumps to other gusts, so those before it alone do not say how fast hair may be.
fn speed_without_jump(solver: &str, wind: &str) -> f32 {
    let mut scene = scene(solver, wind);
    let text = SCENE.replace("TURN", "0").replace("translation = [14.0, 0.5, -1.0]", "");
    scene.body.motion = Scene::parse(&text, Path::new("scene.toml"), &[]).unwrap().body.motion;
    let mut player = Player::builder(scene).without_history().build().unwrap();
    let (mut speed, mut last) = (0.0_f32, local(&mut player));
    while player.frame() < JUMP + 40 {
        player.step().unwrap();
        let now = local(&mut player);
        if player.frame() >= JUMP - 20 {
            speed = speed.max(apart(&now, &last) * 60.0);
        }
        last = now;
    }
    assert_eq!(player.counters().teleports, 0);
    speed
}

fn declared(mode: &str) -> String {
    format!("[[teleport]]\nat_secs = 1.0\nmode = \"{mode}\"\n")
}

#[test]
fn declared_jumps_give_hair_no_speed() {
    for solver in SOLVERS {
        for wind in WINDS {
            // DFTL hair does not come to rest in wind: its speed varies without a jump too.
            let gusts = if wind == WINDS[0] { 0.0 } else { speed_without_jump(solver, wind) };
            for mode in ["reset", "carry-shape", "carry-shape-and-velocity"] {
                let mut player = player(solver, &format!("{}{wind}", declared(mode)));
                let seen = watch(&mut player);
                let what = format!("{solver}, {mode}, {wind:?}");
                println!("{what}: {:.3} m/s, then {:.3}, gusts {gusts:.3}", seen.before, seen.after);
                assert_eq!((player.counters().teleports, player.counters().undeclared_jumps), (1, 0));
                // Hair that is reset settles on the solids and in the wind as it did at the start.
                // Turbulence differs from place to place, and hair may be a quarter faster in it.
                let start = if wind.contains("turbulence") { 1.25 * seen.start } else { seen.start };
                let allowed = if mode == "reset" { start } else { seen.before.max(gusts) };
                assert!(seen.after <= allowed + 0.1, "{what}: {allowed} m/s, then {}", seen.after);
                if mode == "reset" {
                    // A frame of its motion at the start.
                    let most = seen.start / 60.0 + 1e-5;
                    assert!(seen.from_rest <= most, "{what}: {} m from rest", seen.from_rest);
                }
            }
        }
    }
}

/// Without wind hair has come to rest before the jump, and every particle is where it was on the
/// head.
#[test]
fn carried_hair_keeps_its_shape() {
    for solver in SOLVERS {
        for mode in ["carry-shape", "carry-shape-and-velocity"] {
            let seen = watch(&mut player(solver, &declared(mode)));
            // What it moves in a frame anyway, and the rounding of world positions 14 m away.
            let allowed = seen.before / 60.0 + 4e-6;
            println!("{solver}, {mode}: {} m, {allowed} m", seen.changed);
            assert!(seen.changed <= allowed, "{solver}, {mode}: {} m, {allowed} m", seen.changed);
        }
    }
}

/// A scene whose head only shifts, in a wind that is the same everywhere: with its velocity
/// carried, hair moves as if there were no jump.
#[test]
fn hair_that_keeps_its_velocity_does_not_feel_the_jump() {
    let moving = |jump: f64, more: &str| {
        let key = |secs: f64, x: f64, jump: bool| {
            let key = "[[body.motion.keyframe]]";
            format!("{key}\ntime_secs = {secs:?}\njump = {jump}\ntranslation = [{x:?}, 0.0, 0.0]\n")
        };
        let keys = [
            key(0.0, 0.0, false),
            key(0.95, 0.2, false),
            key(0.97, 0.2 + jump, true),
            key(1.3, 0.5 + jump, false),
        ];
        let (base, _) = SCENE.split_once("[[body.motion.keyframe]]").unwrap();
        format!("{base}{}{more}{}", keys.concat(), WINDS[1])
    };
    let run = |solver: &str, text: &str| {
        let sets = [Override::set(&format!("solver.kind={solver}")).unwrap()];
        let scene = Scene::parse(text, Path::new("scene.toml"), &sets).unwrap();
        watch(&mut Player::builder(scene).without_history().build().unwrap())
    };
    for solver in SOLVERS {
        let declared = "[[teleport]]\nat_secs = 0.97\nmode = \"carry-shape-and-velocity\"\n";
        let (jumps, stays) = (run(solver, &moving(8.0, declared)), run(solver, &moving(0.0, "")));
        let off = apart(&jumps.end, &stays.end);
        println!("{solver}: {off} m apart, {} m/s", jumps.before);
        assert!(off < 2e-4, "{solver}: {off} m");
        // Negative control: the other mode stops the hair, which is then elsewhere.
        let stopped = run(solver, &moving(8.0, &declared.replace("-and-velocity", "")));
        assert!(apart(&stopped.end, &stays.end) > 1e-3, "{solver}");
    }
}

#[test]
fn a_jump_that_nobody_declares_is_found_and_counted() {
    for solver in SOLVERS {
        for wind in WINDS {
            let mut player = player(solver, wind);
            let seen = watch(&mut player);
            let what = format!("{solver}, {wind:?}: {:.3} m/s, then {:.3}", seen.before, seen.after);
            assert!(seen.after <= seen.before + 0.1 && seen.after < 10.0, "{what}");
            let jump = player.counters().first_undeclared.unwrap();
            assert_eq!((jump.frame, jump.mode), (JUMP, Teleport::CarryShape));
            let turn = if wind.is_empty() { 90.0 } else { 0.0 };
            assert!((jump.turn_degrees - turn).abs() < 1e-6, "{jump:?}");
            assert!((jump.distance_m - 14.0).abs() < 0.3, "{jump:?}");
            let notes = player.notes().join("\n");
            assert!(notes.contains("frame 60: the head jumped by 14."), "{notes}");
        }
    }
}

/// Negative control: with the limits switched off the jump is motion, and throws the hair.
#[test]
fn without_limits_the_jump_is_motion() {
    for solver in SOLVERS {
        let mut scene = scene(solver, "");
        (scene.body.teleport_speed, scene.body.teleport_turn_degrees) = (0.0, 0.0);
        let mut player = Player::builder(scene).without_history().build().unwrap();
        while player.frame() < JUMP - 1 {
            player.step().unwrap();
        }
        let mut speed = 0.0_f32;
        for _ in 0..5 {
            let before = local(&mut player);
            player.step().unwrap();
            speed = speed.max(apart(&local(&mut player), &before) * 60.0);
        }
        assert!(speed > 10.0, "{solver}: {speed} m/s");
        assert_eq!(player.counters().teleports, 0);
    }
}

/// Solids that jump, with the head or by themselves, do not sweep hair along.
#[test]
fn solids_are_not_swept_across_a_jump() {
    let alone = "
[[collider]]
shape = \"box\"
half_extents = [0.3, 0.3, 0.02]
position = [0.0, 0.1, 1.0]
[collider.motion]
[[collider.motion.keyframe]]
[[collider.motion.keyframe]]
time_secs = 1.0
JUMP
translation = [0.0, 0.0, -2.0]
";
    for solver in SOLVERS {
        let (still, _) = SCENE.split_once("[body.motion]").unwrap();
        let run = |jump: &str| {
            let text = format!("body.motion = \"builtin:still\"\n{still}{}", alone.replace("JUMP", jump));
            let sets = [Override::set(&format!("solver.kind={solver}")).unwrap()];
            let scene = Scene::parse(&text, Path::new("scene.toml"), &sets).unwrap();
            watch(&mut Player::builder(scene).without_history().build().unwrap())
        };
        let seen = run("jump = true");
        assert!(seen.after <= seen.before + 0.1, "{solver}: {} {}", seen.before, seen.after);
        // Negative control: the same way without the jump takes the second before and sweeps the
        // hair.
        assert!(run("jump = false").before > 0.5, "{solver}");
    }
}

#[test]
fn the_summary_counts_teleports_over_a_resumed_run() {
    let out = tempfile::tempdir().unwrap();
    let run = |frames: u32, resume: bool| {
        let mut scene = scene("dftl", "");
        scene.time.frames = frames;
        scene.time.fps = 50.0;
        (scene.output.picture, scene.output.report) = (false, false);
        let options = RunOptions { out: out.path().join("a"), resume, backend: Backend::Cpu };
        simulate(&scene, &options, &mut |_| {}, &AtomicBool::new(false)).unwrap()
    };
    assert_eq!(run(40, false).teleports, 0);
    let first = run(54, true);
    assert_eq!(first.teleports, 1);
    assert!(first.notes.iter().any(|note| note.contains("jumped by 14.")), "{:?}", first.notes);
    let resumed = run(60, true);
    let whole = run(60, false);
    assert_eq!((resumed.teleports, &resumed.state_hash), (1, &whole.state_hash));
    assert_eq!(resumed.notes, whole.notes);
}
