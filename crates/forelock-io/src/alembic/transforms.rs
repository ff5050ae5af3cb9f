//! Transforms of the objects above a strand group (schema `AbcGeom_Xform_v3`).
//!
//! # Theory
//! `.ops` lists operations, one byte each with the kind in its upper four bits, and `.vals` their
//! numbers: 0 scale (3), 1 translation (3), 2 rotation about an axis by degrees (4), 3 matrix (16),
//! 4–6 rotation about x, y, z by degrees (1). An operation acts before those listed above it:
//!
//!   p' = O₀ O₁ … Oₙ₋₁ p.   (1)
//!
//! Matrices are stored for row vectors, row by row, which are the columns of a matrix for column
//! vectors. The transform to the world is that of the parent times the own one, or the own one
//! where `.inherits` is false.
//!
//! # Practice
//! Missing numbers leave an operation out.
//!
//! # Limitations
//! The last row of a matrix must be that of an affine map; projections are ignored.

use std::{
    io::{Read, Seek},
    sync::Arc,
};

use glam::{DAffine3, DMat4, DQuat, DVec3, DVec4};

use super::{
    AlembicError,
    archive::{Archive, Property},
    ogawa::Child,
};

/// The transform of an object, relative to that of its parent.
pub(super) struct Transform {
    parent: Option<Arc<Self>>,
    ops: Option<Property>,
    vals: Option<Property>,
    inherits: Option<Property>,
}

impl Transform {
    /// The transform with the properties in the group `xform`, below `parent`.
    pub fn read<R: Read + Seek>(
        archive: &mut Archive<R>,
        xform: Child,
        parent: Option<Arc<Self>>,
    ) -> Result<Self, AlembicError> {
        let properties = archive.properties(xform)?;
        let find = |name| Property::find(&properties, name).cloned();
        Ok(Self { parent, ops: find(".ops"), vals: find(".vals"), inherits: find(".inherits") })
    }

    /// The numbers of this transform and those above it.
    pub fn moving(&self) -> impl Iterator<Item = &Property> {
        let chain = std::iter::successors(Some(self), |transform| transform.parent.as_deref());
        chain.filter_map(|transform| transform.vals.as_ref())
    }

    /// The transform to the world at `time_secs`.
    pub fn world<R: Read + Seek>(
        &self,
        archive: &mut Archive<R>,
        time_secs: f64,
    ) -> Result<DAffine3, AlembicError> {
        let mut world = DAffine3::IDENTITY;
        let mut next = Some(self);
        while let Some(transform) = next {
            world = transform.local(archive, time_secs)? * world;
            let inherits = transform.inherits.as_ref().map(|property| archive.sample(property, time_secs));
            let inherits = inherits.transpose()?.flatten().and_then(|sample| sample.integers());
            let is_alone = inherits.is_some_and(|values| values.first() == Some(&0));
            next = transform.parent.as_deref().filter(|_| !is_alone);
        }
        Ok(world)
    }

    fn local<R: Read + Seek>(
        &self,
        archive: &mut Archive<R>,
        time_secs: f64,
    ) -> Result<DAffine3, AlembicError> {
        let [Some(ops), Some(vals)] = [&self.ops, &self.vals] else { return Ok(DAffine3::IDENTITY) };
        let ops = archive.sample(ops, time_secs)?.and_then(|sample| sample.integers());
        let vals = archive.sample(vals, time_secs)?.and_then(|sample| sample.doubles());
        Ok(compose(&ops.unwrap_or_default(), &vals.unwrap_or_default()))
    }
}

/// The product of the operations `ops` with the numbers `vals`, equation (1).
fn compose(ops: &[i32], mut vals: &[f64]) -> DAffine3 {
    let mut product = DAffine3::IDENTITY;
    for op in ops {
        let kind = op >> 4;
        let count = match kind {
            0 | 1 => 3,
            2 => 4,
            3 => 16,
            4..=6 => 1,
            _ => 0,
        };
        let Some((own, rest)) = vals.split_at_checked(count) else { break };
        vals = rest;
        product *= match (kind, own) {
            (0, &[x, y, z]) => DAffine3::from_scale(DVec3::new(x, y, z)),
            (1, &[x, y, z]) => DAffine3::from_translation(DVec3::new(x, y, z)),
            (2, &[x, y, z, degrees]) => rotation(DVec3::new(x, y, z), degrees),
            (3, numbers) => matrix(numbers),
            (4..=6, &[degrees]) => rotation(DVec3::AXES[kind as usize - 4], degrees),
            _ => DAffine3::IDENTITY,
        };
    }
    product
}

fn rotation(axis: DVec3, degrees: f64) -> DAffine3 {
    let axis = axis.try_normalize().unwrap_or(DVec3::X);
    DAffine3::from_quat(DQuat::from_axis_angle(axis, degrees.to_radians()))
}

fn matrix(numbers: &[f64]) -> DAffine3 {
    let columns = numbers.as_chunks::<4>().0;
    let column = |i: usize| columns.get(i).map_or(DVec4::ZERO, |&c| DVec4::from_array(c));
    DAffine3::from_mat4(DMat4::from_cols(
        column(0),
        column(1),
        column(2),
        DVec4::W + column(3) * DVec4::new(1.0, 1.0, 1.0, 0.0),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_act_in_the_order_of_the_library() {
        // Translate, then rotate about z, then scale, as a program lists them.
        let map = compose(&[0x10, 0x60, 0x00], &[1.0, 2.0, 3.0, 90.0, 2.0, 2.0, 2.0]);
        assert!(map.transform_point3(DVec3::X).distance(DVec3::new(1.0, 4.0, 3.0)) < 1e-12);
        // The same as one matrix of rows.
        let rows = [0.0, 2.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 1.0, 2.0, 3.0, 1.0];
        let same = compose(&[0x30], &rows);
        assert!(same.transform_point3(DVec3::X).distance(DVec3::new(1.0, 4.0, 3.0)) < 1e-12);
        let about = compose(&[0x20], &[0.0, 0.0, 5.0, 90.0]);
        assert!(about.transform_point3(DVec3::X).distance(DVec3::Y) < 1e-12);
        // What is cut short is left out.
        assert_eq!(compose(&[0x10, 0x30], &[1.0, 0.0, 0.0, 4.0]), DAffine3::from_translation(DVec3::X));
    }
}
