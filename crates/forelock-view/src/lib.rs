//! The window: watch hair move, push it, change its parameters, groom it.
//!
//! # Practice
//! [`run`] opens the window and returns when it is closed. The simulation is a
//! [`Session`](forelock::session::Session) on a thread of its own, pictures are drawn on another
//! one; the window waits for neither. All widgets of parameters are made from the documentation of
//! the parameters.
//!
//! # Limitations
//! Files are opened by path, from a list of the folder, or by drop; there is no file dialog of the
//! system. Contacts and the grid are shown of simulations on the CPU only.

mod app;
mod artist;
mod ghost;
mod lattice;
mod lines;
mod measure;
mod orbit;
pub mod panel;
mod tools;
mod viewport;

use std::path::PathBuf;

use eframe::egui;
use forelock::Backend;

pub use app::App;
pub use panel::files::{Opened, read};
pub use tools::{Brush, Tool};

/// What to open, and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// The scene, or the cache of one.
    pub opened: Opened,
    /// Where it simulates.
    pub backend: Backend,
    /// What draws the hair; [`Backend::Auto`]: a graphics card if there is one.
    pub draw: Backend,
    /// Whether it plays at once.
    pub plays: bool,
    /// Play, write a picture of the window to this file after some seconds, and close it.
    pub screenshot: Option<(PathBuf, f64)>,
}

/// Why there is no window.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// There is no display or no GPU driver.
    #[error(
        "the window cannot open: {0}; it needs a display and a graphics driver (a software Vulkan will do). \
         `forelock render` draws pictures without either"
    )]
    Window(String),
    /// The picture of the window cannot be written.
    #[error("{0}")]
    Screenshot(String),
}

/// Opens the window. Returns when it is closed.
///
/// # Errors
/// [`ViewError`] if it cannot be opened.
pub fn run(options: Options) -> Result<(), ViewError> {
    let viewport = egui::ViewportBuilder::default()
        .with_title("Forelock")
        .with_inner_size([1280.0, 800.0])
        .with_min_inner_size([480.0, 320.0])
        .with_drag_and_drop(true);
    let native = eframe::NativeOptions { viewport, run_and_return: true, ..Default::default() };
    let failure = std::sync::Arc::new(std::sync::Mutex::new(None));
    let told = failure.clone();
    let create = move |cc: &eframe::CreationContext<'_>| {
        let mut app = App::new(cc, options.opened, options.backend, options.draw);
        if options.plays {
            app.session().play(true);
        }
        app.take_screenshot(options.screenshot, told);
        Ok(Box::new(app) as Box<dyn eframe::App>)
    };
    eframe::run_native("forelock", native, Box::new(create)).map_err(|error| {
        ViewError::Window(match error {
            // Its own text begins with a place in the sources.
            eframe::Error::WinitEventLoop(_) => "no display can be reached".to_owned(),
            other => other.to_string(),
        })
    })?;
    let message = failure.lock().unwrap_or_else(std::sync::PoisonError::into_inner).take();
    message.map_or(Ok(()), |message| Err(ViewError::Screenshot(message)))
}
