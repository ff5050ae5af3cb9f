//! Opening, saving and baking.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use eframe::egui;
use forelock::scene::Override;
use forelock::{Assets, Backend, Progress, RunOptions, Scene, Studio};

/// What was opened.
#[derive(Clone, Debug)]
pub struct Opened {
    /// The scene.
    pub scene: Scene,
    /// The cache of a run of it, which is played back.
    pub cache: Option<PathBuf>,
    /// The file that was read.
    pub path: Option<PathBuf>,
}

impl Opened {
    /// The frames that a loop plays: of a cache all.
    pub fn frames(&self) -> u32 {
        if self.cache.is_some() { u32::MAX } else { self.scene.time.frames }
    }

    /// The scene file that was read.
    pub fn scene_file(&self) -> Option<PathBuf> {
        self.path.clone().filter(|path| is_scene(path))
    }
}

impl From<Scene> for Opened {
    fn from(scene: Scene) -> Self {
        Self { scene, cache: None, path: None }
    }
}

/// What the file at `path` holds: a scene, a cache or a groom. `overrides` are laid over its scene.
///
/// # Errors
/// A message with the path.
pub fn read(path: &Path, overrides: &[Override]) -> Result<Opened, String> {
    let of = |scene: Scene| Opened { path: Some(path.to_owned()), ..scene.into() };
    if is_scene(path) {
        return Scene::load(path, overrides).map(of).map_err(|error| error.to_string());
    }
    if !path.is_file() {
        return Err(format!("{}: there is no such file", path.display()));
    }
    if forelock_io::Cache::open(path).is_ok_and(|cache| cache.frames() > 1) {
        let scene = Scene::beside(path, overrides).map_err(|error| error.to_string())?;
        return Ok(Opened { cache: Some(path.to_owned()), ..of(scene) });
    }
    Scene::of_groom(path, overrides).map(of).map_err(|error| error.to_string())
}

fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml"))
}

/// Writes `scene` to `path`, whole or not at all.
///
/// # Errors
/// A message with the path.
pub fn write(path: &Path, scene: Scene) -> Result<(), String> {
    let text = scene.with_absolute_paths().to_toml();
    forelock_io::atomic_write(path, |file| file.write_all(text.as_bytes())).map_err(|error| error.to_string())
}

/// A question for a path.
#[derive(Clone, Debug)]
pub struct PathDialog {
    /// What the path is for.
    pub purpose: Purpose,
    /// Whether a run makes a film too.
    pub has_film: bool,
    /// Whether a scene moves its head and solids as the mouse did.
    pub has_motion: bool,
    path: String,
    is_fresh: bool,
    list: List,
}

/// What a path is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A scene or groom to open.
    Open,
    /// A scene file to write.
    Save,
    /// A picture to write.
    Screenshot,
    /// The folder of a run.
    Bake,
    /// A film of a cache to write.
    Film,
}

impl Purpose {
    /// The title of the dialog.
    pub fn title(self) -> &'static str {
        match self {
            Self::Open => "Open a scene or groom",
            Self::Save => "Save the scene",
            Self::Screenshot => "Save a picture of the window",
            Self::Bake => "Simulate the scene into a folder",
            Self::Film => "Save a film of the cache: a .png file",
        }
    }
}

/// The answer to a [`PathDialog`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// None yet.
    Open,
    /// The dialog was closed.
    Cancelled,
    /// The path.
    Path(PathBuf),
}

impl PathDialog {
    /// A dialog that proposes `path`.
    pub fn new(purpose: Purpose, path: &Path) -> Self {
        let path = path.display().to_string();
        Self { purpose, has_film: false, has_motion: false, path, is_fresh: true, list: List::default() }
    }

