//! A strand or some on a head that moves: the bench on which the other modules measure. SI units.

use forelock_core::body::ColliderFrame;
use forelock_core::frame::{Acceleration, Air, FrameInput, FrameReport};
use forelock_core::lane::Real;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::SimulationReal;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::ams::{AngularForm, Inextensibility};
use forelock_core::solver::{AmsParams, Solver};
use forelock_core::strands::Snapshot;
use forelock_core::strands::Strands;
use glam::{DQuat, DVec3, Vec3};
use std::f64::consts::TAU;

/// Standard gravity of these scenes, m/s².
pub const G: f64 = 9.81;
/// The same as a vector.
pub const GRAVITY: DVec3 = DVec3::new(0.0, -G, 0.0);
/// A frame, seconds.
pub const DT: f64 = 1.0 / 60.0;
/// Length of [`helix`], metres.
pub const LENGTH: f64 = 0.3;

/// A strand: its particles, root first.
pub type Strand = Vec<[f64; 3]>;

/// The design's strand: a hanging helix of `n` particles and [`LENGTH`] along its edges, radius 1
/// cm, three turns.
pub fn helix(n: usize) -> Strand {
    let segments = (n - 1) as f64;
    let (radius, turn) = (0.01, 3.0 * TAU / segments);
    let edge = LENGTH / segments;
    let across = 2.0 * radius * (0.5 * turn).sin();
    let down = (edge * edge - across * across).sqrt();
    let point = |i: usize| {
        let (angle, depth) = (turn * i as f64, down * i as f64);
        [radius * angle.cos(), -depth, radius * angle.sin()]
    };
    (0..n).map(point).collect()
}

/// `count` different strands of `n` particles on a ring of roots.
pub fn tuft(count: usize, n: usize) -> Vec<Strand> {
    let place = |s: usize| {
        let angle = 2.4 * s as f64;
        let turned = DQuat::from_rotation_y(angle) * DQuat::from_rotation_z(0.02 * (s % 50) as f64);
        let root = DVec3::new(0.05 * angle.cos(), 0.001 * s as f64, 0.05 * angle.sin());
        helix(n).iter().map(|&p| (root + turned * DVec3::from(p)).to_array()).collect()
    };
    (0..count).map(place).collect()
}

/// No springs, no ties, no drag, no length pass: particles that know of nothing but gravity.
pub fn bare() -> AmsParams {
    AmsParams {
        k_edge: 0.0,
        k_bend: 0.0,
        k_torsion: 0.0,
        k_integrity: 0.0,
        k_angular: 0.0,
        drag: 0.0,
        clamped: 1,
        angular: AngularForm::Off,
        sag_free: false,
        inextensibility: Inextensibility::Off,
        ..AmsParams::default()
    }
}

/// A shake along x and a little along z, with a peak acceleration of `gs` times gravity. It starts
/// and ends (after whole periods) at rest.
pub fn shake(gs: f64, hertz: f64, t: f64) -> Pose {
    let omega = TAU * hertz;
    let reach = gs * G / (omega * omega) * (1.0 - (omega * t).cos());
    Pose::new(DQuat::IDENTITY, DVec3::new(0.96 * reach, 0.0, 0.28 * reach))
}

/// The float32 instantiations that this processor runs.
pub fn simds() -> impl Iterator<Item = Simd> {
    Simd::ALL.into_iter().filter(|s| s.is_supported())
}

/// Stiffness of each strand and mass of each particle, where they are not 1.
#[derive(Clone, Copy, Default)]
pub struct Varied<'a> {
    pub stiffness: Option<&'a [f32]>,
    pub masses: Option<&'a [f32]>,
}

/// A simulation and the scene around it.
pub struct Rig<T: SimulationReal> {
    pub simulation: Simulation<T>,
    pub head: Pose,
    pub gravity: DVec3,
    pub air: DVec3,
    /// Acceleration of each particle in addition to gravity; empty: none.
    pub acceleration: Vec<Vec3>,
    pub dt: f64,
}

impl<T: SimulationReal> Rig<T> {
    /// `strands` at rest under [`GRAVITY`], the head at the origin.
    pub fn new(strands: &[Strand], params: impl Into<Solver<T>>, simd: Simd) -> Self {
        Self::with_options(strands, params, &Options { simd, rest_gravity: GRAVITY, ..Options::default() })
    }

    /// `strands` at rest as `options` has it.
    pub fn with_options(strands: &[Strand], params: impl Into<Solver<T>>, options: &Options) -> Self {
        Self::varied(strands, Varied::default(), params, options)
    }

