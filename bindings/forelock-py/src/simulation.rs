//! A simulation that is stepped frame by frame.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use forelock::core::groom::Import;
use forelock::player::{ColliderId, Player};
use forelock::scene::{GroomSource, TimeSection};
use forelock::{Backend, PlayerError, Scene};
use glam::Vec3;
use numpy::{PyArray1, PyArray2};
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::groom::PyGroom;
use crate::scene::{self, PyScene};
use crate::{arrays, error};

/// The positions of a frame: the memory that arrays show.
#[pyclass]
struct Frame {
    positions: Vec<Vec3>,
}

/// The player, and the memory of the frame that was shown last.
struct State {
    player: Player,
    shown: Option<Py<Frame>>,
    /// Memory of a frame before, which is used again unless an array shows it.
    spare: Option<Py<Frame>>,
}

/// A scene that is simulated frame by frame and can be changed meanwhile.
///
/// ``Simulation(scene)`` loads what the scene names. A ``groom`` takes the place of that of the
/// scene; ``Simulation(groom=groom)`` is hair alone, without a body, ``Simulation()`` the demo.
/// ``backend`` is "cpu", "gpu" or "auto". With ``history`` it can seek, undo and redo.
#[pyclass(name = "Simulation", module = "forelock", frozen)]
pub struct PySimulation {
    state: Mutex<State>,
}

impl PySimulation {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does `task` without the GIL; what was shown is out of date then.
    fn change<T: Send>(
        &self,
        py: Python<'_>,
        task: impl FnOnce(&mut Player) -> Result<T, PlayerError> + Send,
    ) -> PyResult<T> {
        let done = py.detach(|| {
            let mut state = self.state();
            if let Some(shown) = state.shown.take() {
                state.spare = Some(shown);
            }
            task(&mut state.player)
        });
        done.map_err(error)
    }

    /// Reads the positions of the present frame.
    fn show<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, Frame>> {
        // SAFETY: the object lives, and the GIL is held.
        let is_alone = |own: &Py<Frame>| unsafe { ffi::Py_REFCNT(own.as_ptr()) } == 1;
        let spare = self.state().spare.take().filter(is_alone);
        let mut positions =
            spare.map_or_else(Vec::new, |own| std::mem::take(&mut own.borrow_mut(py).positions));
        let read = py.detach(|| {
            let read = self.state().player.positions(&mut positions);
            read.map(|()| positions)
        });
        let frame = Bound::new(py, Frame { positions: read.map_err(error)? })?;
        self.state().shown = Some(frame.clone().unbind());
        Ok(frame)
    }
}

#[pymethods]
impl PySimulation {
    #[new]
    #[pyo3(signature = (scene=None, groom=None, *, backend="cpu", history=false))]
    fn new(
        py: Python<'_>,
        scene: Option<&PyScene>,
        groom: Option<&PyGroom>,
        backend: &str,
        history: bool,
    ) -> PyResult<Self> {
        let backend = match backend {
            "cpu" => Backend::Cpu,
            "gpu" => Backend::Gpu,
            "auto" => Backend::Auto,
            other => return Err(error(format!("there is no backend {other:?}: cpu, gpu or auto"))),
        };
        let scene = match scene {
            Some(own) => own.scene.clone(),
            None if groom.is_some() => Arc::new(Scene::of_groom(Path::new("hair"), &[]).map_err(error)?),
            None => Arc::new(Scene::builtin(&[]).map_err(error)?),
        };
        let groom = groom.map(|own| own.groom.clone());
        let build = || -> Result<Player, String> {
            // A scene names its groom by a file.
            let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
            let mut scene = (*scene).clone();
            if let Some(groom) = groom {
                let path = folder.path().join("groom.npz");
                forelock::io::write_groom(&path, &groom).map_err(|error| error.to_string())?;
                scene.groom.source = GroomSource::Files(vec![path]);
                // It is in metres, y up.
                let import = Import::default();
                (scene.groom.unit, scene.groom.up, scene.groom.scale) =
                    (import.unit, import.up, import.scale);
            }
            let builder = Player::builder(scene).backend(backend);
            let builder = if history { builder } else { builder.without_history() };
            builder.build().map_err(|error| error.to_string())
        };
        let player = py.detach(build).map_err(error)?;
        Ok(Self { state: Mutex::new(State { player, shown: None, spare: None }) })
    }

