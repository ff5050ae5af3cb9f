//! Scenes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use forelock::Scene;
use forelock::scene::Override;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::{error, values};

/// What is simulated, and how: each key has a default (``forelock help scene``).
///
/// ``Scene()`` is that of the demo, ``Scene({"solver": {"kind": "dftl"}})`` one of a dict. Keyword
/// ``set`` takes a dict of dotted keys that are laid over it.
#[pyclass(name = "Scene", module = "forelock", frozen)]
#[derive(Clone, Debug)]
pub struct PyScene {
    pub scene: Arc<Scene>,
}

/// The overrides of a dict of dotted keys.
pub fn overrides(set: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<Override>> {
    let Some(set) = set else { return Ok(Vec::new()) };
    let one = |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let key: String = key.extract().map_err(|_| error("the keys of `set` are text"))?;
        Ok(Override { label: key.clone(), key, value: values::to_toml(&value)?.to_string() })
    };
    set.iter().map(one).collect()
}

impl PyScene {
    fn of(scene: Scene) -> Self {
        Self { scene: scene.into() }
    }
}

#[pymethods]
impl PyScene {
    #[new]
    #[pyo3(signature = (tables=None, *, set=None))]
    fn new(tables: Option<&Bound<'_, PyDict>>, set: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let sets = overrides(set)?;
        let Some(tables) = tables else {
            return Scene::builtin(&sets).map(Self::of).map_err(error);
        };
        let text = toml::to_string(&values::table(tables, 0)?).map_err(error)?;
        Scene::parse(&text, Path::new("the dict"), &sets).map(Self::of).map_err(error)
    }

    /// Reads a scene file, or the scene of a groom's file: hair alone.
    #[staticmethod]
    #[pyo3(signature = (path, *, set=None))]
    fn load(path: PathBuf, set: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let sets = overrides(set)?;
        let is_scene = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml"));
        let scene = if is_scene { Scene::load(&path, &sets) } else { Scene::of_groom(&path, &sets) };
        scene.map(Self::of).map_err(error)
    }

    /// Reads a scene from TOML. Its paths are relative to the folder of the process.
    #[staticmethod]
    #[pyo3(signature = (text, *, set=None))]
    fn from_toml(text: &str, set: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        Scene::parse(text, Path::new("the text"), &overrides(set)?).map(Self::of).map_err(error)
    }

    /// The scene as TOML, with all keys.
    fn to_toml(&self) -> String {
        (*self.scene).clone().with_absolute_paths().to_toml()
    }

    /// Frames a second.
    #[getter]
    fn fps(&self) -> f64 {
        self.scene.time.fps
    }

    /// Frames of a run.
    #[getter]
    fn frames(&self) -> u32 {
        self.scene.time.frames
    }

    fn __repr__(&self) -> String {
        format!("Scene({:?}, solver {})", self.scene.name, self.scene.solver.kind.name())
    }
}

/// The scene of hair alone with `table` as one of its `[[list]]` tables, to read that table.
pub fn with_table(list: &str, table: &Bound<'_, PyDict>) -> PyResult<Scene> {
    let table = values::table(table, 0)?;
    let mut scene = toml::Table::new();
    scene.insert(list.to_owned(), toml::Value::Array(vec![toml::Value::Table(table)]));
    let mut groom = toml::Table::new();
    groom.insert("source".to_owned(), toml::Value::String("hair".to_owned()));
    scene.insert("groom".to_owned(), toml::Value::Table(groom));
    let text = toml::to_string(&scene).map_err(error)?;
    Scene::parse(&text, Path::new("the dict"), &[]).map_err(error)
}