    /// The same with strands and particles that differ.
    pub fn varied(
        strands: &[Strand],
        varied: Varied<'_>,
        params: impl Into<Solver<T>>,
        options: &Options,
    ) -> Self {
        let positions: Vec<[T; 3]> = strands.iter().flatten().map(|&p| p.map(real)).collect();
        let mut offsets = vec![0u32];
        offsets.extend(strands.iter().scan(0, |sum, s| {
            *sum += s.len() as u32;
            Some(*sum)
        }));
        let Varied { stiffness, masses } = varied;
        let strands = Strands { stiffness, masses, ..Strands::new(&positions, &offsets) };
        Self {
            simulation: Simulation::from_strands(&strands, params, options).unwrap(),
            head: options.rest_pose,
            gravity: options.rest_gravity,
            air: DVec3::ZERO,
            acceleration: Vec::new(),
            dt: DT,
        }
    }

    /// A frame in which the head goes to `to`.
    pub fn step(&mut self, to: Pose) -> FrameReport {
        self.step_among(to, &[])
    }

    /// The same among solids.
    pub fn step_among(&mut self, to: Pose, colliders: &[ColliderFrame<'_>]) -> FrameReport {
        let head = [self.head, to];
        let (gravity, air_velocity, dt_secs) = (self.gravity, self.air, self.dt);
        self.head = to;
        let acceleration = if self.acceleration.is_empty() {
            Acceleration::None
        } else {
            Acceleration::PerParticle(&self.acceleration)
        };
        self.simulation
            .step_frame(&FrameInput {
                roots: head.into(),
                colliders,
                gravity,
                air: Air::uniform(air_velocity),
                acceleration,
                dt_secs,
            })
            .unwrap()
    }

    /// `secs` of the head's `motion` from time 0.
    pub fn play(&mut self, secs: f64, motion: impl Fn(f64) -> Pose) {
        for frame in 1..=(secs / self.dt).round() as u32 {
            self.step(motion(f64::from(frame) * self.dt));
        }
    }

    /// Positions in the world.
    pub fn positions(&self) -> Vec<DVec3> {
        let snapshot = self.simulation.snapshot();
        snapshot.positions.iter().map(|&x| DVec3::from(snapshot.origin) + vector(x)).collect()
    }

    /// Velocities in the world.
    pub fn velocities(&self) -> Vec<DVec3> {
        self.simulation.snapshot().velocities.iter().map(|&v| vector(v)).collect()
    }

    /// Changes the state by hand.
    pub fn edit(&mut self, change: impl FnOnce(&mut Snapshot<T>)) {
        let mut snapshot = self.simulation.snapshot();
        change(&mut snapshot);
        self.simulation.restore(&snapshot).unwrap();
    }

    /// Largest acceleration of a particle from frame to frame, over gravity, with the head held for
    /// `secs`.
    pub fn jitter(&mut self, secs: f64) -> f64 {
        let mut worst = 0.0;
        for _ in 0..(secs / self.dt).round() as u32 {
            let before = self.velocities();
            self.step(self.head);
            worst = largest(&before, &self.velocities()).max(worst);
        }
        worst / self.dt / G
    }
}

/// Largest distance between corresponding points; NaN counts as infinite.
pub fn largest(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (*a - *b).length()).fold(0.0, |m, d| {
        if d <= m {
            m
        } else if d.is_nan() {
            f64::INFINITY
        } else {
            d
        }
    })
}

pub fn real<T: Real>(x: f64) -> T {
    T::from(x).unwrap()
}

pub fn vector<T: Real>(x: [T; 3]) -> DVec3 {
    DVec3::from(x.map(|c| c.to_f64().unwrap()))
}

/// A small generator of numbers in −1…1: the same on every machine.
pub struct Random(pub u64);

impl Random {
    pub fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.number(), self.number(), self.number())
    }
}

/// Whether a hash is the same for one, two and three threads, and for all SIMD widths with the same
/// rounding. `hash` runs in a pool of its own.
pub fn assert_one_hash(hash: impl Fn(Simd) -> u64 + Sync) {
    let of = |threads: usize, simd: Simd| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| hash(simd))
    };
    let one = of(1, Simd::Auto);
    assert_eq!([of(2, Simd::Auto), of(3, Simd::Auto)], [one; 2], "threads");
    for fused in [false, true] {
        let is_fused = |s: &Simd| !matches!(s, Simd::Scalar | Simd::Portable);
        let hashes: Vec<_> = simds().filter(|s| is_fused(s) == fused).map(|s| (s, of(1, s))).collect();
        assert!(hashes.windows(2).all(|h| h[0].1 == h[1].1), "widths: {hashes:x?}");
    }
}
