//! Fig. 7: a hand in hair of which guides carry all strands, and in hair of which all strands are
//! simulated.
//!
//! # Practice
//! The scene is `scenes/ams/hand.toml`, built in. In every frame of each variant every particle of
//! every strand is sampled, simulated or carried, and counts as inside if it is more than 1 mm
//! under the surface of the hand or of the body. Beside the simulation of all strands runs the same
//! one without the hand: the mean distance between the two says how far the hand parts the hair,
//! and how it closes again.
//!
//! # Limitations
//! Guides are chosen by their roots, not for the scene. Carried strands are not brought out of
//! solids afterwards, which is what the paper's figure shows.

use std::fmt::Write as _;
use std::sync::Arc;

use forelock_render::Image;
use glam::Vec3;
use serde::Serialize;

use super::scenes::{self, HAND};
use crate::BenchError;
use forelock::Assets;
use forelock::Scene;
use forelock::penetration::Penetration;
use forelock::summary::Spread;
use forelock::{Observer, Player, Progress};
use forelock::{Studio, labelled};

/// Guides of each variant; 0 simulates all strands.
pub const GUIDES: [u32; 3] = [128, 2048, 0];

/// The moment of the pictures, as a share of the scene: the hand is in the hair.
const MOMENT: f64 = 0.25;

/// What is inside solids in a variant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GuidesRow {
    /// Strands that were simulated.
    pub simulated: usize,
    /// Largest share of particles more than 1 mm inside the hand at the end of a frame, but for
    /// those clamped to the head. No unit.
    pub max_share_in_hand: f64,
    /// The same in hand or body.
    pub max_share: f64,
    /// Mean of that share over all frames.
    pub mean_share: f64,
    /// Deepest particle in any frame, metres.
    pub deepest_m: f64,
    /// Wall time of a frame, milliseconds.
    pub ms_per_frame: Spread,
    /// Time, seconds, and mean distance of the particles from where they are without the hand,
    /// metres, every quarter of a second; of all strands simulated only.
    pub parted: Vec<[f64; 2]>,
    /// All strands at the moment of the pictures, metres.
    #[serde(skip)]
    pub shape: Vec<Vec3>,
}

/// Fig. 7 in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GuidesTable {
    /// What it shows.
    pub title: String,
    /// Strands of the groom.
    pub strands: usize,
    /// Frames of each variant.
    pub frames: u32,
    /// One row a variant.
    pub rows: Vec<GuidesRow>,
    /// All variants at one moment, side by side, if asked for.
    #[serde(skip)]
    pub picture: Option<Image>,
}

impl GuidesTable {
    /// Simulates the scene, with `share` of its strands and `keys` over it, with each of `guides`,
    /// and draws them if `draws`; `observer` receives the progress.
    ///
    /// # Errors
    /// [`BenchError`] if a variant cannot be simulated or drawn.
    pub fn run(
        guides: &[u32],
        share: f64,
        keys: &[String],
        draws: bool,
        observer: &mut Observer<'_>,
    ) -> Result<Self, BenchError> {
        let mut rows = Vec::with_capacity(guides.len());
        let (base, assets) = HAND.load(share, keys, observer)?;
        let frames = base.time.frames;
        for &guides in guides {
            let mut scene = base.clone();
            scene.groom.guides = guides;
            observer(&Progress::Begin { what: "simulating", done: 0, total: frames.into() });
            rows.push(measure(&scene, &assets, guides == 0, observer)?);
            observer(&Progress::End);
        }
        let strands = assets.groom.strand_count();
        let title = format!("AMS, Fig. 7: a hand through {strands} strands, carried by guides or simulated");
        let picture = draws.then(|| side_by_side(&base, &assets, &rows)).transpose()?;
        Ok(Self { title, strands, frames, rows, picture })
    }

    /// The table as Markdown.
    pub fn to_markdown(&self) -> String {
        let mut text = format!(
            "{}\n\n| simulated | of {} strands' particles deeper than 1 mm: in the hand, at most | in hand or body, at most | mean of {} frames | deepest, mm | ms a frame |\n| ---: | ---: | ---: | ---: | ---: | ---: |\n",
            self.title, self.strands, self.frames
        );
        for row in &self.rows {
            let [hand, most, mean] =
                [row.max_share_in_hand, row.max_share, row.mean_share].map(|x| 100.0 * x);
            let (deepest, ms) = (row.deepest_m * 1e3, row.ms_per_frame.median);
            let _ = writeln!(
                text,
                "| {} | {hand:.3} % | {most:.3} % | {mean:.4} % | {deepest:.1} | {ms:.1} |",
                row.simulated
            );
        }
        for row in self.rows.iter().filter(|row| !row.parted.is_empty()) {
            let series: Vec<_> =
                row.parted.iter().map(|[at, mean]| format!("{:.2} ({at:.2} s)", mean * 1e3)).collect();
            let _ = write!(
                text,
                "\nMean distance of the {} simulated strands from where they are without the hand, mm: {}.\n",
                row.simulated,
                series.join(", ")
            );
        }
        text
    }
}

