//! Going back: kept states, seeking, undo, snapshots.

use std::sync::Arc;

use super::history::Keyframe;
use super::live::Live;
use super::timeline::{Change, Moved, Timeline};
use super::{Player, PlayerError};

/// A moment of a player, with all changes until then and after: see [`Player::snapshot`].
#[derive(Clone, Debug)]
pub struct PlayerSnapshot {
    player: u64,
    keyframe: Keyframe,
    timeline: Timeline,
}

impl PlayerSnapshot {
    /// Frames done at that moment.
    pub fn frame(&self) -> u32 {
        self.keyframe.live.frame
    }
}

impl Player {
    /// Goes to `frame`, which has been simulated already: restores the nearest kept state before it
    /// and steps on from there. The state is bit for bit that of the first time, with all changes
    /// that were made until then, those at `frame` included.
    ///
    /// # Errors
    /// [`PlayerError::NotRun`] for a frame that was not simulated, [`PlayerError::NotKept`] without
    /// history, and what [`Player::step`] may return.
    pub fn seek(&mut self, frame: u32) -> Result<(), PlayerError> {
        if frame > self.reached {
            return Err(PlayerError::NotRun { frame, reached: self.reached });
        }
        if frame == self.live.frame {
            return Ok(());
        }
        self.run_from_kept(frame)
    }

    /// Goes to `frame` from the best kept state or from here.
    fn run_from_kept(&mut self, frame: u32) -> Result<(), PlayerError> {
        let kept = self.history.as_ref().and_then(|history| history.at_or_before(frame, usize::MAX));
        let is_ahead = self.live.frame > frame;
        match kept.filter(|kept| is_ahead || kept.live.frame > self.live.frame).cloned() {
            Some(kept) => self.restore_keyframe(&kept)?,
            None if is_ahead => return Err(PlayerError::NotKept(frame)),
            None => {}
        }
        while self.live.frame < frame {
            self.step()?;
        }
        Ok(())
    }

    fn restore_keyframe(&mut self, keyframe: &Keyframe) -> Result<(), PlayerError> {
        let Live { setting, grooming, .. } = &keyframe.live;
        let same_groom = match (&grooming.groom, &self.live.grooming.groom) {
            (None, None) => true,
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            _ => false,
        };
        self.engine.set_sleep_speed(setting.solver.sleep_speed);
        let own = &self.live.setting;
        if !same_groom {
            let guides = self.skinning.as_ref().map(|skinning| skinning.guides());
            let groom = grooming.groom.as_deref().or(guides).unwrap_or(&self.assets.groom);
            self.engine.rebuild(groom, &setting.parts())?;
        } else {
            if !Arc::ptr_eq(&own.params, &setting.params) {
                self.engine.simulator().set_params(&setting.params)?;
            }
            if !Arc::ptr_eq(&own.interaction, &setting.interaction) {
                self.engine.simulator().set_interactions(&setting.interaction.interactions())?;
            }
        }
        self.engine.simulator().restore(&keyframe.state)?;
        self.live = keyframe.live.clone();
        self.repeat_due_changes()
    }

    /// Repeats the recorded changes that are due at the present frame.
    pub(super) fn repeat_due_changes(&mut self) -> Result<(), PlayerError> {
        while let Some(change) = self.timeline.due(self.live.applied, self.live.frame).cloned() {
            match self.apply(&change) {
                // The change that added it was undone.
                Err(PlayerError::NoCollider(_)) => {}
                done => done?,
            }
            self.live.applied += 1;
        }
        Ok(())
    }

    /// Keeps the present state if it is one of those to be kept.
    pub(super) fn keep_state(&mut self) -> Result<(), PlayerError> {
        let Some(history) = &mut self.history else { return Ok(()) };
        if history.wants(self.live.frame) {
            let state = self.engine.simulator().snapshot()?;
            history.keep(Keyframe { live: self.live.clone(), state });
        }
        Ok(())
    }

    /// Keeps the present state and no other.
    pub(super) fn keep_only_this(&mut self) -> Result<(), PlayerError> {
        let Some(history) = &mut self.history else { return Ok(()) };
        history.clear();
        let state = self.engine.simulator().snapshot()?;
        history.keep(Keyframe { live: self.live.clone(), state });
        Ok(())
    }

