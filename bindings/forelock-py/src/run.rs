//! Whole runs and trainings.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use forelock::training::{TrainingConfig, TrainingOptions};
use forelock::{Backend, Progress, RunOptions};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;

use crate::scene::{PyScene, overrides};
use crate::{error, values};

/// Does `work` without the GIL and returns its result as JSON. `progress` is called with what is
/// done, steps done and steps in all. What it raises, or Ctrl-C, ends the work early.
fn watched<T: Serialize + Send, E: Display + Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&mut dyn FnMut(&Progress<'_>), &AtomicBool) -> Result<T, E> + Send,
) -> PyResult<String> {
    let cancel = AtomicBool::new(false);
    let mut stopped = None;
    let (mut what, mut done, mut total) = ("", 0, 0);
    let result = py.detach(|| {
        let mut observe = |own: &Progress<'_>| {
            match own {
                Progress::Begin { what: name, done: begun, total: all } => {
                    (what, done, total) = (name, *begun, *all);
                }
                Progress::Step => done += 1,
                Progress::Note(_) | Progress::End => return,
            }
            let told = Python::attach(|py| {
                py.check_signals()?;
                progress.map_or(Ok(()), |own| own.call1(py, (what, done, total)).map(drop))
            });
            if let Err(error) = told {
                cancel.store(true, Ordering::Relaxed);
                stopped.get_or_insert(error);
            }
        };
        work(&mut observe, &cancel)
    });
    if let Some(stopped) = stopped {
        return Err(stopped);
    }
    serde_json::to_string(&result.map_err(error)?).map_err(error)
}

/// Runs a scene into the folder ``out``, as ``forelock simulate`` does: cache, pictures, report.
/// Returns the summary as JSON. Ctrl-C ends it, after its pictures once all frames are done;
/// ``resume`` goes on with what is there.
/// ``progress`` is called with what is done, steps done and steps in all.
#[pyfunction]
#[pyo3(signature = (scene, out, *, resume=false, progress=None))]
pub fn simulate(
    py: Python<'_>,
    scene: &PyScene,
    out: PathBuf,
    resume: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let scene = scene.scene.clone();
    let options = RunOptions { out, resume, backend: Backend::Cpu };
    watched(py, progress.as_ref(), |observe, cancel| forelock::simulate(&scene, &options, observe, cancel))
}

/// Trains a model of the learned solver into the folder ``out``, as ``forelock train`` does.
/// ``config`` is a dict, the path of a file, or None for the training of the built-in head's hair;
/// ``set`` is a dict of dotted keys laid over it. Returns the summary as JSON. Ctrl-C ends it, and
/// ``resume`` goes on with what is there.
#[pyfunction]
#[pyo3(signature = (config, out, *, set=None, resume=false, progress=None))]
pub fn train(
    py: Python<'_>,
    config: &Bound<'_, PyAny>,
    out: PathBuf,
    set: Option<&Bound<'_, PyDict>>,
    resume: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let sets = overrides(set)?;
    let config = if config.is_none() {
        TrainingConfig::builtin(&sets)
    } else if let Ok(tables) = config.cast::<PyDict>() {
        let text = toml::to_string(&values::table(tables, 0)?).map_err(error)?;
        TrainingConfig::parse(&text, Path::new("the dict"), &sets)
    } else {
        TrainingConfig::load(&config.extract::<PathBuf>()?, &sets)
    };
    let (config, options) = (config.map_err(error)?, TrainingOptions { out, resume });
    watched(py, progress.as_ref(), |observe, cancel| {
        forelock::training::train(&config, &options, observe, cancel)
    })
}
