use super::*;
use crate::frame::{Air, FrameInput};
use crate::groom::Groom;
use crate::lane::Simd;
use crate::pose::Pose;
use crate::simulation::{Options, Simulation};
use crate::strands::Snapshot;

/// Splitmix: numbers from −1 to 1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

fn straight(n: usize) -> Vec<DVec3> {
    (0..n).map(|i| DVec3::new(0.0, -0.01 * i as f64, 0.0)).collect()
}

/// A walk of edges of 1 cm that bend by up to some 60°.
fn walk(n: usize, noise: &mut Noise) -> Vec<DVec3> {
    let (mut x, mut along) = (DVec3::ZERO, DVec3::X);
    (0..n)
        .map(|_| {
            along = (along + noise.vector()).normalize();
            x += 0.01 * along;
            x
        })
        .collect()
}

fn chain(points: &[DVec3], offset: f64) -> Vec<DVec3> {
    let positions: Vec<[f64; 3]> = points.iter().map(|p| p.to_array()).collect();
    let offsets = [0, positions.len() as u32];
    let strands = Strands::new(&positions, &offsets);
    let chain = with_virtual_particles(&strands, offset);
    assert_eq!(chain.len(), 2 * points.len() - 1);
    chain.into_iter().map(DVec3::from).collect()
}

fn volume(p: &[DVec3]) -> f64 {
    (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) / 6.0
}

#[test]
fn a_straight_strand_winds_evenly_by_quarter_turns() {
    let chain = chain(&straight(12), 0.25);
    for (k, p) in chain.iter().enumerate() {
        let axis = DVec3::new(0.0, -0.005 * k as f64, 0.0);
        let off = if k % 2 == 1 { 0.0025 } else { 0.0 };
        assert!((p.distance(axis) - off).abs() < 1e-15, "{k}: {p}");
    }
    let volumes: Vec<f64> = chain.windows(4).map(volume).collect();
    assert!(volumes.iter().all(|v| (v - volumes[0]).abs() < 1e-6 * volumes[0].abs()), "{volumes:?}");
    assert!((volumes[0].abs() - 0.01 * 0.0025 * 0.0025 / 6.0).abs() < 1e-15, "{volumes:?}");
}

#[test]
fn no_tetrahedron_of_a_crooked_strand_is_flat() {
    let mut noise = Noise(7);
    for _ in 0..200 {
        let points = walk(20, &mut noise);
        for (i, p) in chain(&points, 0.25).windows(4).enumerate() {
            let largest = p.iter().flat_map(|a| p.iter().map(|b| a.distance(*b))).fold(0.0, f64::max);
            let flatness = 6.0 * volume(p).abs() / largest.powi(3);
            assert!(flatness > 2e-3, "tetrahedron {i}: {flatness:e}");
        }
    }
}

#[test]
fn output_positions_are_those_of_the_groom() {
    let strands: Vec<Vec<glam::Vec3>> = [5, 2, 9]
        .map(|n| straight(n).iter().map(|p| p.as_vec3() + glam::Vec3::X * n as f32).collect())
        .into();
    let groom = Groom::from_strands(strands).unwrap();
    let mut simulation = Simulation::new(&groom, &MassSpringParams::default(), &Options::default()).unwrap();
    assert_eq!((simulation.model().particle_count, simulation.solver().rules().clamped), (9 + 3 + 17, 3));
    let mut positions = Vec::new();
    simulation.positions(&mut positions);
    for (x, y) in positions.iter().zip(groom.positions()) {
        assert!(x.distance(*y) < 1e-6, "{x} {y}");
    }
    assert_eq!(positions.len(), groom.particle_count());
    // A restored chain repeats its steps bit for bit.
    let step = |simulation: &mut Simulation| {
        simulation.step_frame(&frame(DVec3::NEG_Z * 9.81, 1.0 / 60.0)).unwrap();
        simulation.state_hash()
    };
    let snapshot = simulation.snapshot();
    let (first, second) = (step(&mut simulation), step(&mut simulation));
    simulation.restore(&snapshot).unwrap();
    assert_eq!((step(&mut simulation), step(&mut simulation)), (first, second));
}

#[test]
fn parameters_out_of_range_are_refused() {
    for (params, name) in [
        (MassSpringParams { virtual_offset: 0.0, ..Default::default() }, "virtual_offset"),
        (MassSpringParams { virtual_offset: f64::NAN, ..Default::default() }, "virtual_offset"),
        (MassSpringParams { clamped: 0, ..Default::default() }, "clamped"),
        (MassSpringParams { k_altitude: -1.0, ..Default::default() }, "k_altitude"),
    ] {
        let error = params.validate().unwrap_err();
        assert!(matches!(error, ParamsError::Range { name: found, .. } if found == name), "{error}");
    }
    assert!(MassSpringParams { clamped: 1000, ..Default::default() }.validate().is_ok());
}

