//! Changes of a running simulation.

use std::sync::Arc;

use forelock_core::air::WindParams;
use forelock_core::body::Motion;
use forelock_core::groom::edit::{Edit, EditReport, Operation};
use forelock_core::pose::Pose;
use forelock_core::simulation::Teleport;
use glam::DVec3;

use super::live::{self, Live, LiveSolid};
use super::regrooming::EditContext;
use super::timeline::Change;
use super::track::{Drag, Track};
use super::{ColliderId, Player, PlayerError};
use crate::assets;
use crate::scene::{ColliderSection, InteractionSection, SolverSection};

impl Player {
    /// Changes the solver's parameters, or the solver, from the next step on.
    ///
    /// # Errors
    /// [`PlayerError`] if a parameter is out of range, or cannot change while the simulation runs:
    /// the particles that the solver adds to strands; nothing has changed then.
    pub fn set_params(&mut self, solver: &SolverSection) -> Result<(), PlayerError> {
        self.make(Change::Solver(Arc::new(solver.clone())))
    }

    /// Changes how strands interact, from the next step on.
    ///
    /// # Errors
    /// [`PlayerError`] if a parameter is out of range; nothing has changed then.
    pub fn set_interaction(&mut self, interaction: &InteractionSection) -> Result<(), PlayerError> {
        self.make(Change::Interaction(Arc::new(interaction.clone())))
    }

    /// Changes gravity, m/s², from the next step on. The rest shape carries that of the scene.
    ///
    /// # Errors
    /// [`PlayerError::Pose`] if it is not finite.
    pub fn set_gravity(&mut self, gravity: DVec3) -> Result<(), PlayerError> {
        self.make(Change::Gravity(gravity))
    }

    /// Changes the wind from the next step on.
    ///
    /// # Errors
    /// [`PlayerError::Wind`] if a parameter is out of range.
    pub fn set_wind(&mut self, wind: &WindParams) -> Result<(), PlayerError> {
        self.make(Change::Wind(wind.clone()))
    }

    /// Moves the head by `motion` from the next step on, in place of the scene's motion or a drag.
    /// A pose far from the present one counts as a jump: see `body.teleport_speed` and
    /// [`Player::teleport`].
    ///
    /// # Errors
    /// What a recorded change may return.
    pub fn set_motion(&mut self, motion: Motion) -> Result<(), PlayerError> {
        self.make(Change::Motion(Arc::new(motion)))
    }

    /// Moves the head to `pose` (world from head) in the next frame, at constant speed, and leaves
    /// it there: for dragging it from outside.
    ///
    /// # Errors
    /// [`PlayerError::Pose`] if the pose is not finite.
    pub fn set_head_pose(&mut self, pose: Pose) -> Result<(), PlayerError> {
        self.make(Change::HeadPose(pose))
    }

    /// Declares what the head does in the next step to be a jump, in which the hair behaves as
    /// `mode` says.
    ///
    /// # Errors
    /// What a recorded change may return.
    pub fn teleport(&mut self, mode: Teleport) -> Result<(), PlayerError> {
        self.make(Change::Teleport(mode))
    }

    /// Moves a collider to `pose` in the next frame, at constant speed, and leaves it there. The
    /// pose is relative to the head for a collider on the body, else to the world.
    ///
    /// # Errors
    /// [`PlayerError`] if there is no such collider, or the pose is not finite.
    pub fn set_collider_pose(&mut self, collider: ColliderId, pose: Pose) -> Result<(), PlayerError> {
        self.make(Change::ColliderPose(collider, pose))
    }

    /// Adds a collider.
    ///
    /// # Errors
    /// [`PlayerError::Asset`] if a file that it names cannot be used.
    pub fn add_collider(&mut self, collider: &ColliderSection) -> Result<ColliderId, PlayerError> {
        let solid = Arc::new(assets::solid(collider, self.live.fps)?);
        // A collider that was added later, before going back, has a number already.
        let id = ColliderId(self.live.next_collider.max(self.timeline.next_collider()));
        self.make(Change::AddCollider(id, solid, Arc::new(collider.clone())))?;
        Ok(id)
    }

    /// Removes a collider.
    ///
    /// # Errors
    /// [`PlayerError::NoCollider`] if there is none.
    pub fn remove_collider(&mut self, collider: ColliderId) -> Result<(), PlayerError> {
        self.make(Change::RemoveCollider(collider))
    }

    /// Edits all strands of the groom while it moves: each strand takes its motion over.
    ///
    /// # Errors
    /// [`PlayerError`] if the edit cannot be done, or guides carry the strands; nothing has changed
    /// then.
    pub fn edit(&mut self, operation: Operation) -> Result<(), PlayerError> {
        self.edit_selected(Edit::all(operation))
    }

    /// Like [`Player::edit`], of a selection of the strands.
    ///
    /// # Errors
    /// The same errors as [`Player::edit`].
    pub fn edit_selected(&mut self, edit: Edit) -> Result<(), PlayerError> {
        self.make(Change::Edit(Arc::new(edit)))
    }

