//! Hair that sleeps in scenes: runs that are interrupted, seeking, undo, and live changes.

#![expect(clippy::unwrap_used, reason = "a test that cannot build its scene fails")]

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use forelock::core::air::WindParams;
use forelock::core::groom::edit::{Operation, Trim};
use forelock::core::pose::Pose;
use forelock::core::simulation::Teleport;
use forelock::player::{HistoryOptions, Player};
use forelock::scene::{ColliderSection, InteractionKind, Override};
use forelock::{Backend, Progress, RunOptions, Scene, Summary, simulate};
use glam::DVec3;

/// A live change, and its name.
type Change<'a> = (&'static str, &'a dyn Fn(&mut Player));

const STRANDS: u32 = 32;

/// Hair on a head that is held, and `keys`.
fn scene(keys: &[&str]) -> Scene {
    let text = "[groom]\nstrands = 32\nvertices_per_strand = 10\n[body]\nmotion = \"builtin:still\"\n\
                sdf_cells = 32\n[output]\npicture = false\nreport = false\n";
    let sets: Vec<Override> = keys.iter().map(|key| Override::set(key).unwrap()).collect();
    Scene::parse(text, Path::new("scene.toml"), &sets).unwrap()
}

fn player(keys: &[&str]) -> Player {
    let history = HistoryOptions { every: 8, ..HistoryOptions::default() };
    Player::builder(scene(keys)).history(history).build().unwrap()
}

/// Strands that sleep in the next frame.
fn sleeping(player: &mut Player) -> u32 {
    player.step().unwrap().solver.sleeping_strands
}

/// Frames until all strands sleep, at most 600.
fn fall_asleep(player: &mut Player) -> Option<u32> {
    (1..=600).find(|_| sleeping(player) == STRANDS)
}

/// A run that is interrupted after `until` frames, unless that is 0, and may resume.
fn run(scene: &Scene, out: &Path, resume: bool, until: u32) -> Summary {
    let (cancel, frames) = (AtomicBool::new(false), AtomicU32::new(0));
    let options = RunOptions { out: out.to_path_buf(), resume, backend: Backend::Cpu };
    let mut observer = |progress: &Progress<'_>| {
        if matches!(progress, Progress::Step) && frames.fetch_add(1, Ordering::Relaxed) + 1 == until {
            cancel.store(true, Ordering::SeqCst);
        }
    };
    simulate(scene, &options, &mut observer, &cancel).unwrap()
}

#[test]
fn a_run_that_is_interrupted_in_sleep_ends_the_same() {
    let scene = scene(&["time.frames=400"]);
    let folder = tempfile::tempdir().unwrap();
    let whole = run(&scene, folder.path(), false, 0);
    assert_eq!(whole.sleeping_strands, u64::from(STRANDS), "all sleep in the end");
    let asleep_at = fall_asleep(&mut player(&[])).unwrap();
    for until in [asleep_at / 2, asleep_at - 3, asleep_at + 5] {
        let folder = tempfile::tempdir().unwrap();
        let first = run(&scene, folder.path(), false, until);
        assert!(first.frames < 400, "interrupted");
        let second = run(&scene, folder.path(), true, 0);
        assert_eq!((second.frames, &second.state_hash), (400, &whole.state_hash), "after {until} frames");
        assert_eq!(second.sleeping_strands, whole.sleeping_strands);
    }
    let awake = run(&self::scene(&["time.frames=400", "solver.sleep_speed=0"]), folder.path(), false, 0);
    assert_eq!(awake.sleeping_strands, 0);
    assert_ne!(awake.state_hash, whole.state_hash);
}

#[test]
fn seeking_and_undo_give_sleeping_frames_bit_for_bit() {
    let mut player = player(&[]);
    let asleep_at = fall_asleep(&mut player).unwrap();
    let mut hashes = vec![player.state_hash().unwrap()];
    for _ in 0..20 {
        assert_eq!(sleeping(&mut player), STRANDS);
        hashes.push(player.state_hash().unwrap());
    }
    player.seek(asleep_at - 20).unwrap();
    player.seek(asleep_at + 10).unwrap();
    assert_eq!(player.state_hash().unwrap(), hashes[10]);
    player.set_gravity(DVec3::new(0.0, -5.0, 0.0)).unwrap();
    assert_eq!(sleeping(&mut player), 0);
    (0..9).for_each(|_| {
        player.step().unwrap();
    });
    assert_ne!(player.state_hash().unwrap(), hashes[20]);
    player.undo().unwrap();
    assert_eq!(player.state_hash().unwrap(), hashes[20]);
    assert_eq!(sleeping(&mut player), STRANDS);
}

#[test]
fn live_changes_wake_hair() {
    let mut player = player(&["groom.preset=bob"]);
    fall_asleep(&mut player).unwrap();
    let moment = player.snapshot().unwrap();
    let there = Pose { translation: DVec3::X * 0.01, ..Pose::IDENTITY };
    let changes: [Change<'_>; 9] = [
        ("gravity", &|own| own.set_gravity(DVec3::new(0.0, -9.0, 0.0)).unwrap()),
        ("wind", &|own| {
            own.set_wind(&WindParams { velocity: DVec3::X, ..WindParams::default() }).unwrap();
        }),
        ("head", &|own| own.set_head_pose(there).unwrap()),
        ("parameters", &|own| {
            let mut solver = own.solver().clone();
            solver.ams.k_integrity = 90.0;
            own.set_params(&solver).unwrap();
        }),
        ("sleep speed", &|own| {
            let mut solver = own.solver().clone();
            solver.sleep_speed = 0.0;
            own.set_params(&solver).unwrap();
        }),
        ("interaction", &|own| {
            let mut interaction = own.interaction().clone();
            interaction.kind = InteractionKind::None;
            own.set_interaction(&interaction).unwrap();
        }),
        ("collider", &|own| {
            own.add_collider(&ColliderSection { position: [9.0; 3], ..ColliderSection::default() }).unwrap();
        }),
        ("edit", &|own| own.edit(Operation::Trim(Trim { to: 0.1, ..Trim::default() })).unwrap()),
        ("teleport", &|own| own.teleport(Teleport::CarryShape).unwrap()),
    ];
    for (name, change) in changes {
        player.restore(&moment).unwrap();
        assert_eq!(sleeping(&mut player), STRANDS, "asleep before: {name}");
        change(&mut player);
        assert_eq!(sleeping(&mut player), 0, "{name}");
        let again = fall_asleep(&mut player).is_some();
        assert_eq!(again, !["wind", "sleep speed"].contains(&name), "{name}: asleep again");
    }
}

/// Scenes that move all the time are the same with and without sleep, to the bit.
#[test]
fn hair_in_motion_and_in_wind_is_the_same_with_sleep() {
    for keys in [
        ["body.motion=builtin:turn", "wind.velocity=[0,0,0]"],
        ["body.motion=builtin:still", "wind.velocity=[1,0,0]"],
    ] {
        let hash = |more: &str| {
            let mut player = player(&[keys[0], keys[1], more]);
            (0..150).for_each(|_| assert_eq!(sleeping(&mut player), 0));
            player.state_hash().unwrap()
        };
        assert_eq!(hash("solver.sleep_speed=0"), hash("solver.sleep_speed=0.001"), "{keys:?}");
    }
}
