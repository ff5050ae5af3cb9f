//! Growth of one strand.

use glam::{Vec3, vec3};

use super::random::{Random, mix, sin_cos};
use super::roots::Root;
use super::{Avoid, GrowParams};

/// Share of the comb's length over which a strand that has left the skin forgets the comb.
const LEAVING: f32 = 0.25;
/// Share of the comb's length over which a strand rises to half its layer.
const RISING: f32 = 0.5;

/// What all strands of one growth share.
pub(super) struct Field<'a> {
    pub(super) params: &'a GrowParams,
    pub(super) avoid: Option<&'a Avoid<'a>>,
    /// Bounding box of the roots.
    pub(super) low: Vec3,
    pub(super) high: Vec3,
}

/// What is drawn once for a strand.
pub(super) struct Traits {
    /// Length of its edges, in metres.
    pub(super) step: f32,
    /// Whether it keeps out of its lock.
    pub(super) stray: bool,
    /// Distance of its layer over the solid.
    layer: f32,
    /// Phase of its wave, in radians, and the sense in which it turns.
    phase: f32,
    sense: f32,
    /// Which way the comb goes aside, −1 to 1.
    side: f32,
    /// Where it comes to hang from back to front, z in metres.
    hang_z: f32,
    /// Its place in the tail below the band, in band radii.
    spot: Vec3,
    random: Random,
}

