//! What strands grow on, as the learned simulator needs it: outward normals at roots.

use forelock_core::body::{Bvh, TriMesh};
use forelock_core::groom::Groom;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// The surface that strands grow on; none for a groom without a body.
#[derive(Debug)]
pub(crate) struct Scalp(Option<Surface>);

#[derive(Debug)]
struct Surface {
    bvh: Bvh,
    triangles: Vec<[u32; 3]>,
    normals: Vec<Vec3>,
}

impl Scalp {
    pub(crate) fn new(mesh: Option<&TriMesh>) -> Self {
        Self(mesh.map(|mesh| Surface {
            bvh: Bvh::new(mesh),
            triangles: mesh.triangles.clone(),
            normals: mesh.vertex_normals(),
        }))
    }

    /// The outward normals at the roots of `groom`, one a strand: those of the nearest points of
    /// the surface, or away from `centre` where there is none. A surface turned inside out, whose
    /// normals point to `centre` on average, is turned back.
    pub(crate) fn normals(&self, groom: &Groom, centre: DVec3) -> Vec<DVec3> {
        let strands = 0..groom.strand_count();
        let root = |strand: usize| groom.strand(strand).first().copied().unwrap_or_default();
        let away = |strand: usize| (root(strand).as_dvec3() - centre).normalize_or(DVec3::Y);
        let normal = |strand: usize| {
            let found = self.0.as_ref().and_then(|surface| surface.normal(root(strand)));
            found.unwrap_or_else(|| away(strand))
        };
        let mut normals: Vec<DVec3> = strands.into_par_iter().map(normal).collect();
        let outward: f64 = normals.iter().enumerate().map(|(strand, n)| n.dot(away(strand))).sum();
        if outward < 0.0 {
            normals.iter_mut().for_each(|normal| *normal = -*normal);
        }
        normals
    }
}

impl Surface {
    /// The normal at the point nearest to `x`.
    fn normal(&self, x: Vec3) -> Option<DVec3> {
        let nearest = self.bvh.nearest(x)?;
        let corners = self.triangles[nearest.triangle as usize].map(|v| self.normals[v as usize]);
        let sum: Vec3 = corners.iter().zip(nearest.barycentric).map(|(n, weight)| *n * weight).sum();
        sum.as_dvec3().try_normalize()
    }
}
