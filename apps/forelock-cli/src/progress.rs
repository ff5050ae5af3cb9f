//! Progress on standard error: a bar with rate and remaining time on a terminal, occasional plain
//! lines elsewhere.

use std::fmt;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use forelock::Progress;
use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use crate::terminal;

/// The minimum time between two plain lines.
const PLAIN_INTERVAL: Duration = Duration::from_secs(5);

/// Shows the progress of a long operation.
pub struct Reporter {
    bar: Option<ProgressBar>,
    what: &'static str,
    total: u64,
    done: u64,
    started: Instant,
    last_line: Instant,
    on_terminal: bool,
    quiet: bool,
}

impl Reporter {
    /// A reporter. With `quiet` it shows only notes.
    pub fn new(quiet: bool) -> Self {
        let now = Instant::now();
        Self {
            bar: None,
            what: "",
            total: 0,
            done: 0,
            started: now,
            last_line: now,
            on_terminal: std::io::stderr().is_terminal(),
            quiet,
        }
    }

    /// Shows one report.
    pub fn report(&mut self, progress: &Progress<'_>) {
        match *progress {
            Progress::Note(text) => match &self.bar {
                Some(bar) => bar.suspend(|| terminal::note(text)),
                None => terminal::note(text),
            },
            Progress::Begin { what, done, total } => self.begin(what, done, total),
            Progress::Step => self.step(),
            Progress::End => self.end(),
        }
    }

    fn begin(&mut self, what: &'static str, done: u64, total: u64) {
        (self.what, self.done, self.total) = (what, done, total);
        self.started = Instant::now();
        self.last_line = self.started;
        if self.quiet {
            return;
        }
        if self.on_terminal {
            let bar = ProgressBar::new(total).with_position(done).with_message(what);
            let rate = |state: &ProgressState, out: &mut dyn fmt::Write| {
                let _ = write!(out, "{:.1}/s", state.per_sec());
            };
            if let Ok(style) =
                ProgressStyle::with_template("{msg:>12} {bar:32} {pos}/{len}  {rate}  {eta} left")
            {
                bar.set_style(style.with_key("rate", rate));
            }
            bar.reset_eta();
            self.bar = Some(bar);
        } else {
            terminal::note(format!("{what} …"));
        }
    }

    fn step(&mut self) {
        self.done += 1;
        if let Some(bar) = &self.bar {
            bar.inc(1);
        } else if !self.quiet && self.last_line.elapsed() >= PLAIN_INTERVAL {
            self.last_line = Instant::now();
            terminal::note(format!("{} {}/{}", self.what, self.done, self.total));
        }
    }

    fn end(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
        if !self.quiet {
            let secs = self.started.elapsed().as_secs_f64();
            terminal::note(format!("{} done: {} in {secs:.1} s", self.what, self.done));
        }
    }
}
