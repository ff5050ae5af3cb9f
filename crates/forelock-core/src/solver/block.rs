//! A frame for one block of strands, and its instantiations for every instruction set.

use crate::body::ColliderFrame;
use crate::lane::{LANES, Lane, Real, V3};
use crate::pose::Pose;
use crate::solver::SolverParams;
use crate::solver::params::Inextensibility;
use crate::stage::find_neighbours::SearchReal;
use crate::stage::follow_leader::{self, FollowStep, FollowTerms};
use crate::stage::resolve_solids::{self, Contacts, LevelSolids, Since, SolidPose, Solids};
use crate::stage::restore_lengths::{self, LengthTerms};
use crate::stage::sample_air::{self, AirTerms};
use crate::stage::solve_strands::{self, FrameTerms, SubstepTerms};
use crate::stage::{BlockView, Scratch};
use glam::DVec3;
use std::ops::Range;
use std::time::Instant;

/// The stages of a frame, in order, as reports name them.
pub const STAGES: [&str; 12] = [
    "solve_strands",
    "follow_leader",
    "resolve_solids",
    "restore_lengths",
    "check_strands",
    "splat_segments",
    "solve_pressure",
    "gather_velocities",
    "find_contacts",
    "resolve_contacts",
    "find_neighbours",
    "push_particles",
];

/// Those of them that a block runs by itself: the first.
pub const BLOCK_STAGES: usize = 5;

// Their numbers.
const SOLVE: usize = 0;
const FOLLOW: usize = 1;
const SOLIDS: usize = 2;
const LENGTHS: usize = 3;
const CHECK: usize = 4;

/// All that a block needs to know of a frame.
#[derive(Debug)]
pub struct FrameJob<'a, T> {
    /// Which part of the frame.
    pub part: Part,
    /// Coefficients, which say what strands are under.
    pub terms: &'a StrandTerms,
    /// Substep, seconds.
    pub h: f64,
    /// Clamped particles from the root.
    pub clamped: usize,
    /// Head poses at the substeps' ends, M + 1, from the model's centre to the frame's origin.
    pub poses: &'a [Pose],
    /// What the length pass needs.
    pub lengths: LengthTerms,
    /// Gravity, m/s².
    pub gravity: DVec3,
    /// Gravity in the head's rest frame.
    pub rest_gravity: DVec3,
    /// Velocity of the air, m/s.
    pub air_velocity: DVec3,
    /// The air where it is not the same everywhere; then `air_velocity` is in it.
    pub air: Option<AirTerms<'a, T>>,
    /// To be added to stored positions, which are relative to the last frame's origin.
    pub shift: DVec3,
    /// Solids of the frame.
    pub solids: &'a [ColliderFrame<'a>],
    /// Their poses, M × solids.
    pub solid_poses: &'a [SolidPose<T>],
    /// Whether edges that solids stretched are laid along them.
    pub lay_along: bool,
    /// Skin thickness, metres.
    pub skin_thickness: f64,
    /// Depth that a particle may come out of a solid in a substep, metres.
    pub way_out: f64,
}

/// What moves a strand by itself.
#[derive(Clone, Debug)]
pub enum StrandTerms {
    /// `solve_strands`, and `resolve_solids` after it.
    Ams(FrameTerms),
    /// `follow_leader`, with solids level by level.
    Dftl(FollowTerms),
}

impl StrandTerms {
    /// The terms of `params` for frames of `dt_secs`.
    pub fn new(params: &SolverParams, dt_secs: f64) -> Self {
        match params {
            SolverParams::Ams(params) => Self::Ams(FrameTerms::new(params, dt_secs)),
            SolverParams::Dftl(params) => Self::Dftl(FollowTerms::new(params, dt_secs)),
        }
    }

    /// Whether drag differs from particle to particle.
    pub fn is_slender(&self) -> bool {
        matches!(self, Self::Ams(terms) if terms.slender)
    }
}

