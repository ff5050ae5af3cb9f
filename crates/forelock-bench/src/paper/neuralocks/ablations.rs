//! Trainings compared: Figs. 3, 4 and 6, and ablations.
//!
//! # Practice
//! All variants train the same strands and motions from the same seed for the same number of steps,
//! and the last network is measured, not the best. The reference is that of the full energies,
//! whatever a variant left out, but for style, repulsion and adhesion, which the reference lacks.

use forelock::training::Examination;
use forelock::{Observer, labelled};
use forelock_core::body::Bvh;
use forelock_core::groom::Groom;
use glam::Vec3;

use super::NeuralOptions;
use super::models::{SCORES, Trained, Variant, config, demo, mean_score, runs, score_row, score_table};
use crate::BenchError;
use crate::paper::scenes::player;
use crate::paper::study::{Strip, Study, Table, millimetres};
use forelock::{Assets, Studio};

/// Strands of a picture.
const SHOWN: f64 = 3000.0;
/// The frames of pictures: the head turns, and has turned.
const FRAMES: [u32; 2] = [40, 100];

const FULL: Variant = Variant { name: "full", label: "full", keys: &[] };
pub(super) const QUASI_STATIC: Variant =
    Variant { name: "quasi-static", label: "ours, quasi-static", keys: &["method.kind=quasi-static"] };
const NO_LOCKS: Variant =
    Variant { name: "no-locks", label: "no lock codes", keys: &["method.lock_codes=false"] };
const ADHESION: Variant = Variant { name: "adhesion", label: "+ adhesion", keys: &["energies.adhesion=2"] };

/// Everything that can be left out or exchanged.
const ALL: [Variant; 14] = [
    FULL,
    Variant { name: "no-bend", label: "no bending, no twist", keys: &["energies.bend_twist=0.001"] },
    Variant { name: "no-body", label: "no body", keys: &["energies.body=0"] },
    Variant { name: "no-drag", label: "no drag", keys: &["energies.drag=0"] },
    Variant { name: "no-drape", label: "no warm start", keys: &["steps.drape=0"] },
    Variant { label: "no inertia, no history", ..QUASI_STATIC },
    NO_LOCKS,
    Variant { name: "direct", label: "direct transport", keys: &["method.transport=direct"] },
    Variant { name: "step", label: "energy of a step", keys: &["method.objective=step"] },
    Variant { name: "displacement", label: "displacement head", keys: &["method.head=displacement"] },
    Variant {
        name: "printed",
        label: "as printed: displacements, direct, step, no drag, no warm start",
        keys: &[
            "method.head=displacement",
            "method.transport=direct",
            "method.objective=step",
            "energies.drag=0",
            "energies.tail=100",
            "energies.extra_margin=0",
            "steps.drape=0",
            "steps.rate=5e-4",
        ],
    },
    Variant { name: "style", label: "+ style", keys: &["energies.style=3"] },
    Variant { name: "repulsion", label: "+ repulsion", keys: &["energies.repulsion=5"] },
    ADHESION,
];

/// Trains `variants`.
pub(super) fn train(
    variants: &[Variant],
    options: &NeuralOptions,
    observer: &mut Observer<'_>,
) -> Result<Vec<Trained>, BenchError> {
    variants.iter().map(|variant| variant.train(options, observer)).collect()
}

/// The measures of all of `trained`, whose first has the full energies.
pub(super) fn scores(
    trained: &[Trained],
    options: &NeuralOptions,
    observer: &mut Observer<'_>,
) -> Result<Table, BenchError> {
    let mut table = score_table("", "variant");
    let Some(full) = trained.first() else { return Ok(table) };
    let own = config(options, &[])?;
    let examination = Examination::new(&own, &full.model.info().energies(), &full.model, observer)?;
    for Trained { label, model, .. } in trained {
        table.rows.push(score_row(label, &mean_score(&examination, model)?));
    }
    Ok(table)
}

/// Hair in a run, frame by frame: positions on the head in its axes, metres.
pub(super) type Course = Vec<Vec<Vec3>>;

