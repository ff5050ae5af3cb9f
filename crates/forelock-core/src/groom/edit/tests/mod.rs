//! Properties that every edit must have, and tests of each operation's purpose.

use std::collections::HashSet;

use glam::{UVec3, Vec3};
use proptest::prelude::*;

use super::*;
use crate::groom::grow::random::Random;
use crate::groom::{Labels, RootBinding};

/// A strand of `count` particles that curls downwards from `root`.
fn strand(root: Vec3, count: usize, seed: u64) -> Vec<Vec3> {
    let mut random = Random::new(seed, 9);
    let (step, turn) = (0.005 + 0.02 * random.unit(), 0.2 + 0.5 * random.unit());
    let mut points = vec![root];
    for i in 1..count {
        let angle = turn * i as f32;
        let direction = Vec3::new(0.4 * angle.cos(), -1.0, 0.4 * angle.sin()) + random.cube() * 0.1;
        points.push(points[i - 1] + direction.normalize() * step);
    }
    points
}

/// Strands of `counts` particles beside each other, with every attribute.
fn groom(counts: &[usize], seed: u64) -> Groom {
    let mut random = Random::new(seed, 1);
    let roots: Vec<Vec3> = counts.iter().map(|_| random.cube() * Vec3::new(0.06, 0.01, 0.06)).collect();
    let strands =
        roots.iter().zip(counts).zip(seed..).map(|((root, count), seed)| strand(*root, *count, seed));
    let mut groom = Groom::from_strands(strands).unwrap();
    let particles = groom.particle_count();
    let mut values = |count: usize| (0..count).map(|_| random.unit()).collect::<Vec<f32>>();
    groom.widths = Some(values(particles));
    groom.transparencies = Some(values(particles));
    groom.colours = Some(values(particles).into_iter().map(|v| [v, 1.0 - v, 0.5]).collect());
    groom.root_uvs = Some(values(counts.len()).into_iter().map(|v| [v, 1.0 - v]).collect());
    groom.stiffness = Some(values(counts.len()));
    groom.pinned = Some((0..counts.len()).map(|s| (s % 3) as u16).collect());
    let binding = |s| RootBinding { triangle: s as u32, barycentric: [1.0, 0.0, 0.0], distance: 0.0 };
    groom.bindings = Some((0..counts.len()).map(binding).collect());
    let strands = 0..counts.len() as i32;
    groom.labels = Labels {
        ids: Some(strands.clone().map(|s| 100 - s).collect()),
        group_ids: Some(strands.clone().map(|s| s % 3).collect()),
        guides: Some(strands.clone().map(|s| s % 4 == 0).collect()),
        closest_guides: Some(strands.clone().map(|s| [100, 96, 92 - s % 2 * 4]).collect()),
        guide_weights: Some(strands.map(|s| [1.0 / (1 + s) as f32, 0.25, 0.0]).collect()),
    };
    groom
}