/// Which part of a frame a block runs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Part {
    /// Its substeps.
    pub substeps: Range<usize>,
    /// Whether strands are solved in them.
    pub solves: bool,
    /// Whether they look at solids.
    pub looks: bool,
    /// Whether edges are brought back to their lengths.
    pub lengths: bool,
    /// Whether solids are looked at once more.
    pub looks_last: bool,
    /// Whether strands are checked.
    pub checks: bool,
}

/// What a block, or all, found in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockReport {
    /// Largest |l/l₀ − 1| after the length pass.
    pub max_edge_stretch: f64,
    /// The same at the frame's end, after solids.
    pub max_edge_stretch_final: f64,
    /// Solids at the frame's end.
    pub contacts: Contacts,
    /// Strands reset because they were not finite.
    pub quarantined: u32,
    /// Nanoseconds a stage, summed over threads.
    pub stage_nanos: [u64; BLOCK_STAGES],
}

impl BlockReport {
    /// This part of a frame and the one that comes `after` it.
    #[must_use]
    pub fn then(self, after: &Self) -> Self {
        Self {
            max_edge_stretch: self.max_edge_stretch.max(after.max_edge_stretch),
            quarantined: self.quarantined + after.quarantined,
            stage_nanos: std::array::from_fn(|k| self.stage_nanos[k] + after.stage_nanos[k]),
            ..*after
        }
    }

    /// A block's substeps and what came after them, which `looked` at solids once more or did not.
    #[must_use]
    pub fn finished(self, after: Self, looked: bool) -> Self {
        let contacts = if looked { after.contacts } else { self.contacts };
        Self { contacts, ..self.merge(after) }
    }

    /// Both together; the same whatever the order.
    #[must_use]
    pub fn merge(self, other: Self) -> Self {
        Self {
            max_edge_stretch: self.max_edge_stretch.max(other.max_edge_stretch),
            max_edge_stretch_final: self.max_edge_stretch_final.max(other.max_edge_stretch_final),
            contacts: Contacts {
                touching: self.contacts.touching + other.contacts.touching,
                deepest: self.contacts.deepest.max(other.contacts.deepest),
            },
            quarantined: self.quarantined + other.quarantined,
            stage_nanos: std::array::from_fn(|k| self.stage_nanos[k] + other.stage_nanos[k]),
        }
    }
}

/// Advances a block, of which `live` lanes count, by a frame.
///
/// # Safety
/// The processor must have the instruction set that the function was made for.
pub type BlockFn<T> =
    unsafe fn(&FrameJob<'_, T>, &mut BlockView<'_, T>, live: usize, &mut Scratch<T>) -> BlockReport;

/// An instruction set and a width.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Simd {
    /// The best that the processor has.
    #[default]
    Auto,
    /// What every processor of this architecture has, one strand at a time.
    Scalar,
    /// What every processor of this architecture has, 4 strands.
    Portable,
    /// AVX2 and FMA, 1 strand: for comparing widths.
    Avx2x1,
    /// AVX2 and FMA, 4 strands: for comparing widths.
    Avx2x4,
    /// AVX2 and FMA, 8 strands.
    Avx2,
    /// AVX2 and FMA, 16 strands in two registers: for comparing widths.
    Avx2x16,
    /// AVX-512, 16 strands.
    Avx512,
}

impl Simd {
    /// All but `Auto`, narrow to wide.
    pub const ALL: [Self; 7] =
        [Self::Scalar, Self::Portable, Self::Avx2x1, Self::Avx2x4, Self::Avx2, Self::Avx2x16, Self::Avx512];

