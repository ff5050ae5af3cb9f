//! Caches: the frames of a run.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use forelock::io::Cache;
use glam::Vec3;
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;

use crate::{arrays, error};

/// The memory of a frame that was read.
#[pyclass(frozen)]
struct Read {
    positions: Vec<Vec3>,
}

/// The frames of a run in an .npz file: ``cache[i]`` is float32 [P, 3], metres.
#[pyclass(name = "Cache", module = "forelock", frozen)]
pub struct PyCache {
    cache: Mutex<Cache>,
    frames: usize,
}

#[pymethods]
impl PyCache {
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let cache = Cache::open(&path).map_err(error)?;
        Ok(Self { frames: cache.frames(), cache: Mutex::new(cache) })
    }

    fn __len__(&self) -> usize {
        self.frames
    }

    fn __getitem__<'py>(&self, py: Python<'py>, frame: isize) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let from_end = if frame < 0 { frame.saturating_add_unsigned(self.frames) } else { frame };
        let index = usize::try_from(from_end).ok().filter(|own| *own < self.frames);
        let index =
            index.ok_or_else(|| PyIndexError::new_err(format!("there are {} frames", self.frames)))?;
        let positions = py.detach(|| {
            let mut positions = Vec::new();
            let mut cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
            cache.read_frame(index, &mut positions).map(|()| positions)
        });
        let read = Bound::new(py, Read { positions: positions.map_err(error)? })?;
        // SAFETY: the object is frozen, and the array holds it.
        Ok(unsafe { arrays::view(read.clone().into_any(), &read.get().positions) })
    }

    /// The first particle of each strand, and their number, uint32 [S + 1].
    #[getter]
    fn strand_offsets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        arrays::numbers(py, cache.strand_offsets())
    }

    /// The times of the frames, seconds, float64 [F]; None if the file has none.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        cache.times_secs().map(|times| arrays::numbers(py, times))
    }

    fn __repr__(&self) -> String {
        format!("Cache({} frames)", self.frames)
    }
}
