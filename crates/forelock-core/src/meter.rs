//! The progress of long work, for another thread to watch.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Counts the steps of a piece of work after the other. The work may run on many threads.
#[derive(Debug, Default)]
pub struct Meter {
    what: Mutex<&'static str>,
    done: AtomicU64,
    total: AtomicU64,
}

impl Meter {
    /// A piece of work of `total` steps begins.
    pub fn begin(&self, what: &'static str, total: u64) {
        let mut name = self.what.lock().unwrap_or_else(PoisonError::into_inner);
        *name = what;
        self.total.store(total, Ordering::Relaxed);
        self.done.store(0, Ordering::Relaxed);
    }

    /// `steps` more are done.
    pub fn add(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }

    /// The present piece of work, empty before the first, and how much of it is done, in percent.
    pub fn read(&self) -> (&'static str, u64) {
        let name = self.what.lock().unwrap_or_else(PoisonError::into_inner);
        let (done, total) = (self.done.load(Ordering::Relaxed), self.total.load(Ordering::Relaxed));
        (*name, (100 * done / total.max(1)).min(100))
    }
}
