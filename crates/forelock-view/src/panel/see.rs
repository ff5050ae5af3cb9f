//! The panel of what is seen: colours, and numbers of the simulation.

use std::collections::VecDeque;

use eframe::egui;
use forelock::player::{Asked, Moment};
use forelock::scene::HairSection;
use forelock::session::Status;
use forelock_render::HairColour;

use crate::measure::{self, Measure};

/// Frames in the plot of times.
const PLOTTED: usize = 120;

/// What is said while something is not known of the frame that is shown.
const NOT_YET: &str = "Not known of this frame: the next one has it.";

/// What the colours of strands show, with its scale. What cannot be shown says why.
pub fn measures(ui: &mut egui::Ui, measure: &mut Measure, status: &Status, moment: Option<&Moment>) {
    egui::ComboBox::from_label("Strands show").selected_text(measure.words().0).show_ui(ui, |ui| {
        for own in Measure::ALL {
            let why = own.untold(&status.untold);
            let line = egui::Button::selectable(*measure == own, own.words().0);
            let mut line = ui.add_enabled(why.is_none(), line);
            if let Some(why) = why {
                line = line.on_disabled_hover_text(why.to_string());
            }
            if line.clicked() {
                *measure = own;
            }
        }
    });
    if let Some(why) = measure.untold(&status.untold) {
        ui.weak(format!("Not shown: {why}."));
        return;
    }
    match *measure {
        Measure::Hair => {}
        Measure::Contacts => touches(ui, status),
        _ => scale(ui, measure.words().1),
    }
    if moment.is_some_and(|moment| !measure.is_told(moment)) {
        ui.weak(NOT_YET);
    }
    if measure.asks() != Asked::default() && status.has_guides {
        ui.weak("Strands that follow guides show their nearest guide.");
    }
}

/// The choice of whether the grid is drawn, with its scale.
pub fn grid(ui: &mut egui::Ui, has_grid: &mut bool, status: &Status, moment: Option<&Moment>) {
    let why = status.untold.grid;
    let choice = ui.add_enabled(why.is_none() || *has_grid, egui::Checkbox::new(has_grid, "Grid"));
    choice
        .on_hover_text("Draws the cells that hold hair, coloured by its density")
        .on_disabled_hover_text(why.map_or_else(String::new, |why| why.to_string()));
    match why {
        _ if !*has_grid => {}
        Some(why) => drop(ui.weak(format!("Not shown: {why}."))),
        None => {
            scale(ui, "twice as dense as at rest");
            if moment.is_some_and(|moment| moment.told.grid.is_none()) {
                ui.weak(NOT_YET);
            }
        }
    }
}

/// The scale of colours, up to what `end` says.
fn scale(ui: &mut egui::Ui, end: &str) {
    ui.horizontal(|ui| {
        ui.weak("0");
        let (rect, _) = ui.allocate_exact_size(egui::vec2(120.0, 10.0), egui::Sense::hover());
        for step in 0_u8..24 {
            let [low, high] = [step, step + 1].map(|own| rect.left() + f32::from(own) / 24.0 * rect.width());
            let [r, g, b] = measure::colour((f32::from(step) + 0.5) / 24.0);
            let part = egui::Rect::from_x_y_ranges(low..=high, rect.y_range());
            ui.painter().rect_filled(part, 0.0, egui::Rgba::from_rgb(r, g, b));
        }
        ui.weak(end);
    });
}

/// The colours of contacts.
fn touches(ui: &mut egui::Ui, status: &Status) {
    ui.horizontal_wrapped(|ui| {
        for (touch, words) in measure::TOUCHES {
            let (rect, _) = ui.allocate_exact_size(egui::vec2(10.0, 10.0), egui::Sense::hover());
            let [r, g, b] = measure::colour_of(touch);
            ui.painter().rect_filled(rect, 2.0, egui::Rgba::from_rgb(r, g, b));
            ui.weak(words);
        }
    });
    if status.parameters.as_ref().is_some_and(|own| !own.interaction.contacts) {
        ui.weak("Contacts between strands are off: those with solids are shown.");
    }
}

/// Colours of the hair and of the body beneath. Returns whether one is new.
pub fn colours(ui: &mut egui::Ui, hair: &mut HairSection) -> bool {
    let before = hair.clone();
    let list = |ui: &mut egui::Ui, label: &str, now: &mut String, first: Option<&str>| {
        egui::ComboBox::from_label(label).selected_text(now.as_str()).show_ui(ui, |ui| {
            for name in first.into_iter().chain(HairColour::NAMES) {
                ui.selectable_value(now, name.to_owned(), name);
            }
        });
    };
    list(ui, "Hair", &mut hair.colour, None);
    greying_and_dye(ui, hair);
    list(ui, "Body", &mut hair.body_colour, Some("clay"));
    let mut width = hair.width * 1e3;
    ui.horizontal(|ui| {
        let value = egui::DragValue::new(&mut width).range(0.0..=10.0).speed(0.005).suffix(" mm");
        if ui.add(value).on_hover_text("Width of a drawn strand; 0 chooses one").changed() {
            hair.width = width * 1e-3;
        }
        ui.label("Width");
    });
    before != *hair
}