/// Runs `preset` with each of `trained` for pictures, and gives all frames to `each`.
pub(super) fn show(
    trained: &[Trained],
    preset: &str,
    options: &NeuralOptions,
    each: &mut dyn FnMut(&Trained, &Assets, &Course),
    observer: &mut Observer<'_>,
) -> Result<Strip, BenchError> {
    let mut pictures = Vec::new();
    for one in trained {
        let (scene, assets) = demo(preset, SHOWN * options.scenes.share, &runs(&one.path), observer)?;
        let studio = Studio::new(&scene, &assets);
        let mut player = player(&scene, &assets)?;
        let (mut course, mut positions) = (Course::new(), Vec::new());
        for frame in 1..=FRAMES[1] {
            player.step()?;
            player.positions(&mut positions)?;
            if FRAMES.contains(&frame) {
                let label = if frame == FRAMES[0] { one.label.to_uppercase() } else { String::new() };
                pictures.push((studio.picture(&positions, player.time_secs(), 0.5)?, label));
            }
            let back = player.head_pose().inverse();
            course.push(positions.iter().map(|x| back.transform_point(x.as_dvec3()).as_vec3()).collect());
        }
        each(one, &assets, &course);
    }
    let title = format!("{preset} hair after {} and {} frames", FRAMES[0], FRAMES[1]);
    Ok(Strip { name: "variants", title, image: labelled(&pictures, 4)? })
}

pub(super) fn steps(options: &NeuralOptions) -> String {
    format!("Each variant was trained for {} steps from the same seed.", options.steps)
}

/// Every energy, head, transport, history and lock code left out or exchanged.
pub(super) fn all(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let trained = train(&ALL, options, observer)?;
    let strip = show(&trained, "wavy", options, &mut |_, _, _| {}, observer)?;
    Ok(Study {
        title: "Neuralocks: ablations".to_owned(),
        claim: String::new(),
        notes: vec![
            steps(options),
            SCORES.to_owned(),
            "The reference has the full energies. Gravity cannot be left out: hair without it hangs \
             nowhere. Style, repulsion and adhesion are added, not left out, and the reference is \
             without them."
                .to_owned(),
        ],
        tables: vec![scores(&trained, options, observer)?],
        strips: vec![strip],
        ..Study::default()
    })
}

/// Fig. 6: without and with codes of locks.
pub(super) fn locks(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let variants = [Variant { label: "with lock codes", ..FULL }, NO_LOCKS];
    let trained = train(&variants, options, observer)?;
    let (table, strip) = show_apart(&trained, "straight", options, observer)?;
    Ok(Study {
        title: "Neuralocks, Fig. 6: codes of locks".to_owned(),
        claim: "without the lock's code hair expands and collisions stay unresolved.".to_owned(),
        notes: vec![steps(options), SCORES.to_owned(), APART.to_owned()],
        tables: vec![scores(&trained, options, observer)?, table],
        strips: vec![strip],
        ..Study::default()
    })
}

/// Fig. 4: rising adhesion.
pub(super) fn adhesion(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let variants = [
        Variant { label: "no adhesion", ..FULL },
        Variant { label: "k 2", ..ADHESION },
        Variant { name: "adhesion-20", label: "k 20", keys: &["energies.adhesion=20"] },
        Variant {
            name: "adhesion-printed",
            label: "k 2, as printed",
            keys: &["energies.adhesion=2", "energies.adhesion_printed=true"],
        },
    ];
    let trained = train(&variants, options, observer)?;
    let (table, strip) = show_apart(&trained, "wavy", options, observer)?;
    Ok(Study {
        title: "Neuralocks, Fig. 4: rising adhesion".to_owned(),
        claim: "the stiffer adhesion is, the more hair moves as clumps.".to_owned(),
        notes: vec![
            steps(options),
            APART.to_owned(),
            "As printed, adhesion pulls neighbours together below their distance at rest.".to_owned(),
        ],
        tables: vec![table],
        strips: vec![strip],
        ..Study::default()
    })
}

/// Fig. 3: a tied style, without and with the energy that keeps it.
pub(super) fn style(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let variants = [
        Variant { name: "ponytail", label: "no style", keys: &["hair.grooms=[\"ponytail\"]"] },
        Variant {
            name: "ponytail-style",
            label: "style",
            keys: &["hair.grooms=[\"ponytail\"]", "energies.style=3"],
        },
        Variant {
            name: "ponytail-style-30",
            label: "style, ten times as stiff",
            keys: &["hair.grooms=[\"ponytail\"]", "energies.style=30"],
        },
    ];
    let trained = train(&variants, options, observer)?;
    let mut table = Table::new("", &["variant", "near the head, from rest, mm", "elsewhere, mm"]);
    let strip = show(
        &trained,
        "ponytail",
        options,
        &mut |one, assets, course| {
            let [near, far] = from_rest(assets, course).map(millimetres);
            table.rows.push(vec![one.label.to_owned(), near, far]);
        },
        observer,
    )?;
    Ok(Study {
        title: "Neuralocks, Fig. 3: the energy of the style".to_owned(),
        claim: "without it strands sag; with it the tied part of a ponytail keeps its shape.".to_owned(),
        notes: vec![
            steps(options),
            format!(
                "Mean distance of particles from their places at rest in the head's axes: of those that \
                 are within {} cm of the head at rest, which is the tied part, and of all others.",
                100.0 * NEAR_M
            ),
        ],
        tables: vec![table],
        strips: vec![strip],
        ..Study::default()
    })
}

