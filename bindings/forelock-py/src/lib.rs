//! Forelock in Python.
//!
//! # Practice
//! The classes here are adapters: each calls the crate `forelock` and converts arguments, errors
//! and arrays. Arrays of positions are views of memory that Rust holds: a view keeps its memory
//! alive, and what it shows never changes, so a step that comes while a view is in use writes
//! elsewhere. Long calls release the GIL and look for signals, so Ctrl-C ends them.

mod arrays;
mod cache;
mod groom;
mod run;
mod scene;
mod simulation;
mod values;

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    forelock,
    ForelockError,
    PyException,
    "What Forelock refuses: the message says what is wrong, where, and what to do."
);

/// `error` as an exception with the same message.
fn error(error: impl std::fmt::Display) -> PyErr {
    ForelockError::new_err(error.to_string())
}

/// Real-time simulation of dense hair, strand by strand.
#[pymodule]
fn _forelock(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("ForelockError", m.py().get_type::<ForelockError>())?;
    m.add_class::<groom::PyGroom>()?;
    m.add_class::<scene::PyScene>()?;
    m.add_class::<simulation::PySimulation>()?;
    m.add_class::<cache::PyCache>()?;
    m.add_function(wrap_pyfunction!(run::simulate, m)?)?;
    m.add_function(wrap_pyfunction!(run::train, m)?)
}
