//! What growth is told.

use super::GrowError;
use crate::body::Region;

/// Parameters of procedural growth. The first block is the paper's (supplement D), with its names; the rest are ours.
///
/// "Box" below is the bounding box of the strands' roots. Every default of ours leaves the paper's formula alone.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct GrowParams {
    /// Strands in all; the paper's p_n is this over the region's triangles. Unit strands, default 10000, range 1 to 1000000; 0 is refused.
    pub strands: u32,
    /// Particles of each strand. Unit particles, default 25, range 2 to 1000; 0 and 1 are refused.
    pub vertices_per_strand: u32,
    /// Seed of all that is random. No unit, default 1; 0 is a seed like any other.
    pub seed: u64,
    /// Region of the built-in head that the hair grows on: "scalp" or "beard". Default "scalp".
    pub region: Region,
    /// Length of an edge, p_τ. Unit m, default 0.01, range above 0 to 1; 0 is refused.
    pub step: f32,
    /// Half-width of the noise added to the first direction. No unit, default 0.1, range 0 to 10; 0 grows along the normal.
    pub noise: f32,
    /// Pull downwards a particle, growing along the strand, p_γ. No unit, default 0, range 0 to 10; 0 is weightless.
    pub gravity: f32,
    /// Least share of that pull on a strand that already points up or down, p_Γ. No unit, default 0.2, range 0 to 1; 0 leaves it alone.
    pub deviation: f32,
    /// Radius of the helix vector, p_h; the paper's curliness. No unit, default 0, range 0 to 1000; 0 has no curl.
    pub helix_radius: f32,
    /// Turn of the helix vector a particle, p_freq. Unit rad, default 1, range 0 to 10; 0 does not turn.
    pub helix_frequency: f32,
    /// Share of the helix vector in each direction, p_Ω. No unit, default 0.017, range 0 to 1; 0 has no spiral.
    pub spiral: f32,
    /// Distance that particles keep from the solid. Unit m, default 0.001, range 0 to 0.1; 0 only keeps them out.
    pub margin: f32,
    /// Greatest further distance of a strand's layer over the solid, drawn for each strand. Unit m, default 0, range 0 to 1; 0 lies flat.
    pub volume: f32,
    /// Share by which strands are shorter at random. No unit, default 0, range 0 to 1; 0 makes all as long.
    pub length_variation: f32,
    /// Share by which strands are shorter where the region fades. No unit, default 0, range 0 to 1; 0 makes all as long.
    pub fade: f32,
    /// Height of a level cut, down from the box's top, over the box's height. No unit, default 0, range 0 to 10; 0 does not cut.
    pub cut: f32,
    /// Rise of the cut towards +x. No unit, default 0, range -10 to 10; 0 is level.
    pub cut_slope: f32,
    /// Share of the normal in the first direction; the rest is the comb's. No unit, default 1, range 0 to 1; 0 lies along the skin.
    pub lift: f32,
    /// The comb's direction: away from the parting, up, and to the front. No unit, default [0, 0, 0], range -10 to 10 each; 0 does not comb.
    pub comb: [f32; 3],
    /// Length over which the comb's direction holds, and on whose scale strands rise to their layer. Unit m, default 0.1, range above 0 to 10; 0 is refused.
    pub comb_length: f32,
    /// Place of the parting, from the middle towards +x, over half the box's width. No unit, default 0, range -2 to 2; 0 is the middle.
    pub parting: f32,
    /// Rate at which strands turn to hang down or to follow the comb. Unit 1/m, default 0, range 0 to 10000; 0 leaves only the paper's formula.
    pub hang: f32,
    /// Greatest slope at which strands from the front of the box hang to the front and all others to the back, so that shoulders stay free. No unit, default 0, range 0 to 10; 0 hangs straight down.
    pub sweep: f32,
    /// Point of the box, each axis 0 to 1, that strands are gathered in before they hang. No unit, default [0.5, 0.5, 0], range -5 to 5 each; used if `gather_radius` is not 0.
    pub gather: [f32; 3],
    /// Radius of the band at that point. Unit m, default 0, range 0 to 1; 0 does not gather.
    pub gather_radius: f32,
    /// Radius of the waves or curls. Unit m, default 0, range 0 to 1; 0 is straight.
    pub wave_radius: f32,
    /// Length of one wave along the strand. Unit m, default 0.05, range above 0 to 10; 0 is refused.
    pub wave_length: f32,
    /// Share of one lock's phase in the phase of its strands. No unit, default 0.8, range 0 to 1; 0 makes each strand wave by itself.
    pub wave_coherence: f32,
    /// Random change of direction a particle. No unit, default 0, range 0 to 10; 0 is smooth.
    pub frizz: f32,
    /// Mean distance of locks on the skin. Unit m, default 0.015, range above 0 to 1; 0 is refused.
    pub lock_size: f32,
    /// Share by which strands draw together to their lock at the tip. No unit, default 0, range 0 to 1; 0 has no locks.
    pub clump: f32,
    /// Share of strands that keep out of locks and stray. No unit, default 0, range 0 to 1; 0 has none.
    pub flyaways: f32,
    /// Width (diameter) of the hair at the root; it tapers to a third at the tip. Unit m, default 0.00008, range above 0 to 0.1; 0 is refused.
    pub width: f32,
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
    /// [`GrowError::Parameter`] for the first field outside its range or not a number.
    pub fn check(&self) -> Result<(), GrowError> {
        let above_zero = f32::MIN_POSITIVE;
        let ranges = [
            ("strands", self.strands as f32, 1.0, 1e6),
            ("vertices_per_strand", self.vertices_per_strand as f32, 2.0, 1e3),
            ("step", self.step, above_zero, 1.0),
            ("noise", self.noise, 0.0, 10.0),
            ("gravity", self.gravity, 0.0, 10.0),
            ("deviation", self.deviation, 0.0, 1.0),
            ("helix_radius", self.helix_radius, 0.0, 1e3),
            ("helix_frequency", self.helix_frequency, 0.0, 10.0),
            ("spiral", self.spiral, 0.0, 1.0),
            ("margin", self.margin, 0.0, 0.1),
            ("volume", self.volume, 0.0, 1.0),
            ("length_variation", self.length_variation, 0.0, 1.0),
            ("fade", self.fade, 0.0, 1.0),
            ("cut", self.cut, 0.0, 10.0),
            ("cut_slope", self.cut_slope, -10.0, 10.0),
            ("lift", self.lift, 0.0, 1.0),
            ("comb[0]", self.comb[0], -10.0, 10.0),
            ("comb[1]", self.comb[1], -10.0, 10.0),
            ("comb[2]", self.comb[2], -10.0, 10.0),
            ("comb_length", self.comb_length, above_zero, 10.0),
            ("parting", self.parting, -2.0, 2.0),
            ("hang", self.hang, 0.0, 1e4),
            ("sweep", self.sweep, 0.0, 10.0),
            ("gather[0]", self.gather[0], -5.0, 5.0),
            ("gather[1]", self.gather[1], -5.0, 5.0),
            ("gather[2]", self.gather[2], -5.0, 5.0),
            ("gather_radius", self.gather_radius, 0.0, 1.0),
            ("wave_radius", self.wave_radius, 0.0, 1.0),
            ("wave_length", self.wave_length, above_zero, 10.0),
            ("wave_coherence", self.wave_coherence, 0.0, 1.0),
            ("frizz", self.frizz, 0.0, 10.0),
            ("lock_size", self.lock_size, above_zero, 1.0),
            ("clump", self.clump, 0.0, 1.0),
            ("flyaways", self.flyaways, 0.0, 1.0),
            ("width", self.width, above_zero, 0.1),
        ];
        match ranges.into_iter().find(|&(_, value, low, high)| !(low..=high).contains(&value)) {
            Some((name, value, low, high)) => Err(GrowError::Parameter { name, value, low, high }),
            None => Ok(()),
        }
    }
}
