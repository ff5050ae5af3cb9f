//! The AMS paper's ablations (Figs. 4 and 5) as tables and pictures.
//!
//! # Practice
//! Each figure is a scene in `scenes/ams`, built in; a row of its table is that scene with a few
//! keys changed, simulated in memory. Measured are: how far the particles end from their places at
//! rest, in the mean and over the strand's length L; the largest stretch of an edge in any frame;
//! and the root-mean-square acceleration in the last second, over gravity. Beside each stands the
//! reference, where there is one: what two float64 implementations of the paper's equations agree
//! on. A variant that breaks (a number is not finite) ends there.
//!
//! # Limitations
//! The paper states neither masses, substeps nor the strand; stiffness is taken per unit mass, and
//! the strands are ours. The trend is what can be compared with the paper, single values only with
//! the reference.

use std::fmt::Write as _;
use std::sync::Arc;

use forelock_core::groom::Groom;
use forelock_render::Image;
use glam::Vec3;
use serde::Serialize;

use super::scenes;
use crate::BenchError;
use forelock::Assets;
use forelock::Scene;
use forelock::{Studio, labelled};

/// A figure of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Figure {
    /// Fig. 4: plain mass-spring sags and breaks, AMS keeps the shape.
    Sag,
    /// Fig. 5: the angular spring keeps the wisp stable.
    Angular,
}

/// What can be measured of a variant of a figure's scene; `null` for what is not there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Measures {
    /// Mean distance of the particles from their places at rest at the end, over the strand's
    /// length.
    pub sag: Option<f64>,
    /// Largest |l/l₀ − 1| in any frame.
    pub max_stretch: Option<f64>,
    /// Root-mean-square acceleration in the last second, over 9.81 m/s².
    pub late_jitter_g: Option<f64>,
    /// Time at which the simulation broke, seconds.
    pub broke_at_secs: Option<f64>,
}

/// One variant of a figure's scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PaperRow {
    /// What was varied, in words.
    pub variant: String,
    /// What came out.
    pub measured: Measures,
    /// What the reference says.
    pub reference: Measures,
    /// Positions at the end or before the break, metres.
    #[serde(skip)]
    pub shape: Vec<Vec3>,
}

/// A figure's table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PaperTable {
    /// What it shows.
    pub title: &'static str,
    /// One row a variant.
    pub rows: Vec<PaperRow>,
}

/// A variant: its name, the keys that make it, and its reference.
struct Variant {
    name: String,
    keys: Vec<String>,
    reference: Measures,
}

impl Variant {
    fn new(name: String, keys: &[String], reference: Measures) -> Self {
        Self { name, keys: keys.to_vec(), reference }
    }
}

/// A reference sag.
fn sag(sag: f64) -> Measures {
    Measures { sag: Some(sag), ..Measures::default() }
}

/// The keys that set edge, bend and torsion springs of the solver `table` to `k`.
fn springs(table: &str, k: f64) -> Vec<String> {
    ["edge", "bend", "torsion"].map(|spring| format!("solver.{table}.k_{spring}={k:e}")).to_vec()
}

/// Fig. 4: mass-spring on the groom's particles, where the reference is from, and with virtual
/// particles; then AMS.
fn sag_variants() -> Vec<Variant> {
    let mut variants = Vec::new();
    let breaks = Measures { broke_at_secs: Some(0.0), ..Measures::default() };
    let plain = [(1e4, sag(0.45)), (1e6, sag(0.37)), (1e7, sag(0.30)), (1e8, sag(0.25))];
    for (k, reference) in plain.into_iter().chain([(1e10, breaks)]) {
        let mut keys = springs("mass_spring", k);
        keys.push("solver.kind=mass-spring".to_owned());
        variants.push(Variant::new(format!("mass-spring, κ_L {k:e}"), &keys, reference));
    }
    for k in [1e4, 1e6, 1e7, 1e8, 1e10] {
        let mut keys = springs("mass_spring", k);
        keys.extend(
            [
                "kind=mass-spring",
                "mass_spring.virtual_particles=true",
                &format!("mass_spring.k_altitude={k:e}"),
            ]
            .map(|key| format!("solver.{key}")),
        );
        variants.push(Variant::new(format!("mass-spring 2N-1, κ_L {k:e}"), &keys, Measures::default()));
    }
    // Without preload and at the default substeps, the sag that each κ_I leaves.
    let ties =
        [(0.0, 0.37), (10.0, 0.35), (30.0, 0.30), (100.0, 0.21), (300.0, 0.087), (1e3, 0.030), (1e4, 0.003)];
    for (k, expected) in ties {
        let mut keys = springs("ams", 1e6);
        keys.extend(
            ["sag_free=false", "jacobian=tension", &format!("k_integrity={k:e}")]
                .map(|key| format!("solver.ams.{key}")),
        );
        variants.push(Variant::new(format!("AMS, κ_L 1e6, κ_I {k}, no preload"), &keys, sag(expected)));
    }
    let without = ["solver.ams.sag_free=false".to_owned()];
    variants.push(Variant::new("AMS, κ_L 1e7, κ_I 100, no preload".to_owned(), &without, sag(0.18)));
    variants.push(Variant::new("AMS, κ_L 1e7, κ_I 100".to_owned(), &[], sag(0.0)));
    variants
}