    /// Does `task`; what it changes is undone in one go, with the other changes of `group`: those
    /// that the drag of a slider makes.
    pub fn grouped<R>(&mut self, group: u64, task: impl FnOnce(&mut Self) -> R) -> R {
        self.timeline.group = Some(group);
        let done = task(self);
        self.timeline.group = None;
        done
    }

    /// Applies `change`; nothing has changed after an error.
    pub(super) fn apply(&mut self, change: &Change) -> Result<(), PlayerError> {
        match change {
            Change::Solver(solver) => self.apply_solver(solver),
            Change::Interaction(interaction) => {
                interaction.grid.validate()?;
                interaction.sph.validate()?;
                interaction.contact.validate()?;
                self.engine.simulator().set_interactions(&interaction.interactions())?;
                self.live.setting.interaction = interaction.clone();
                Ok(())
            }
            Change::Gravity(gravity) => {
                let gravity = gravity.is_finite().then_some(*gravity).ok_or(PlayerError::Pose)?;
                self.live.setting.gravity = gravity;
                Ok(())
            }
            Change::Wind(wind) => {
                self.live.setting.wind = Arc::new(live::wind(&self.scene, wind)?);
                Ok(())
            }
            Change::AddCollider(..) | Change::RemoveCollider(_) => {
                self.live.apply_pose(change)?;
                Ok(self.engine.simulator().forget_solids()?)
            }
            Change::Motion(_) | Change::HeadPose(_) | Change::Teleport(_) | Change::ColliderPose(..) => {
                self.live.apply_pose(change)
            }
            Change::Edit(edit) => self.apply_edit(edit).map(drop),
        }
    }

    fn apply_solver(&mut self, solver: &Arc<SolverSection>) -> Result<(), PlayerError> {
        if !solver.has_model_of(&self.live.setting.solver) {
            return Err(PlayerError::Fixed(
                "the trained model of the solver \"neural\", or whether there is one,",
            ));
        }
        let params = Arc::new(self.solvers.solver(solver)?);
        if params.refinement() != self.live.setting.params.refinement() {
            return Err(PlayerError::Fixed("the particles that the solver adds between those of the groom"));
        }
        if solver.masses != self.live.setting.solver.masses {
            return Err(PlayerError::Fixed("`solver.masses`"));
        }
        params.validate()?;
        self.engine.check_step(&params, 1.0 / self.live.fps, solver.beyond_float32)?;
        self.engine.simulator().set_params(&params)?;
        self.engine.set_sleep_speed(solver.sleep_speed);
        self.live.set_solver(solver.clone(), params);
        Ok(())
    }

    fn apply_edit(&mut self, edit: &Edit) -> Result<EditReport, PlayerError> {
        if self.skinning.is_some() {
            return Err(PlayerError::EditedGuides);
        }
        let Self { scene, assets, engine, live, .. } = self;
        let number = scene.edits.0.len();
        let mut context = EditContext { scene, assets, engine, head: live.head_at };
        live.grooming.edit(edit, number, &mut context)
    }
}

impl Live {
    /// Applies `change` to the head and to the solids. Other changes are ignored. Nothing has
    /// changed after an error.
    pub(super) fn apply_pose(&mut self, change: &Change) -> Result<(), PlayerError> {
        match change {
            Change::Motion(motion) => self.head = Track::Motion(motion.clone()),
            Change::HeadPose(pose) => self.head = self.drag(self.head_at, *pose)?,
            Change::Teleport(mode) => self.teleport = Some(*mode),
            Change::ColliderPose(id, pose) => {
                let live = self.solids.iter().find(|live| live.id == *id);
                let live = live.ok_or(PlayerError::NoCollider(*id))?;
                let drag = self.drag(live.at, pose.after(&live.solid.base().inverse()))?;
                for live in self.solids.iter_mut().filter(|live| live.id == *id) {
                    live.track = drag.clone();
                }
            }
            Change::AddCollider(id, solid, _) => {
                let track = Track::Motion(solid.motion().clone());
                let at = track.pose(self.simulated_secs());
                let now = solid.carrier(&self.head_shown, &track.pose(self.shown_secs()));
                let was_there = solid.is_there(self.shown_secs());
                let solid = solid.clone();
                self.solids.push(LiveSolid { id: *id, solid, track, at, shown: [now; 2], was_there });
                self.next_collider = id.0 + 1;
            }
            Change::RemoveCollider(id) => {
                let index = self.solids.iter().position(|live| live.id == *id);
                self.solids.remove(index.ok_or(PlayerError::NoCollider(*id))?);
            }
            Change::Solver(_)
            | Change::Interaction(_)
            | Change::Gravity(_)
            | Change::Wind(_)
            | Change::Edit(_) => {}
        }
        Ok(())
    }

    /// From pose `from` at the time that the simulation has reached to pose `to` at the next frame.
    fn drag(&self, from: Pose, to: Pose) -> Result<Track, PlayerError> {
        if !(to.is_finite() && to.rotation.length() > 1e-6) {
            return Err(PlayerError::Pose);
        }
        let to = Pose::new(to.rotation.normalize(), to.translation);
        let start_secs = self.simulated_secs();
        let next = self.frame_secs(self.frame + 1);
        let end_secs = next.max(start_secs + self.step_secs());
        Ok(Track::Drag(Drag { from, to, start_secs, end_secs }))
    }
}
