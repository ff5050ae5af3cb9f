//! Hair in moving air: closed forms of its drag, and bits that do not depend on threads or width.

use crate::rig::{DT, G, GRAVITY, Rig, bare, real, simds, tuft};
use forelock_core::air::{Wind, WindParams};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{Air, FrameInput, Roots};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::solver::AmsParams;
use glam::DVec3;

/// A free straight strand along `along` in still air: the vertical and the sideways speed of its
/// middle after `secs`.
fn fall(params: &AmsParams, along: DVec3, secs: f64) -> DVec3 {
    let n = 200;
    let strand = (0..n).map(|i| (along * (0.01 * f64::from(i))).to_array()).collect();
    let mut rig = Rig::<f64>::new(&[strand], params, Simd::Auto);
    rig.gravity = GRAVITY;
    for _ in 0..(secs / DT).round() as u32 {
        rig.step(Pose::IDENTITY);
    }
    // The clamped root bends its neighbours, one more a substep: the tip has not heard of it.
    rig.velocities()[n as usize - 2]
}

#[test]
fn a_strand_falls_at_its_terminal_velocity() {
    // 0.6 s at 240 substeps a second: the clamp affects 144 particles. After 0.6 s at rates of 20
    // s⁻¹ and more all but e⁻⁶ of the final speed is reached.
    let (c, beta) = (40.0, 0.5);
    let params = AmsParams { drag: c, drag_along: beta, ..bare() };
    let across = fall(&params, DVec3::X, 0.6);
    assert!((across - DVec3::NEG_Y * (G / c)).length() < 1e-9, "{across}");
    let along = fall(&params, DVec3::NEG_Y, 0.6);
    // The discrete law of the speed along the strand: a factor (1 + h c (1 − β))/(1 + h c) a
    // substep.
    let hc = c * DT / 4.0;
    let left = ((1.0 + hc * (1.0 - beta)) / (1.0 + hc)).powi(144);
    assert!((along.y + G / (c * beta) * (1.0 - left)).abs() < 1e-9, "{along}");
    // Inclined by 45° it glides: g has equal parts along and across.
    let glide = fall(&params, DVec3::new(1.0, -1.0, 0.0).normalize(), 0.6);
    let part = G / 2f64.sqrt();
    let (s, n) = (DVec3::new(1.0, -1.0, 0.0).normalize(), DVec3::new(-1.0, -1.0, 0.0).normalize());
    let expected = s * (part / (c * beta) * (1.0 - left)) + n * (part / c);
    assert!((glide - expected).length() < 1e-6, "{glide} for {expected}");
    // Quadratic alone: c₁ v² = g.
    let params = AmsParams { drag: 0.0, drag_quadratic: 60.0, ..bare() };
    let quadratic = fall(&params, DVec3::X, 0.6);
    assert!((quadratic.y + (G / 60.0).sqrt()).abs() < 1e-6, "{quadratic}");
}

/// With the options at their defaults nothing changes, to the bit.
#[test]
fn a_uniform_field_is_the_frames_air() {
    let mut plain = Rig::<f32>::new(&tuft(20, 30), &AmsParams::default(), Simd::Auto);
    let mut field = Rig::<f32>::new(&tuft(20, 30), &AmsParams::default(), Simd::Auto);
    plain.air = DVec3::new(1.0, 0.5, -2.0);
    let wind = Wind::new(&WindParams { velocity: plain.air, ..WindParams::default() }).unwrap();
    for frame in 0..30 {
        plain.step(Pose::IDENTITY);
        blow(&mut field, &wind, frame, &[]);
    }
    assert_eq!(plain.simulation.state_hash(), field.simulation.state_hash());
}

fn blow(rig: &mut Rig<f32>, wind: &Wind, frame: u32, colliders: &[ColliderFrame<'_>]) {
    let frame_of = FrameInput {
        roots: Roots::Rigid([Pose::IDENTITY; 2]),
        colliders,
        gravity: GRAVITY,
        dt_secs: DT,
        ..FrameInput::default()
    };
    let wind = wind.at(f64::from(frame) * DT);
    rig.simulation
        .step_frame(&FrameInput { air: Air { field: Some(&wind), ..frame_of.air }, ..frame_of })
        .unwrap();
}

fn gale() -> Wind {
    let params = WindParams {
        velocity: DVec3::new(-5.0, 0.0, 1.0),
        gust_strength: 0.3,
        turbulence: 0.3,
        shelter: 0.8,
        hair_depth: 0.02,
        ..WindParams::default()
    };
    Wind::new(&params).unwrap()
}

#[test]
fn bits_do_not_depend_on_threads_or_width() {
    let shape = Shape::Sphere { radius: 0.05 };
    let params = AmsParams { drag_along: 0.5, drag_quadratic: 0.5, ..AmsParams::default() };
    let run = |threads: usize, simd: Simd| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut rig = Rig::<f32>::new(&tuft(40, 30), &params, simd);
            let at = Pose { translation: DVec3::new(0.1, -0.1, 0.0), ..Pose::IDENTITY };
            let ball =
                ColliderFrame { shape: &shape, local: Pose::IDENTITY, from: at, to: at, friction: 0.3 };
            for frame in 0..20 {
                blow(&mut rig, &gale(), frame, &[ball]);
            }
            rig.simulation.state_hash()
        })
    };
    assert_eq!(run(1, Simd::Auto), run(2, Simd::Auto));
    let fused: Vec<_> = simds().filter(|s| !matches!(s, Simd::Scalar | Simd::Portable)).collect();
    assert!(fused.windows(2).all(|pair| run(1, pair[0]) == run(2, pair[1])), "{fused:?}");
}

#[test]
fn exposure_and_shelter_keep_the_wind_off() {
    let push = |exposure: Option<f32>| {
        let mut rig = Rig::<f32>::new(&tuft(9, 30), &AmsParams::default(), Simd::Auto);
        if let Some(exposure) = exposure {
            for row in rig.simulation.air_exposure() {
                row.0.fill(real(f64::from(exposure)));
            }
        }
        let start = rig.positions();
        for frame in 0..60 {
            blow(&mut rig, &gale(), frame, &[]);
        }
        let moved = rig.positions().iter().zip(&start).map(|(a, b)| (*a - *b).length()).sum::<f64>();
        moved / start.len() as f64
    };
    let (open, whole, none) = (push(None), push(Some(1.0)), push(Some(0.0)));
    assert_eq!(open, whole);
    assert!(none < 1e-4 * open && open > 0.01, "{none} of {open}");
}
