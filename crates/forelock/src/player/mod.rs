//! A scene that runs: stepped frame by frame, changed while it runs, and taken back.
//!
//! # Practice
//! A [`Player`] holds a scene, its assets, a simulation and a clock, and writes no files. It is
//! what a window, a game or a script drives; [`simulate`](crate::simulate) is a player with sinks.
//!
//! ```
//! use forelock::player::Player;
//! use forelock::scene::Override;
//! use forelock::Scene;
//!
//! let small = ["groom.strands=20", "body.sdf_cells=32"];
//! let sets: Result<Vec<_>, _> = small.iter().map(|set| Override::set(set)).collect();
//! let mut player = Player::new(Scene::builtin(&sets?)?)?;
//! for _ in 0..10 {
//!     player.step()?;
//! }
//! let mut positions = Vec::new();
//! player.positions(&mut positions)?;
//! let hash = player.state_hash()?;
//! player.seek(3)?;
//! player.seek(10)?;
//! assert_eq!(player.state_hash()?, hash);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **Time.** A frame takes 1 / `time.fps` seconds. A solver with a fixed step takes the steps that
//! begin before the end of the frame; [`Player::positions`] shows strands at the frame's time. All
//! built-in solvers have one, so that the motion does not depend on the frame rate.
//!
//! **Live changes** (parameters, wind, colliders, poses, edits) take effect before the next step
//! and are recorded on a timeline at the frame at which they were made. Every state is the result
//! of the scene and that timeline: [`Player::seek`] restores the nearest kept state and steps on,
//! repeating the recorded changes at their frames, bit for bit. A change that is made after seeking
//! back is inserted at its frame; later frames are simulated again, with the later changes.
//! [`Player::undo`] takes the last edit or change of parameters out of the timeline, whatever its
//! frame, and simulates from there to the present frame again; [`Player::redo`] puts it back.
//! Motions and poses of the head and of colliders cannot be undone.
//!
//! # Limitations
//! A player without history ([`PlayerBuilder::without_history`]) records nothing: it neither seeks
//! nor undoes.

mod bending;
mod between;
mod builder;
mod changes;
mod engine;
mod error;
mod history;
mod live;
mod moment;
mod past;
mod performance;
mod regrooming;
mod report;
mod stepping;
mod timeline;
mod told;
mod track;

use std::sync::Arc;

use forelock_core::body::{ColliderFrame, TriMesh};
use forelock_core::groom::Groom;
use forelock_core::groom::guides::Skinning;
use forelock_core::pose::Pose;
use forelock_core::strands::{Between, Snapshot};
use forelock_gpu::DevicePositions;
use glam::{DVec3, Vec3};

pub use builder::PlayerBuilder;
pub use engine::SolverFactory;
pub use error::PlayerError;
pub use history::HistoryOptions;
pub use moment::{Moment, Parameters};
pub use past::PlayerSnapshot;
pub use report::{Counters, Jump, StepReport};
pub use told::{Asked, Told, Untold, WhyUntold};

pub use forelock_core::simulation::Touch;

use crate::assets::Assets;
use crate::penetration::{Layout, MeasuredSolid, Penetration};
use crate::scene::{InteractionSection, Scene, SolverSection};
use bending::Bending;
use engine::{Engine, Solvers};
use history::History;
use live::Live;
use timeline::Timeline;

/// A collider of a running simulation: 0 is the body, then come the scene's in order, then those
/// that were added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ColliderId(pub u32);

impl ColliderId {
    /// The body, if strands collide with it.
    pub const BODY: Self = Self(0);
}

/// A collider as a picture shows it.
#[derive(Clone, Copy, Debug)]
pub struct ColliderView<'a> {
    /// Which.
    pub id: ColliderId,
    /// World from the collider's space.
    pub pose: Pose,
    /// Its mesh, if it has one and is visible; the body is [`Assets::body_mesh`].
    pub mesh: Option<&'a TriMesh>,
}

/// A scene that runs; see the [module](self).
#[derive(Debug)]
pub struct Player {
    scene: Arc<Scene>,
    assets: Arc<Assets>,
    solvers: Solvers,
    engine: Engine,
    live: Live,
    timeline: Timeline,
    /// None for a player that does not go back.
    history: Option<History>,
    /// All that changes, at the start.
    start: Live,
    /// The last frame that is simulated with the timeline as it is.
    reached: u32,
    /// Identifies the snapshots of this player.
    id: u64,
    /// The roots, if the body bends.
    bending: Option<Bending>,
    /// How guides carry all strands, if only guides are simulated.
    skinning: Option<Skinning>,
    /// The middle of the roots at rest, metres.
    middle: DVec3,
    /// Positions that are simulated, where others are shown.
    simulated: Vec<Vec3>,
    /// What the user should know of the run.
    notes: Vec<String>,
}

