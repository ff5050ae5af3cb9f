//! The window driven by events, without a display: what is clicked, dragged and typed changes the
//! state that it should.

#![expect(clippy::unwrap_used, reason = "a test that cannot build its scene fails")]

mod colours;
#[cfg(target_os = "linux")]
mod display;
mod unsaved;

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use eframe::egui;
use egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use forelock::core::groom::Groom;
use forelock::player::{Player, PlayerError};
use forelock::scene::{Override, SolverKind};
use forelock::session::{Phase, Status};
use forelock::{Assets, Backend, Scene};
use forelock_view::App;
use glam::Vec3;

/// The longest that anything may take.
const PATIENCE: Duration = Duration::from_secs(120);

fn scene(more: &[&str]) -> Scene {
    let keys = ["groom.strands=80", "body.sdf_cells=32", "time.frames=6", "output.film=false"];
    let small = ["output.width=64", "output.height=64", "body.motion=builtin:still"];
    let sets = keys.iter().chain(&small).chain(more);
    let sets: Vec<Override> = sets.map(|key| Override::set(key).unwrap()).collect();
    Scene::builtin(&sets).unwrap()
}

/// A window without a display.
struct Window {
    harness: Harness<'static, App>,
}

impl Window {
    /// A window in which `scene` is loaded.
    fn open(scene: Scene) -> Self {
        let app = App::on_cpu(&egui::Context::default(), scene, Backend::Cpu);
        let show = |ui: &mut egui::Ui, app: &mut App| app.show(ui);
        let harness = Harness::builder().with_size(Vec2::new(1100.0, 760.0)).build_ui_state(show, app);
        let mut window = Self { harness };
        window.until("the scene is loaded", |app| app.session().status().phase == Phase::Ready);
        window
    }

    fn until(&mut self, what: &str, mut is_so: impl FnMut(&App) -> bool) {
        let started = Instant::now();
        while !is_so(self.harness.state()) {
            self.harness.step();
            std::thread::sleep(Duration::from_millis(2));
            let message = self.harness.state().message().unwrap_or_default().to_owned();
            assert!(started.elapsed() < PATIENCE, "waited in vain until {what}; message: {message}");
        }
        self.harness.run_steps(2);
    }

    /// Waits until the hair has played on by two frames, with all that was ordered so far.
    fn until_two_more_frames(&mut self) {
        let now = self.player(|player| Ok(player.frame()));
        self.until("two frames pass", |app| app.frame() >= now + 2);
    }

    /// The first picture is followed by one of all pixels.
    fn until_the_picture_stays(&mut self) {
        let mut last = (Instant::now(), 0);
        self.until("the picture stays", |app| {
            if app.pictures() != last.1 {
                last = (Instant::now(), app.pictures());
            }
            last.0.elapsed() > Duration::from_secs(1)
        });
    }

    fn click(&mut self, label: &str) {
        self.harness.get_by_label(label).click();
        self.harness.run_steps(3);
    }

    /// Clicks on a line of a menu.
    fn choose(&mut self, menu: &str, line: &str) {
        self.click(menu);
        self.click(line);
    }

    /// Types `text` in place of what is in the dialog, and confirms.
    fn answer(&mut self, text: &str) {
        self.harness.run_steps(2);
        self.harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
        self.harness.event(Event::Text(text.to_owned()));
        self.harness.run_steps(2);
        self.click("OK");
    }

    /// Runs the scene into `folder`.
    fn bake(&mut self, folder: &Path, with_film: bool) {
        self.choose("File", "Bake…");
        if with_film {
            self.click("With a film, from where the camera is");
        }
        self.answer(&folder.display().to_string());
        self.until("it is baked", |app| {
            !app.is_baking() && app.message().is_some_and(|text| text.starts_with("baked"))
        });
    }

