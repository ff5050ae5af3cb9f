//! The body and all other solids.

use std::borrow::Cow;
use std::sync::Arc;

use forelock_core::body::{ColliderFrame, Head, Motion, Prop, Sdf, Shape, TriMesh};
use forelock_core::pose::Pose;
use glam::DVec3;

use super::{AssetError, distance_grid, motion, neck};
use crate::scene::{ColliderSection, Scene, ShapeKind};
use crate::tessellate;

/// Cells along the longest side of a mesh collider's distance grid.
const COLLIDER_CELLS: u32 = 96;

/// What hair grows on.
#[derive(Debug)]
pub(super) struct Body {
    pub(super) mesh: Cow<'static, TriMesh>,
    /// Its distance grid, if strands collide with it.
    pub(super) sdf: Option<Arc<Sdf>>,
    pivot: Option<DVec3>,
}

impl Body {
    /// The body of `scene`, if it has one.
    pub(super) fn load(scene: &Scene) -> Result<Option<Self>, AssetError> {
        let section = &scene.body;
        let (mesh, pivot) = match section.mesh.as_str() {
            "none" => return Ok(None),
            "builtin:head" => (Cow::Borrowed(&Head::builtin().mesh), Some(Head::NECK_PIVOT.as_dvec3())),
            path => (Cow::Owned(forelock_io::read_mesh(path.as_ref(), &section.import())?), None),
        };
        let grid = || distance_grid(&mesh, &section.mesh, section.sdf_cells, "body.collide = false");
        let sdf = section.collide.then(grid).transpose()?.map(Arc::new);
        Ok(Some(Self { mesh, sdf, pivot }))
    }

    /// The point about which it turns.
    pub(super) fn pivot(&self) -> DVec3 {
        self.pivot.unwrap_or_else(|| {
            let (lo, hi) = self.mesh.bounds();
            neck(lo.as_dvec3(), hi.as_dvec3())
        })
    }
}

/// A solid and how it moves.
#[derive(Debug)]
pub(super) struct Solid {
    shape: Shape,
    friction: f64,
    on_body: bool,
    /// Where it is before its motion.
    base: Pose,
    motion: Motion,
    /// How it is drawn; the body is drawn as itself.
    pub(super) mesh: Option<TriMesh>,
}

impl Solid {
    /// World from local at `time` seconds, when the body is at `head`.
    pub(super) fn pose(&self, time: f64, head: &Pose) -> Pose {
        self.carrier(time, head).after(&self.base)
    }

    /// The solid between two `times` at which the body is at `head`.
    pub(super) fn frame(&self, times: [f64; 2], head: [Pose; 2]) -> ColliderFrame<'_> {
        let [from, to] = [0, 1].map(|end| self.carrier(times[end], &head[end]));
        ColliderFrame { shape: &self.shape, local: self.base, from, to, friction: self.friction }
    }

    /// What carries the solid: its motion, on the body or in the world.
    fn carrier(&self, time: f64, head: &Pose) -> Pose {
        let motion = self.motion.pose(time);
        if self.on_body { head.after(&motion) } else { motion }
    }
}

/// All solids of `scene`, the body first.
pub(super) fn load(scene: &Scene, body: Option<&Body>) -> Result<Vec<Solid>, AssetError> {
    let mut solids = Vec::with_capacity(scene.colliders.len() + 1);
    if let Some(sdf) = body.and_then(|body| body.sdf.as_ref()) {
        solids.push(Solid {
            shape: Shape::Sdf(sdf.clone()),
            friction: scene.body.friction,
            on_body: true,
            base: Pose::IDENTITY,
            motion: Motion::default(),
            mesh: None,
        });
    }
    for section in &scene.colliders {
        solids.push(solid(section)?);
    }
    Ok(solids)
}

fn solid(section: &ColliderSection) -> Result<Solid, AssetError> {
    let radius = section.radius.unwrap_or(0.1);
    let half_length = section.half_length.unwrap_or(0.1);
    let half_extents = DVec3::from_array(section.half_extents.unwrap_or([0.1; 3]));
    let (shape, mesh) = match section.shape {
        ShapeKind::Sphere => (Shape::Sphere { radius }, Some(tessellate::capsule(0.0, radius))),
        ShapeKind::HollowSphere => (Shape::HollowSphere { radius }, None),
        ShapeKind::Capsule => {
            (Shape::Capsule { half_length, radius }, Some(tessellate::capsule(half_length, radius)))
        }
        ShapeKind::Box => (Shape::Box { half_extents }, Some(tessellate::cuboid(half_extents.as_vec3()))),
        ShapeKind::Plane => (Shape::Plane, None),
        ShapeKind::Mesh => {
            let path = section.mesh.as_deref().unwrap_or("".as_ref());
            let mesh = forelock_io::read_mesh(path, &section.import())?;
            let name = path.display().to_string();
            let cells = section.sdf_cells.unwrap_or(COLLIDER_CELLS);
            let sdf = distance_grid(&mesh, &name, cells, "another `shape`")?;
            (Shape::Sdf(Arc::new(sdf)), Some(mesh))
        }
        ShapeKind::Hand => prop(Prop::Hand, section)?,
        ShapeKind::Comb => prop(Prop::Comb, section)?,
        ShapeKind::HoledSphere => prop(Prop::HoledSphere { radius: radius as f32 }, section)?,
    };
    let position = DVec3::from_array(section.position);
    Ok(Solid {
        shape,
        friction: section.friction,
        on_body: section.on_body,
        base: Pose::new(motion::rotation(section.rotation_degrees), position),
        motion: motion::motion(&section.motion, position)?,
        mesh,
    })
}

/// A built-in solid as a distance grid.
fn prop(prop: Prop, section: &ColliderSection) -> Result<(Shape, Option<TriMesh>), AssetError> {
    let mesh = prop.mesh();
    let cells = section.sdf_cells.unwrap_or_else(|| prop.field_nodes());
    let sdf = distance_grid(&mesh, section.shape.name(), cells, "fewer `sdf_cells`")?;
    Ok((Shape::Sdf(Arc::new(sdf)), Some(mesh)))
}
