//! The roller-coaster (Fig. 10): ties to the rest shape that are damaged under large forces, and
//! what that leaves.
//!
//! # Practice
//! The scene runs three times side by side: with damage, with damage that heals, and elastic, where
//! no tie is ever damaged. Followed are the ties' intact share s (1 whole, 0 broken), the hair's
//! offset from its rest shape in the head's frame, and its offset from the elastic hair. A single
//! strand rides besides (`strand`).

use glam::Vec3;

use crate::BenchError;
use crate::plot::{Line, Plot};
use forelock::Scene;
use forelock::{Observer, Player, Progress};

use super::scenes::ROLLER_COASTER;
use super::strand;
use super::study::{Study, Table, percent};
use super::watch::{between, mean, offset};

/// Intact share below which a tie counts as broken.
pub(super) const BROKEN: f64 = 0.01;
/// Intact share below which a tie counts as damaged.
const DAMAGED: f64 = 0.99;

/// Names of the runs, and what makes them of the scene.
const RUNS: [(&str, &str); 3] = [
    ("damaged", "solver.ams.non_hookean=true"),
    ("healing within 1 s", "solver.ams.healing_secs=1"),
    ("elastic", "solver.ams.non_hookean=false"),
];

/// What the ties are like at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Ties {
    broken: f64,
    damaged: f64,
    mean: f64,
    least: f64,
}

impl Ties {
    /// Of the intact shares of all ties.
    fn of(intact: &[f32]) -> Self {
        let share = |below: f64| {
            intact.iter().filter(|&&s| f64::from(s) < below).count() as f64 / intact.len().max(1) as f64
        };
        Self {
            broken: share(BROKEN),
            damaged: share(DAMAGED),
            mean: mean(intact.iter().map(|&s| f64::from(s))),
            least: intact.iter().fold(1.0, |least, &s| least.min(f64::from(s))),
        }
    }
}

/// One run at one moment.
#[derive(Clone, Copy, Debug, Default)]
struct Moment {
    ties: Ties,
    /// From the rest shape, over the strand's length.
    offset: f64,
    /// From the elastic run, over the strand's length.
    from_elastic: f64,
}

/// Runs the scene, with `keys` over it, and the strand.
pub(super) fn study(share: f64, keys: &[String], observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let (scene, assets) = ROLLER_COASTER.load(share, keys, observer)?;
    let scenes = RUNS.map(|(_, key)| ROLLER_COASTER.scene(share, &[keys, &[key.to_owned()]].concat()));
    let scenes: Vec<Scene> = scenes.into_iter().collect::<Result<_, _>>()?;
    let players = scenes.iter().map(|scene| super::scenes::player(scene, &assets));
    let mut players: Vec<Player> = players.collect::<Result<_, _>>()?;
    let strands: Vec<usize> = (0..assets.groom.strand_count()).collect();
    let frames = scene.time.frames;
    let mut tracks: [Vec<Moment>; 3] = Default::default();
    let mut positions: [Vec<Vec3>; 3] = Default::default();
    observer(&Progress::Begin { what: "riding", done: 0, total: frames.into() });
    for frame in 0..=frames {
        for (player, positions) in players.iter_mut().zip(&mut positions) {
            if frame > 0 {
                player.step()?;
            }
            player.positions(positions)?;
        }
        let head = players[0].head_pose();
        for ((player, track), x) in players.iter_mut().zip(&mut tracks).zip(&positions) {
            track.push(Moment {
                ties: Ties::of(&player.state()?.integrity),
                offset: offset(&assets.groom, &strands, &head, x).over_length,
                from_elastic: between(&assets.groom, &strands, x, &positions[2]).over_length,
            });
        }
        if frame > 0 {
            observer(&Progress::Step);
        }
    }
    observer(&Progress::End);
    let end_secs = f64::from(frames) / scene.time.fps;
    let ride_secs = scene.body.motion.rest_after_secs;
    let notes = vec![
        format!(
            "Scene `{}`: {} strands, {} particles, {frames} frames at {} a second; the ride ends at {ride_secs} s, the last numbers are {:.1} s after.",
            ROLLER_COASTER.name,
            strands.len(),
            assets.groom.particle_count(),
            scene.time.fps,
            end_secs - ride_secs,
        ),
        format!(
            "s: intact share of a tie to the rest shape; broken below {BROKEN}, damaged below {DAMAGED}. Offsets are means over all particles, over the strand's length L."
        ),
        "Single strand in brackets: the reference, in float64, of another ride at 1 Hz.".to_owned(),
    ];
    Ok(Study {
        title: "AMS, Fig. 10: a roller-coaster".to_owned(),
        claim: "the initial hairstyle holds before intense motion, and the hair is scrambled after the ride."
            .to_owned(),
        notes,
        tables: vec![table(&tracks), strand::table()?],
        plots: plots(&tracks, scene.time.fps, ride_secs),
        ..Study::default()
    })
}

