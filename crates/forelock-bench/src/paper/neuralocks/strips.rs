//! Figs. 1, 9, 10 and 13: models at work.

use forelock::training::{Examination, KindScore, TrainingConfig};
use forelock::{Assets, Observer, Scene, labelled};
use std::sync::Arc;

use super::NeuralOptions;
use super::models::{SCORES, config, demo, runs_builtin, score_row, score_table, xpbd_with_contacts};
use crate::BenchError;
use crate::paper::followed::{Case, Followed, Shots, plot};
use crate::paper::study::{Strip, Study, Table, percent};
use crate::paper::watch::mean;

/// Strands of a picture.
const SHOWN: f64 = 4096.0;
/// The moments of pictures, as shares of the scene's time.
const MOMENTS: [f64; 4] = [0.25, 0.5, 0.7, 1.0];

/// Follows `scene`, with pictures.
fn follow(
    label: &str,
    scene: Scene,
    assets: &Arc<Assets>,
    observer: &mut Observer<'_>,
) -> Result<Followed, BenchError> {
    let case = Case { label: label.to_owned(), scene };
    Followed::run(&case, assets, &Shots { moments: &MOMENTS, scale: 0.54 }, observer)
}

/// The pictures of all that were followed, a row each.
fn film(followed: &[Followed]) -> Result<Vec<Strip>, BenchError> {
    let pictures: Vec<_> = followed.iter().flat_map(|one| one.pictures.clone()).collect();
    let image = labelled(&pictures, MOMENTS.len() as u32)?;
    Ok(vec![Strip { name: "film", title: "Over time".to_owned(), image }])
}

/// A table of what was followed.
fn followed_table(first: &str) -> Table {
    let columns = [
        first,
        "strands",
        "ms a frame",
        "from the shape, mean over L",
        "edges off by",
        "over 1 mm inside, at most",
    ];
    Table::new("", &columns)
}

/// A row of it.
fn followed_row(one: &Followed, strands: usize) -> Vec<String> {
    vec![
        one.label.clone(),
        forelock::html::thousands(strands),
        format!("{:.2}", one.ms),
        percent(mean(one.shape.iter().copied())),
        format!("{:.1e}", one.stretch[1]),
        format!("{:.3} %", 100.0 * one.inside),
    ]
}

/// Fig. 1: one model moves several styles.
pub(super) fn styles(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let mut table = followed_table("hair");
    let mut followed = Vec::new();
    for preset in ["straight", "wavy", "curly", "bob"] {
        let (scene, assets) = demo(preset, SHOWN * options.scenes.share, &runs_builtin(), observer)?;
        let one = follow(&preset.to_uppercase(), scene, &assets, observer)?;
        table.rows.push(followed_row(&one, assets.groom.strand_count()));
        followed.push(one);
    }
    Ok(Study {
        title: "Neuralocks, Fig. 1: one model moves several styles".to_owned(),
        claim: "a compact network moves many styles, strand by strand, in real time.".to_owned(),
        notes: vec!["The built-in model, trained on all four, on a head that turns.".to_owned()],
        tables: vec![table],
        strips: film(&followed)?,
        ..Study::default()
    })
}

/// Fig. 9: the network beside the solvers.
pub(super) fn beside_xpbd(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let of = |kind: &str| vec![format!("solver.kind={kind}")];
    let cases = [
        ("NEURAL", runs_builtin()),
        ("XPBD", of("xpbd")),
        ("XPBD, CONTACTS", xpbd_with_contacts()),
        ("AMS", of("ams")),
    ];
    let mut table = followed_table("solver");
    let (mut followed, mut fps) = (Vec::new(), 60.0);
    for (label, keys) in cases {
        let (scene, assets) = demo("wavy", SHOWN * options.scenes.share, &keys, observer)?;
        fps = scene.time.fps;
        let one = follow(label, scene, &assets, observer)?;
        table.rows.push(followed_row(&one, assets.groom.strand_count()));
        followed.push(one);
    }
    let shape = |one: &Followed| one.shape.iter().map(|share| 100.0 * share).collect();
    let title = "mean distance from the rest shape over the strand's length, %".to_owned();
    Ok(Study {
        title: "Neuralocks, Fig. 9: beside XPBD and AMS".to_owned(),
        claim: "the network keeps the dynamics of hair, with more damping, at a fraction of the cost."
            .to_owned(),
        notes: vec![
            "Wavy hair on a head that turns. XPBD and AMS have their defaults, which are other \
             stiffnesses than those of the training: compare the kind of the motion, not the sag."
                .to_owned(),
        ],
        tables: vec![table],
        plots: vec![plot("shape", title, &followed, fps, shape)],
        bars: None,
        strips: film(&followed)?,
    })
}

/// Fig. 10: trained on few strands, run on many.
pub(super) fn generalisation(
    options: &NeuralOptions,
    observer: &mut Observer<'_>,
) -> Result<Study, BenchError> {
    let mut table = followed_table("groom");
    let mut followed = Vec::new();
    for strands in [3_000.0, 120_000.0] {
        let (scene, assets) = demo("straight", strands * options.scenes.share, &runs_builtin(), observer)?;
        let count = assets.groom.strand_count();
        let label = format!("{} STRANDS", forelock::html::thousands(count));
        let one = follow(&label, scene, &assets, observer)?;
        table.rows.push(followed_row(&one, count));
        followed.push(one);
    }
    Ok(Study {
        title: "Neuralocks, Fig. 10: trained on few strands, run on many".to_owned(),
        claim: "trained on 3,000 strands, the network moves all 120,000 of the groom.".to_owned(),
        notes: vec![
            "The built-in model, trained on 4,080 strands of each of eight kinds of hair. No strand of \
             the two grooms is one of them."
                .to_owned(),
        ],
        tables: vec![table],
        strips: film(&followed)?,
        ..Study::default()
    })
}

/// Fig. 13: grooms that were not trained.
pub(super) fn unseen(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let model = forelock::builtin_model()?;
    let grooms = ["ponytail", "asymmetric", "afro"];
    let mut table = score_table("", "groom");
    let mut followed = Vec::new();
    for groom in grooms {
        let own: TrainingConfig = config(options, &[&format!("hair.grooms=[\"{groom}\"]")])?;
        let examination = Examination::new(&own, &model.info().energies(), &model, observer)?;
        for KindScore { groom, score } in examination.measure(&model)? {
            table.rows.push(score_row(&groom, &score));
        }
        let (scene, assets) = demo(groom, SHOWN * options.scenes.share, &runs_builtin(), observer)?;
        followed.push(follow(&groom.to_uppercase(), scene, &assets, observer)?);
    }
    Ok(Study {
        title: "Neuralocks, Fig. 13: grooms that were not trained".to_owned(),
        claim: "the network generalises to similar grooms outside of the training.".to_owned(),
        notes: vec![
            SCORES.to_owned(),
            "The built-in model knows straight, wavy and curly hair and a bob; none of these grooms."
                .to_owned(),
        ],
        tables: vec![table],
        strips: film(&followed)?,
        ..Study::default()
    })
}
