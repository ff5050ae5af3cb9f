//! Digital grooming (Fig. 11): a trim, purely geometric and simulated.
//!
//! # Practice
//! The scene trims hair while it is simulated. What the edit leaves is the purely geometric trim;
//! followed is how far the simulated hair goes from there, because less weight hangs on what is
//! left of each strand and fewer strands take up room.

use glam::Vec3;

use crate::BenchError;
use crate::plot::{Line, Plot};
use forelock::{Observer, Progress};

use super::scenes::{self, AS_IT_IS, GROOMING};
use super::study::{Study, Table, millimetres};
use super::watch::mean;

/// Distance by which an edit must move a tip for its strand to count as trimmed, metres.
const TRIMMED_M: f32 = 1e-4;

/// Trimmed strands at the end of a frame, compared with the geometric trim.
#[derive(Clone, Copy, Debug, Default)]
struct Moment {
    /// Mean height of their tips over where the trim left them, metres.
    rise: f64,
    /// Mean distance of their particles from there, metres.
    distance: f64,
}

/// Runs the scene.
pub(super) fn study(observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let (scene, assets) = GROOMING.load(1.0, AS_IT_IS, observer)?;
    let cut_frame = scene.edits.timed().first().map_or(0, |&(_, secs)| (secs * scene.time.fps).ceil() as u32);
    let offsets = assets.groom.strand_offsets();
    let range = |strand: usize| offsets[strand] as usize..offsets[strand + 1] as usize;
    let tip = |strand: usize| offsets[strand + 1] as usize - 1;
    let mut player = scenes::player(&scene, &assets)?;
    let (mut before, mut geometric, mut positions) = (Vec::new(), Vec::new(), Vec::new());
    let mut trimmed: Vec<usize> = Vec::new();
    let mut track: Vec<Moment> = Vec::new();
    let moment = |trimmed: &[usize], geometric: &[Vec3], positions: &[Vec3]| {
        let rise = |&strand: &usize| f64::from(positions[tip(strand)].y - geometric[tip(strand)].y);
        let particles = trimmed.iter().flat_map(|&strand| range(strand));
        Moment {
            rise: mean(trimmed.iter().map(rise)),
            distance: mean(particles.map(|p| f64::from(positions[p].distance(geometric[p])))),
        }
    };
    observer(&Progress::Begin { what: "trimming", done: 0, total: scene.time.frames.into() });
    for frame in 0..scene.time.frames {
        if frame == cut_frame {
            player.positions(&mut before)?;
            player.apply_due_edits()?;
            player.positions(&mut geometric)?;
            trimmed = (0..offsets.len() - 1)
                .filter(|&strand| before[tip(strand)].distance(geometric[tip(strand)]) > TRIMMED_M)
                .collect();
            track.push(Moment::default());
        }
        player.step()?;
        if frame >= cut_frame {
            player.positions(&mut positions)?;
            track.push(moment(&trimmed, &geometric, &positions));
        }
        observer(&Progress::Step);
    }
    observer(&Progress::End);

    let end = track.last().copied().unwrap_or_default();
    let most = |of: fn(&Moment) -> f64| millimetres(track.iter().map(of).fold(0.0, f64::max));
    let columns = ["trimmed strands against the geometric trim, mean", "largest, mm", "at the end, mm"];
    let mut table = Table::new("", &columns);
    let row = |name: &str, most: String, end: f64| vec![name.to_owned(), most, millimetres(end)];
    table.rows.push(row("height of tips", most(|m| m.rise), end.rise));
    table.rows.push(row("distance of particles", most(|m| m.distance), end.distance));
    let line = |name: &str, colour, of: fn(&Moment) -> f64| Line {
        name: name.to_owned(),
        colour,
        dashed: false,
        values: track.iter().map(|m| 1e3 * of(m)).collect(),
    };
    Ok(Study {
        title: "AMS, Fig. 11: a trim, geometric and simulated".to_owned(),
        claim: "in the simulation-based trim the hair's shape changes due to the change of volume and length; a purely geometric one cannot respond.".to_owned(),
        notes: vec![
            format!(
                "Scene `{}`: {} strands, {} particles, of which {} are trimmed at {:.2} s; compared is each later frame with what the trim left.",
                GROOMING.name,
                offsets.len() - 1,
                assets.groom.particle_count(),
                trimmed.len(),
                player.secs_of(cut_frame),
            ),
        ],
        tables: vec![table],
        plots: vec![Plot {
            name: "trim",
            title: "trimmed strands against the geometric trim since the cut, mm".to_owned(),
            step_secs: 1.0 / scene.time.fps,
            shaded_secs: None,
            lines: vec![line("height of tips", 0, |m| m.rise), line("distance of particles", 1, |m| m.distance)],
        }],
        ..Study::default()
    })
}
