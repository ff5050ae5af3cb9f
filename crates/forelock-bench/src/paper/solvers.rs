//! All solvers on the five scenes of the follow-the-leader paper: time, lengths, penetration, shape
//! and energy.
//!
//! # Limitations
//! Each has its default or the scene's parameters, which were not tuned to one error.

use forelock::{Observer, PlayerError, labelled};

use super::dftl::{Entry, SCENES};
use super::followed::{Case, Followed, Shots, plot};
use super::scenes::AS_IT_IS;
use super::study::{Strip, Study, Table, percent};
use super::table1::or_skipped;
use crate::BenchError;

/// Solvers compared, as keys of the five scenes: each alone, and two with the hair–hair interaction
/// of their paper.
const SOLVERS: [(&str, &[&str]); 7] = [
    ("AMS", &["solver.kind=\"ams\"", "interaction.kind=\"none\""]),
    ("MASS-SPRING", &["solver.kind=\"mass-spring\"", "interaction.kind=\"none\""]),
    ("DFTL", &["interaction.kind=\"none\""]),
    ("XPBD", &["solver.kind=\"xpbd\"", "interaction.kind=\"none\""]),
    ("NEURAL", &["solver.kind=\"neural\"", "interaction.kind=\"none\""]),
    ("AMS, GRID", &["solver.kind=\"ams\"", "interaction.kind=\"grid\""]),
    ("DFTL, SPH", &[]),
];

/// All solvers through the five scenes. `so_far` gets what there is after each: all
/// of them take minutes.
///
/// # Errors
/// [`BenchError`] if a scene cannot be simulated; one whose files are not there is left out, and
/// said so.
pub fn compare(
    share: f64,
    observer: &mut Observer<'_>,
    so_far: &mut dyn FnMut(&Study),
) -> Result<Study, BenchError> {
    let table = Table::new(
        "",
        &[
            "scene",
            "solver",
            "ms a frame",
            "MB",
            "edges off by",
            "after solids",
            "over 1 mm inside",
            "from the shape, mean over L",
            "energy, J/kg, rms",
        ],
    );
    let mut study = Study {
        title: "AMS, mass-spring, DFTL, XPBD and the learned simulator on the same five scenes".to_owned(),
        claim: String::new(),
        notes: vec!["AMS, mass-spring and XPBD with their defaults, follow the leader with the scenes' parameters, the learned simulator with its built-in model, which knows the body and not the scene's colliders; each alone, two also with what their own papers let hair meet in: the grid, whose cost hardly depends on the strands, and smoothed particles. \"Edges off by\" is the largest after the length pass, \"after solids\" at the end of a frame; roots do not count as inside. Energy is that of the motion relative to the rest shape on the head, and of the height over it.".to_owned()],
        tables: vec![table, choice()],
        ..Study::default()
    };
    for (number, Entry { name, builtin, .. }) in SCENES.iter().enumerate() {
        let (base, assets) = match or_skipped(builtin.load(share, AS_IT_IS, &mut |_| {}))? {
            Ok(loaded) => loaded,
            Err(why) => {
                study.notes.push(format!("{name} is left out: {why}."));
                continue;
            }
        };
        let mut followed = Vec::new();
        for (solver, keys) in SOLVERS {
            let case = Case { label: solver.to_owned(), scene: builtin.scene(share, keys)? };
            let shots = Shots { moments: &[0.25, 0.5, 1.0], scale: 0.54 };
            match Followed::run(&case, &assets, &shots, observer) {
                Ok(one) => followed.push(one),
                // The built-in model knows hair on a head of human size.
                Err(BenchError::Player(PlayerError::Neural(error))) => {
                    study.notes.push(format!("{name} is left out for {solver}: {error}."));
                }
                Err(error) => return Err(error),
            }
        }
        for one in &followed {
            let rms = (one.energy.iter().map(|e| e * e).sum::<f64>() / one.energy.len().max(1) as f64).sqrt();
            study.tables[0].rows.push(vec![
                (*name).to_owned(),
                one.label.clone(),
                format!("{:.2}", one.ms),
                format!("{:.1}", one.bytes as f64 / 1e6),
                format!("{:.1e}", one.stretch[0]),
                percent(one.stretch[1]),
                percent(one.inside),
                percent(super::watch::mean(one.shape.iter().copied())),
                format!("{rms:.3}"),
            ]);
        }
        let fps = base.time.fps;
        study.plots.push(plot(
            PLOTS[number][0],
            format!("{name}: mean distance from the rest shape over the strand's length, %"),
            &followed,
            fps,
            |one| one.shape.iter().map(|share| 100.0 * share).collect(),
        ));
        study.plots.push(plot(PLOTS[number][1], format!("{name}: energy, J/kg"), &followed, fps, |one| {
            one.energy.clone()
        }));
        let pictures: Vec<_> = followed.iter().flat_map(|one| one.pictures.clone()).collect();
        study.strips.push(Strip {
            name: PLOTS[number][2],
            title: format!("{name}, over time"),
            image: labelled(&pictures, 3)?,
        });
        study.notes.push(format!("So far: {} of {} scenes.", number + 1, SCENES.len()));
        so_far(&study);
        study.notes.pop();
    }
    Ok(study)
}

/// When to choose which solver.
fn choice() -> Table {
    let mut table = Table::new("When to choose which", &["solver", "choose it for", "not for"]);
    for [solver, good, bad] in [
        [
            "AMS",
            "styles that keep their shape; strands are solved exactly; the default",
            "strands that twist about their own axis",
        ],
        ["mass-spring", "a comparison with older work", "stiff styles: lengths and curls need care"],
        [
            "DFTL",
            "many strands without stiffness, on a GPU particle by particle",
            "long styles, energy that lasts",
        ],
        [
            "XPBD",
            "rods that bend and twist, a reference in many games",
            "much hair in real time: it costs most",
        ],
        [
            "neural",
            "many heads with styles that were trained, motion like that of the training",
            "wind, colliders, contacts between strands, bodies that bend",
        ],
    ] {
        table.rows.push([solver, good, bad].map(str::to_owned).into());
    }
    table
}

/// Names of the plots and the strip of each scene.
const PLOTS: [[&str; 3]; 5] = [
    ["mannequin-a-shape", "mannequin-a-energy", "mannequin-a"],
    ["mannequin-b-shape", "mannequin-b-energy", "mannequin-b"],
    ["horse-shape", "horse-energy", "horse"],
    ["bunny-shape", "bunny-energy", "bunny"],
    ["doll-shape", "doll-energy", "doll"],
];