impl Player {
    /// Loads what `scene` names and builds its simulation on the CPU, at rest before the first
    /// frame.
    ///
    /// # Errors
    /// [`PlayerError`] if something that the scene names cannot be used.
    pub fn new(scene: impl Into<Arc<Scene>>) -> Result<Self, PlayerError> {
        Self::builder(scene).build()
    }

    /// A player of `scene` with options.
    pub fn builder(scene: impl Into<Arc<Scene>>) -> PlayerBuilder {
        PlayerBuilder::new(scene.into())
    }

    /// The scene as it was loaded, without live changes.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// What the scene names, as it was loaded.
    pub fn assets(&self) -> &Arc<Assets> {
        &self.assets
    }

    /// Frames done.
    pub fn frame(&self) -> u32 {
        self.live.frame
    }

    /// The last frame that has been simulated with all changes as they are.
    pub fn reached(&self) -> u32 {
        self.reached
    }

    /// Time of the present frame, seconds.
    pub fn time_secs(&self) -> f64 {
        self.live.shown_secs()
    }

    /// Time of a frame, seconds.
    pub fn secs_of(&self, frame: u32) -> f64 {
        self.live.frame_secs(frame)
    }

    /// The positions of the present frame on the GPU that simulates them, for renderers that share
    /// its device ([`PlayerBuilder::gpu`]), in the layout of [`Player::groom`]. None on a CPU, with
    /// guides, after cuts, and if the frame does not end with a step of the simulation, as at rates
    /// that do not divide 60 (`time.fps`); [`positions`](Self::positions) has them then. After a
    /// change of the solver, an edit, seeking or undoing they may be in other buffers
    /// ([`DevicePositions::revision`]).
    ///
    /// # Errors
    /// [`PlayerError`] if the device has failed.
    pub fn device_positions(&mut self) -> Result<Option<&DevicePositions>, PlayerError> {
        let Self { engine, live, skinning, .. } = self;
        let clock = live.own_clock.filter(|clock| clock.done > 0);
        let is_between = clock.is_some_and(|clock| clock.share(live.shown_secs()) < 1.0);
        if is_between || skinning.is_some() || !live.grooming.shows_simulated() {
            return Ok(None);
        }
        Ok(engine.simulator().positions()?.device())
    }

    /// All strands at the present frame, those that guides carry included: positions in world
    /// space, metres, in the order of [`Player::groom`].
    ///
    /// # Errors
    /// [`PlayerError`] if the device has failed.
    pub fn positions(&mut self, out: &mut Vec<Vec3>) -> Result<(), PlayerError> {
        let Self { engine, live, skinning, simulated: buffer, .. } = self;
        let stepped = live.own_clock.filter(|clock| clock.done > 0);
        let simulator = engine.simulator();
        let mut simulated = |out: &mut Vec<Vec3>| -> Result<(), PlayerError> {
            let Some(clock) = stepped else { return Ok(simulator.read_positions(out)?) };
            let share = clock.share(live.shown_secs());
            let moment = Between { share, heads: live.step_heads, now: live.head_shown };
            if live.setting.stores_step_before() {
                return Ok(simulator.read_positions_between(&moment, out)?);
            }
            simulator.read_positions(out)?;
            let before = live.before.as_ref().filter(|own| share < 1.0 && own.len() == out.len());
            if let Some(before) = before {
                between::interpolate(simulator.model(), before, &moment, out);
            }
            Ok(())
        };
        match skinning {
            None => live.grooming.positions(simulated, buffer, out),
            Some(skinning) => {
                simulated(buffer)?;
                skinning.skin(&live.head_shown, buffer, out);
                Ok(())
            }
        }
    }

    /// The groom that [`Player::positions`] are of, at rest. It is the one at the start, whose
    /// particles beyond a cut lie at the tip, until an edit from outside adds particles or strands.
    pub fn groom(&self) -> &Groom {
        self.live.grooming.shown(&self.assets.groom)
    }

    /// The groom with all edits so far, at rest.
    pub fn edited_groom(&self) -> &Groom {
        self.live.grooming.groom.as_deref().unwrap_or(&self.assets.groom)
    }

