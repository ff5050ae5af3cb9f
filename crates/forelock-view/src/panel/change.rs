//! The panel of what can be changed while hair moves: solver, interaction, wind, gravity, motion.

use std::sync::Arc;

use eframe::egui;
use forelock::player::{Parameters, Player, PlayerError};
use forelock::scene::{InteractionSection, MotionSection, SolverSection};
use forelock::session::Session;
use forelock_core::air::WindParams;
use glam::DVec3;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::keys::{self, Touched};

/// The motions of the head in the list.
const MOTIONS: [&str; 8] =
    ["still", "turn", "nod", "shake", "spin", "jump", "shake-and-jump", "roller-coaster"];
const INTERACTIONS: [&str; 3] = ["none", "grid", "sph"];

/// The panel.
#[derive(Clone, Debug, Default)]
pub struct ChangePanel {
    /// What the widgets show: the parameters of the session, or a drag ahead of them.
    own: Option<Tables>,
    /// The parameters that `own` was made from.
    of: Option<Arc<Parameters>>,
    /// The number of the drag that goes on; its changes are undone together.
    drag: u64,
}

#[derive(Clone, Debug)]
struct Tables {
    solver: toml::Table,
    interaction: toml::Table,
    wind: toml::Table,
    gravity: [f64; 3],
}

impl Tables {
    fn of(parameters: &Parameters) -> Self {
        let table = |value: Result<toml::Table, toml::ser::Error>| value.unwrap_or_default();
        Self {
            solver: table(toml::Table::try_from(&parameters.solver)),
            interaction: table(toml::Table::try_from(&parameters.interaction)),
            wind: table(toml::Table::try_from(&parameters.wind)),
            gravity: parameters.gravity,
        }
    }
}

impl ChangePanel {
    /// Draws the panel for a session with `parameters`, and passes changes on. Returns whether
    /// there were any, or the message of a value that cannot be.
    pub fn show(
        &mut self,
        ui: &mut egui::Ui,
        session: &Session,
        parameters: &Arc<Parameters>,
    ) -> Result<bool, String> {
        let is_dragging = ui.ctx().egui_is_using_pointer();
        let is_new = self.of.as_ref().is_none_or(|of| **of != **parameters);
        let tables = match self.own.take() {
            Some(own) if !is_new || is_dragging => self.own.insert(own),
            _ => {
                self.of = Some(parameters.clone());
                self.own.insert(Tables::of(parameters))
            }
        };
        let mut is_moved = false;
        egui::CollapsingHeader::new("Motion").default_open(true).show(ui, |ui| {
            is_moved = motions(ui, session);
        });
        let mut passed = Ok(is_moved);
        let mut ended = false;
        let mut pass = |touched: Touched, order: &mut dyn FnMut(u64) -> Result<(), String>| {
            ended |= touched.ended;
            if touched.changed {
                passed = order(self.drag).map(|()| true);
            }
        };
        egui::CollapsingHeader::new("Solver").default_open(true).show(ui, |ui| {
            let touched = solver(ui, &mut tables.solver);
            pass(touched, &mut |drag| {
                let section: SolverSection = read(&tables.solver)?;
                change(session, "the solver", drag, move |player| player.set_params(&section));
                Ok(())
            });
        });
        egui::CollapsingHeader::new("Hair against hair").show(ui, |ui| {
            let touched = interaction(ui, &mut tables.interaction);
            pass(touched, &mut |drag| {
                let section: InteractionSection = read(&tables.interaction)?;
                change(session, "the interaction", drag, move |player| player.set_interaction(&section));
                Ok(())
            });
        });
        egui::CollapsingHeader::new("Wind").show(ui, |ui| {
            let touched = keys::table(ui, "wind", &mut tables.wind, &[]);
            pass(touched, &mut |drag| {
                let wind: WindParams = read(&tables.wind)?;
                change(session, "the wind", drag, move |player| player.set_wind(&wind));
                Ok(())
            });
        });
        egui::CollapsingHeader::new("Gravity").show(ui, |ui| {
            let touched = gravity(ui, &mut tables.gravity);
            let gravity = tables.gravity;
            pass(touched, &mut |drag| {
                change(session, "gravity", drag, move |player| player.set_gravity(gravity.into()));
                Ok(())
            });
        });
        if ended {
            self.drag += 1;
        }
        passed
    }
}

