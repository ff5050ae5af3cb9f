//! Bodies: triangle meshes, signed distance fields, colliders, motions, characters that bend, and
//! the built-in head, horse and props.

mod bending;
mod bvh;
pub mod character;
mod closed;
mod collider;
mod depths;
mod head;
mod horse;
mod implicit;
mod mesh;
mod morph;
mod motion;
mod props;
mod sdf;
mod talker;
mod walker;

/// WGSL of solids and their distance fields.
pub const SHAPES_WGSL: &str = concat!(include_str!("shapes.wgsl"), include_str!("bending/sample.wgsl"));
#[cfg(test)]
pub(crate) mod shapes_for_tests;
mod surface_nets;

pub use bending::{BendingBody, BendingBox, BendingField, BendingLevel, STILL};
pub use bvh::{Bvh, Nearest};
pub use closed::{ClosedFaces, ClosedMesh, ClosingReport, SEGMENT_TOLERANCE_M, segment_tolerance};
pub use collider::{Attachment, Collider, ColliderFrame, FLAT_GRADIENT, PACKET, Shape};
pub use depths::Depths;
pub use head::{Features, Head, Region};
pub use horse::{Horse, Part};
pub use mesh::{MeshError, TriMesh};
pub use morph::Morph;
pub use motion::{
    BuiltinMotion, Keyframe, KeyframeInterpolation, Keyframes, KeyframesError, Motion, MotionKind,
    UnknownMotion,
};
pub use props::Prop;
pub use sdf::{BRICK_NODES, REFINEMENT, Sdf, SdfBytesError, SdfError};
pub use talker::Talker;
pub use walker::Walker;
