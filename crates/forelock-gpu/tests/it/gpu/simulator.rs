//! What changes a simulation as a whole, on the GPU as on the CPU: both are a `Simulator`.

#![expect(clippy::unwrap_used, reason = "in a test a failure to build is a failure of the test")]

use crate::common;
use crate::common::shaken::{GRAVITY, head, options, tuft};
use forelock_core::frame::{FrameInput, Roots, Solver};
use forelock_core::groom::Groom;
use forelock_core::groom::edit::{Edit, Operation, Trim};
use forelock_core::interaction::grid::GridParams;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Simulation, Teleport};
use forelock_core::simulator::{HostPositions, Simulator};
use forelock_core::solver::{AmsParams, DftlParams, XpbdParams};
use forelock_core::strands::Snapshot;
use forelock_gpu::{Choice, DevicePositions, Gpu, GpuSimulation};
use glam::{DQuat, DVec3, Vec3};

const DT: f64 = 1.0 / 60.0;

fn groom() -> Groom {
    let (positions, offsets) = tuft(40, |_| 8, [0.001, 0.01]);
    let strand = |ends: &[u32]| {
        positions[ends[0] as usize..ends[1] as usize].iter().map(|p| Vec3::from_array(*p)).collect::<Vec<_>>()
    };
    Groom::from_strands(offsets.windows(2).map(strand)).unwrap()
}

fn frame(from: f64, jump: &Pose) -> FrameInput<'static> {
    let pose = |time: f64| jump.after(&head(time));
    FrameInput {
        roots: Roots::Rigid([pose(from), pose(from + DT)]),
        gravity: GRAVITY,
        dt_secs: DT,
        ..FrameInput::default()
    }
}

/// The same simulation on the CPU and on the GPU.
fn both(solver: &Solver<f32>) -> [Box<dyn Simulator>; 2] {
    let gpu = common::gpu();
    let groom = groom();
    let cpu = Simulation::new(&groom, solver, &options()).unwrap();
    let device = GpuSimulation::new(&gpu, &groom, solver, &options()).unwrap();
    [Box::new(HostPositions::new(cpu)), Box::new(device)]
}

/// Ten frames of a shaken head, for motion.
fn shake(simulator: &mut dyn Simulator) {
    for number in 0..10 {
        simulator.step(&frame(f64::from(number) * DT, &Pose::IDENTITY)).unwrap();
    }
}