    /// Simulates ``frames`` frames. Returns what the last one reports, as a dict.
    #[pyo3(signature = (frames=1))]
    fn step<'py>(&self, py: Python<'py>, frames: u32) -> PyResult<Bound<'py, PyDict>> {
        let mut last = None;
        for _ in 0..frames {
            last = Some(self.change(py, Player::step)?);
            py.check_signals()?;
        }
        let dict = PyDict::new(py);
        if let Some(report) = last {
            dict.set_item("frame", report.frame)?;
            dict.set_item("max_edge_stretch", report.solver.max_edge_stretch_final)?;
            dict.set_item("max_penetration_m", report.solver.max_penetration_m)?;
            dict.set_item("quarantined_strands", report.solver.quarantined_strands)?;
            dict.set_item("teleports", report.teleports.len())?;
        }
        Ok(dict)
    }

    /// Positions of all particles at the present frame, float32 [P, 3], metres, world space: a
    /// read-only view that stays as it is when the simulation goes on.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let shown = self.state().shown.as_ref().map(|own| own.clone_ref(py));
        let frame = match shown {
            Some(shown) => shown.into_bound(py),
            None => self.show(py)?,
        };
        let positions: *const [Vec3] = &raw const *frame.borrow().positions;
        // SAFETY: positions change only while no array holds the frame: see `State::spare`.
        Ok(unsafe { arrays::view(frame.into_any(), &*positions) })
    }

    /// The first particle of each strand, and their number, uint32 [S + 1].
    #[getter]
    fn strand_offsets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        arrays::numbers(py, self.state().player.layout().strand_offsets)
    }

    /// Frames done.
    #[getter]
    fn frame(&self) -> u32 {
        self.state().player.frame()
    }

    /// Time of the present frame, seconds.
    #[getter]
    fn time(&self) -> f64 {
        self.state().player.time_secs()
    }

    /// The groom at rest, in the space of the head, with all edits.
    #[getter]
    fn groom(&self) -> PyResult<PyGroom> {
        Ok(PyGroom::of(self.state().player.edited_groom().clone()))
    }

    /// The scene with the changes that were made.
    #[getter]
    fn scene(&self) -> PyScene {
        PyScene { scene: self.state().player.changed_scene().into() }
    }

    /// The same with what was done from outside: the head and colliders move by keyframes as they
    /// were moved, and colliders that were added or removed appear and disappear. Without history
    /// nothing of this is recorded.
    #[getter]
    fn performed_scene(&self) -> PyScene {
        PyScene { scene: self.state().player.performed_scene().into() }
    }

    /// What the user should know of import and edits, one sentence each.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.state().player.notes()
    }

    /// The head's pose, 4 × 4, world from head. When it is set, the head is there in the next
    /// frame and stays there.
    #[getter]
    fn head_pose<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        arrays::matrix(py, &self.state().player.head_pose())
    }

    #[setter]
    fn set_head_pose(&self, py: Python<'_>, pose: &Bound<'_, PyAny>) -> PyResult<()> {
        let pose = arrays::pose(pose)?;
        self.change(py, |player| player.set_head_pose(pose))
    }

    /// Changes solver, interaction, wind or gravity by a dotted key of the scene, from the next
    /// frame on: ``set("solver.ams.k_integrity", 20)``.
    fn set(&self, py: Python<'_>, key: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let own = PyDict::new(py);
        own.set_item(key, value)?;
        let sets = scene::overrides(Some(&own))?;
        let before = self.state().player.changed_scene();
        let text = before.clone().with_absolute_paths().to_toml();
        let after = Scene::parse(&text, Path::new("the scene"), &sets).map_err(error)?;
        let same_but = Scene {
            solver: before.solver.clone(),
            interaction: before.interaction.clone(),
            wind: before.wind.clone(),
            gravity: before.gravity,
            time: TimeSection { substep_secs: before.time.substep_secs, ..after.time.clone() },
            ..after.clone()
        };
        if same_but.with_absolute_paths() != before.clone().with_absolute_paths() {
            return Err(error(format!("{key} cannot change while the simulation runs: build a new one")));
        }
        self.change(py, |player| {
            if after.solver != before.solver {
                player.set_params(&after.solver)?;
            }
            if after.interaction != before.interaction {
                player.set_interaction(&after.interaction)?;
            }
            if after.wind != before.wind {
                player.set_wind(&after.wind)?;
            }
            if after.gravity != before.gravity {
                player.set_gravity(arrays::vector(after.gravity))?;
            }
            Ok(())
        })
    }

    /// Edits the groom while it moves: ``edit({"op": "cut", ...})``, the keys of ``[[edit]]``.
    fn edit(&self, py: Python<'_>, edit: &Bound<'_, PyDict>) -> PyResult<()> {
        let scene = scene::with_table("edit", edit)?;
        let edits = scene.edits.0;
        edits.into_iter().try_for_each(|own| self.change(py, |player| player.edit_selected(own.edit)))
    }

    /// Adds a solid, the keys of ``[[collider]]``. Returns its number.
    fn add_collider(&self, py: Python<'_>, collider: &Bound<'_, PyDict>) -> PyResult<u32> {
        let scene = scene::with_table("collider", collider)?;
        let collider = scene.colliders.first().ok_or_else(|| error("there is no collider"))?.clone();
        self.change(py, move |player| player.add_collider(&collider)).map(|id| id.0)
    }

    /// Moves a solid to a pose, 4 × 4, in the next frame. 0 is the body, then come the scene's.
    fn move_collider(&self, py: Python<'_>, collider: u32, pose: &Bound<'_, PyAny>) -> PyResult<()> {
        let pose = arrays::pose(pose)?;
        self.change(py, |player| player.set_collider_pose(ColliderId(collider), pose))
    }

    /// Removes a solid.
    fn remove_collider(&self, py: Python<'_>, collider: u32) -> PyResult<()> {
        self.change(py, |player| player.remove_collider(ColliderId(collider)))
    }

    /// Goes to a frame, which must have been simulated; needs ``history``.
    fn seek(&self, py: Python<'_>, frame: u32) -> PyResult<()> {
        self.change(py, |player| player.seek(frame).map(drop))
    }

    /// Takes the last change back; needs ``history``. Returns its name.
    fn undo(&self, py: Python<'_>) -> PyResult<Option<&'static str>> {
        self.change(py, Player::undo)
    }

    /// Makes the change again that was undone last. Returns its name.
    fn redo(&self, py: Python<'_>) -> PyResult<Option<&'static str>> {
        self.change(py, Player::redo)
    }

    /// A 64-bit hash of the solver's state: equal for equal runs.
    fn state_hash(&self, py: Python<'_>) -> PyResult<u64> {
        py.detach(|| self.state().player.state_hash()).map_err(error)
    }

    /// Name of the processor that simulates.
    #[getter]
    fn device(&self) -> String {
        let state = self.state();
        state.player.gpu_name().map_or_else(|| state.player.simd_name(), str::to_owned)
    }

    fn __repr__(&self) -> String {
        let state = self.state();
        format!("Simulation({} strands, frame {})", state.player.groom().strand_count(), state.player.frame())
    }
}
