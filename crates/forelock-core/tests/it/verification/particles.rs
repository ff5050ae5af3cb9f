//! SPH against known results: neighbours by brute force, densities of a lattice, momentum, hair at
//! rest.

use crate::rig::{GRAVITY, Random, Rig, assert_one_hash, shake, tuft};
use forelock_core::interaction::sph::find_neighbours::{Neighbours, Particle, SearchReal};
use forelock_core::interaction::sph::push_particles;
use forelock_core::interaction::sph::{Fluid, Sph, SphParams};
use forelock_core::lane::Real;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::solver::{AmsParams, DftlParams, Solver};
use glam::DVec3;

/// A cloud of `count` particles in a cube of side 2, several to a strand, some in one place.
fn cloud<T: Real>(count: u32, random: &mut Random) -> Vec<Particle<T>> {
    let mut vector = || random.vector().to_array().map(|x| T::from(x).unwrap());
    let mut particles: Vec<Particle<T>> =
        (0..count).map(|number| Particle { x: vector(), u: vector(), number, strand: number / 7 }).collect();
    for pair in particles.chunks_exact_mut(31) {
        pair[30].x = pair[2].x;
    }
    particles
}

fn fluid<T: Real>(h: f64, params: &SphParams) -> Fluid<T> {
    Fluid::new(h, 1.0, params)
}

/// The numbers of the neighbours of particle `own`, nearest first, by looking at all.
fn brute_force<T: Real>(particles: &[Particle<T>], own: usize, h2: T, params: &SphParams) -> Vec<u32> {
    let own = &particles[own];
    let square = |other: &Particle<T>| {
        let d = [0, 1, 2].map(|c| other.x[c] - own.x[c]);
        d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    };
    let mut near: Vec<(T, u32)> = particles
        .iter()
        .filter(|other| other.number != own.number && (params.own_strand || other.strand != own.strand))
        .map(|other| (square(other), other.number))
        .filter(|(square, _)| *square < h2)
        .collect();
    near.sort_by(|a, b| a.partial_cmp(b).unwrap());
    near.iter().take(params.neighbours as usize).map(|(_, number)| *number).collect()
}

#[test]
fn neighbours_are_those_of_brute_force() {
    neighbours::<f64>(Simd::Scalar);
    for simd in Simd::ALL.into_iter().filter(|simd| simd.is_supported()) {
        neighbours::<f32>(simd);
    }
}

/// The case in which particles are far out, and nowhere.
const LOST: usize = 9;

fn neighbours<T: SearchReal>(simd: Simd) {
    let mut random = Random(7);
    let mut full = 0;
    for (n, (count, h, neighbours, own_strand)) in [
        (1, 0.5, 16, false),
        (2, 3.0, 1, true),
        (600, 0.2, 16, false),
        (600, 0.5, 16, true),
        (3000, 0.3, 5, false),
        (3000, 0.02, 64, true),
        (3000, 0.9, 16, false),
        (1500, 0.9, 64, true),
        (1500, 0.9, 1, false),
        (600, 0.9, 16, false),
    ]
    .into_iter()
    .enumerate()
    {
        let mut particles = cloud::<T>(count, &mut random);
        if n == LOST {
            // Cells far out, beyond all that have a number, and none.
            for (n, particle) in particles.iter_mut().enumerate() {
                let far = [0.0, 3e3, 1e12, f64::INFINITY, f64::NAN][n % 5];
                particle.x[n % 3] = particle.x[n % 3] + T::from(far).unwrap();
            }
        }
        let params = SphParams { neighbours, own_strand, ..SphParams::default() };
        let mut found = Neighbours::on(simd);
        let fluid = fluid::<T>(h, &params);
        // Twice: what the first left behind must not matter.
        found.find(&cloud(4000, &mut random), &fluid);
        found.find(&particles, &fluid);
        for own in 0..count as usize {
            let slot = found.slots[own] as usize;
            let near: Vec<u32> =
                found.near(slot, &fluid).iter().map(|&j| found.sorted[j as usize].number).collect();
            let expected = brute_force(&particles, own, fluid.h2, &params);
            assert_eq!(near, expected, "particle {own} of {count}, h = {h}");
            full += usize::from(near.len() == neighbours as usize);
        }
    }
    assert!(full > 1000, "{full} lists are full");
}

/// A lattice of spacing a has the density m/a³. The kernel's sum over it is within 2 % of that, and
/// the computed density is that sum.
#[test]
fn a_lattice_has_its_density() {
    let (side, spacing, h) = (12u32, 0.1, 0.235);
    let place = |k: u32| [k % side, k / side % side, k / (side * side)].map(|i| spacing * f64::from(i) - 0.3);
    let particles: Vec<Particle<f64>> = (0..side.pow(3))
        .map(|number| Particle { x: place(number), u: [0.0; 3], number, strand: number })
        .collect();
    let params = SphParams { neighbours: 64, ..SphParams::default() };
    let fluid = fluid(h, &params);
    let mut found = Neighbours::default();
    found.find(&particles, &fluid);
    // What is not near the lattice's faces.
    let inner = |x: &[f64; 3]| x.iter().all(|x| (x - 0.25).abs() < 0.56 - h);
    let mut seen = 0;
    for particle in particles.iter().filter(|particle| inner(&particle.x)) {
        let own = DVec3::from(particle.x);
        let sum: f64 = particles
            .iter()
            .map(|other| own.distance(other.x.into()))
            .filter(|r| *r < h)
            .map(|r| 315.0 / (64.0 * std::f64::consts::PI * h.powi(9)) * (h * h - r * r).powi(3))
            .sum();
        let density = found.density[found.slots[particle.number as usize] as usize];
        assert!((density / sum - 1.0).abs() < 1e-12, "{density} {sum}");
        assert!((density * spacing.powi(3) - 1.0).abs() < 0.02, "{}", density * spacing.powi(3));
        seen += 1;
    }
    assert!(seen > 100, "{seen}");
}

