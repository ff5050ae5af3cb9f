//! A summary of a groom in words: counts, lengths, bounding box, probable unit and anything
//! unusual.

use std::fmt;

use glam::Vec3;

use super::{Groom, Unit, repair};

/// Typical extent of the roots on a human head, in metres; used to guess the unit.
const HEAD_METRES: f64 = 0.18;
/// Factor by which the extent of a head's roots may differ from it (a child's parting, a doll's
/// wig, a cartoon).
const HEAD_TOLERANCE: f64 = 2.0;
/// Share of folded strands from which a file is probably misread: with a wrong order of bytes or
/// wrong ends of strands most of them fold; of hair that is grown or combed around a head up to 5 %
/// do.
const FOLDED_SHARE: f64 = 0.1;

/// Minimum, mean and maximum of a quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Spread {
    /// Smallest value.
    pub min: f64,
    /// Arithmetic mean.
    pub mean: f64,
    /// Largest value.
    pub max: f64,
}

impl Spread {
    /// The statistics of `values`; all zero if there are none.
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let (mut lo, mut hi, mut sum, mut count) = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0usize);
        for value in values {
            (lo, hi, sum, count) = (lo.min(value), hi.max(value), sum + value, count + 1);
        }
        if count == 0 { Self::default() } else { Self { min: lo, mean: sum / count as f64, max: hi } }
    }
}

/// The probable unit of a groom's numbers, estimated from the extent of its roots.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct UnitGuess {
    /// The unit in which the groom would have the size of hair on a head; `None` if no unit fits.
    /// [`Unit::Metre`] means that the numbers are already in metres.
    pub unit: Option<Unit>,
    /// The reason, in one sentence.
    pub reason: String,
}

/// A summary of a groom; see [`Info::of`]. Lengths are in the groom's numbers, which are metres if
/// its unit was right.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Info {
    /// Number of strands, S.
    pub strands: usize,
    /// Number of particles, P.
    pub particles: usize,
    /// Number of particles of a strand.
    pub particles_per_strand: Spread,
    /// Arc lengths of the strands.
    pub length: Spread,
    /// Smallest corner of the bounding box of all finite particles.
    pub min: Vec3,
    /// Largest corner of that box.
    pub max: Vec3,
    /// Longest side of the bounding box of the roots.
    pub root_extent: f64,
    /// Names of the attributes that are present.
    pub attributes: Vec<&'static str>,
    /// The probable unit of the numbers.
    pub unit_guess: UnitGuess,
    /// Unusual properties that the user should know before simulating the groom, one sentence each.
    pub odd: Vec<String>,
}

impl Info {
    /// Summarises `groom`.
    pub fn of(groom: &Groom) -> Self {
        let strands = groom.strand_count();
        let lengths: Vec<f64> = (0..strands).map(|s| f64::from(groom.length(s))).collect();
        let (min, max) = bounds(groom.positions().iter().copied());
        let (root_min, root_max) = bounds(groom.strands().filter_map(|s| s.first().copied()));
        let root_extent = f64::from((root_max - root_min).max_element());
        let present = [
            ("widths", groom.widths.is_some()),
            ("colours", groom.colours.is_some()),
            ("transparencies", groom.transparencies.is_some()),
            ("root UVs", groom.root_uvs.is_some()),
            ("pinned counts", groom.pinned.is_some()),
            ("stiffness", groom.stiffness.is_some()),
            ("root bindings", groom.bindings.is_some()),
            ("IDs", groom.labels.ids.is_some()),
            ("groups", groom.labels.group_ids.is_some()),
            ("guides", groom.labels.guides.is_some()),
            ("closest guides", groom.labels.closest_guides.is_some()),
            ("weights of guides", groom.labels.guide_weights.is_some()),
        ];
        let unit_guess = guess_unit(root_extent);
        let mut odd = repair(groom.clone()).1.sentences();
        odd.extend(odd_shapes(groom, &lengths));
        Self {
            strands,
            particles: groom.particle_count(),
            particles_per_strand: Spread::of((0..strands).map(|s| groom.range(s).len() as f64)),
            length: Spread::of(lengths.into_iter().filter(|length| length.is_finite())),
            min,
            max,
            root_extent,
            attributes: present.into_iter().filter_map(|(name, there)| there.then_some(name)).collect(),
            unit_guess,
            odd,
        }
    }
}

