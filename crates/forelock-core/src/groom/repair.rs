//! Repair of imported grooms: removes and counts what a simulation cannot use.
//!
//! # Theory
//! A solver divides by edge lengths, so a strand needs at least two particles, all of them finite
//! and distinct. Two consecutive particles are treated as repeated if they are closer than
//! [`REPEATED_FRACTION`] of the strand's length: the direction of such a short edge is rounding
//! noise in float32.
//!
//! # Practice
//! Of repeated particles the first is kept, so the root never moves. In USC `.data` files strands
//! with a single point mean 'no strand here' and are common. A clean groom is returned unchanged,
//! without a copy.
//!
//! # Limitations
//! Strands inside a body are not repaired here, but by [`lift_out`](super::lift_out), which knows
//! the body.

use std::fmt;

use super::Groom;

/// Consecutive particles closer than this fraction of their strand's length are repeated particles.
pub const REPEATED_FRACTION: f32 = 1e-6;

/// What [`repair`] removed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct RepairReport {
    /// Strands before the repair.
    pub strands_before: usize,
    /// Particles removed because they repeat the particle before them.
    pub repeated_particles: usize,
    /// Strands from which repeated particles were removed.
    pub strands_with_repeats: usize,
    /// Strands removed because a coordinate is not finite.
    pub non_finite_strands: usize,
    /// Strands removed because their length overflows: an edge is longer than about 1.8e19 m, whose
    /// square float32 cannot hold.
    pub overlong_strands: usize,
    /// Strands removed because they have less than two particles.
    pub one_point_strands: usize,
    /// Strands removed because all their particles coincide.
    pub zero_length_strands: usize,
    /// Attributes removed because an entry is not finite or the number of entries is wrong.
    pub dropped_attributes: Vec<&'static str>,
}

impl RepairReport {
    /// Whether nothing had to be repaired.
    pub fn is_clean(&self) -> bool {
        self.repeated_particles + self.dropped_strands() == 0 && self.dropped_attributes.is_empty()
    }

    /// Number of strands removed for any reason.
    pub fn dropped_strands(&self) -> usize {
        self.non_finite_strands + self.overlong_strands + self.one_point_strands + self.zero_length_strands
    }

    /// One sentence for each kind of repair that was needed.
    pub fn sentences(&self) -> Vec<String> {
        let of = format!("of {}", self.strands_before);
        let mut sentences = Vec::new();
        let mut add = |count: usize, words: &str| {
            if count > 0 {
                let noun = if count == 1 { "strand" } else { "strands" };
                sentences.push(format!("{count} {noun} {of} {words}"));
            }
        };
        add(self.non_finite_strands, "dropped: a point is not finite");
        add(self.overlong_strands, "dropped: too long, two neighbouring points are more than 1e19 m apart");
        add(self.one_point_strands, "dropped: fewer than two points, which means 'no strand here'");
        add(self.zero_length_strands, "dropped: all points coincide");
        add(
            self.strands_with_repeats,
            &format!("had repeated points; {} points removed", self.repeated_particles),
        );
        sentences.extend(self.dropped_attributes.iter().map(|name| {
            format!("attribute `{name}` dropped: an entry is not finite, or its length is wrong")
        }));
        sentences
    }
}

impl fmt::Display for RepairReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_clean() {
            return f.write_str("nothing to repair");
        }
        f.write_str(&self.sentences().join("\n"))
    }
}

/// The result for one strand.
enum Verdict {
    Whole,
    Thinned,
    NonFinite,
    Overlong,
    OnePoint,
    ZeroLength,
}

