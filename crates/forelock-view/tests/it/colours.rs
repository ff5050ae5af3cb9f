//! What the colours of strands show.

use eframe::egui;
use egui::Key;
use egui::accesskit::Role;
use egui_kittest::kittest::{NodeT, Queryable};
use forelock::scene::InteractionKind;
use forelock_view::App;

use crate::{Window, scene};

impl Window {
    /// Opens the list of what strands show.
    fn list_measures(&mut self) {
        self.harness.get_by_role_and_label(Role::ComboBox, "Strands show").click();
        self.harness.run_steps(3);
    }

    /// Whether a line of the open list can be clicked.
    fn is_offered(&self, line: &str) -> bool {
        !self.harness.get_by_label(line).accesskit_node().is_disabled()
    }

    fn shows(&self, text: &str) -> bool {
        self.harness.query_all_by_label_contains(text).next().is_some()
    }
}

#[test]
fn colours_of_strands_show_what_they_do() {
    let mut window = Window::open(scene(&[]));
    let picture = |app: &App| app.pictures();
    window.until("there is a picture", move |app| picture(app) > 0);
    window.click("Colours");
    window.harness.get_by_role_and_label(Role::ComboBox, "Strands show").click();
    window.until_the_picture_stays();
    let before = picture(window.harness.state());
    window.click("Displacement");
    window.until("it is drawn anew", move |app| picture(app) > before);
    window.harness.get_by_label("10 cm from the rest shape");
    window.until_the_picture_stays();
    let before = picture(window.harness.state());
    window.click("Rest shape");
    window.until("the rest shape is drawn", move |app| picture(app) > before);
}

#[test]
fn contacts_are_shown_once_a_frame_tells_them() {
    let mut window = Window::open(scene(&["interaction.contacts=false"]));
    let told = |app: &App| app.session().moment().is_some_and(|own| own.told.contacts.is_some());
    window.click("Step");
    assert!(!told(window.harness.state()));
    window.click("Colours");
    window.list_measures();
    window.click("Contacts");
    // The frame that is shown tells them at once.
    window.until("contacts are told", told);
    assert!(window.shows("with solids") && window.shows("Contacts between strands are off"));
    assert!(!window.shows("Not known of this frame"));
    window.harness.key_press(Key::Home);
    window.until("the start is shown", |app| app.frame() == 0);
    assert!(window.shows("Not known of this frame"));
    window.click("Step");
    window.until("contacts are told", told);
    // Nothing is asked for that is not shown.
    window.list_measures();
    window.click("Speed");
    window.click("Step");
    window.until("contacts are not told", move |app| !told(app));
}

#[test]
fn what_cannot_be_shown_is_not_offered() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = Window::open(scene(&[]));
    window.click("Colours");
    window.list_measures();
    assert!(window.is_offered("Contacts") && !window.is_offered("Damage"));
    window.click("Damage");
    assert!(!window.status().asked.damage);
    window.harness.state().session().change("the solver", |player| {
        let mut solver = player.solver().clone();
        solver.ams.non_hookean = true;
        player.set_params(&solver)
    });
    window.until("ties weaken", |app| app.session().status().untold.damage.is_none());
    if window.harness.query_by_label("Damage").is_none() {
        window.list_measures();
    }
    assert!(window.is_offered("Damage"));
    window.click("Damage");
    window.until("damage is told", |app| app.session().moment().is_some_and(|own| own.told.damage.is_some()));
    // A cache has neither: what was shown says so.
    window.bake(&folder.path().join("out"), false);
    window.drop_file(&folder.path().join("out/hair.npz"));
    window.until("the cache is open", |app| app.session().status().parameters.is_none());
    assert!(window.shows("Not shown: a cache holds positions only"));
    window.list_measures();
    assert!(!window.is_offered("Contacts") && window.is_offered("Stretch"));
}

#[test]
fn the_grid_is_drawn_where_there_is_one() {
    let mut window = Window::open(scene(&["interaction.kind=none", "interaction.grid.resolution=12"]));
    window.click("Colours");
    assert!(!window.is_offered("Grid"));
    window.harness.state().session().change("the interaction", |player| {
        let mut interaction = player.interaction().clone();
        interaction.kind = InteractionKind::Grid;
        player.set_interaction(&interaction)
    });
    window.until("there is a grid", |app| app.session().status().untold.grid.is_none());
    window.click("Grid");
    assert!(window.shows("Not known of this frame"));
    window.until_the_picture_stays();
    let before = window.harness.state().pictures();
    window.click("Step");
    window.until("the grid is drawn", |app| {
        app.pictures() > before && app.session().moment().is_some_and(|own| own.told.grid.is_some())
    });
    assert!(window.shows("twice as dense as at rest") && !window.shows("Not known of this frame"));
}
