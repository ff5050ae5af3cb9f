//! Resampling: ends are exact, no length is added, the error bound shrinks with the count, and
//! curls are kept.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use forelock_core::groom::{Groom, ResampleError, repair, resample};
use glam::Vec3;
use proptest::prelude::*;

fn strands() -> impl Strategy<Value = Groom> {
    let point = prop::array::uniform3(-1.0f32..1.0).prop_map(Vec3::from_array);
    prop::collection::vec(prop::collection::vec(point, 2..40), 1..6)
        .prop_map(|strands| repair(Groom::from_strands(strands).unwrap()).0)
}

fn helix(n: usize, turns: f32) -> Vec<Vec3> {
    let at = |i: usize| {
        let t = i as f32 / (n - 1) as f32;
        let angle = t * turns * std::f32::consts::TAU;
        Vec3::new(0.01 * angle.cos(), -0.2 * t, 0.01 * angle.sin())
    };
    (0..n).map(at).collect()
}

fn distance_to_polyline(p: Vec3, line: &[Vec3]) -> f32 {
    let to_edge = |edge: &[Vec3]| {
        let along = edge[1] - edge[0];
        let t = ((p - edge[0]).dot(along) / along.length_squared().max(1e-30)).clamp(0.0, 1.0);
        p.distance(edge[0] + along * t)
    };
    line.windows(2).map(to_edge).fold(f32::INFINITY, f32::min)
}

/// The largest distance from a point of `truth` to the polyline `strand`.
fn deviation(truth: &[Vec3], strand: &[Vec3]) -> f32 {
    truth.iter().map(|&p| distance_to_polyline(p, strand)).fold(0.0, f32::max)
}

proptest! {
    #[test]
    fn ends_are_exact_and_counts_are_equal(groom in strands(), n in 2usize..60) {
        let out = resample(&groom, n).unwrap();
        prop_assert_eq!(out.strand_count(), groom.strand_count());
        for (before, after) in groom.strands().zip(out.strands()) {
            prop_assert_eq!(after.len(), n);
            prop_assert_eq!(after[0], before[0]);
            prop_assert_eq!(after[n - 1], before[before.len() - 1]);
        }
    }

    #[test]
    fn the_result_is_never_longer_than_its_curve_and_every_particle_is_near(groom in strands(), n in 2usize..60) {
        for s in 0..groom.strand_count() {
            let one = groom.select(|strand| strand == s);
            // So many samples are the curve itself but for 1 %, even of random zigzags.
            let length = 1.01 * resample(&one, 4000).unwrap().length(0);
            let out = resample(&one, n).unwrap();
            prop_assert!(out.length(0) <= length);
            // Any point of the curve is within half a spacing, along the curve, of a sample.
            let bound = length / (2.0 * (n - 1) as f32);
            prop_assert!(deviation(one.positions(), out.positions()) <= bound);
        }
    }

    #[test]
    fn equally_spaced_strands_are_copied_bit_for_bit(turns in 0.0f32..8.0, n in 2usize..60) {
        let groom = Groom::from_strands([helix(n, turns)]).unwrap();
        prop_assert_eq!(resample(&groom, n).unwrap(), groom);
    }
}

#[test]
fn more_particles_round_a_curl_off_where_its_polyline_cuts_corners() {
    let coarse = Groom::from_strands([helix(24, 3.0)]).unwrap();
    let truth = helix(2000, 3.0);
    let polyline = deviation(&truth, coarse.positions());
    let fine = resample(&coarse, 96).unwrap();
    let spline = deviation(&truth, fine.positions());
    assert!(spline < 0.5 * polyline, "spline {spline} m, polyline {polyline} m");
    let (kept, true_length) = (fine.length(0), Groom::from_strands([truth]).unwrap().length(0));
    assert!((kept / true_length - 1.0).abs() < 0.01, "{kept} m of {true_length} m");
}

#[test]
fn fewer_particles_keep_the_radius_of_a_curl() {
    let out = resample(&Groom::from_strands([helix(40, 4.0)]).unwrap(), 31).unwrap();
    for (i, p) in out.positions().iter().enumerate() {
        let radius = (p.x * p.x + p.z * p.z).sqrt();
        assert!((radius - 0.01).abs() < 2e-4, "particle {i} is {radius} m from the axis, not 0.01");
    }
}

#[test]
fn the_error_shrinks_with_the_square_of_the_count() {
    let truth = Groom::from_strands([helix(2000, 3.0)]).unwrap();
    let error = |n: usize| deviation(truth.positions(), resample(&truth, n).unwrap().positions());
    for n in [25, 50, 100] {
        let ratio = error(n) / error(2 * n);
        assert!((3.5..4.6).contains(&ratio), "from {n} to {} particles the error fell by {ratio}", 2 * n);
    }
}

#[test]
fn attributes_follow_the_arc_and_pins_keep_their_meaning() {
    let line: Vec<Vec3> = [0.0, 1.0, 2.0, 4.0].map(|y| Vec3::Y * y).to_vec();
    let mut groom = Groom::from_strands([line.clone(), line.clone(), line]).unwrap();
    groom.widths = Some([0.0, 1.0, 2.0, 4.0].repeat(3));
    groom.colours = Some([[0.0, 1.0, 0.5], [0.25, 1.0, 0.5], [0.5, 1.0, 0.5], [1.0, 1.0, 0.5]].repeat(3));
    groom.pinned = Some(vec![0, 1, 2]);
    groom.root_uvs = Some(vec![[0.0; 2], [0.1; 2], [0.2; 2]]);
    for (n, pinned) in [(3, vec![0, 1, 2]), (9, vec![0, 1, 3])] {
        let out = resample(&groom, n).unwrap();
        out.check_attributes().unwrap();
        assert_eq!(out.pinned, Some(pinned));
        assert_eq!(out.root_uvs, groom.root_uvs);
        for (i, p) in out.positions().iter().enumerate() {
            assert!((out.widths.as_ref().unwrap()[i] - p.y).abs() < 0.02, "particle {i}");
            assert!((out.colours.as_ref().unwrap()[i][0] - p.y / 4.0).abs() < 0.01);
            assert_eq!(out.colours.as_ref().unwrap()[i][1..], [1.0, 0.5]);
        }
    }
}

#[test]
fn what_cannot_be_resampled_is_refused() {
    let line = vec![Vec3::ZERO, Vec3::Y];
    let groom = Groom::from_strands([line.clone(), vec![Vec3::ONE]]).unwrap();
    assert_eq!(resample(&groom, 1), Err(ResampleError::TooFew(1)));
    assert_eq!(resample(&groom, 8), Err(ResampleError::NoLength(1)));
    let broken = Groom::from_strands([vec![Vec3::ZERO, Vec3::NAN]]).unwrap();
    assert_eq!(resample(&broken, 8), Err(ResampleError::NoLength(0)));
    let many = Groom::from_strands([line.clone(), line]).unwrap();
    assert!(matches!(resample(&many, usize::MAX / 2), Err(ResampleError::Groom(_))));
    assert!(matches!(resample(&many, 1 << 31), Err(ResampleError::Groom(_))));
}
