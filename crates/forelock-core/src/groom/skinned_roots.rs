//! Roots on the skin of a character: their motion as a function of the pose of its bones.

use std::sync::Arc;

use glam::Vec3;

use super::{FrameBuffers, RootFrames, SurfaceRoots};
use crate::body::character::{Character, SkinPose};

/// Roots bound to a character at rest.
///
/// The scalar code of [`SkinnedRoots::frames`] is what devices answer to that get a pose and
/// compute the motions themselves.
#[derive(Clone, Debug)]
pub struct SkinnedRoots {
    surface: SurfaceRoots,
    character: Arc<Character>,
}

impl SkinnedRoots {
    /// The roots of `surface`, which are bound to the mesh of `character` at rest.
    pub fn new(surface: SurfaceRoots, character: Arc<Character>) -> Self {
        Self { surface, character }
    }

    /// The roots on the mesh.
    pub fn surface(&self) -> &SurfaceRoots {
        &self.surface
    }

    /// The character.
    pub fn character(&self) -> &Arc<Character> {
        &self.character
    }

    /// The roots' motions in `pose`.
    ///
    /// # Panics
    /// If it is a pose of another character.
    pub fn frames(&self, pose: &SkinPose) -> RootFrames {
        let (mut frames, mut positions) = (RootFrames::default(), Vec::<Vec3>::new());
        self.character.deform(pose, &mut positions);
        self.surface.frames(&positions, &mut FrameBuffers::default(), &mut frames);
        frames
    }
}
