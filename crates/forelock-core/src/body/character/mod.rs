//! Characters: meshes that a skeleton and blend shapes move, and clips that move these.
//!
//! # Practice
//! The **rest** of a character is its mesh in the rest pose of its skeleton, with the rest weights
//! of its shapes: what a viewer shows before a clip is played, and what a groom grows on. The mesh
//! as it was bound may differ from it.

mod clip;
mod performance;
mod retarget;
mod skeleton;
mod skin;

use std::ops::Range;

use glam::{DAffine3, Vec3};

pub use clip::{Clip, Interpolation, Track, TrackError, Values};
pub use performance::{Performance, Playback, Posed, PosingBuffers};
pub use retarget::{Retarget, RetargetError};
pub use skeleton::{Joint, Skeleton, SkeletonError, Transform};
pub use skin::{Bone, MAX_INFLUENCES, Palette, SKIN_WGSL, Skin, SkinReport, Skinning};

use super::{MeshError, TriMesh};

/// A displacement of vertices, to be weighted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlendShape {
    /// Its name; may be empty.
    pub name: String,
    /// The vertices that it moves, and by how much, in the space of the bound mesh.
    pub deltas: Vec<(u32, Vec3)>,
    /// Its weight at rest.
    pub rest_weight: f64,
}

/// A part of a character's mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// Its name; may be empty.
    pub name: String,
    /// Its triangles.
    pub triangles: Range<usize>,
}

/// What moves the vertices of a character at one instant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SkinPose {
    /// The motions of its bones.
    pub palette: Palette,
    /// How they are blended.
    pub skinning: Skinning,
    /// The bound vertices as blend shapes displace them, metres; empty where none does.
    pub shaped: Vec<Vec3>,
}

/// What a character is made of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CharacterParts {
    /// The skeleton.
    pub skeleton: Skeleton,
    /// The mesh as it was bound.
    pub bound: TriMesh,
    /// Its skin.
    pub skin: Skin,
    /// Its blend shapes.
    pub shapes: Vec<BlendShape>,
    /// Its parts.
    pub groups: Vec<Group>,
    /// Its clips.
    pub clips: Vec<Clip>,
}

/// Why parts are not a character.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CharacterError {
    /// The mesh as it was bound, or at rest, is not one.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Mesh and skin do not have the same number of vertices.
    #[error("the mesh has {mesh} vertices and its skin {skin}")]
    Vertices {
        /// Vertices of the mesh.
        mesh: usize,
        /// Vertices of the skin.
        skin: usize,
    },
    /// A bone or track names a joint, or a shape names a vertex, that does not exist.
    #[error("{0} refers to a joint, shape or vertex that does not exist")]
    Missing(String),
}

/// A mesh that a skeleton moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Character {
    parts: CharacterParts,
    rest: TriMesh,
}

impl Character {
    /// A character of `parts`.
    ///
    /// # Errors
    /// [`CharacterError`] if they do not fit together.
    pub fn new(parts: CharacterParts) -> Result<Self, CharacterError> {
        let CharacterParts { skeleton, bound, skin, shapes, clips, .. } = &parts;
        let (mesh, skinned) = (bound.positions.len(), skin.vertices());
        if mesh != skinned {
            return Err(CharacterError::Vertices { mesh, skin: skinned });
        }
        if skin.bones().is_empty() {
            return Err(CharacterError::Missing("the skin has no bones; a vertex".into()));
        }
        if skin.bones().iter().any(|bone| bone.joint >= skeleton.joints().len()) {
            return Err(CharacterError::Missing("a bone".into()));
        }
        if let Some(own) = shapes.iter().find(|own| own.deltas.iter().any(|delta| delta.0 as usize >= mesh)) {
            return Err(CharacterError::Missing(format!("blend shape {:?}", own.name)));
        }
        if let Some(own) = clips.iter().find(|own| !own.check(skeleton, shapes.len())) {
            return Err(CharacterError::Missing(format!("clip {:?}", own.name)));
        }
        let mut character = Self { rest: TriMesh::default(), parts };
        character.rest = character.at_rest()?;
        Ok(character)
    }

