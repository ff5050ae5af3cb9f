//! The contents of a picture: bodies, strands, camera, lights, backdrop and settings.

use forelock_core::body::TriMesh;
use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use glam::Vec3;

use crate::camera::Camera;
use crate::colour::HairColour;
use crate::hair::MAX_PARTICLES;
use crate::image::ImageError;
use crate::light::{Ambient, Light};

/// The default diameter of a hair, used where the groom has no widths, metres.
pub const HAIR_WIDTH: f32 = 80e-6;

/// The contents of a picture. It borrows meshes and strands, so drawing a frame of a simulation
/// copies nothing.
#[derive(Clone, Debug)]
pub struct Scene<'a> {
    /// Solid meshes.
    pub bodies: Vec<Body<'a>>,
    /// Groups of strands.
    pub strands: Vec<Strands<'a>>,
    /// The camera.
    pub camera: Camera,
    /// Directional lights. [`Light::studio`] gives a useful set.
    pub lights: Vec<Light>,
    /// Ambient light.
    pub ambient: Ambient,
    /// The background.
    pub backdrop: Backdrop,
}

impl<'a> Scene<'a> {
    /// A scene of `bodies` and `strands` with the default backdrop and the studio lights.
    pub fn new(bodies: Vec<Body<'a>>, strands: Vec<Strands<'a>>, camera: Camera) -> Self {
        let lights = Light::studio(&camera);
        Self { bodies, strands, camera, lights, ambient: Ambient::default(), backdrop: Backdrop::default() }
    }

    /// Checks that a picture can be drawn, but for the bodies.
    pub(crate) fn check(&self, settings: &Settings) -> Result<(), RenderError> {
        settings.check()?;
        if !self.camera.is_valid() {
            return Err(RenderError::Camera(self.camera));
        }
        self.strands.iter().enumerate().try_for_each(|(group, strands)| strands.check(group))
    }
}

/// A mesh in the picture.
#[derive(Clone, Copy, Debug)]
pub struct Body<'a> {
    /// The mesh in mesh space, metres.
    pub mesh: &'a TriMesh,
    /// The pose: world from mesh.
    pub pose: Pose,
    /// The albedo, linear RGB in 0–1.
    pub colour: Vec3,
    /// The face that is drawn on it.
    pub face: Option<Face<'a>>,
    /// The skin under the hair.
    pub scalp: Option<Scalp<'a>>,
}

/// Eyes, brows and lips of the built-in head.
#[derive(Clone, Copy, Debug)]
pub struct Face<'a> {
    /// The vertices of the mesh in the shape of [`Head::builtin`](forelock_core::body::Head),
    /// `[V]`, metres.
    pub rest: &'a [Vec3],
    /// The albedo of the brows, linear RGB in 0–1.
    pub brows: Vec3,
}

/// Skin that hair grows on: it shows the hair's colour between the roots.
#[derive(Clone, Copy, Debug)]
pub struct Scalp<'a> {
    /// The share of the hair's colour at each vertex, 0–1, `[V]`.
    pub shares: &'a [f32],
    /// The albedo of the hair, linear RGB in 0–1.
    pub colour: Vec3,
}

impl<'a> Body<'a> {
    /// The default colour: fired clay, linear RGB.
    pub const CLAY: Vec3 = Vec3::new(0.315, 0.225, 0.18);

    /// `mesh` at `pose` in [`CLAY`](Self::CLAY).
    pub fn new(mesh: &'a TriMesh, pose: Pose) -> Self {
        Self { mesh, pose, colour: Self::CLAY, face: None, scalp: None }
    }

    /// Checks that triangles and attributes of body number `index` match its vertices.
    pub(crate) fn check(&self, index: usize) -> Result<(), RenderError> {
        let vertices = self.mesh.positions.len();
        let bad = |corners: &[u32; 3]| corners.iter().any(|&v| v as usize >= vertices);
        if let Some(triangle) = self.mesh.triangles.iter().position(bad) {
            return Err(RenderError::Triangle { body: index, triangle });
        }
        let lengths = [
            ("face.rest", self.face.map(|face| face.rest.len())),
            ("scalp.shares", self.scalp.map(|scalp| scalp.shares.len())),
        ];
        for (name, found) in lengths {
            if let Some(found) = found.filter(|found| *found != vertices) {
                return Err(RenderError::VertexAttribute { body: index, name, expected: vertices, found });
            }
        }
        Ok(())
    }
}

