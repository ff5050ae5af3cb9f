//! Opening, saving, baking and pictures of the window: what the window does with files.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use eframe::egui;
use forelock::Scene;
use forelock::scene::{CameraSection, OutputSection};
use forelock::session::{Phase, Session, Status};

use super::{App, start};
use crate::panel::change::ChangePanel;
use crate::panel::files::{self, Answer, Bake, Opened, PathDialog, Purpose};
use crate::panel::play::PlayBar;
use crate::panel::see::Times;

/// What a scene that the session's thread wrote out is for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum SceneFor {
    /// To be saved: the file, and the number of changes that it holds.
    File(PathBuf, u64),
    /// A run into a folder, with a film or without.
    Bake(PathBuf, bool),
}

/// A picture of the window that is to be taken.
pub(super) struct Screenshot {
    path: PathBuf,
    at_secs: f64,
    started: Instant,
    asked: bool,
    failure: Arc<Mutex<Option<String>>>,
}

/// What ends the scene that is open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Wish {
    Close,
    File(PathBuf),
    Demo,
    /// What has been loaded is shown.
    Next,
}

/// A scene that is being loaded while another one is shown.
pub(super) struct Next {
    session: Session,
    opened: Opened,
}

impl App {
    /// Writes a picture of the window to a file after some seconds, and closes it. A message that
    /// it cannot be written goes to `failure`.
    pub(crate) fn take_screenshot(
        &mut self,
        wanted: Option<(PathBuf, f64)>,
        failure: Arc<Mutex<Option<String>>>,
    ) {
        self.screenshot = wanted.map(|(path, at_secs)| Screenshot {
            path,
            at_secs,
            started: Instant::now(),
            asked: false,
            failure,
        });
        if self.screenshot.is_some() {
            self.session.play(true);
        }
    }

