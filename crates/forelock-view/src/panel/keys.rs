//! Widgets for the keys of a scene's tables, made from the documentation of the parameters.

use std::ops::RangeInclusive;

use eframe::egui;
use forelock::scene::reference::{self, Entry};

/// How far a slider without bounds of its own reaches beyond the default, as a factor.
const REACH: f64 = 100.0;
/// Ratio of bounds above which a slider is logarithmic.
const WIDE: f64 = 20.0;

/// What a user did to a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Touched {
    /// Whether a value is another one than before.
    pub changed: bool,
    /// Whether a drag of a slider has ended, or there was none.
    pub ended: bool,
}

impl Touched {
    /// By a widget.
    pub fn by(response: &egui::Response) -> Self {
        let changed = response.changed();
        Self { changed, ended: response.drag_stopped() || (changed && !response.dragged()) }
    }

    /// By one widget or another.
    pub fn or(self, other: Self) -> Self {
        Self { changed: self.changed || other.changed, ended: self.ended || other.ended }
    }
}

/// Widgets for all keys of `values`, the table `name` of a scene, in the order of the reference.
/// Values that have widgets elsewhere are in `hidden`.
pub fn table(ui: &mut egui::Ui, name: &str, values: &mut toml::Table, hidden: &[&str]) -> Touched {
    let mut touched = Touched::default();
    let own = |entry: &&Entry| entry.key.rsplit_once('.').is_some_and(|(table, _)| table == name);
    for entry in reference::keys().filter(own) {
        let key = entry.key.rsplit('.').next().unwrap_or_default();
        if hidden.contains(&key) {
            continue;
        }
        let Some(value) = values.get_mut(key) else { continue };
        touched = touched.or(one(ui, entry, key, value));
    }
    touched
}

fn one(ui: &mut egui::Ui, entry: &Entry, key: &str, value: &mut toml::Value) -> Touched {
    let default = default_of(entry);
    match value {
        toml::Value::Boolean(on) => {
            let response = ui.checkbox(on, key).on_hover_text(described(entry));
            Touched::by(&response)
        }
        toml::Value::Float(number) => {
            let default = default.and_then(|value| value.as_float());
            let touched = slider(ui, entry, key, number, default, false);
            *number = allowed(entry, *number);
            touched
        }
        toml::Value::Integer(whole) => {
            let mut number = *whole as f64;
            let default = default.and_then(|value| value.as_integer()).map(|value| value as f64);
            let touched = slider(ui, entry, key, &mut number, default, true);
            // Whole numbers of a slider are exact.
            *whole = allowed(entry, number) as i64;
            touched
        }
        toml::Value::String(text) if quoted(entry).len() > 1 => {
            let before = text.clone();
            egui::ComboBox::from_label(key)
                .selected_text(text.as_str())
                .show_ui(ui, |ui| {
                    for name in quoted(entry) {
                        ui.selectable_value(text, name.to_owned(), name);
                    }
                })
                .response
                .on_hover_text(described(entry));
            let changed = before != *text;
            Touched { changed, ended: changed }
        }
        toml::Value::String(text) => {
            let line = ui.horizontal(|ui| {
                ui.label(key).on_hover_text(described(entry));
                ui.add(egui::TextEdit::singleline(text).desired_width(140.0))
            });
            let ended = line.inner.lost_focus();
            Touched { changed: ended, ended }
        }
        toml::Value::Array(list) => {
            let mut touched = Touched::default();
            ui.horizontal(|ui| {
                ui.label(key).on_hover_text(described(entry));
                for number in list.iter_mut() {
                    if let toml::Value::Float(number) = number {
                        let speed = (0.01 * number.abs()).max(0.01);
                        touched = touched.or(Touched::by(&ui.add(egui::DragValue::new(number).speed(speed))));
                        *number = allowed(entry, *number);
                    }
                }
                ui.weak(unit(entry).unwrap_or_default());
            });
            touched
        }
        toml::Value::Table(_) | toml::Value::Datetime(_) => Touched::default(),
    }
}

