//! The thread of a session: carries out orders, steps when a frame is due, publishes frames.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use forelock_core::frame::FrameReport;

use super::{Phase, Shared, Status};
use crate::player::{Asked, Moment, Player, PlayerError};

/// How far a frame may be late before the clock starts anew from it.
const LATE: Duration = Duration::from_millis(100);
/// Time over which the speed is measured.
const MEASURED: Duration = Duration::from_secs(1);

pub(super) type Task = Box<dyn FnOnce(&mut Player) -> Result<(), PlayerError> + Send>;

/// What the owner of a session asks for.
pub(super) enum Order {
    Play(bool),
    Step,
    Seek(u32),
    Speed(f64),
    Loop(Option<u32>),
    /// Something new is asked for ([`Status::asked`]).
    Ask,
    Change(&'static str, Task),
    Tell(Sender<()>),
    End,
}

/// What a session plays.
pub(super) trait Source {
    /// The number of the present frame.
    fn frame(&self) -> u32;
    /// Its time, seconds.
    fn time_secs(&self) -> f64;
    /// The last frame that can be gone to.
    fn reached(&self) -> u32;
    /// Whether no frame follows.
    fn is_at_end(&self) -> bool;
    /// Goes to the next frame; not called at the end.
    fn step(&mut self) -> Result<FrameReport, String>;
    /// Goes to a frame up to [`reached`](Self::reached).
    fn seek(&mut self, frame: u32) -> Result<(), String>;
    /// Lets `task` change it.
    fn change(&mut self, task: Task) -> Result<(), String>;
    /// The present frame, with what is `asked` for.
    fn moment(&mut self, asked: Asked) -> Result<Moment, String>;
    /// Tells what is known.
    fn tell(&self, status: &mut Status);
}

impl Source for Player {
    fn frame(&self) -> u32 {
        self.frame()
    }

    fn time_secs(&self) -> f64 {
        self.time_secs()
    }

    fn reached(&self) -> u32 {
        self.reached()
    }

    fn is_at_end(&self) -> bool {
        false
    }

    fn step(&mut self) -> Result<FrameReport, String> {
        self.step().map(|report| report.solver).map_err(|error| error.to_string())
    }

    fn seek(&mut self, frame: u32) -> Result<(), String> {
        self.seek(frame).map(drop).map_err(|error| error.to_string())
    }

    fn change(&mut self, task: Task) -> Result<(), String> {
        task(self).map_err(|error| error.to_string())
    }

    fn moment(&mut self, asked: Asked) -> Result<Moment, String> {
        self.moment_with(asked).map_err(|error| error.to_string())
    }

    fn tell(&self, status: &mut Status) {
        let parameters = self.parameters();
        if status.parameters.as_deref() != Some(&parameters) {
            status.parameters = Some(Arc::new(parameters));
        }
        [status.undo, status.redo] = self.undoable();
        (status.untold, status.has_guides) = (self.untold(), self.guides() > 0);
        status.notes = self.notes();
        status.bytes = [self.simulation_bytes(), self.history_bytes() as u64];
        status.device = self.gpu_name().map_or_else(|| self.simd_name(), str::to_owned);
    }
}

/// The state of the thread.
pub(super) struct Worker<'a, S> {
    source: S,
    shared: &'a Shared,
    playing: bool,
    speed: f64,
    frames: Option<u32>,
    /// When the next frame is due.
    due: Instant,
    /// When the last steps ended, and their times in the scene, seconds.
    ends: VecDeque<(Instant, f64)>,
}

impl<'a, S: Source> Worker<'a, S> {
    /// Obeys with what `load` returns until the end.
    pub fn run(load: impl FnOnce() -> Result<S, String>, orders: &Receiver<Order>, shared: &'a Shared) {
        match guarded(load).flatten() {
            Ok(source) => {
                let mut worker = Worker {
                    source,
                    shared,
                    playing: false,
                    speed: 1.0,
                    frames: None,
                    due: Instant::now(),
                    ends: VecDeque::new(),
                };
                shared.status().phase = Phase::Ready;
                worker.publish();
                worker.obey(orders);
            }
            Err(message) => {
                let mut status = shared.status();
                (status.phase, status.busy, status.error) = (Phase::Failed, None, Some(message));
                drop(status);
                (shared.wake)();
                refuse(orders);
            }
        }
    }

