use super::*;
use crate::body::{ColliderFrame, Shape};
use crate::lane::Row;
use crate::pose::Pose;
use crate::strands::{Model, Strands};

fn windy() -> WindParams {
    WindParams {
        velocity: DVec3::new(4.0, 0.0, 3.0),
        gust_strength: 0.25,
        turbulence: 0.2,
        turbulence_scale: 0.4,
        ..WindParams::default()
    }
}

/// Points of an irrational lattice in the cube of half side `half`.
fn points(count: u32, half: f64) -> impl Iterator<Item = DVec3> {
    (1..=count).map(move |i| {
        let at = |step: f64| (f64::from(i) * step).fract() * 2.0 - 1.0;
        DVec3::new(at(0.819_172_513), at(0.671_043_607), at(0.549_700_478)) * half
    })
}

#[test]
fn turbulence_is_free_of_divergence() {
    let field = Wind::new(&windy()).unwrap().at(1.3);
    let h = 1e-5;
    let (mut divergence, mut slope) = (0.0f64, 0.0f64);
    for p in points(2000, 2.0) {
        let rise =
            DVec3::AXES.map(|axis| (field.velocity(p + axis * h) - field.velocity(p - axis * h)) / (2.0 * h));
        divergence = divergence.max((rise[0].x + rise[1].y + rise[2].z).abs());
        slope = slope.max(rise[0].length());
    }
    // The remainder is the error of central differences for waves of 15 turns per metre, (2π 15
    // h)²/6 = 1.5e-7.
    assert!(slope > 5.0 && divergence < 2e-7 * slope, "{divergence} of {slope}");
}

#[test]
fn turbulence_has_the_requested_mean_and_variance() {
    for seed in 0..8 {
        let params = WindParams { seed, gust_strength: 0.0, ..windy() };
        let field = Wind::new(&params).unwrap().at(0.0);
        let count = 20_000;
        let (mut sum, mut squares) = (DVec3::ZERO, DVec3::ZERO);
        // Fifty wavelengths: the mean of the waves over the finite box is below one percent.
        for p in points(count, 20.0) {
            let u = field.velocity(p) - params.velocity;
            sum += u / f64::from(count);
            squares += u * u / f64::from(count);
        }
        let asked = 0.2 * 5.0;
        assert!(sum.length() < 0.05 * asked, "{sum}");
        let total = (squares.element_sum() / 3.0).sqrt();
        assert!((total / asked - 1.0).abs() < 0.02, "{total}");
        // The sixteen directions are not perfectly isotropic.
        for rms in squares.to_array().map(f64::sqrt) {
            assert!((rms / asked - 1.0).abs() < 0.35, "{squares}");
        }
    }
}

#[test]
fn gusts_have_the_requested_mean_and_variance() {
    for seed in 0..8 {
        let params = WindParams { seed, ..windy() };
        let wind = Wind::new(&params).unwrap();
        let count = 20_000;
        let (mut mean, mut square) = (0.0, 0.0);
        for i in 0..count {
            let share = wind.at(f64::from(i) * 0.1).mean.length() / 5.0;
            mean += share / f64::from(count);
            square += (share - 1.0).powi(2) / f64::from(count);
        }
        assert!((mean - 1.0).abs() < 0.01, "{mean}");
        assert!((square.sqrt() - 0.25).abs() < 0.01, "{}", square.sqrt());
    }
    // The gusts are smooth: the wind does not jump within a millisecond.
    let wind = Wind::new(&windy()).unwrap();
    for i in 0..5000 {
        let [a, b] = [i, i + 1].map(|i| wind.at(f64::from(i) * 1e-3).mean);
        assert!((a - b).length() < 0.02 * 5.0);
    }
}

#[test]
fn the_mean_wind_advects_the_turbulence() {
    let params = WindParams { gust_strength: 0.0, ..windy() };
    let wind = Wind::new(&params).unwrap();
    let (now, later) = (wind.at(0.2), wind.at(0.7));
    for p in points(50, 1.0) {
        let carried = p + params.velocity * 0.5;
        assert!((now.velocity(p) - later.velocity(carried)).length() < 1e-9);
    }
    let other = Wind::new(&WindParams { seed: 1, ..params }).unwrap();
    assert!((other.at(0.2).velocity(DVec3::ZERO) - now.velocity(DVec3::ZERO)).length() > 1e-2);
}

#[test]
fn a_sphere_shelters_its_lee_only() {
    let (origin, radius) = (DVec3::new(100.0, 2.0, -30.0), 0.08);
    let shape = Shape::Sphere { radius };
    let place = Pose { translation: origin, ..Pose::IDENTITY };
    let ball = ColliderFrame { shape: &shape, local: Pose::IDENTITY, from: place, to: place, friction: 0.0 };
    for along in [DVec3::X, DVec3::new(1.0, -2.0, 0.5).normalize()] {
        let mut wake = Wake::default();
        wake.update(&[ball], origin, 0.5, along * 3.0);
        let across = along.any_orthonormal_vector();
        let deficit = |s: f64, r: f64| wake.deficit((along * s + across * r).as_vec3().to_array());
        // On the axis the deficit falls monotonically.
        assert!(deficit(1.5 * radius, 0.0) > 0.6, "{}", deficit(1.5 * radius, 0.0));
        let falling = [1.5, 2.0, 3.0, 4.0, 5.0].map(|s| deficit(s * radius, 0.0));
        assert!(falling.windows(2).all(|w| w[1] < w[0] && w[1] > 0.05), "{falling:?}");
        // There is none upwind, beside the sphere and far off the axis.
        for (s, r) in [(-2.0, 0.0), (-4.0, 0.5), (0.0, 2.2), (0.0, -3.0), (3.0, 4.5), (-9.0, 9.0)] {
            let d = deficit(s * radius, r * radius);
            assert!(d < 0.02, "{s} {r}: {d}");
        }
        // The wake is the same on all sides of the axis.
        let around = along.cross(across);
        let other = wake.deficit((along * 0.2 + around * 0.05).as_vec3().to_array());
        assert!((other - deficit(0.2, 0.05)).abs() < 0.05);
    }
    let mut none = Wake::default();
    none.update(&[], origin, 0.5, DVec3::X);
    assert_eq!(none.deficit([0.1; 3]), 0.0);
}