    /// The mesh at rest.
    fn at_rest(&self) -> Result<TriMesh, MeshError> {
        let mut positions = Vec::new();
        self.deform(&self.rest_pose(), &mut positions);
        TriMesh::new(positions, self.parts.bound.triangles.clone())
    }

    /// Applies `map`, a change of axes and units, to all of the character.
    ///
    /// # Errors
    /// [`MeshError`] if the mesh at rest is not finite then.
    pub fn transform(&mut self, map: &DAffine3) -> Result<(), MeshError> {
        self.parts.skeleton.transform(map);
        self.parts.skin.transform(map);
        let linear = map.matrix3;
        for p in &mut self.parts.bound.positions {
            *p = map.transform_point3(p.as_dvec3()).as_vec3();
        }
        for delta in self.parts.shapes.iter_mut().flat_map(|shape| &mut shape.deltas) {
            delta.1 = (linear * delta.1.as_dvec3()).as_vec3();
        }
        self.rest = self.at_rest()?;
        Ok(())
    }

    /// The skeleton.
    pub fn skeleton(&self) -> &Skeleton {
        &self.parts.skeleton
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        &self.parts.skin
    }

    /// The mesh as it was bound.
    pub fn bound(&self) -> &TriMesh {
        &self.parts.bound
    }

    /// The mesh at rest, which a groom grows on.
    pub fn rest(&self) -> &TriMesh {
        &self.rest
    }

    /// The blend shapes.
    pub fn shapes(&self) -> &[BlendShape] {
        &self.parts.shapes
    }

    /// The parts of the mesh.
    pub fn groups(&self) -> &[Group] {
        &self.parts.groups
    }

    /// The clips.
    pub fn clips(&self) -> &[Clip] {
        &self.parts.clips
    }

    /// The joint that the most weight of `vertices` follows.
    ///
    /// # Panics
    /// If a vertex is out of range.
    pub fn main_joint(&self, vertices: impl IntoIterator<Item = usize>) -> Option<usize> {
        let mut sums = vec![0.0f64; self.skeleton().joints().len()];
        for (bone, weight) in vertices.into_iter().flat_map(|vertex| self.skin().of_vertex(vertex)) {
            sums[self.skin().bones()[bone].joint] += f64::from(weight);
        }
        let most = sums.iter().copied().fold(0.0, f64::max);
        (most > 0.0).then(|| sums.iter().position(|&sum| sum == most))?
    }

    /// The pose that takes the bound mesh to rest.
    pub fn rest_pose(&self) -> SkinPose {
        let weights: Vec<f64> = self.shapes().iter().map(|shape| shape.rest_weight).collect();
        let mut pose = SkinPose::default();
        self.pose(&self.skeleton().rest_globals(), &weights, Skinning::Linear, &mut pose);
        pose
    }

    /// Computes the pose in which joints have the transforms `globals` to the body's space, and
    /// shapes the `weights`.
    ///
    /// # Panics
    /// If there are fewer `globals` than joints.
    pub fn pose(&self, globals: &[DAffine3], weights: &[f64], skinning: Skinning, pose: &mut SkinPose) {
        let SkinPose { palette, shaped, .. } = pose;
        shaped.clear();
        let active = || self.shapes().iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
        if active().next().is_some() {
            shaped.extend_from_slice(&self.parts.bound.positions);
            for (shape, &weight) in active() {
                for &(vertex, delta) in &shape.deltas {
                    shaped[vertex as usize] += delta * weight as f32;
                }
            }
        }
        self.skin().palette(globals, palette);
        pose.skinning = skinning;
    }

    /// The vertices that the bones of `pose` move, metres.
    pub fn shaped<'a>(&'a self, pose: &'a SkinPose) -> &'a [Vec3] {
        if pose.shaped.is_empty() { &self.parts.bound.positions } else { &pose.shaped }
    }

    /// Writes to `out` the places of the vertices in `pose`, metres.
    ///
    /// # Panics
    /// If it is a pose of another character.
    pub fn deform(&self, pose: &SkinPose, out: &mut Vec<Vec3>) {
        self.skin().deform(self.shaped(pose), &pose.palette, pose.skinning, out);
    }
}
