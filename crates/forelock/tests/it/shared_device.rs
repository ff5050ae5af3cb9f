//! A scene on the device of an engine.

use forelock::Scene;
use forelock::player::Player;
use forelock::scene::Override;
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
    let mut between = Player::builder(scene(&["time.fps=240"])?).gpu(gpu).build()?;
    between.step()?;
    assert!(between.device_positions()?.is_none());
    for _ in 0..3 {
        between.step()?;
    }
    assert!(between.device_positions()?.is_some());
    Ok(())
}

#[test]
fn on_a_cpu_there_are_none() -> Result<(), AnyError> {
    assert!(Player::builder(scene(&[])?).build()?.device_positions()?.is_none());
    Ok(())
}
