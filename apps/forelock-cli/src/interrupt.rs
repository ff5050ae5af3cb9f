//! Ctrl-C and termination requests: the program ends within two seconds, whatever it does, and
//! leaves no half-written file.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::terminal;

/// The exit status after an interruption: 128 + SIGINT, as shells expect.
pub const STATUS: u8 = 130;

/// How long work may take to end by itself.
const GRACE: Duration = Duration::from_millis(1500);

static ASKED: AtomicBool = AtomicBool::new(false);
static WATCHED: AtomicBool = AtomicBool::new(false);
/// Whether a run has begun.
static RESUMABLE: AtomicBool = AtomicBool::new(false);

/// Installs the handler. An interruption ends the program at once, or, while the work at hand
/// watches for it, after a grace period. A second one ends the program at once.
pub fn listen() -> anyhow::Result<()> {
    ctrlc::set_handler(|| {
        if ASKED.swap(true, Ordering::SeqCst) || !WATCHED.load(Ordering::SeqCst) {
            leave();
        }
        std::thread::spawn(|| {
            std::thread::sleep(GRACE);
            leave();
        });
    })?;
    Ok(())
}

/// Set by the first interruption.
pub fn asked() -> &'static AtomicBool {
    &ASKED
}

/// States whether the work at hand ends by itself soon after [`asked`] has been set.
pub fn set_watched(watched: bool) {
    RESUMABLE.fetch_or(watched, Ordering::SeqCst);
    WATCHED.store(watched, Ordering::SeqCst);
}

fn leave() -> ! {
    forelock_io::remove_temporaries();
    let hint = if RESUMABLE.load(Ordering::SeqCst) {
        ": --resume goes on from the last checkpoint, if there is one"
    } else {
        ""
    };
    terminal::note(format!("interrupted{hint}"));
    std::process::exit(STATUS.into());
}
