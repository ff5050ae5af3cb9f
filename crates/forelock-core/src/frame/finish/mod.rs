//! The steps that all solvers share after their substeps: the length pass, the final collision
//! pass, and the checks.

use super::context::FrameContext;
use super::plan::{Span, Step};
use super::report::BlockReport;
use super::restore_lengths::{self, LengthTerms};
use super::solver::{BlockTask, Clock};
use crate::collide::resolve_solids::{self, QueriedStrands, Since, SolidContacts, Solids};
use crate::lane::{Lane, Real, V3};
use crate::params::Inextensibility;
use crate::strands::{BlockView, LaneGroup, Scratch, number, vector};
use num_traits::ToPrimitive;

/// The WGSL of `check_strands`.
pub const WGSL: &str = include_str!("check_strands.wgsl");

/// Which of the shared steps a block runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Finish {
    /// The substeps that they come after.
    pub span: Span,
    /// The length pass and its collisions.
    pub lengths: bool,
    /// Collisions after interactions.
    pub collides: bool,
    /// Checks.
    pub checks: bool,
}

impl Finish {
    /// Those among `steps`, all after the same span, of a frame of `substeps`; some depend on
    /// whether an interaction `moved` edges.
    pub fn of(steps: &[Step], substeps: u32, moved: bool) -> Self {
        let span = Span::whole(substeps);
        let mut finish = Self { span, lengths: false, collides: false, checks: false };
        for step in steps {
            match *step {
                Step::RestoreLengths { span } => (finish.span, finish.lengths) = (span, true),
                Step::RestoreIfMoved { span } if moved => (finish.span, finish.lengths) = (span, true),
                Step::CollideFinal { span, unless_moved } if !(moved && unless_moved) => {
                    (finish.span, finish.collides) = (span, true);
                }
                Step::CheckStrands => finish.checks = true,
                _ => {}
            }
        }
        finish
    }

    /// Whether there is anything to do.
    pub fn is_any(self) -> bool {
        self.lengths || self.collides || self.checks
    }
}

impl BlockTask for Finish {
    #[inline(always)]
    fn run<L: Lane>(
        &self,
        cx: &FrameContext<'_, L::Scalar>,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        scratch: &mut Scratch<L::Scalar>,
    ) -> BlockReport {
        let mut report = BlockReport::default();
        let mut clock = Clock::start();
        // The largest stretch of each lane, where it has been measured.
        let mut stretch = None;
        if self.lengths {
            let restored = restore::<L>(cx, self.span, view, group.first, scratch);
            report.max_edge_stretch = largest(restored, group);
            report.nanos.lengths += clock.lap();
            let (left, contacts) = collide::<L>(cx, self.span, view, group, true, restored, scratch);
            (stretch, report.contacts) = (Some(left), contacts);
            report.nanos.collide += clock.lap();
        }
        if self.collides || self.checks {
            let before = stretch.unwrap_or_else(|| restore_lengths::largest_stretch::<L>(view, group.first));
            // Where no length pass measures it.
            let unmeasured = cx.rules.restores_own_lengths || cx.rules.lengths == Inextensibility::Off;
            if stretch.is_none() && unmeasured {
                report.max_edge_stretch = largest(before, group);
            }
            stretch = Some(before);
            if self.collides {
                let (left, contacts) = collide::<L>(cx, self.span, view, group, false, before, scratch);
                (stretch, report.contacts) = (Some(left), contacts);
                report.nanos.collide += clock.lap();
            }
        }
        report.max_edge_stretch_final = stretch.map_or(0.0, |stretch| largest(stretch, group));
        if self.checks {
            let sum = finiteness::<L>(view, group.first);
            for lane in 0..L::WIDTH.min(group.live - group.first) {
                if !num_traits::Float::is_finite(sum.get(lane)) {
                    quarantine(cx, view, group.first + lane);
                    report.quarantined += 1;
                }
            }
            report.nanos.check += clock.lap();
        }
        report
    }
}

