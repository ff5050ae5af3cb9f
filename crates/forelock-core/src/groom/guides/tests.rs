//! Tests of skinning by guides.

use super::*;
use crate::groom::grow::{GrowParams, grow_on_head};

fn hair() -> Groom {
    // Hair that stands: neighbours that fall to different sides of a shoulder are no neighbours.
    let params = GrowParams { strands: 600, ..GrowParams::preset("afro").unwrap() };
    let grown = grow_on_head(&params).unwrap();
    // Different lengths and numbers of particles.
    let strands = grown.strands().enumerate().map(|(s, points)| points[..5 + s % 20].to_vec());
    Groom::from_strands(strands.collect::<Vec<_>>()).unwrap()
}

fn farthest(a: &[Vec3], b: &[Vec3]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
}

#[test]
fn skinning_is_exact_at_rest_and_for_rigid_motions() {
    let groom = hair();
    let mut skinning = Skinning::new(&groom, 40, 1).unwrap();
    let mut out = Vec::new();
    let half = std::f64::consts::PI * 0.97;
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), half);
    for pose in [Pose::IDENTITY, Pose::new(turn, DVec3::new(0.7, -0.2, 0.4))] {
        let moved = |p: &Vec3| pose.transform_point(p.as_dvec3()).as_vec3();
        let guides: Vec<Vec3> = skinning.guides().positions().iter().map(moved).collect();
        skinning.skin(&pose, &guides, &mut out);
        let expected: Vec<Vec3> = groom.positions().iter().map(moved).collect();
        // Rounding of the guides' positions to float32, 6e-8 at a metre, rotates their edges of 1
        // cm by 1e-5; a strand is centimetres away from its guide.
        assert!(farthest(&out, &expected) < 2e-6, "{} at {pose:?}", farthest(&out, &expected));
    }
}

#[test]
fn guides_and_their_neighbours_follow_the_guides() {
    let groom = hair();
    let mut skinning = Skinning::new(&groom, 40, 1).unwrap();
    // Each guide rotates about its root by a different angle.
    let mut guides = skinning.guides().clone();
    for g in 0..guides.strand_count() {
        let root = guides.strand(g)[0];
        let turn = glam::Quat::from_rotation_x(0.3 + 0.2 * root.x / 0.1);
        let range = guides.range(g);
        guides.positions_mut()[range].iter_mut().for_each(|p| *p = root + turn * (*p - root));
    }
    let mut out = Vec::new();
    skinning.skin(&Pose::IDENTITY, guides.positions(), &mut out);
    for (g, &strand) in skinning.chosen().iter().enumerate() {
        let range = groom.range(strand);
        assert!(farthest(&out[range], guides.strand(g)) < 1e-6, "guide {g}");
    }
    for s in 0..groom.strand_count() {
        let range = groom.range(s);
        let (points, rest) = (&out[range], groom.strand(s));
        assert!(points[0].distance(rest[0]) < 1e-6, "root {s} is not on the head");
        let turn = glam::Quat::from_rotation_x(0.3 + 0.2 * rest[0].x / 0.1);
        let last = rest.len() - 1;
        let expected = rest[0] + turn * (rest[last] - rest[0]);
        let swing = expected.distance(rest[last]);
        assert!(points[last].distance(expected) < 0.15 * swing + 0.01, "strand {s}");
    }
}

#[test]
fn weights_sum_to_one_and_do_not_jump() {
    let row = |n: usize, step: f32| {
        Groom::from_strands(
            (0..n).map(|i| [Vec3::X * (step * i as f32), Vec3::new(step * i as f32, -0.1, 0.0)]),
        )
        .unwrap()
    };
    let groom = row(4001, 2.5e-5);
    let skinning = Skinning::new(&groom, 12, 3).unwrap();
    let weights = |s: usize| {
        let mut all = vec![0.0f32; 12];
        skinning.follows(s).for_each(|(g, w)| all[g] += w);
        all
    };
    let mut before = weights(0);
    for s in 1..4001 {
        let now = weights(s);
        assert!((now.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        let jump = now.iter().zip(&before).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(jump < 0.02, "strand {s}: {jump}");
        before = now;
    }
}

#[test]
fn guides_cover_the_roots_evenly_and_depend_on_the_seed() {
    let groom = hair();
    let chosen = choose_guides(&groom, 50, 7);
    assert_eq!(chosen, choose_guides(&groom, 50, 7));
    assert_ne!(chosen, choose_guides(&groom, 50, 8));
    let distance = |a: usize, b: usize| groom.strand(a)[0].distance(groom.strand(b)[0]);
    let far =
        (0..600).map(|s| chosen.iter().map(|&g| distance(s, g)).fold(1.0, f32::min)).fold(0.0, f32::max);
    let pairs = chosen.iter().flat_map(|&a| chosen.iter().filter(move |&&b| b != a).map(move |&b| (a, b)));
    let apart = pairs.map(|(a, b)| distance(a, b)).fold(1.0, f32::min);
    // Gonzalez: no root is farther from a guide than guides are from each other.
    assert!(far <= apart, "{far} {apart}");
    assert_eq!(choose_guides(&groom, 1000, 1).len(), 600);
    // Many strands with the same root: no strand is selected twice.
    let same = groom.only(&[3; 9]);
    assert_eq!(choose_guides(&same, 5, 1).len(), 5);
    assert!(choose_guides(&same, 5, 1).windows(2).all(|w| w[0] < w[1]));
}

#[test]
fn any_numbers_of_guides_and_particles() {
    let one = Groom::from_strands([[Vec3::ZERO, Vec3::NEG_Y]]).unwrap();
    for count in [1, 2, 9] {
        let mut skinning = Skinning::new(&one, count, 1).unwrap();
        let mut out = Vec::new();
        skinning.skin(&Pose::IDENTITY, &[Vec3::ZERO, Vec3::X], &mut out);
        assert!(farthest(&out, &[Vec3::ZERO, Vec3::X]) < 1e-6);
    }
    assert!(matches!(Skinning::new(&one, 0, 1), Err(GuidesError::None)));
    let short = Groom::from_strands([vec![Vec3::ZERO]]).unwrap();
    assert!(matches!(Skinning::new(&short, 1, 1), Err(GuidesError::Strand(0))));
    let groom = hair();
    for count in [1, 2, 3, 4, 5, 599, 600] {
        let mut skinning = Skinning::new(&groom, count, 1).unwrap();
        let guides = skinning.guides().positions().to_vec();
        let mut out = Vec::new();
        skinning.skin(&Pose::IDENTITY, &guides, &mut out);
        assert!(farthest(&out, groom.positions()) < 1e-6, "{count} guides");
    }
}
