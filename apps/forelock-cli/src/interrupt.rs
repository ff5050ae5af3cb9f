//! Ctrl-C: the first requests a clean end, the second ends the program immediately.

use std::sync::atomic::{AtomicBool, Ordering};

/// The exit status after an interruption with all output complete: 128 + SIGINT, as shells expect.
pub const STATUS: u8 = 130;

static ASKED: AtomicBool = AtomicBool::new(false);

/// Installs the handler. The first Ctrl-C (or termination request) sets the returned flag.
pub fn listen() -> anyhow::Result<&'static AtomicBool> {
    ctrlc::set_handler(|| {
        if ASKED.swap(true, Ordering::SeqCst) {
            std::process::exit(i32::from(STATUS));
        }
    })?;
    Ok(&ASKED)
}
