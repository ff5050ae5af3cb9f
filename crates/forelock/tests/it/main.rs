//! The tests of this crate that use its public interface alone, as one program.

mod ams_scenes;
mod chain;
mod characters;
mod documented_parameters;
mod frame_rates;
mod measure;
mod measured_runs;
mod mesh_sequence;
mod neural;
mod player;
mod rates_agree;
mod readme;
mod real_grooms;
mod renderer;
mod shared_device;
mod sleep;
mod teleports;
mod training;

/// The strands of the frame that is shown.
#[expect(clippy::unwrap_used, reason = "a test whose player has failed fails")]
fn positions(player: &mut forelock::Player) -> Vec<glam::Vec3> {
    let mut positions = Vec::new();
    player.positions(&mut positions).unwrap();
    positions
}
