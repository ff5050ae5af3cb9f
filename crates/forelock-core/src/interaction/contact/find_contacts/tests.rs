//! The search compared with a test of all pairs.

use super::*;
use crate::collide::impact;
use crate::lane::{LANES, Row};
use crate::pose::Pose;
use crate::strands::Strands;
use glam::Vec3;
use std::collections::BTreeSet;

/// Numbers between −1 and 1.
struct Random(u32);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
    }

    fn point(&mut self, size: f32) -> [f32; 3] {
        [size * self.next(), size * self.next(), size * self.next()]
    }
}

/// Straight strands in a ball, some with edges twenty times as long as others.
fn tangle(random: &mut Random) -> Model<f32> {
    let (mut positions, mut offsets) = (Vec::new(), vec![0u32]);
    for strand in 0..220u32 {
        let (particles, edge) = match strand % 10 {
            0 => (3, 0.08),
            1..4 => (6, 0.015),
            _ => (16, 0.004),
        };
        let (from, along) = (random.point(0.05), random.point(1.0));
        let length = along.iter().map(|x| x * x).sum::<f32>().sqrt().max(0.1);
        for i in 0..particles {
            let s = edge * (i as f32 - 0.5 * particles as f32) / length;
            positions.push([0, 1, 2].map(|c| from[c] + s * along[c]));
        }
        offsets.push(positions.len() as u32);
    }
    Model::new(&Strands::new(&positions, &offsets)).unwrap()
}

/// A frame in which two thirds of the strands have independent displacements of up to `speed`
/// metres, and all strands share a common displacement.
fn frame(model: &Model<f32>, random: &mut Random, speed: f32) -> (Displacements, MeanMotion) {
    let mut end = model.rest.clone();
    for block in &model.blocks {
        for lane in 0..block.live {
            let own = if random.next() > 0.3 { speed } else { 0.0 };
            let displacement = random.point(own);
            for place in block.range() {
                for c in 0..3 {
                    end[3 * place + c].0[lane] += displacement[c] + [0.02, 0.0, -0.01][c];
                }
            }
        }
    }
    let mut displacements = Displacements::new(model);
    displacements.record_start(model, &model.rest, &Pose::IDENTITY);
    displacements.record_end(model, &end, &Pose::IDENTITY);
    let mut mean_motion = MeanMotion::for_edges(displacements.longest);
    mean_motion.measure(model, &mut displacements, 0.0);
    (displacements, mean_motion)
}

/// The numbers of all segments.
fn segments(model: &Model<f32>) -> impl Iterator<Item = u32> {
    model
        .blocks
        .iter()
        .flat_map(|b| (b.first..b.first + b.particles - 1).map(move |place| (place, b.live)))
        .flat_map(|(place, live)| (0..live).map(move |lane| (LANES * place + lane) as u32))
}

/// Whether two segments belong to the same strand.
fn is_one_strand(displacements: &Displacements, [a, b]: [u32; 2]) -> bool {
    let [[p, lane], [q, other_lane]] = [a, b].map(|a| [a as usize / LANES, a as usize % LANES]);
    lane == other_lane && displacements.block[p] == displacements.block[q]
}

/// The contacts of all pairs with an active segment, in each slice.
fn all_pairs(
    model: &Model<f32>,
    displacements: &Displacements,
    first: Slice,
    slices: u32,
) -> BTreeSet<[u32; 2]> {
    let segments: Vec<usize> = segments(model).map(|a| a as usize).collect();
    let is_active = |a: usize| first.active.includes(a, displacements.residual_of_segment(a));
    let mut found = BTreeSet::new();
    for k in 0..slices {
        let slice = Slice { span: [k, k + 1].map(|k| k as f32 / slices as f32), ..first };
        for (i, &a) in segments.iter().enumerate() {
            for &b in &segments[..i] {
                let [p, q] = [b as u32, a as u32];
                if (is_active(a) || is_active(b)) && !is_one_strand(displacements, [p, q]) {
                    let contact = follow::follow(model, displacements, &slice, [p, q]);
                    found.extend(contact.map(|contact| contact.segments));
                }
            }
        }
    }
    found
}

