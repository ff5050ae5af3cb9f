//! A player: seeking, live changes, undo, snapshots and resuming, bit for bit.

#![expect(clippy::unwrap_used, reason = "a test that cannot build its scene fails")]

use std::path::Path;
use std::sync::Arc;

use forelock::core::body::Motion;
use forelock::core::groom::edit::{Ball, Density, Edit, Operation, Selection, Trim};
use forelock::core::pose::Pose;
use forelock::core::simulation::Teleport;
use forelock::core::solver::DftlParams;
use forelock::player::{ColliderId, HistoryOptions, Player, PlayerError};
use forelock::scene::{ColliderSection, InteractionKind, Override, SolverKind};
use forelock::{Assets, Scene};
use glam::{DQuat, DVec3, EulerRot, Vec3};

use crate::positions;

const TEXT: &str = "[groom]\nstrands = 40\nvertices_per_strand = 12\n[body]\nmotion = \"builtin:shake\"\n\
                    sdf_cells = 32\n[wind]\nvelocity = [1.0, 0.0, 0.5]\nturbulence = 0.3\n";

fn scene(keys: &[&str]) -> Scene {
    let sets: Vec<Override> = keys.iter().map(|key| Override::set(key).unwrap()).collect();
    Scene::parse(TEXT, Path::new("scene.toml"), &sets).unwrap()
}

fn player(keys: &[&str]) -> Player {
    let history = HistoryOptions { every: 4, ..HistoryOptions::default() };
    Player::builder(scene(keys)).history(history).build().unwrap()
}

fn run(player: &mut Player, frames: u32) {
    for _ in 0..frames {
        player.step().unwrap();
    }
}

/// Everything that a frame shows, as bits.
fn shown(player: &mut Player) -> (u64, Vec<[u32; 3]>, Pose) {
    let bits = positions(player).iter().map(|p| p.to_array().map(f32::to_bits)).collect();
    (player.state_hash().unwrap(), bits, player.head_pose())
}

/// Every kind of solver and interaction.
const CASES: [&[&str]; 6] = [
    &["interaction.kind=none", "interaction.contacts=false"],
    &["interaction.kind=grid", "interaction.contacts=true"],
    &["solver.kind=dftl", "interaction.kind=sph"],
    &["solver.kind=dftl", "time.fps=24"],
    &["solver.kind=mass-spring"],
    &["groom.guides=12"],
];

#[test]
fn seeking_gives_every_frame_bit_for_bit() {
    for keys in CASES {
        let mut player = player(keys);
        let mut frames = vec![shown(&mut player)];
        for _ in 0..14 {
            run(&mut player, 1);
            frames.push(shown(&mut player));
        }
        for frame in [13u32, 3, 3, 0, 9, 8, 14, 5] {
            player.seek(frame).unwrap();
            assert_eq!(player.frame(), frame);
            assert!(shown(&mut player) == frames[frame as usize], "frame {frame} of {keys:?}");
        }
        assert!(matches!(player.seek(15), Err(PlayerError::NotRun { frame: 15, reached: 14 })));
    }
}

#[test]
fn seeking_across_edits_of_the_scene_repeats_them() {
    let edit = "[[edit]]\nop = \"trim\"\nto = 0.1\nat_secs = 0.1\n";
    for solver in ["ams", "dftl"] {
        let set = Override::set(&format!("solver.kind={solver}")).unwrap();
        let scene = Scene::parse(&format!("{TEXT}{edit}"), Path::new("scene.toml"), &[set]).unwrap();
        let history = HistoryOptions { every: 4, ..HistoryOptions::default() };
        let mut player = Player::builder(scene).history(history).build().unwrap();
        let mut frames = vec![shown(&mut player)];
        for _ in 0..11 {
            run(&mut player, 1);
            frames.push(shown(&mut player));
        }
        assert_eq!(player.edited_groom().strand_count(), player.groom().strand_count());
        assert_ne!(player.edited_groom().particle_count(), player.groom().particle_count());
        for frame in [3u32, 10, 7, 2, 6, 11] {
            player.seek(frame).unwrap();
            assert!(shown(&mut player) == frames[frame as usize], "frame {frame} with {solver}");
        }
        assert_eq!(player.notes().iter().filter(|note| note.contains("trim")).count(), 1);
    }
}

