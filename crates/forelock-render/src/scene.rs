//! What a picture is made of.

use forelock_core::body::TriMesh;
use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use glam::Vec3;

use crate::camera::Camera;
use crate::colour::HairColour;
use crate::hair::MAX_PARTICLES;
use crate::image::ImageError;
use crate::light::{Ambient, Light};

/// Diameter of a human hair where the groom states none, metres.
pub const HAIR_WIDTH: f32 = 80e-6;

/// Everything in a picture; borrowed, so that drawing a simulation's frame copies nothing.
#[derive(Clone, Debug)]
pub struct Scene<'a> {
    /// Solid meshes.
    pub bodies: Vec<Body<'a>>,
    /// Groups of strands.
    pub strands: Vec<Strands<'a>>,
    /// The camera.
    pub camera: Camera,
    /// Directional lights; [`Light::studio`] gives a good set.
    pub lights: Vec<Light>,
    /// Light from all around.
    pub ambient: Ambient,
    /// What is behind everything.
    pub backdrop: Backdrop,
}

impl<'a> Scene<'a> {
    /// `bodies` and `strands` before the default backdrop, seen by `camera` under the studio lights.
    pub fn new(bodies: Vec<Body<'a>>, strands: Vec<Strands<'a>>, camera: Camera) -> Self {
        let lights = Light::studio(&camera);
        Self { bodies, strands, camera, lights, ambient: Ambient::default(), backdrop: Backdrop::default() }
    }
}

/// A mesh in the picture.
#[derive(Clone, Copy, Debug)]
pub struct Body<'a> {
    /// The mesh, metres, in its own space.
    pub mesh: &'a TriMesh,
    /// Where it stands: world from mesh.
    pub pose: Pose,
    /// Its albedo, linear RGB in 0–1.
    pub colour: Vec3,
}

impl<'a> Body<'a> {
    /// The colour of the bust: fired clay, linear RGB.
    pub const CLAY: Vec3 = Vec3::new(0.315, 0.225, 0.18);

    /// `mesh` at `pose` in [`CLAY`](Self::CLAY).
    pub fn new(mesh: &'a TriMesh, pose: Pose) -> Self {
        Self { mesh, pose, colour: Self::CLAY }
    }
}

/// A group of strands in the picture, in world space.
///
/// A strand with a non-finite particle, or with fewer than two, is left out.
#[derive(Clone, Copy, Debug)]
pub struct Strands<'a> {
    /// Particles, root first, `[P]`, metres.
    pub positions: &'a [Vec3],
    /// Where each strand starts, `[S + 1]`, the last = P.
    pub strand_offsets: &'a [u32],
    /// Diameters, `[P]`, metres; `None`: [`width`](Self::width), tapering to the tip.
    pub widths: Option<&'a [f32]>,
    /// Albedos, `[P]`, linear RGB in 0–1; `None`: [`colour`](Self::colour) with variation.
    pub colours: Option<&'a [[f32; 3]]>,
    /// Diameter where `widths` is `None`, metres.
    pub width: f32,
    /// Colour where `colours` is `None`.
    pub colour: HairColour,
}

impl<'a> Strands<'a> {
    /// Strands of the default width and `colour`.
    pub fn new(positions: &'a [Vec3], strand_offsets: &'a [u32], colour: HairColour) -> Self {
        Self { positions, strand_offsets, widths: None, colours: None, width: HAIR_WIDTH, colour }
    }

    /// A groom at rest, with its widths and colours.
    pub fn from_groom(groom: &'a Groom, colour: HairColour) -> Self {
        Self {
            widths: groom.widths.as_deref(),
            colours: groom.colours.as_deref(),
            ..Self::new(groom.positions(), groom.strand_offsets(), colour)
        }
    }

    /// Checks that offsets and attributes describe the positions.
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

/// A vertical gradient with darkened corners, linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backdrop {
    /// At the upper edge.
    pub top: Vec3,
    /// At the lower edge.
    pub bottom: Vec3,
    /// How much darker the corners are: 0 not, 1 black.
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

/// How to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Width of the picture, pixels, 1–4096, default 800.
    pub width: u32,
    /// Height of the picture, pixels, 1–4096, default 800.
    pub height: u32,
    /// Samples along each side of a pixel for the edges of bodies, 1–4, default 2; strands need none.
    pub samples: u32,
    /// Factor on the strands' widths, above 0; `None` (default) lets them stand for a full head ([`crate::hair`]).
    pub width_scale: Option<f32>,
    /// Strands drawn for each simulated one, 1–64, for display only; `None` (default): 1–4 ([`crate::hair`]).
    pub children: Option<u32>,
    /// Factor on all light, default 1, above 0.
    pub exposure: f32,
    /// Seed of the variation from strand to strand, default 1.
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
            exposure: 1.0,
            seed: 1,
        }
    }
}

/// Why a scene cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The picture's size.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A setting outside its range.
    #[error("`{name}` is {value}, outside {range}")]
    Setting {
        /// The field's name.
        name: &'static str,
        /// Its value.
        value: String,
        /// What it may be.
        range: &'static str,
    },
    /// The camera has a non-finite number, stands on its target, or its angle is not in (0, π).
    #[error("the camera is not usable: {0:?}")]
    Camera(Camera),
    /// A triangle that names a vertex that is not there.
    #[error("body {body}: triangle {triangle} names a vertex that the mesh does not have")]
    Triangle {
        /// Which of [`Scene::bodies`].
        body: usize,
        /// The triangle.
        triangle: usize,
    },
    /// Strand offsets that do not describe the positions.
    #[error("strand group {group}: the offsets do not rise to the number of particles")]
    Offsets {
        /// Which of [`Scene::strands`].
        group: usize,
    },
    /// An attribute of the wrong length.
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
    /// A strand too long to index.
    #[error("strand group {group}: strand {strand} has {particles} particles, over the limit of 1,000,000")]
    StrandLength {
        /// Which of [`Scene::strands`].
        group: usize,
        /// The strand.
        strand: usize,
        /// Its particles.
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
        if !(self.exposure > 0.0 && self.exposure.is_finite()) {
            return fail("exposure", self.exposure.to_string(), "the finite numbers above 0");
        }
        Ok(())
    }
}