/// A slider from a hundredth to a hundred times the default, within what is allowed. Numbers beyond
/// it can be typed. A double click puts the default back.
fn slider(
    ui: &mut egui::Ui,
    entry: &Entry,
    key: &str,
    number: &mut f64,
    default: Option<f64>,
    is_whole: bool,
) -> Touched {
    let range = bounds(entry, default, is_whole);
    let (low, high) = (*range.start(), *range.end());
    let is_wide = low >= 0.0 && high > WIDE * low.max(if low == 0.0 { high / REACH } else { low });
    let mut slider = egui::Slider::new(number, range)
        .logarithmic(is_wide)
        .smallest_positive(smallest(default, high))
        .clamping(egui::SliderClamping::Never)
        .max_decimals(9)
        .text(key);
    if is_whole {
        slider = slider.integer();
    }
    if let Some(unit) = unit(entry).filter(|unit| unit.len() <= 6) {
        slider = slider.suffix(format!(" {unit}"));
    }
    let response = ui.add(slider).on_hover_text(described(entry));
    let mut touched = Touched::by(&response);
    if response.double_clicked()
        && let Some(default) = default
        && *number != default
    {
        *number = default;
        touched = Touched { changed: true, ended: true };
    }
    touched
}

fn smallest(default: Option<f64>, high: f64) -> f64 {
    default.filter(|default| *default > 0.0).map_or(high * 1e-6, |default| default / REACH)
}

/// The ends of a slider.
fn bounds(entry: &Entry, default: Option<f64>, is_whole: bool) -> RangeInclusive<f64> {
    let (mut low, mut high) = entry.range.map_or((0.0, 1.0), |range| (range.low, range.high));
    if entry.range.is_some_and(|range| range.or_zero) {
        low = low.min(0.0);
    }
    if let Some(default) = default.map(f64::abs).filter(|default| *default > 0.0) {
        let reach = if is_whole { 0.1 * REACH } else { REACH };
        high = high.min(default * reach).max(default);
        low = low.max(-default * reach);
    } else {
        (low, high) = (low.max(-REACH), high.min(REACH));
    }
    low..=high
}

/// The number nearest to `number` that is allowed.
fn allowed(entry: &Entry, number: f64) -> f64 {
    let Some(range) = entry.range else { return number };
    if range.contains(number) { number } else { number.clamp(range.low, range.high) }
}

fn default_of(entry: &Entry) -> Option<toml::Value> {
    let line = format!("value = {}", entry.default);
    line.parse::<toml::Table>().ok()?.remove("value")
}

/// The words in quotes in what a key means: those that its text may be.
fn quoted(entry: &Entry) -> Vec<&str> {
    entry.meaning.split('"').skip(1).step_by(2).collect()
}

/// A unit in letters that the window's font has.
fn unit(entry: &Entry) -> Option<String> {
    let own = entry.unit.as_deref()?;
    let known = [("s⁻²", "1/s²"), ("s⁻¹", "1/s"), ("m⁻¹", "1/m")];
    let plain = known.iter().find(|(exponent, _)| *exponent == own).map(|(_, plain)| (*plain).to_owned());
    Some(plain.unwrap_or_else(|| own.replace('⁻', "^-")))
}

/// What is known of a key.
fn described(entry: &Entry) -> String {
    let range = entry.range.map_or_else(String::new, |range| format!("\nRange {range}"));
    let unit = unit(entry).map_or_else(String::new, |unit| format!("\nUnit {unit}"));
    format!("{}\n{}{unit}\nDefault {}{range}", entry.key, entry.meaning, entry.default)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_documented_default_lies_on_its_slider() {
        let mut found = 0;
        for entry in reference::keys() {
            let default = match default_of(entry) {
                Some(toml::Value::Float(number)) => number,
                Some(toml::Value::Integer(number)) => number as f64,
                _ => continue,
            };
            let range = bounds(entry, Some(default), false);
            assert!(range.contains(&default), "{}: {default} is not in {range:?}", entry.key);
            assert!(range.start() < range.end(), "{}: {range:?}", entry.key);
            assert_eq!(allowed(entry, default), default, "{}", entry.key);
            found += 1;
        }
        assert!(found > 100, "{found} sliders");
    }
}