/// The variants of `rows` at one moment, side by side.
fn side_by_side(scene: &Scene, assets: &Assets, rows: &[GuidesRow]) -> Result<Image, BenchError> {
    let studio = Studio::new(scene, assets);
    let time_secs = f64::from(moment(scene)) / scene.time.fps;
    let all = assets.groom.strand_count();
    let mut pictures = Vec::with_capacity(rows.len());
    for row in rows {
        let label = match row.simulated {
            strands if strands == all => format!("ALL {all} STRANDS SIMULATED"),
            guides => format!("{guides} GUIDES"),
        };
        pictures.push((studio.picture(&row.shape, time_secs, 0.6)?, label));
    }
    Ok(labelled(&pictures, 3)?)
}

/// The frame of the pictures.
fn moment(scene: &Scene) -> u32 {
    (f64::from(scene.time.frames) * MOMENT) as u32
}

/// One variant; `beside` simulates it without the hand too.
fn measure(
    scene: &Scene,
    assets: &Arc<Assets>,
    beside: bool,
    observer: &mut Observer<'_>,
) -> Result<GuidesRow, BenchError> {
    let undisturbed = Scene { colliders: Vec::new(), ..scene.clone() };
    let other = beside.then(|| Player::builder(undisturbed).without_history().build());
    let mut other = other.transpose()?;
    let mut player = scenes::player(scene, assets)?;
    let simulated = player.simulated_strands();
    let (mut positions, mut without, mut times) = (Vec::new(), Vec::new(), Vec::new());
    let mut row = GuidesRow {
        simulated,
        max_share_in_hand: 0.0,
        max_share: 0.0,
        mean_share: 0.0,
        deepest_m: 0.0,
        ms_per_frame: Spread::default(),
        parted: Vec::new(),
        shape: Vec::new(),
    };
    let every = (0.25 * scene.time.fps).max(1.0) as u32;
    for frame in 0..scene.time.frames {
        let started = std::time::Instant::now();
        player.step()?;
        player.positions(&mut positions)?;
        times.push(started.elapsed().as_secs_f64() * 1e3);
        let solids = player.measured_solids();
        let all = Penetration::measure(&positions, player.layout(), &solids);
        // The body comes first.
        let but_body = solids.get(1..).unwrap_or_default();
        let in_hand = Penetration::measure(&positions, player.layout(), but_body);
        row.max_share = row.max_share.max(all.share_inside);
        row.max_share_in_hand = row.max_share_in_hand.max(in_hand.share_inside);
        row.mean_share += all.share_inside / f64::from(scene.time.frames);
        row.deepest_m = row.deepest_m.max(all.deepest_m);
        if frame + 1 == moment(scene) {
            row.shape.clone_from(&positions);
        }
        if let Some(other) = &mut other {
            other.step()?;
            if (frame + 1) % every == 0 {
                other.positions(&mut without)?;
                let sum: f64 = positions.iter().zip(&without).map(|(a, b)| f64::from(a.distance(*b))).sum();
                row.parted.push([player.time_secs(), sum / positions.len().max(1) as f64]);
            }
        }
        observer(&Progress::Step);
    }
    row.ms_per_frame = Spread::of(&times);
    Ok(row)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table with `guides`, at a fiftieth of the strands.
    fn table(guides: u32) -> GuidesTable {
        let keys = ["body.sdf_cells=64".to_owned()];
        let table = GuidesTable::run(&[guides], 0.02, &keys, false, &mut |_| {}).unwrap();
        println!("{}", table.to_markdown());
        table
    }

    /// The paper's claim: guides let strands into the hand.
    #[test]
    fn guides_let_strands_into_the_hand() {
        let table = table(16);
        let [guided] = &*table.rows else { panic!() };
        assert_eq!((guided.simulated, table.strands), (16, 300));
        assert!(guided.max_share_in_hand > 5e-4 && guided.deepest_m > 1e-2, "{}", guided.max_share_in_hand);
        assert!(guided.parted.is_empty());
    }

    /// Simulated strands stay out of the hand, and close again behind it.
    #[test]
    fn simulated_strands_give_way_and_close() {
        let table = table(0);
        let [all] = &*table.rows else { panic!() };
        assert_eq!((all.simulated, table.strands), (300, 300));
        assert!(all.max_share <= 1e-4, "{}", all.max_share);
        assert_eq!(all.shape.len(), 300 * 30);
        let most = all.parted.iter().map(|[_, mean]| *mean).fold(0.0, f64::max);
        let [at, last] = all.parted[all.parted.len() - 1];
        assert!(most > 2e-3, "the hand parts the hair: {most}");
        assert!(at > 4.9 && last < 0.25 * most, "it closes again: {last} of {most} at {at} s");
    }
}