    /// Draws the dialog.
    pub fn show(&mut self, ctx: &egui::Context) -> Answer {
        let mut answer = Answer::Open;
        let modal = egui::Modal::new(egui::Id::new("path")).show(ctx, |ui| {
            ui.heading(self.purpose.title());
            let field = ui.add(egui::TextEdit::singleline(&mut self.path).desired_width(420.0));
            if std::mem::take(&mut self.is_fresh) {
                field.request_focus();
            }
            let is_entered = field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
            // What is typed next goes on from there.
            self.is_fresh |= self.list.show(ui, &mut self.path);
            if self.purpose == Purpose::Bake {
                let film = ui.checkbox(&mut self.has_film, "With a film, from where the camera is");
                self.is_fresh |= film.clicked();
            }
            if matches!(self.purpose, Purpose::Save | Purpose::Bake) {
                let motion =
                    ui.checkbox(&mut self.has_motion, "With the motion of head and solids by the mouse");
                self.is_fresh |= motion.clicked();
            }
            ui.horizontal(|ui| {
                let ok = ui.add_enabled(!self.path.trim().is_empty(), egui::Button::new("OK"));
                if ok.clicked() || (is_entered && !self.path.trim().is_empty()) {
                    answer = Answer::Path(PathBuf::from(self.path.trim()));
                }
                if ui.button("Cancel").clicked() {
                    answer = Answer::Cancelled;
                }
            });
        });
        if modal.should_close() && answer == Answer::Open {
            answer = Answer::Cancelled;
        }
        answer
    }
}

/// What is in the folder of the path of a dialog.
#[derive(Clone, Debug, Default)]
struct List {
    folder: Option<PathBuf>,
    /// The folder above it.
    above: Option<PathBuf>,
    /// Names, those of folders with a slash at their end and first.
    names: Vec<String>,
}

impl List {
    /// Draws the names that go on with what is written in `path`; a click writes one there. Returns
    /// whether it did.
    fn show(&mut self, ui: &mut egui::Ui, path: &mut String) -> bool {
        let (folder, begun) = match path.rsplit_once(std::path::is_separator) {
            Some((folder, begun)) => (PathBuf::from(format!("{folder}/")), begun.to_lowercase()),
            None => (PathBuf::from("."), path.to_lowercase()),
        };
        if self.folder.as_ref() != Some(&folder) {
            self.names = names(&folder);
            let whole = folder.canonicalize().or_else(|_| std::path::absolute(&folder)).ok();
            self.above = whole.as_deref().and_then(Path::parent).map(|above| above.join(""));
            self.folder = Some(folder.clone());
        }
        // A whole name is no beginning: its neighbours may be wanted.
        let is_whole = self.names.iter().any(|name| name.to_lowercase() == begun);
        let goes_on = |name: &&String| is_whole || name.to_lowercase().starts_with(&begun);
        let mut chosen = None;
        egui::ScrollArea::vertical().max_height(180.0).auto_shrink([false, true]).show(ui, |ui| {
            if self.above.is_some() && ui.selectable_label(false, "../").clicked() {
                chosen = self.above.clone();
            }
            for name in self.names.iter().filter(goes_on) {
                if ui.selectable_label(name.to_lowercase() == begun, name).clicked() {
                    chosen = Some(if folder == Path::new(".") { name.into() } else { folder.join(name) });
                }
            }
        });
        let is_chosen = chosen.is_some();
        if let Some(chosen) = chosen {
            *path = chosen.display().to_string();
        }
        is_chosen
    }
}

/// Names in `folder` that are not hidden; none if it cannot be read.
fn names(folder: &Path) -> Vec<String> {
    const MOST: usize = 500;
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let named = entries.filter_map(|entry| {
        let name = entry.file_name().into_string().ok().filter(|name| !name.starts_with('.'))?;
        let is_file = !entry.path().is_dir();
        Some((is_file, if is_file { name } else { format!("{name}/") }))
    });
    let mut named: Vec<_> = named.collect();
    named.sort();
    named.into_iter().take(MOST).map(|(_, name)| name).collect()
}

/// A run of a scene into a folder, or a film of a cache, on a thread of its own.
#[derive(Debug)]
pub struct Bake {
    state: Arc<BakeState>,
}

/// What the thread and the window share.
#[derive(Debug, Default)]
struct BakeState {
    cancel: AtomicBool,
    done: AtomicU64,
    total: AtomicU64,
    /// What is being done.
    what: Mutex<&'static str>,
    ended: Mutex<Option<Result<String, String>>>,
}

