//! Hair followed through a scene: how far it is from its shape, how much room it takes, what energy
//! it has, what it costs.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Instant;

use forelock_render::Image;
use glam::Vec3;

use crate::BenchError;
use crate::plot::{Line, Plot};
use forelock::Assets;
use forelock::Scene;
use forelock::Studio;
use forelock::penetration::Penetration;
use forelock::{Observer, Progress};

use super::scenes;
use super::watch::{mean, offset};

/// Side of the cells in which room is counted, metres.
const CELL: f32 = 0.01;

/// A scene with one choice of solver and keys.
pub(super) struct Case {
    /// Its name.
    pub label: String,
    pub scene: Scene,
}

/// Pictures to take.
pub(super) struct Shots<'a> {
    /// When, as shares of the scene's time.
    pub moments: &'a [f64],
    /// How much larger than the scene asks for.
    pub scale: f64,
}

/// What happened, a value a frame, the first at the start.
pub(super) struct Followed {
    pub label: String,
    /// Mean distance from the rest shape in the head's frame over the strand's length.
    pub shape: Vec<f64>,
    /// Volume of the cells of 1 cm that hold hair, in the head's frame, litres.
    pub volume: Vec<f64>,
    /// Kinetic energy of hair relative to the rest shape as the head moves it, and potential from
    /// its height over that, J/kg.
    pub energy: Vec<f64>,
    /// Milliseconds a frame, median of all.
    pub ms: f64,
    /// Memory of the simulation at the end, bytes.
    pub bytes: u64,
    /// Largest |l/l₀ − 1| of an edge after the length pass, and at the end of a frame.
    pub stretch: [f64; 2],
    /// Largest share of particles more than 1 mm inside a solid, but for those clamped to the head.
    pub inside: f64,
    /// At the moments asked for.
    pub pictures: Vec<(Image, String)>,
}

impl Followed {
    /// Runs `case`, of `assets`, and takes `shots` of it.
    pub fn run(
        case: &Case,
        assets: &Arc<Assets>,
        shots: &Shots<'_>,
        observer: &mut Observer<'_>,
    ) -> Result<Self, BenchError> {
        let scene = &case.scene;
        let frames = scene.time.frames;
        let (mut player, studio) = (scenes::player(scene, assets)?, Studio::new(scene, assets));
        let all: Vec<usize> = (0..assets.groom.strand_count()).collect();
        let mut followed = Self {
            label: case.label.clone(),
            shape: Vec::new(),
            volume: Vec::new(),
            energy: Vec::new(),
            ms: 0.0,
            bytes: 0,
            stretch: [0.0; 2],
            inside: 0.0,
            pictures: Vec::new(),
        };
        let wanted: Vec<u32> = shots.moments.iter().map(|m| (m * f64::from(frames)).round() as u32).collect();
        let (mut positions, mut before, mut times) = (Vec::new(), Vec::new(), Vec::new());
        observer(&Progress::Begin { what: "following", done: 0, total: frames.into() });
        for frame in 0..=frames {
            if frame > 0 {
                let started = Instant::now();
                let report = player.step()?.solver;
                times.push(started.elapsed().as_secs_f64() * 1e3);
                let stretch = [report.max_edge_stretch, report.max_edge_stretch_final];
                followed.stretch = [0, 1].map(|k| followed.stretch[k].max(stretch[k]));
                observer(&Progress::Step);
            }
            player.positions(&mut positions)?;
            if frame > 0 {
                let solids = player.measured_solids();
                let measured = Penetration::measure(&positions, player.layout(), &solids);
                followed.inside = followed.inside.max(measured.share_inside);
            }
            let head = player.head_pose();
            followed.shape.push(offset(&assets.groom, &all, &head, &positions).over_length);
            let own = head.inverse();
            let local = positions.iter().map(|p| own.transform_point(p.as_dvec3()).as_vec3());
            followed.volume.push(occupied_litres(local));
            let rest = assets.groom.positions().iter().map(|p| head.transform_point(p.as_dvec3()).as_vec3());
            let away: Vec<Vec3> = positions.iter().zip(rest).map(|(x, rest)| *x - rest).collect();
            followed.energy.push(energy(&away, if frame > 0 { &before } else { &away }, scene));
            before = away;
            if let Some(number) = wanted.iter().position(|&moment| moment == frame) {
                let time = player.time_secs();
                let time_label = format!("{time:.2} S");
                let label = if number == 0 { format!("{}  {time_label}", case.label) } else { time_label };
                followed.pictures.push((studio.picture(&positions, time, shots.scale)?, label));
            }
        }
        observer(&Progress::End);
        followed.bytes = player.simulation_bytes();
        times.sort_by(f64::total_cmp);
        followed.ms = times.get(times.len() / 2).copied().unwrap_or(0.0);
        Ok(followed)
    }

    /// The mean of `values` over their last quarter.
    pub fn late(values: &[f64]) -> f64 {
        let from = values.len() - values.len().div_ceil(4);
        mean(values[from..].iter().copied())
    }
}

fn occupied_litres(points: impl Iterator<Item = Vec3>) -> f64 {
    let cells: HashSet<[i32; 3]> =
        points.filter(|p| p.is_finite()).map(|p| (p / CELL).floor().as_ivec3().to_array()).collect();
    cells.len() as f64 * f64::from(CELL).powi(3) * 1e3
}

/// Mean kinetic and gravitational energy of the particles per mass, m²/s², from the positions `now`
/// and those one frame `before`.
fn energy(now: &[Vec3], before: &[Vec3], scene: &Scene) -> f64 {
    let gravity = glam::DVec3::from_array(scene.gravity);
    let of_particle = |(now, before): (&Vec3, &Vec3)| {
        let speed = f64::from(now.distance(*before)) * scene.time.fps;
        0.5 * speed * speed - gravity.dot(now.as_dvec3())
    };
    mean(now.iter().zip(before).map(of_particle))
}

/// A plot of one measure of all that were followed.
pub(super) fn plot(
    name: &'static str,
    title: String,
    followed: &[Followed],
    fps: f64,
    of: impl Fn(&Followed) -> Vec<f64>,
) -> Plot {
    let line = |(colour, one): (usize, &Followed)| Line {
        name: one.label.clone(),
        colour,
        dashed: false,
        values: of(one),
    };
    Plot {
        name,
        title,
        step_secs: 1.0 / fps,
        shaded_secs: None,
        lines: followed.iter().enumerate().map(line).collect(),
    }
}