#[test]
fn little_memory_keeps_the_first_state_and_still_seeks() {
    let history = HistoryOptions { every: 1, budget_bytes: 0 };
    let mut player = Player::builder(scene(&[])).history(history).build().unwrap();
    let one = player.history_bytes();
    run(&mut player, 9);
    let last = player.state_hash().unwrap();
    assert_eq!(player.history_bytes(), one, "one state only");
    player.seek(1).unwrap();
    player.seek(9).unwrap();
    assert_eq!(player.state_hash().unwrap(), last);
    let mut forgetful = Player::builder(scene(&[])).without_history().build().unwrap();
    run(&mut forgetful, 9);
    assert_eq!(forgetful.state_hash().unwrap(), last);
    assert!(matches!(forgetful.seek(1), Err(PlayerError::NotKept(1))));
}

/// Changes of every kind over 24 frames.
fn perform(player: &mut Player) {
    run(player, 2);
    let mut solver = player.solver().clone();
    solver.ams.drag *= 3.0;
    player.set_params(&solver).unwrap();
    run(player, 2);
    player.edit(Operation::Trim(Trim { to: 0.12, ..Trim::default() })).unwrap();
    run(player, 3);
    let ball =
        ColliderSection { radius: Some(0.05), position: [0.2, 0.1, 0.0], ..ColliderSection::default() };
    let ball = player.add_collider(&ball).unwrap();
    player.set_gravity(DVec3::new(0.0, -5.0, 2.0)).unwrap();
    for step in 0..4 {
        let x = 0.2 - 0.02 * f64::from(step);
        player.set_collider_pose(ball, Pose::new(DQuat::IDENTITY, DVec3::new(x, 0.1, 0.0))).unwrap();
        run(player, 1);
    }
    let mut interaction = player.interaction().clone();
    interaction.kind = InteractionKind::None;
    player.set_interaction(&interaction).unwrap();
    let mut wind = player.scene().wind.clone();
    wind.velocity = DVec3::Z * 3.0;
    player.set_wind(&wind).unwrap();
    run(player, 3);
    player.set_head_pose(Pose::new(DQuat::from_rotation_y(0.1), DVec3::X * 0.01)).unwrap();
    run(player, 2);
    player.remove_collider(ball).unwrap();
    player.set_head_pose(Pose::new(DQuat::IDENTITY, DVec3::X * 3.0)).unwrap();
    player.teleport(Teleport::CarryShapeAndVelocity).unwrap();
    run(player, 1);
    // The scene's motion starts from the origin: a jump back that nobody declares.
    player.set_motion(Motion::by_name("nod").unwrap()).unwrap();
    run(player, 2);
    let mut solver = player.solver().clone();
    solver.kind = SolverKind::Dftl;
    player.set_params(&solver).unwrap();
    run(player, 5);
}

#[test]
fn live_changes_are_repeated_bit_for_bit() {
    let mut first = player(&[]);
    perform(&mut first);
    let end = shown(&mut first);
    assert_eq!((first.counters().teleports, first.counters().undeclared_jumps), (2, 1));
    assert!(first.notes().iter().any(|note| note.contains("jumped by") && note.contains("teleport")));
    // Without history the same calls give the same bits.
    let mut forward = Player::builder(scene(&[])).without_history().build().unwrap();
    perform(&mut forward);
    assert!(shown(&mut forward) == end);
    let counters = *first.counters();
    for frame in [3, 10, 0, 17, 6, 21] {
        first.seek(frame).unwrap();
        let there = shown(&mut first);
        first.seek(24).unwrap();
        assert!(shown(&mut first) == end, "from frame {frame}");
        assert_eq!(first.counters(), &counters);
        first.seek(frame).unwrap();
        assert!(shown(&mut first) == there);
    }
}