    /// Drags with the main button from one place of the picture to another, both as shares of it.
    fn drag(&mut self, from: Vec2, to: Vec2) {
        let rect = self.harness.get_by_label("picture").rect();
        let at = |share: Vec2| rect.min + share * rect.size();
        self.harness.hover_at(at(from));
        self.harness.step();
        self.harness.drag_at(at(from));
        self.harness.step();
        for step in 1..=8 {
            self.harness.hover_at(at(from + (to - from) * (step as f32 / 8.0)));
            self.harness.step();
        }
        self.release(at(to));
        self.harness.run_steps(2);
    }

    fn release(&mut self, pos: Pos2) {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
        self.harness.event(Event::PointerButton { pos, button, pressed: false, modifiers });
    }

    fn status(&self) -> Status {
        self.harness.state().session().status()
    }

    /// What `ask` finds in the player.
    fn player<T: Send + Default + 'static>(
        &self,
        ask: impl FnOnce(&mut Player) -> Result<T, PlayerError> + Send + 'static,
    ) -> T {
        let session = self.harness.state().session();
        let found = Arc::new(Mutex::new(T::default()));
        let own = found.clone();
        session.change("asking", move |player| {
            *own.lock().unwrap() = ask(player)?;
            Ok(())
        });
        session.wait();
        std::mem::take(&mut *found.lock().unwrap())
    }

    fn hash(&self) -> u64 {
        self.player(Player::state_hash)
    }

    fn groom(&self) -> Option<Groom> {
        self.player(|player| Ok(Some(player.edited_groom().clone())))
    }

    fn drop_file(&mut self, path: &Path) {
        let file = egui::DroppedFile { path: Some(path.to_owned()), ..Default::default() };
        self.harness.input_mut().dropped_files.push(file);
        self.harness.step();
        self.harness.input_mut().dropped_files.clear();
        self.harness.run_steps(2);
    }
}

const MIDDLE: Vec2 = Vec2::new(0.5, 0.5);

#[test]
fn a_picture_of_hair_appears_and_follows_the_camera() {
    let mut window = Window::open(scene(&[]));
    window.until("there is a picture", App::has_picture);
    let before = window.harness.state().camera();
    window.click("Look");
    window.drag(MIDDLE, Vec2::new(0.6, 0.5));
    assert_ne!(window.harness.state().camera(), before);
    window.harness.key_press(Key::Num1);
    window.harness.run_steps(2);
    let camera = window.harness.state().camera();
    assert!((camera.eye - camera.target).normalize().z > 0.999, "{camera:?}");
}

#[test]
fn hair_plays_stops_steps_and_goes_back() {
    let mut window = Window::open(scene(&["body.motion=builtin:turn"]));
    let start = window.hash();
    window.click("Play");
    window.until("frames pass", |app| app.frame() >= 3);
    window.click("Pause");
    window.harness.state().session().wait();
    let frame = window.player(|player| Ok(player.frame()));
    window.click("Step");
    assert_eq!(window.player(|player| Ok(player.frame())), frame + 1);
    window.harness.key_press(Key::Home);
    window.harness.run_steps(2);
    assert_eq!((window.player(|player| Ok(player.frame())), window.hash()), (0, start));
}

#[test]
fn the_head_follows_the_mouse_and_a_solid_pushes() {
    let mut window = Window::open(scene(&[]));
    window.click("Head");
    window.drag(MIDDLE, Vec2::new(0.62, 0.5));
    window.until_two_more_frames();
    let moved = window.player(|player| Ok(player.head_pose().translation));
    // The camera sees the head from its front and left: to the right is +x and −z.
    assert!(moved.x > 0.02 && moved.z < 0.0 && moved.y.abs() < 0.01, "{moved}");
    window.click("Ball");
    let solids = |player: &mut Player| Ok(player.colliders().count());
    let before = window.player(solids);
    window.drag(Vec2::new(0.3, 0.4), MIDDLE);
    assert_eq!(window.player(solids), before + 1);
    window.click("Remove solid");
    assert_eq!(window.player(solids), before);
}

