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