/// The bounding box of the finite points; both corners are zero if there are none.
fn bounds(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    let (lo, hi) = points
        .filter(|p| p.is_finite())
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
    if lo.x <= hi.x { (lo, hi) } else { (Vec3::ZERO, Vec3::ZERO) }
}

fn guess_unit(root_extent: f64) -> UnitGuess {
    let off = |unit: &Unit| (root_extent * unit.metres() / HEAD_METRES).ln().abs();
    let nearest = Unit::ALL.into_iter().min_by(|a, b| off(a).total_cmp(&off(b)));
    let extent = three_digits(root_extent);
    match nearest.filter(|unit| off(unit) <= HEAD_TOLERANCE.ln()) {
        Some(Unit::Metre) => UnitGuess {
            unit: Some(Unit::Metre),
            reason: format!("the roots span {extent} m; the roots on a head span 0.15 to 0.25 m"),
        },
        Some(unit) => UnitGuess {
            unit: Some(unit),
            reason: format!(
                "the roots span {extent}, which is {} m with unit `{unit}`; the roots on a head span 0.15 to \
                 0.25 m",
                three_digits(root_extent * unit.metres())
            ),
        },
        None if root_extent > 0.0 && root_extent.is_finite() => UnitGuess {
            unit: None,
            reason: format!(
                "the roots span {extent}, which is not the 0.15 to 0.25 m of a head in any known unit; a \
                 scale of {} would give this size, if the groom covers a whole head",
                three_digits(HEAD_METRES / root_extent)
            ),
        },
        None => UnitGuess {
            unit: None,
            reason: "the roots have no extent, so the unit cannot be estimated".into(),
        },
    }
}

/// Formats `x` with three significant digits, without an exponent.
fn three_digits(x: f64) -> String {
    let magnitude = if x == 0.0 || !x.is_finite() { 0.0 } else { x.abs().log10().floor() };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 300")]
    let decimals = (2.0 - magnitude).max(0.0) as usize;
    format!("{x:.decimals$}")
}

/// Unusual shapes that are not defects of the data: uneven edges, strands that fold back, strands
/// much longer than the others.
fn odd_shapes(groom: &Groom, lengths: &[f64]) -> Vec<String> {
    let mut uneven = 0;
    let mut folded = 0;
    for strand in groom.strands().filter(|s| s.len() > 2 && s.iter().all(|p| p.is_finite())) {
        let edges: Vec<Vec3> = strand.windows(2).map(|w| w[1] - w[0]).collect();
        let mean = edges.iter().map(|e| e.length()).sum::<f32>() / edges.len() as f32;
        uneven += usize::from(edges.iter().any(|e| e.length() > 10.0 * mean || e.length() < 0.01 * mean));
        folded += usize::from(edges.windows(2).any(|e| e[0].angle_between(e[1]) > 2.6));
    }
    let mut sorted: Vec<f64> = lengths.iter().copied().filter(|l| l.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let long = sorted.iter().filter(|&&l| l > 10.0 * median).count();

    let findings = [
        (
            uneven,
            "with very uneven edges (longer than 10 or shorter than 0.01 times the mean); resampling makes \
             them even",
        ),
        (
            if folded as f64 > FOLDED_SHARE * lengths.len() as f64 { folded } else { 0 },
            "that fold back by more than 150° at a particle; the file may be damaged or misinterpreted: \
             export it again",
        ),
        (long, "longer than ten times the median"),
    ];
    findings
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, words)| {
            let noun = if count == 1 { "strand" } else { "strands" };
            format!("{count} {noun} {words}")
        })
        .collect()
}

