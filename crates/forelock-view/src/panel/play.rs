//! The bar below the picture: play, step, go back, speed.

use eframe::egui;
use forelock::session::{Session, Status};

/// What the bar remembers.
#[derive(Clone, Debug)]
pub struct PlayBar {
    /// Whether to start again after the scene's frames.
    pub looped: bool,
    speed: f64,
    /// Frames of the scene.
    pub frames: u32,
    /// The frame that the slider was dragged to and that is not shown yet.
    sought: Option<u32>,
}

impl PlayBar {
    /// The bar of a scene of `frames` frames.
    pub fn new(frames: u32) -> Self {
        Self { looped: false, speed: 1.0, frames, sought: None }
    }

    /// Draws the bar and passes orders on. `frame` and `secs` are those of the frame shown.
    pub fn show(&mut self, ui: &mut egui::Ui, session: &Session, status: &Status, frame: u32, secs: f64) {
        ui.horizontal(|ui| {
            if ui.button("⏮").on_hover_text("Back to the start (Home)").clicked() {
                session.seek(0);
            }
            let (text, hint) =
                if status.playing { ("Pause", "Pause (space)") } else { ("Play", "Play (space)") };
            if ui.button(text).on_hover_text(hint).clicked() {
                session.play(!status.playing);
            }
            if ui.button("Step").on_hover_text("One frame (→)").clicked() {
                session.step();
            }
            let looped = ui.checkbox(&mut self.looped, "Loop");
            if looped.on_hover_text("Start again after the frames of the scene").changed() {
                session.set_loop(self.looped.then_some(self.frames));
            }
            let speed = egui::DragValue::new(&mut self.speed).range(0.05..=4.0).speed(0.01).suffix("×");
            if ui.add(speed).on_hover_text("Speed of time in the scene").changed() {
                session.set_speed(self.speed);
            }
            ui.separator();
            ui.monospace(format!("{secs:7.2} s"));
            let mut shown = self.sought.unwrap_or(frame);
            let last = status.reached.max(1);
            ui.spacing_mut().slider_width = (ui.available_width() - 110.0).max(60.0);
            let slider = ui.add(egui::Slider::new(&mut shown, 0..=last).text("frame"));
            if slider.on_hover_text("Frames so far: drag to go back").changed() {
                session.play(false);
                session.seek(shown);
                self.sought = Some(shown);
            }
            if self.sought == Some(frame) || status.playing {
                self.sought = None;
            }
        });
    }
}
