//! XPBD Cosserat rods against closed forms, against much shorter substeps, and against the least
//! energy of the discrete rod.

use crate::golden_rods::{Trajectory, positions};
use forelock_core::frame::FrameInput;
use forelock_core::groom::Groom;
use forelock_core::groom::edit::{Edit, Lengthen, Operation};
use forelock_core::lane::Simd;
use forelock_core::params::Inextensibility;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation, SimulationReal};
use forelock_core::solver::{Solver, XpbdParams};
use forelock_core::strands::{Strands, number};
use glam::{DQuat, DVec3, Vec3};

/// Metres of a centimetre.
const CM: f64 = 0.01;
const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);
/// A frame of these tests, seconds.
const DT: f64 = 1.0 / 30.0;

/// Rods that nothing but their own constraints keeps together.
fn rods(substeps: u32) -> XpbdParams {
    let substep_secs = DT / f64::from(substeps);
    XpbdParams { substep_secs, inextensibility: Inextensibility::Off, ..XpbdParams::default() }
}

/// Runs `rest` for `frames`, with the head at `pose` of a frame; calls `see` with the positions in
/// the world after each frame.
fn run<T: SimulationReal>(
    params: &XpbdParams,
    rest: &[DVec3],
    frames: usize,
    gravity: DVec3,
    pose: impl Fn(usize) -> Pose,
    mut see: impl FnMut(usize, &[DVec3]),
) {
    let points: Vec<[T; 3]> = rest.iter().map(|x| x.to_array().map(number)).collect();
    let offsets = [0, rest.len() as u32];
    let options = Options { simd: Simd::Auto, rest_pose: pose(0), ..Options::default() };
    let solver: Solver<T> = params.into();
    let mut simulation =
        Simulation::from_strands(&Strands::new(&points, &offsets), solver, &options).unwrap();
    for frame in 0..frames {
        let roots = [pose(frame), pose(frame + 1)].into();
        let input = FrameInput { roots, gravity, dt_secs: DT, ..FrameInput::default() };
        simulation.step_frame(&input).unwrap();
        see(frame, &positions(&simulation.snapshot()));
    }
}

/// The largest distance of the particles of `a` from those of `b`.
fn farthest(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
}

/// The strand of the reference that turns with the head.
fn curl() -> Trajectory {
    Trajectory::load("xpbd_4_curly_turn")
}

#[test]
fn a_curl_without_gravity_stays_as_it_is() {
    let trajectory = curl();
    let turned = Pose::new(DQuat::from_rotation_y(0.7), DVec3::new(0.1, 1.5, -0.3));
    let expected: Vec<DVec3> = trajectory.rest.iter().map(|x| turned.transform_point(*x)).collect();
    let moved = |see: &mut dyn FnMut(&[DVec3]), single: bool| {
        let (params, rest) = (rods(200), &trajectory.rest);
        if single {
            run::<f32>(&params, rest, 60, DVec3::ZERO, |_| turned, |_, x| see(x));
        } else {
            run::<f64>(&params, rest, 60, DVec3::ZERO, |_| turned, |_, x| see(x));
        }
    };
    for (single, most) in [(false, 1e-11), (true, 1e-6)] {
        let mut worst = 0.0f64;
        moved(&mut |x| worst = worst.max(farthest(x, &expected)), single);
        assert!(worst <= most, "float32 {single}: {worst:e} m");
    }
}

#[test]
fn a_turned_scene_moves_the_same() {
    let trajectory = curl();
    let turn = DQuat::from_rotation_x(1.1) * DQuat::from_rotation_z(-0.4);
    let turned_rest: Vec<DVec3> = trajectory.rest.iter().map(|x| turn * *x).collect();
    let pose = |frame: usize| trajectory.pose(frame.min(24));
    let turned_pose = |frame: usize| {
        let Pose { rotation, translation } = pose(frame);
        Pose::new(turn * rotation * turn.inverse(), turn * translation)
    };
    let (mut all, mut worst) = (Vec::new(), 0.0f64);
    run::<f64>(&rods(50), &trajectory.rest, 24, GRAVITY, pose, |_, x| {
        all.push(x.iter().map(|x| turn * *x).collect::<Vec<_>>());
    });
    run::<f64>(&rods(50), &turned_rest, 24, turn * GRAVITY, turned_pose, |frame, x| {
        worst = worst.max(farthest(x, &all[frame]));
    });
    assert!(worst <= 1e-10, "{worst:e} m");
}

