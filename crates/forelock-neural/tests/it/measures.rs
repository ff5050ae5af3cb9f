//! Measures of a motion against a reference.

use crate::golden::{load, vectors};
use forelock_neural::measures::{MeasureError, Measures, Motions};

const PARTICLES: usize = 25;
const FRAMES: usize = 30;

fn measure(rest: &[[f64; 3]], motion: &[[f64; 3]], reference: &[[f64; 3]]) -> Result<Measures, MeasureError> {
    Motions { particles: PARTICLES, rest, motion, reference }.measure()
}

/// Two straight strands at rest.
fn rest() -> Vec<[f64; 3]> {
    (0..2 * PARTICLES).map(|i| [(i / PARTICLES) as f64, -((i % PARTICLES) as f64), 0.0]).collect()
}

/// The strands swaying by an amount that grows towards the tips, `late` frames late, `size` times.
fn swaying(size: f64, late: f64) -> Vec<[f64; 3]> {
    let frame = |t: usize| {
        let phase = (t as f64 - late) * std::f64::consts::TAU / 10.0;
        rest().into_iter().map(move |x| [x[0] - size * 0.1 * x[1] * phase.sin(), x[1], x[2]])
    };
    (0..FRAMES).flat_map(frame).collect()
}

#[test]
fn measures_are_the_golden_ones() {
    let file = load("net_7_measures");
    let [rest, motion, reference] = ["x_rest", "x", "x_reference"].map(|key| vectors(&file[key]));
    let found = measure(&rest, &motion, &reference).unwrap();
    for (found, key) in [
        (found.rmse, "rmse"),
        (found.ref_rms, "ref_rms"),
        (found.ref_dyn, "ref_dyn"),
        (found.motion_ratio, "motion_ratio"),
        (found.corr, "corr"),
        (found.corr_vel, "corr_vel"),
        (found.nrmse, "nrmse"),
        (found.nrmse_dyn, "nrmse_dyn"),
    ] {
        let expected = file["out"][key].as_f64().unwrap();
        assert!((found / expected - 1.0).abs() < 1e-9, "{key}: {found} {expected}");
    }
    // Narrow positions, wide sums.
    let narrow = |x: &[[f64; 3]]| -> Vec<[f32; 3]> { x.iter().map(|x| x.map(|c| c as f32)).collect() };
    let (rest, motion, reference) = (narrow(&rest), narrow(&motion), narrow(&reference));
    let rounded = Motions { particles: 25, rest: &rest, motion: &motion, reference: &reference };
    assert!((rounded.measure().unwrap().nrmse_dyn - found.nrmse_dyn).abs() < 1e-5);
}

#[test]
fn the_reference_itself_is_perfect() {
    let reference = swaying(1.0, 0.0);
    let found = measure(&rest(), &reference, &reference).unwrap();
    assert_eq!((found.nrmse, found.nrmse_dyn, found.motion_ratio), (0.0, 0.0, 1.0));
    assert!((found.corr - 1.0).abs() < 1e-12 && (found.corr_vel - 1.0).abs() < 1e-12);
}

#[test]
fn hair_at_rest_has_error_one_and_no_motion() {
    let still = swaying(0.0, 0.0);
    let found = measure(&rest(), &still, &swaying(1.0, 0.0)).unwrap();
    assert_eq!((found.nrmse, found.motion_ratio), (1.0, 0.0));
    assert!((found.nrmse_dyn - 1.0).abs() < 1e-12);
    assert_eq!((found.corr, found.corr_vel), (0.0, 0.0));
    // Where the reference does not move either, all agrees.
    let both = measure(&rest(), &still, &still).unwrap();
    assert_eq!((both.nrmse, both.nrmse_dyn, both.motion_ratio), (0.0, 0.0, 1.0));
    // Where it alone does not, the quotients are infinite.
    let found = measure(&rest(), &swaying(1.0, 0.0), &still).unwrap();
    assert_eq!((found.nrmse, found.motion_ratio), (f64::INFINITY, f64::INFINITY));
}

#[test]
fn size_and_delay_are_told_apart() {
    // Two periods are kept; a third as large again: error 1/3, in time.
    let large = measure(&rest(), &swaying(4.0 / 3.0, 0.0), &swaying(1.0, 0.0)).unwrap();
    for (found, expected) in [
        (large.nrmse, 1.0 / 3.0),
        (large.nrmse_dyn, 1.0 / 3.0),
        (large.motion_ratio, 4.0 / 3.0),
        (large.corr, 1.0),
        (large.corr_vel, 1.0),
    ] {
        assert!((found - expected).abs() < 1e-12, "{large:?}");
    }
    // A delay by an angle φ: correlation cos φ, error 2 sin(φ/2).
    let late = measure(&rest(), &swaying(1.0, 1.0), &swaying(1.0, 0.0)).unwrap();
    let angle = std::f64::consts::TAU / 10.0;
    assert!((late.corr - angle.cos()).abs() < 1e-12);
    assert!((late.nrmse_dyn - 2.0 * (angle / 2.0).sin()).abs() < 1e-12);
    assert!(late.corr_vel < 0.9);
}

#[test]
fn bad_motions_are_errors() {
    let (rest, good) = (rest(), swaying(1.0, 0.0));
    assert_eq!(
        measure(&rest[1..], &good, &good),
        Err(MeasureError::Rest { found: 49, particles: PARTICLES })
    );
    assert!(matches!(measure(&[], &good, &good), Err(MeasureError::Rest { .. })));
    assert!(matches!(measure(&rest, &good[50..], &good), Err(MeasureError::Frames { .. })));
    assert_eq!(measure(&rest, &good[..550], &good[..550]), Err(MeasureError::Short(11)));
    assert!(measure(&rest, &good[..600], &good[..600]).is_ok());
    let mut bad = good.clone();
    bad[3 * 50 + 27][1] = f64::NAN;
    assert_eq!(measure(&rest, &good, &bad), Err(MeasureError::Position { frame: 3, strand: 1 }));
}
