//! Parameters of procedural growth.

use super::GrowError;
use crate::body::Region;
use crate::params::check;

crate::documented! {
/// Parameters of procedural growth. The first block, down to `spiral`, has the paper's parameters
/// (supplement D) under its names; the others are additions. With the defaults of the additions,
/// growth follows the paper's formula.
///
/// "Box" below is the bounding box of the region: the triangles with vertices of positive weight.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct GrowParams {
    /// Total number of strands; the paper's p_n is this number divided by the number of triangles
    /// of the region. Unit strands, default 10000, range 1 to 1000000; 0 is refused.
    pub strands: u32,
    /// Number of particles of each strand. Unit particles, default 25, range 2 to 1000; 0 and 1 are
    /// refused.
    pub vertices_per_strand: u32,
    /// Seed of all random numbers. No unit, default 1, range 0 or more; 0 is a valid seed.
    pub seed: u64,
    /// Region of the built-in head on which the hair grows: "scalp" or "beard". Default "scalp".
    pub region: Region,
    /// Length of an edge, p_τ. Unit m, default 0.01, range 1e-5 to 1; 0 is refused.
    pub step: f32,
    /// Half-width of the noise added to the first direction. No unit, default 0.1, range 0 to 10; 0
    /// grows along the normal.
    pub noise: f32,
    /// Downward pull per particle, which increases along the strand, p_γ. No unit, default 0, range
    /// 0 to 10; 0 is weightless.
    pub gravity: f32,
    /// Smallest fraction of that pull that acts on a strand that already points up or down, p_Γ. No
    /// unit, default 0.2, range 0 to 1; 0 does not bend such a strand.
    pub deviation: f32,
    /// Radius of the helix vector, p_h; the paper's curliness. No unit, default 0, range 0 to 1000;
    /// 0 has no curl.
    pub helix_radius: f32,
    /// Rotation of the helix vector per particle, p_freq. Unit rad, default 1, range 0 to 10; 0
    /// does not rotate.
    pub helix_frequency: f32,
    /// Weight of the helix vector in each direction, p_Ω. No unit, default 0.017, range 0 to 1; 0
    /// has no spiral.
    pub spiral: f32,
    /// Distance that particles keep from the solid. Unit m, default 0.001, range 0 to 0.1; 0 only
    /// keeps them outside.
    pub margin: f32,
    /// Largest additional distance of a strand's layer from the solid; the distance is drawn at
    /// random for each strand. Unit m, default 0, range 0 to 1; 0 lies flat.
    pub volume: f32,
    /// Largest fraction by which strands are shortened at random. No unit, default 0, range 0 to 1;
    /// 0 gives all strands the same length.
    pub length_variation: f32,
    /// Fraction by which strands are shortened where the region's weight falls to 0. No unit,
    /// default 0, range 0 to 1; 0 gives all strands the same length.
    pub fade: f32,
    /// Distance of a level cut below the box's top, divided by the box's height. No unit, default
    /// 0, range 0 to 10; 0 does not cut.
    pub cut: f32,
    /// Slope of the cut towards +x. No unit, default 0, range -10 to 10; 0 is level.
    pub cut_slope: f32,
    /// Weight of the normal in the first direction; the remaining weight is that of the comb. No
    /// unit, default 1, range 0 to 1; 0 lies along the skin.
    pub lift: f32,
    /// Direction of the comb: away from the parting, upwards, to the front. No unit, default [0, 0,
    /// 0], range -10 to 10 each; 0 does not comb.
    pub comb: [f32; 3],
    /// Length over which a strand follows the comb's direction and on which strands rise to their
    /// layer. Unit m, default 0.1, range 1e-5 to 10; 0 is refused.
    pub comb_length: f32,
    /// Position of the parting: distance from the middle towards +x, divided by half the box's
    /// width. No unit, default 0, range -2 to 2; 0 is the middle.
    pub parting: f32,
    /// Rate at which strands turn downwards or to the comb's direction. Unit 1/m, default 0, range
    /// 0 to 10000; 0 leaves only the paper's formula.
    pub hang: f32,
    /// Largest slope at which strands from the front of the box hang in front of the shoulders and
    /// beside the face, and all others behind the shoulders. No unit, default 0, range 0 to 10; 0
    /// hangs straight down.
    pub sweep: f32,
    /// Point at which strands are gathered before they hang down, relative to the box: 0 to 1 on
    /// each axis is inside. No unit, default [0.5, 0.5, 0], range -5 to 5 each; used if
    /// `gather_radius` is not 0.
    pub gather: [f32; 3],
    /// Radius of the band at that point. Unit m, default 0, range 0 to 1; 0 does not gather.
    pub gather_radius: f32,
    /// Radius of the waves or curls. Unit m, default 0, range 0 to 1; 0 is straight.
    pub wave_radius: f32,
    /// Length of one wave along the strand. Unit m, default 0.05, range 1e-5 to 10; 0 is refused.
    pub wave_length: f32,
    /// Weight of the lock's common phase in the phases of its strands. No unit, default 0.8, range
    /// 0 to 1; 0 gives each strand an independent phase.
    pub wave_coherence: f32,
    /// Random change of direction at each particle. No unit, default 0, range 0 to 10; 0 is smooth.
    pub frizz: f32,
    /// Mean distance of locks on the skin. Unit m, default 0.015, range 1e-5 to 1; 0 is refused.
    pub lock_size: f32,
    /// Fraction by which tips move towards the middle strand of their lock. No unit, default 0,
    /// range 0 to 1; 0 has no locks.
    pub clump: f32,
    /// Fraction of strands that do not join locks but stray. No unit, default 0, range 0 to 1; 0
    /// has none.
    pub flyaways: f32,
    /// Width (diameter) of the hair at the root; it tapers to a third at the tip, and to 30 % where
    /// the region's weight falls to 0. Unit m, default 0.00008, range 1e-7 to 0.1; 0 is refused.
    pub width: f32,
}
}

