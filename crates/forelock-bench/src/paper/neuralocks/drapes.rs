//! Figs. 7 and 11: static shapes under several energies.

use std::time::Instant;

use forelock::{Assets, Observer, Progress, Scene, Studio, labelled};
use forelock_core::lane::{Mat3, V3};
use forelock_neural::losses::body::{Body, Near};
use forelock_neural::losses::elastic::{ElasticTerms, RestStrand, Transport, elastic};
use forelock_neural::losses::motion::{MotionTerms, Place};
use forelock_neural::losses::{Strand, zero};
use forelock_neural::reference::{Terms, motion};
use forelock_neural::{EDGES, PARTICLES};
use forelock_render::Image;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::NeuralOptions;
use super::models::demo;
use crate::BenchError;
use crate::paper::study::{Strip, Study, Table, percent};
use crate::paper::watch::mean;

/// Strands that are draped.
const STRANDS: f64 = 192.0;
/// Strands of which energies are timed, and how often.
const TIMED: [usize; 2] = [64, 40];

/// Gravity from above, and from the side, cm/s².
const DOWN: DVec3 = DVec3::new(0.0, -981.0, 0.0);
const SIDEWAYS: DVec3 = DVec3::new(981.0, 0.0, 0.0);

/// No body: hair hangs freely.
struct Nothing;

impl Body<f64> for Nothing {
    fn near(&self, _: V3<f64>) -> Near<f64> {
        Near { distance: 1e6, gradient: V3::zero() }
    }
}

/// Hair that is draped, before a camera.
struct Hair {
    scene: Scene,
    assets: Assets,
    /// Its strands at rest, cm.
    rest: Vec<Strand<f64>>,
}

impl Hair {
    /// Strands of `preset`, before a camera at `distance` times the usual one.
    fn grown(
        preset: &str,
        distance: f64,
        options: &NeuralOptions,
        observer: &mut Observer<'_>,
    ) -> Result<Self, BenchError> {
        let (mut scene, assets) = demo(preset, STRANDS * options.scenes.share, &[], observer)?;
        let cm = |x: &Vec3| V3((100.0 * x.as_dvec3()).to_array());
        let one = |x: &[Vec3]| std::array::from_fn(|i| cm(&x[i]));
        let rest = assets.groom.strands().map(one).collect();
        // Hair hangs through where the head would be.
        scene.body.mesh = "none".into();
        scene.camera.distance = distance;
        let assets = Assets::around(&scene, assets.groom.clone())?;
        Ok(Self { scene, assets, rest })
    }

    /// `strands`, cm, before the camera.
    fn picture(&self, strands: &[Strand<f64>], label: &str) -> Result<(Image, String), BenchError> {
        let metres = |x: &V3<f64>| (0.01 * DVec3::from_array(x.0)).as_vec3();
        let positions: Vec<Vec3> = strands.iter().flatten().map(metres).collect();
        let image = Studio::new(&self.scene, &self.assets).picture(&positions, 0.0, 0.5)?;
        Ok((image, label.to_uppercase()))
    }
}

/// Gravity and nothing else, cm/s².
fn still(gravity: DVec3) -> MotionTerms {
    MotionTerms { is_dynamic: false, gravity, ..MotionTerms::default() }
}

/// `strands` at rest under `terms` and `gravity`, cm.
fn drape(strands: &[Strand<f64>], gravity: DVec3, terms: ElasticTerms) -> Vec<Strand<f64>> {
    let terms = Terms { elastic: terms, motion: still(gravity), ..Terms::default() };
    let place = Place { rotation: Mat3::splat(glam::DMat3::IDENTITY), origin: V3::zero() };
    let one = |rest: &Strand<f64>| motion(&terms, rest, &[place], &[Nothing])[0];
    strands.par_iter().map(one).collect()
}

fn distances<'a>(a: &'a [Strand<f64>], b: &'a [Strand<f64>]) -> impl Iterator<Item = f64> + 'a {
    let of_strand =
        |(a, b): (&'a Strand<f64>, &'a Strand<f64>)| a.iter().zip(b).map(|(x, y)| length(*x - *y));
    a.iter().zip(b).flat_map(of_strand)
}

fn length(x: V3<f64>) -> f64 {
    x.dot(x).sqrt()
}