#[test]
fn the_search_finds_what_all_pairs_find() {
    // With this seed some contacts only graze.
    let mut random = Random(3);
    for simd in Simd::ALL.into_iter().filter(|simd| simd.is_supported()) {
        for speed in [0.001, 0.005, 0.012, 0.001, 0.005, 0.012] {
            let model = tangle(&mut random);
            let (displacements, mean_motion) = frame(&model, &mut random, speed);
            let params = ContactParams { distance: 1e-3, budget: 1 << 20, ..ContactParams::default() };
            let mut finder = Finder::new(&model, &params, simd);
            let (slice, slices) = finder.first_slice(&model, &params, 1.0 / 60.0, &mean_motion).unwrap();
            let expected = all_pairs(&model, &displacements, slice, slices);
            finder.find(&model, &params, 1.0 / 60.0, &displacements, &mean_motion);
            let found = finder.found();
            let pairs: BTreeSet<_> = found.iter().map(|contact| contact.segments).collect();
            assert!(pairs.len() > 50, "{speed}: {} pairs", pairs.len());
            let missed = expected.difference(&pairs).count();
            assert_eq!(
                (missed, pairs.difference(&expected).count()),
                (0, 0),
                "{simd:?} {speed}: of {}",
                pairs.len()
            );
            assert!(found.len() <= pairs.len() * slices as usize, "a pair comes once a slice at most");
        }
    }
}

/// Strands side by side, every second one upside down, with long edges.
fn combed(random: &mut Random) -> Model<f32> {
    let (mut positions, mut offsets) = (Vec::new(), vec![0u32]);
    for strand in 0..40u16 {
        let (side, up) = (4e-4 * f32::from(strand), if strand % 2 == 0 { 1.0 } else { -1.0 });
        for i in 0..5u16 {
            let tilt = 1e-5 * random.next();
            positions.push([side + tilt, up * 0.032 * (f32::from(i) - 2.0), tilt]);
        }
        offsets.push(positions.len() as u32);
    }
    Model::new(&Strands::new(&positions, &offsets)).unwrap()
}

/// Of sixteen pairs that are advanced together none is ruled out that has a contact, however small
/// the contact distance is and if segments are parallel. At half the distance some are.
#[test]
fn no_pair_with_a_contact_is_ruled_out() {
    let mut random = Random(23);
    let scenes = [(tangle(&mut random), 0.012), (combed(&mut random), 0.002)];
    for (model, speed) in scenes {
        let (displacements, mean_motion) = frame(&model, &mut random, speed);
        let some = segments(&model).step_by(3).take(700);
        let some: Vec<u32> = some.collect();
        let pairs = some.iter().enumerate().flat_map(|(k, &b)| some[..k].iter().map(move |&a| [a, b]));
        let pairs: Vec<_> = pairs.filter(|&[a, b]| !is_one_strand(&displacements, [a, b])).collect();
        for (distance, simd) in [1e-6, 1e-4, 2e-3]
            .into_iter()
            .flat_map(|distance| Simd::ALL.map(|simd| (distance, simd)))
            .filter(|(_, simd)| simd.is_supported())
        {
            let params = ContactParams { distance: f64::from(distance), slip: 0.0, ..Default::default() };
            let finder = Finder::new(&model, &params, simd);
            let (slice, _) = finder.first_slice(&model, &params, 1.0 / 60.0, &mean_motion).unwrap();
            let slice = Slice { span: [0.25, 0.75], ..slice };
            let (come_near, mut paths) = (follow::come_near_for(simd), follow::Paths::default());
            let (mut contacts, mut left, mut missed) = (0, 0, [0, 0]);
            for pairs in pairs.chunks(LANES) {
                pairs.iter().enumerate().for_each(|(lane, &pair)| paths.set(lane, &displacements, pair));
                // SAFETY: the processor supports `simd`.
                let near = [1.0, 0.5].map(|part| unsafe { come_near(&paths, part * distance, slice.span) });
                for (lane, &pair) in pairs.iter().enumerate() {
                    let is_near = near.map(|near| near >> lane & 1 != 0);
                    left += usize::from(is_near[0]);
                    if follow::follow(&model, &displacements, &slice, pair).is_some() {
                        contacts += 1;
                        missed.iter_mut().zip(is_near).for_each(|(sum, is)| *sum += usize::from(!is));
                    }
                }
            }
            let found =
                format!("{simd:?}, {distance} m: {contacts} contacts, {left} left, {missed:?} missed");
            println!("{found}");
            assert_eq!(missed[0], 0, "{found}");
            assert!(4 * left < pairs.len(), "{found}");
            assert!(distance < 1e-3 || contacts > 20 && missed[1] > 0, "{found}");
        }
    }
}

