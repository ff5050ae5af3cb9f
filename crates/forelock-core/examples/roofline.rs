//! The strand solve beside what the machine can do: operations counted, not estimated.
//!
//! `cargo run --release -p forelock-core --example roofline`
//!
//! The solver runs once with a lane type that counts its arithmetic, and is then timed with the
//! widest registers. The peak is a loop of independent fused multiply–adds in the same registers on
//! one core.

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use bytemuck::{Pod, Zeroable};
use forelock_core::frame::{FrameInput, RestMotion};
use forelock_core::lane::Simd;
use forelock_core::lane::peak::multiply_adds_per_sec;
use forelock_core::lane::{LANES, Lane, Row, V3};
use forelock_core::params::parts;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use forelock_core::solver::ams::Inextensibility;
use forelock_core::solver::ams::solve_strands::{self, FrameTerms, SubstepTerms};
use forelock_core::strands::Strands;
use forelock_core::strands::{BlockChannels, BlockView, Scratch};
use glam::DVec3;
use std::cell::Cell;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

const STRANDS: usize = 10_298;
const PARTICLES: usize = 30;
const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

thread_local! {
    static OPERATIONS: Cell<u64> = const { Cell::new(0) };
}

/// A float64 lane that counts additions, multiplications, divisions and roots.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(transparent)]
struct Counted(f64);

fn counted(operations: u64, value: f64) -> Counted {
    OPERATIONS.with(|n| n.set(n.get() + operations));
    Counted(value)
}

macro_rules! operator {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl $trait for Counted {
            type Output = Self;
            fn $method(self, rhs: Self) -> Self {
                counted(1, self.0 $op rhs.0)
            }
        }
    )*};
}
operator!(Add add +, Sub sub -, Mul mul *, Div div /);

impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl AddAssign for Counted {
    fn add_assign(&mut self, rhs: Self) {
        *self = *self + rhs;
    }
}

impl SubAssign for Counted {
    fn sub_assign(&mut self, rhs: Self) {
        *self = *self - rhs;
    }
}

impl Lane for Counted {
    type Scalar = f64;
    type Mask = bool;
    const WIDTH: usize = 1;
    fn splat(value: f64) -> Self {
        Self(value)
    }
    fn from_f64(value: f64) -> Self {
        Self(value)
    }
    fn load(row: &Row<f64>, first: usize) -> Self {
        Self(row.0[first])
    }
    fn store(self, row: &mut Row<f64>, first: usize) {
        row.0[first] = self.0;
    }
    fn get(self, _lane: usize) -> f64 {
        self.0
    }
    fn set(&mut self, _lane: usize, value: f64) {
        self.0 = value;
    }
    fn mul_add(self, a: Self, b: Self) -> Self {
        counted(2, self.0 * a.0 + b.0)
    }
    fn sqrt(self) -> Self {
        counted(1, self.0.sqrt())
    }
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }
    fn lt(self, other: Self) -> bool {
        self.0 < other.0
    }
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    fn bits(mask: bool) -> u32 {
        mask.into()
    }
    fn asin_ratio(square: Self) -> Self {
        counted(8, f64::asin_ratio(square.0)) // the float32 polynomial's four multiply–adds
    }
    fn atan2(self, other: Self) -> Self {
        Self(self.0.atan2(other.0))
    }
}

/// A curly strand of [`PARTICLES`] particles and 30 cm.
fn helix() -> Vec<[f64; 3]> {
    (0..PARTICLES)
        .map(|i| {
            let (s, angle) = (i as f64 / (PARTICLES - 1) as f64, 0.9 * i as f64);
            [0.006 * angle.cos(), -0.27 * s, 0.006 * angle.sin()]
        })
        .collect()
}

