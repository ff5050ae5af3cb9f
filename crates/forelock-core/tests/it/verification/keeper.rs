//! A solver with channels of every kind, beside the positions of a damped chain.

use forelock_core::collide::resolve_solids::SolidContacts;
use forelock_core::frame::{Channel, ChannelKind, Channels, FrameContext, FrameRules, LaneGroup, LaneSolver};
use forelock_core::frame::{Solver, Substep};
use forelock_core::lane::{Lane, Mat3, V3};
use forelock_core::strands::{BlockView, Scratch};
use glam::{DQuat, DVec3};

/// A chain that keeps its filtered velocity, counts its substeps, and carries a frame that turns
/// about the world's y axis.
#[derive(Clone, Debug)]
pub struct Keeper;

pub const FILTERED: Channel =
    Channel { name: "filtered", kind: ChannelKind::Vector(DVec3::new(0.5, 0.0, 0.0)), values: 1 };
/// A count, and the sum of the counts before.
pub const COUNTS: Channel = Channel { name: "counts", kind: ChannelKind::Scalar(2.0), values: 2 };
pub const FRAME: Channel = Channel { name: "frame", kind: ChannelKind::Rotation(DQuat::IDENTITY), values: 1 };

/// Substeps per frame of 1/60 s.
pub const SUBSTEPS: u32 = 2;

/// Half the angle by which the frame turns in a substep, radians.
pub const HALF_TURN: f64 = 0.05;

impl LaneSolver for Keeper {
    type Terms = ();

    fn name(&self) -> &'static str {
        "keeper"
    }

    fn rules(&self) -> FrameRules {
        FrameRules {
            stage: "keep",
            substep_secs: 1.0 / (60.0 * f64::from(SUBSTEPS)),
            ..FrameRules::default()
        }
    }

    fn channels(&self) -> Channels {
        Channels { extra: &[FILTERED, COUNTS, FRAME], ..Channels::default() }
    }

    fn terms(&self, _: f64) {}

    #[inline(always)]
    fn solve<L: Lane>(
        _: &(),
        cx: &FrameContext<'_, L::Scalar>,
        substep: Substep,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        _: &mut Scratch<L::Scalar>,
    ) -> SolidContacts {
        let first = group.first;
        let head = &cx.poses[substep.index + 1];
        let (turn, shift) = (Mat3::splat(head.matrix()), V3::splat(head.translation));
        let fall = V3::<L>::splat(cx.gravity * cx.h);
        let (sin, cos) = HALF_TURN.sin_cos();
        let [sin, cos] = [sin, cos].map(L::from_f64);
        for i in 0..view.particles {
            let x = V3::<L>::load(view.positions, i, first);
            let (x, v) = if i < cx.rules.clamped {
                let on_head = shift.add_mul(&turn, V3::load(view.rest, i, first));
                (on_head, (on_head - x).scale(L::from_f64(1.0 / cx.h)))
            } else {
                let v = V3::<L>::load(view.velocities, i, first).scale(L::from_f64(0.95)) + fall;
                (x.add_scaled(L::from_f64(cx.h), v), v)
            };
            x.store(view.positions, i, first);
            v.store(view.velocities, i, first);
            let filtered = V3::<L>::load(view.extra.rows(0, i), 0, first).scale(L::from_f64(0.75));
            filtered.add_scaled(L::from_f64(0.25), v).store(view.extra.rows_mut(0, i), 0, first);
            let [count, sum] = [0, 1].map(|k| L::load(&view.extra.rows(1, i)[k], first));
            (count + L::one()).store(&mut view.extra.rows_mut(1, i)[0], first);
            (count + sum).store(&mut view.extra.rows_mut(1, i)[1], first);
            // (0, sin, 0, cos) q
            let [x, y, z, w] = [0, 1, 2, 3].map(|c| L::load(&view.extra.rows(2, i)[c], first));
            let turned = [cos * x + sin * z, cos * y + sin * w, cos * z - sin * x, cos * w - sin * y];
            for (row, q) in view.extra.rows_mut(2, i).iter_mut().zip(turned) {
                q.store(row, first);
            }
        }
        SolidContacts::default()
    }
}

/// The solver in float32, compiled once.
pub fn keeper() -> Solver<f32> {
    Solver::new(Keeper)
}
