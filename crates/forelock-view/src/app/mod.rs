//! The window's state, and what is where in it.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use eframe::egui;
use eframe::egui::{Key, Modifiers};
use forelock::player::{Asked, Moment};
use forelock::scene::HairSection;
use forelock::session::{Phase, Session, Status};
use forelock::{Backend, Scene};

mod documents;

use documents::{Next, SceneFor, Screenshot, Wish};

use crate::artist::{Artist, Picture, Wanted};
use crate::measure::Measure;
use crate::orbit::Orbit;
use crate::panel::change::ChangePanel;
use crate::panel::files::{Bake, Opened, PathDialog, Purpose};
use crate::panel::play::PlayBar;
use crate::panel::recent::Recent;
use crate::panel::see::{self, Times};
use crate::tools::Tool;
use crate::viewport::{Done, Viewport};

/// Time over which pictures are counted.
const RATED: Duration = Duration::from_secs(3);

/// What is said at the first start.
const HINTS: [&str; 5] = [
    "Drag the head with the mouse; hold shift to turn it.",
    "Choose Hand on the left, and push it through the hair.",
    "Choose Cut, and drag across a fringe. Ctrl+Z takes it back.",
    "Middle button: turn the camera. Right button: move it. Wheel: nearer.",
    "Change the solver, its parameters and the wind on the right while hair moves.",
];

/// The picture shown.
struct Shown {
    id: egui::TextureId,
    /// Keeps the texture of a picture by the CPU.
    handle: Option<egui::TextureHandle>,
    ms: f32,
    /// Whether it has as many pixels as its place.
    is_whole: bool,
}

/// The device of the window.
type RenderState = eframe::egui_wgpu::RenderState;

/// The window.
pub struct App {
    session: Session,
    next: Option<Next>,
    backend: Backend,
    /// The scene as it was opened, and the file that it is saved to.
    scene: Scene,
    file: Option<PathBuf>,
    recent_files: Recent,
    /// The cache that is played back.
    cache: Option<PathBuf>,
    hair: HairSection,
    measure: Measure,
    /// Whether the rest shape is drawn.
    has_ghost: bool,
    /// Whether the grid is drawn.
    has_grid: bool,
    /// The frames shown last, the newest at the end.
    recent: [Option<Arc<Moment>>; 2],
    artist: Artist,
    /// Whether a picture is being drawn, after which the window is painted anew.
    drawing: Arc<AtomicBool>,
    /// None while pictures are drawn by the CPU.
    gpu: Option<RenderState>,
    /// Why the CPU draws, if it does.
    why_cpu: &'static str,
    shown: Option<Shown>,
    pictures: u64,
    /// When the pictures of the last seconds were shown.
    shown_at: Vec<Instant>,
    viewport: Viewport,
    play: PlayBar,
    change: ChangePanel,
    times: Times,
    hints: bool,
    /// Where the camera was placed when hair was first seen.
    framed: Option<Orbit>,
    dialog: Option<PathDialog>,
    /// A message to the user, and whether it is of an error.
    message: Option<(String, bool)>,
    bake: Option<Bake>,
    /// Whether scenes that are saved or run move as the mouse moved head and solids.
    keeps_motion: bool,
    /// Scenes that the session's thread has written out.
    scenes: Arc<Mutex<Vec<(SceneFor, Scene)>>>,
    /// Changes by the user, and how many of them are saved.
    changes: u64,
    saved: u64,
    /// What is done once the user has agreed to lose changes.
    pending: Option<Wish>,
    screenshot: Option<Screenshot>,
}

impl App {
    /// The window of `scene`, in the context of its creation. Pictures are drawn on `draw`.
    pub fn new(cc: &eframe::CreationContext<'_>, opened: Opened, backend: Backend, draw: Backend) -> Self {
        let gpu = cc.wgpu_render_state.clone().filter(|own| match draw {
            Backend::Cpu => false,
            Backend::Gpu => true,
            // A driver that runs on the CPU draws more slowly than the CPU itself.
            _ => own.adapter.get_info().device_type != wgpu::DeviceType::Cpu,
        });
        let mut app = Self::with_gpu(&cc.egui_ctx, gpu, opened, backend);
        if draw == Backend::Cpu {
            app.why_cpu = "";
        }
        let begun = std::mem::replace(&mut app.recent_files, Recent::of_user());
        begun.paths().iter().for_each(|path| app.recent_files.add(path));
        app
    }

