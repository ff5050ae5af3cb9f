//! The transforms of prims.
//!
//! # Theory
//! `xformOpOrder` lists the operations of a prim; the last one acts on points first, then the one
//! before it, and after the first one those of the parent. `!invert!` before a name asks for the
//! inverse, and `!resetXformStack!` ignores the parent. `rotateXYZ` turns about x, then y, then z,
//! in degrees. Matrices act on row vectors: their last row is the translation.
//!
//! # Limitations
//! Quaternions between two samples are interpolated by their numbers and normalised.

use std::io::{Read, Seek};

use glam::{DMat4, DQuat, DVec3, EulerRot};

use super::{
    UsdError, invalid,
    layer::{Layer, Prim, Value},
};

/// The transform from `prim` to the layer, at `time`.
pub(super) fn world_from<R: Read + Seek>(
    layer: &Layer<R>,
    prim: &Prim,
    time: f64,
) -> Result<DMat4, UsdError> {
    let mut world = DMat4::IDENTITY;
    let mut next = Some(prim);
    while let Some(prim) = next {
        next = prim.parent.map(|parent| &layer.prims[parent]);
        let Some(order) = layer.find(prim, "xformOpOrder", time)? else { continue };
        let Value::Words(order) = &*order else { continue };
        let mut local = DMat4::IDENTITY;
        for name in order {
            if &**name == "!resetXformStack!" {
                next = None;
                continue;
            }
            let (name, is_inverse) = match name.strip_prefix("!invert!") {
                Some(name) => (name, true),
                None => (&**name, false),
            };
            let Some(value) = layer.find(prim, name, time)? else { continue };
            let numbers = value.doubles().unwrap_or_default();
            let operation = operation(name, &numbers);
            let operation = operation.ok_or_else(|| {
                invalid(format!(
                    "the operation `{name}` of {} is not known or has {} numbers; apply it before exporting",
                    layer.path(prim),
                    numbers.len()
                ))
            })?;
            local *= if is_inverse { operation.inverse() } else { operation };
        }
        world = local * world;
    }
    Ok(world)
}

/// The matrix of the operation `name`, for column vectors.
fn operation(name: &str, numbers: &[f64]) -> Option<DMat4> {
    let kind = name.strip_prefix("xformOp:")?.split(':').next()?;
    let axis = |axis: &str| match axis {
        "X" => Some(DVec3::X),
        "Y" => Some(DVec3::Y),
        "Z" => Some(DVec3::Z),
        _ => None,
    };
    let vector = || Some(DVec3::from_array(*numbers.first_chunk::<3>()?));
    match kind {
        "translate" => return Some(DMat4::from_translation(vector()?)),
        "scale" => return Some(DMat4::from_scale(vector()?)),
        "transform" => return Some(DMat4::from_cols_array(numbers.first_chunk::<16>()?)),
        "orient" => {
            let turn = DQuat::from_array(*numbers.first_chunk::<4>()?);
            return Some(DMat4::from_quat(if turn.length_squared() > 0.0 { turn.normalize() } else { turn }));
        }
        _ => {}
    }
    if let Some(along) = kind.strip_prefix("translate").and_then(axis) {
        return Some(DMat4::from_translation(along * *numbers.first()?));
    }
    if let Some(along) = kind.strip_prefix("scale").and_then(axis) {
        return Some(DMat4::from_scale(DVec3::ONE + along * (*numbers.first()? - 1.0)));
    }
    let about = kind.strip_prefix("rotate")?;
    if let Some(axis) = axis(about) {
        return Some(DMat4::from_axis_angle(axis, numbers.first()?.to_radians()));
    }
    let [x, y, z] = numbers.first_chunk::<3>()?.map(f64::to_radians);
    // The first rotation stands last in the product.
    let (order, a, b, c) = match about {
        "XYZ" => (EulerRot::ZYX, z, y, x),
        "XZY" => (EulerRot::YZX, y, z, x),
        "YXZ" => (EulerRot::ZXY, z, x, y),
        "YZX" => (EulerRot::XZY, x, z, y),
        "ZXY" => (EulerRot::YXZ, y, x, z),
        "ZYX" => (EulerRot::XYZ, x, y, z),
        _ => return None,
    };
    Some(DMat4::from_euler(order, a, b, c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turn(axis: char, degrees: f64) -> DMat4 {
        operation(&format!("xformOp:rotate{axis}"), &[degrees]).unwrap()
    }

    #[test]
    fn rotations_act_in_the_order_of_their_letters() {
        let angles = [10.0, -20.0, 150.0];
        for order in ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"] {
            let found = operation(&format!("xformOp:rotate{order}:suffix"), &angles).unwrap();
            let wanted = order
                .chars()
                .fold(DMat4::IDENTITY, |before, axis| turn(axis, angles["XYZ".find(axis).unwrap()]) * before);
            assert!(found.abs_diff_eq(wanted, 1e-12), "{order}");
        }
        let quarter = turn('X', -90.0).transform_point3(DVec3::new(1.0, 2.0, 3.0));
        assert!(quarter.abs_diff_eq(DVec3::new(1.0, 3.0, -2.0), 1e-12), "{quarter}");
    }

    #[test]
    fn single_axes_and_matrices() {
        let at = |name: &str, numbers: &[f64]| Some(operation(name, numbers)?.transform_point3(DVec3::ONE));
        assert_eq!(at("xformOp:translateZ", &[2.0]), Some(DVec3::new(1.0, 1.0, 3.0)));
        assert_eq!(at("xformOp:scaleY:a", &[4.0]), Some(DVec3::new(1.0, 4.0, 1.0)));
        let mut matrix = [0.0; 16];
        [matrix[0], matrix[5], matrix[10], matrix[15]] = [1.0; 4];
        matrix[12] = 7.0;
        assert_eq!(at("xformOp:transform", &matrix), Some(DVec3::new(8.0, 1.0, 1.0)));
        for (name, numbers) in
            [("xformOp:translate", 2), ("xformOp:shear", 3), ("scale", 3), ("xformOp:rotateXYZ", 1)]
        {
            assert_eq!(at(name, &[1.0; 3][..numbers]), None, "{name}");
        }
    }
}
