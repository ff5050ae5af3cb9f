//! A scene that is driven from outside: stepped, changed while it runs, taken back, and undone.
//!
//! Runs with `cargo run --release -p forelock --example player` and checks its results.
#![expect(clippy::print_stdout, reason = "an example prints")]

use std::error::Error;

use forelock::core::groom::edit::{Operation, Trim};
use forelock::core::pose::Pose;
use forelock::core::simulation::Teleport;
use forelock::player::{HistoryOptions, Player, PlayerError};
use forelock::scene::{ColliderSection, Override, Scene};
use glam::{DQuat, DVec3, Vec3};

/// Length of the longest strand that is shown, metres.
fn longest(player: &mut Player) -> Result<f32, PlayerError> {
    let mut positions = Vec::new();
    player.positions(&mut positions)?;
    let length = |ends: &[u32]| {
        let strand = &positions[ends[0] as usize..ends[1] as usize];
        strand.windows(2).map(|edge| edge[0].distance(edge[1])).sum::<f32>()
    };
    Ok(player.layout().strand_offsets.windows(2).map(length).fold(0.0, f32::max))
}

/// The first root, metres.
fn root(player: &mut Player) -> Result<Vec3, PlayerError> {
    let mut positions = Vec::new();
    player.positions(&mut positions)?;
    Ok(positions[0])
}

fn main() -> Result<(), Box<dyn Error>> {
    let sets = ["groom.strands=200", "body.sdf_cells=48", "body.motion=builtin:still"];
    let sets: Vec<Override> = sets.iter().map(|set| Override::set(set)).collect::<Result<_, _>>()?;
    let history = HistoryOptions { every: 10, ..HistoryOptions::default() };
    let mut player = Player::builder(Scene::builtin(&sets)?).history(history).build()?;
    println!("{} strands at {:.3} s", player.groom().strand_count(), player.time_secs());

    // Half a second of hair at rest, then gusts from the side.
    for _ in 0..30 {
        player.step()?;
    }
    let still = player.state_hash()?;
    let mut wind = player.scene().wind.clone();
    wind.velocity = DVec3::new(4.0, 0.0, 0.0);
    player.set_wind(&wind)?;
    for _ in 0..30 {
        player.step()?;
    }
    let blown = player.state_hash()?;

    // Back and forth: every bit is as it was.
    player.seek(30)?;
    assert_eq!(player.state_hash()?, still);
    player.seek(60)?;
    assert_eq!(player.state_hash()?, blown);

    // A trim while the hair moves, and undone again.
    let before = longest(&mut player)?;
    let to = 0.5 * before;
    player.edit(Operation::Trim(Trim { to, ..Trim::default() }))?;
    for _ in 0..5 {
        player.step()?;
    }
    let trimmed = longest(&mut player)?;
    assert!(trimmed < 0.6 * before, "{trimmed} m of {before} m");
    assert_eq!(player.undo()?, Some("trim"));
    assert!(longest(&mut player)? > 0.9 * before);
    assert_eq!(player.redo()?, Some("trim"));
    println!("trimmed from {:.0} to {:.0} mm", 1e3 * before, 1e3 * trimmed);

    // A ball beside the head, moved through the hair.
    let ball =
        ColliderSection { radius: Some(0.04), position: [0.3, 0.1, 0.0], ..ColliderSection::default() };
    let ball = player.add_collider(&ball)?;
    for step in 0..20 {
        let x = 0.3 - 0.01 * f64::from(step);
        player.set_collider_pose(ball, Pose::new(DQuat::IDENTITY, DVec3::new(x, 0.1, 0.0)))?;
        player.step()?;
    }
    player.remove_collider(ball)?;

    // The head is dragged, then put somewhere else: the hair goes along.
    let from = root(&mut player)?;
    player.set_head_pose(Pose::new(DQuat::from_rotation_y(0.2), DVec3::new(0.02, 0.0, 0.0)))?;
    player.step()?;
    player.set_head_pose(Pose::new(DQuat::IDENTITY, DVec3::new(5.0, 0.0, 0.0)))?;
    player.teleport(Teleport::CarryShapeAndVelocity)?;
    let report = player.step()?;
    let jump = report.teleports.first().ok_or("there was no teleport")?;
    assert!((jump.distance_m - 4.98).abs() < 0.1, "{jump:?}");
    assert!((root(&mut player)? - from - Vec3::X * 5.0).length() < 1e-3);
    assert_eq!(player.counters().quarantined_strands, 0);
    println!("{} frames, state {:016x}", player.frame(), player.state_hash()?);
    Ok(())
}