    /// The window without a graphics card, for tests.
    pub fn on_cpu(ctx: &egui::Context, scene: Scene, backend: Backend) -> Self {
        Self::with_gpu(ctx, None, scene.into(), backend)
    }

    fn with_gpu(ctx: &egui::Context, gpu: Option<RenderState>, opened: Opened, backend: Backend) -> Self {
        let of_gpu =
            gpu.as_ref().map(|own| (own.device.clone(), own.queue.clone(), own.adapter.get_info().name));
        let waker = ctx.clone();
        let drawing = Arc::new(AtomicBool::new(false));
        let artist = Artist::start(of_gpu, drawing.clone(), move || waker.request_repaint());
        let bounds = (glam::Vec3::splat(-0.2), glam::Vec3::splat(0.2));
        let session = start(ctx, &opened, backend, &drawing);
        let play = PlayBar::new(opened.frames());
        let file = opened.scene_file();
        let Opened { scene, cache, path } = opened;
        let mut recent_files = Recent::default();
        path.iter().for_each(|path| recent_files.add(path));
        Self {
            session,
            cache,
            measure: Measure::default(),
            has_ghost: false,
            has_grid: false,
            recent: [None, None],
            next: None,
            backend,
            file,
            recent_files,
            hair: scene.hair.clone(),
            artist,
            drawing,
            gpu,
            why_cpu: ", for there is no graphics card",
            shown: None,
            pictures: 0,
            shown_at: Vec::new(),
            viewport: Viewport::new(Orbit::framing(bounds, 0.5, 0.1)),
            play,
            change: ChangePanel::default(),
            times: Times::default(),
            hints: true,
            framed: None,
            dialog: None,
            message: None,
            bake: None,
            keeps_motion: false,
            scenes: Arc::default(),
            changes: 0,
            saved: 0,
            pending: None,
            screenshot: None,
            scene,
        }
    }

    /// The session of the scene that is open.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// The frame that is shown.
    pub fn frame(&self) -> u32 {
        self.session.moment().map_or(0, |moment| moment.frame)
    }

    /// Whether another scene is being loaded.
    pub fn is_loading(&self) -> bool {
        self.next.is_some()
    }

    /// Whether a picture is shown.
    pub fn has_picture(&self) -> bool {
        self.shown.is_some()
    }

    /// How many pictures have been shown.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Where the picture is taken from.
    pub fn camera(&self) -> forelock_render::Camera {
        self.viewport.orbit.camera()
    }

    /// What the mouse does in the picture.
    pub fn tool(&self) -> Tool {
        self.viewport.tool()
    }

    /// The message that is shown, if there is one.
    pub fn message(&self) -> Option<&str> {
        self.message.as_ref().map(|(text, _)| text.as_str())
    }

    /// Whether a run into a folder goes on.
    pub fn is_baking(&self) -> bool {
        self.bake.is_some()
    }

    /// Draws the window and passes orders on.
    pub fn show(&mut self, ui: &mut egui::Ui) {
        // `tools/window-work.py` counts this and pictures.
        tracing::trace!("repaint");
        let ctx = ui.ctx().clone();
        self.take_next();
        self.session.ask(Asked { grid: self.has_grid, ..self.measure.asks() });
        let status = self.session.status();
        let moment = self.session.moment();
        if let Some(error) = &status.error {
            self.message = Some((error.clone(), true));
            self.session.clear_error();
        }
        self.take_scenes(&ctx);
        self.take_news();
        if let Some(moment) = &moment {
            self.times.add(moment.frame, &status);
            self.note(moment);
            if self.framed.is_none() {
                self.frame_scene(moment);
            }
        }
        self.keys(&ctx, &status, moment.as_deref());
        egui::Panel::top("menu").show(ui, |ui| self.menu(ui, &status));
        egui::Panel::bottom("play").show(ui, |ui| {
            self.status_line(ui, &status);
            let (frame, secs) = moment.as_ref().map_or((0, 0.0), |own| (own.frame, own.time_secs));
            self.play.show(ui, &self.session, &status, frame, secs);
        });
        egui::Panel::left("tools").resizable(false).default_size(96.0).show(ui, |ui| self.tools(ui));
        egui::Panel::right("parameters").default_size(330.0).show(ui, |ui| {
            egui::ScrollArea::vertical().show(ui, |ui| self.parameters(ui, &status, moment.as_deref()));
        });
        egui::CentralPanel::default()
            .frame(egui::Frame::new().fill(egui::Color32::from_rgb(60, 63, 68)))
            .show(ui, |ui| self.picture(ui, &status, moment.as_ref()));
        self.dialogs(&ctx);
        self.drops(&ctx);
        self.screenshots(&ctx, &status);
    }