/// Removes from `groom` what a simulation cannot use, and reports what was removed. The result may
/// have no strands; check [`Groom::strand_count`].
///
/// ```
/// # use forelock_core::groom::{Groom, repair};
/// # use glam::Vec3;
/// let groom = Groom::from_strands([vec![Vec3::ZERO, Vec3::Y], vec![Vec3::X]])?;
/// let (groom, report) = repair(groom);
/// assert_eq!((groom.strand_count(), report.one_point_strands), (1, 1));
/// # Ok::<(), forelock_core::groom::GroomError>(())
/// ```
pub fn repair(mut groom: Groom) -> (Groom, RepairReport) {
    let mut report = RepairReport { strands_before: groom.strand_count(), ..RepairReport::default() };
    drop_bad_attributes(&mut groom, &mut report);

    let mut kept: Vec<usize> = Vec::with_capacity(groom.particle_count());
    let verdicts: Vec<Verdict> = (0..groom.strand_count())
        .map(|strand| {
            let start = kept.len();
            let verdict = classify(&groom, strand, &mut kept);
            if !matches!(verdict, Verdict::Whole | Verdict::Thinned) {
                kept.truncate(start);
            }
            verdict
        })
        .collect();
    let mut thinned = 0;
    for (strand, verdict) in verdicts.iter().enumerate() {
        match verdict {
            Verdict::Whole => {}
            Verdict::Thinned => {
                report.strands_with_repeats += 1;
                thinned += groom.range(strand).len();
            }
            Verdict::NonFinite => report.non_finite_strands += 1,
            Verdict::Overlong => report.overlong_strands += 1,
            Verdict::OnePoint => report.one_point_strands += 1,
            Verdict::ZeroLength => report.zero_length_strands += 1,
        }
    }
    if report.dropped_strands() == 0 && thinned == 0 {
        return (groom, report);
    }
    let whole = groom.select(|strand| matches!(verdicts[strand], Verdict::Whole | Verdict::Thinned));
    report.repeated_particles = whole.particle_count() - kept.len();
    if thinned == 0 {
        return (whole, report);
    }
    (thin(&groom, whole, &kept), report)
}

/// Appends the particles of `strand` that are kept to `kept`.
fn classify(groom: &Groom, strand: usize, kept: &mut Vec<usize>) -> Verdict {
    let range = groom.range(strand);
    if range.len() < 2 {
        return Verdict::OnePoint;
    }
    let length = groom.length(strand);
    if !length.is_finite() {
        let points_are_finite = groom.strand(strand).iter().all(|p| p.is_finite());
        return if points_are_finite { Verdict::Overlong } else { Verdict::NonFinite };
    }
    let (root, count) = (range.start, range.len());
    let start = kept.len();
    kept.push(root);
    let mut last = groom.positions()[root];
    for particle in range.skip(1) {
        let p = groom.positions()[particle];
        if p.distance(last) > REPEATED_FRACTION * length {
            kept.push(particle);
            last = p;
        }
    }
    match kept.len() - start {
        1 => Verdict::ZeroLength,
        n if n < count => Verdict::Thinned,
        _ => Verdict::Whole,
    }
}

/// Reduces `whole`, a selection of the strands of `groom`, to the particles `kept` (indices into
/// `groom`).
fn thin(groom: &Groom, whole: Groom, kept: &[usize]) -> Groom {
    fn pick<T: Copy>(values: &[T], kept: &[usize]) -> Vec<T> {
        kept.iter().map(|&i| values[i]).collect()
    }
    let mut offsets = vec![0u32];
    let mut pinned = whole.pinned;
    let (mut next, mut from) = (0, 0);
    for strand in 0..groom.strand_count() {
        let range = groom.range(strand);
        let count_kept = kept[from..].iter().take_while(|&&i| i < range.end).count();
        if count_kept == 0 {
            continue;
        }
        if let Some(count) = pinned.as_mut().and_then(|pinned| pinned.get_mut(next)) {
            let end = range.start + usize::from(*count);
            let still = kept[from..from + count_kept].iter().filter(|&&i| i < end).count();
            *count = u16::try_from(still).unwrap_or(*count);
        }
        from += count_kept;
        next += 1;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "the result has no more particles than the source"
        )]
        offsets.push(from as u32);
    }
    Groom {
        positions: pick(&groom.positions, kept),
        strand_offsets: offsets,
        widths: groom.widths.as_deref().map(|a| pick(a, kept)),
        colours: groom.colours.as_deref().map(|a| pick(a, kept)),
        transparencies: groom.transparencies.as_deref().map(|a| pick(a, kept)),
        root_uvs: whole.root_uvs,
        pinned,
        stiffness: whole.stiffness,
        bindings: whole.bindings,
        labels: whole.labels,
    }
}