/// The share of white hairs, and a dye.
fn greying_and_dye(ui: &mut egui::Ui, hair: &mut HairSection) {
    let of_colour = HairColour::by_name(&hair.colour).map_or(0.0, |colour| f64::from(colour.greying));
    let mut greying = hair.greying.unwrap_or(of_colour);
    let slider = egui::Slider::new(&mut greying, 0.0..=1.0).text("Greying");
    if ui.add(slider).on_hover_text("Share of the hairs that are white").changed() {
        hair.greying = Some(greying);
    }
    ui.horizontal(|ui| {
        let mut has_dye = hair.dye.is_some();
        let told = "A colour that white hair takes; on other hair it adds";
        if ui.checkbox(&mut has_dye, "Dye").on_hover_text(told).changed() {
            hair.dye = has_dye.then_some([0.2, 0.45, 0.75]);
        }
        if let Some(dye) = &mut hair.dye {
            let mut bytes = dye.map(|part| (255.0 * part).round() as u8);
            if ui.color_edit_button_srgb(&mut bytes).changed() {
                *dye = bytes.map(|byte| f64::from(byte) / 255.0);
            }
        }
    });
}

/// Times of the last frames.
#[derive(Clone, Debug, Default)]
pub struct Times {
    /// For each frame its number and the milliseconds of each stage.
    frames: VecDeque<(u32, Vec<(&'static str, f32)>)>,
}

impl Times {
    /// Adds those of frame `frame`, unless they are in it.
    pub fn add(&mut self, frame: u32, status: &Status) {
        if self.frames.back().is_some_and(|(last, _)| *last == frame) {
            return;
        }
        let stages = status.report.stages.iter().map(|(name, secs)| (name, 1e3 * secs as f32));
        self.frames.push_back((frame, stages.filter(|(_, ms)| *ms > 0.0).collect()));
        if self.frames.len() > PLOTTED {
            self.frames.pop_front();
        }
    }

    /// The stages of the newest frame, as a stacked plot over the frames and a list.
    pub fn show(&self, ui: &mut egui::Ui) {
        let total = |stages: &[(&str, f32)]| stages.iter().map(|(_, ms)| ms).sum::<f32>();
        let most = self.frames.iter().map(|(_, stages)| total(stages)).fold(1.0, f32::max);
        let (place, painter) =
            ui.allocate_painter(egui::vec2(ui.available_width(), 70.0), egui::Sense::hover());
        let rect = place.rect;
        painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
        let wide = rect.width() / PLOTTED as f32;
        for (column, (_, stages)) in self.frames.iter().enumerate() {
            let mut bottom = rect.bottom();
            for (name, ms) in stages {
                let top = bottom - ms / most * rect.height();
                let left = rect.left() + column as f32 * wide;
                let bar = egui::Rect::from_x_y_ranges(left..=left + wide, top..=bottom);
                painter.rect_filled(bar, 0.0, colour_of(name));
                bottom = top;
            }
        }
        ui.weak(format!("work of all threads, highest {most:.1} ms"));
        for (name, ms) in self.frames.back().map(|(_, stages)| &stages[..]).unwrap_or_default() {
            ui.horizontal(|ui| {
                let (rect, _) = ui.allocate_exact_size(egui::vec2(10.0, 10.0), egui::Sense::hover());
                ui.painter().rect_filled(rect, 2.0, colour_of(name));
                ui.monospace(format!("{ms:7.2} ms"));
                ui.label(*name);
            });
        }
    }
}

/// A colour for each name.
fn colour_of(name: &str) -> egui::Color32 {
    let sum = name.bytes().fold(7_u32, |sum, byte| sum.wrapping_mul(31).wrapping_add(byte.into()));
    egui::ecolor::Hsva::new((sum % 97) as f32 / 97.0, 0.55, 0.8, 1.0).into()
}

/// Counts and measures of the newest frame.
pub fn numbers(ui: &mut egui::Ui, moment: &Moment, status: &Status, drawn_ms: f32, drawn_by: &str) {
    let row = |ui: &mut egui::Ui, name: &str, value: String| {
        ui.label(name);
        ui.monospace(value);
        ui.end_row();
    };
    let report = &status.report;
    let megabytes = |bytes: u64| format!("{:.0} MB", bytes as f64 / 1e6);
    egui::Grid::new("numbers").num_columns(2).show(ui, |ui| {
        row(ui, "Strands", moment.groom().strand_count().to_string());
        row(ui, "Particles", moment.positions.len().to_string());
        row(ui, "Simulated by", status.device.clone());
        row(ui, "Frame", format!("{:.1} ms", status.step_ms));
        row(ui, "Real time", format!("{:.2}×", status.real_time));
        row(ui, "Drawn by", drawn_by.to_owned());
        row(ui, "Picture", format!("{drawn_ms:.0} ms"));
        row(ui, "Asleep", report.sleeping_strands.to_string());
        row(ui, "Touching", report.touching.to_string());
        row(ui, "Contacts", report.strand_contacts.contacts.to_string());
        row(ui, "Stretch", format!("{:.2e}", report.max_edge_stretch_final));
        row(ui, "Inside solids", format!("{:.2} mm", 1e3 * report.max_penetration_m));
        row(ui, "Reset strands", report.quarantined_strands.to_string());
        row(ui, "Memory", megabytes(status.bytes[0]));
        row(ui, "For going back", megabytes(status.bytes[1]));
    });
}