/// Angles of the edges of a planar cantilever of least energy, whose root is horizontal: `count`
/// edges of length `l`, stiffness `k` over the unit mass, inextensible; the tip has `tip_mass`.
///
/// E = Σ (2 k/L) sin²(Δθ/2) + Σ m g y, by Newton's method on its tridiagonal system.
fn least_energy(count: usize, l: f64, k: f64, tip_mass: f64) -> Vec<f64> {
    let mut angles = vec![0.0f64; count];
    // The mass that each edge carries at its outer end and beyond.
    let carried: Vec<f64> = (0..count).map(|i| (count - 1 - i) as f64 + tip_mass).collect();
    // Gravity is switched on in steps, so that Newton's method converges.
    for step in 1..=20 {
        let g = -GRAVITY.y * f64::from(step) / 20.0;
        for _ in 0..50 {
            let (mut gradient, mut diagonal) = (vec![0.0; count], vec![0.0; count]);
            let mut beside = vec![0.0; count];
            for i in 0..count {
                gradient[i] = carried[i] * g * l * angles[i].cos();
                diagonal[i] = -carried[i] * g * l * angles[i].sin();
            }
            for i in 0..count {
                let (before, reach) = if i == 0 { (0.0, 0.5 * l) } else { (angles[i - 1], l) };
                let change = angles[i] - before;
                let (force, slope) = (k / reach * change.sin(), k / reach * change.cos());
                gradient[i] += force;
                diagonal[i] += slope;
                if i > 0 {
                    gradient[i - 1] -= force;
                    diagonal[i - 1] += slope;
                    beside[i] = -slope;
                }
            }
            let mut steps = gradient;
            for i in 1..count {
                let share = beside[i] / diagonal[i - 1];
                diagonal[i] -= share * beside[i];
                steps[i] -= share * steps[i - 1];
            }
            for i in (0..count).rev() {
                let next = if i + 1 < count { beside[i + 1] * steps[i + 1] } else { 0.0 };
                steps[i] = (steps[i] - next) / diagonal[i];
                angles[i] -= steps[i];
            }
            if steps.iter().all(|step| step.abs() < 1e-13) {
                break;
            }
        }
    }
    angles
}

/// The end of edges of length `l` at `angles`.
fn tip(angles: &[f64], l: f64) -> DVec3 {
    angles.iter().map(|a| l * DVec3::new(a.cos(), a.sin(), 0.0)).sum()
}

/// The discrete rod of least energy converges to the elastica: EI/ρ = 1e6 cm⁴ s⁻², 12 cm.
#[test]
fn the_least_energy_converges_to_the_elastica() {
    let elastica = CM * DVec3::new(11.7087, -2.4568, 0.0);
    let error = |count: usize| {
        let l = 12.0 * CM / count as f64;
        // k_bt = EI, over the mass ρ l; half a mass at the tip, whose edge ends there.
        let k = 1e6 * CM.powi(4) / l;
        tip(&least_energy(count, l, k, 0.5), l).distance(elastica) / CM
    };
    let errors = [12, 24, 48].map(error);
    assert!(errors[0] < 0.02, "{errors:?} cm");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!(order > 1.8, "order {order}: {errors:?} cm");
    }
}

/// A cantilever comes to rest near the least energy, the nearer the shorter its substeps.
#[test]
fn a_cantilever_rests_at_the_least_energy() {
    let rest: Vec<DVec3> = (0..=12).map(|i| CM * DVec3::X * f64::from(i)).collect();
    // The springs of the solver give way a little, so the tip is that of the design's figures.
    let least = CM * DVec3::new(11.6404, -2.7633, 0.0);
    let inextensible = tip(&least_energy(12, CM, 1.0, 1.0), CM);
    assert!(inextensible.distance(least) < 0.05 * CM, "{inextensible} m");
    let error = |substeps: u32| {
        let params = XpbdParams { drag: 6.0, ..rods(substeps) };
        let mut last = DVec3::ZERO;
        run::<f64>(&params, &rest, 120, GRAVITY, |_| Pose::IDENTITY, |_, x| last = x[12]);
        last.distance(least) / CM
    };
    let errors = [100, 200, 400].map(error);
    println!("cantilever: {errors:?} cm");
    assert!(errors[1] <= 0.1, "{errors:?} cm");
    for pair in errors.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((3.0..5.5).contains(&ratio), "errors fall by {ratio}: {errors:?} cm");
    }
}

