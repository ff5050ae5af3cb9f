//! Combing along a stroke.
//!
//! # Theory
//! The strand is rebuilt edge by edge from its root. An edge whose new position is within the
//! stroke's radius is rotated towards the stroke's direction at that point, by the rotation from
//! the strand's flow (its direction averaged over `detail`) to that direction. So hair is aligned
//! with the stroke, and waves finer than `detail` are kept.

use glam::Vec3;

use super::chain::{falloff, rise, turn};
use super::change::Change;
use super::error::check;
use super::{EditError, Stroke};
use crate::groom::Groom;

crate::documented! {
/// `comb`: rotates hair along a stroke; lengths are kept.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Comb {
    /// The polyline of the stroke, two points or more; the effect decreases with the distance from
    /// it. Unit m, no default, range -1e4 to 1e4 each.
    pub points: Vec<Vec3>,
    /// Distance from the polyline at which the effect ends. Unit m, default 0.03, range 1e-6 to
    /// 1000.
    #[cfg_attr(feature = "serde", serde(default = "radius"))]
    pub radius: f32,
    /// Fraction of the rotation for hair on the polyline. No unit, default 1, range 0 to 1; 0 does
    /// nothing, 1 aligns hair with the polyline.
    #[cfg_attr(feature = "serde", serde(default = "strength"))]
    pub strength: f32,
    /// Length over which the hair's direction is averaged; finer curls are kept. Unit m, default
    /// 0.03, range 0 to 1000; 0 straightens.
    #[cfg_attr(feature = "serde", serde(default = "detail"))]
    pub detail: f32,
    /// Length from the root over which the effect increases to its full strength. Unit m, default
    /// 0.005, range 0 to 1000; 0 rotates the first edge fully.
    #[cfg_attr(feature = "serde", serde(default = "ease"))]
    pub ease: f32,
}
}

fn radius() -> f32 {
    0.03
}
fn strength() -> f32 {
    1.0
}
fn detail() -> f32 {
    0.03
}
fn ease() -> f32 {
    0.005
}

impl Comb {
    /// Combing along `points` (metres) with default values of all other parameters.
    pub fn along(points: Vec<Vec3>) -> Self {
        Self { points, radius: radius(), strength: strength(), detail: detail(), ease: ease() }
    }

    fn stroke(&self) -> Stroke {
        Stroke { points: self.points.clone(), radius: self.radius }
    }

    pub(super) fn validate(&self) -> Result<(), EditError> {
        self.stroke().validate()?;
        check::<Self>(&[("strength", &[self.strength]), ("detail", &[self.detail]), ("ease", &[self.ease])])
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        let stroke = self.stroke();
        let (reach, ease) = (f64::from(self.radius), f64::from(self.ease));
        Change::moved(groom, selected, |chain| {
            let directions = chain.directions();
            let flow = chain.smoothed_directions(self.detail.into());
            let arcs = chain.arcs();
            let mut touched = false;
            let points = chain.rebuilt(|edge, from| {
                let middle = from + directions[edge] * (0.5 * chain.lengths[edge]);
                let (distance, along) = stroke.nearest(middle.as_vec3());
                let set_in = if ease > 0.0 { rise(arcs[edge + 1] / ease) } else { 1.0 };
                let share = f64::from(self.strength) * falloff(f64::from(distance) / reach) * set_in;
                if share == 0.0 {
                    return directions[edge];
                }
                touched = true;
                turn(flow[edge], along.as_dvec3(), share) * directions[edge]
            });
            touched.then_some(points)
        })
    }
}