/// Brings edges back to their lengths; the largest stretch left, a lane.
#[inline(always)]
fn restore<L: Lane>(
    cx: &FrameContext<'_, L::Scalar>,
    span: Span,
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    scratch: &mut Scratch<L::Scalar>,
) -> L {
    let (before, work) = scratch.vectors::<L>().split_at_mut(view.particles);
    for (i, x) in before.iter_mut().enumerate() {
        *x = V3::load(view.positions, i, first);
    }
    let terms = LengthTerms {
        kind: cx.rules.lengths,
        max_stretch: cx.rules.max_stretch,
        damping: cx.rules.length_damping,
        dt_secs: span.secs(cx.substeps, cx.dt_secs),
        clamped: cx.rules.clamped,
    };
    restore_lengths::restore(&terms, view, first, work)
}

/// Collisions at the end of a substep. The last one tests slow edges too where no length pass
/// follows ([`FrameRules::collides_once`]), and lays strands along colliders.
///
/// [`FrameRules::collides_once`]: super::FrameRules::collides_once
#[inline(always)]
pub(super) fn collide_substep<L: Lane>(
    cx: &FrameContext<'_, L::Scalar>,
    substep: usize,
    view: &mut BlockView<'_, L::Scalar>,
    group: LaneGroup,
    scratch: &mut Scratch<L::Scalar>,
) -> SolidContacts {
    if cx.solids.is_empty() {
        return SolidContacts::default();
    }
    let first = group.first;
    let (load, work) = scratch.vectors::<L>().split_at_mut(view.particles);
    let is_final = cx.rules.collides_once() && substep + 1 == cx.substeps as usize;
    let loaded = set_load_aside(cx, view, first, load);
    let solids = cx.colliders(substep, cx.max_push_out());
    let slow_edges = if is_final { L::Scalar::default() } else { solids.slow_edges };
    // Velocities are derived from positions below.
    let solids = Solids { slow_edges, friction_moves: loaded, ..solids };
    let queried = QueriedStrands::all::<L>(group);
    let mut contacts = resolve_solids::resolve::<L>(&solids, Since::Substep, view, queried, work);
    if is_final && (contacts.lanes >> first) & queried.lanes != 0 {
        let stretch = restore_lengths::largest_stretch::<L>(view, first);
        let mut touched = stretch;
        for lane in (0..L::WIDTH).filter(|lane| (contacts.lanes >> first >> lane) & 1 == 0) {
            touched.set(lane, L::Scalar::default());
        }
        if let Some(limit) = cx.rules.stretch_limit {
            let depth = resolve_solids::lay_along(&solids, touched, limit, view, group, work);
            contacts.deepest = contacts.deepest.max(depth);
        }
    }
    if loaded {
        let inverse_h = L::from_f64(1.0 / cx.h);
        for (i, load) in load.iter().enumerate() {
            (motion(view, i, first, inverse_h) + *load).store(view.velocities, i, first);
        }
    }
    contacts
}

/// The velocity with which particles `i` moved in the last step, from their positions.
#[inline(always)]
fn motion<L: Lane>(view: &BlockView<'_, L::Scalar>, i: usize, first: usize, inverse_h: L) -> V3<L> {
    (V3::load(view.positions, i, first) - V3::load(view.previous, i, first)).scale(inverse_h)
}

/// Where velocities hold more than motion, stores the rest of them in `load` and leaves the motion;
/// returns whether they do.
#[inline(always)]
fn set_load_aside<L: Lane>(
    cx: &FrameContext<'_, L::Scalar>,
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    load: &mut [V3<L>],
) -> bool {
    if view.previous.is_empty() {
        return false;
    }
    let inverse_h = L::from_f64(1.0 / cx.h);
    for (i, load) in load.iter_mut().enumerate() {
        let u = motion(view, i, first, inverse_h);
        *load = V3::load(view.velocities, i, first) - u;
        u.store(view.velocities, i, first);
    }
    true
}