#[test]
fn undo_is_as_if_a_change_had_never_been_made() {
    let run_with = |wind: bool, trim: bool| {
        let mut player = player(&[]);
        run(&mut player, 5);
        if wind {
            player.set_gravity(DVec3::X * 4.0).unwrap();
        }
        run(&mut player, 2);
        player.set_head_pose(Pose::new(DQuat::from_rotation_y(0.05), DVec3::ZERO)).unwrap();
        if trim {
            player.edit(Operation::Trim(Trim { to: 0.1, ..Trim::default() })).unwrap();
        }
        run(&mut player, 3);
        player
    };
    let hashes =
        [[false, false], [true, false], [true, true]].map(|[a, b]| run_with(a, b).state_hash().unwrap());
    let mut player = run_with(true, true);
    let mut expect = |name: Option<&str>, undo: bool, hash: u64| {
        let done = if undo { player.undo() } else { player.redo() };
        assert_eq!((done.unwrap(), player.state_hash().unwrap(), player.frame()), (name, hash, 10));
    };
    expect(Some("trim"), true, hashes[1]);
    expect(Some("gravity"), true, hashes[0]);
    expect(None, true, hashes[0]);
    expect(Some("gravity"), false, hashes[1]);
    expect(Some("trim"), false, hashes[2]);
    expect(None, false, hashes[2]);
    expect(Some("trim"), true, hashes[1]);
    assert_eq!(player.undo().unwrap(), Some("gravity"));
    // A new change forgets what was undone; in the past it keeps what comes after.
    player.seek(2).unwrap();
    player.set_gravity(DVec3::ZERO).unwrap();
    assert_eq!((player.redo().unwrap(), player.reached()), (None, 2));
    assert!(matches!(player.seek(9), Err(PlayerError::NotRun { .. })));
    run(&mut player, 8);
    assert!((player.head_pose().rotation.y - 0.025).abs() < 1e-3, "the later drag is repeated");
}

#[test]
fn snapshots_bring_a_moment_back_with_its_changes() {
    let mut player = player(&[]);
    run(&mut player, 6);
    player.set_gravity(DVec3::Z).unwrap();
    run(&mut player, 3);
    let kept = player.snapshot().unwrap();
    let there = shown(&mut player);
    run(&mut player, 2);
    let later = player.state_hash().unwrap();
    player.edit(Operation::Trim(Trim { to: 0.1, ..Trim::default() })).unwrap();
    run(&mut player, 2);
    player.restore(&kept).unwrap();
    assert_eq!((player.frame(), kept.frame()), (9, 9));
    assert!(shown(&mut player) == there);
    run(&mut player, 2);
    assert_eq!(player.state_hash().unwrap(), later, "without the trim");
    player.seek(7).unwrap();
    player.seek(11).unwrap();
    assert_eq!(player.state_hash().unwrap(), later);
    // The change before the snapshot can still be undone.
    assert_eq!(player.undo().unwrap(), Some("gravity"));
    assert_ne!(player.state_hash().unwrap(), later);
    // Another player of the scene takes it too, and begins there.
    let mut other = self::player(&[]);
    other.restore(&kept).unwrap();
    run(&mut other, 2);
    assert_eq!(other.state_hash().unwrap(), later);
    assert!(matches!(other.undo(), Err(PlayerError::NotKept(6))));
    assert_eq!(other.state_hash().unwrap(), later, "nothing has changed");
}

#[test]
fn a_state_resumes_in_another_player() {
    for keys in [&["solver.kind=dftl", "time.fps=50"][..], &["interaction.kind=grid"]] {
        let assets = Arc::new(Assets::load(&scene(keys), &mut |_| {}).unwrap());
        let build = || Player::builder(scene(keys)).assets(assets.clone()).build().unwrap();
        let mut first = build();
        run(&mut first, 7);
        let state = first.state().unwrap();
        run(&mut first, 4);
        let mut second = build();
        second.resume(7, &state).unwrap();
        run(&mut second, 4);
        assert!(shown(&mut second) == shown(&mut first), "{keys:?}");
        assert!(matches!(second.seek(6), Err(PlayerError::NotKept(6))));
        second.seek(8).unwrap();
    }
}

