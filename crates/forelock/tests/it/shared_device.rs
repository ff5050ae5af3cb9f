//! A scene on the device of an engine.

use forelock::Scene;
use forelock::core::groom::edit::{Density, Operation, Smooth, Trim};
use forelock::player::Player;
use forelock::scene::{Override, SolverKind};
use forelock_gpu::{Choice, DevicePositions, Gpu};
use glam::{DVec3, Vec3};

type AnyError = Box<dyn std::error::Error>;

fn scene(more: &[&str]) -> Result<Scene, AnyError> {
    let small = ["groom.strands=60", "body.sdf_cells=32", "body.motion=builtin:turn"];
    let sets = small.iter().chain(more).map(|key| Override::set(key)).collect::<Result<Vec<_>, _>>()?;
    Ok(Scene::builtin(&sets)?)
}

/// What a renderer on `gpu` finds.
fn read(gpu: &Gpu, shared: &DevicePositions, particles: usize) -> Result<Vec<Vec3>, AnyError> {
    let mut found = vec![Vec3::NAN; particles];
    for (buffer, places) in shared.buffers.iter().zip(&shared.places) {
        let staging = gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: buffer.size(),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
        gpu.queue().submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |_| {});
        gpu.wait()?;
        let bytes = staging.get_mapped_range(..);
        let numbers: Vec<f32> =
            bytes.chunks_exact(4).map(|own| f32::from_le_bytes([own[0], own[1], own[2], own[3]])).collect();
        for [x, particle] in places {
            let at = |c: u32| f64::from(numbers[(x + c * DevicePositions::STRIDE) as usize]);
            found[*particle as usize] = (shared.origin + DVec3::new(at(0), at(1), at(2))).as_vec3();
        }
    }
    Ok(found)
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_player_on_an_engines_device_shares_its_positions() -> Result<(), AnyError> {
    let gpu = Gpu::open(&Choice::Fastest)?;
    for kind in ["solver.kind=ams", "solver.kind=mass-spring"] {
        let mut player = Player::builder(scene(&[kind])?).gpu(gpu.clone()).build()?;
        for _ in 0..3 {
            player.step()?;
        }
        let mut positions = Vec::new();
        player.positions(&mut positions)?;
        let shared = player.device_positions()?.ok_or("there are none")?;
        assert_eq!(read(&gpu, shared, positions.len())?, positions, "{kind}");
    }
    Ok(())
}

/// Where a renderer cannot use them there are none.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn positions_that_are_not_on_the_device_are_not_shared() -> Result<(), AnyError> {
    let gpu = Gpu::open(&Choice::Fastest)?;
    let mut guided = Player::builder(scene(&["groom.guides=20"])?).gpu(gpu.clone()).build()?;
    assert!(guided.device_positions()?.is_none());
    // A step is a sixtieth of a second: frame 1 of 24 a second ends in the middle of one.
    for (fps, has_first) in [("time.fps=240", false), ("time.fps=24", false), ("time.fps=30", true)] {
        let mut player = Player::builder(scene(&[fps])?).gpu(gpu.clone()).build()?;
        player.step()?;
        assert_eq!(player.device_positions()?.is_some(), has_first, "{fps}");
        for _ in 0..3 {
            player.step()?;
        }
        assert!(player.device_positions()?.is_some(), "{fps}");
    }
    Ok(())
}

/// Edits that keep particles, or show their own, keep them; other buffers have another revision.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn edits_and_changes_of_the_solver_are_noticed() -> Result<(), AnyError> {
    let gpu = Gpu::open(&Choice::Fastest)?;
    let mut player = Player::builder(scene(&[])?).gpu(gpu.clone()).build()?;
    player.step()?;
    let revision = |player: &mut Player| -> Result<u64, AnyError> {
        Ok(player.device_positions()?.ok_or("there are none")?.revision)
    };
    let first = revision(&mut player)?;
    player.step()?;
    assert_eq!(revision(&mut player)?, first);
    player.edit(Operation::Density(Density { factor: 0.5, ..Density::default() }))?;
    let edited = revision(&mut player)?;
    assert_ne!(edited, first);
    let mut positions = Vec::new();
    player.positions(&mut positions)?;
    assert_eq!(positions.len(), player.groom().particle_count());
    let shared = player.device_positions()?.ok_or("there are none")?;
    assert_eq!(read(&gpu, shared, positions.len())?, positions);
    let mut solver = player.solver().clone();
    solver.kind = SolverKind::Dftl;
    player.set_params(&solver)?;
    assert_ne!(revision(&mut player)?, edited);

    let mut player = Player::builder(scene(&[])?).gpu(gpu).build()?;
    player.edit(Operation::Smooth(Smooth::default()))?;
    assert!(player.device_positions()?.is_some());
    player.edit(Operation::Trim(Trim { to: 0.05, ..Trim::default() }))?;
    assert!(player.device_positions()?.is_none());
    Ok(())
}

#[test]
fn on_a_cpu_there_are_none() -> Result<(), AnyError> {
    assert!(Player::builder(scene(&[])?).build()?.device_positions()?.is_none());
    Ok(())
}