    fn obey(&mut self, orders: &Receiver<Order>) {
        loop {
            let order = if self.playing {
                orders.recv_timeout(self.due.saturating_duration_since(Instant::now()))
            } else {
                orders.recv().map_err(|_| RecvTimeoutError::Disconnected)
            };
            match order {
                Ok(Order::End) | Err(RecvTimeoutError::Disconnected) => return,
                _ if self.shared.cancelled.load(Ordering::Relaxed) => return,
                Ok(order) => self.carry_out(order),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if self.playing && Instant::now() >= self.due {
                self.play_on();
            }
        }
    }

    fn carry_out(&mut self, order: Order) {
        match order {
            Order::Play(on) => {
                if on && self.source.is_at_end() {
                    self.attempt("starting again", |source| source.seek(0));
                }
                (self.playing, self.due) = (on, Instant::now());
                self.ends.clear();
                self.tell();
            }
            Order::Step => {
                self.playing = false;
                self.ends.clear();
                self.step();
            }
            Order::Speed(speed) => (self.speed, self.due) = (speed, Instant::now()),
            Order::Loop(frames) => self.frames = frames,
            // What plays has another frame soon.
            Order::Ask if self.playing => {}
            Order::Ask => self.publish(),
            Order::Seek(frame) => {
                let frame = frame.min(self.source.reached());
                self.attempt("going to another frame", |source| source.seek(frame));
            }
            Order::Change(what, task) => self.attempt(what, |source| source.change(task)),
            // Its owner may not wait any more.
            Order::Tell(done) => drop(done.send(())),
            Order::End => {}
        }
    }

    fn attempt(&mut self, what: &'static str, task: impl FnOnce(&mut S) -> Result<(), String>) {
        self.shared.status().busy = Some(what.to_owned());
        let source = &mut self.source;
        let done = guarded(AssertUnwindSafe(|| task(source))).flatten();
        self.shared.status().busy = None;
        if let Err(message) = done {
            self.fail(&message);
        }
        // What plays has another frame soon.
        if self.playing { self.tell() } else { self.publish() }
    }

    /// The next frame of what plays.
    fn play_on(&mut self) {
        let before = self.source.time_secs();
        let is_at_end = self.source.is_at_end();
        if self.frames.is_some_and(|frames| is_at_end || self.source.frame() >= frames) {
            self.attempt("starting again", |source| source.seek(0));
            self.ends.clear();
        } else if is_at_end {
            self.playing = false;
            self.shared.status().playing = false;
            return self.tell();
        } else {
            self.step();
        }
        let lasts = (self.source.time_secs() - before).max(1e-3) / self.speed;
        self.due += Duration::from_secs_f64(lasts.min(10.0));
        let now = Instant::now();
        if now > self.due + LATE {
            self.due = now;
        }
    }

    fn step(&mut self) {
        let started = Instant::now();
        if self.source.is_at_end() {
            return self.tell();
        }
        let source = &mut self.source;
        match guarded(AssertUnwindSafe(|| source.step())).flatten() {
            Ok(report) => self.shared.status().report = report,
            Err(message) => return self.fail(&message),
        }
        self.publish();
        let now = Instant::now();
        self.ends.push_back((now, self.source.time_secs()));
        while self.ends.len() > 2 && self.ends.front().is_some_and(|(end, _)| now - *end > MEASURED) {
            self.ends.pop_front();
        }
        self.shared.status().step_ms = (now - started).as_secs_f64() * 1e3;
    }

    /// Tells what went wrong, and stops.
    fn fail(&mut self, message: &str) {
        self.playing = false;
        let mut status = self.shared.status();
        (status.playing, status.error) = (false, Some(message.to_owned()));
        drop(status);
        self.tell();
    }

    /// Makes the present frame the newest.
    fn publish(&mut self) {
        let asked = self.shared.status().asked;
        match self.source.moment(asked) {
            Ok(moment) => *self.shared.moment() = Some(Arc::new(moment)),
            Err(message) => self.fail(&message),
        }
        self.tell();
    }

    fn tell(&mut self) {
        let mut status = self.shared.status();
        self.source.tell(&mut status);
        status.reached = self.source.reached();
        status.real_time = match (self.ends.front(), self.ends.back()) {
            (Some((a, from)), Some((b, to))) if b > a => (to - from) / (*b - *a).as_secs_f64(),
            _ => 0.0,
        };
        drop(status);
        (self.shared.wake)();
    }
}

/// The result of `task`; the message of a panic as an error.
fn guarded<T>(task: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(task)).map_err(|panic| {
        let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        format!("an error of the program: {text}; please report it")
    })
}

/// Refuses all orders until the end.
fn refuse(orders: &Receiver<Order>) {
    while let Ok(order) = orders.recv() {
        if matches!(order, Order::End) {
            return;
        }
    }
}