/// Operations of one strand's substep.
fn count_operations() -> Result<u64, Box<dyn std::error::Error>> {
    let positions = helix();
    let offsets = [0, PARTICLES as u32];
    let strands = Strands::new(&positions, &offsets);
    let params = AmsParams::default();
    let simulation = Simulation::<f64>::from_strands(&strands, &params, &Options::default())?;
    let (model, mut state) = (simulation.model(), simulation.state().clone());
    let mut scratch = Scratch::new(PARTICLES);
    let terms = FrameTerms::new(&params, 1.0 / 60.0);
    let rest = RestMotion::<Counted>::rigid(&Pose::IDENTITY);
    let weight = V3::splat(GRAVITY);
    let substep = SubstepTerms::new(terms.h, [&rest, &rest], GRAVITY, weight, DVec3::ZERO);
    let mut view = BlockView {
        particles: PARTICLES,
        rest: &model.rest,
        root_frames: &[],
        rest_lengths: &model.rest_lengths,
        local: &[],
        inverse_edges: &model.inverse_edges,
        strand_length: &model.strand_lengths[0],
        stiffness: &model.stiffness[0],
        masses: &[],
        least_mass: model.least_mass,
        acceleration: &[],
        positions: &mut state.positions,
        previous: &mut [],
        velocities: &mut state.velocities,
        integrity: &mut state.integrity,
        clearance: &mut state.clearance,
        extra: BlockChannels::default(),
        exposure: &[],
        wind: &mut [],
        air: &mut [],
        drag: &mut [],
    };
    OPERATIONS.with(|n| n.set(0));
    solve_strands::advance(&terms, &substep, &mut view, 0, &mut scratch);
    Ok(OPERATIONS.with(Cell::get))
}

/// Shortest time of a substep's solve over all strands, on one thread, seconds.
fn time_solve() -> Result<f64, Box<dyn std::error::Error + Send + Sync>> {
    let helix: Vec<[f32; 3]> = helix().iter().map(|p| p.map(|x| x as f32)).collect();
    let positions: Vec<_> = (0..STRANDS).flat_map(|_| helix.iter().copied()).collect();
    let offsets: Vec<u32> = (0..=STRANDS).map(|s| (s * PARTICLES) as u32).collect();
    let strands = Strands::new(&positions, &offsets);
    let params = AmsParams { inextensibility: Inextensibility::Off, ..AmsParams::default() };
    let options = Options { rest_gravity: GRAVITY, ..Options::default() };
    let mut simulation = Simulation::<f32>::from_strands(&strands, &params, &options)?;
    let mut least = f64::INFINITY;
    for frame in 0..40 {
        let pose = |f: f64| Pose::new(glam::DQuat::from_rotation_y(0.3 * (0.1 * f).sin()), DVec3::ZERO);
        let head = [pose(f64::from(frame)), pose(f64::from(frame + 1))];
        let frame =
            FrameInput { roots: head.into(), gravity: GRAVITY, dt_secs: 1.0 / 60.0, ..FrameInput::default() };
        let report = simulation.step_frame(&frame)?;
        least =
            least.min(report.stages.get("solve_strands") / f64::from(parts(1.0 / 60.0, params.substep_secs)));
    }
    Ok(least)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let operations = count_operations()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let secs = pool.install(time_solve).map_err(|e| e.to_string())?;
    let peak = multiply_adds_per_sec();
    let rate = operations as f64 * STRANDS as f64 / secs;
    let particles = (STRANDS * PARTICLES) as f64;
    println!("strand solve, {STRANDS} x {PARTICLES}, one thread, {:?}", Simd::Auto.resolve());
    println!("  {:.0} operations a particle and substep (counted)", operations as f64 / PARTICLES as f64);
    println!("  {:.2} ms a substep, {:.1} ns a particle", secs * 1e3, secs * 1e9 / particles);
    println!(
        "  {:.1} GFLOP/s of a measured peak of {:.1} ({:.0} %)",
        rate / 1e9,
        peak / 1e9,
        100.0 * rate / peak
    );
    println!("  factors of a group of strands: {} KiB", 30 * 4 * LANES.min(8) * PARTICLES / 1024);
    Ok(())
}
