//! A player on a thread of its own, for programs that must not wait for it: windows and engines.
//!
//! # Practice
//! A [`Session`] loads a scene and plays it in real time. Its owner gives orders, which return at
//! once, and asks for the newest finished frame, a [`Moment`] behind an [`Arc`]. All that a
//! [`Player`] can do is an order too: [`Session::change`] takes a closure. Orders are carried out
//! one after the other, before the next frame. An order that fails changes nothing; its message is
//! in [`Status::error`] until [`Session::clear_error`].
//!
//! [`Session::play_back`] plays a cache in the same way; it refuses changes.
//!
//! If a frame takes longer than it lasts, time passes more slowly in the scene: no frame is left
//! out, and [`Status::real_time`] tells by how much.
//!
//! ```
//! use forelock::scene::Override;
//! use forelock::session::Session;
//! use forelock::{Backend, Scene};
//! use glam::DVec3;
//!
//! let small = ["groom.strands=20", "body.sdf_cells=32"];
//! let sets: Result<Vec<_>, _> = small.iter().map(|set| Override::set(set)).collect();
//! let session = Session::start(Scene::builtin(&sets?)?, Backend::Cpu, || {});
//! session.change("gravity", |player| player.set_gravity(DVec3::NEG_Y));
//! session.step();
//! session.wait();
//! let moment = session.moment().ok_or("there is no frame")?;
//! assert_eq!((moment.frame, moment.groom().strand_count()), (1, 20));
//! assert_eq!(session.status().undo, Some("gravity"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Limitations
//! A running step is not interrupted: an order waits for it, and so does the end of a session.

mod recording;
mod worker;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use forelock_core::frame::FrameReport;

use crate::backend::Backend;
use crate::player::{Asked, Moment, Parameters, Player, PlayerError, Untold};
use crate::progress::Progress;
use crate::scene::Scene;
use recording::Recording;
use worker::{Order, Source, Worker};

/// Where a session is in its life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// The scene is being loaded.
    #[default]
    Loading,
    /// There is a player.
    Ready,
    /// The scene cannot be played; [`Status::error`] says why.
    Failed,
}

/// What is known of a session besides its newest frame.
#[derive(Clone, Debug, Default)]
pub struct Status {
    /// Whether there is a player.
    pub phase: Phase,
    /// What is being done that takes longer than a frame: loading, an edit, undoing.
    pub busy: Option<String>,
    /// Whether frames follow each other.
    pub playing: bool,
    /// Seconds in the scene for each second that passes, as it was ordered.
    pub speed: f64,
    /// The same as it was in the last second; 0 while nothing plays.
    pub real_time: f64,
    /// The last frame that has been simulated with all changes as they are.
    pub reached: u32,
    /// The message of the last order that failed.
    pub error: Option<String>,
    /// What the user should know of import, edits and jumps, one sentence each.
    pub notes: Vec<String>,
    /// The change that undoing would take back, and that redoing would make again.
    pub undo: Option<&'static str>,
    /// See `undo`.
    pub redo: Option<&'static str>,
    /// What the last step reported.
    pub report: FrameReport,
    /// Milliseconds of the last step, copying its frame included.
    pub step_ms: f64,
    /// Bytes of the simulation, and of the states for going back.
    pub bytes: [u64; 2],
    /// The processor that simulates.
    pub device: String,
    /// What can be changed, as it is now; none while a cache is played back.
    pub parameters: Option<Arc<Parameters>>,
    /// What moments tell besides positions, as it was ordered.
    pub asked: Asked,
    /// What they cannot tell.
    pub untold: Untold,
    /// Whether some strands are not simulated: guides carry them.
    pub has_guides: bool,
}

/// What thread and owner share.
struct Shared {
    moment: Mutex<Option<Arc<Moment>>>,
    status: Mutex<Status>,
    cancelled: AtomicBool,
    wake: Box<dyn Fn() + Send + Sync>,
}