fn table(tracks: &[Vec<Moment>; 3]) -> Table {
    let columns = [
        "groom",
        "smallest s",
        "mean s at the end",
        "ties damaged at the end",
        "ties broken, most",
        "ties broken at the end",
        "offset at the end / L",
        "from the elastic hair / L",
    ];
    let mut table = Table::new("The groom", &columns);
    for ((name, _), track) in RUNS.iter().zip(tracks) {
        let end = track.last().copied().unwrap_or_default();
        table.rows.push(vec![
            (*name).to_owned(),
            format!("{:.2}", track.iter().map(|m| m.ties.least).fold(1.0, f64::min)),
            format!("{:.3}", end.ties.mean),
            percent(end.ties.damaged),
            percent(track.iter().map(|m| m.ties.broken).fold(0.0, f64::max)),
            percent(end.ties.broken),
            format!("{:.3}", end.offset),
            format!("{:.3}", end.from_elastic),
        ]);
    }
    table
}

fn plots(tracks: &[Vec<Moment>; 3], fps: f64, ride_secs: f64) -> Vec<Plot> {
    let plot = |name, title: &str, runs: &[usize], of: fn(&Moment) -> f64| Plot {
        name,
        title: title.to_owned(),
        step_secs: 1.0 / fps,
        shaded_secs: Some([0.0, ride_secs]),
        lines: runs
            .iter()
            .map(|&run| Line {
                name: RUNS[run].0.to_owned(),
                colour: [1, 2, 0][run],
                dashed: run == 2,
                values: tracks[run].iter().map(of).collect(),
            })
            .collect(),
    };
    vec![
        plot("offset", "mean distance from the rest shape over the strand's length, %", &[0, 1, 2], |m| {
            100.0 * m.offset
        }),
        plot(
            "from-elastic",
            "mean distance from the elastic hair over the strand's length, %",
            &[0, 1],
            |m| 100.0 * m.from_elastic,
        ),
        plot("broken", "ties to the rest shape that are broken, %", &[0, 1], |m| 100.0 * m.ties.broken),
        plot("integrity", "mean intact share of the ties", &[0, 1], |m| m.ties.mean),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few strands of the scene: damaged hair stays off, healed and elastic hair come back.
    #[test]
    fn a_groom_is_scrambled_and_healing_brings_it_back() {
        let alone = ["interaction.kind=\"none\"".to_owned()];
        let study = study(0.006, &alone, &mut |_| {}).unwrap();
        let line = |plot: &str, run: &str| {
            let plot = study.plots.iter().find(|p| p.name == plot).unwrap();
            plot.lines.iter().find(|line| line.name.contains(run)).unwrap().values.clone()
        };
        let end = |plot, run| *line(plot, run).last().unwrap();
        let offsets = ["damaged", "healing", "elastic"].map(|run| end("offset", run));
        let [damaged, healing, _] = offsets.map(|offset| offset - offsets[2]);
        assert!(damaged > 2.0 * offsets[2] && healing < 0.35 * damaged, "{offsets:?} % of L");
        assert!(end("from-elastic", "damaged") > 2.0 * end("from-elastic", "healing"));
        let broken = ["damaged", "healing"].map(|run| end("broken", run));
        assert!(broken[0] > 0.0 && broken[1] < 0.5 * broken[0], "{broken:?} % of the ties");
        let whole = ["damaged", "healing"].map(|run| end("integrity", run));
        assert!(whole[1] > 0.95 && whole[0] < whole[1] - 0.03, "{whole:?}");
        // Damage grows only.
        assert!(line("integrity", "damaged").is_sorted_by(|a, b| a >= b));
    }
}