/// Microseconds of the elastic energy and its gradient, a strand, on one thread in float64: the
/// least of several passes.
fn micros(strands: &[Strand<f64>], terms: &ElasticTerms) -> f64 {
    let [count, passes] = TIMED;
    let own: Vec<_> = strands.iter().cycle().take(count).map(|x| (x, RestStrand::new(x, terms))).collect();
    let pass = || {
        let began = Instant::now();
        for (x, rest) in &own {
            let mut by_x = zero();
            std::hint::black_box(elastic(terms, rest, x, &mut by_x));
            std::hint::black_box(&by_x);
        }
        1e6 * began.elapsed().as_secs_f64() / count as f64
    };
    (0..passes).map(|_| pass()).fold(f64::INFINITY, f64::min)
}

/// Fig. 7: how frames are carried along a strand.
pub(super) fn transport(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let kinds = [
        ("sequential (full)", Transport::Sequential, "980"),
        ("direct (as printed)", Transport::Direct, "160"),
        ("direct from the chord", Transport::Chord, "–"),
    ];
    let columns =
        ["hair", "transport", "from sequential, mean cm", "at most", "µs a strand", "paper, ms a batch"];
    let mut table = Table::new("", &columns);
    let presets = ["straight", "wavy", "curly"];
    observer(&Progress::Begin { what: "draping", done: 0, total: 3 * presets.len() as u64 });
    let mut pictures = Vec::new();
    for preset in presets {
        let hair = Hair::grown(preset, 1.1, options, &mut |_| {})?;
        let mut sequential = Vec::new();
        for (name, transport, paper) in kinds {
            let terms = ElasticTerms { transport, ..ElasticTerms::default() };
            let found = drape(&hair.rest, DOWN, terms);
            if transport == Transport::Sequential {
                sequential.clone_from(&found);
            }
            let most = distances(&found, &sequential).fold(0.0, f64::max);
            table.rows.push(vec![
                preset.to_owned(),
                name.to_owned(),
                format!("{:.2}", mean(distances(&found, &sequential))),
                format!("{most:.2}"),
                format!("{:.2}", micros(&hair.rest, &terms)),
                paper.to_owned(),
            ]);
            pictures.push(hair.picture(&found, &format!("{preset}, {name}"))?);
            observer(&Progress::Step);
        }
    }
    observer(&Progress::End);
    Ok(Study {
        title: "Neuralocks, Fig. 7: frames carried along a strand".to_owned(),
        claim: "direct transport is six times as fast as the full one, and deforms hair much alike."
            .to_owned(),
        notes: vec![
            "Hair hanging at rest under gravity without a body, beside its shape under sequential \
             transport. Times are of the energy with its gradient, float64, one thread; the paper's are of \
             a batch of unknown size on a GPU. Compiled, transports differ little in cost: the factor is one \
             of many small tensor operations."
                .to_owned(),
        ],
        tables: vec![table],
        strips: vec![Strip {
            name: "drapes",
            title: "Hair at rest under each transport".to_owned(),
            image: labelled(&pictures, kinds.len() as u32)?,
        }],
        ..Study::default()
    })
}

/// The least of Quaffure's energy, k/2 Σ l⁰ |e/l⁰ − d⁰|², and gravity: directors d⁰ held at rest,
/// so each edge answers to the weight below it alone, e = l⁰ (d⁰ + F/k).
fn held_directors(rest: &Strand<f64>, gravity: DVec3, stiffness: f64) -> Strand<f64> {
    let weight = gravity * still(gravity).mass;
    let mut x = *rest;
    for i in 0..EDGES {
        let edge = rest[i + 1] - rest[i];
        let below = (EDGES - i) as f64;
        let force = V3((weight * below).to_array());
        x[i + 1] = x[i] + edge.add_scaled(length(edge) / stiffness, force);
    }
    x
}