impl Shared {
    fn status(&self) -> MutexGuard<'_, Status> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn moment(&self) -> MutexGuard<'_, Option<Arc<Moment>>> {
        self.moment.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A player on a thread of its own; see the [module](self). Dropping it ends the thread.
pub struct Session {
    orders: Sender<Order>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Session {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session").field("status", &*self.shared.status()).finish_non_exhaustive()
    }
}

impl Session {
    /// Loads `scene` on a new thread, to be simulated on `backend`. It waits before the first frame
    /// then. `wake` is called on that thread whenever there is something new to see.
    pub fn start(scene: Scene, backend: Backend, wake: impl Fn() + Send + Sync + 'static) -> Self {
        Self::on_thread(wake, move |shared| {
            let built =
                Player::builder(scene).backend(backend).build_observed(&mut |progress| match progress {
                    Progress::Begin { what, .. } => {
                        shared.status().busy = Some((*what).to_owned());
                        (shared.wake)();
                    }
                    Progress::End => shared.status().busy = None,
                    _ => {}
                });
            built.map_err(|error| error.to_string())
        })
    }

    /// Opens the cache at `path`, of a run of `scene`, on a new thread, and plays it back; see
    /// [`Session::start`]. It has the frames of the cache only. Changes are refused with a message.
    pub fn play_back(path: PathBuf, scene: Scene, wake: impl Fn() + Send + Sync + 'static) -> Self {
        Self::on_thread(wake, move |_| Recording::open(path, scene))
    }

    fn on_thread<S: Source>(
        wake: impl Fn() + Send + Sync + 'static,
        load: impl FnOnce(&Shared) -> Result<S, String> + Send + 'static,
    ) -> Self {
        let status = Status { speed: 1.0, ..Status::default() };
        let shared = Arc::new(Shared {
            moment: Mutex::default(),
            status: Mutex::new(status),
            cancelled: AtomicBool::new(false),
            wake: Box::new(wake),
        });
        let (orders, received) = channel();
        let of_worker = shared.clone();
        let run = move || Worker::run(|| load(&of_worker), &received, &of_worker);
        let thread = std::thread::Builder::new().name("session".to_owned()).spawn(run);
        if let Err(error) = &thread {
            let mut status = shared.status();
            (status.phase, status.error) =
                (Phase::Failed, Some(format!("the simulation's thread cannot start: {error}")));
        }
        Self { orders, shared, thread: thread.ok() }
    }

    /// The newest finished frame; none before the scene is loaded.
    pub fn moment(&self) -> Option<Arc<Moment>> {
        self.shared.moment().clone()
    }

    /// What else is known.
    pub fn status(&self) -> Status {
        self.shared.status().clone()
    }

    /// Forgets the message of the last order that failed.
    pub fn clear_error(&self) {
        self.shared.status().error = None;
    }

    /// Lets frames follow each other, or stops them.
    pub fn play(&self, on: bool) {
        self.shared.status().playing = on;
        self.order(Order::Play(on));
    }

    /// Simulates one frame, and stops.
    pub fn step(&self) {
        self.shared.status().playing = false;
        self.order(Order::Step);
    }

    /// Goes to `frame`, or to the last frame that has been simulated if it is later.
    pub fn seek(&self, frame: u32) {
        self.order(Order::Seek(frame));
    }

    /// Sets the seconds in the scene for each second that passes, from 0.01 to 100.
    pub fn set_speed(&self, speed: f64) {
        let speed = if speed.is_finite() { speed.clamp(0.01, 100.0) } else { 1.0 };
        self.shared.status().speed = speed;
        self.order(Order::Speed(speed));
    }

    /// Starts again at the first frame after `frames`; none goes on without end.
    pub fn set_loop(&self, frames: Option<u32>) {
        self.order(Order::Loop(frames));
    }

    /// Asks for what moments tell besides positions, from the present one on. It takes time in each
    /// frame, and nothing while nothing is asked for.
    pub fn ask(&self, asked: Asked) {
        let before = std::mem::replace(&mut self.shared.status().asked, asked);
        if !asked.is_in(before) {
            self.order(Order::Ask);
        }
    }

    /// Does `task` before the next frame. `what` names it in messages: "the edit", "the wind".
    pub fn change(
        &self,
        what: &'static str,
        task: impl FnOnce(&mut Player) -> Result<(), PlayerError> + Send + 'static,
    ) {
        self.order(Order::Change(what, Box::new(task)));
    }

    /// Takes the last edit or change of parameters back.
    pub fn undo(&self) {
        self.change("undoing", |player| player.undo().map(drop));
    }

    /// Makes the change again that was undone last.
    pub fn redo(&self) {
        self.change("redoing", |player| player.redo().map(drop));
    }

    /// Waits until all orders so far have been carried out, or the scene cannot be played. What
    /// plays goes on.
    pub fn wait(&self) {
        let (done, is_done) = channel();
        if self.orders.send(Order::Tell(done)).is_ok() {
            // An error is the end of the thread.
            let _ = is_done.recv();
        }
    }

    fn order(&self, order: Order) {
        // The thread has ended only if it could not start.
        let _ = self.orders.send(order);
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.cancelled.store(true, Ordering::Relaxed);
        self.order(Order::End);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been printed.
            let _ = thread.join();
        }
    }
}