impl fmt::Display for Info {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = three_digits;
        let Spread { min, mean, max } = self.particles_per_strand;
        writeln!(f, "strands     {}", self.strands)?;
        write!(f, "particles   {}", self.particles)?;
        if min == max {
            writeln!(f, ", {min} a strand")?;
        } else {
            writeln!(f, ", {min} to {max} a strand, {mean:.1} on average")?;
        }
        let Spread { min, mean, max } = self.length;
        writeln!(f, "length      {} to {}, {} on average", digits(min), digits(max), digits(mean))?;
        let corner = |p: Vec3| p.to_array().map(|x| digits(f64::from(x))).join(" ");
        writeln!(f, "box         {}  to  {}", corner(self.min), corner(self.max))?;
        let attributes = if self.attributes.is_empty() { "none".into() } else { self.attributes.join(", ") };
        writeln!(f, "attributes  {attributes}")?;
        let unit = self.unit_guess.unit.map_or_else(|| "unknown".into(), |unit| unit.to_string());
        write!(f, "unit        {unit}: {}", self.unit_guess.reason)?;
        self.odd.iter().try_for_each(|odd| write!(f, "\nodd         {odd}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn groom(scale: f32) -> Groom {
        let strand = |x: f32, n: u8| (0..n).map(move |i| Vec3::new(x, -0.1 * f32::from(i), 0.0) * scale);
        Groom::from_strands([strand(0.0, 3).collect::<Vec<_>>(), strand(0.2, 5).collect()]).unwrap()
    }

    #[test]
    fn counts_lengths_and_box() {
        let info = Info::of(&groom(1.0));
        assert_eq!((info.strands, info.particles), (2, 8));
        assert_eq!(info.particles_per_strand, Spread { min: 3.0, mean: 4.0, max: 5.0 });
        assert!((info.length.mean - 0.3).abs() < 1e-6);
        assert_eq!((info.min, info.max), (Vec3::new(0.0, -0.4, 0.0), Vec3::new(0.2, 0.0, 0.0)));
        assert!(info.odd.is_empty(), "{:?}", info.odd);
        assert!(info.to_string().contains("3 to 5 a strand, 4.0 on average"), "{info}");
    }

    #[test]
    fn the_unit_is_estimated_from_the_roots() {
        for (scale, unit) in [
            (1.0, Some(Unit::Metre)),
            (100.0, Some(Unit::Centimetre)),
            (1000.0, Some(Unit::Millimetre)),
            (39.37, Some(Unit::Inch)),
        ] {
            let scaled = groom(scale);
            let guess = Info::of(&scaled).unit_guess;
            let near = |u: Unit| ((0.2 * f64::from(scale) * u.metres()) / 0.18).ln().abs();
            // Inches and centimetres are so close that only the nearer of the two can be expected.
            assert!(
                guess.unit.is_some_and(|g| near(g) <= unit.map_or(0.0, near) + 1e-6),
                "{scale}: {guess:?}"
            );
        }
        let none = Info::of(&groom(1e6)).unit_guess;
        assert_eq!(none.unit, None);
        assert!(none.reason.contains("a scale of 0.000000900"), "{}", none.reason);
        assert_eq!(Info::of(&Groom::default()).unit_guess.unit, None);
    }

    /// The tips of curly hair fold where growth leads them around the body, in 1 strand of 25.
    #[test]
    fn a_grown_groom_is_not_called_damaged() {
        use crate::groom::grow::{GrowParams, grow_on_head};
        let params = GrowParams { strands: 500, ..GrowParams::preset("curly").unwrap() };
        let groom = grow_on_head(&params).unwrap();
        assert_eq!(Info::of(&groom).odd, Vec::<String>::new());
    }

    #[test]
    fn unusual_shapes_are_reported() {
        let folded = vec![Vec3::ZERO, Vec3::Y, Vec3::new(0.01, 0.0, 0.0)];
        let uneven = vec![Vec3::ZERO, Vec3::Y * 1e-4, Vec3::Y, Vec3::Y * 2.0];
        let broken = vec![Vec3::ZERO, Vec3::NAN];
        let odd = Info::of(&Groom::from_strands([folded, uneven, broken]).unwrap()).odd.join("\n");
        for words in ["not finite", "uneven", "fold back"] {
            assert!(odd.contains(words), "`{words}` is missing in:\n{odd}");
        }
    }
}