fn frame(gravity: DVec3, dt_secs: f64) -> FrameInput<'static> {
    let (head, air_velocity) = ([Pose::IDENTITY; 2], DVec3::ZERO);
    FrameInput {
        roots: head.into(),
        gravity,
        air: Air::uniform(air_velocity),
        dt_secs,
        ..FrameInput::default()
    }
}

const H: f64 = 1.0 / 240.0;

/// The velocities of a chain, with all particles but the root free, after one substep from
/// positions `x` and `velocities`, without the length pass.
fn substep(rest: &[DVec3], x: &[DVec3], velocities: &[f64], params: &AmsParams) -> Vec<f64> {
    let positions: Vec<[f64; 3]> = rest.iter().map(|p| p.to_array()).collect();
    let offsets = [0, positions.len() as u32];
    let strands = Strands::new(&positions, &offsets);
    let options = Options { simd: Simd::Scalar, ..Options::default() };
    let params = AmsParams { inextensibility: Inextensibility::Off, ..params.clone() };
    let mut simulation = Simulation::from_strands(&strands, &params, &options).unwrap();
    let origin = DVec3::from(simulation.model().centre);
    let snapshot = Snapshot {
        positions: x.iter().map(|p| (*p - origin).to_array()).collect(),
        velocities: velocities.as_chunks::<3>().0.to_vec(),
        ..simulation.snapshot()
    };
    simulation.restore(&snapshot).unwrap();
    simulation.step_frame(&frame(DVec3::ZERO, H)).unwrap();
    simulation.snapshot().velocities.as_flattened().to_vec()
}

/// Height along the shortest of the seven altitudes of the tetrahedron `p`, and the number of its
/// features: 0 to 3 for a point and the opposite face, 4 to 6 for two lines. `of` selects the
/// features instead.
fn height(p: &[DVec3], of: Option<usize>) -> (f64, usize) {
    let normals = [
        (p[2] - p[1]).cross(p[3] - p[1]),
        (p[3] - p[0]).cross(p[2] - p[0]),
        (p[1] - p[0]).cross(p[3] - p[0]),
        (p[2] - p[0]).cross(p[1] - p[0]),
        (p[1] - p[0]).cross(p[3] - p[2]),
        (p[2] - p[0]).cross(p[1] - p[3]),
        (p[3] - p[0]).cross(p[2] - p[1]),
    ];
    let largest = (0..7).max_by(|&a, &b| normals[a].length().total_cmp(&normals[b].length()));
    let feature = of.or(largest).unwrap_or(0);
    (6.0 * volume(p) / normals[feature].length(), feature)
}

/// h κ (height − rest height) and the height's gradient by central differences, over the twelve
/// coordinates.
fn altitude(rest: &[DVec3], x: &[DVec3], kappa: f64) -> (f64, [f64; 12]) {
    let (now, feature) = height(x, None);
    let (then, _) = height(rest, Some(feature));
    let mut gradient = [0.0; 12];
    for (c, slope) in gradient.iter_mut().enumerate() {
        let moved = |by: f64| {
            let mut p = x.to_vec();
            p[c / 3][c % 3] += by;
            height(&p, Some(feature)).0
        };
        *slope = (moved(1e-7) - moved(-1e-7)) / 2e-7;
    }
    (H * kappa * (now - then), gradient)
}

