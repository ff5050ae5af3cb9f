//! Python values as TOML.

use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use toml::{Table, Value};

use crate::error;

/// The deepest nesting of a value.
const DEEPEST: usize = 16;

/// `value` in TOML. Paths become text; numbers of NumPy become numbers, and arrays lists.
pub fn to_toml(value: &Bound<'_, PyAny>) -> PyResult<Value> {
    nested(value, 0)
}

fn nested(value: &Bound<'_, PyAny>, depth: usize) -> PyResult<Value> {
    if depth > DEEPEST {
        return Err(error("the value is nested too deeply"));
    }
    // A bool is an int too.
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Boolean(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        return Ok(Value::Integer(value.extract()?));
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(value.extract()?));
    }
    if value.is_instance_of::<PyString>() {
        return Ok(Value::String(value.extract()?));
    }
    if let Ok(dict) = value.cast::<PyDict>() {
        return Ok(Value::Table(table(dict, depth + 1)?));
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let own = value.try_iter()?.map(|own| nested(&own?, depth + 1));
        return Ok(Value::Array(own.collect::<PyResult<_>>()?));
    }
    if value.hasattr("tolist")? {
        return nested(&value.call_method0("tolist")?, depth + 1);
    }
    if value.hasattr("__fspath__")? {
        return nested(&value.call_method0("__fspath__")?, depth + 1);
    }
    Err(error(format!("a value of the type {} has no place in a scene", value.get_type().name()?)))
}

/// The table of a dict whose keys are text.
pub fn table(dict: &Bound<'_, PyDict>, depth: usize) -> PyResult<Table> {
    let entry = |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let key: String = key.extract().map_err(|_| error("the keys of a scene are text"))?;
        // None stands for a key that is not given.
        Ok(if value.is_none() { None } else { Some((key, nested(&value, depth)?)) })
    };
    dict.iter().filter_map(|own| entry(own).transpose()).collect()
}
