//! How a combed strand is guided along the solids while it grows.
//!
//! # Theory
//!
//! Near a solid, the component of a strand's direction along the outward normal is kept above (c −
//! d) / λ, where d is the distance, c the distance of the strand's layer and λ a length. A strand
//! that falls on the solid therefore bends into its surface, and its distance approaches c
//! exponentially over λ, instead of being pushed out after it has entered.
//!
//! # Practice
//!
//! The drape is the body with the spaces that hair passes over: the ears, and the space in front of
//! the face. A strand whose root is a little below its surface rises to it gradually; that of a
//! deeper root stays under it, along the body.
//!
//! Distances are measured every few millimetres and extrapolated in between.

use glam::Vec3;

use super::Avoid;
use super::roots::Root;
use super::strand::{Field, PIECE, Traits};

/// Fraction of the comb's length over which a strand bends along a surface that it meets.
const GLIDE: f32 = 0.25;
/// Length in metres of combed hair that grows between two measurements of the distance.
const MEASURED: f32 = 6e-3;
/// Depth of a root in the drape, as a fraction of the comb's length, from which on its strand does
/// not rise to the drape.
pub(super) const TUCKED: f32 = 0.08;

/// A solid near a strand: the distance in metres and the normal, and where they were measured.
#[derive(Clone, Copy)]
struct Near {
    distance: f32,
    outwards: Vec3,
    at: Vec3,
}

impl Near {
    fn of(solid: &Avoid, at: Vec3, reach: f32) -> Option<Self> {
        solid(at, reach).map(|(distance, outwards)| Self { distance, outwards, at })
    }

    /// The distance at `x`, to first order.
    fn distance(&self, x: Vec3) -> f32 {
        self.distance + self.outwards.dot(x - self.at)
    }
}

/// Guides a combed strand along the solids.
pub(super) struct Guide<'a> {
    field: &'a Field<'a>,
    /// Distance of the strand's layer from the solid, in metres.
    layer: f32,
    /// How deep the root lies in the drape, in metres, negative.
    depth: f32,
    /// The inside of the drape, if the strand is so deep in it that it follows the body, as hair
    /// that is tucked behind an ear.
    under: Option<Near>,
    /// The solid at the last measurement, if it was near.
    near: Option<Near>,
    /// Length of the strand since then, in metres.
    since: f32,
}

impl<'a> Guide<'a> {
    pub(super) fn new(field: &'a Field<'a>, root: &Root, traits: &Traits) -> Self {
        let (at, length) = (root.position, field.params.comb_length);
        let near = field.drape.and_then(|drape| Near::of(drape, at, GLIDE * length));
        let depth = near.map_or(0.0, |near| near.distance.min(0.0));
        let under = near.filter(|_| traits.tucked);
        let near = match under {
            Some(_) => field.body.and_then(|body| Near::of(body, at, GLIDE * length)),
            None => near,
        };
        Self { field, layer: traits.layer, depth, under, near, since: 0.0 }
    }

    /// The point at the distance `piece` from `from` in direction `heading`, turned along the solid
    /// where it is near; a lower bound of its distance from the body; and the solid's normal if the
    /// strand lies on it.
    pub(super) fn glide(
        &mut self,
        from: Vec3,
        heading: Vec3,
        piece: f32,
        arc: f32,
    ) -> (Vec3, f32, Option<Vec3>) {
        let (Some(drape), Some(body)) = (self.field.drape, self.field.body) else {
            return (from + heading * piece, f32::INFINITY, None);
        };
        let length = GLIDE * self.field.params.comb_length;
        let margin = self.field.margin(arc);
        let rise = self.field.rise(arc);
        let mut heading = heading;
        let mut layer = self.layer * rise;
        match self.under {
            Some(_) => layer *= 0.3,
            None => layer += self.depth * (1.0 - rise) * (1.0 - rise),
        }
        let clearance = margin + layer;
        let mut touched = None;
        if let Some(near) = self.near {
            // Distances approach their limits exponentially over `length`.
            let rising = ((clearance - near.distance(from)) / length).min(0.7);
            let lacking = rising - heading.dot(near.outwards);
            if lacking > 0.0 {
                heading = (heading + near.outwards * lacking).normalize_or(near.outwards);
                touched = Some(near.outwards);
            }
        }
        if let Some(under) = self.under.filter(|under| under.outwards.y > 0.0) {
            let excess = heading.dot(under.outwards) - (-under.distance(from) / length).max(0.0);
            heading = (heading - under.outwards * excess.max(0.0)).normalize_or(heading);
        }
        let mut to = from + heading * piece;
        let reach = clearance.max(margin) + length + PIECE;
        self.since += piece;
        if self.under.is_some() {
            (self.under, self.near) = (Near::of(drape, to, 0.0), Near::of(body, to, reach));
            self.since = 0.0;
        } else if self.since > MEASURED + 0.3 * self.near.map_or(0.0, |near| near.distance(to).max(0.0)) {
            self.near = Near::of(drape, to, reach);
            self.since = 0.0;
        }
        // The distance changes by little more than the way.
        let gap = self.near.map_or(reach, |near| near.distance) - 1.2 * self.since;
        if gap < margin {
            to = self.field.outside(to, Vec3::ZERO, arc);
        }
        (to, gap, touched)
    }
}
