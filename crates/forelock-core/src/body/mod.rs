//! Bodies: triangle meshes, signed distances, primitive solids and how they move.

mod bvh;
mod closed;
mod collider;
mod mesh;
mod sdf;
#[cfg(test)]
mod shapes_for_tests;

pub use bvh::{Bvh, Nearest};
pub use closed::{ClosedMesh, ClosingReport};
pub use collider::{Attachment, Collider, ColliderFrame, Shape};
pub use mesh::{MeshError, TriMesh};
pub use sdf::{Sdf, SdfBytesError, SdfError};