/// Fig. 11: stiffness, beside an older energy.
pub(super) fn stiffness(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let hair = Hair::grown("wavy", 1.7, options, observer)?;
    let rest = &hair.rest;
    let columns =
        ["energy", "stiffness", "tips along gravity, cm", "tips from gravity, degrees", "edges off by"];
    let mut table = Table::new("", &columns);
    let mut pictures = vec![hair.picture(rest, "at rest")?];
    for bend_twist in [10.0, 100.0, 1000.0] {
        let found = drape(rest, SIDEWAYS, ElasticTerms { bend_twist, ..ElasticTerms::default() });
        pictures.push(hair.picture(&found, &format!("bend-twist {bend_twist}"))?);
        table.rows.push(row("bending and twist", bend_twist, rest, &found));
    }
    pictures.push(hair.picture(rest, "at rest")?);
    for held in [10.0, 100.0, 1000.0] {
        let found: Vec<_> = rest.iter().map(|x| held_directors(x, SIDEWAYS, held)).collect();
        pictures.push(hair.picture(&found, &format!("held directors {held}"))?);
        table.rows.push(row("directors held at rest (Quaffure)", held, rest, &found));
    }
    Ok(Study {
        title: "Neuralocks, Fig. 11: stiffness, beside an older energy".to_owned(),
        claim: "bending and twist turn hair towards gravity and keep its shape at any stiffness; held directors make it rigid.".to_owned(),
        notes: vec![
            "Wavy hair at rest without a body, with gravity from the side. Angles are those between the \
             last third of a strand and gravity, in the mean. Stiffnesses of the two energies are in g \
             cm³/s² and g cm/s²."
                .to_owned(),
        ],
        tables: vec![table],
        strips: vec![Strip {
            name: "drapes",
            title: "Hair at rest, softer to stiffer".to_owned(),
            image: labelled(&pictures, 4)?,
        }],
        ..Study::default()
    })
}

/// A row of Fig. 11.
fn row(energy: &str, stiffness: f64, rest: &[Strand<f64>], found: &[Strand<f64>]) -> Vec<String> {
    let tip = PARTICLES - 1;
    let along = SIDEWAYS.normalize();
    let sag =
        mean(rest.iter().zip(found).map(|(rest, x)| DVec3::from_array((x[tip] - rest[tip]).0).dot(along)));
    let angle = |x: &Strand<f64>| {
        let end = DVec3::from_array((x[tip] - x[tip - EDGES / 3]).0);
        end.angle_between(along).to_degrees()
    };
    let off = |(rest, x): (&Strand<f64>, &Strand<f64>)| {
        let edge = |x: &Strand<f64>, i: usize| length(x[i + 1] - x[i]);
        (0..EDGES).map(|i| (edge(x, i) / edge(rest, i) - 1.0).abs()).fold(0.0, f64::max)
    };
    let off = rest.iter().zip(found).map(off).fold(0.0, f64::max);
    vec![
        energy.to_owned(),
        format!("{stiffness}"),
        format!("{sag:.2}"),
        format!("{:.1}", mean(found.iter().map(angle))),
        percent(off),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strand along x of 24 edges of 1 cm.
    fn straight() -> Strand<f64> {
        std::array::from_fn(|i| V3([i as f64, 0.0, 0.0]))
    }

    #[test]
    fn held_directors_are_at_the_least_of_their_energy() {
        let rest = straight();
        let (k, still) = (5.0, still(SIDEWAYS));
        let energy = |x: &Strand<f64>| {
            let edge = |i: usize| {
                let off = (x[i + 1] - x[i]) - (rest[i + 1] - rest[i]);
                0.5 * k * off.dot(off) - still.mass * still.gravity.dot(DVec3::from_array(x[i + 1].0))
            };
            (0..EDGES).map(edge).sum::<f64>()
        };
        let least = held_directors(&rest, SIDEWAYS, k);
        for i in 1..PARTICLES {
            for c in 0..3 {
                let moved = |h: f64| {
                    let mut x = least;
                    x[i].0[c] += h;
                    energy(&x)
                };
                assert!((moved(1e-4) - moved(-1e-4)).abs() < 1e-10, "particle {i}");
            }
        }
    }

    #[test]
    fn all_transports_drape_a_straight_strand_alike() {
        let rest = [straight()];
        let of = |transport| drape(&rest, DOWN, ElasticTerms { transport, ..ElasticTerms::default() });
        let sequential = of(Transport::Sequential);
        assert!(sequential[0][24].0[1] < -1.0, "it sags");
        assert!(distances(&of(Transport::Direct), &sequential).all(|d| d < 1e-4));
    }
}