/// The substep solves A v = b, where A and b are built from the altitudes' energies by finite
/// differences. The springs conserve momentum.
#[test]
fn altitude_springs_solve_the_system_of_their_energy() {
    let mut noise = Noise(11);
    for _ in 0..20 {
        let rest: Vec<DVec3> = chain(&walk(4, &mut noise), 0.25);
        let x: Vec<DVec3> = rest.iter().map(|p| *p + 0.001 * noise.vector()).collect();
        let size = 3 * rest.len();
        let v: Vec<f64> = (0..size).map(|i| if i < 3 { 0.0 } else { noise.next() }).collect();
        let kappa = 1e5;
        let params = AmsParams {
            k_edge: 0.0,
            k_bend: 0.0,
            k_torsion: 0.0,
            drag: 0.0,
            substep_secs: 1.0,
            ..MassSpringParams { k_altitude: kappa, clamped: 1, ..Default::default() }.ams()
        };
        let after = substep(&rest, &x, &v, &params);
        // r = v' + Σ g (h² κ g·v' + h κ (height − rest)) − v: zero in every row that is not
        // clamped.
        let mut residual: Vec<f64> = after.iter().zip(&v).map(|(a, b)| a - b).collect();
        for (i, (rest, x)) in rest.windows(4).zip(x.windows(4)).enumerate() {
            let (push, gradient) = altitude(rest, x, kappa);
            let moving: f64 = gradient.iter().zip(&after[3 * i..]).map(|(g, v)| g * v).sum();
            for (r, g) in residual[3 * i..].iter_mut().zip(gradient) {
                *r += g * (push + H * H * kappa * moving);
            }
            for c in 0..3 {
                let sum: f64 = gradient.iter().skip(c).step_by(3).sum();
                assert!(sum.abs() < 1e-6, "momentum: {sum}");
            }
        }
        let worst = residual[3..].iter().fold(0.0, |m: f64, r| m.max(r.abs()));
        let speed = after.iter().fold(0.0, |m: f64, r| m.max(r.abs()));
        assert!(worst < 1e-5 * speed, "{worst:e} of {speed}");
    }
}

/// A⁻¹, the derivative of the velocities after a substep with respect to those before, is symmetric
/// with eigenvalues in (0, 1].
#[test]
fn the_system_is_symmetric_positive_definite() {
    let mut noise = Noise(3);
    let rest = chain(&walk(4, &mut noise), 0.25);
    let x: Vec<DVec3> = rest.iter().map(|p| *p + 0.002 * noise.vector()).collect();
    let params = AmsParams {
        drag: 0.0,
        substep_secs: 1.0,
        ..MassSpringParams { clamped: 1, ..Default::default() }.ams()
    };
    let size = 3 * rest.len();
    let still = substep(&rest, &x, &vec![0.0; size], &params);
    let columns: Vec<Vec<f64>> = (3..size)
        .map(|c| {
            let mut v = vec![0.0; size];
            v[c] = 1.0;
            substep(&rest, &x, &v, &params).iter().zip(&still).skip(3).map(|(a, b)| a - b).collect()
        })
        .collect();
    for (i, column) in columns.iter().enumerate() {
        for (j, value) in column.iter().enumerate() {
            assert!((value - columns[j][i]).abs() < 1e-9, "{i} {j}");
        }
    }
    assert!(is_positive(columns.clone()), "A⁻¹ is positive definite");
    let mut rest_of_one = columns;
    for (i, column) in rest_of_one.iter_mut().enumerate() {
        column.iter_mut().for_each(|value| *value = -*value);
        column[i] += 1.0 + 1e-9;
    }
    assert!(is_positive(rest_of_one.clone()), "no eigenvalue of A⁻¹ is over 1");
    rest_of_one[0][0] -= 2.0;
    assert!(!is_positive(rest_of_one));
}

/// Whether Cholesky's factorisation of a symmetric matrix exists.
fn is_positive(mut a: Vec<Vec<f64>>) -> bool {
    for k in 0..a.len() {
        if a[k][k] <= 0.0 {
            return false;
        }
        let (done, below) = a.split_at_mut(k + 1);
        let pivot = &done[k];
        for row in below {
            let factor = row[k] / pivot[k];
            for (x, upper) in row[k..].iter_mut().zip(&pivot[k..]) {
                *x -= factor * upper;
            }
        }
    }
    true
}

/// A tetrahedron that was inverted returns to its orientation with altitude springs, and stays
/// inverted without them.
#[test]
fn altitude_springs_restore_an_inverted_tetrahedron() {
    let rest = vec![
        DVec3::ZERO,
        DVec3::new(0.01, 0.0, 0.0),
        DVec3::new(0.0, 0.01, 0.0),
        DVec3::new(0.003, 0.003, 0.008),
    ];
    let mut inverted = rest.clone();
    inverted[3].z = -0.002;
    let side = |k_altitude: f64| {
        let params = MassSpringParams { k_altitude, clamped: 1, drag: 20.0, ..Default::default() };
        let (mut x, mut v) = (inverted.clone(), vec![0.0; 12]);
        let params = AmsParams { substep_secs: 1.0, ..params.ams() };
        for _ in 0..2000 {
            v = substep(&rest, &x, &v, &params);
            for (x, v) in x.iter_mut().zip(v.as_chunks::<3>().0) {
                *x += H * DVec3::from(*v);
            }
        }
        volume(&x) / volume(&rest)
    };
    let (with, without) = (side(1e6), side(0.0));
    assert!((with - 1.0).abs() < 0.05, "{with}");
    assert!((without + 1.0).abs() < 0.05, "{without}");
}
