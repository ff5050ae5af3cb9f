//! What keeps its shape: AMS and plain mass-spring on hair of different lengths (Fig. 9 and the
//! asymmetric style).
//!
//! # Practice
//! The same scene runs with both solvers. Strands are taken in thirds by length, and followed is
//! each third's mean distance from its rest shape in the head's frame. While the head moves, that
//! is how far hair swings; once the head is still, it is what was lost of the shape.
//!
//! A strand that the shake throws around an ear stays behind it. Few such strands make most of that
//! mean, so the median over strands and the share of strands that lie elsewhere stand beside it.

use crate::BenchError;
use crate::plot::{Line, Plot};
use forelock::{Observer, Progress};

use super::scenes::{self, Builtin};
use super::study::{Study, Table, millimetres, percent};
use super::watch::{ELSEWHERE, Offset, Part, mean, offset, thirds};

/// A scene to be run with both solvers.
pub(super) struct Keeping {
    builtin: Builtin,
    title: &'static str,
    claim: &'static str,
}

pub(super) const BEARD: Keeping = Keeping {
    builtin: scenes::BEARD,
    title: "AMS, Fig. 9: a beard on a head that shakes and jumps",
    claim: "under mass-spring the initial shape of the beard is lost; AMS preserves it while producing vivid dynamics.",
};

pub(super) const ASYMMETRIC: Keeping = Keeping {
    builtin: scenes::ASYMMETRIC,
    title: "AMS, Fig. 1 (middle) and Sec. 5.2.2: an asymmetric style on a head that shakes and jumps",
    claim: "under mass-spring strands move alike whatever their length, and the short side behaves like fur; AMS keeps what is distinct of each section.",
};

/// Solvers compared: key and name.
const SOLVERS: [(&str, &str); 2] = [("ams", "AMS"), ("mass-spring", "mass-spring")];

/// A third of the groom with one solver: its offset at every frame, the first at the start.
struct Track {
    solver: &'static str,
    part: String,
    offsets: Vec<Offset>,
}

/// Runs `what`, with `keys` over its scene, with both solvers.
pub(super) fn study(
    what: &Keeping,
    share: f64,
    keys: &[String],
    observer: &mut Observer<'_>,
) -> Result<Study, BenchError> {
    let (scene, assets) = what.builtin.load(share, keys, observer)?;
    let parts = thirds(&assets.groom);
    let frames = scene.time.frames;
    let mut tracks = Vec::new();
    for (kind, solver) in SOLVERS {
        let scene = what.builtin.scene(share, &[keys, &[format!("solver.kind=\"{kind}\"")]].concat())?;
        let mut player = scenes::player(&scene, &assets)?;
        let mut of_parts = vec![Vec::with_capacity(frames as usize + 1); parts.len()];
        let mut positions = Vec::new();
        observer(&Progress::Begin { what: solver, done: 0, total: frames.into() });
        for frame in 0..=frames {
            if frame > 0 {
                player.step()?;
                observer(&Progress::Step);
            }
            player.positions(&mut positions)?;
            let head = player.head_pose();
            for (part, offsets) in parts.iter().zip(&mut of_parts) {
                offsets.push(offset(&assets.groom, &part.strands, &head, &positions));
            }
        }
        observer(&Progress::End);
        let of_solver = of_parts.into_iter().zip(&parts);
        tracks.extend(of_solver.map(|(offsets, Part { name, .. })| Track {
            solver,
            part: name.clone(),
            offsets,
        }));
    }
    // Without a time to rest the head moves to the end.
    let end_secs = f64::from(frames) / scene.time.fps;
    let rest = scene.body.motion.rest_after_secs;
    let still_secs = if rest > 0.0 { rest.min(end_secs) } else { end_secs };
    let moving = (still_secs * scene.time.fps) as usize;
    let notes = vec![
        format!(
            "Scene `{}`: {} strands, {} particles, {frames} frames at {} a second.",
            what.builtin.name,
            assets.groom.strand_count(),
            assets.groom.particle_count(),
            scene.time.fps
        ),
        "Offset: mean distance of the particles from their places at rest, in the head's frame; L is the strand's length.".to_owned(),
        format!("Elsewhere: strands whose mean offset at the end is more than {:.0} % of L.", 100.0 * ELSEWHERE),
        format!("The head moves for {still_secs:.1} s (grey in the plots); the columns from the fifth on are {:.1} s after.", end_secs - still_secs),
    ];
    Ok(Study {
        title: what.title.to_owned(),
        claim: what.claim.to_owned(),
        notes,
        tables: vec![table(&tracks, moving)],
        plots: plots(&tracks, scene.time.fps, still_secs),
        ..Study::default()
    })
}