/// The sum of the accelerations of equal particles over the sum of their amounts.
fn momentum(particles: &[Particle<f64>], h: f64, params: &SphParams) -> f64 {
    let fluid = fluid(h, params).pushing(params.pressure, params.viscosity);
    let mut found = Neighbours::default();
    found.find(particles, &fluid);
    let lowest = found.density.iter().copied().fold(f64::INFINITY, f64::min);
    let (mut pressure, mut pushed) = (vec![0.0; particles.len()], vec![[0.0; 3]; particles.len()]);
    push_particles::push(&found, &vec![lowest; particles.len()], &fluid, &mut pressure, &mut pushed);
    let sum: DVec3 = pushed.iter().map(|&a| DVec3::from(a)).sum();
    sum.length() / pushed.iter().map(|&a| DVec3::from(a).length()).sum::<f64>()
}

#[test]
fn pairs_keep_momentum() {
    let particles = cloud(2000, &mut Random(3));
    for (pressure, viscosity) in [(1.0, 0.0), (0.0, 1.0), (0.7, 0.3)] {
        let params = SphParams { pressure, viscosity, own_strand: true, ..SphParams::default() };
        // Lists that are full, and such that hold all that is near.
        for h in [0.4, 0.15] {
            let off = momentum(&particles, h, &params);
            assert!(off < 1e-14, "h = {h}: {off}");
        }
        let one_sided = momentum(&particles, 0.4, &SphParams { mutual: false, ..params });
        println!("one-sided pairs are off by {one_sided:.1e} of all they give");
        assert!(one_sided > 1e-6, "{one_sided}");
    }
}

#[test]
fn a_groom_at_rest_feels_nothing() {
    for solver in [
        Solver::from(&DftlParams { sag_free: true, ..DftlParams::default() }),
        (&AmsParams::default()).into(),
    ] {
        let mut rig = Rig::<f64>::new(&tuft(50, 20), &solver, Simd::Auto);
        rig.simulation.set_sph(Some(&SphParams::default())).unwrap();
        let rest = rig.positions();
        rig.play(0.5, |_| Pose::IDENTITY);
        let off = crate::rig::largest(&rest, &rig.positions());
        assert!(off < 1e-9, "{off}");
    }
}

/// Hair that is pressed together comes apart, with either solver.
#[test]
fn pressure_gives_volume() {
    let spread = |solver: &Solver<f32>, pressure: Option<f64>| {
        let mut rig = Rig::<f32>::new(&tuft(60, 20), solver, Simd::Auto);
        let params = pressure.map(|pressure| SphParams { pressure, ..SphParams::default() });
        rig.simulation.set_sph(params.as_ref()).unwrap();
        rig.gravity = GRAVITY;
        rig.play(1.0, |_| Pose::IDENTITY);
        let tips: Vec<DVec3> = rig.positions().chunks(20).map(|strand| strand[19]).collect();
        let middle: DVec3 = tips.iter().sum::<DVec3>() / tips.len() as f64;
        (tips.iter().map(|tip| (*tip - middle).reject_from(DVec3::Y).length_squared()).sum::<f64>()
            / tips.len() as f64)
            .sqrt()
    };
    // A bundle that hangs together.
    for solver in [
        Solver::from(&DftlParams { shape_global: 0.0, shape_local: 0.0, ..DftlParams::default() }),
        (&AmsParams { k_integrity: 1.0, k_angular: 1.0, sag_free: false, ..AmsParams::default() }).into(),
    ] {
        let [without, with] = [None, Some(0.2)].map(|pressure| spread(&solver, pressure));
        println!("tips {without:.4} m from their middle without pressure, {with:.4} m with");
        assert!(with > 1.02 * without, "{without} {with}");
    }
}

#[test]
fn threads_and_widths_leave_the_bits_alone() {
    assert_one_hash(|simd| {
        let mut rig = Rig::<f32>::new(&tuft(200, 20), &AmsParams::default(), simd);
        rig.simulation.set_sph(Some(&SphParams::default())).unwrap();
        rig.play(0.2, |t| shake(3.0, 3.0, t));
        rig.simulation.state_hash()
    });
}

#[test]
fn a_smoothing_length_finds_its_neighbours() {
    let rig = Rig::<f64>::new(&tuft(400, 20), &AmsParams::default(), Simd::Auto);
    let params = SphParams::default();
    let sph = Sph::new(rig.simulation.model(), &params, Simd::Auto);
    let mean = sph.rest_density().iter().sum::<f64>() / sph.rest_density().len() as f64;
    assert!((mean - 1.0).abs() < 1e-12, "{mean}");
    let particles: Vec<Particle<f64>> = (0..)
        .zip(rig.positions())
        .map(|(number, x)| Particle { x: x.to_array(), u: [0.0; 3], number, strand: number / 20 })
        .collect();
    let mut found = Neighbours::default();
    found.find(&particles, sph.fluid());
    let full = found.counts.iter().filter(|&&count| count == params.neighbours).count();
    let share = full as f64 / found.counts.len() as f64;
    println!("{:.0} % have all their neighbours within {:.1} mm", 100.0 * share, 1e3 * sph.fluid().h);
    assert!((0.35..0.65).contains(&share), "{share}");
}