/// Collisions after the length pass (`restored`) or after interactions, at the end of `span`.
/// `stretch` is the largest of each lane before them; returns it after them, and the contacts.
/// Colliders meet hair with the speed at which it moves: where velocities hold more than motion
/// (`BlockView::previous`), the rest of them is set aside meanwhile.
#[inline(always)]
fn collide<L: Lane>(
    cx: &FrameContext<'_, L::Scalar>,
    span: Span,
    view: &mut BlockView<'_, L::Scalar>,
    group: LaneGroup,
    restored: bool,
    stretch: L,
    scratch: &mut Scratch<L::Scalar>,
) -> (L, SolidContacts) {
    if cx.solids.is_empty() {
        return (stretch, SolidContacts::default());
    }
    let first = group.first;
    let n = view.particles;
    // The length pass has stored the positions before it.
    let (before, work) = scratch.vectors::<L>().split_at_mut(n);
    let (load, work) = work.split_at_mut(n);
    let loaded = set_load_aside(cx, view, first, load);
    let solids = cx.colliders(span.end as usize - 1, 0.0);
    let secs = span.secs(cx.substeps, cx.dt_secs);
    let max_edge_push = number(cx.rules.depenetration_speed * secs);
    let solids = Solids { slow_edges: L::Scalar::default(), max_edge_push, ..solids };
    let queried = QueriedStrands::all::<L>(group);
    let since = if restored { Since::Displaced(&*before) } else { Since::Noted };
    // Edges that springs may compress would hide those that solids stretch.
    let is_limit = cx.rules.lengths == Inextensibility::Limit;
    let by_solids = |view: &BlockView<'_, L::Scalar>, stretch: L| {
        if is_limit { restore_lengths::largest_extension(view, first) } else { stretch }
    };
    let before_solids = by_solids(view, stretch);
    let mut contacts = resolve_solids::resolve::<L>(&solids, since, view, queried, work);
    let mut left = stretch;
    if contacts.touching + contacts.edges > 0 {
        left = restore_lengths::largest_stretch::<L>(view, first);
        if let Some(limit) = cx.rules.stretch_limit {
            // Only strands that colliders stretched: the result must not depend on the width.
            let now = by_solids(view, left);
            let stretched = L::select(before_solids.lt(now), now, L::zero());
            let depth = resolve_solids::lay_along(&solids, stretched, limit, view, group, work);
            contacts.deepest = contacts.deepest.max(depth);
            left = restore_lengths::largest_stretch::<L>(view, first);
        }
    }
    if loaded {
        for (i, load) in load.iter().enumerate() {
            (V3::load(view.velocities, i, first) + *load).store(view.velocities, i, first);
        }
    }
    (left, contacts)
}

/// The largest of the lanes that hold strands of their own.
fn largest<L: Lane>(stretch: L, group: LaneGroup) -> f64 {
    (0..L::WIDTH.min(group.live - group.first))
        .filter_map(|lane| stretch.get(lane).to_f64())
        .fold(0.0, f64::max)
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

/// Puts the strand in `lane`, which has a number that is not finite, back to its rest shape, moving
/// with the head, with integrity 1 and channels at their initial values; other strands are not
/// changed.
fn quarantine<T: Real>(cx: &FrameContext<'_, T>, view: &mut BlockView<'_, T>, lane: usize) {
    let end = cx.poses.len() - 1;
    let [before, last] = [end - 1, end].map(|end| cx.rest_motion_of(view, lane, end));
    for i in 0..view.particles {
        let rest = vector(view.rest, i, lane).map(|x| x.to_f64().unwrap_or(0.0)).into();
        let x = last.transform_point(rest);
        let v = (x - before.transform_point(rest)) / cx.h;
        for c in 0..3 {
            view.positions[3 * i + c].0[lane] = number(x[c]);
            view.velocities[3 * i + c].0[lane] = number(v[c]);
            if let Some(row) = view.previous.get_mut(3 * i + c) {
                row.0[lane] = number(x[c] - v[c] * cx.h);
            }
        }
        view.integrity[i].0[lane] = T::one();
        view.clearance[i].0[lane] = T::neg_infinity();
    }
    view.extra.reset(lane, last.rotation);
}
