//! Bodies: triangle meshes, signed distances, primitive solids, how they move, and the built-in head.

mod bvh;
mod closed;
mod collider;
mod head;
mod mesh;
mod motion;
mod sdf;
#[cfg(test)]
pub(crate) mod shapes_for_tests;

pub use bvh::{Bvh, Nearest};
pub use closed::{ClosedMesh, ClosingReport};
pub use collider::{Attachment, Collider, ColliderFrame, PACKET, Shape};
pub use head::{Head, Region};
pub use mesh::{MeshError, TriMesh};
pub use motion::{
    BuiltinMotion, KeyframeInterpolation, Keyframes, KeyframesError, Motion, MotionKind, UnknownMotion,
};
pub use sdf::{Sdf, SdfBytesError, SdfError};