/// Every operation, with parameters that have an effect. The first ones, whose number is returned,
/// keep lengths.
fn operations() -> (Vec<Operation>, usize) {
    let points = vec![Vec3::new(-0.05, -0.02, 0.0), Vec3::new(0.05, -0.03, 0.0), Vec3::new(0.1, -0.1, 0.05)];
    let keeping = vec![
        Operation::Comb(Comb { radius: 0.06, ..Comb::along(points.clone()) }),
        Operation::Attract(Pull::about(Vec3::new(0.03, -0.03, 0.0))),
        Operation::Repel(Pull::about(Vec3::new(0.01, -0.02, 0.0))),
        Operation::Curl(Curl::default()),
        Operation::Curl(Curl { kind: CurlKind::Wave, frequency: 40.0, ..Curl::default() }),
        Operation::Curl(Curl { kind: CurlKind::Roll, radius: 0.05, amount: -0.7, ..Curl::default() }),
        Operation::Straighten(Straighten::default()),
        Operation::Clump(Clump { spacing: 0.03, ..Clump::default() }),
        Operation::Smooth(Smooth { across: 0.04, ..Smooth::default() }),
    ];
    let count = keeping.len();
    let stroke = Stroke { points, radius: 0.01 };
    let others = [
        Operation::Trim(Trim { to: 0.1, by: 0.01, variation: 0.01, ..Trim::default() }),
        Operation::Cut(Cut { variation: 0.002, ..Cut::new(CutShape::Stroke(stroke)) }),
        Operation::Cut(Cut::new(CutShape::Plane(HalfSpace {
            point: Vec3::NEG_Y * 0.04,
            normal: Vec3::NEG_Y,
        }))),
        Operation::Lengthen(Lengthen { by: 0.02, factor: 1.2 }),
        Operation::Resample(Resample { particles: 12 }),
        Operation::Density(Density { factor: 0.5, ..Density::default() }),
        Operation::Density(Density { factor: 2.3, ..Density::default() }),
        Operation::Mirror(Mirror::default()),
        Operation::Mirror(Mirror {
            mode: MirrorMode::Add,
            normal: Vec3::new(1.0, 0.0, -3.0),
            ..Mirror::default()
        }),
        Operation::Mirror(Mirror { mode: MirrorMode::Flip, ..Mirror::default() }),
    ];
    (keeping.into_iter().chain(others).collect(), count)
}

/// Every bit of a groom.
fn bits(groom: &Groom) -> (Vec<u32>, Vec<u32>, String) {
    let mut rest = groom.clone();
    rest.positions_mut().fill(Vec3::ZERO);
    // `Debug` prints numbers so that they are read back to the same bits.
    (bytemuck::cast_slice(groom.positions()).to_vec(), groom.strand_offsets().to_vec(), format!("{rest:?}"))
}

/// Lengths of all edges in float64, and the change that rounding of their ends may cause.
fn edges(groom: &Groom) -> Vec<(f64, f64)> {
    let edge = |w: &[Vec3]| {
        let rounding = w[0].abs().max(w[1].abs()).max_element() * f32::EPSILON;
        (w[0].as_dvec3().distance(w[1].as_dvec3()), f64::from(rounding))
    };
    groom.strands().flat_map(|s| s.windows(2).map(edge).collect::<Vec<_>>()).collect()
}

/// Strands keep their labels; new ones have those of their source, and IDs of their own.
fn check_labels(start: &Groom, after: &Groom, report: &EditReport) {
    let sources = report.sources.iter().map(|source| source.strand as usize);
    let wanted = start.only(&sources.collect::<Vec<_>>()).labels;
    assert_eq!(after.labels.group_ids, wanted.group_ids);
    assert_eq!(after.labels.guides, wanted.guides);
    assert_eq!(after.labels.guide_weights, wanted.guide_weights);
    let ids = |labels: &Labels| labels.ids.clone().unwrap();
    let guides = |labels: &Labels| labels.closest_guides.clone().unwrap();
    for (s, source) in report.sources.iter().enumerate() {
        let is_kept = ids(&after.labels)[s] == ids(&wanted)[s];
        assert_eq!(is_kept, !source.fresh);
        assert!(source.fresh || guides(&after.labels)[s] == guides(&wanted)[s]);
    }
    let unique: HashSet<i32> = ids(&after.labels).into_iter().collect();
    assert_eq!(unique.len(), after.strand_count());
}