#[test]
fn a_cut_is_undone_redone_saved_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = Window::open(scene(&[]));
    window.click("Step");
    let whole = window.hash();
    window.click("Cut");
    window.drag(Vec2::new(0.3, 0.55), Vec2::new(0.7, 0.55));
    assert_eq!(window.player(|player| Ok(player.undoable())), [Some("cut"), None]);
    let cut = window.hash();
    assert_ne!(cut, whole);
    window.harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.harness.run_steps(2);
    assert_eq!(window.hash(), whole);
    window.harness.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    window.harness.run_steps(2);
    assert_eq!(window.hash(), cut);

    let path = folder.path().join("fringe.toml");
    window.choose("File", "Save scene…");
    window.answer(&path.display().to_string());
    window.until("the scene is saved", |app| app.message().is_some_and(|text| text.starts_with("saved")));
    // The file is a script for `forelock groom` that leads to the same hair.
    let saved = Scene::load(&path, &[]).unwrap();
    let replayed = Assets::load(&saved, &mut |_| {}).unwrap();
    assert_eq!(Some(&replayed.groom), window.groom().as_ref());
    window.drop_file(&path);
    window.until("the scene is read", |app| app.session().status().phase == Phase::Ready && app.frame() == 0);
    assert_eq!(Some(replayed.groom), window.groom());
}

#[test]
fn a_click_makes_one_side_the_image_of_the_other() {
    let mut window = Window::open(scene(&[]));
    window.until("there is a picture", App::has_picture);
    window.harness.key_press(Key::Num1);
    window.harness.run_steps(2);
    // From the front the head's left is to the right.
    for (place, side) in [(0.6, 1.0), (0.4, -1.0)] {
        let before = window.groom().unwrap();
        window.click("Mirror");
        let place = Vec2::new(place, 0.25);
        window.drag(place, place);
        window.harness.state().session().wait();
        let after = window.groom().unwrap();
        assert_ne!(after, before, "{side}");
        let roots = |groom: &Groom, side: f32| -> Vec<Vec3> {
            groom.strands().map(|strand| strand[0]).filter(|root| root.x * side > 0.0).collect()
        };
        assert_eq!(roots(&after, side), roots(&before, side));
        // Images are brought out of the head, which is not quite symmetric.
        let (sources, images) = (roots(&after, side), roots(&after, -side));
        assert_eq!(sources.len(), images.len());
        assert!(sources.iter().zip(&images).all(|(p, image)| p.with_x(-p.x).distance(*image) < 1e-4));
        window.harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
        window.harness.run_steps(2);
        assert_eq!(window.groom().unwrap(), before);
    }
}

/// The window is made larger, smaller, and minimised, which leaves no pixels.
#[test]
fn the_window_can_have_any_size() {
    let mut window = Window::open(scene(&["body.motion=builtin:turn"]));
    window.click("Play");
    for size in [[1600.0, 1000.0], [480.0, 320.0], [300.0, 20.0], [0.0, 0.0], [1100.0, 760.0]] {
        window.harness.set_size(size.into());
        window.harness.run_steps(4);
        if size[1] > 100.0 {
            let before = window.harness.state().pictures();
            window.until("there are pictures", move |app| app.pictures() > before + 1);
        }
    }
    window.until_two_more_frames();
    assert_eq!(window.status().error, None);
}

#[test]
fn what_the_mouse_moved_is_saved_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = Window::open(scene(&[]));
    window.click("Head");
    window.drag(MIDDLE, Vec2::new(0.62, 0.5));
    window.until_two_more_frames();
    window.click("Ball");
    window.drag(Vec2::new(0.3, 0.4), MIDDLE);
    window.click("Pause");
    let (head, frame) = window.player(|player| Ok((player.head_pose().translation, player.frame())));
    let mut saved = |name: &str, with_motion: bool| {
        let path = folder.path().join(name);
        window.choose("File", "Save scene…");
        if with_motion {
            window.click("With the motion of head and solids by the mouse");
        }
        window.answer(&path.display().to_string());
        window.until("the scene is saved", |app| app.message().is_some_and(|text| text.ends_with(name)));
        Scene::load(&path, &[]).unwrap()
    };
    let without = saved("without.toml", false);
    assert!(without.colliders.is_empty() && without.body.motion.keyframes.is_empty());
    let with = saved("with.toml", true);
    assert_eq!((with.colliders.len(), with.time.frames.max(frame)), (1, with.time.frames));
    let mut again = Player::builder(with).backend(Backend::Cpu).build().unwrap();
    (0..frame).for_each(|_| drop(again.step().unwrap()));
    assert!(again.head_pose().translation.distance(head) < 1e-9);
}

