//! The AMS paper's ablations (Figs. 4 and 5) as tables.
//!
//! # Practice
//! Each figure is a scene in `scenes/ams`, built in; a row of its table is that scene with a few keys changed, simulated in
//! memory. Measured are, over the strand's length L: how far the worst particle ends from its place at rest; the
//! largest stretch of an edge in any frame; and the root-mean-square acceleration in the last second, over gravity.
//!
//! # Limitations
//! The paper states neither masses, substeps nor the strand; stiffness is taken per unit mass, and the strands are ours. The
//! trend is what can be compared, not single values.

use std::fmt::Write as _;
use std::path::Path;

use forelock_core::groom::Groom;
use glam::Vec3;
use serde::Serialize;

use crate::assets::Assets;
use crate::run::{RunError, Stepper};
use crate::scene::{Override, Scene};

/// A figure of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Figure {
    /// Fig. 4: plain mass-spring sags and breaks, AMS keeps the shape.
    Sag,
    /// Fig. 5: the angular spring keeps the wisp stable.
    Angular,
}

/// What was measured of one variant of a figure's scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PaperRow {
    /// What was varied, in words.
    pub variant: String,
    /// Mean distance of the particles from their places at rest at the end, over the strand's length; `null` if the
    /// simulation broke.
    pub sag: Option<f64>,
    /// Largest |l/l₀ − 1| in any frame; `null` if the simulation broke.
    pub max_stretch: Option<f64>,
    /// Root-mean-square acceleration in the last second, over 9.81 m/s²; `null` if the simulation broke.
    pub late_jitter_g: Option<f64>,
    /// Times that a strand became non-finite and was put back to rest.
    pub breaks: u64,
}

/// A figure's table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PaperTable {
    /// What it shows.
    pub title: &'static str,
    /// One row a variant.
    pub rows: Vec<PaperRow>,
}

/// A figure's scene and strands.
struct Source {
    title: &'static str,
    scene: &'static str,
    strands: &'static [u8],
}

impl Figure {
    fn source(self) -> Source {
        match self {
            Self::Sag => Source {
                title: "AMS, Fig. 4: one curly strand under gravity for 5 s",
                scene: include_str!("../../../scenes/ams/figure4.toml"),
                strands: include_bytes!("../../../scenes/ams/helix.obj"),
            },
            Self::Angular => Source {
                title: "AMS, Fig. 5: a wisp tilted by 45° in 1 s and held for 3 s",
                scene: include_str!("../../../scenes/ams/figure5.toml"),
                strands: include_bytes!("../../../scenes/ams/wisp.obj"),
            },
        }
    }

    /// Name of each variant and the keys that make it.
    fn variants(self) -> Vec<(String, Vec<String>)> {
        match self {
            Self::Sag => {
                let springs = |k: f64| ["edge", "bend", "torsion"].map(|s| format!("solver.ams.k_{s}={k:e}"));
                let mut variants: Vec<_> = [1e4, 1e6, 1e7, 1e8, 1e9, 1e10]
                    .into_iter()
                    .map(|k| {
                        let mut keys = springs(k).to_vec();
                        keys.extend(
                            ["solver.kind=mass-spring", "solver.ams.sag_free=false", "solver.ams.substeps=5"]
                                .map(Into::into),
                        );
                        (format!("mass-spring, κ_L {k:e}, M 5"), keys)
                    })
                    .collect();
                let without = vec!["solver.ams.sag_free=false".to_owned()];
                variants.push(("AMS, κ_L 1e7, κ_I 1e2, M 10, without preload".to_owned(), without));
                variants.push(("AMS, κ_L 1e7, κ_I 1e2, M 10".to_owned(), Vec::new()));
                variants
            }
            Self::Angular => [100, 10, 1, 0]
                .map(|k| (format!("κ_α {k}, M 1"), vec![format!("solver.ams.k_angular={k}")]))
                .to_vec(),
        }
    }

    /// Runs every variant.
    ///
    /// # Errors
    /// [`RunError`] if a variant cannot be simulated.
    pub fn table(self) -> Result<PaperTable, RunError> {
        let source = self.source();
        let mut rows = Vec::new();
        for (variant, keys) in self.variants() {
            rows.push(measure(&source, variant, &keys)?);
        }
        Ok(PaperTable { title: source.title, rows })
    }
}

