//! How long work reports its progress.

use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use forelock_core::meter::Meter;

/// What long work reports while it runs.
#[derive(Clone, Copy, Debug)]
pub enum Progress<'a> {
    /// Something the user should know, one sentence.
    Note(&'a str),
    /// A piece of work begins, of which `done` of `total` steps are done already.
    Begin {
        /// Name of the work, a word or two.
        what: &'static str,
        /// Steps done before.
        done: u64,
        /// Steps in all.
        total: u64,
    },
    /// One more step is done.
    Step,
    /// The piece of work is done.
    End,
}

/// Receives the progress of long work.
pub type Observer<'a> = dyn FnMut(&Progress<'_>) + 'a;

/// Time between two looks at a [`Meter`]; work that takes less is not reported.
const LOOK: Duration = Duration::from_millis(250);

/// Does `work` on another thread, and so in rayon's global pool, and reports to `observer` what its
/// meter counts, in percent.
pub(crate) fn watch<T: Send>(observer: &mut Observer<'_>, work: impl FnOnce(&Meter) -> T + Send) -> T {
    let meter = Meter::default();
    std::thread::scope(|scope| {
        let (sender, ended) = mpsc::channel::<()>();
        let worker = scope.spawn(|| {
            let _sender = sender;
            work(&meter)
        });
        let (mut shown, mut percent) = ("", 0);
        while ended.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
            let (what, now) = meter.read();
            if what != shown || now < percent {
                if !shown.is_empty() {
                    observer(&Progress::End);
                }
                (shown, percent) = (what, 0);
                observer(&Progress::Begin { what, done: 0, total: 100 });
            }
            (percent..now).for_each(|_| observer(&Progress::Step));
            percent = now;
        }
        if !shown.is_empty() {
            (percent..100).for_each(|_| observer(&Progress::Step));
            observer(&Progress::End);
        }
        worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}
