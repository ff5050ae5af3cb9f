//! How far hair is from its rest shape, part by part.

use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use glam::Vec3;

/// Mean distance of the particles of some strands from their places at rest in the head's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Offset {
    /// Metres.
    pub metres: f64,
    /// Over the length of their strand.
    pub over_length: f64,
    /// Of the means of single strands, over their length: the median.
    pub median_over_length: f64,
    /// Share of the strands of which that mean is more than [`ELSEWHERE`].
    pub elsewhere: f64,
}

/// Mean distance over its length from which a strand lies elsewhere than at rest, for instance
/// behind an ear instead of in front of it.
pub(super) const ELSEWHERE: f64 = 0.05;

/// Strands put together.
#[derive(Clone, Debug)]
pub(super) struct Part {
    /// Its name.
    pub name: String,
    /// Its strands.
    pub strands: Vec<usize>,
}

/// The strands of `groom` by length, in thirds of equal number: shortest, middle, longest.
pub(super) fn thirds(groom: &Groom) -> [Part; 3] {
    let mut strands: Vec<usize> = (0..groom.strand_count()).collect();
    strands.sort_by(|&a, &b| groom.length(a).total_cmp(&groom.length(b)).then(a.cmp(&b)));
    let cut = |third: usize| third * strands.len() / 3;
    std::array::from_fn(|third| {
        let strands = strands[cut(third)..cut(third + 1)].to_vec();
        let mean = mean(strands.iter().map(|&strand| f64::from(groom.length(strand))));
        let which = ["shortest", "middle", "longest"][third];
        Part { name: format!("{which} third ({:.1} cm)", 100.0 * mean), strands }
    })
}

/// The mean over `strands` of the distance between particles at `positions` (world space) and where
/// `groom` has them at rest with the head at `head`.
pub(super) fn offset(groom: &Groom, strands: &[usize], head: &Pose, positions: &[Vec3]) -> Offset {
    let rest = |p: usize| head.transform_point(groom.positions()[p].as_dvec3());
    let distance = |p: usize| positions[p].as_dvec3().distance(rest(p));
    apart(groom, strands, distance)
}

/// The mean over `strands` of the distance between particles at `a` and at `b`.
pub(super) fn between(groom: &Groom, strands: &[usize], a: &[Vec3], b: &[Vec3]) -> Offset {
    apart(groom, strands, |p| f64::from(a[p].distance(b[p])))
}

fn apart(groom: &Groom, strands: &[usize], distance: impl Fn(usize) -> f64) -> Offset {
    let (mut sum, mut particles) = (Offset::default(), 0usize);
    let mut of_strands = Vec::with_capacity(strands.len());
    for &strand in strands {
        let offsets = groom.strand_offsets();
        let range = offsets[strand] as usize..offsets[strand + 1] as usize;
        let total: f64 = range.clone().map(&distance).sum();
        let over_length = total / f64::from(groom.length(strand)).max(f64::MIN_POSITIVE);
        sum.metres += total;
        sum.over_length += over_length;
        particles += range.len();
        of_strands.push(over_length / range.len().max(1) as f64);
    }
    of_strands.sort_by(f64::total_cmp);
    let count = particles.max(1) as f64;
    let elsewhere = of_strands.iter().filter(|mean| **mean > ELSEWHERE).count();
    Offset {
        metres: sum.metres / count,
        over_length: sum.over_length / count,
        median_over_length: of_strands.get(of_strands.len() / 2).copied().unwrap_or_default(),
        elsewhere: elsewhere as f64 / of_strands.len().max(1) as f64,
    }
}

/// The mean; 0 of nothing.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), value| (sum + value, count + 1));
    sum / count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    /// Strands of 1, 2, … m along y.
    fn groom(count: usize) -> Groom {
        let strand = |s: usize| vec![Vec3::ZERO, Vec3::Y * (s + 1) as f32];
        Groom::from_strands((0..count).rev().map(strand)).unwrap()
    }

    #[test]
    fn thirds_are_by_length() {
        let parts = thirds(&groom(6));
        assert_eq!(parts.each_ref().map(|part| part.strands.len()), [2; 3]);
        assert_eq!(parts[0].strands, [5, 4], "the last strands are the shortest");
        assert_eq!(parts[2].name, "longest third (550.0 cm)");
    }

    #[test]
    fn what_moves_with_the_head_is_at_rest_and_a_shift_is_its_length() {
        let groom = groom(2);
        let head = Pose::new(DQuat::from_rotation_z(1.0), DVec3::new(3.0, 0.0, 0.0));
        let moved = |shift: Vec3| -> Vec<Vec3> {
            groom.positions().iter().map(|p| head.transform_point(p.as_dvec3()).as_vec3() + shift).collect()
        };
        assert!(offset(&groom, &[0, 1], &head, &moved(Vec3::ZERO)).metres < 1e-6);
        let away = offset(&groom, &[0, 1], &head, &moved(Vec3::Z * 0.5));
        // Strands of 2 m and 1 m: a quarter and a half of their lengths.
        assert!((away.metres - 0.5).abs() < 1e-6 && (away.over_length - 0.375).abs() < 1e-6, "{away:?}");
        assert!((away.median_over_length - 0.5).abs() < 1e-6 && away.elsewhere == 1.0, "{away:?}");
        let same = between(&groom, &[1], &moved(Vec3::ZERO), &moved(Vec3::Z * 0.5));
        assert!((same.over_length - 0.5).abs() < 1e-6);
    }
}