impl Default for GrowParams {
    fn default() -> Self {
        Self {
            strands: 10_000,
            vertices_per_strand: 25,
            seed: 1,
            region: Region::Scalp,
            step: 0.01,
            noise: 0.1,
            gravity: 0.0,
            deviation: 0.2,
            helix_radius: 0.0,
            helix_frequency: 1.0,
            spiral: 0.017,
            margin: 1e-3,
            volume: 0.0,
            length_variation: 0.0,
            fade: 0.0,
            cut: 0.0,
            cut_slope: 0.0,
            lift: 1.0,
            comb: [0.0; 3],
            comb_length: 0.1,
            parting: 0.0,
            hang: 0.0,
            sweep: 0.0,
            gather: [0.5, 0.5, 0.0],
            gather_radius: 0.0,
            wave_radius: 0.0,
            wave_length: 0.05,
            wave_coherence: 0.8,
            frizz: 0.0,
            lock_size: 0.015,
            clump: 0.0,
            flyaways: 0.0,
            width: 8e-5,
        }
    }
}

impl GrowParams {
    /// Checks every field against its documented range.
    ///
    /// # Errors
    /// [`GrowError::Parameter`] for the first field that is out of range or NaN.
    pub fn check(&self) -> Result<(), GrowError> {
        Ok(check::<Self, f32>(&[
            ("strands", &[self.strands as f32]),
            ("vertices_per_strand", &[self.vertices_per_strand as f32]),
            ("step", &[self.step]),
            ("noise", &[self.noise]),
            ("gravity", &[self.gravity]),
            ("deviation", &[self.deviation]),
            ("helix_radius", &[self.helix_radius]),
            ("helix_frequency", &[self.helix_frequency]),
            ("spiral", &[self.spiral]),
            ("margin", &[self.margin]),
            ("volume", &[self.volume]),
            ("length_variation", &[self.length_variation]),
            ("fade", &[self.fade]),
            ("cut", &[self.cut]),
            ("cut_slope", &[self.cut_slope]),
            ("lift", &[self.lift]),
            ("comb", &self.comb),
            ("comb_length", &[self.comb_length]),
            ("parting", &[self.parting]),
            ("hang", &[self.hang]),
            ("sweep", &[self.sweep]),
            ("gather", &self.gather),
            ("gather_radius", &[self.gather_radius]),
            ("wave_radius", &[self.wave_radius]),
            ("wave_length", &[self.wave_length]),
            ("wave_coherence", &[self.wave_coherence]),
            ("frizz", &[self.frizz]),
            ("lock_size", &[self.lock_size]),
            ("clump", &[self.clump]),
            ("flyaways", &[self.flyaways]),
            ("width", &[self.width]),
        ])?)
    }
}