    /// Whether this processor can run it.
    pub fn is_supported(self) -> bool {
        match self {
            Self::Auto | Self::Scalar | Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2x1 | Self::Avx2x4 | Self::Avx2 | Self::Avx2x16 => {
                is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("fma")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// This choice, or for `Auto` the best one supported.
    pub fn resolve(self) -> Self {
        if self != Self::Auto {
            return self;
        }
        [Self::Avx512, Self::Avx2].into_iter().find(|s| s.is_supported()).unwrap_or(Self::Portable)
    }
}

/// What a block does in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The part's substeps under [`StrandTerms::Ams`].
    Ams,
    /// The same under [`StrandTerms::Dftl`].
    Dftl,
    /// What comes after them.
    Finish,
}

/// Numbers that the solver runs in.
pub trait SolverReal: SearchReal {
    /// The function for `task` on `simd` (supported, not `Auto`).
    ///
    /// Implementations are never inlined: a crate that inlines one compiles all functions that it can return.
    fn block_fn(task: Task, simd: Simd) -> BlockFn<Self>;
}

/// The specification: one strand at a time, plain float64.
impl SolverReal for f64 {
    #[inline(never)]
    fn block_fn(task: Task, _: Simd) -> BlockFn<Self> {
        match task {
            Task::Ams => advance_ams::<f64>,
            Task::Dftl => advance_dftl::<f64>,
            Task::Finish => finish_block::<f64>,
        }
    }
}

/// Whether the target has fused multiply–add without asking.
pub(crate) const BASELINE_FMA: bool = cfg!(any(target_arch = "aarch64", target_feature = "fma"));

/// `$text` for lanes `$lane`, with `$features`.
#[cfg(target_arch = "x86_64")]
macro_rules! with_features {
    ($features:literal, $lane:ty, $text:ident($($name:ident: $type:ty),*) $(-> $found:ty)?) => {{
        #[target_feature(enable = $features)]
        fn with_features($($name: $type),*) $(-> $found)? {
            $text::<$lane>($($name),*)
        }
        with_features
    }};
}
#[cfg(target_arch = "x86_64")]
pub(crate) use with_features;

/// `$text`, a function of lanes of float32, for the instruction set and width `$simd` (supported, not `Auto`): unsafe to call where they are not there.
macro_rules! on {
    ($simd:ident, $text:ident $takes:tt $(-> $found:ty)?) => {
        match $simd {
            $crate::solver::Simd::Scalar => $text::<$crate::lane::Pack<1, { $crate::solver::BASELINE_FMA }>>,
            #[cfg(target_arch = "x86_64")]
            $crate::solver::Simd::Avx2x1 => $crate::solver::with_features!("avx2,fma", $crate::lane::Pack<1, true>, $text $takes $(-> $found)?),
            #[cfg(target_arch = "x86_64")]
            $crate::solver::Simd::Avx2x4 => $crate::solver::with_features!("avx2,fma", $crate::lane::Pack<4, true>, $text $takes $(-> $found)?),
            #[cfg(target_arch = "x86_64")]
            $crate::solver::Simd::Avx2 => $crate::solver::with_features!("avx2,fma", $crate::lane::Avx2, $text $takes $(-> $found)?),
            #[cfg(target_arch = "x86_64")]
            $crate::solver::Simd::Avx2x16 => $crate::solver::with_features!("avx2,fma", $crate::lane::Pack<16, true>, $text $takes $(-> $found)?),
            #[cfg(target_arch = "x86_64")]
            $crate::solver::Simd::Avx512 => $crate::solver::with_features!(
                "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma",
                $crate::lane::Avx512,
                $text $takes $(-> $found)?
            ),
            _ => $text::<$crate::lane::Pack<4, { $crate::solver::BASELINE_FMA }>>,
        }
    };
}
pub(crate) use on;

/// `$text` as a [`BlockFn`].
macro_rules! block_on {
    ($simd:ident, $text:ident) => {
        on!(
            $simd,
            $text(
                job: &FrameJob<'_, f32>,
                view: &mut BlockView<'_, f32>,
                live: usize,
                scratch: &mut Scratch<f32>
            ) -> BlockReport
        )
    };
}

impl SolverReal for f32 {
    #[inline(never)]
    fn block_fn(task: Task, simd: Simd) -> BlockFn<Self> {
        match task {
            Task::Ams => block_on!(simd, advance_ams),
            Task::Dftl => block_on!(simd, advance_dftl),
            Task::Finish => block_on!(simd, finish_block),
        }
    }
}

/// [`Task::Ams`], group of lanes by group of lanes: all substeps while its data is in the cache.
#[inline(always)]
fn advance_ams<L: Lane>(
    job: &FrameJob<'_, L::Scalar>,
    view: &mut BlockView<'_, L::Scalar>,
    live: usize,
    scratch: &mut Scratch<L::Scalar>,
) -> BlockReport {
    let mut report = BlockReport::default();
    let StrandTerms::Ams(terms) = job.terms else { return report };
    for first in (0..live.min(LANES)).step_by(L::WIDTH) {
        report = report.merge(advance_substeps::<L>(job, terms, view, (first, live), scratch));
    }
    report
}

/// [`Task::Dftl`], group of lanes by group of lanes.
#[inline(always)]
fn advance_dftl<L: Lane>(
    job: &FrameJob<'_, L::Scalar>,
    view: &mut BlockView<'_, L::Scalar>,
    live: usize,
    _: &mut Scratch<L::Scalar>,
) -> BlockReport {
    let mut report = BlockReport::default();
    let StrandTerms::Dftl(terms) = job.terms else { return report };
    for first in (0..live.min(LANES)).step_by(L::WIDTH) {
        report = report.merge(advance_step::<L>(job, terms, view, (first, live)));
    }
    report
}

/// [`Task::Finish`], group of lanes by group of lanes.
#[inline(always)]
fn finish_block<L: Lane>(
    job: &FrameJob<'_, L::Scalar>,
    view: &mut BlockView<'_, L::Scalar>,
    live: usize,
    scratch: &mut Scratch<L::Scalar>,
) -> BlockReport {
    let mut report = BlockReport::default();
    for first in (0..live.min(LANES)).step_by(L::WIDTH) {
        report = report.merge(finish_lanes::<L>(job, view, (first, live), scratch));
    }
    report
}

/// What one group of lanes does after its substeps.
#[inline(always)]
fn finish_lanes<L: Lane>(
    job: &FrameJob<'_, L::Scalar>,
    view: &mut BlockView<'_, L::Scalar>,
    (first, live): (usize, usize),
    scratch: &mut Scratch<L::Scalar>,
) -> BlockReport {
    let mut report = BlockReport::default();
    let mut clock = Clock::start();
    // What the edges are stretched by, once they have their lengths back.
    let mut restored = None;
    if job.part.lengths {
        let stretch = restore::<L>(job, view, first, scratch);
        report.max_edge_stretch = worst(stretch, live - first);
        restored = Some(stretch);
        report.stage_nanos[LENGTHS] += clock.lap();
    }
    if job.part.looks_last || job.part.checks {
        finish::<L>(job, view, (first, live), restored, scratch, (&mut clock, &mut report));
    }
    report
}

/// The solids, as substep `step` meets them.
fn look<'a, T: Real>(job: &'a FrameJob<'_, T>, step: usize, way_out: f64) -> Solids<'a, T> {
    let solids = job.solids.len();
    Solids {
        solids: job.solids,
        poses: &job.solid_poses[step * solids..(step + 1) * solids],
        thickness: crate::state::number(job.skin_thickness),
        way_out: crate::state::number(way_out),
        h: crate::state::number(job.h),
        clamped: job.clamped,
        drags: false,
    }
}

/// The part's substeps of one group of lanes.
#[inline(always)]
fn advance_substeps<L: Lane>(
    job: &FrameJob<'_, L::Scalar>,
    terms: &FrameTerms,
    view: &mut BlockView<'_, L::Scalar>,
    (first, live): (usize, usize),
    scratch: &mut Scratch<L::Scalar>,
) -> BlockReport {
    let mut report = BlockReport::default();
    let mut clock = Clock::start();
    shift_positions::<L>(job.shift, view, first);
    if let Some(air) = job.air.as_ref().filter(|_| job.part.solves) {
        sample_air::sample::<L>(air, view.positions, view.exposure, first, view.wind);
        sample_air::draw::<L>(terms, view, first);
    }
    for step in job.part.substeps.clone() {
        if job.part.solves {
            let poses = [&job.poses[step], &job.poses[step + 1]];
            let substep =
                SubstepTerms::<L>::new(terms.h, poses, job.gravity, job.rest_gravity, job.air_velocity);
            if terms.slender && job.air.is_some() {
                sample_air::draw::<L>(terms, view, first);
            }
            solve_strands::advance(terms, &substep, view, first, scratch);
            report.stage_nanos[SOLVE] += clock.lap();
        }
        if job.part.looks {
            let solids = look(job, step, job.way_out);
            report.contacts = resolve_solids::resolve::<L>(&solids, Since::Substep, view, first, live);
            report.stage_nanos[SOLIDS] += clock.lap();
        }
    }
    report
}

/// One group of lanes by a step of follow the leader.
#[inline(always)]
fn advance_step<L: Lane>(
    job: &FrameJob<'_, L::Scalar>,
    terms: &FollowTerms,
    view: &mut BlockView<'_, L::Scalar>,
    lanes: (usize, usize),
) -> BlockReport {
    let mut report = BlockReport::default();
    let mut clock = Clock::start();
    let mut shift = [job.shift; 2];
    if let Some(air) = &job.air {
        shift_positions::<L>(job.shift, view, lanes.0);
        shift[0] = DVec3::ZERO;
        sample_air::sample::<L>(air, view.positions, view.exposure, lanes.0, view.wind);
    }
    let carried = if terms.sag_free { job.poses[1].transform_vector(job.rest_gravity) } else { DVec3::ZERO };
    let step = FollowStep::<L>::new(&job.poses[1], job.gravity - carried, job.air_velocity, shift);
    let solids = LevelSolids::new(look(job, 0, job.way_out));
    report.contacts = follow_leader::advance(terms, &step, solids, view, lanes);
    report.stage_nanos[FOLLOW] += clock.lap();
    report
}

/// Brings edges back to their lengths, if that is asked for; the largest stretch left.
#[inline(always)]
fn restore<L: Lane>(
    job: &FrameJob<'_, L::Scalar>,
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    scratch: &mut Scratch<L::Scalar>,
) -> L {
    if job.lengths.kind == Inextensibility::Off {
        return restore_lengths::largest_stretch::<L>(view, first);
    }
    let (before, work) = scratch.vectors::<L>().split_at_mut(view.particles);
    for (i, x) in before.iter_mut().enumerate() {
        *x = V3::load(view.positions, i, first);
    }
    let stretch = restore_lengths::restore(&job.lengths, view, first, work);
    resolve_solids::note_moves::<L>(before, view, first);
    stretch
}

/// Solids have the last word; then checks. `restored` is the largest stretch before, where it is known. Solids meet hair with the speed at which it moves, not with the load that followers' velocities hold.
#[inline(always)]
fn finish<L: Lane>(
    job: &FrameJob<'_, L::Scalar>,
    view: &mut BlockView<'_, L::Scalar>,
    (first, live): (usize, usize),
    restored: Option<L>,
    scratch: &mut Scratch<L::Scalar>,
    (clock, report): (&mut Clock, &mut BlockReport),
) {
    let before = restored.unwrap_or_else(|| restore_lengths::largest_stretch::<L>(view, first));
    let mut stretch = before;
    let follows = matches!(job.terms, StrandTerms::Dftl(_));
    let looks_at_motion = follows && job.part.looks_last;
    if looks_at_motion {
        let inverse_h = L::from_f64(1.0 / job.h);
        for (i, load) in scratch.vectors::<L>()[..view.particles].iter_mut().enumerate() {
            let u = (V3::load(view.positions, i, first) - V3::load(view.previous, i, first)).scale(inverse_h);
            *load = V3::load(view.velocities, i, first) - u;
            u.store(view.velocities, i, first);
        }
    }
    if restored.is_none() && follows {
        // Lengths were restored level by level.
        report.max_edge_stretch = worst(before, live - first);
    }
    if job.part.looks_last {
        let last = job.poses.len() - 2;
        report.contacts =
            resolve_solids::resolve::<L>(&look(job, last, 0.0), Since::Noted, view, first, live);
        report.stage_nanos[SOLIDS] += clock.lap();
        if report.contacts.touching > 0 {
            stretch = restore_lengths::largest_stretch::<L>(view, first);
            if job.lay_along {
                // Of the strands beside one that touches, only those that solids stretched: the width must not matter.
                let by_solids = L::select(before.lt(stretch), stretch, L::zero());
                resolve_solids::lay_along(&look(job, last, 0.0), by_solids, view, first, live);
                stretch = restore_lengths::largest_stretch::<L>(view, first);
            }
        }
    }
    if looks_at_motion {
        for (i, load) in scratch.vectors::<L>()[..view.particles].iter().enumerate() {
            (V3::load(view.velocities, i, first) + *load).store(view.velocities, i, first);
        }
    }
    report.max_edge_stretch_final = worst(stretch, live - first);
    if !job.part.checks {
        return;
    }
    let sum = finiteness::<L>(view, first);
    for lane in 0..L::WIDTH.min(live - first) {
        if !num_traits::Float::is_finite(sum.get(lane)) {
            quarantine(job, view, first + lane);
            report.quarantined += 1;
        }
    }
    report.stage_nanos[CHECK] += clock.lap();
}

fn worst<L: Lane>(stretch: L, live: usize) -> f64 {
    (0..L::WIDTH.min(live))
        .filter_map(|lane| num_traits::ToPrimitive::to_f64(&stretch.get(lane)))
        .fold(0.0, f64::max)
}

#[inline(always)]
fn shift_positions<L: Lane>(shift: DVec3, view: &mut BlockView<'_, L::Scalar>, first: usize) {
    if shift == DVec3::ZERO {
        return;
    }
    let shift = V3::<L>::splat(shift);
    for i in 0..view.particles {
        (V3::load(view.positions, i, first) + shift).store(view.positions, i, first);
    }
}

/// Zero in the lanes whose numbers are all finite, not a number in the others.
#[inline(always)]
fn finiteness<L: Lane>(view: &BlockView<'_, L::Scalar>, first: usize) -> L {
    let mut sum = L::zero();
    for i in 0..view.particles {
        let both = V3::<L>::load(view.positions, i, first) + V3::load(view.velocities, i, first);
        sum = both.0[0].mul_add(L::zero(), sum);
        sum = both.0[1].mul_add(L::zero(), sum);
        sum = both.0[2].mul_add(L::zero(), sum);
    }
    sum
}

/// Puts the strand in `lane`, which has a number that is not finite, back to its rest shape, moving with the head, with
/// whole ties; the other strands do not notice.
fn quarantine<T: Real>(job: &FrameJob<'_, T>, view: &mut BlockView<'_, T>, lane: usize) {
    let [.., before, last] = job.poses else { return };
    for i in 0..view.particles {
        let rest = crate::state::vector(view.rest, i, lane).map(|x| x.to_f64().unwrap_or(0.0)).into();
        let x = last.transform_point(rest);
        let v = (x - before.transform_point(rest)) / job.h;
        for c in 0..3 {
            view.positions[3 * i + c].0[lane] = crate::state::number(x[c]);
            view.velocities[3 * i + c].0[lane] = crate::state::number(v[c]);
            if let Some(row) = view.previous.get_mut(3 * i + c) {
                row.0[lane] = crate::state::number(x[c] - v[c] * job.h);
            }
        }
        view.integrity[i].0[lane] = T::one();
        view.clearance[i].0[lane] = T::neg_infinity();
    }
}

/// Laps of a stage's time.
struct Clock(Instant);

impl Clock {
    fn start() -> Self {
        Self(Instant::now())
    }

    #[expect(clippy::cast_possible_truncation, reason = "a lap is far under 584 years")]
    fn lap(&mut self) -> u64 {
        let now = Instant::now();
        let nanos = (now - self.0).as_nanos() as u64;
        self.0 = now;
        nanos
    }
}