fn drop_bad_attributes(groom: &mut Groom, report: &mut RepairReport) {
    fn check<T>(
        name: &'static str,
        values: &mut Option<Vec<T>>,
        expected: usize,
        finite: impl Fn(&T) -> bool,
    ) -> Option<&'static str> {
        let good = |v: &Vec<T>| v.len() == expected && v.iter().all(&finite);
        (!values.as_ref().is_none_or(good)).then(|| {
            *values = None;
            name
        })
    }
    let (particles, strands) = (groom.particle_count(), groom.strand_count());
    let all_finite = |v: &[f32]| v.iter().all(|x| x.is_finite());
    let dropped = [
        check("widths", &mut groom.widths, particles, |w| w.is_finite()),
        check("colours", &mut groom.colours, particles, |c| all_finite(c)),
        check("transparencies", &mut groom.transparencies, particles, |t| t.is_finite()),
        check("root_uvs", &mut groom.root_uvs, strands, |uv| all_finite(uv)),
        check("pinned", &mut groom.pinned, strands, |_| true),
        check("stiffness", &mut groom.stiffness, strands, |k| k.is_finite() && *k >= 0.0),
        check("bindings", &mut groom.bindings, strands, |b| {
            all_finite(&b.barycentric) && b.distance.is_finite()
        }),
        check("ids", &mut groom.labels.ids, strands, |_| true),
        check("group_ids", &mut groom.labels.group_ids, strands, |_| true),
        check("guides", &mut groom.labels.guides, strands, |_| true),
        check("closest_guides", &mut groom.labels.closest_guides, strands, |_| true),
        check("guide_weights", &mut groom.labels.guide_weights, strands, |w| all_finite(w)),
    ];
    report.dropped_attributes.extend(dropped.into_iter().flatten());
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::groom::Labels;

    fn line(n: usize) -> Vec<Vec3> {
        (0..n).map(|i| Vec3::Y * i as f32 * 0.01).collect()
    }

    #[test]
    fn a_clean_groom_is_unchanged() {
        let groom = Groom::from_strands([line(5), line(2)]).unwrap();
        let (repaired, report) = repair(groom.clone());
        assert_eq!(repaired, groom);
        assert!(report.is_clean());
        assert_eq!(report.to_string(), "nothing to repair");
    }

    #[test]
    fn each_kind_of_defect_is_removed_and_counted() {
        let mut repeats = line(4);
        repeats.insert(1, repeats[0]);
        repeats.push(repeats[4]);
        let broken = vec![Vec3::ZERO, Vec3::new(f32::NAN, 0.0, 0.0)];
        let huge = vec![Vec3::ZERO, Vec3::splat(f32::MAX)];
        let point = vec![Vec3::ONE; 3];
        let mut groom =
            Groom::from_strands([line(3), broken, repeats, vec![], vec![Vec3::ONE], point, huge, line(2)])
                .unwrap();
        let particles = groom.particle_count();
        groom.widths = Some((0..particles).map(|i| i as f32).collect());
        groom.pinned = Some(vec![1, 1, 2, 0, 1, 1, 1, 1]);
        groom.root_uvs = Some((0..8).map(|i| [i as f32, 0.0]).collect());
        groom.transparencies = Some(vec![f32::NAN; particles]);
        groom.labels.ids = Some((0..8).collect());
        groom.labels.guides = Some(vec![true; 3]);

        let (repaired, report) = repair(groom);
        repaired.check_attributes().unwrap();
        assert_eq!(
            repaired,
            Groom {
                widths: Some(vec![0.0, 1.0, 2.0, 5.0, 7.0, 8.0, 9.0, 17.0, 18.0]),
                pinned: Some(vec![1, 1, 1]),
                root_uvs: Some(vec![[0.0, 0.0], [2.0, 0.0], [7.0, 0.0]]),
                labels: Labels { ids: Some(vec![0, 2, 7]), ..Labels::default() },
                ..Groom::from_strands([line(3), line(4), line(2)]).unwrap()
            }
        );
        let expected = RepairReport {
            strands_before: 8,
            repeated_particles: 2,
            strands_with_repeats: 1,
            non_finite_strands: 1,
            overlong_strands: 1,
            one_point_strands: 2,
            zero_length_strands: 1,
            dropped_attributes: vec!["transparencies", "guides"],
        };
        assert_eq!(report, expected);
        assert_eq!(report.sentences().len(), 7);
        assert!(report.to_string().contains("2 points removed"), "{report}");
    }

    #[test]
    fn a_far_point_is_not_called_infinite() {
        let far = vec![Vec3::ZERO, Vec3::new(0.0, -4e37, 0.0)];
        let (_, report) = repair(Groom::from_strands([far, line(2)]).unwrap());
        assert_eq!((report.non_finite_strands, report.overlong_strands), (0, 1));
        assert!(report.to_string().contains("too long"), "{report}");
    }

    #[test]
    fn a_groom_without_usable_strands_becomes_empty() {
        let (repaired, report) = repair(Groom::from_strands([vec![Vec3::ONE]]).unwrap());
        assert_eq!((repaired.strand_count(), report.one_point_strands), (0, 1));
    }

    #[test]
    fn a_second_repair_finds_nothing() {
        let mut strand = line(10);
        strand[4] = strand[3] + Vec3::X * 1e-9;
        let (once, _) = repair(Groom::from_strands([strand]).unwrap());
        assert!(repair(once).1.is_clean());
    }
}
