//! Growth of a single strand.

use glam::{Vec3, vec3};

use super::curve::Curve;
use super::guide::{Guide, TUCKED};
use super::random::{Random, mix, sin_cos};
use super::roots::Root;
use super::{Avoid, GrowParams};

/// Fraction of the comb's length over which the comb loses its effect on a strand that has left the
/// skin.
const LEAVING: f32 = 0.25;
/// Largest length in metres of the pieces in which combed strands grow.
pub(super) const PIECE: f32 = 8e-3;
/// Fraction of the comb's length over which a strand rises to half the height of its layer.
const RISING: f32 = 0.5;

/// The data that all strands of a groom share.
pub(super) struct Field<'a> {
    pub(super) params: &'a GrowParams,
    /// The solid that no particle enters.
    pub(super) body: Option<&'a Avoid<'a>>,
    /// The solid over which combed hair falls; it contains the body.
    pub(super) drape: Option<&'a Avoid<'a>>,
    /// Bounding box of the region.
    pub(super) low: Vec3,
    pub(super) high: Vec3,
}

/// The random properties of a strand.
pub(super) struct Traits {
    /// Length of the strand's edges, in metres.
    pub(super) step: f32,
    /// Whether the strand does not join a lock.
    pub(super) stray: bool,
    /// Distance of the strand's layer from the solid, in metres.
    pub(super) layer: f32,
    /// Whether the root is so deep in the drape that its strand stays under it.
    pub(super) tucked: bool,
    /// Phase of the strand's wave, in radians, and its sense of rotation.
    phase: f32,
    sense: f32,
    /// Sideways direction of the comb, −1 to 1.
    pub(super) side: f32,
    /// Whether the strand hangs in front of the shoulders.
    front: bool,
    /// The z coordinates in metres between which the strand hangs straight down.
    hang: [f32; 2],
    /// Position in the tail below the band, in band radii.
    spot: Vec3,
    random: Random,
}