    /// Notes that `moment` is shown. The one before it stays while the same frame comes again, with
    /// something that was asked for.
    fn note(&mut self, moment: &Arc<Moment>) {
        let [before, last] = &mut self.recent;
        if last.as_ref().is_some_and(|last| Arc::ptr_eq(last, moment)) {
            return;
        }
        let is_again = |last: &Arc<Moment>| (last.frame, last.time_secs) == (moment.frame, moment.time_secs);
        if !last.as_ref().is_some_and(is_again) {
            *before = last.take();
        }
        *last = Some(moment.clone());
    }

    /// Places the camera as the scene says.
    fn frame_scene(&mut self, moment: &Moment) {
        let orbit = Orbit::of(&moment.camera(&self.scene));
        (self.viewport.orbit, self.framed) = (orbit, Some(orbit));
    }

    fn menu(&mut self, ui: &mut egui::Ui, status: &Status) {
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| self.file_menu(ui));
            ui.menu_button("Edit", |ui| {
                for (verb, next, is_undo) in [("Undo", status.undo, true), ("Redo", status.redo, false)] {
                    let text = next.map_or_else(|| verb.to_owned(), |name| format!("{verb} {name}"));
                    if ui.add_enabled(next.is_some(), egui::Button::new(text)).clicked() {
                        self.move_in_history(is_undo, status);
                        ui.close();
                    }
                }
            });
            ui.menu_button("View", |ui| {
                let views = [
                    ("Front (1)", 0.0),
                    ("Side (3)", 90.0),
                    ("Back (Ctrl+1)", 180.0),
                    ("Left (Ctrl+3)", -90.0),
                ];
                for (name, yaw) in views {
                    if ui.button(name).clicked() {
                        self.viewport.orbit.look_from(yaw, 0.0);
                    }
                }
                if ui.button("Top (7)").clicked() {
                    self.viewport.orbit.look_from(0.0, 88.0);
                }
                ui.separator();
                egui::widgets::global_theme_preference_buttons(ui);
            });
            ui.menu_button("Help", |ui| {
                ui.checkbox(&mut self.hints, "Hints");
                ui.hyperlink_to("Documentation", "https://docs.rs/forelock");
            });
            if let Some(bake) = &self.bake {
                ui.separator();
                bake.show(ui);
            }
        });
    }

    fn move_in_history(&mut self, is_undo: bool, status: &Status) {
        let name = if is_undo { status.undo } else { status.redo };
        if name == Some("add collider") {
            self.viewport.forget();
        }
        if name.is_some() {
            self.changes += 1;
            if is_undo { self.session.undo() } else { self.session.redo() }
        }
    }

    fn status_line(&mut self, ui: &mut egui::Ui, status: &Status) {
        ui.horizontal_wrapped(|ui| match (&self.message, status.phase) {
            (Some((text, is_error)), _) => {
                let colour = if *is_error { ui.visuals().error_fg_color } else { ui.visuals().text_color() };
                ui.colored_label(colour, text);
                if ui.small_button("Dismiss").clicked() {
                    self.message = None;
                }
            }
            (None, Phase::Loading) => {
                ui.spinner();
                ui.label(status.busy.as_deref().unwrap_or("loading"));
            }
            (None, Phase::Failed) => drop(ui.weak("no scene")),
            (None, Phase::Ready) => {
                let slow = status.playing && status.real_time > 0.0 && status.real_time < 0.9 * status.speed;
                let text = match (&status.busy, slow) {
                    (Some(busy), _) => format!("{busy} …"),
                    (None, true) => format!(
                        "slower than real time: {:.2}× (a frame takes {:.0} ms)",
                        status.real_time, status.step_ms
                    ),
                    (None, false) if status.playing => "playing".to_owned(),
                    (None, false) => "paused".to_owned(),
                };
                ui.weak(text);
                ui.weak(format!("· simulated by {} · {}", status.device, self.drawn_by()));
            }
        });
    }

    /// What draws, and how often in the last seconds.
    fn drawn_by(&self) -> String {
        let recent = self.shown_at.iter().filter(|at| at.elapsed() <= RATED).count();
        let device = &self.artist.device;
        let why = if self.gpu.is_none() { self.why_cpu } else { "" };
        let rate = recent as f32 / RATED.as_secs_f32();
        let rate = if rate >= 1.0 { format!(": {rate:.0} pictures a second") } else { String::new() };
        format!("drawn by {device}{why}{rate}")
    }

    fn tools(&mut self, ui: &mut egui::Ui) {
        ui.add_space(4.0);
        self.viewport.only_looks = self.cache.is_some();
        if self.viewport.only_looks {
            ui.disable();
        }
        for (tool, name, hint) in Tool::ALL {
            let chosen = ui.selectable_label(self.viewport.tool() == tool, name);
            if chosen.on_hover_text(hint).clicked() {
                self.viewport.tool = tool;
            }
        }
        ui.separator();
        ui.label("Radius");
        let mut radius = self.viewport.brush.radius * 1e3;
        ui.add(egui::DragValue::new(&mut radius).range(1.0..=500.0).speed(0.5).suffix(" mm"));
        self.viewport.brush.radius = radius * 1e-3;
        ui.label("Strength");
        ui.add(egui::DragValue::new(&mut self.viewport.brush.strength).range(0.0..=1.0).speed(0.01));
        if self.viewport.has_pusher() && ui.button("Remove solid").clicked() {
            self.viewport.remove_pusher(&self.session);
            self.changes += 1;
        }
    }

    fn parameters(&mut self, ui: &mut egui::Ui, status: &Status, moment: Option<&Moment>) {
        if let Some(cache) = &self.cache {
            ui.label(format!("{} is played back. Open its scene to change it.", cache.display()));
        }
        egui::CollapsingHeader::new("Colours").show(ui, |ui| {
            see::measures(ui, &mut self.measure, status, moment);
            ui.checkbox(&mut self.has_ghost, "Rest shape").on_hover_text("Draws the rest shape in blue");
            see::grid(ui, &mut self.has_grid, status, moment);
            self.changes += u64::from(see::colours(ui, &mut self.hair));
        });
        if let Some(parameters) = &status.parameters {
            match self.change.show(ui, &self.session, parameters) {
                Ok(changed) => self.changes += u64::from(changed),
                Err(message) => self.message = Some((message, true)),
            }
        }
        egui::CollapsingHeader::new("Times").show(ui, |ui| self.times.show(ui));
        egui::CollapsingHeader::new("Numbers").show(ui, |ui| {
            if let Some(moment) = moment {
                let ms = self.shown.as_ref().map_or(0.0, |shown| shown.ms);
                see::numbers(ui, moment, status, ms, &self.artist.device);
            }
            status.notes.iter().for_each(|note| drop(ui.weak(note)));
        });
    }

    fn picture(&mut self, ui: &mut egui::Ui, status: &Status, moment: Option<&Arc<Moment>>) {
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), egui::Sense::click_and_drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::WidgetType::Image, true, "picture"));
        let Some(moment) = moment else { return };
        let scale = ui.ctx().pixels_per_point();
        let Done { changed } = self.viewport.interact(ui, &response, scale, &self.session, moment);
        self.changes += u64::from(changed);
        let size = [rect.width(), rect.height()].map(|side| ((side * scale) as u32).clamp(1, 4096));
        self.artist.want(Wanted {
            moment: moment.clone(),
            camera: self.viewport.orbit.camera(),
            size,
            hair: self.hair.clone(),
            measure: self.measure,
            previous: self.recent[0].clone(),
            has_ghost: self.has_ghost,
            has_grid: self.has_grid,
            moves: status.playing,
        });
        self.take_picture(ui.ctx());
        if let Some(shown) = &self.shown {
            let all = egui::Rect::from_min_max(egui::Pos2::ZERO, egui::pos2(1.0, 1.0));
            let behind = ui.painter().clone();
            behind.image(shown.id, rect, all, egui::Color32::WHITE);
        }
        self.viewport.paint(ui, &response);
        if self.hints {
            hints(ui, rect, &mut self.hints, status);
        }
    }

    /// Shows the newest picture.
    fn take_picture(&mut self, ctx: &egui::Context) {
        let drawn = match self.artist.take() {
            None => return,
            Some(Err(message)) => {
                self.message = Some((message, true));
                return;
            }
            Some(Ok(drawn)) => drawn,
        };
        if let Some(note) = drawn.note {
            self.message = Some((note, false));
        }
        let is_whole = drawn.is_whole;
        let shown = match (drawn.picture, &self.gpu) {
            (Picture::Image(image), _) => {
                let handle = ctx.load_texture("picture", image, egui::TextureOptions::LINEAR);
                Shown { id: handle.id(), handle: Some(handle), ms: drawn.ms, is_whole }
            }
            (Picture::Texture(view), Some(gpu)) => {
                let mut renderer = gpu.renderer.write();
                let filter = wgpu::FilterMode::Linear;
                let id = match &self.shown {
                    Some(Shown { id, handle: None, .. }) => {
                        renderer.update_egui_texture_from_wgpu_texture(&gpu.device, &view, filter, *id);
                        *id
                    }
                    _ => renderer.register_native_texture(&gpu.device, &view, filter),
                };
                Shown { id, handle: None, ms: drawn.ms, is_whole }
            }
            (Picture::Texture(_), None) => return,
        };
        self.shown = Some(shown);
        self.pictures += 1;
        tracing::debug!("picture {} took {:.1} ms", self.pictures, drawn.ms);
        self.shown_at.retain(|at| at.elapsed() <= RATED);
        self.shown_at.push(Instant::now());
    }

    fn keys(&mut self, ctx: &egui::Context, status: &Status, moment: Option<&Moment>) {
        if ctx.egui_wants_keyboard_input() || self.dialog.is_some() {
            return;
        }
        let pressed =
            |modifiers: Modifiers, key: Key| ctx.input_mut(|input| input.consume_key(modifiers, key));
        let ctrl_shift = Modifiers::COMMAND | Modifiers::SHIFT;
        if pressed(ctrl_shift, Key::Z) || pressed(Modifiers::COMMAND, Key::Y) {
            self.move_in_history(false, status);
        }
        if pressed(Modifiers::COMMAND, Key::Z) {
            self.move_in_history(true, status);
        }
        if pressed(Modifiers::COMMAND, Key::S) && self.cache.is_none() {
            match self.file.clone() {
                Some(file) => self.ask_for_scene(SceneFor::File(file, self.changes)),
                None => self.dialog = Some(PathDialog::new(Purpose::Save, Path::new("scene.toml"))),
            }
        }
        if pressed(Modifiers::COMMAND, Key::O) {
            self.dialog = Some(PathDialog::new(Purpose::Open, Path::new("")));
        }
        if pressed(Modifiers::NONE, Key::Space) {
            self.session.play(!status.playing);
        }
        if pressed(Modifiers::NONE, Key::ArrowRight) {
            self.session.step();
        }
        if pressed(Modifiers::NONE, Key::Home) {
            self.session.seek(0);
        }
        if let Some(moment) = moment.filter(|_| pressed(Modifiers::NONE, Key::F)) {
            self.viewport.orbit.frame(moment.bounds());
        }
        let views = [
            (Modifiers::COMMAND, Key::Num1, [180.0, 0.0]),
            (Modifiers::COMMAND, Key::Num3, [-90.0, 0.0]),
            (Modifiers::NONE, Key::Num1, [0.0, 0.0]),
            (Modifiers::NONE, Key::Num3, [90.0, 0.0]),
            (Modifiers::NONE, Key::Num7, [0.0, 88.0]),
        ];
        for (modifiers, key, [yaw, pitch]) in views {
            if pressed(modifiers, key) {
                self.viewport.orbit.look_from(yaw, pitch);
            }
        }
    }
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        self.show(ui);
    }
}