    /// How [`Player::positions`] are divided into strands.
    pub fn layout(&self) -> Layout<'_> {
        Layout { strand_offsets: self.groom().strand_offsets(), clamped: self.live.setting.clamped() }
    }

    /// The head's pose at the present frame: world from head.
    pub fn head_pose(&self) -> Pose {
        self.live.head_shown
    }

    /// All solids from the frame before to the present one. A body that bends has its present pose.
    pub fn collider_frames(&self) -> Vec<ColliderFrame<'_>> {
        self.measured_solids().into_iter().map(|solid| solid.frame).collect()
    }

    /// All solids at the present frame.
    pub fn colliders(&self) -> impl Iterator<Item = ColliderView<'_>> {
        let secs = self.time_secs();
        let solids = self.live.solids.iter().filter(move |live| live.solid.is_there(secs));
        solids.map(move |live| ColliderView {
            id: live.id,
            pose: live.shown[1].after(live.solid.base()),
            mesh: live.solid.mesh_at(secs),
        })
    }

    /// The solver and its parameters as they are now.
    pub fn solver(&self) -> &SolverSection {
        &self.live.setting.solver
    }

    /// The interaction of strands as it is now.
    pub fn interaction(&self) -> &InteractionSection {
        &self.live.setting.interaction
    }

    /// Substeps of a frame as they are now, 1 for a solver without them.
    pub fn substeps(&self) -> u32 {
        self.live.setting.substeps(1.0 / self.live.fps)
    }

    /// Whether hair collides with anything.
    pub fn has_solids(&self) -> bool {
        self.assets.bending_solid().is_some() || !self.live.solids.is_empty()
    }

    /// Measures how much of the hair lies inside solids at the present frame: `positions` are those
    /// of [`Player::positions`]. Exact for primitives and meshes.
    pub fn penetration(&self, positions: &[Vec3]) -> Penetration {
        Penetration::measure(positions, self.layout(), &self.measured_solids())
    }

    /// The solids of the last step at the present frame, as [`Penetration::measure`] needs them, in
    /// the order of [`Player::collider_frames`].
    pub fn measured_solids(&self) -> Vec<MeasuredSolid<'_>> {
        self.live.measured_solids(&self.assets, false)
    }

    /// Makes the surfaces that hair is measured against, which are otherwise made when they are
    /// needed first.
    pub(crate) fn prepare_surfaces(&self) {
        drop(self.live.measured_solids(&self.assets, true));
    }

    /// Sums over all frames so far.
    pub fn counters(&self) -> &Counters {
        &self.live.counters
    }

    /// What the user should know of import, edits and jumps, one sentence each.
    pub fn notes(&self) -> Vec<String> {
        let jumps: Vec<String> = self.live.counters.jump_note().into_iter().collect();
        [&self.assets.notes[..], &self.notes, &self.live.grooming.notes, &jumps].concat()
    }

    /// What the user should know of the choice of the backend, one sentence each.
    pub fn backend_notes(&self) -> &[String] {
        &self.notes
    }

    /// A 64-bit hash of the solver's state.
    ///
    /// # Errors
    /// [`PlayerError`] if the device has failed.
    pub fn state_hash(&mut self) -> Result<u64, PlayerError> {
        self.engine.state_hash()
    }

    /// A copy of the solver's state; see [`Player::resume`].
    ///
    /// # Errors
    /// [`PlayerError`] if the device has failed.
    pub fn state(&mut self) -> Result<Snapshot<f32>, PlayerError> {
        let mut state = self.engine.simulator().snapshot()?;
        if let Some(before) = &self.live.before {
            let flat = before.iter().flat_map(|x| x.to_array()).collect();
            state.extra.insert(between::CHANNEL.to_owned(), flat);
        }
        Ok(state)
    }

    /// Strands that are simulated: all, or the guides.
    pub fn simulated_strands(&self) -> usize {
        self.engine.strand_count()
    }

    /// Guides that carry all strands; 0 if all strands are simulated.
    pub fn guides(&self) -> usize {
        self.skinning.as_ref().map_or(0, |skinning| skinning.chosen().len())
    }

    /// Bytes held by the simulation and the guides, without history.
    pub fn simulation_bytes(&self) -> u64 {
        self.engine.bytes() + self.skinning.as_ref().map_or(0, Skinning::bytes) as u64
    }

    /// Bytes held by the states from which the player goes back.
    pub fn history_bytes(&self) -> usize {
        self.history.as_ref().map_or(0, History::bytes)
    }

    /// Name of the GPU, if it runs on one.
    pub fn gpu_name(&self) -> Option<&str> {
        self.engine.gpu_name()
    }

    /// Name of the instruction set.
    pub fn simd_name(&self) -> String {
        self.engine.simd_name()
    }
}