#[test]
fn an_edit_that_adds_strands_changes_the_layout_and_comes_back() {
    let mut player = player(&[]);
    run(&mut player, 3);
    let strands = player.groom().strand_count();
    player.edit(Operation::Density(Density { factor: 2.0, ..Density::default() })).unwrap();
    run(&mut player, 2);
    let (_, positions, _) = shown(&mut player);
    assert_eq!(player.groom().strand_count(), 2 * strands);
    assert_eq!(positions.len(), player.groom().particle_count());
    player.seek(2).unwrap();
    assert_eq!(player.groom().strand_count(), strands);
    player.seek(5).unwrap();
    assert!(shown(&mut player).1 == positions);
}

#[test]
fn wrong_changes_are_refused_and_change_nothing() {
    let mut player = player(&[]);
    run(&mut player, 2);
    let hash = player.state_hash().unwrap();
    let mut solver = player.solver().clone();
    solver.ams.k_edge = -1.0;
    assert!(player.set_params(&solver).is_err());
    assert!(player.set_gravity(DVec3::NAN).is_err());
    assert!(player.set_head_pose(Pose::new(DQuat::IDENTITY, DVec3::INFINITY)).is_err());
    let pose = Pose::IDENTITY;
    assert!(matches!(player.set_collider_pose(ColliderId(9), pose), Err(PlayerError::NoCollider(_))));
    assert!(matches!(player.remove_collider(ColliderId(9)), Err(PlayerError::NoCollider(_))));
    assert!(player.edit(Operation::Trim(Trim { to: -1.0, ..Trim::default() })).is_err());
    assert_eq!((player.state_hash().unwrap(), player.undo().unwrap()), (hash, None));
    let mut virtual_chain = self::player(&["solver.kind=mass-spring"]);
    let mut solver = virtual_chain.solver().clone();
    solver.mass_spring.virtual_particles = false;
    assert!(matches!(virtual_chain.set_params(&solver), Err(PlayerError::Fixed(_))));
    let mut guided = self::player(&["groom.guides=12"]);
    assert!(matches!(guided.edit(Operation::Trim(Trim::default())), Err(PlayerError::EditedGuides)));
}

#[test]
fn the_body_can_be_taken_away() {
    let mut player = player(&["body.motion=builtin:still"]);
    assert_eq!(player.colliders().map(|collider| collider.id).collect::<Vec<_>>(), [ColliderId::BODY]);
    player.remove_collider(ColliderId::BODY).unwrap();
    run(&mut player, 3);
    assert_eq!(player.colliders().count(), 0);
    assert_eq!(player.undo().unwrap(), Some("remove collider"));
    assert_eq!(player.colliders().count(), 1);
}

#[test]
fn a_registered_solver_runs_with_its_table() {
    let text = format!("{TEXT}[solver]\nkind = \"chain\"\n[solver.chain]\ndamping = 0.7\n");
    let scene = Scene::parse_with(&text, Path::new("scene.toml"), &[], &["chain"]).unwrap();
    let build = |scene: Scene| {
        let player = Player::builder(scene).solver("chain", |table| {
            let damping =
                table.get("damping").and_then(|value| value.as_float()).ok_or("damping is missing")?;
            Ok((&DftlParams { damping, ..DftlParams::default() }).into())
        });
        player.build()
    };
    let mut chain = build(scene.clone()).unwrap();
    run(&mut chain, 5);
    let mut same = player(&["solver.kind=dftl", "solver.dftl.damping=0.7"]);
    run(&mut same, 5);
    assert_eq!(chain.state_hash().unwrap(), same.state_hash().unwrap());
    // Its table can change live, and come back.
    let mut solver = chain.solver().clone();
    solver.custom.insert("damping".to_owned(), 0.9.into());
    chain.set_params(&solver).unwrap();
    run(&mut chain, 1);
    run(&mut same, 1);
    assert_ne!(chain.state_hash().unwrap(), same.state_hash().unwrap());
    assert_eq!(chain.undo().unwrap(), Some("solver"));
    assert_eq!(chain.state_hash().unwrap(), same.state_hash().unwrap());
    let mut wrong = scene.clone();
    wrong.solver.custom.clear();
    let error = build(wrong).unwrap_err().to_string();
    assert!(error.contains("solver.chain") && error.contains("damping is missing"), "{error}");
    let error = Player::new(scene).unwrap_err().to_string();
    assert!(error.contains("\"chain\" is not registered"), "{error}");
}