fn measure(source: &Source, variant: String, keys: &[String]) -> Result<PaperRow, RunError> {
    let mut overrides = vec![Override::option("", "solver.beyond_float32", true)];
    for key in keys {
        overrides.push(Override::set(key)?);
    }
    let scene = Scene::parse(source.scene, Path::new("scenes/ams"), &overrides)?;
    let groom = forelock_io::obj::read_groom(source.strands)
        .map_err(|error| forelock_io::ReadError::Format { path: "scenes/ams".into(), source: error });
    let groom = groom.map_err(crate::assets::AssetError::from)?;
    let assets = Assets::around(&scene, groom)?;
    let mut stepper = Stepper::new(&scene, &assets)?;
    let frames = scene.time.frames;
    let late = frames.saturating_sub(scene.time.fps as u32);
    let (mut stretch, mut breaks, mut square_sum, mut terms) = (0.0_f64, 0, 0.0, 0usize);
    let mut tracks: [Vec<Vec3>; 3] = Default::default();
    for frame in 0..frames {
        let report = stepper.step(frame)?;
        stretch = stretch.max(report.max_edge_stretch_final);
        breaks += u64::from(report.quarantined_strands);
        tracks.rotate_left(1);
        stepper.simulation.positions(&mut tracks[2]);
        if frame >= late {
            for ((a, b), c) in tracks[0].iter().zip(&tracks[1]).zip(&tracks[2]) {
                let acceleration = (*c - *b - (*b - *a)).as_dvec3() * scene.time.fps * scene.time.fps;
                square_sum += acceleration.length_squared();
                terms += 1;
            }
        }
    }
    let sound = breaks == 0 && stretch.is_finite();
    let end = assets.head_pose(f64::from(frames) / scene.time.fps);
    let rest = assets.groom.positions().iter().map(|p| end.transform_point(p.as_dvec3()).as_vec3());
    let distances = tracks[2].iter().zip(rest).map(|(x, y)| f64::from(x.distance(y)));
    let mean = distances.sum::<f64>() / tracks[2].len().max(1) as f64;
    let jitter = (square_sum / terms.max(1) as f64).sqrt() / 9.81;
    Ok(PaperRow {
        variant,
        sag: sound.then_some(mean / longest(&assets.groom)),
        max_stretch: sound.then_some(stretch),
        late_jitter_g: sound.then_some(jitter),
        breaks,
    })
}

fn longest(groom: &Groom) -> f64 {
    (0..groom.strand_count()).map(|strand| f64::from(groom.length(strand))).fold(0.0, f64::max)
}

impl PaperTable {
    /// The table as Markdown.
    pub fn to_markdown(&self) -> String {
        let mut text = format!(
            "{}\n\n| variant | sag / L | largest stretch | late jitter, g | breaks |\n| --- | ---: | ---: | ---: | ---: |\n",
            self.title
        );
        let number = |value: Option<f64>| match value {
            None => "broke".to_owned(),
            Some(value) if value != 0.0 && value.abs() < 0.01 => format!("{value:.1e}"),
            Some(value) => format!("{value:.2}"),
        };
        for row in &self.rows {
            let _ = writeln!(
                text,
                "| {} | {} | {} | {} | {} |",
                row.variant,
                number(row.sag),
                number(row.max_stretch),
                number(row.late_jitter_g),
                row.breaks
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ams_keeps_the_shape_where_mass_spring_sags_and_then_breaks() {
        let rows = Figure::Sag.table().unwrap().rows;
        let (ams, others) = rows.split_last().unwrap();
        let (without_preload, mass_spring) = others.split_last().unwrap();
        assert!(ams.sag.unwrap() < 1e-5, "{ams:?}");
        assert!((0.1..0.3).contains(&without_preload.sag.unwrap()), "{without_preload:?}");
        let (stiffest, others) = mass_spring.split_last().unwrap();
        assert!(stiffest.breaks > 0, "{stiffest:?}");
        assert!(others.iter().all(|row| row.sag.unwrap() > 0.4), "{others:?}");
    }

    #[test]
    fn a_weaker_angular_spring_is_less_stable() {
        let rows = Figure::Angular.table().unwrap().rows;
        let stretch: Vec<f64> = rows.iter().map(|row| row.max_stretch.unwrap()).collect();
        assert!(stretch.is_sorted() && stretch[0] < 0.02 && stretch[3] > 2.0, "{stretch:?}");
        assert!(rows[0].late_jitter_g.unwrap() < 1e-3, "{:?}", rows[0]);
        assert!(rows[1..].iter().all(|row| row.late_jitter_g.unwrap() > 0.5), "{rows:?}");
    }

    #[test]
    fn tables_say_what_broke() {
        let broken = PaperRow {
            variant: "stiff".into(),
            sag: None,
            max_stretch: Some(0.5),
            late_jitter_g: Some(1e-3),
            breaks: 2,
        };
        let text = PaperTable { title: "A figure", rows: vec![broken] }.to_markdown();
        assert!(text.ends_with("| stiff | broke | 0.50 | 1.0e-3 | 2 |\n"), "{text}");
    }
}