impl Field<'_> {
    /// Draws the traits of strand number `strand`.
    pub(super) fn traits(&self, strand: usize, root: &Root) -> Traits {
        let p = self.params;
        let mut random = Random::new(p.seed, 2 * strand as u64 + 1);
        let mut lock = Random::new(mix(root.lock.key), 1);
        let stray = random.unit() < p.flyaways;
        let shorter = 1.0 - p.length_variation * (0.5 * lock.unit() + 0.5 * random.unit());
        let faded = 1.0 - p.fade * (1.0 - root.weight);
        let own = random.unit() - 0.5;
        let phase = std::f32::consts::TAU * (lock.unit() + (1.0 - p.wave_coherence) * own);
        Traits {
            step: p.step * (shorter * faded).max(0.05),
            stray,
            layer: p.volume * random.unit() * if stray { 1.5 } else { 1.0 },
            phase,
            sense: if lock.unit() < 0.5 { -1.0 } else { 1.0 },
            side: self.side(root.position, random.signed()),
            hang_z: self.hang_z(root.position, [random.signed(), random.signed()]),
            spot: random.cube(),
            random,
        }
    }

    /// 0 at the back of the box, 1 at its front.
    fn share_to_front(&self, x: Vec3) -> f32 {
        (x.z - self.low.z) / (self.high.z - self.low.z).max(f32::MIN_POSITIVE)
    }

    /// Which way the comb goes at `x`: −1 or 1 beside the parting, and less sharply towards the back, where hair
    /// spreads from the crown. `jitter` in −1 to 1 blurs the parting by a few millimetres.
    fn side(&self, x: Vec3, jitter: f32) -> f32 {
        let half_width = (0.5 * (self.high.x - self.low.x)).max(f32::MIN_POSITIVE);
        let across = (x.x - 0.5 * (self.low.x + self.high.x)) / half_width - self.params.parting;
        let sharp = if across + 0.05 * jitter < 0.0 { -1.0 } else { 1.0 };
        let spread = (1.2 * across).clamp(-1.0, 1.0);
        let front = (3.0 * (self.share_to_front(x) - 0.25)).clamp(0.0, 1.0);
        spread + (sharp - spread) * front
    }

    /// Hair from the front of the box comes to hang before the shoulders, the rest behind them.
    /// Both the border and the place are blurred by `jitter`, each in −1 to 1.
    fn hang_z(&self, x: Vec3, jitter: [f32; 2]) -> f32 {
        let front = self.share_to_front(x) + 0.08 * jitter[0] > 0.64;
        let share = if front { 0.74 } else { -0.12 } + 0.1 * jitter[1];
        self.low.z + (self.high.z - self.low.z) * share
    }

    /// Grows a strand into `out`, whose length says how many particles it has.
    pub(super) fn grow(&self, root: &Root, traits: &Traits, out: &mut [Vec3]) {
        let p = self.params;
        let mut random = traits.random;
        let combed = self.comb(traits, root.normal);
        // Where the comb says nothing, hair that lies flat lies downwards.
        let down = Vec3::NEG_Y + root.normal * root.normal.y;
        let combed = combed + down * (1.0 - combed.length());
        let mut direction = (root.normal * p.lift + combed * (1.0 - p.lift) + random.cube() * p.noise)
            .normalize_or(root.normal);
        let mut gathered = p.gather_radius == 0.0;
        // The skin that the strand lies on: its normal, scaled down the farther it has left it.
        let mut skin = root.normal;
        let mut across = root.normal.any_orthonormal_vector();
        out[0] = root.position;
        for i in 1..out.len() {
            let from = out[i - 1];
            let arc = traits.step * i as f32;
            direction = self.turn_as_paper(direction, i);
            if p.hang > 0.0 {
                let target = self.target(traits, from, skin, arc, &mut gathered);
                let rate = p.hang * traits.step;
                let unit = direction.normalize_or(root.normal);
                direction = (unit + (target - unit) * (rate / (1.0 + rate))).normalize_or(target);
            }
            let stray = if traits.stray { 2.0 } else { 1.0 };
            let frizz = random.cube() * (p.frizz * stray);
            let heading = self.wave(direction, &mut across, traits, arc) + frizz * direction.length();
            let wanted = from + heading.normalize_or(root.normal) * traits.step;
            let (to, touched) = self.advance(from, wanted, traits, arc);
            skin /= 1.0 + traits.step / (LEAVING * p.comb_length);
            if let Some(outwards) = touched {
                // Along the skin from here on, not into it.
                skin = outwards;
                if p.hang > 0.0 {
                    let went = (to - from) / traits.step;
                    direction = 0.5 * (direction - outwards * direction.dot(outwards).min(0.0) + went);
                }
            }
            out[i] = to;
        }
    }

    /// Supplement Eqs. 4–7, in the form of the design: p′ = p + g max(p_Γ, 1 − |p·ŷ|); p = p′ + p_Ω (p′ − H).
    fn turn_as_paper(&self, direction: Vec3, i: usize) -> Vec3 {
        let p = self.params;
        let index = i as f32;
        let pull = -(index - 1.0) * p.gravity;
        let bent = direction + Vec3::Y * (pull * p.deviation.max(1.0 - direction.y.abs()));
        let (sin, cos) = sin_cos(f64::from(index) * f64::from(p.helix_frequency));
        let helix = vec3(p.helix_radius * cos, 1.0, p.helix_radius * sin);
        bent + (bent - helix) * p.spiral
    }

    /// The comb's direction on a skin of normal `normal`; not longer than 1. Aside only where the skin looks up:
    /// past the side of the head, aside would be away from it.
    fn comb(&self, traits: &Traits, normal: Vec3) -> Vec3 {
        let aside = traits.side * (1.8 * normal.y + 0.15).clamp(0.0, 1.0);
        let comb = Vec3::from_array(self.params.comb) * vec3(aside, 1.0, 1.0);
        (comb - normal * comb.dot(normal)).clamp_length_max(1.0)
    }

    /// Where a strand at `from` would go if it bent at once.
    fn target(&self, traits: &Traits, from: Vec3, skin: Vec3, arc: f32, gathered: &mut bool) -> Vec3 {
        let p = self.params;
        if p.gather_radius > 0.0 {
            let band = self.low + (self.high - self.low) * Vec3::from_array(p.gather);
            let to_band = band - from;
            *gathered |= to_band.length() < p.gather_radius.max(traits.step);
            if !*gathered {
                return to_band.normalize_or(Vec3::NEG_Y);
            }
            // The tail keeps together behind the band.
            let aside = to_band / (3.0 * p.gather_radius) + traits.spot * 0.5 + Vec3::NEG_Z;
            return (vec3(aside.x, 0.0, aside.z).clamp_length_max(0.5) + Vec3::NEG_Y).normalize();
        }
        let held = arc / p.comb_length;
        let contact = skin.length();
        let combed = self.comb(traits, skin / contact) * (contact / (1.0 + held * held * held * held));
        // Sweeping starts on the way down from half the box's height, and ends at the place to hang.
        let size = (self.high - self.low).max(Vec3::splat(f32::MIN_POSITIVE));
        let below = (0.5 - (from.y - self.low.y) / size.y).clamp(0.0, 1.0);
        let aside = (5.0 * (traits.hang_z - from.z) / size.z).clamp(-1.0, 1.0);
        let hanging = vec3(0.0, -1.0, p.sweep * below * aside);
        (combed + hanging * (1.0 - combed.length()).max(0.05)).normalize_or(Vec3::NEG_Y)
    }

    /// The heading of a helix of the wave's radius and length around `direction`, which grows in from the root.
    /// `across` is carried along the strand, so that the helix turns at its own rate alone.
    fn wave(&self, direction: Vec3, across: &mut Vec3, traits: &Traits, arc: f32) -> Vec3 {
        let p = self.params;
        if p.wave_radius == 0.0 {
            return direction;
        }
        let unit = direction.normalize_or(Vec3::NEG_Y);
        *across = (*across - unit * across.dot(unit)).normalize_or(unit.any_orthonormal_vector());
        let wave_number = std::f32::consts::TAU / p.wave_length;
        let amplitude = p.wave_radius * wave_number * (arc / p.wave_length).min(1.0);
        let (sin, cos) = sin_cos(f64::from(traits.phase + traits.sense * wave_number * arc));
        unit + (*across * cos + unit.cross(*across) * sin) * amplitude
    }

    /// The particle one edge from `from` towards `wanted`, moved round the solid: never inside it. If it was moved,
    /// the solid's normal too.
    pub(super) fn advance(
        &self,
        from: Vec3,
        wanted: Vec3,
        traits: &Traits,
        arc: f32,
    ) -> (Vec3, Option<Vec3>) {
        let edge = |to: Vec3| from + (to - from).normalize_or(Vec3::NEG_Y) * traits.step;
        let mut to = edge(wanted);
        let Some(avoid) = self.avoid else { return (to, None) };
        let near = (self.params.margin).min(0.25 * arc);
        let layer = traits.layer * (arc / (arc + RISING * self.params.comb_length));
        let mut touched = None;
        for attempt in 0..12 {
            // The layer is a wish; keeping out is not.
            let clearance = if attempt < 3 { near + layer } else { near };
            let Some((distance, outwards)) = avoid(to, clearance) else { return (to, touched) };
            touched = Some(outwards);
            to = edge(to + outwards * (1.1 * (clearance - distance)).max(1e-6));
        }
        if avoid(to, 0.0).is_some() {
            // A crease that the pushes go to and fro in: straight out from the particle before.
            to = edge(from + avoid(from, f32::INFINITY).map_or(Vec3::Y, |(_, outwards)| outwards));
        }
        (to, touched)
    }
}