/// Makes a change that is undone together with the others of the same drag.
fn change(
    session: &Session,
    what: &'static str,
    drag: u64,
    task: impl FnOnce(&mut Player) -> Result<(), PlayerError> + Send + 'static,
) {
    session.change(what, move |player| player.grouped(drag, task));
}

fn read<T: DeserializeOwned + Serialize>(table: &toml::Table) -> Result<T, String> {
    T::deserialize(toml::Value::Table(table.clone())).map_err(|error| error.message().to_owned())
}

/// Whether a motion was chosen.
fn motions(ui: &mut egui::Ui, session: &Session) -> bool {
    let mut is_chosen = false;
    ui.horizontal_wrapped(|ui| {
        for name in MOTIONS {
            if ui.button(name).on_hover_text(format!("Move the head as builtin:{name}")).clicked() {
                session.change("the motion", move |player| {
                    let section =
                        MotionSection { name: format!("builtin:{name}"), ..MotionSection::default() };
                    let motion = player.assets().motion(&section)?;
                    player.set_motion(motion)
                });
                session.play(true);
                is_chosen = true;
            }
        }
    });
    is_chosen
}

/// A list of `names` for the kind in `table`.
fn choice(ui: &mut egui::Ui, table: &mut toml::Table, label: &str, names: &[&str]) -> Touched {
    let Some(toml::Value::String(now)) = table.get_mut("kind") else { return Touched::default() };
    let before = now.clone();
    egui::ComboBox::from_label(label).selected_text(now.as_str()).show_ui(ui, |ui| {
        for name in names {
            ui.selectable_value(now, (*name).to_owned(), *name);
        }
    });
    let changed = before != *now;
    Touched { changed, ended: changed }
}

fn solver(ui: &mut egui::Ui, table: &mut toml::Table) -> Touched {
    let mut touched = choice(ui, table, "method", &forelock::scene::SolverKind::NAMES);
    let kind = table.get("kind").and_then(toml::Value::as_str).unwrap_or_default().replace('-', "_");
    if let Some(toml::Value::Table(values)) = table.get_mut(&kind) {
        touched = touched.or(keys::table(ui, &format!("solver.{kind}"), values, &[]));
    }
    touched.or(keys::table(ui, "solver", table, &["kind", "simd"]))
}

fn interaction(ui: &mut egui::Ui, table: &mut toml::Table) -> Touched {
    let mut touched = choice(ui, table, "kind", &INTERACTIONS);
    let kind = table.get("kind").and_then(toml::Value::as_str).unwrap_or_default().to_owned();
    touched = touched.or(keys::table(ui, "interaction", table, &["kind"]));
    for part in [kind.as_str(), "contact"] {
        if let Some(toml::Value::Table(values)) = table.get_mut(part) {
            ui.separator();
            ui.label(part);
            touched = touched.or(keys::table(ui, &format!("interaction.{part}"), values, &[]));
        }
    }
    touched
}

fn gravity(ui: &mut egui::Ui, gravity: &mut [f64; 3]) -> Touched {
    let mut touched = Touched::default();
    ui.horizontal(|ui| {
        for (axis, number) in ["x", "y", "z"].into_iter().zip(gravity.iter_mut()) {
            let value =
                egui::DragValue::new(number).speed(0.1).range(-1000.0..=1000.0).prefix(format!("{axis} "));
            touched = touched.or(Touched::by(&ui.add(value)));
        }
        ui.weak("m/s²");
    });
    ui.horizontal(|ui| {
        for (name, value) in [("Earth", -9.81), ("Moon", -1.62), ("None", 0.0)] {
            if ui.button(name).clicked() {
                *gravity = DVec3::new(0.0, value, 0.0).to_array();
                touched = Touched { changed: true, ended: true };
            }
        }
    });
    touched
}