fn far(a: &Snapshot<f32>, b: &Snapshot<f32>) -> f32 {
    let place =
        |s: &Snapshot<f32>, p: usize| Vec3::from_array(s.positions[p]) + DVec3::from(s.origin).as_vec3();
    assert_eq!(a.positions.len(), b.positions.len());
    (0..a.positions.len()).map(|p| place(a, p).distance(place(b, p))).fold(0.0, f32::max)
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_teleport_moves_hair_as_on_the_cpu() {
    let to = Pose { rotation: DQuat::from_rotation_y(1.0), translation: DVec3::new(14.0, 1.0, -3.0) };
    for solver in [
        Solver::from(&AmsParams::default()),
        Solver::from(&DftlParams::default()),
        Solver::from(&XpbdParams::default()),
    ] {
        for mode in [Teleport::Reset, Teleport::CarryShape, Teleport::CarryShapeAndVelocity] {
            let [mut cpu, mut gpu] = both(&solver);
            shake(&mut *cpu);
            let state = cpu.snapshot().unwrap();
            gpu.restore(&state).unwrap();
            let now = head(10.0 * DT);
            for simulator in [&mut cpu, &mut gpu] {
                simulator.teleport(&now, &to.after(&now), mode).unwrap();
            }
            assert_eq!(cpu.snapshot().unwrap(), gpu.snapshot().unwrap(), "{mode:?} {solver:?}");
            // And it goes on there.
            for simulator in [&mut cpu, &mut gpu] {
                simulator.step(&frame(10.0 * DT, &to)).unwrap();
            }
            let apart = far(&cpu.snapshot().unwrap(), &gpu.snapshot().unwrap());
            assert!(apart < 2e-5, "{mode:?}: {apart} m apart");
        }
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn parameters_and_the_solver_change_while_hair_moves() {
    let [mut cpu, mut gpu] = both(&Solver::from(&AmsParams::default()));
    shake(&mut *cpu);
    gpu.restore(&cpu.snapshot().unwrap()).unwrap();
    let stiffer = AmsParams { k_integrity: 200.0, ..AmsParams::default() };
    let finer = AmsParams { substep_secs: DT / 6.0, ..AmsParams::default() };
    let changes = [
        Solver::from(&stiffer),
        Solver::from(&finer),
        Solver::from(&DftlParams::default()),
        Solver::from(&XpbdParams::default()),
        Solver::from(&XpbdParams { substep_secs: DT / 50.0, iterations: 2, ..XpbdParams::default() }),
        Solver::from(&AmsParams::default()),
    ];
    for (number, solver) in (10..).zip(&changes) {
        let mut before = Vec::new();
        for simulator in [&mut cpu, &mut gpu] {
            before.push(simulator.snapshot().unwrap());
            simulator.set_params(solver).unwrap();
            simulator.step(&frame(f64::from(number) * DT, &Pose::IDENTITY)).unwrap();
        }
        let apart = far(&cpu.snapshot().unwrap(), &gpu.snapshot().unwrap());
        assert!(apart < 5e-5, "{solver:?}: {apart} m apart");
        assert!(far(&before[1], &gpu.snapshot().unwrap()) > 1e-5, "{solver:?}: nothing moved");
    }
    // What is out of range changes nothing.
    let wrong = Solver::from(&AmsParams { substep_secs: 0.0, ..AmsParams::default() });
    for simulator in [&mut cpu, &mut gpu] {
        assert!(simulator.set_params(&wrong).is_err());
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn an_edit_while_hair_moves_keeps_interactions() {
    let gpu = common::gpu();
    let mut own = GpuSimulation::new(&gpu, &groom(), &AmsParams::default(), &options()).unwrap();
    own.set_grid(Some(&GridParams { resolution: 16, iterations: 8, ..GridParams::default() })).unwrap();
    shake(&mut own);
    let mut edited = groom();
    let trim = Trim { to: 0.04, ..Trim::default() };
    let report = Edit::all(Operation::Trim(trim)).apply(&mut edited, None).unwrap();
    let now = head(10.0 * DT);
    own.regroom(&edited, &report.sources, &now).unwrap();
    assert_eq!(own.model().particle_count, edited.particle_count());
    assert_eq!(own.exchanges().len(), 1);
    Simulator::step(&mut own, &frame(10.0 * DT, &Pose::IDENTITY)).unwrap();
    assert!(own.snapshot().unwrap().positions.iter().flatten().all(|x| x.is_finite()));
}

/// Frames go into the caller's encoder, and positions stay where they are: nothing is read back.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn positions_stay_on_the_device() {
    // A device of its own: it counts what is read back.
    let gpu = Gpu::open(&Choice::Fastest).unwrap();
    let mut own = GpuSimulation::new(&gpu, &groom(), &AmsParams::default(), &options()).unwrap();
    let mut same = GpuSimulation::new(&gpu, &groom(), &AmsParams::default(), &options()).unwrap();
    let before = gpu.counts().read_backs;
    for number in 0..3 {
        let frame = frame(f64::from(number) * DT, &Pose::IDENTITY);
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        own.encode(&mut encoder, &frame).unwrap();
        gpu.queue().submit([encoder.finish()]);
    }
    let shared = Simulator::positions(&mut own).unwrap().device::<DevicePositions>().unwrap().clone();
    assert_eq!(gpu.counts().read_backs, before, "frames and positions copied something to the CPU");
    let live: usize = shared.blocks.iter().map(|block| block.live * block.particles).sum();
    assert_eq!(live, own.model().particle_count);

    // A read-back that does not wait.
    let pending = own.begin_read();
    let mut found = Vec::new();
    let mut tries = 0;
    while !own.try_read(&pending, &mut found).unwrap() {
        tries += 1;
        assert!(tries < 10_000, "the device did not answer");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    // One that waits, and the layout as documented.
    let mut waited = Vec::new();
    own.read_positions(&mut waited).unwrap();
    assert_eq!(found, waited);
    let state = own.read_state().unwrap().clone();
    for block in &shared.blocks {
        for lane in 0..block.live {
            let strand = block.strands[lane] as usize;
            for i in 0..block.particles {
                let relative = [0, 1, 2].map(|c| state.positions[3 * (block.first + i) + c].0[lane]);
                let world = (shared.origin + Vec3::from_array(relative).as_dvec3()).as_vec3();
                assert_eq!(world, waited[own.model().offsets[strand] as usize + i]);
            }
        }
    }
    let mut placed = vec![Vec3::NAN; waited.len()];
    for [x, particle] in shared.places.iter().flatten() {
        let (row, lane) = ((x / 16) as usize, (x % 16) as usize);
        let relative = Vec3::from_array([0, 1, 2].map(|c| state.positions[row + c].0[lane]));
        placed[*particle as usize] = (shared.origin + relative.as_dvec3()).as_vec3();
    }
    assert_eq!(placed, waited);
    for number in 0..3 {
        same.step_frame(&frame(f64::from(number) * DT, &Pose::IDENTITY)).unwrap();
    }
    assert_eq!(own.state_hash().unwrap(), same.state_hash().unwrap());
}