fn table(tracks: &[Track], moving: usize) -> Table {
    let columns = [
        "strands",
        "offset while the head moves, mm",
        "over L",
        "largest, mm",
        "at the end, mm",
        "over L",
        "median over L",
        "elsewhere",
    ];
    let mut table = Table::new("", &columns);
    for Track { solver, part, offsets } in tracks {
        let moved = || offsets.iter().take(moving + 1);
        let end = offsets.last().copied().unwrap_or_default();
        table.rows.push(vec![
            format!("{solver}, {part}"),
            millimetres(mean(moved().map(|o| o.metres))),
            percent(mean(moved().map(|o| o.over_length))),
            millimetres(moved().map(|o| o.metres).fold(0.0, f64::max)),
            millimetres(end.metres),
            percent(end.over_length),
            percent(end.median_over_length),
            percent(end.elsewhere),
        ]);
    }
    table
}

fn plots(tracks: &[Track], fps: f64, still_secs: f64) -> Vec<Plot> {
    let plot = |name, title: &str, of: fn(&Offset) -> f64| Plot {
        name,
        title: title.to_owned(),
        step_secs: 1.0 / fps,
        shaded_secs: Some([0.0, still_secs]),
        lines: tracks
            .iter()
            .enumerate()
            .map(|(number, Track { solver, part, offsets })| Line {
                name: format!("{solver}, {part}"),
                colour: number % 3,
                dashed: number >= 3,
                values: offsets.iter().map(of).collect(),
            })
            .collect(),
    };
    vec![
        plot("offset", "mean distance from the rest shape, mm", |o| 1e3 * o.metres),
        plot("offset-over-length", "mean distance from the rest shape over the strand's length, %", |o| {
            100.0 * o.over_length
        }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(what: &Keeping, share: f64) -> Vec<Vec<f64>> {
        let alone = ["interaction.kind=\"none\"".to_owned()];
        let study = study(what, share, &alone, &mut |_| {}).unwrap();
        assert!(study.plots.iter().flat_map(|p| &p.lines).all(|l| l.values.iter().all(|v| v.is_finite())));
        let number = |cell: &String| cell.trim_end_matches(" %").parse().unwrap();
        study.tables[0].rows.iter().map(|row| row[1..].iter().map(number).collect()).collect()
    }

    /// Rows are AMS's thirds from the shortest to the longest, then mass-spring's; `end` is the
    /// column that says what was lost of the shape.
    fn check(rows: &[Vec<f64>], end: usize, most: f64) {
        for third in 0..3 {
            let [ams, plain] = [third, third + 3].map(|row| rows[row][end]);
            assert!(ams < most && plain > 5.0 * ams, "over L at the end, %: {rows:?}");
        }
        assert!(rows[2][0] > 2.0 * rows[0][0], "the longest swing further: {rows:?}");
    }

    #[test]
    fn ams_keeps_a_beard_that_mass_spring_loses() {
        check(&rows(&BEARD, 0.1), 4, 2.0);
    }

    /// Long strands may be thrown behind an ear. Which ones, and so the mean over a few strands,
    /// changes with every detail of the ear; the shape of all others does not.
    #[test]
    fn ams_keeps_an_asymmetric_style_that_mass_spring_loses() {
        let rows = rows(&ASYMMETRIC, 0.02);
        check(&rows, 5, 1.5);
        let elsewhere = |row: usize| rows[row][6];
        assert!(elsewhere(0) <= 5.0 && elsewhere(1) <= 5.0 && elsewhere(2) <= 20.0, "{rows:?}");
        assert!((3..6).all(|row| elsewhere(row) > 50.0), "mass-spring loses most strands: {rows:?}");
    }
}