    pub(super) fn file_menu(&mut self, ui: &mut egui::Ui) {
        let folder = self.file.as_deref().and_then(Path::parent).unwrap_or(Path::new("")).to_owned();
        let name = if self.scene.name.is_empty() { "scene" } else { &self.scene.name };
        let proposals = [
            ("Open…", Purpose::Open, folder.clone()),
            ("Save scene…", Purpose::Save, self.file.clone().unwrap_or(folder.join(format!("{name}.toml")))),
            ("Bake…", Purpose::Bake, folder.join("forelock-out").join(name)),
            ("Film…", Purpose::Film, self.cache.as_deref().unwrap_or(&folder).with_file_name("film.png")),
            ("Screenshot…", Purpose::Screenshot, folder.join("window.png")),
        ];
        for (text, purpose, path) in proposals {
            // A cache has no scene to save or to run; a film of a scene comes with its run.
            let can_be_done = match purpose {
                Purpose::Save | Purpose::Bake => self.cache.is_none(),
                Purpose::Film => self.cache.is_some(),
                Purpose::Open | Purpose::Screenshot => true,
            };
            let is_busy = self.bake.is_some() && matches!(purpose, Purpose::Bake | Purpose::Film);
            if ui.add_enabled(can_be_done && !is_busy, egui::Button::new(text)).clicked() {
                let mut dialog = PathDialog::new(purpose, &path);
                dialog.has_film = self.scene.output.film;
                dialog.has_motion = self.keeps_motion;
                self.dialog = Some(dialog);
                ui.close();
            }
        }
        if let Some(path) = self.recent_files.show(ui) {
            self.ask_for(ui.ctx(), Wish::File(path));
        }
        if ui.button("Demo").clicked() {
            self.ask_for(ui.ctx(), Wish::Demo);
            ui.close();
        }
        if ui.button("Quit").clicked() {
            ui.ctx().send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    /// Opens the scene or groom at `path` in place of the one that is open.
    pub fn open(&mut self, ctx: &egui::Context, path: &Path) {
        match files::read(path, &[]) {
            Ok(opened) => self.load(ctx, opened),
            Err(message) => self.message = Some((message, true)),
        }
    }

    /// Loads what was `opened`, while what is open stays there.
    pub(super) fn load(&mut self, ctx: &egui::Context, opened: Opened) {
        let session = start(ctx, &opened, self.backend, &self.drawing);
        self.message = None;
        drop_elsewhere(self.next.replace(Next { session, opened }));
    }

    /// Takes a scene over that has been loaded, or tells why it cannot be.
    pub(super) fn take_next(&mut self) {
        let Some(next) = self.next.take() else { return };
        let status = next.session.status();
        match status.phase {
            Phase::Loading => self.next = Some(next),
            // Changed since it was asked for.
            Phase::Ready if self.is_changed() => {
                self.next = Some(next);
                self.pending.get_or_insert(Wish::Next);
            }
            Phase::Failed => {
                self.message = status.error.map(|error| (error, true));
                drop_elsewhere(next);
            }
            Phase::Ready => {
                let Next { session, opened } = next;
                self.play = PlayBar::new(opened.frames());
                let file = opened.scene_file();
                let Opened { scene, cache, path } = opened;
                path.iter().for_each(|path| self.recent_files.add(path));
                drop_elsewhere(std::mem::replace(&mut self.session, session));
                self.viewport.forget();
                self.hair = scene.hair.clone();
                self.change = ChangePanel::default();
                self.times = Times::default();
                (self.framed, self.changes, self.saved) = (None, 0, 0);
                // What the other session still writes out is not of this scene.
                self.scenes = Arc::default();
                (self.scene, self.cache, self.file) = (scene, cache, file);
                self.recent = [None, None];
                self.keeps_motion = false;
            }
        }
    }

    /// Asks the session's thread for the scene as it is now.
    pub(super) fn ask_for_scene(&mut self, purpose: SceneFor) {
        let (scenes, hair) = (self.scenes.clone(), self.hair.clone());
        let (camera, has_motion) = (self.camera_keys(), self.keeps_motion);
        self.session.change("saving", move |player| {
            let now = if has_motion { player.performed_scene() } else { player.changed_scene() };
            let mut scene = Scene { hair, ..now };
            scene.camera = camera.unwrap_or(scene.camera);
            scenes.lock().unwrap_or_else(PoisonError::into_inner).push((purpose, scene));
            Ok(())
        });
    }

    /// The keys of the camera, if it has been moved.
    fn camera_keys(&self) -> Option<CameraSection> {
        let is_moved = self.framed.is_some_and(|placed| placed != self.viewport.orbit);
        let moment = self.session.moment().filter(|_| is_moved)?;
        Some(moment.camera_keys(&self.scene, &self.viewport.orbit.camera()))
    }

    /// Saves or runs the scenes that the session's thread has written out.
    pub(super) fn take_scenes(&mut self, ctx: &egui::Context) {
        let scenes = std::mem::take(&mut *self.scenes.lock().unwrap_or_else(PoisonError::into_inner));
        for (purpose, scene) in scenes {
            match purpose {
                SceneFor::File(path, changes) => match files::write(&path, scene) {
                    Ok(()) => {
                        self.message = Some((format!("saved {}", path.display()), false));
                        self.recent_files.add(&path);
                        (self.file, self.saved) = (Some(path), changes);
                    }
                    Err(message) => self.message = Some((message, true)),
                },
                SceneFor::Bake(out, film) => {
                    let waker = ctx.clone();
                    self.session.play(false);
                    let output = OutputSection { film, ..scene.output.clone() };
                    let scene = Scene { output, ..scene };
                    let wake = move || waker.request_repaint();
                    self.bake = Some(Bake::start(scene, out, self.backend, wake));
                }
            }
        }
    }

    /// Draws a film of the cache that is played back, with camera and colours of the window.
    fn film(&mut self, ctx: &egui::Context, path: PathBuf) {
        let Some(cache) = self.cache.clone() else { return };
        let camera = self.camera_keys().unwrap_or_else(|| self.scene.camera.clone());
        let scene = Scene { camera, hair: self.hair.clone(), ..self.scene.clone() };
        let waker = ctx.clone();
        self.bake = Some(Bake::film(scene, cache, path, move || waker.request_repaint()));
    }

    pub(super) fn take_news(&mut self) {
        if let Some(ended) = self.bake.as_ref().and_then(Bake::ended) {
            let is_error = ended.is_err();
            self.message = Some((ended.unwrap_or_else(|error| error), is_error));
            self.bake = None;
        }
    }

    pub(super) fn dialogs(&mut self, ctx: &egui::Context) {
        if let Some(mut dialog) = self.dialog.take() {
            let answer = dialog.show(ctx);
            if matches!(answer, Answer::Path(_)) && matches!(dialog.purpose, Purpose::Save | Purpose::Bake) {
                self.keeps_motion = dialog.has_motion;
            }
            match (answer, dialog.purpose) {
                (Answer::Open, _) => self.dialog = Some(dialog),
                (Answer::Cancelled, _) => {}
                (Answer::Path(path), Purpose::Open) => self.ask_for(ctx, Wish::File(path)),
                (Answer::Path(path), Purpose::Save) => self.ask_for_scene(SceneFor::File(path, self.changes)),
                (Answer::Path(path), Purpose::Bake) => {
                    self.ask_for_scene(SceneFor::Bake(path, dialog.has_film));
                }
                (Answer::Path(path), Purpose::Film) => self.film(ctx, path),
                (Answer::Path(path), Purpose::Screenshot) => {
                    let failure = Arc::default();
                    self.screenshot = Some(Screenshot {
                        path,
                        at_secs: 0.0,
                        started: Instant::now(),
                        asked: false,
                        failure,
                    });
                }
            }
        }
        let closing = ctx.input(|input| input.viewport().close_requested());
        if closing && self.is_changed() && self.screenshot.is_none() {
            ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.pending = Some(Wish::Close);
        }
        if let Some(wish) = self.pending.take() {
            self.ask_to_lose(ctx, wish);
        }
    }

    /// Whether there are changes that are not saved.
    fn is_changed(&self) -> bool {
        self.changes != self.saved
    }

    /// Does what ends the scene that is open, once the user agrees to lose changes.
    pub(super) fn ask_for(&mut self, ctx: &egui::Context, wish: Wish) {
        if self.is_changed() { self.pending = Some(wish) } else { self.grant(ctx, wish) }
    }

    fn grant(&mut self, ctx: &egui::Context, wish: Wish) {
        match wish {
            Wish::Close => ctx.send_viewport_cmd(egui::ViewportCommand::Close),
            Wish::File(path) => self.open(ctx, &path),
            Wish::Demo => match Scene::builtin(&[]) {
                Ok(scene) => {
                    self.load(ctx, scene.into());
                    self.next.iter().for_each(|next| next.session.play(true));
                }
                Err(error) => self.message = Some((error.to_string(), true)),
            },
            // It is taken over in the next repaint.
            Wish::Next => {}
        }
    }

    fn ask_to_lose(&mut self, ctx: &egui::Context, wish: Wish) {
        let mut answer = None;
        egui::Modal::new(egui::Id::new("lose")).show(ctx, |ui| {
            ui.heading("There are changes that are not saved");
            ui.horizontal(|ui| {
                for (text, loses) in [("Lose them", true), ("Go back", false)] {
                    if ui.button(text).clicked() {
                        answer = Some(loses);
                    }
                }
            });
        });
        match answer {
            None => self.pending = Some(wish),
            Some(true) => {
                self.saved = self.changes;
                self.grant(ctx, wish);
            }
            Some(false) if wish == Wish::Next => self.next.take().into_iter().for_each(drop_elsewhere),
            Some(false) => {}
        }
    }

    /// Opens a file that was dropped on the window.
    pub(super) fn drops(&mut self, ctx: &egui::Context) {
        let dropped = ctx.input(|input| input.raw.dropped_files.first().and_then(|file| file.path.clone()));
        if let Some(path) = dropped {
            self.ask_for(ctx, Wish::File(path));
        }
    }

    pub(super) fn screenshots(&mut self, ctx: &egui::Context, status: &Status) {
        let Some(wanted) = &mut self.screenshot else { return };
        let closes = wanted.at_secs > 0.0;
        let taken = ctx.input(|input| {
            input.events.iter().find_map(|event| match event {
                egui::Event::Screenshot { image, .. } => Some(image.clone()),
                _ => None,
            })
        });
        if let Some(image) = taken {
            let result = write_screenshot(&wanted.path, &image);
            let path = wanted.path.display().to_string();
            // The picture of a window in which nothing could be opened is written all the same.
            let opening = match (&self.message, status.phase) {
                (Some((message, true)), Phase::Failed) => Err(message.clone()),
                _ => Ok(()),
            };
            if let Err(message) = result.as_ref().and(opening.as_ref()) {
                *wanted.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(message.clone());
            }
            self.screenshot = None;
            self.message = Some(match result {
                Ok(()) => (format!("saved {path}"), false),
                Err(message) => (message, true),
            });
            if closes {
                ctx.send_viewport_cmd(egui::ViewportCommand::Close);
            }
            return;
        }
        let left = wanted.at_secs - wanted.started.elapsed().as_secs_f64();
        // A picture of what stands still has all its pixels.
        if left <= 0.0 && closes && status.playing {
            self.session.play(false);
        }
        let is_whole = !status.playing && self.shown.as_ref().is_some_and(|shown| shown.is_whole);
        // The user's own is taken as it is, and an error is to be seen too.
        let has_failed = self.message.as_ref().is_some_and(|(_, is_error)| *is_error);
        let can_be_taken = is_whole || !closes || has_failed || status.phase == Phase::Failed;
        if left <= 0.0 && can_be_taken && !wanted.asked && status.phase != Phase::Loading {
            wanted.asked = true;
            ctx.send_viewport_cmd(egui::ViewportCommand::Screenshot(egui::UserData::default()));
        }
        ctx.request_repaint_after_secs(left.max(0.1) as f32);
    }
}

/// Ends what has a session, which waits for its last step, on another thread.
fn drop_elsewhere<T: Send + 'static>(own: T) {
    std::thread::spawn(move || drop(own));
}

fn write_screenshot(path: &Path, image: &egui::ColorImage) -> Result<(), String> {
    let pixels = image.pixels.iter().flat_map(egui::Color32::to_array).collect();
    let [width, height] = image.size.map(|side| side as u32);
    let image =
        forelock_render::Image::from_rgba(width, height, pixels).map_err(|error| error.to_string())?;
    forelock::write_picture(path, &image).map_err(|error| error.to_string())
}