/// Positions after a second at a rate of frames.
fn after_a_second(fps: u32, keys: &[&str]) -> Vec<Vec3> {
    let text = "[groom]\nstrands = 60\n[wind]\nvelocity = [0.5, 0.0, 1.0]\n[solver]\nkind = \"dftl\"\n\
                [interaction]\nkind = \"sph\"\n[body]\nmotion = \"builtin:shake\"\nsdf_cells = 32\n";
    let rate = format!("time.fps={fps}");
    let keys = keys.iter().copied().chain([rate.as_str()]);
    let sets: Vec<_> = keys.map(|key| Override::set(key).unwrap()).collect();
    let scene = Scene::parse(text, Path::new("scene.toml"), &sets).unwrap();
    let mut player = Player::builder(scene).without_history().build().unwrap();
    let mut positions = Vec::new();
    for frame in 0..fps {
        player.step().unwrap();
        player.positions(&mut positions).unwrap();
        // Between steps too roots are where the head carries them.
        let rest = player.assets().groom.positions()[0];
        let root = player.head_pose().transform_point(rest.as_dvec3()).as_vec3();
        assert!(positions[0].distance(root) < 1e-5, "frame {frame} at {fps}");
    }
    positions
}

/// A solver with steps of its own shows the same hair at any rate: 24 to 240 frames a second.
#[test]
fn follow_the_leader_looks_alike_at_every_rate() {
    let sixty = after_a_second(60, &[]);
    for fps in [24, 30, 120, 240] {
        let off = farthest(&after_a_second(fps, &[]), &sixty);
        assert!(off < 1e-5, "{fps} frames a second: {off} m");
    }
    // One step a frame is another motion.
    let own = ["solver.dftl.step_secs=0"];
    assert!(farthest(&after_a_second(30, &own), &after_a_second(120, &own)) > 1e-3);
}

/// The largest distance between two lists of positions, metres.
fn farthest(a: &[Vec3], b: &[Vec3]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
}