/// Segments whose lines pass through each other, by exact continuous collision detection.
#[test]
fn the_search_finds_every_impact() {
    let mut random = Random(11);
    for speed in [0.002, 0.01] {
        let model = tangle(&mut random);
        let (displacements, mean_motion) = frame(&model, &mut random, speed);
        let params = ContactParams { distance: 1e-4, slip: 0.0, budget: 1 << 20, ..ContactParams::default() };
        let mut finder = Finder::new(&model, &params, Simd::Auto.resolve());
        finder.find(&model, &params, 1.0 / 60.0, &displacements, &mean_motion);
        let found: BTreeSet<_> = finder.found().iter().map(|contact| contact.segments).collect();
        let segments: Vec<u32> = segments(&model).collect();
        let (mut hits, mut missed) = (0, 0);
        for (i, &a) in segments.iter().enumerate() {
            for &b in segments[..i].iter().filter(|&&b| !is_one_strand(&displacements, [a, b])) {
                let particles = [a, a + LANES as u32, b, b + LANES as u32].map(|p| p as usize);
                let corners = |at: &dyn Fn(usize) -> Vec3| particles.map(|p| at(p).as_dvec3().to_array());
                let from = corners(&|p| displacements.start(p));
                let to = corners(&|p| displacements.end(p));
                if impact::edges(&from, &to).is_some() {
                    hits += 1;
                    missed += usize::from(!found.contains(&[a.min(b), a.max(b)]));
                }
            }
        }
        println!("{speed} m: {hits} impacts, of which {missed} are missed; {} contacts", found.len());
        assert!(hits > 30 && missed == 0);
    }
}

/// The budget keeps the contacts of the fastest approach.
#[test]
fn the_budget_keeps_the_fastest() {
    let contact = |k: u16| Contact { approach: f32::from(k * 37 % 1000), ..Contact::default() };
    let mut found: Vec<_> = (0..1000).map(contact).collect();
    keep_fastest(&mut found, 300, &mut Histogram::default());
    assert_eq!(found.len(), 300);
    let least = found.iter().map(|c| c.approach).fold(f32::INFINITY, f32::min);
    // To an eighth of a binade: 640 to 704 share a bin.
    assert!(least >= 640.0, "{least}");
}

/// Positions that are not finite or far away do not slow the search down.
#[test]
fn outliers_do_not_slow_the_search() {
    let mut random = Random(3);
    let model = tangle(&mut random);
    let mut end: Vec<Row<f32>> = model.rest.clone();
    end[0].0[0] = f32::NAN;
    end[4].0[1] = f32::INFINITY;
    end[7].0[2] = 3e18;
    end[10].0[3] = 100.0;
    let mut displacements = Displacements::new(&model);
    displacements.record_start(&model, &model.rest, &Pose::IDENTITY);
    displacements.record_end(&model, &end, &Pose::IDENTITY);
    let mut mean_motion = MeanMotion::for_edges(displacements.longest);
    mean_motion.measure(&model, &mut displacements, 0.0);
    let params = ContactParams::default();
    let mut finder = Finder::new(&model, &params, Simd::Auto.resolve());
    let started = std::time::Instant::now();
    finder.find(&model, &params, 1.0 / 60.0, &displacements, &mean_motion);
    assert!(started.elapsed().as_secs_f64() < 5.0);
    assert!(mean_motion.largest_residual.is_finite());
}