/// Fig. 5.
fn angular_variants() -> Vec<Variant> {
    [(100, 0.01, 0.0), (10, 0.9, 0.6), (1, 2.9, 1.2), (0, 3.6, 1.1)]
        .map(|(k, stretch, jitter)| {
            let reference =
                Measures { max_stretch: Some(stretch), late_jitter_g: Some(jitter), ..Measures::default() };
            Variant::new(format!("κ_α {k}, M 1"), &[format!("solver.ams.k_angular={k}")], reference)
        })
        .into()
}

impl Figure {
    /// Its scene with `keys` over it, and its strands.
    fn load(self, keys: &[String]) -> Result<(Scene, Arc<Assets>), BenchError> {
        let keys = [&["solver.beyond_float32=true".to_owned()], keys].concat();
        let (scene, strands) = match self {
            Self::Sag => (scenes::FIGURE4, scenes::HELIX),
            Self::Angular => (scenes::FIGURE5, scenes::WISP),
        };
        let scene = scene.scene(1.0, &keys)?;
        let assets = scenes::alone(&scene, strands)?;
        Ok((scene, assets))
    }

    /// Runs every variant.
    ///
    /// # Errors
    /// [`BenchError`] if a variant cannot be simulated.
    pub fn table(self) -> Result<PaperTable, BenchError> {
        let (title, variants) = match self {
            Self::Sag => ("AMS, Fig. 4: one curly strand under gravity for 5 s", sag_variants()),
            Self::Angular => {
                ("AMS, Fig. 5: a wisp tilted by 45° in 1 s and held for 3 s", angular_variants())
            }
        };
        let rows = variants.into_iter().map(|variant| measure(self, variant));
        Ok(PaperTable { title, rows: rows.collect::<Result<_, _>>()? })
    }

    /// The strands of every row of `table`, which is this figure's, at its end, side by side.
    ///
    /// # Errors
    /// [`BenchError`] if they cannot be drawn.
    pub fn picture(self, table: &PaperTable) -> Result<Image, BenchError> {
        let (scene, assets) = self.load(&[])?;
        let studio = Studio::new(&scene, &assets);
        let end_secs = f64::from(scene.time.frames) / scene.time.fps;
        let mut pictures = Vec::new();
        for row in &table.rows {
            let broken = row.measured.broke_at_secs.map(|secs| format!(" - broke at {secs:.2} s"));
            let label = format!("{}{}", row.variant, broken.unwrap_or_default());
            // The sheet's letters are Latin.
            let label = label.replace('κ', "k").replace('α', "a");
            pictures.push((studio.picture(&row.shape, end_secs, 1.0)?, label));
        }
        Ok(labelled(&pictures, if self == Self::Sag { 5 } else { 4 })?)
    }
}

fn measure(figure: Figure, variant: Variant) -> Result<PaperRow, BenchError> {
    let (scene, assets) = figure.load(&variant.keys)?;
    let mut player = scenes::player(&scene, &assets)?;
    let frames = scene.time.frames;
    let late = frames.saturating_sub(scene.time.fps as u32);
    let (mut stretch, mut square_sum, mut terms) = (0.0_f64, 0.0, 0usize);
    let mut tracks: [Vec<Vec3>; 3] = Default::default();
    player.positions(&mut tracks[2])?;
    for frame in 0..frames {
        let report = player.step()?.solver;
        if report.quarantined_strands > 0 {
            let broke_at_secs = Some(f64::from(frame + 1) / scene.time.fps);
            let measured = Measures { broke_at_secs, ..Measures::default() };
            let [_, _, shape] = tracks;
            return Ok(PaperRow { variant: variant.name, measured, reference: variant.reference, shape });
        }
        stretch = stretch.max(report.max_edge_stretch_final);
        tracks.rotate_left(1);
        player.positions(&mut tracks[2])?;
        if frame >= late {
            for ((a, b), c) in tracks[0].iter().zip(&tracks[1]).zip(&tracks[2]) {
                let acceleration = (*c - *b - (*b - *a)).as_dvec3() * scene.time.fps * scene.time.fps;
                square_sum += acceleration.length_squared();
                terms += 1;
            }
        }
    }
    let end = assets.head_pose(f64::from(frames) / scene.time.fps);
    let rest = assets.groom.positions().iter().map(|p| end.transform_point(p.as_dvec3()).as_vec3());
    let distances = tracks[2].iter().zip(rest).map(|(x, y)| f64::from(x.distance(y)));
    let mean = distances.sum::<f64>() / tracks[2].len().max(1) as f64;
    let measured = Measures {
        sag: Some(mean / longest(&assets.groom)),
        max_stretch: Some(stretch),
        late_jitter_g: Some((square_sum / terms.max(1) as f64).sqrt() / 9.81),
        broke_at_secs: None,
    };
    let [_, _, shape] = tracks;
    Ok(PaperRow { variant: variant.name, measured, reference: variant.reference, shape })
}

