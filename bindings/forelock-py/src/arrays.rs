//! NumPy arrays of points, poses and numbers.

use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};
use numpy::ndarray::ArrayView2;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use forelock::core::pose::Pose;

use crate::error;

/// `values` as a contiguous array of the type `dtype`, without a copy if it is one.
fn contiguous<'py>(values: &Bound<'py, PyAny>, dtype: &str) -> PyResult<Bound<'py, PyAny>> {
    let py = values.py();
    let options = PyDict::new(py);
    options.set_item("dtype", dtype)?;
    py.import("numpy")?.call_method("ascontiguousarray", (values,), Some(&options))
}

/// The points of an array of shape `[P, 3]` or `[S, N, 3]`, and the strand offsets of the latter.
pub fn points(values: &Bound<'_, PyAny>) -> PyResult<(Vec<Vec3>, Option<Vec<u32>>)> {
    let array: PyReadonlyArrayDyn<'_, f32> = contiguous(values, "float32")?.extract()?;
    let shape = array.shape().to_vec();
    let flat = array.as_slice().map_err(error)?;
    let points =
        || bytemuck::cast_slice::<f32, [f32; 3]>(flat).iter().map(|p| Vec3::from_array(*p)).collect();
    match shape[..] {
        [_, 3] => Ok((points(), None)),
        [strands, each, 3] => {
            let offset = |strand: usize| {
                u32::try_from(strand * each).map_err(|_| error("more than 4,294,967,295 particles"))
            };
            let offsets = (0..=strands).map(offset).collect::<PyResult<_>>()?;
            Ok((points(), Some(offsets)))
        }
        _ => Err(error(format!("positions have the shape {shape:?}, but must have [P, 3] or [S, N, 3]"))),
    }
}

/// The whole numbers of an array of shape `[N]`.
pub fn counts(values: &Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
    let array: PyReadonlyArrayDyn<'_, i64> = contiguous(values, "int64")?.extract()?;
    let counts = array.as_slice().map_err(error)?.iter();
    let count =
        |own: &i64| u32::try_from(*own).map_err(|_| error(format!("{own} is no number of particles")));
    counts.map(count).collect()
}

/// The values of an array of shape `[S]`, or `[S, 3]` for three `each`, converted to `dtype`.
pub fn rows<T: numpy::Element + Copy>(
    values: &Bound<'_, PyAny>,
    dtype: &str,
    each: usize,
) -> PyResult<Vec<T>> {
    let array: PyReadonlyArrayDyn<'_, T> = contiguous(values, dtype)?.extract()?;
    let is_right = match *array.shape() {
        [_] => each == 1,
        [_, own] => each > 1 && own == each,
        _ => false,
    };
    if !is_right {
        let shape = if each == 1 { "[S]".to_owned() } else { format!("[S, {each}]") };
        return Err(error(format!("an array has the shape {:?}, but must have {shape}", array.shape())));
    }
    Ok(array.as_slice().map_err(error)?.to_vec())
}

/// A pose from a 4 × 4 matrix without scale, world from local.
pub fn pose(values: &Bound<'_, PyAny>) -> PyResult<Pose> {
    let array: PyReadonlyArrayDyn<'_, f64> = contiguous(values, "float64")?.extract()?;
    let rows: Option<&[f64; 16]> = array.as_slice().map_err(error)?.try_into().ok();
    let rows = rows.filter(|_| array.shape() == [4, 4]);
    let rows = rows.ok_or_else(|| error(format!("a pose is a 4 × 4 matrix, not {:?}", array.shape())))?;
    let matrix = DMat4::from_cols_array(rows).transpose();
    let turn = DMat3::from_mat4(matrix);
    let off = turn.transpose() * turn - DMat3::IDENTITY;
    let is_rigid = off.to_cols_array().iter().all(|own| own.abs() < 1e-4) && turn.determinant() > 0.0;
    if !is_rigid || matrix.row(3).to_array() != [0.0, 0.0, 0.0, 1.0] {
        return Err(error(
            "a pose turns and moves only: its matrix must be a rotation and a last row 0 0 0 1",
        ));
    }
    Ok(Pose::new(DQuat::from_mat3(&turn).normalize(), matrix.w_axis.truncate()))
}

/// `pose` as a 4 × 4 matrix.
pub fn matrix<'py>(py: Python<'py>, pose: &Pose) -> Bound<'py, PyArray2<f64>> {
    let turn = pose.matrix();
    let row = |k: usize| [turn.row(k).x, turn.row(k).y, turn.row(k).z, pose.translation[k]];
    let rows = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
    PyArray2::from_vec2(py, &rows.map(Vec::from)).unwrap_or_else(|_| PyArray2::zeros(py, [4, 4], false))
}

/// Three numbers as a vector.
pub fn vector(values: [f64; 3]) -> DVec3 {
    DVec3::from_array(values)
}

/// A read-only view, `[P, 3]`, of the `points` that `owner` holds.
///
/// # Safety
/// The points stay where they are and do not change as long as `owner` lives.
pub unsafe fn view<'py>(owner: Bound<'py, PyAny>, points: &[Vec3]) -> Bound<'py, PyArray2<f32>> {
    let flat: &[f32] = bytemuck::cast_slice(points);
    let rows = ArrayView2::from(bytemuck::cast_slice::<f32, [f32; 3]>(flat));
    // SAFETY: the caller's promise.
    let array = unsafe { PyArray2::borrow_from_array(&rows, owner) };
    array.readwrite().make_nonwriteable();
    array
}

/// A copy of `rows`, `[S, 3]`.
pub fn threes<'py, T: numpy::Element + Copy>(
    py: Python<'py>,
    rows: &[[T; 3]],
) -> PyResult<Bound<'py, PyArray2<T>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), 3])
}

/// A copy of `numbers`, `[N]`.
pub fn numbers<'py, T: numpy::Element + Copy>(py: Python<'py>, numbers: &[T]) -> Bound<'py, PyArray1<T>> {
    PyArray1::from_slice(py, numbers)
}