impl Field<'_> {
    /// Draws the traits of the strand with index `strand`.
    pub(super) fn traits(&self, strand: usize, root: &Root) -> Traits {
        let p = self.params;
        let mut random = Random::new(p.seed, 2 * strand as u64 + 1);
        let mut lock = Random::new(mix(root.lock.key), 1);
        let stray = random.unit() < p.flyaways;
        let shorter = 1.0 - p.length_variation * (0.5 * lock.unit() + 0.5 * random.unit());
        let faded = 1.0 - p.fade * (1.0 - root.weight);
        let jitter = random.unit() - 0.5;
        let phase = std::f32::consts::TAU * (lock.unit() + (1.0 - p.wave_coherence) * jitter);
        let side = self.side(root.position, random.signed());
        let blur = lock.signed();
        let front = self.front(root.position, blur);
        let depth = self.drape.filter(|_| p.hang > 0.0).and_then(|drape| drape(root.position, 0.0));
        Traits {
            step: p.step * (shorter * faded).max(0.05),
            stray,
            layer: p.volume * random.unit() * (0.3 + 0.7 * root.weight) * if stray { 1.5 } else { 1.0 },
            tucked: depth.is_some_and(|(distance, _)| distance < -TUCKED * p.comb_length),
            phase,
            sense: if lock.unit() < 0.5 { -1.0 } else { 1.0 },
            side,
            front,
            hang: self.hang(front, blur + random.signed()),
            spot: random.cube(),
            random,
        }
    }

    /// 0 at the back of the box, 1 at its front.
    fn share_to_front(&self, x: Vec3) -> f32 {
        (x.z - self.low.z) / (self.high.z - self.low.z).max(f32::MIN_POSITIVE)
    }

    /// Sideways direction of the comb at `x`: −1 or 1 beside the parting, and smoother towards the
    /// back, where hair spreads from the crown. `jitter` in −1 to 1 blurs the parting by a few
    /// millimetres.
    fn side(&self, x: Vec3, jitter: f32) -> f32 {
        let half_width = (0.5 * (self.high.x - self.low.x)).max(f32::MIN_POSITIVE);
        let across = (x.x - 0.5 * (self.low.x + self.high.x)) / half_width - self.params.parting;
        let sharp = if across + 0.015 * jitter < 0.0 { -1.0 } else { 1.0 };
        let spread = (1.2 * across).clamp(-1.0, 1.0);
        let front = (4.0 * (self.share_to_front(x) - 0.35)).clamp(0.0, 1.0);
        spread + (sharp - spread) * front
    }

    /// Whether a strand from `x` hangs in front of the shoulders, with a border blurred by `jitter`
    /// in −1 to 1.
    fn front(&self, x: Vec3, jitter: f32) -> bool {
        self.share_to_front(x) + 0.04 * jitter > 0.52
    }

    /// The z coordinates in metres between which a strand hangs: beside the face and in front of
    /// the shoulders, or behind them. The places are blurred by `jitter` in −2 to 2.
    fn hang(&self, front: bool, jitter: f32) -> [f32; 2] {
        let shares = if front { [0.57, 0.76] } else { [-0.5, 0.05] };
        shares.map(|share| self.low.z + (self.high.z - self.low.z) * (share + 0.05 * jitter))
    }

    /// Number of pieces in which an edge of a strand grows.
    fn pieces(&self, traits: &Traits) -> usize {
        if self.params.hang > 0.0 { (traits.step / PIECE).ceil().max(1.0) as usize } else { 1 }
    }

    /// Grows a strand into `curve`.
    pub(super) fn grow(&self, root: &Root, traits: &Traits, curve: &mut Curve) {
        let p = self.params;
        let mut random = traits.random;
        let mut direction = self.first_direction(root, traits, random.cube());
        let mut gathered = p.gather_radius == 0.0;
        // The normal of the skin on which the strand lies; its length decreases as the strand
        // leaves the skin.
        let mut skin = root.normal;
        let mut across = root.normal.any_orthonormal_vector();
        let pieces = self.pieces(traits);
        let piece = traits.step / pieces as f32;
        let (mut from, mut frizz, mut sag) = (root.position, Vec3::ZERO, 0.0);
        let mut guide = Guide::new(self, root, traits);
        curve.start(from, piece);
        for i in 0..(p.vertices_per_strand as usize - 1) * pieces {
            let arc = piece * (i + 1) as f32;
            if i % pieces == 0 {
                direction = self.turn_as_paper(direction, i / pieces + 1);
                frizz = random.cube() * (p.frizz * if traits.stray { 2.0 } else { 1.0 });
            }
            if p.hang > 0.0 {
                let target = self.target(traits, from, skin, arc, &mut gathered);
                let rate = p.hang * piece;
                let unit = direction.normalize_or(root.normal);
                direction = (unit + (target - unit) * (rate / (1.0 + rate))).normalize_or(target);
            }
            let heading = self.wave(direction, &mut across, traits, arc) + frizz * direction.length();
            let heading = heading.normalize_or(root.normal);
            skin /= 1.0 + piece / (LEAVING * p.comb_length);
            let (to, gap, touched) = if p.hang > 0.0 {
                guide.glide(from, heading, piece, arc)
            } else {
                let (to, touched) = self.advance(from, from + heading * piece, traits, arc);
                (to, 0.0, touched)
            };
            if let Some(outwards) = touched {
                // From here on the strand continues along the skin, not into it.
                skin = outwards;
                direction -= outwards * direction.dot(outwards).min(0.0);
                if outwards.y > 0.2 && from.y < self.low.y {
                    sag += (piece + to.y - from.y).max(0.0);
                }
            }
            curve.push(to, sag, gap);
            from = to;
        }
    }

    /// The direction at the root: between the normal and the comb's direction. Where the comb has
    /// no direction, as in a whorl, hair stands up.
    fn first_direction(&self, root: &Root, traits: &Traits, noise: Vec3) -> Vec3 {
        let p = self.params;
        let normal = root.normal;
        let combed = if p.gather_radius > 0.0 {
            let to_band = (self.band() - root.position).normalize_or_zero();
            (to_band - normal * to_band.dot(normal)).normalize_or_zero()
        } else {
            self.comb(traits, normal)
        };
        // Where the comb has no effect, flat hair points downwards.
        let down = Vec3::NEG_Y + normal * normal.y;
        let flat = combed + down * (1.0 - combed.length());
        let whorl = (1.0 - 2.5 * flat.length()).max(0.0);
        let lift = p.lift + (1.0 - p.lift) * whorl;
        // Where hair grows thinly, it is less orderly.
        let noise = noise * (p.noise * (1.0 + 3.0 * whorl + (1.0 - root.weight)));
        (normal * lift + flat * (1.0 - p.lift) + noise).normalize_or(normal)
    }

    /// The middle of the band of a ponytail.
    fn band(&self) -> Vec3 {
        self.low + (self.high - self.low) * Vec3::from_array(self.params.gather)
    }

    /// Supplement Eqs. 4–7 in the form used here:
    /// p′ = p + g max(p_Γ, 1 − |p·ŷ|); p = p′ + p_Ω (p′ − H).
    fn turn_as_paper(&self, direction: Vec3, i: usize) -> Vec3 {
        let p = self.params;
        let index = i as f32;
        let pull = -(index - 1.0) * p.gravity;
        let bent = direction + Vec3::Y * (pull * p.deviation.max(1.0 - direction.y.abs()));
        let (sin, cos) = sin_cos(f64::from(index) * f64::from(p.helix_frequency));
        let helix = vec3(p.helix_radius * cos, 1.0, p.helix_radius * sin);
        bent + (bent - helix) * p.spiral
    }

    /// The comb's direction on skin with normal `normal`, of a length of at most 1. It points
    /// sideways only where the skin faces upwards: on the side of the head, sideways would be away
    /// from it.
    fn comb(&self, traits: &Traits, normal: Vec3) -> Vec3 {
        let aside = traits.side * (1.8 * normal.y + 0.15).clamp(0.0, 1.0);
        let comb = Vec3::from_array(self.params.comb) * vec3(aside, 1.0, 1.0);
        (comb - normal * comb.dot(normal)).clamp_length_max(1.0)
    }

    /// The distance that a strand keeps from the solid at the length `arc` from its root, which is
    /// on the skin, in metres.
    pub(super) fn margin(&self, arc: f32) -> f32 {
        self.params.margin.min(0.25 * arc)
    }

    /// How far a strand has risen to its layer at the length `arc` from its root, 0 to 1.
    pub(super) fn rise(&self, arc: f32) -> f32 {
        arc / (arc + RISING * self.params.comb_length)
    }

    /// `point`, at the length `arc` of a strand, moved by `shift` as far as it stays outside the
    /// body.
    pub(super) fn outside(&self, point: Vec3, shift: Vec3, arc: f32) -> Vec3 {
        let mut to = point + shift;
        let Some(body) = self.body else { return to };
        let margin = self.margin(arc);
        for _ in 0..8 {
            let Some((distance, outwards)) = body(to, margin) else { break };
            to += outwards * (1.05 * (margin - distance)).max(1e-6);
        }
        to
    }

    /// The direction in which a strand at `from` would continue if it bent immediately.
    fn target(&self, traits: &Traits, from: Vec3, skin: Vec3, arc: f32, gathered: &mut bool) -> Vec3 {
        let p = self.params;
        if p.gather_radius > 0.0 {
            let to_band = self.band() - from;
            *gathered |= to_band.length() < p.gather_radius.max(traits.step);
            if !*gathered {
                return to_band.normalize_or(Vec3::NEG_Y);
            }
            // Behind the band the tail stays together.
            let aside = to_band / (3.0 * p.gather_radius) + traits.spot * 0.5 + Vec3::NEG_Z;
            return (vec3(aside.x, 0.0, aside.z).clamp_length_max(0.5) + Vec3::NEG_Y).normalize();
        }
        let held = arc / p.comb_length;
        let contact = skin.length();
        let combed = self.comb(traits, skin / contact) * (contact / (1.0 + held * held * held * held));
        let hanging = vec3(0.0, -1.0, p.sweep * self.aside(traits, from));
        (combed + hanging * (1.0 - combed.length()).max(0.05)).normalize_or(Vec3::NEG_Y)
    }

    /// How strongly a strand at `from` is swept, −1 backwards to 1 forwards, until it is where it
    /// hangs down. The sweep off the shoulders starts in the lower part of the box, that off the
    /// face in the upper part.
    fn aside(&self, traits: &Traits, from: Vec3) -> f32 {
        let size = (self.high - self.low).max(Vec3::splat(f32::MIN_POSITIVE));
        let height = (from.y - self.low.y) / size.y;
        let shoulders = (0.6 - 2.5 * height).clamp(0.0, 1.0);
        let face = (3.0 - 4.0 * height).clamp(0.0, 1.0);
        let [back, front] = traits.hang.map(|z| 4.0 * (z - from.z) / size.z);
        let backwards = if traits.front { face } else { shoulders };
        shoulders * back.clamp(0.0, 1.0) + backwards * front.clamp(-1.0, 0.0)
    }

    /// The direction of a helix around `direction` with the wave's radius and length; the amplitude
    /// increases from the root. `across` is propagated along the strand without twist, so that the
    /// helix rotates only at its wave number.
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

    /// The particle at the distance of one edge from `from` towards `wanted`, moved around the
    /// solid so that it is never inside. If it was moved, the solid's normal is returned too.
    pub(super) fn advance(
        &self,
        from: Vec3,
        wanted: Vec3,
        traits: &Traits,
        arc: f32,
    ) -> (Vec3, Option<Vec3>) {
        let edge = |to: Vec3| from + (to - from).normalize_or(Vec3::NEG_Y) * traits.step;
        let mut to = edge(wanted);
        let Some(avoid) = self.body else { return (to, None) };
        let near = self.margin(arc);
        let layer = traits.layer * self.rise(arc);
        let mut touched = None;
        for attempt in 0..12 {
            // The distance of the layer is optional; staying outside is not.
            let clearance = if attempt < 3 { near + layer } else { near };
            let Some((distance, outwards)) = avoid(to, clearance) else { return (to, touched) };
            touched = Some(outwards);
            to = edge(to + outwards * (1.1 * (clearance - distance)).max(1e-6));
        }
        if avoid(to, 0.0).is_some() {
            // The corrections alternate in a crease: go straight outwards from the previous
            // particle.
            to = edge(from + avoid(from, f32::INFINITY).map_or(Vec3::Y, |(_, outwards)| outwards));
        }
        (to, touched)
    }
}