fn longest(groom: &Groom) -> f64 {
    (0..groom.strand_count()).map(|strand| f64::from(groom.length(strand))).fold(0.0, f64::max)
}

impl PaperTable {
    /// The table as Markdown: what was measured, and in brackets the reference.
    pub fn to_markdown(&self) -> String {
        let mut text = format!(
            "{}\n\n| variant | sag / L | largest stretch | late jitter, g |\n| --- | ---: | ---: | ---: |\n",
            self.title
        );
        for row in &self.rows {
            let PaperRow { variant, measured, reference, .. } = row;
            let cell = |measure: fn(&Measures) -> Option<f64>| {
                let measured = measure(measured).map_or_else(
                    || measured.broke_at_secs.map_or(String::new(), |secs| format!("broke at {secs:.2} s")),
                    number,
                );
                let broken = reference.broke_at_secs.map(|_| "breaks".to_owned());
                let reference = measure(reference).map(number).or(broken);
                reference.map_or(measured.clone(), |reference| format!("{measured} ({reference})"))
            };
            let cells = [cell(|m| m.sag), cell(|m| m.max_stretch), cell(|m| m.late_jitter_g)];
            let _ = writeln!(text, "| {variant} | {} |", cells.join(" | "));
        }
        text.push_str("\nIn brackets: the reference, in float64.\n");
        text
    }
}

fn number(value: f64) -> String {
    match value {
        value if value != 0.0 && value.abs() < 0.001 => format!("{value:.1e}"),
        value if value.abs() < 0.1 => format!("{value:.3}"),
        value => format!("{value:.2}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every sag agrees with the reference within 0.01 of a length, and what should break does.
    #[test]
    fn ams_keeps_the_shape_where_mass_spring_sags_and_then_breaks() {
        let rows = Figure::Sag.table().unwrap().rows;
        for row in &rows {
            if let Some(reference) = row.reference.sag {
                assert!((row.measured.sag.unwrap() - reference).abs() < 0.01, "{row:?}");
            }
            if row.reference.broke_at_secs.is_some() {
                assert!(row.measured.broke_at_secs.unwrap() < 1.0, "{row:?}");
            }
        }
        let find = |name: &str| rows.iter().find(|row| row.variant == name).unwrap().measured;
        assert!(find("AMS, κ_L 1e7, κ_I 100").sag.unwrap() < 1e-5);
        // Virtual particles and altitude springs make it sag less as it stiffens, but sag.
        let sags = [1e4, 1e6, 1e7, 1e8].map(|k| find(&format!("mass-spring 2N-1, κ_L {k:e}")).sag.unwrap());
        assert!(sags.is_sorted_by(|a, b| a > b) && sags[3] > 0.1, "{sags:?}");
    }

    #[test]
    fn a_weaker_angular_spring_is_less_stable() {
        let rows = Figure::Angular.table().unwrap().rows;
        let stretch: Vec<f64> = rows.iter().map(|row| row.measured.max_stretch.unwrap()).collect();
        // Where the wisp explodes, how far depends on each detail.
        let [stable, weaker, exploded @ ..] = &stretch[..] else { panic!("{stretch:?}") };
        assert!(*stable < 0.02 && *weaker > 1.0, "{stretch:?}");
        assert!(exploded.len() == 2 && exploded.iter().all(|other| *other > 2.0 * weaker), "{stretch:?}");
        let jitter: Vec<f64> = rows.iter().map(|row| row.measured.late_jitter_g.unwrap()).collect();
        assert!(jitter[0] < 1e-3 && jitter[1..].iter().all(|g| *g > 0.5), "{jitter:?}");
    }

    #[test]
    fn tables_put_the_reference_beside_the_figure() {
        let row = |measured, reference| PaperRow {
            variant: "stiff".into(),
            measured,
            reference,
            shape: Vec::new(),
        };
        let broken = Measures { broke_at_secs: Some(0.5), ..Measures::default() };
        let rows = vec![row(sag(0.449), sag(0.45)), row(broken, broken)];
        let text = PaperTable { title: "A figure", rows }.to_markdown();
        assert!(text.contains("\n| stiff | 0.45 (0.45) |  |  |\n"), "{text}");
        assert!(text.contains("| stiff | broke at 0.50 s (breaks) |"), "{text}");
    }
}
