//! Bodies as arrays for the device.

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Mat3, Vec3};

use crate::scene::{Body, RenderError, bounds_of};
use crate::solids::unit;

/// `MeshVertex` in `place.wgsl`: a vertex in mesh space.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct MeshVertexData {
    pub position: [f32; 3],
    /// The share of the hair's colour.
    pub share: f32,
    pub normal: [f32; 3],
    pub body: u32,
    /// Its place on the built-in head.
    pub rest: [f32; 3],
    pub unused: u32,
}

/// `Placement` in `place.wgsl`: where a body is, and its colours.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct PlacementData {
    pub x_axis: [f32; 3],
    /// 1 if it has a face.
    pub has_face: f32,
    pub y_axis: [f32; 3],
    pub unused_y: u32,
    pub z_axis: [f32; 3],
    pub unused_z: u32,
    pub origin: [f32; 3],
    pub unused_origin: u32,
    pub skin: [f32; 3],
    pub unused_skin: u32,
    pub scalp: [f32; 3],
    pub unused_scalp: u32,
    pub brows: [f32; 3],
    pub unused_brows: u32,
}

/// `Vertex` in `vertex.wgsl`: a vertex in world space, which the device computes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(super) struct VertexData {
    pub position: [f32; 3],
    pub has_face: f32,
    pub normal: [f32; 3],
    pub brow_red: f32,
    pub skin: [f32; 3],
    pub brow_green: f32,
    pub rest: [f32; 3],
    pub brow_blue: f32,
}

/// Bodies, kept from one frame to the next.
#[derive(Debug, Default)]
pub(super) struct BodyArrays {
    pub vertices: Vec<MeshVertexData>,
    /// The vertices of all triangles.
    pub faces: Vec<[u32; 3]>,
    pub placements: Vec<PlacementData>,
    /// What vertices and triangles were made of.
    sources: Vec<Source>,
}

/// Which arrays are new.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct News {
    pub vertices: bool,
    pub faces: bool,
}

/// What the vertices of a body are made of.
#[derive(Debug, Default)]
struct Source {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    shares: Option<Vec<f32>>,
    rest: Option<Vec<Vec3>>,
}

impl Source {
    fn of(body: &Body<'_>) -> Self {
        Self {
            positions: body.mesh.positions.clone(),
            triangles: body.mesh.triangles.clone(),
            shares: body.scalp.map(|scalp| scalp.shares.to_vec()),
            rest: body.face.map(|face| face.rest.to_vec()),
        }
    }

    fn has_triangles_of(&self, body: &Body<'_>) -> bool {
        self.positions.len() == body.mesh.positions.len() && self.triangles == body.mesh.triangles
    }

    fn has_vertices_of(&self, body: &Body<'_>) -> bool {
        self.positions == body.mesh.positions
            && self.shares.as_deref() == body.scalp.map(|scalp| scalp.shares)
            && self.rest.as_deref() == body.face.map(|face| face.rest)
    }
}

impl BodyArrays {
    /// Makes the arrays those of `bodies`.
    pub fn update(&mut self, bodies: &[Body<'_>]) -> Result<News, RenderError> {
        let all = |has: fn(&Source, &Body<'_>) -> bool| {
            self.sources.len() == bodies.len()
                && self.sources.iter().zip(bodies).all(|(source, body)| has(source, body))
        };
        let faces = !all(Source::has_triangles_of);
        let vertices = faces || !all(Source::has_vertices_of);
        if vertices {
            bodies.iter().enumerate().try_for_each(|(index, body)| body.check(index))?;
            self.sources = bodies.iter().map(Source::of).collect();
            self.vertices.clear();
            bodies.iter().enumerate().for_each(|(index, body)| self.append_vertices(body, index as u32));
        }
        if faces {
            self.faces.clear();
            let mut first = 0;
            for body in bodies {
                self.faces.extend(body.mesh.triangles.iter().map(|corners| corners.map(|v| v + first)));
                first += body.mesh.positions.len() as u32;
            }
        }
        self.placements = bodies.iter().map(placement).collect();
        Ok(News { vertices, faces })
    }

    fn append_vertices(&mut self, body: &Body<'_>, index: u32) {
        let normals = body.mesh.vertex_normals();
        self.vertices.extend(body.mesh.positions.iter().zip(normals).enumerate().map(
            |(v, (position, normal))| MeshVertexData {
                position: position.to_array(),
                share: body.scalp.map_or(0.0, |scalp| unit(scalp.shares[v])),
                normal: normal.into(),
                body: index,
                rest: body.face.map_or(Vec3::ZERO, |face| face.rest[v]).into(),
                unused: 0,
            },
        ));
    }

    /// The smallest box around all finite vertices, world space. It is empty (min > max) if there
    /// is none, or no triangle.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let sources = if self.faces.is_empty() { &[] } else { &self.sources[..] };
        bounds_of(sources.iter().zip(&self.placements).flat_map(|(source, placement)| {
            let PlacementData { x_axis, y_axis, z_axis, origin, .. } = *placement;
            let [x, y, z, origin] = [x_axis, y_axis, z_axis, origin].map(Vec3::from);
            let pose = Affine3A::from_mat3_translation(Mat3::from_cols(x, y, z), origin);
            source.positions.iter().map(move |&p| pose.transform_point3(p)).filter(|p| p.is_finite())
        }))
    }
}

fn placement(body: &Body<'_>) -> PlacementData {
    let axes = body.pose.matrix().as_mat3();
    PlacementData {
        x_axis: axes.x_axis.into(),
        has_face: if body.face.is_some() { 1.0 } else { 0.0 },
        y_axis: axes.y_axis.into(),
        z_axis: axes.z_axis.into(),
        origin: body.pose.translation.as_vec3().into(),
        skin: body.colour.into(),
        scalp: body.scalp.map_or(Vec3::ZERO, |scalp| scalp.colour).into(),
        brows: body.face.map_or(Vec3::ZERO, |face| face.brows).into(),
        ..PlacementData::zeroed()
    }
}