    /// Applies `change` now and records it.
    pub(super) fn make(&mut self, change: Change) -> Result<(), PlayerError> {
        self.apply(&change)?;
        let Some(history) = &mut self.history else { return Ok(()) };
        let frame = self.live.frame;
        self.timeline.record(frame, change);
        self.live.applied += 1;
        history.drop_after(frame, usize::MAX);
        self.reached = frame;
        Ok(())
    }

    /// Takes the edit or change of parameters back that was made last, whatever its frame, and
    /// simulates again from there to the present frame. Returns its name; `None` if there is none.
    ///
    /// # Errors
    /// [`PlayerError::NotKept`] if no state from before it is kept, and what [`Player::step`] may
    /// return.
    pub fn undo(&mut self) -> Result<Option<&'static str>, PlayerError> {
        let Some(moved) = self.timeline.undo() else { return Ok(None) };
        let done = self.run_again_from(moved);
        if let Err(PlayerError::NotKept(_)) = &done {
            self.timeline.redo();
        }
        done.map(|()| Some(moved.name))
    }

    /// Makes the change again that was undone last, at its frame, and simulates again from there to
    /// the present frame. Returns its name; `None` if there is none.
    ///
    /// # Errors
    /// The same errors as [`Player::undo`].
    pub fn redo(&mut self) -> Result<Option<&'static str>, PlayerError> {
        let Some(moved) = self.timeline.redo() else { return Ok(None) };
        let done = self.run_again_from(moved);
        if let Err(PlayerError::NotKept(_)) = &done {
            self.timeline.undo();
        }
        done.map(|()| Some(moved.name))
    }

    /// Names of the changes that [`Player::undo`] would take back and [`Player::redo`] make again.
    pub fn undoable(&self) -> [Option<&'static str>; 2] {
        self.timeline.next()
    }

    /// The timeline has changed at `moved`: simulates from there to the present frame again.
    fn run_again_from(&mut self, moved: Moved) -> Result<(), PlayerError> {
        let now = self.live.frame;
        let kept = self.history.as_ref().and_then(|h| h.at_or_before(moved.frame, moved.index)).cloned();
        let kept = kept.ok_or(PlayerError::NotKept(moved.frame))?;
        if let Some(history) = &mut self.history {
            history.drop_after(moved.frame, moved.index);
        }
        self.reached = self.reached.min(moved.frame.max(now));
        if moved.frame > now {
            return Ok(());
        }
        self.restore_keyframe(&kept)?;
        while self.live.frame < now {
            self.step()?;
        }
        Ok(())
    }

    /// A copy of the present moment, with all changes, to be restored later.
    ///
    /// # Errors
    /// [`PlayerError`] if the device has failed.
    pub fn snapshot(&mut self) -> Result<PlayerSnapshot, PlayerError> {
        let keyframe = Keyframe { live: self.live.clone(), state: self.state()? };
        Ok(PlayerSnapshot { player: self.id, keyframe, timeline: self.timeline.clone() })
    }

    /// Goes back to a snapshot, of this or of another player of the same scene, and to the changes
    /// of that moment. Earlier frames can still be
    /// sought where this player kept states of them and has made no other changes since.
    ///
    /// # Errors
    /// [`PlayerError`] if it is of another scene.
    pub fn restore(&mut self, snapshot: &PlayerSnapshot) -> Result<(), PlayerError> {
        let PlayerSnapshot { player, keyframe, timeline } = snapshot;
        let (frame, applied) = (keyframe.live.frame, keyframe.live.applied);
        let same = *player == self.id && self.timeline.agrees_with(timeline, applied);
        self.timeline = timeline.clone();
        self.restore_keyframe(keyframe)?;
        self.reached = frame;
        if let Some(history) = &mut self.history {
            if same {
                history.drop_after(frame, applied);
            } else {
                history.clear();
            }
            if history.at_or_before(frame, applied).is_none() {
                history.keep(keyframe.clone());
            }
        }
        Ok(())
    }
}
