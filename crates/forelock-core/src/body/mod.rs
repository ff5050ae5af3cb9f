//! Bodies: triangle meshes, signed distances, primitive solids and how they move.

mod mesh;

pub use mesh::{MeshError, TriMesh};