impl BakeState {
    fn observe(&self, progress: &Progress<'_>) {
        match progress {
            Progress::Begin { what, done, total } => {
                *self.what.lock().unwrap_or_else(PoisonError::into_inner) = what;
                self.done.store(*done, Ordering::Relaxed);
                self.total.store(*total, Ordering::Relaxed);
            }
            Progress::Step => drop(self.done.fetch_add(1, Ordering::Relaxed)),
            _ => {}
        }
    }

    fn end(&self, result: Result<String, String>) {
        *self.ended.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
    }
}

impl Bake {
    /// Starts a run of `scene` into the folder `out`. `wake` is called when there is news.
    pub fn start(scene: Scene, out: PathBuf, backend: Backend, wake: impl Fn() + Send + 'static) -> Self {
        Self::on_thread(wake, move |state, observe| {
            let options = RunOptions { out, resume: false, backend };
            let summary =
                forelock::simulate(&scene, &options, observe, &state.cancel).map_err(|e| e.to_string())?;
            Ok(format!("baked {} frames in {}", summary.frames, options.out.display()))
        })
    }

    /// Starts to draw a film of `cache`, a run of `scene`, into the file `path`.
    pub fn film(scene: Scene, cache: PathBuf, path: PathBuf, wake: impl Fn() + Send + 'static) -> Self {
        Self::on_thread(wake, move |state, observe| {
            let film = film(&scene, &cache, &path, observe)?;
            if state.cancel.load(Ordering::Relaxed) {
                return Ok("stopped: there is no film".to_owned());
            }
            forelock_io::atomic_write(&path, |file| file.write_all(&film)).map_err(|e| e.to_string())?;
            Ok(format!("saved {}", path.display()))
        })
    }

    fn on_thread(
        wake: impl Fn() + Send + 'static,
        task: impl FnOnce(&BakeState, &mut dyn FnMut(&Progress<'_>)) -> Result<String, String> + Send + 'static,
    ) -> Self {
        let state = Arc::<BakeState>::default();
        let own = state.clone();
        let run = move || {
            let result = task(&own, &mut |progress| {
                own.observe(progress);
                wake();
            });
            own.end(result);
            wake();
        };
        if let Err(error) = std::thread::Builder::new().name("bake".to_owned()).spawn(run) {
            state.end(Err(format!("the run's thread cannot start: {error}")));
        }
        Self { state }
    }

    /// How it ended, once it has: a message.
    pub fn ended(&self) -> Option<Result<String, String>> {
        self.state.ended.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Ends it; the cache so far is complete, a film is not written.
    pub fn cancel(&self) {
        self.state.cancel.store(true, Ordering::Relaxed);
    }

    /// Draws its progress and a button that ends it.
    pub fn show(&self, ui: &mut egui::Ui) {
        let [done, total] = [&self.state.done, &self.state.total].map(|own| own.load(Ordering::Relaxed));
        let what = *self.state.what.lock().unwrap_or_else(PoisonError::into_inner);
        let share = if total > 0 { done as f32 / total as f32 } else { 0.0 };
        ui.add(egui::ProgressBar::new(share).desired_width(160.0).text(format!("{what} {done} of {total}")));
        if ui.button("Stop").clicked() {
            self.cancel();
        }
    }
}

impl Drop for Bake {
    fn drop(&mut self) {
        self.cancel();
    }
}

/// The film of `cache` to be written to `path`, an animated PNG.
fn film(
    scene: &Scene,
    cache: &Path,
    path: &Path,
    observe: &mut dyn FnMut(&Progress<'_>),
) -> Result<Vec<u8>, String> {
    if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png")) {
        return Err(format!("{}: a film is an animated PNG, a .png file", path.display()));
    }
    let mut cache = forelock_io::Cache::open(cache).map_err(|error| error.to_string())?;
    let assets = Assets::of_cache(scene, &mut cache).map_err(|error| error.to_string())?;
    Studio::new(scene, &assets).film(&mut cache, observe).map_err(|error| error.to_string())
}