#[test]
fn the_solver_changes_while_hair_moves() {
    let mut window = Window::open(scene(&[]));
    window.click("Play");
    window.until("frames pass", |app| app.frame() >= 2);
    window.click("method");
    window.click("dftl");
    window.until("the solver is another one", |app| {
        app.session().status().parameters.is_some_and(|now| now.solver.kind == SolverKind::Dftl)
    });
    let frame = window.harness.state().frame();
    window.until("hair moves on", |app| app.frame() >= frame + 3);
    window.harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.until("the solver is the first one", |app| {
        app.session().status().parameters.is_some_and(|now| now.solver.kind == SolverKind::Ams)
    });
    assert_eq!(window.status().error, None);
}

#[test]
fn a_scene_is_baked_into_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = Window::open(scene(&[]));
    window.bake(&folder.path().join("out"), false);
    assert!(folder.path().join("out/hair.npz").is_file() && folder.path().join("out/summary.json").is_file());
}

#[test]
fn a_baked_cache_is_played_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = Window::open(scene(&[]));
    window.bake(&folder.path().join("out"), false);
    let path = folder.path().join("out/hair.npz");
    window.drop_file(&path);
    window.until("the cache is open", |app| app.session().status().parameters.is_none());
    let mut cache = forelock_io::Cache::open(&path).unwrap();
    assert_eq!(window.status().reached as usize, cache.frames() - 1);
    window.click("Play");
    window.until("its last frame is shown", |app| app.frame() == app.session().status().reached);
    window.until("it stops", |app| !app.session().status().playing);
    let mut last = Vec::new();
    cache.read_frame(cache.frames() - 1, &mut last).unwrap();
    assert_eq!(window.harness.state().session().moment().unwrap().positions, last);
    // Steps beyond its end do nothing, and changes are refused in a sentence.
    window.click("Step");
    window.harness.state().session().undo();
    window.until("there is a message", |app| app.message().is_some_and(|text| text.contains("played back")));
    assert_eq!(window.harness.state().session().moment().unwrap().positions, last);
}

/// The bytes of the first picture of a film.
fn first_picture(path: &Path) -> Vec<u8> {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    pixels
}

/// The mean difference of two pictures, of 255.
fn difference(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
}

#[test]
fn films_are_made_from_where_the_camera_is() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = Window::open(scene(&["time.frames=3", "output.film_every=1", "output.cache_every=1"]));
    window.until("there is a picture", App::has_picture);
    let placed = window.harness.state().camera();
    window.click("Look");
    window.drag(MIDDLE, Vec2::new(0.7, 0.45));
    let camera = window.harness.state().camera();
    assert!(camera.eye.distance(placed.eye) > 0.05);
    window.bake(&folder.path().join("out"), true);
    let film = first_picture(&folder.path().join("out/film.png"));
    // The run's scene has the camera, so a film of its cache is the same, but for widths and
    // colours of strands, which a cache does not hold.
    window.drop_file(&folder.path().join("out/hair.npz"));
    window.until("the cache is open", |app| app.session().status().parameters.is_none());
    window.until("the camera is placed", |app| app.camera() != camera && app.has_picture());
    let found = window.harness.state().camera();
    assert!(found.eye.distance(camera.eye) < 1e-4, "{found:?} is not {camera:?}");
    let path = folder.path().join("again.png");
    window.choose("File", "Film…");
    window.answer(&path.display().to_string());
    window.until("it is made", |app| app.message().is_some_and(|text| text.starts_with("saved")));
    let apart = difference(&first_picture(&path), &film);
    assert!(apart < 1.5, "the films differ by {apart}");
    // Another place gives another film, and no file is written under another name.
    window.drag(MIDDLE, Vec2::new(0.2, 0.5));
    window.choose("File", "Film…");
    window.answer(&path.display().to_string());
    window.until("it is made", |app| {
        !app.is_baking() && difference(&first_picture(&path), &film) > 4.0 + apart
    });
    window.choose("File", "Film…");
    window.answer(&folder.path().join("film.mp4").display().to_string());
    window.until("there is a message", |app| app.message().is_some_and(|text| text.contains("animated PNG")));
}