#[test]
fn parameters_out_of_range_are_named() {
    let wrong = [
        (WindParams { gust_strength: 1.5, ..windy() }, "gust_strength"),
        (WindParams { turbulence: -0.1, ..windy() }, "turbulence"),
        (WindParams { turbulence_scale: 0.0, ..windy() }, "turbulence_scale"),
        (WindParams { hair_depth: -0.01, ..windy() }, "hair_depth"),
        (WindParams { gust_period_secs: f64::NAN, ..windy() }, "gust_period_secs"),
        (WindParams { shelter: 2.0, ..windy() }, "shelter"),
        (WindParams { velocity: DVec3::splat(f64::INFINITY), ..windy() }, "velocity"),
    ];
    for (params, name) in wrong {
        let found = Wind::new(&params).unwrap_err();
        assert!(matches!(found, ParamsError::Range { name: n, .. } if n == name), "{found}");
    }
}

/// A block of straight vertical strands at random positions in x and z, as positions and offsets;
/// `sides` in metres.
fn block_of_hair(sides: DVec3, strands: u32) -> (Vec<[f32; 3]>, Vec<u32>) {
    let particles = 21;
    let roots = points(strands, 0.5).map(|root| root * sides);
    let along = |root: DVec3| {
        (0..particles).map(move |i| {
            let y = sides.y * (0.5 - f64::from(i) / f64::from(particles - 1));
            DVec3::new(root.x, y, root.z).as_vec3().to_array()
        })
    };
    (roots.flat_map(along).collect(), (0..=strands).map(|strand| strand * particles).collect())
}

#[test]
fn wind_falls_exponentially_in_hair_of_rest_density() {
    let sides = DVec3::new(0.2, 0.16, 0.08);
    let (positions, offsets) = block_of_hair(sides, 24_000);
    let model = Model::new(&Strands::new(&positions, &offsets)).unwrap();
    let shift = DVec3::new(0.3, -0.2, 0.1);
    let mut canopy = Canopy::default();
    let depth = 0.08;
    for wind in [DVec3::Z, DVec3::new(0.0, 0.0, -7.0)] {
        canopy.update(&model, &PlacedHair { positions: &model.rest, shift }, wind, depth);
        let mean = |z: f64| {
            let open = points(400, 1.0).map(|p| {
                let at = DVec3::new(0.3 * sides.x * p.x, 0.3 * sides.y * p.y, z * wind.z.signum()) + shift;
                f64::from(canopy.open(at.as_vec3().to_array()))
            });
            open.sum::<f64>() / 400.0
        };
        // From the upwind side to the downwind side in steps of 8 mm; cells are 7 mm wide.
        for step in 0..=10 {
            let inside = 0.008 * f64::from(step);
            let (open, expected) = (mean(inside - 0.5 * sides.z), (-inside / depth).exp());
            // The surface of the hair is blurred over a cell.
            let near = if step == 0 { 0.06 } else { 0.05 * expected };
            println!("{inside:.3} m deep: {open:.4}, closed form {expected:.4}");
            assert!((open - expected).abs() < near, "{inside} m deep: {open} instead of {expected}");
        }
        let before = mean(-0.5 * sides.z - 0.01);
        let behind = mean(0.5 * sides.z + 0.01);
        assert!(
            before > 1.0 - 1e-6 && (behind / (-sides.z / depth).exp() - 1.0).abs() < 0.05,
            "{before}, {behind}"
        );
    }
    // Beside the hair, without wind, and with half the rest density.
    let beside = shift + DVec3::new(0.12, 0.0, 0.2);
    assert_eq!(canopy.open(beside.as_vec3().to_array()), 1.0);
    let twice: Vec<_> = model.rest.iter().map(|row| Row(row.0.map(|x| x * 2f32.cbrt()))).collect();
    canopy.update(&model, &PlacedHair { positions: &twice, shift: DVec3::ZERO }, DVec3::Z, depth);
    let behind = f64::from(canopy.open([0.01, 0.02, 0.08]));
    // Half the density over a distance longer by the cube root of 2.
    let expected = (-0.5 * sides.z * 2f64.cbrt() / depth).exp();
    assert!((behind / expected - 1.0).abs() < 0.08, "{behind} instead of {expected}");
    canopy.update(&model, &PlacedHair { positions: &model.rest, shift }, DVec3::ZERO, depth);
    assert_eq!(canopy.open(shift.as_vec3().to_array()), 1.0);
}
