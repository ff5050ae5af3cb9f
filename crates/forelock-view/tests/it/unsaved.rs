//! What is asked about before it is lost.

use std::path::PathBuf;

use eframe::egui::Vec2;
use egui_kittest::kittest::Queryable;
use forelock_view::App;

use crate::{MIDDLE, Window, scene};

/// Another scene, of twenty strands.
fn other(folder: &tempfile::TempDir) -> PathBuf {
    let path = folder.path().join("other.toml");
    std::fs::write(&path, scene(&["groom.strands=20"]).to_toml()).unwrap();
    path
}

fn is_other(app: &App) -> bool {
    app.session().moment().is_some_and(|moment| moment.groom().strand_count() == 20)
}

#[test]
fn drags_of_head_and_solids_are_unsaved_work() {
    let folder = tempfile::tempdir().unwrap();
    let path = other(&folder);
    for tool in ["Head", "Ball"] {
        let mut window = Window::open(scene(&[]));
        window.until("there is a picture", App::has_picture);
        window.click(tool);
        window.drag(MIDDLE, Vec2::new(0.6, 0.5));
        window.click("Pause");
        window.drop_file(&path);
        window.click("Go back");
        assert!(!window.harness.state().is_loading(), "{tool}");
        window.drop_file(&path);
        window.click("Lose them");
        window.until("the other scene is open", is_other);
    }
}

#[test]
fn what_only_looks_is_not_asked_about() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = Window::open(scene(&[]));
    window.until("there is a picture", App::has_picture);
    window.click("Look");
    window.drag(MIDDLE, Vec2::new(0.6, 0.5));
    // A press that does not move the head is no change either.
    window.click("Head");
    window.drag(MIDDLE, MIDDLE);
    window.drop_file(&other(&folder));
    assert!(window.harness.query_by_label("Go back").is_none());
    window.until("the other scene is open", is_other);
}

#[test]
fn what_the_panel_changes_is_unsaved_work() {
    let folder = tempfile::tempdir().unwrap();
    let path = other(&folder);
    for clicks in [&["shake"][..], &["method", "dftl"]] {
        let mut window = Window::open(scene(&[]));
        clicks.iter().for_each(|label| window.click(label));
        window.drop_file(&path);
        window.click("Lose them");
        window.until("the other scene is open", is_other);
    }
}

#[test]
fn the_demo_is_asked_about_too() {
    let mut window = Window::open(scene(&[]));
    window.click("shake");
    window.choose("File", "Demo");
    window.click("Go back");
    assert!(!window.harness.state().is_loading());
}

#[test]
fn changes_while_another_scene_loads_are_asked_about() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slow.toml");
    std::fs::write(&path, scene(&["groom.strands=4000", "interaction.kind=none"]).to_toml()).unwrap();
    let mut window = Window::open(scene(&[]));
    for (answer, strands) in [("Go back", 80), ("Lose them", 4000)] {
        window.drop_file(&path);
        assert!(window.harness.state().is_loading());
        window.click("shake");
        assert!(window.harness.state().is_loading(), "loaded before the change");
        let started = std::time::Instant::now();
        while window.harness.query_by_label(answer).is_none() {
            window.harness.step();
            assert!(started.elapsed() < crate::PATIENCE, "it does not ask");
        }
        // The dialog finds its place.
        window.harness.run_steps(3);
        window.click(answer);
        window.until("nothing loads", |app| !app.is_loading());
        let moment = window.harness.state().session().moment().unwrap();
        assert_eq!(moment.groom().strand_count(), strands, "{answer}");
        // The changes of the scene that stays are asked about again.
        if answer == "Go back" {
            window = Window::open(scene(&[]));
        }
    }
}