#[test]
fn a_dialog_lists_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("listed.toml");
    std::fs::write(&path, scene(&["groom.strands=20"]).to_toml()).unwrap();
    let mut window = Window::open(scene(&[]));
    window.choose("File", "Open…");
    window.harness.run_steps(2);
    window.harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.harness.event(Event::Text(format!("{}/", folder.path().display())));
    window.harness.run_steps(2);
    // Up, and back.
    window.harness.get_by_label("listed.toml");
    window.click("../");
    assert!(window.harness.query_by_label("listed.toml").is_none());
    window.harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.harness.event(Event::Text(format!("{}/", folder.path().display())));
    window.harness.run_steps(2);
    window.click("listed.toml");
    window.click("OK");
    window.until("it is open", |app| {
        app.session().moment().is_some_and(|moment| moment.groom().strand_count() == 20)
    });
}

#[test]
fn a_file_that_cannot_be_read_is_a_message_and_nothing_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = Window::open(scene(&[]));
    let hash = window.hash();
    for (name, text) in [("broken.toml", "[groom\n"), ("broken.hair", "no hair")] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        window.drop_file(&path);
        window.until("there is a message", |app| app.message().is_some());
        assert!(window.harness.state().message().unwrap().contains(name));
        window.click("Dismiss");
        assert_eq!(window.harness.state().message(), None);
    }
    window.drop_file(&folder.path().join("nowhere.hair"));
    window.until("there is a message", |app| app.message().is_some());
    assert_eq!(window.hash(), hash, "the scene that was open is still there");
}

#[test]
fn unsaved_work_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = Window::open(scene(&[]));
    let path = folder.path().join("other.toml");
    std::fs::write(&path, scene(&["groom.strands=20"]).to_toml()).unwrap();
    window.click("Cut");
    window.drag(Vec2::new(0.3, 0.55), Vec2::new(0.7, 0.55));
    let cut = window.hash();
    window.drop_file(&path);
    window.click("Go back");
    assert_eq!(window.hash(), cut);
    window.drop_file(&path);
    window.click("Lose them");
    window.until("the other scene is open", |app| {
        app.session().moment().is_some_and(|moment| moment.groom().strand_count() == 20)
    });
}

#[test]
fn a_slider_changes_its_parameter_and_its_drag_is_undone_in_one_go() {
    let mut window = Window::open(scene(&[]));
    let friction = |app: &App| app.session().status().parameters.map(|now| now.solver.ams.drag);
    let before = friction(window.harness.state()).unwrap();
    let rect = window.harness.get_by_role_and_label(egui::accesskit::Role::Slider, "drag").rect();
    let at = |share: f32| egui::pos2(rect.left() + 8.0 + share * 40.0, rect.center().y);
    window.harness.hover_at(at(0.0));
    window.harness.step();
    window.harness.drag_at(at(0.0));
    for step in 0..5 {
        window.harness.hover_at(at(step as f32 / 4.0));
        window.harness.run_steps(2);
    }
    window.release(at(1.0));
    window.until("the parameter is another one", |app| friction(app) != Some(before));
    window.harness.state().session().wait();
    window.harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.until("it is back", |app| friction(app) == Some(before));
    assert_eq!(window.player(|player| Ok(player.undoable()))[0], None, "one drag is one change");
}