/// A strand in motion converges with the substep.
#[test]
fn shorter_substeps_converge() {
    let trajectory = curl();
    let motion = |substeps: u32| {
        let params = XpbdParams { rotation_weight: 0.05, drag: 0.0, ..rods(substeps) };
        let mut all = Vec::new();
        let pose = |frame: usize| trajectory.pose(frame.min(24));
        run::<f64>(&params, &trajectory.rest, 24, GRAVITY, pose, |_, x| all.extend_from_slice(x));
        all
    };
    let limit = motion(3200);
    let errors = [100, 200, 400].map(|substeps| {
        let all = motion(substeps);
        let squares = all.iter().zip(&limit).map(|(a, b)| a.distance_squared(*b)).sum::<f64>();
        (squares / all.len() as f64).sqrt() / CM
    });
    println!("moving curl: {errors:?} cm");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!(order >= 0.9, "order {order}: {errors:?} cm");
    }
}

/// Float32 follows float64, and edges stretch little, while the head turns.
#[test]
fn a_turn_in_float32_is_that_in_float64() {
    let trajectory = curl();
    let params = XpbdParams { drag: 4.0, ..rods(200) };
    let pose = |frame: usize| trajectory.pose(frame.min(24));
    let (mut all, mut worst, mut stretch) = (Vec::new(), 0.0f64, 0.0f64);
    run::<f64>(&params, &trajectory.rest, 30, GRAVITY, pose, |_, x| {
        for (edge, at_rest) in x.windows(2).zip(trajectory.rest.windows(2)) {
            let ratio = edge[0].distance(edge[1]) / at_rest[0].distance(at_rest[1]);
            stretch = stretch.max((ratio - 1.0).abs());
        }
        all.push(x.to_vec());
    });
    run::<f32>(&params, &trajectory.rest, 30, GRAVITY, pose, |frame, x| {
        worst = worst.max(farthest(x, &all[frame]));
    });
    println!("turn: float32 {:.1e} cm, stretch {:.2} %", worst / CM, 100.0 * stretch);
    assert!(worst <= 2e-5, "{worst:e} m");
    assert!(stretch <= 0.025, "{stretch}");
}

/// Hair that is lengthened after the head has turned goes on as it moved: its new edges continue
/// the rotation of the tip, not that of the start.
#[test]
fn lengthened_hair_is_not_jolted() {
    let strand = |s: usize| (0..9).map(move |i| Vec3::new(0.01 * s as f32, -0.01 * i as f32, 0.0));
    let groom = Groom::from_strands((0..3).map(|s| strand(s).collect::<Vec<_>>())).unwrap();
    let solver = XpbdParams { inextensibility: Inextensibility::Off, drag: 20.0, ..XpbdParams::default() };
    let options = Options { simd: Simd::Auto, ..Options::default() };
    let mut simulation = Simulation::new(&groom, &solver, &options).unwrap();
    let pose = |frame: usize| Pose::new(DQuat::from_rotation_z(0.04 * frame.min(60) as f64), DVec3::ZERO);
    let play = |simulation: &mut Simulation, frames: std::ops::Range<usize>| {
        let mut fastest = 0.0f64;
        for frame in frames {
            let roots = [pose(frame), pose(frame + 1)].into();
            let input = FrameInput { roots, gravity: GRAVITY, dt_secs: 1.0 / 60.0, ..FrameInput::default() };
            simulation.step_frame(&input).unwrap();
            let velocities = simulation.snapshot().velocities;
            let speeds = velocities.iter().map(|v| DVec3::from(v.map(f64::from)).length());
            fastest = speeds.fold(fastest, f64::max);
        }
        fastest
    };
    play(&mut simulation, 0..240);
    let mut edited = groom.clone();
    let longer = Operation::Lengthen(Lengthen { by: 0.02, ..Lengthen::default() });
    let sources = Edit::all(longer).apply(&mut edited, None).unwrap().sources;
    simulation.regroom(&edited, &sources, &pose(240)).unwrap();
    let fastest = play(&mut simulation, 240..250);
    println!("lengthened: {fastest:.3} m/s");
    assert!(fastest < 0.3, "{fastest} m/s");
}
