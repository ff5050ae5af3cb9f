//! Bodies: triangle meshes, signed distances, primitive solids and how they move.

mod collider;
mod mesh;
mod sdf;

pub use collider::{Attachment, Collider, ColliderFrame, Shape};
pub use mesh::{MeshError, TriMesh};
pub use sdf::{Sdf, SdfError};
