//! Triangle meshes.

use glam::Vec3;

/// A triangle mesh in metres, y up. Triangles are counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Vertices, `[V]`, metres.
    pub positions: Vec<Vec3>,
    /// Triangles, `[T]`, indices into `positions`.
    pub triangles: Vec<[u32; 3]>,
}

/// Why arrays do not form a mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} refers to vertex {vertex}, but the mesh has {vertices} vertices")]
    Index {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex index it refers to.
        vertex: u32,
        /// Number of vertices of the mesh.
        vertices: usize,
    },
    /// The vertex of this index has a coordinate that is not finite.
    #[error("vertex {0} is not finite")]
    NonFinite(usize),
    /// There are no triangles.
    #[error("the mesh has no triangles")]
    Empty,
}

impl TriMesh {
    /// A mesh from `positions` (metres) and `triangles`.
    ///
    /// # Errors
    /// [`MeshError`] if a triangle refers to a missing vertex, a vertex is not finite, or there are
    /// no triangles.
    pub fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        if let Some(vertex) = positions.iter().position(|p| !p.is_finite()) {
            return Err(MeshError::NonFinite(vertex));
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= positions.len()) {
                return Err(MeshError::Index { triangle, vertex, vertices: positions.len() });
            }
        }
        Ok(Self { positions, triangles })
    }

    /// The three corners of a triangle, in metres.
    ///
    /// # Panics
    /// If `triangle` is out of range.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// The smallest axis-aligned box that contains all vertices: (min, max) in metres.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        self.positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)))
    }

    /// Area-weighted unit normals, one for each vertex; zero for vertices that no triangle uses.
    pub fn vertex_normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::ZERO; self.positions.len()];
        for (triangle, corners) in self.triangles.iter().enumerate() {
            let [a, b, c] = self.corners(triangle);
            let normal = (b - a).cross(c - a);
            for &v in corners {
                normals[v as usize] += normal;
            }
        }
        normals.into_iter().map(Vec3::normalize_or_zero).collect()
    }
}