#[test]
fn a_saved_scene_does_what_was_done_from_outside() {
    for keys in [["time.fps=60", "time.frames=5"], ["time.fps=24", "time.frames=30"]] {
        let mut first = player(&keys);
        let mut frames = vec![(first.head_pose(), positions(&mut first))];
        let mut step = |player: &mut Player| {
            run(player, 1);
            frames.push((player.head_pose(), positions(player)));
        };
        (0..2).for_each(|_| step(&mut first));
        first.set_head_pose(Pose::new(DQuat::IDENTITY, DVec3::X)).unwrap();
        first.teleport(Teleport::CarryShapeAndVelocity).unwrap();
        step(&mut first);
        first.set_head_pose(Pose::IDENTITY).unwrap();
        first.teleport(Teleport::CarryShape).unwrap();
        for k in 1..8 {
            let turn = DQuat::from_euler(EulerRot::YXZ, 0.05 * f64::from(k), -0.03 * f64::from(k), 0.02);
            first.set_head_pose(Pose::new(turn, DVec3::new(0.004 * f64::from(k), 0.0, 0.0))).unwrap();
            step(&mut first);
        }
        let section =
            ColliderSection { radius: Some(0.04), position: [0.1, 0.0, 0.02], ..ColliderSection::default() };
        let ball = first.add_collider(&section).unwrap();
        for k in 0..4 {
            let at = DVec3::new(0.1 - 0.01 * f64::from(k), 0.0, 0.02);
            first.set_collider_pose(ball, Pose::new(DQuat::IDENTITY, at)).unwrap();
            step(&mut first);
        }
        first.remove_collider(ball).unwrap();
        (0..4).for_each(|_| step(&mut first));
        assert!(farthest(&frames[12].1, &frames[14].1) > 1e-3, "the ball pushes");
        let saved = first.performed_scene();
        assert_eq!(first.parameters().wind, first.scene().wind);
        assert_eq!(saved.time.frames, first.scene().time.frames.max(18));
        let text = saved.to_toml();
        let read = Scene::parse(&text, Path::new("scene.toml"), &[]).unwrap();
        assert_eq!(read.colliders.len(), 1);
        assert_eq!(read.to_toml(), text);
        let mut again = Player::new(read).unwrap();
        for (frame, (head, before)) in frames.iter().enumerate() {
            if frame > 0 {
                run(&mut again, 1);
            }
            let now = again.head_pose();
            assert!(now.translation.distance(head.translation) < 1e-9, "frame {frame}");
            assert!(now.rotation.angle_between(head.rotation) < 1e-7, "frame {frame}");
            let off = farthest(&positions(&mut again), before);
            assert!(off < 2e-4, "frame {frame} of {keys:?}: {off} m");
            assert_eq!(again.colliders().count(), 1 + usize::from((10..=14).contains(&frame)), "{frame}");
        }
    }
}

#[test]
fn a_collider_is_there_from_and_until_its_times() {
    let ball = "[[collider]]\nradius = 0.05\nposition = [0.08, 0.0, 0.02]\n";
    let still = [Override::set("body.motion=builtin:still").unwrap()];
    let load = |keys: &str| {
        let text = format!("{TEXT}{keys}");
        Player::new(Scene::parse(&text, Path::new("scene.toml"), &still).unwrap()).unwrap()
    };
    let mut bald = load("");
    let mut timed = load(&format!("{ball}from_secs = 0.1\nuntil_secs = 0.2\n"));
    for frame in 0..=20 {
        if frame > 0 {
            run(&mut bald, 1);
            run(&mut timed, 1);
        }
        let off = farthest(&positions(&mut bald), &positions(&mut timed));
        assert_eq!(off > 1e-3, frame > 6, "frame {frame}: {off} m");
        assert_eq!(timed.moment().unwrap().solids().count(), usize::from((6..=12).contains(&frame)));
    }
    // Hair goes back to where it would be, but for what now lies on the other side of an ear.
    run(&mut bald, 120);
    run(&mut timed, 120);
    let off = positions(&mut bald);
    let off =
        off.iter().zip(positions(&mut timed)).map(|(a, b)| a.distance(b)).sum::<f32>() / off.len() as f32;
    assert!(off < 1e-3, "{off}");
    let wrong = format!("{TEXT}{ball}from_secs = 1\nuntil_secs = 1\n");
    let error = Scene::parse(&wrong, Path::new("scene.toml"), &[]).unwrap_err().to_string();
    assert!(error.contains("until_secs") && error.contains("from_secs"), "{error}");
}

#[test]
fn the_scalp_shows_where_hair_was_removed() {
    let mut player = player(&["groom.strands=600"]);
    let covered = |player: &mut Player| {
        let moment = player.moment().unwrap();
        let camera = moment.camera(player.scene());
        let picture = moment.picture(&player.scene().hair, camera);
        let shares = picture.bodies[0].scalp.map(|scalp| scalp.shares.to_vec()).unwrap();
        let (mut left, mut right) = (0.0, 0.0);
        for (at, share) in picture.bodies[0].mesh.positions.iter().zip(shares) {
            *if at.x > 0.0 { &mut left } else { &mut right } += share;
        }
        [left, right]
    };
    let before = covered(&mut player);
    run(&mut player, 2);
    assert_eq!(covered(&mut player), before);
    let centre = Vec3::new(0.2, 0.1, 0.0);
    let only = Selection { sphere: Some(Ball { centre, radius: 0.2 }), ..Selection::default() };
    let operation = Operation::Density(Density { factor: 0.0, ..Density::default() });
    player.edit_selected(Edit { operation, only }).unwrap();
    let after = covered(&mut player);
    assert!(after[0] < 0.4 * before[0] && after[1] > 0.9 * before[1], "{before:?} {after:?}");
    player.undo().unwrap();
    assert_eq!(covered(&mut player), before);
}

