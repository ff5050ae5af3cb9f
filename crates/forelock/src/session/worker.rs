//! The thread of a session: carries out orders, steps when a frame is due, publishes frames.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use super::{Phase, Shared};
use crate::backend::Backend;
use crate::player::{Player, PlayerError};
use crate::progress::Progress;
use crate::scene::Scene;

/// How far a frame may be late before the clock starts anew from it.
const LATE: Duration = Duration::from_millis(100);
/// Time over which the speed is measured.
const MEASURED: Duration = Duration::from_secs(1);

type Task = Box<dyn FnOnce(&mut Player) -> Result<(), PlayerError> + Send>;

/// What the owner of a session asks for.
pub(super) enum Order {
    Play(bool),
    Step,
    Seek(u32),
    Speed(f64),
    Loop(Option<u32>),
    Change(&'static str, Task),
    Tell(Sender<()>),
    End,
}

/// The state of the thread.
pub(super) struct Worker<'a> {
    player: Player,
    shared: &'a Shared,
    playing: bool,
    speed: f64,
    frames: Option<u32>,
    /// When the next frame is due.
    due: Instant,
    /// When the last steps ended, and their times in the scene, seconds.
    ends: VecDeque<(Instant, f64)>,
}

impl<'a> Worker<'a> {
    /// Loads `scene` and obeys until the end.
    pub fn run(scene: Scene, backend: Backend, orders: &Receiver<Order>, shared: &'a Shared) {
        let load = || {
            Player::builder(scene).backend(backend).build_observed(&mut |progress| match progress {
                Progress::Begin { what, .. } => {
                    shared.status().busy = Some((*what).to_owned());
                    (shared.wake)();
                }
                Progress::End => shared.status().busy = None,
                _ => {}
            })
        };
        let player = guarded(load).and_then(|built| built.map_err(|error| error.to_string()));
        match player {
            Ok(player) => {
                let mut worker = Worker {
                    player,
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
            Order::Seek(frame) => {
                let frame = frame.min(self.player.reached());
                self.change("going to another frame", Box::new(move |player| player.seek(frame)));
            }
            Order::Change(what, task) => self.change(what, task),
            // Its owner may not wait any more.
            Order::Tell(done) => drop(done.send(())),
            Order::End => {}
        }
    }

    fn change(&mut self, what: &'static str, task: Task) {
        self.shared.status().busy = Some(what.to_owned());
        let player = &mut self.player;
        let done = guarded(AssertUnwindSafe(|| task(player)));
        self.shared.status().busy = None;
        match done {
            Ok(Ok(())) => {}
            Ok(Err(error)) => self.fail(&error.to_string()),
            Err(panic) => self.fail(&panic),
        }
        // What plays has another frame soon.
        if self.playing { self.tell() } else { self.publish() }
    }

    /// The next frame of what plays.
    fn play_on(&mut self) {
        let before = self.player.time_secs();
        if self.frames.is_some_and(|frames| self.player.frame() >= frames) {
            self.change("starting again", Box::new(|player| player.seek(0)));
            self.ends.clear();
        } else {
            self.step();
        }
        let lasts = (self.player.time_secs() - before).max(1e-3) / self.speed;
        self.due += Duration::from_secs_f64(lasts.min(10.0));
        let now = Instant::now();
        if now > self.due + LATE {
            self.due = now;
        }
    }

    fn step(&mut self) {
        let started = Instant::now();
        let player = &mut self.player;
        match guarded(AssertUnwindSafe(|| player.step())) {
            Ok(Ok(report)) => self.shared.status().report = report.solver,
            Ok(Err(error)) => return self.fail(&error.to_string()),
            Err(panic) => return self.fail(&panic),
        }
        self.publish();
        let now = Instant::now();
        self.ends.push_back((now, self.player.time_secs()));
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
        match self.player.moment() {
            Ok(moment) => *self.shared.moment() = Some(Arc::new(moment)),
            Err(error) => self.fail(&error.to_string()),
        }
        self.tell();
    }

    fn tell(&mut self) {
        let player = &self.player;
        let parameters = player.parameters();
        let mut status = self.shared.status();
        if status.parameters.as_deref() != Some(&parameters) {
            status.parameters = Some(Arc::new(parameters));
        }
        let [undo, redo] = player.undoable();
        (status.undo, status.redo) = (undo, redo);
        status.reached = player.reached();
        status.real_time = match (self.ends.front(), self.ends.back()) {
            (Some((a, from)), Some((b, to))) if b > a => (to - from) / (*b - *a).as_secs_f64(),
            _ => 0.0,
        };
        status.notes = player.notes();
        status.bytes = [player.simulation_bytes(), player.history_bytes() as u64];
        status.device = player.gpu_name().map_or_else(|| player.simd_name(), str::to_owned);
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
