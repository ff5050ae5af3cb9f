//! The search against all pairs.

use super::*;
use crate::lane::{LANES, Row};
use crate::pose::Pose;
use crate::strands::Strands;
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

/// Straight strands through a ball, some with edges twenty times as long as others.
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
    Model::new(&Strands { positions: &positions, offsets: &offsets, stiffness: None }).unwrap()
}

/// A frame in which a third of the strands move by up to `speed` metres, each its own way, and all swing together.
fn frame(model: &Model<f32>, random: &mut Random, speed: f32) -> (Ways, Drift) {
    let mut end = model.rest.clone();
    for block in &model.blocks {
        for lane in 0..block.live {
            let own = if random.next() > 0.3 { speed } else { 0.0 };
            let way = random.point(own);
            for place in block.range() {
                for c in 0..3 {
                    end[3 * place + c].0[lane] += way[c] + [0.02, 0.0, -0.01][c];
                }
            }
        }
    }
    let mut ways = Ways::new(model);
    ways.note_start(model, &model.rest, &Pose::IDENTITY);
    ways.note_end(model, &end, &Pose::IDENTITY);
    let mut drift = Drift::default();
    drift.measure(model, &mut ways);
    (ways, drift)
}

/// All pairs of one active segment and another, followed through each slice.
fn all_pairs(model: &Model<f32>, ways: &Ways, (first, slices): (Slice, u32)) -> BTreeSet<[u32; 2]> {
    let segments: Vec<usize> = model
        .blocks
        .iter()
        .flat_map(|b| (b.first..b.first + b.particles - 1).map(move |place| (place, b.live)))
        .flat_map(|(place, live)| (0..live).map(move |lane| LANES * place + lane))
        .collect();
    let is_active = |a: usize| first.active.has(a, ways.stray[a].max(ways.stray[a + LANES]));
    let mut found = BTreeSet::new();
    for k in 0..slices {
        let slice = Slice { span: [k, k + 1].map(|k| k as f32 / slices as f32), ..first };
        for (i, &a) in segments.iter().enumerate() {
            for &b in &segments[..i] {
                if is_active(a) || is_active(b) {
                    let contact = meet::follow(model, ways, &slice, [a as u32, b as u32]);
                    found.extend(contact.map(|contact| contact.segments));
                }
            }
        }
    }
    found
}

#[test]
fn the_search_finds_what_all_pairs_find() {
    let mut random = Random(7);
    for simd in Simd::ALL.into_iter().filter(|simd| simd.is_supported()) {
        for speed in [0.001, 0.005, 0.012] {
            let model = tangle(&mut random);
            let (ways, drift) = frame(&model, &mut random, speed);
            let params = ContactParams { distance: 1e-3, budget: 1 << 20, ..ContactParams::default() };
            let mut finder = Finder::new(&model, &params, simd);
            let slices = finder.first_slice(&model, (&params, 1.0 / 60.0), &drift).unwrap();
            let expected = all_pairs(&model, &ways, slices);
            let found = finder.find(&model, (&params, 1.0 / 60.0), &ways, &drift);
            let pairs: BTreeSet<_> = found.iter().map(|contact| contact.segments).collect();
            assert!(pairs.len() > 50, "{speed}: {} pairs", pairs.len());
            let missed = expected.difference(&pairs).count();
            assert_eq!(
                (missed, pairs.difference(&expected).count()),
                (0, 0),
                "{simd:?} {speed}: of {}",
                pairs.len()
            );
            assert!(found.len() <= pairs.len() * slices.1 as usize, "a pair comes once a slice at most");
        }
    }
}

/// A budget keeps the fastest.
#[test]
fn the_fastest_stay() {
    let contact = |k: u16| Contact { approach: f32::from(k * 37 % 1000), ..Contact::default() };
    let mut found: Vec<_> = (0..1000).map(contact).collect();
    keep_fastest(&mut found, 300, &mut Histogram::default());
    assert_eq!(found.len(), 300);
    let least = found.iter().map(|c| c.approach).fold(f32::INFINITY, f32::min);
    // To an eighth of a binade: 640 to 704 share a bin.
    assert!(least >= 640.0, "{least}");
}

/// A strand that is nowhere, one infinitely far away and one as long as a street harm no one.
#[test]
fn hair_out_of_bounds_takes_no_time() {
    let mut random = Random(3);
    let model = tangle(&mut random);
    let mut end: Vec<Row<f32>> = model.rest.clone();
    end[0].0[0] = f32::NAN;
    end[4].0[1] = f32::INFINITY;
    end[7].0[2] = 3e18;
    end[10].0[3] = 100.0;
    let mut ways = Ways::new(&model);
    ways.note_start(&model, &model.rest, &Pose::IDENTITY);
    ways.note_end(&model, &end, &Pose::IDENTITY);
    let mut drift = Drift::default();
    drift.measure(&model, &mut ways);
    let params = ContactParams::default();
    let mut finder = Finder::new(&model, &params, Simd::Auto.resolve());
    let started = std::time::Instant::now();
    finder.find(&model, (&params, 1.0 / 60.0), &ways, &drift);
    assert!(started.elapsed().as_secs_f64() < 5.0);
    assert!(drift.strays.1.is_finite());
}
