//! Mirroring at a plane.

use glam::Vec3;

use super::EditError;
use super::change::{Change, NewStrand, Particle, What};
use super::error::{check, direction};
use crate::groom::Groom;

/// What happens to the strands on the other side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum MirrorMode {
    /// Strands rooted on the other side are removed, and mirrored strands are added.
    #[default]
    Replace,
    /// Mirrored strands are added to the existing ones.
    Add,
    /// Every selected strand is mirrored in place: left becomes right. This is the only edit that
    /// moves roots; applied twice, it restores the groom.
    Flip,
}

crate::documented! {
/// `mirror`: mirrors strands at a plane. The strands rooted on the side to which the normal points
/// are copied.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Mirror {
    /// What happens to the other side: "replace", "add" or "flip". Default "replace".
    pub mode: MirrorMode,
    /// A point of the plane. Unit m, default [0, 0, 0], range -1e4 to 1e4 each.
    pub point: Vec3,
    /// Normal of the plane, of any non-zero length; it points to the side that is copied. No unit,
    /// default [1, 0, 0], range -1e4 to 1e4 each.
    pub normal: Vec3,
}
}

impl Default for Mirror {
    fn default() -> Self {
        Self { mode: MirrorMode::Replace, point: Vec3::ZERO, normal: Vec3::X }
    }
}

impl Mirror {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[("point", &self.point.to_array())])?;
        direction("normal", self.normal)
    }

    /// Twice the signed distance of `p` from the plane, positive in the direction of the normal.
    fn beyond(&self, p: Vec3) -> f64 {
        let normal = self.normal.as_dvec3().normalize();
        2.0 * (p.as_dvec3() - self.point.as_dvec3()).dot(normal)
    }

    fn image(&self, p: Vec3) -> Vec3 {
        (p.as_dvec3() - self.normal.as_dvec3().normalize() * self.beyond(p)).as_vec3()
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        let strands = (0..groom.strand_count()).filter(|&s| selected[s]);
        if self.mode == MirrorMode::Flip {
            let images = strands.map(|s| (s, groom.strand(s).iter().map(|&p| self.image(p)).collect()));
            return Change { what: What::Moved(images.collect()), coarse: 0 };
        }
        let (copied, other): (Vec<usize>, Vec<usize>) =
            strands.partition(|&s| self.beyond(groom.strand(s)[0]) > 0.0);
        let mut removed = vec![false; groom.strand_count()];
        if self.mode == MirrorMode::Replace {
            other.iter().for_each(|&s| removed[s] = true);
        }
        let kept = (0..groom.strand_count()).filter(|&s| !removed[s]).map(NewStrand::kept);
        let images = copied.iter().map(|&source| {
            let points = groom.strand(source).iter().enumerate();
            let particle =
                |(edge, &p): (usize, &Vec3)| Particle { position: self.image(p), edge, fraction: 0.0 };
            NewStrand {
                source,
                particles: Some(points.map(particle).collect()),
                parents: Some(vec![(source, 1.0)]),
            }
        });
        Change { what: What::Rebuilt(kept.chain(images).collect()), coarse: 0 }
    }
}
