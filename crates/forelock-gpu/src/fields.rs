//! The distance fields of shapes in the buffer that all kernels sample.

use crate::collide::FIELD_NUMBERS;
use forelock_core::body::{Sdf, Shape};
use std::sync::Arc;

/// The fields of a shape; none of a primitive.
pub(crate) fn fields_of(shape: &Shape) -> &[Sdf] {
    match shape {
        Shape::Sdf(field) => std::slice::from_ref(field),
        Shape::Morph { morph, .. } => morph.fields(),
        _ => &[],
    }
}

/// Where `shape` is held, if it is.
pub(crate) fn place_of(held: &[(Shape, u32)], shape: &Shape) -> Option<u32> {
    let is_same = |own: &Shape| match (own, shape) {
        (Shape::Sdf(own), Shape::Sdf(other)) => Arc::ptr_eq(own, other),
        (Shape::Morph { morph: own, .. }, Shape::Morph { morph: other, .. }) => Arc::ptr_eq(own, other),
        _ => false,
    };
    held.iter().find(|(own, _)| is_same(own)).map(|(_, first)| *first)
}

/// [`FIELD_NUMBERS`] of a field whose values start at `first`.
pub(crate) fn describe(field: &Sdf, first: u32) -> [f32; FIELD_NUMBERS as usize] {
    let ([x, y, z], [i, j, k]) = (field.origin().to_array(), field.dims().as_vec3().to_array());
    let [a, b] = halves(first);
    let [c, d] = halves(table_of(field, first));
    [x, y, z, field.cell(), i, j, k, a, b, c, d]
}

/// An index in two halves, each of which a float holds exactly.
fn halves(index: u32) -> [f32; 2] {
    [(index >> 16) as f32, (index & 0xffff) as f32]
}

/// The first entry of the table of bricks of a field whose values start at `first`; 0 if it has
/// none.
pub(crate) fn table_of(field: &Sdf, first: u32) -> u32 {
    if field.is_refined() { first + field.values().len() as u32 } else { 0 }
}
