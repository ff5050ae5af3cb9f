//! The strands to which an edit applies.

use super::error::check;
use super::{Ball, EditError, HalfSpace};
use crate::body::Region;
use crate::groom::Groom;
use crate::groom::grow::random::Random;
use glam::Vec3;

crate::documented! {
/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Cuboid {
    /// One corner. Unit m, no default, range -1e4 to 1e4 each.
    pub from: Vec3,
    /// The opposite corner. Unit m, no default, range -1e4 to 1e4 each.
    pub to: Vec3,
}
}

crate::documented! {
/// A selection of strands by the positions of their roots, by index and at random. A strand must
/// satisfy all conditions that are given.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Selection {
    /// Select roots in this ball. Default everywhere.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub sphere: Option<Ball>,
    /// Select roots in this box. Default everywhere.
    #[cfg_attr(feature = "serde", serde(rename = "box", skip_serializing_if = "Option::is_none"))]
    pub cuboid: Option<Cuboid>,
    /// Select roots on the side of this plane to which its normal points. Default everywhere.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub plane: Option<HalfSpace>,
    /// Select roots in this region of the built-in head: "scalp" or "beard". Default everywhere.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub region: Option<Region>,
    /// Range of strand indices: the first index, and the index after the last. Default all, range 0
    /// to 4294967295 each.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub strands: Option<[u32; 2]>,
    /// Fraction of the strands, drawn at random. No unit, default 1, range 0 to 1; 0 selects none.
    pub share: f32,
    /// Seed of that draw. No unit, default 1, range 0 or more; 0 is a valid seed.
    pub seed: u64,
    /// Whether to select the other strands instead. Default false.
    pub invert: bool,
}
}

impl Default for Selection {
    fn default() -> Self {
        Self {
            sphere: None,
            cuboid: None,
            plane: None,
            region: None,
            strands: None,
            share: 1.0,
            seed: 1,
            invert: false,
        }
    }
}

impl Selection {
    /// Checks every field against its documented range.
    ///
    /// # Errors
    /// [`EditError::Parameter`] for the first field that is out of range.
    pub fn validate(&self) -> Result<(), EditError> {
        self.sphere.iter().try_for_each(Ball::validate).map_err(|e| e.under("sphere"))?;
        self.plane.iter().try_for_each(HalfSpace::validate).map_err(|e| e.under("plane"))?;
        if let Some(cuboid) = &self.cuboid {
            check::<Cuboid>(&[("from", &cuboid.from.to_array()), ("to", &cuboid.to.to_array())])
                .map_err(|e| e.under("box"))?;
        }
        check::<Self>(&[("share", &[self.share])])
    }

    /// Whether each strand of `groom` is selected, one entry for each strand.
    pub fn strands(&self, groom: &Groom) -> Vec<bool> {
        (0..groom.strand_count()).map(|strand| self.selects(groom, strand) != self.invert).collect()
    }

    fn selects(&self, groom: &Groom, strand: usize) -> bool {
        let Some(&root) = groom.strand(strand).first() else { return false };
        let inside = |cuboid: &Cuboid| {
            let (lo, hi) = (cuboid.from.min(cuboid.to), cuboid.from.max(cuboid.to));
            root.cmpge(lo).all() && root.cmple(hi).all()
        };
        self.sphere.is_none_or(|ball| root.distance(ball.centre) <= ball.radius)
            && self.cuboid.as_ref().is_none_or(inside)
            && self.plane.is_none_or(|plane| plane.distance(root) <= 0.0)
            && self.region.is_none_or(|region| region.weight(root) > 0.0)
            && self.strands.is_none_or(|[from, to]| (from as usize..to as usize).contains(&strand))
            && Random::new(self.seed, strand as u64).unit() < self.share
    }
}
