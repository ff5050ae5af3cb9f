//! Whole runs.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use forelock::{Backend, Progress, RunOptions};
use pyo3::prelude::*;

use crate::error;
use crate::scene::PyScene;

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
    let cancel = AtomicBool::new(false);
    let mut stopped = None;
    let (mut what, mut done, mut total) = ("", 0, 0);
    let summary = py.detach(|| {
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
                progress.as_ref().map_or(Ok(()), |own| own.call1(py, (what, done, total)).map(drop))
            });
            if let Err(error) = told {
                cancel.store(true, Ordering::Relaxed);
                stopped.get_or_insert(error);
            }
        };
        let options = RunOptions { out, resume, backend: Backend::Cpu };
        forelock::simulate(&scene, &options, &mut observe, &cancel)
    });
    if let Some(stopped) = stopped {
        return Err(stopped);
    }
    serde_json::to_string(&summary.map_err(error)?).map_err(error)
}