/// A group of strands in the picture, in world space.
///
/// Strands with a non-finite particle or fewer than two particles are not drawn.
#[derive(Clone, Copy, Debug)]
pub struct Strands<'a> {
    /// Particles, root first, `[P]`, metres.
    pub positions: &'a [Vec3],
    /// The index of each strand's first particle, and P at the end, `[S + 1]`.
    pub strand_offsets: &'a [u32],
    /// Diameters, `[P]`, metres. With `None` the diameter is [`width`](Self::width), tapering to
    /// the tip.
    pub widths: Option<&'a [f32]>,
    /// Albedos, `[P]`, linear RGB in 0–1. With `None` the albedo is that of
    /// [`colour`](Self::colour), with variation.
    pub colours: Option<&'a [[f32; 3]]>,
    /// The diameter if `widths` is `None`, metres.
    pub width: f32,
    /// The colour if `colours` is `None`.
    pub colour: HairColour,
}

impl<'a> Strands<'a> {
    /// Strands of the default width, with the colour `colour`.
    pub fn new(positions: &'a [Vec3], strand_offsets: &'a [u32], colour: HairColour) -> Self {
        Self { positions, strand_offsets, widths: None, colours: None, width: HAIR_WIDTH, colour }
    }

    /// The strands of a groom at rest, with its widths and colours.
    pub fn from_groom(groom: &'a Groom, colour: HairColour) -> Self {
        Self {
            widths: groom.widths.as_deref(),
            colours: groom.colours.as_deref(),
            ..Self::new(groom.positions(), groom.strand_offsets(), colour)
        }
    }

    /// Checks that offsets and attributes match the positions.
    pub(crate) fn check(&self, group: usize) -> Result<(), RenderError> {
        let particles = self.positions.len();
        let grows = self.strand_offsets.windows(2).all(|w| w[0] <= w[1]);
        if !grows || self.strand_offsets.last().is_some_and(|&last| last as usize != particles) {
            return Err(RenderError::Offsets { group });
        }
        for (strand, range) in self.strand_offsets.windows(2).enumerate() {
            let particles = (range[1] - range[0]) as usize;
            if particles > MAX_PARTICLES {
                return Err(RenderError::StrandLength { group, strand, particles });
            }
        }
        let lengths = [("widths", self.widths.map(<[_]>::len)), ("colours", self.colours.map(<[_]>::len))];
        for (name, found) in lengths {
            if let Some(found) = found.filter(|&found| found != particles) {
                return Err(RenderError::AttributeLength { group, name, expected: particles, found });
            }
        }
        Ok(())
    }
}

/// The smallest box around `points`: (min, max). It is empty (min > max) if there is none.
pub(crate) fn bounds_of(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)))
}

/// A vertical gradient with darkened corners, linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backdrop {
    /// The colour at the upper edge.
    pub top: Vec3,
    /// The colour at the lower edge.
    pub bottom: Vec3,
    /// How much darker the corners are: 0 not at all, 1 black.
    pub vignette: f32,
}

impl Default for Backdrop {
    fn default() -> Self {
        Self { top: Vec3::new(0.185, 0.20, 0.225), bottom: Vec3::new(0.085, 0.088, 0.095), vignette: 0.55 }
    }
}

impl Backdrop {
    /// The colour at (`u`, `v`), each 0–1 from the upper left, linear RGB.
    pub(crate) fn at(&self, u: f32, v: f32) -> Vec3 {
        let from_centre = ((u - 0.5) * (u - 0.5) + (v - 0.5) * (v - 0.5)) * 2.0;
        self.top.lerp(self.bottom, v * v * (3.0 - 2.0 * v)) * (1.0 - self.vignette * from_centre)
    }
}