#[test]
fn a_saved_scene_jumps_where_the_head_was_teleported() {
    for fps in ["time.fps=60", "time.fps=240"] {
        let mut first = player(&[fps, "body.motion=builtin:still"]);
        let at = |k: i32| Pose::new(DQuat::IDENTITY, DVec3::new(0.3 * f64::from(k % 2), 0.0, 0.0));
        let mut heads = vec![first.head_pose()];
        for k in 0..40 {
            if k >= 30 {
                first.set_head_pose(at(k)).unwrap();
                first.teleport(Teleport::CarryShape).unwrap();
            }
            run(&mut first, 1);
            heads.push(first.head_pose());
        }
        let mut again = Player::new(first.performed_scene()).unwrap();
        for head in &heads[1..] {
            run(&mut again, 1);
            assert!(again.head_pose().translation.distance(head.translation) < 1e-9, "{}", again.frame());
        }
        let counted = |player: &Player| (player.counters().teleports, player.counters().undeclared_jumps);
        assert_eq!(counted(&again), counted(&first), "{fps}");
        assert!(farthest(&positions(&mut again), &positions(&mut first)) < 1e-5, "{fps}");
    }
}

#[test]
fn saved_scenes_have_all_changes_whatever_frame_is_shown() {
    let mut player = player(&[]);
    run(&mut player, 3);
    let add = |player: &mut Player, x: f64| {
        let position = [x, 0.0, 0.3];
        player.add_collider(&ColliderSection { radius: Some(0.02), position, ..ColliderSection::default() })
    };
    let move_to = |player: &mut Player, id: ColliderId, x: f64| {
        player.set_collider_pose(id, Pose::new(DQuat::IDENTITY, DVec3::new(x, 0.0, 0.3))).unwrap();
        run(player, 2);
    };
    let late = add(&mut player, 0.1).unwrap();
    move_to(&mut player, late, 0.2);
    player.edit(Operation::Trim(Trim { to: 0.12, ..Trim::default() })).unwrap();
    player.set_gravity(DVec3::new(0.0, -5.0, 0.0)).unwrap();
    run(&mut player, 1);
    // One that is added before it has another number.
    player.seek(1).unwrap();
    let early = add(&mut player, -0.1).unwrap();
    assert_ne!(early, late);
    move_to(&mut player, early, -0.2);
    run(&mut player, 6);
    player.seek(0).unwrap();
    let saved = player.performed_scene();
    assert_eq!((saved.edits.0.len(), saved.gravity[1]), (1, -5.0));
    let ends: Vec<f64> =
        saved.colliders.iter().map(|own| own.motion.keyframes.last().unwrap().translation[0]).collect();
    assert!((ends[0] + 0.1).abs() < 1e-9 && (ends[1] - 0.1).abs() < 1e-9, "{ends:?}");
    // What moved a collider is ignored where adding it was undone.
    player.seek(9).unwrap();
    for _ in 0..4 {
        player.undo().unwrap();
    }
    run(&mut player, 3);
    assert_eq!(player.performed_scene().colliders.len(), 0);
    // A run is long enough for one that was only added.
    run(&mut player, 300);
    add(&mut player, 0.1).unwrap();
    run(&mut player, 2);
    let saved = player.performed_scene();
    assert_eq!((saved.colliders.len(), saved.time.frames), (1, 314));
}
