//! Grooms.

use std::path::PathBuf;
use std::sync::Arc;

use forelock::core::groom::{Groom, Import, Labels, repair, resample};
use forelock::io;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{arrays, error};

/// Strands at rest: positions in metres, y up, root first.
///
/// ``Groom(positions)`` takes an array of shape [S, N, 3]; ``Groom(positions, strand_offsets)``
/// takes [P, 3] and the first particle of each strand with P at the end, [S + 1]. Repeated points
/// are merged, and strands that are not finite are dropped: see ``repairs``.
#[pyclass(name = "Groom", module = "forelock", frozen)]
#[derive(Clone, Debug)]
pub struct PyGroom {
    pub groom: Arc<Groom>,
    /// What was repaired, one sentence each.
    #[pyo3(get)]
    repairs: Vec<String>,
}

impl PyGroom {
    /// A groom that needs no repair.
    pub fn of(groom: Groom) -> Self {
        Self { groom: groom.into(), repairs: Vec::new() }
    }
}

/// Values in threes.
fn threes<T: Copy>(values: Vec<T>) -> Vec<[T; 3]> {
    values.as_chunks().0.to_vec()
}

#[pymethods]
impl PyGroom {
    #[new]
    #[pyo3(signature = (positions, strand_offsets=None))]
    fn new(positions: &Bound<'_, PyAny>, strand_offsets: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let (points, own) = arrays::points(positions)?;
        let offsets = match (strand_offsets, own) {
            (Some(given), None) => arrays::counts(given)?,
            (None, Some(own)) => own,
            (Some(_), Some(_)) => return Err(error("positions of shape [S, N, 3] take no strand_offsets")),
            (None, None) => return Err(error("positions of shape [P, 3] need strand_offsets, [S + 1]")),
        };
        let (groom, report) = repair(Groom::new(points, offsets).map_err(error)?);
        if groom.strand_count() == 0 {
            return Err(error(format!("no strand can be used: {}", report.sentences().join("; "))));
        }
        Ok(Self { groom: groom.into(), repairs: report.sentences() })
    }

    /// Reads a file; its ending names the format. ``unit`` is m, cm, mm or in, ``up`` y or z,
    /// ``scale`` a factor on all lengths.
    #[staticmethod]
    #[pyo3(signature = (path, *, unit="m", up="y", scale=1.0))]
    fn load(py: Python<'_>, path: PathBuf, unit: &str, up: &str, scale: f64) -> PyResult<Self> {
        let import = Import { unit: unit.parse().map_err(error)?, up: up.parse().map_err(error)?, scale };
        let imported = py.detach(|| io::read_groom(&path, &import)).map_err(error)?;
        Ok(Self { groom: imported.groom.into(), repairs: imported.repairs.sentences() })
    }

    /// Writes a file in metres, y up; its ending names the format.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| io::write_groom(&path, &self.groom)).map_err(error)
    }

    /// The groom with ``particles`` particles on each strand, at equal distances.
    fn resample(&self, py: Python<'_>, particles: usize) -> PyResult<Self> {
        let groom = py.detach(|| resample(&self.groom, particles)).map_err(error)?;
        Ok(Self::of(groom))
    }

    /// The labels of the strands that the groom has, as copies: ``ids`` and ``group_ids``, int32
    /// [S]; ``guides``, bool [S]; ``closest_guides``, int32 [S, 3], -1 for none; ``guide_weights``,
    /// float32 [S, 3].
    #[getter]
    fn labels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let Labels { ids, group_ids, guides, closest_guides, guide_weights } = &self.groom.labels;
        let dict = PyDict::new(py);
        for (name, numbers) in [("ids", ids), ("group_ids", group_ids)] {
            if let Some(numbers) = numbers {
                dict.set_item(name, arrays::numbers(py, numbers))?;
            }
        }
        if let Some(guides) = guides {
            dict.set_item("guides", arrays::numbers(py, guides))?;
        }
        if let Some(closest) = closest_guides {
            dict.set_item("closest_guides", arrays::threes(py, closest)?)?;
        }
        if let Some(weights) = guide_weights {
            dict.set_item("guide_weights", arrays::threes(py, weights)?)?;
        }
        Ok(dict)
    }

    /// The groom with these labels, named and shaped as in ``labels``, in place of those it has.
    fn with_labels(&self, labels: &Bound<'_, PyDict>) -> PyResult<Self> {
        let mut groom = (*self.groom).clone();
        groom.labels = Labels::default();
        for (name, values) in labels {
            let own = &mut groom.labels;
            match name.extract::<String>()?.as_str() {
                "ids" => own.ids = Some(arrays::rows(&values, "int32", 1)?),
                "group_ids" => own.group_ids = Some(arrays::rows(&values, "int32", 1)?),
                "guides" => own.guides = Some(arrays::rows(&values, "bool", 1)?),
                "closest_guides" => own.closest_guides = Some(threes(arrays::rows(&values, "int32", 3)?)),
                "guide_weights" => own.guide_weights = Some(threes(arrays::rows(&values, "float32", 3)?)),
                other => {
                    return Err(error(format!(
                        "there is no label {other:?}: ids, group_ids, guides, closest_guides, guide_weights"
                    )));
                }
            }
        }
        groom.check_attributes().map_err(error)?;
        Ok(Self { groom: groom.into(), repairs: self.repairs.clone() })
    }

    /// Positions of all particles, float32 [P, 3], metres: a read-only view.
    #[getter]
    fn positions<'py>(slf: Bound<'py, Self>) -> Bound<'py, PyArray2<f32>> {
        let groom = slf.get().groom.clone();
        // SAFETY: the groom of a frozen class does not change, and the array holds the object.
        unsafe { arrays::view(slf.into_any(), groom.positions()) }
    }

    /// The first particle of each strand, and their number, uint32 [S + 1].
    #[getter]
    fn strand_offsets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        arrays::numbers(py, self.groom.strand_offsets())
    }

    /// Number of strands.
    #[getter]
    fn strands(&self) -> usize {
        self.groom.strand_count()
    }

    /// Number of particles.
    #[getter]
    fn particles(&self) -> usize {
        self.groom.particle_count()
    }

    fn __len__(&self) -> usize {
        self.groom.strand_count()
    }

    fn __repr__(&self) -> String {
        format!("Groom({} strands, {} particles)", self.groom.strand_count(), self.groom.particle_count())
    }
}