/// How far apart neighbours move under each of `trained` in `preset`, and pictures.
fn show_apart(
    trained: &[Trained],
    preset: &str,
    options: &NeuralOptions,
    observer: &mut Observer<'_>,
) -> Result<(Table, Strip), BenchError> {
    let mut table = Table::new("", &["variant", "neighbours apart, mm"]);
    let mut measure = |one: &Trained, assets: &Assets, course: &Course| {
        let metres = apart(&assets.groom, &neighbours(&assets.groom), course);
        table.rows.push(vec![one.label.to_owned(), millimetres(metres)]);
    };
    let strip = show(trained, preset, options, &mut measure, observer)?;
    Ok((table, strip))
}

/// What [`apart`] is.
const APART: &str = "Neighbours apart: how much farther particles are from those of the strand with \
    the nearest root than at rest, in the mean; closer ones count as 0.";

/// For each strand the strand with the nearest root.
fn neighbours(groom: &Groom) -> Vec<usize> {
    let root = |strand: usize| groom.strand(strand)[0];
    let count = groom.strand_count();
    let nearest = |strand: usize| {
        let others = (0..count).filter(|other| *other != strand);
        let distance = |other: &usize| root(*other).distance_squared(root(strand));
        others.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(strand)
    };
    (0..count).map(nearest).collect()
}

/// The mean of what particles are farther from those of their strand's neighbour than at rest,
/// metres.
fn apart(groom: &Groom, neighbours: &[usize], course: &Course) -> f64 {
    let offsets = groom.strand_offsets();
    let (mut sum, mut count) = (0.0, 0usize);
    for positions in course {
        for (strand, other) in neighbours.iter().enumerate() {
            let [own, theirs] = [strand, *other].map(|s| offsets[s] as usize..offsets[s + 1] as usize);
            for (a, b) in own.zip(theirs).skip(1) {
                let rest = groom.positions()[a].distance(groom.positions()[b]);
                sum += f64::from((positions[a].distance(positions[b]) - rest).max(0.0));
                count += 1;
            }
        }
    }
    sum / count.max(1) as f64
}

/// Distance from the head at rest up to which hair counts as tied, metres.
const NEAR_M: f64 = 0.015;

/// The mean distance from rest of the particles near the head at rest and of all others, metres.
fn from_rest(assets: &Assets, course: &Course) -> [f64; 2] {
    let tree = assets.body_mesh().map(Bvh::new);
    let is_near = |x: &Vec3| {
        let nearest = tree.as_ref().and_then(|tree| tree.nearest(*x));
        nearest.is_some_and(|nearest| f64::from(nearest.distance_squared).sqrt() < NEAR_M)
    };
    let near: Vec<bool> = assets.groom.positions().iter().map(is_near).collect();
    let (mut sums, mut counts) = ([0.0; 2], [0usize; 2]);
    for positions in course {
        for ((x, rest), near) in positions.iter().zip(assets.groom.positions()).zip(&near) {
            let part = usize::from(!near);
            sums[part] += f64::from(x.distance(*rest));
            counts[part] += 1;
        }
    }
    [0, 1].map(|part| sums[part] / counts[part].max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_that_move_apart_are_measured_and_those_that_meet_are_not() {
        let strand = |x: f32| vec![Vec3::new(x, 0.0, 0.0), Vec3::new(x, -0.1, 0.0)];
        let groom = Groom::from_strands([strand(0.0), strand(0.01), strand(1.0)]).unwrap();
        let pairs = neighbours(&groom);
        assert_eq!(pairs, [1, 0, 1]);
        let moved = |by: f32| {
            let mut positions = groom.positions().to_vec();
            positions[1].x += by;
            vec![positions]
        };
        // Two of three pairs are 4 mm farther apart.
        assert!((apart(&groom, &pairs, &moved(-0.004)) - 0.008 / 3.0).abs() < 1e-6);
        assert_eq!(apart(&groom, &pairs, &moved(0.004)), 0.0);
    }
}