/// Settings of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Width of the picture, pixels, 1–4096, default 800.
    pub width: u32,
    /// Height of the picture, pixels, 1–4096, default 800.
    pub height: u32,
    /// Samples along each side of a pixel for the edges of bodies, 1–4, default 2. Strands are not
    /// sampled. The GPU renderer always takes 2.
    pub samples: u32,
    /// Factor for the widths of strands, above 0. With `None` (default) it is chosen so that the
    /// strands represent full hair ([`crate::hair`]).
    pub width_scale: Option<f32>,
    /// Strands drawn for each simulated strand, 1–64. With `None` (default) the number is chosen
    /// from 1–4 ([`crate::hair`]).
    pub children: Option<u32>,
    /// The width below which fewer strands are drawn, wider in proportion, pixels, 0–4, default
    /// 1/8 ([`crate::hair`]).
    pub thinnest: f32,
    /// Factor for all light, above 0, default 1.
    pub exposure: f32,
    /// Seed of the variation between strands, default 1.
    pub seed: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            width: 800,
            height: 800,
            samples: 2,
            width_scale: None,
            children: None,
            thinnest: 0.125,
            exposure: 1.0,
            seed: 1,
        }
    }
}

/// Why a scene cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The size of the picture is invalid.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A setting is outside its range.
    #[error("`{name}` is {value}, outside {range}")]
    Setting {
        /// The name of the field.
        name: &'static str,
        /// Its value.
        value: String,
        /// The allowed values.
        range: &'static str,
    },
    /// The camera has a non-finite number, its eye equals its target, or its field of view is not
    /// in (0, π).
    #[error("the camera is not usable: {0:?}")]
    Camera(Camera),
    /// A triangle refers to a vertex that does not exist.
    #[error("body {body}: triangle {triangle} refers to a vertex that the mesh does not have")]
    Triangle {
        /// The index in [`Scene::bodies`].
        body: usize,
        /// The index of the triangle.
        triangle: usize,
    },
    /// An attribute of a body's vertices has the wrong length.
    #[error("body {body}: `{name}` has {found} entries, but there are {expected} vertices")]
    VertexAttribute {
        /// The index in [`Scene::bodies`].
        body: usize,
        /// The field's name.
        name: &'static str,
        /// Entries it should have.
        expected: usize,
        /// Entries it has.
        found: usize,
    },
    /// The offsets of strands do not match the positions.
    #[error("strand group {group}: the offsets do not rise to the number of particles")]
    Offsets {
        /// Which of [`Scene::strands`].
        group: usize,
    },
    /// An attribute has the wrong length.
    #[error("strand group {group}: `{name}` has {found} entries, but there are {expected} particles")]
    AttributeLength {
        /// Which of [`Scene::strands`].
        group: usize,
        /// The field's name.
        name: &'static str,
        /// Entries it should have.
        expected: usize,
        /// Entries it has.
        found: usize,
    },
    /// A strand has too many particles.
    #[error("strand group {group}: strand {strand} has {particles} particles, over the limit of 1,000,000")]
    StrandLength {
        /// Which of [`Scene::strands`].
        group: usize,
        /// The index of the strand.
        strand: usize,
        /// The number of its particles.
        particles: usize,
    },
}

impl Settings {
    pub(crate) fn check(&self) -> Result<(), RenderError> {
        crate::image::check_size(self.width, self.height)?;
        let fail = |name, value: String, range| Err(RenderError::Setting { name, value, range });
        if !(1..=4).contains(&self.samples) {
            return fail("samples", self.samples.to_string(), "1 to 4");
        }
        if let Some(scale) = self.width_scale.filter(|s| !(*s > 0.0 && s.is_finite())) {
            return fail("width_scale", scale.to_string(), "the finite numbers above 0");
        }
        if let Some(children) = self.children.filter(|n| !(1..=64).contains(n)) {
            return fail("children", children.to_string(), "1 to 64");
        }
        if !(0.0..=4.0).contains(&self.thinnest) {
            return fail("thinnest", self.thinnest.to_string(), "0 to 4");
        }
        if !(self.exposure > 0.0 && self.exposure.is_finite()) {
            return fail("exposure", self.exposure.to_string(), "the finite numbers above 0");
        }
        Ok(())
    }
}