fn check(operation: &Operation, keeps_lengths: bool, start: &Groom) {
    let mut history = EditHistory::new(start.clone());
    let report = history.apply(&Edit::all(operation.clone()), None).unwrap();
    let after = history.groom().clone();
    after.check_attributes().unwrap();
    check_labels(start, &after, &report);
    assert!(after.positions().iter().all(|p| p.is_finite()), "{operation:?}");
    assert!(after.strands().all(|s| s.len() >= 2));
    assert_eq!(after.strand_count(), start.strand_count() + report.added - report.removed);
    assert_eq!((report.selected, report.refused), (start.strand_count(), 0));
    if keeps_lengths {
        for ((old, rounding), (new, _)) in edges(start).into_iter().zip(edges(&after)) {
            // 1e-6 of the edge, plus the rounding of float32 positions, which matters for a short
            // edge far from the origin.
            assert!((new - old).abs() <= 1e-6 * old + rounding, "{operation:?}: {old} became {new}");
        }
        for s in 0..start.strand_count() {
            let pinned = usize::from(start.pinned.as_ref().unwrap()[s]).clamp(1, start.strand(s).len());
            assert_eq!(start.strand(s)[..pinned], after.strand(s)[..pinned], "{operation:?} moved a root");
        }
    }
    if matches!(operation, Operation::Trim(_) | Operation::Cut(_)) {
        for s in 0..start.strand_count() {
            assert!(
                after.length(s) <= start.length(s) * (1.0 + 1e-6),
                "{operation:?} made strand {s} longer"
            );
            assert_eq!(after.strand(s)[0], start.strand(s)[0]);
        }
    }
    history.undo();
    assert_eq!(bits(history.groom()), bits(start), "{operation:?} undone");
    history.redo();
    assert_eq!(bits(history.groom()), bits(&after), "{operation:?} redone");
}