/// Starts a session. Its news repaint the window, but not while `drawing`: the next picture does.
fn start(ctx: &egui::Context, opened: &Opened, backend: Backend, drawing: &Arc<AtomicBool>) -> Session {
    let (waker, drawing) = (ctx.clone(), drawing.clone());
    let wake = move || {
        if !drawing.load(Ordering::Acquire) {
            waker.request_repaint();
        }
    };
    match opened.cache.clone() {
        Some(cache) => Session::play_back(cache, opened.scene.clone(), wake),
        None => Session::start(opened.scene.clone(), backend, wake),
    }
}

fn hints(ui: &mut egui::Ui, rect: egui::Rect, shown: &mut bool, status: &Status) {
    let place = egui::Area::new(egui::Id::new("hints"))
        .pivot(egui::Align2::LEFT_BOTTOM)
        .fixed_pos(rect.left_bottom() + egui::vec2(10.0, -10.0));
    place.show(ui.ctx(), |ui| {
        egui::Frame::popup(ui.style()).show(ui, |ui| {
            if status.phase == Phase::Loading {
                ui.label("Growing hair …");
            }
            HINTS.iter().for_each(|hint| drop(ui.label(*hint)));
            if ui.button("Hide hints").clicked() {
                *shown = false;
            }
        });
    });
}