#[test]
fn every_operation_works_on_every_size() {
    let (operations, keeping) = operations();
    let sizes: [&[usize]; 6] = [&[7], &[2], &[2, 2, 2], &[3, 40, 2, 17, 5, 9, 2, 30], &[1000, 3], &[25; 40]];
    for (number, operation) in operations.iter().enumerate() {
        operation.validate().unwrap();
        for counts in sizes {
            check(operation, number < keeping, &groom(counts, 4));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_sequence_of_edits_is_undone_bit_for_bit(
        counts in prop::collection::vec(2usize..30, 1..12),
        seed in 0u64..1000,
        numbers in prop::collection::vec(0usize..19, 1..6),
        share in 0.0f32..1.0,
    ) {
        let start = groom(&counts, seed);
        let (operations, _) = operations();
        let mut history = EditHistory::new(start);
        let mut grooms = vec![bits(history.groom())];
        for number in numbers {
            let only = Selection { share, seed, ..Selection::default() };
            let edit = Edit { operation: operations[number].clone(), only };
            history.apply(&edit, None).unwrap();
            prop_assert!(history.groom().positions().iter().all(|p| p.is_finite()));
            history.groom().check_attributes().unwrap();
            grooms.push(bits(history.groom()));
        }
        for groom in grooms.iter().rev().skip(1) {
            history.undo().unwrap();
            prop_assert_eq!(&bits(history.groom()), groom);
        }
        prop_assert!(history.undo().is_none());
        for groom in grooms.iter().skip(1) {
            history.redo().unwrap();
            prop_assert_eq!(&bits(history.groom()), groom);
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let start = groom(&[25; 64], 2);
    for operation in operations().0 {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut groom = start.clone();
            pool.install(|| Edit::all(operation.clone()).apply(&mut groom, None)).unwrap();
            bits(&groom)
        };
        assert_eq!(with(1), with(3), "{operation:?}");
    }
}

#[test]
fn strands_that_are_not_finite_are_unchanged_and_counted() {
    for operation in operations().0 {
        let mut broken = groom(&[9, 9, 9], 1);
        broken.positions_mut()[12] = Vec3::NAN;
        let old = broken.clone();
        let report = Edit::all(operation.clone()).apply(&mut broken, None).unwrap();
        assert_eq!((report.selected, report.refused), (3, 1), "{operation:?}");
        let same =
            |a: &[Vec3]| a.iter().zip(old.strand(1)).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()));
        assert!(broken.strands().any(same), "{operation:?} lost the strand");
    }
}

#[test]
fn the_size_of_the_result_is_foreseen() {
    let start = groom(&[9; 20], 1);
    let density = |factor| Operation::Density(Density { factor, ..Density::default() });
    for operation in [density(3.0), density(0.5), Operation::Resample(Resample { particles: 40 })] {
        let mut after = start.clone();
        Edit::all(operation.clone()).apply(&mut after, None).unwrap();
        let foreseen = operation.foreseen_particles(&start);
        assert_eq!(foreseen, after.particle_count().max(start.particle_count()) as u64, "{operation:?}");
    }
}

#[test]
fn parameters_out_of_range_are_refused_by_name() {
    let curl = Curl { radius: 0.0, ..Curl::default() };
    let error = Edit::all(Operation::Curl(curl)).apply(&mut groom(&[3], 1), None).unwrap_err();
    assert_eq!(error.to_string(), "`radius` should be from 1e-6 to 1000, not 0");
    let stroke = Operation::Comb(Comb::along(vec![Vec3::ZERO; 2]));
    assert_eq!(
        stroke.validate().unwrap_err().to_string(),
        "`points` should be points that differ, not one place"
    );
    assert!(Operation::Trim(Trim { to: f32::NAN, ..Trim::default() }).validate().is_err());
}

#[test]
fn only_selected_strands_change() {
    let start = groom(&[9; 50], 3);
    let plane = HalfSpace { point: Vec3::ZERO, normal: Vec3::X };
    for invert in [false, true] {
        let only = Selection { plane: Some(plane), strands: Some([10, 40]), invert, ..Selection::default() };
        let mut groom = start.clone();
        Edit { operation: Operation::Curl(Curl::default()), only }.apply(&mut groom, None).unwrap();
        for s in 0..50 {
            let chosen = (10..40).contains(&s) && start.strand(s)[0].x >= 0.0;
            assert_eq!(groom.strand(s) != start.strand(s), chosen != invert, "strand {s}");
        }
    }
    let half = Selection { share: 0.5, ..Selection::default() }.strands(&start);
    assert!((15..35).contains(&half.iter().filter(|&&s| s).count()));
}

/// The distance field of a ball of radius 5 cm about `centre`.
fn ball(centre: Vec3) -> Sdf {
    let (cell, size) = (0.004, 64);
    let origin = centre - Vec3::splat(0.5 * cell * size as f32);
    let values = (0..size * size * size).map(|i| {
        let at = UVec3::new(i % size, i / size % size, i / size / size);
        (origin + at.as_vec3() * cell).distance(centre) - 0.05
    });
    Sdf::new(UVec3::splat(size), origin, cell, values.collect()).unwrap()
}

#[test]
fn strands_do_not_end_up_inside_the_body() {
    let sdf = ball(Vec3::NEG_Y * 0.055);
    let body = Body { sdf: &sdf, mesh: None, margin: 5e-4 };
    let roots = (0..40).map(|i| 0.15 * i as f32).map(|a| Vec3::new(0.02 * a.cos(), -0.0085, 0.02 * a.sin()));
    let outwards = |root: Vec3| (root + Vec3::Y * 0.055).normalize();
    let strands =
        roots.map(|root| (0..15).map(|i| root + outwards(root) * (0.01 * i as f32)).collect::<Vec<_>>());
    let start = Groom::from_strands(strands).unwrap();
    for operation in [
        Operation::Attract(Pull { radius: 0.3, strength: 1.0, ..Pull::about(Vec3::NEG_Y * 0.055) }),
        Operation::Comb(Comb { radius: 0.3, ..Comb::along(vec![Vec3::Y, Vec3::NEG_Y]) }),
        Operation::Density(Density { factor: 3.0, ..Density::default() }),
    ] {
        let edit = Edit::all(operation);
        let inside = |groom: &Groom| groom.positions().iter().filter(|&&p| sdf.sample(p).0 < 0.0).count();
        let mut without = start.clone();
        edit.apply(&mut without, None).unwrap();
        assert!(inside(&without) > 0, "{edit:?} must move particles inside without a body");
        let mut with = start.clone();
        let report = edit.apply(&mut with, Some(&body)).unwrap();
        assert_eq!(inside(&with), 0, "{edit:?}: {report}");
        for s in 0..start.strand_count() {
            assert_eq!(with.strand(s)[0], start.strand(s)[0], "{edit:?} moved root {s}");
        }
        for ((old, _), (new, _)) in edges(&start).into_iter().zip(edges(&with)) {
            assert!((new / old - 1.0).abs() < 2e-3, "{edit:?}: {old} became {new}");
        }
    }
}

mod purposes;
