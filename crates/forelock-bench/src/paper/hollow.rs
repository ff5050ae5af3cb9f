//! Fig. 8: a sphere with openings in hair of which all strands are simulated, and in hair that a
//! few guides carry, by skinning and by a network of strand codes.
//!
//! # Theory
//! CT2Hair (Shen et al. 2023) makes dense hair of guides with a strand autoencoder: the code of a
//! strand is a weighted mean of the codes of the guides around it, and the decoder makes a strand
//! of that. Here the autoencoder is that of the learned simulator (75 → 256 → 256 → 32 and back).
//! Each guide is encoded as it is in a frame, in the axes of its root on the head.
//!
//! # Practice
//! The autoencoder is trained on strands of the groom at rest and as they are simulated, so that it
//! knows the shapes that it has to make. Guides and weights are those of the skinning
//! ([`Skinning`]).
//!
//! # Limitations
//! The network of CT2Hair is trained on a collection of styles, and smooths codes over the scalp by
//! a second network. Ours knows the strands of this very run, so it has an easier task.

use std::sync::Arc;
use std::time::Instant;

use forelock::penetration::Penetration;
use forelock::{Assets, Observer, Player, Progress, Scene, Studio, labelled};
use forelock_core::groom::Groom;
use forelock_core::groom::guides::Skinning;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_neural::PARTICLES;
use forelock_neural::codes::encoder::{CODE, CodeOptions, INPUTS, StrandCodes};
use forelock_neural::codes::{LOCAL_SCALE_CM, root_frame};
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::scenes::{self, HOLLOW_SPHERE};
use super::study::{Strip, Study, Table, percent};
use crate::BenchError;

/// Guides, the paper's number.
const GUIDES: u32 = 128;
/// Moment of the pictures, as a share of the scene: the sphere is in the hair.
const MOMENT: f64 = 0.6;
/// Frames between those whose strands are trained.
const TRAINED_EVERY: u32 = 10;
/// Strands that are trained, at most.
const TRAINED: usize = 60_000;
/// Metres of a unit of the autoencoder's numbers.
const UNIT_M: f64 = 0.01 * LOCAL_SCALE_CM;

/// A strand in the numbers of the autoencoder.
type Local = [f32; INPUTS];

/// Carries all strands of a groom by codes of guides.
struct Decoder {
    codes: StrandCodes,
    skinning: Skinning,
    assets: Arc<Assets>,
    /// Of each strand from the head's axes to those of its root.
    frames: Vec<DMat3>,
    /// RMS error of a coordinate of the trained strands, metres.
    error_m: f64,
}

/// The particle at a share of a strand's particles.
fn at(points: &[Vec3], share: f64) -> DVec3 {
    let place = share * (points.len() - 1) as f64;
    let first = (place as usize).min(points.len().saturating_sub(2));
    let [a, b] = [first, (first + 1).min(points.len() - 1)].map(|i| points[i].as_dvec3());
    a.lerp(b, place - first as f64)
}

/// A strand in the head's space in the numbers of the autoencoder.
fn local(points: &[Vec3], frame: DMat3) -> Local {
    let mut own = [0.0; INPUTS];
    for (i, x) in own.chunks_exact_mut(3).enumerate() {
        let place = at(points, i as f64 / (PARTICLES - 1) as f64) - points[0].as_dvec3();
        x.copy_from_slice(&(frame * place / UNIT_M).as_vec3().to_array());
    }
    own
}

/// Of each strand of `groom` the rotation from the head's axes to those of its root.
fn root_frames(groom: &Groom) -> Vec<DMat3> {
    let roots = || groom.strands().map(|strand| strand[0].as_dvec3());
    let centre = roots().sum::<DVec3>() / groom.strand_count().max(1) as f64;
    let frame = |root: DVec3| root_frame((root - centre).normalize_or(DVec3::Y)).unwrap_or(DMat3::IDENTITY);
    roots().map(frame).collect()
}

/// `positions`, world space, in the head's space.
fn of_head(head: &Pose, positions: &[Vec3]) -> Vec<Vec3> {
    let own = head.inverse();
    positions.iter().map(|x| own.transform_point(x.as_dvec3()).as_vec3()).collect()
}

/// Strands of `scene`, at rest and as they are simulated.
fn shapes(
    scene: &Scene,
    assets: &Arc<Assets>,
    frames: &[DMat3],
    observer: &mut Observer<'_>,
) -> Result<Vec<Local>, BenchError> {
    let groom = &assets.groom;
    let moments = scene.time.frames / TRAINED_EVERY;
    let stride = (groom.strand_count() * moments as usize).div_ceil(TRAINED).max(1);
    let mut found: Vec<Local> = groom.strands().zip(frames).map(|(x, frame)| local(x, *frame)).collect();
    let (mut player, mut positions) = (scenes::player(scene, assets)?, Vec::new());
    observer(&Progress::Begin { what: "strands to train with", done: 0, total: scene.time.frames.into() });
    for frame in 1..=scene.time.frames {
        player.step()?;
        observer(&Progress::Step);
        if frame % TRAINED_EVERY == 0 {
            player.positions(&mut positions)?;
            let own = of_head(&player.head_pose(), &positions);
            let first = (frame / TRAINED_EVERY) as usize % stride;
            let strands = (first..groom.strand_count()).step_by(stride);
            found.extend(strands.map(|strand| local(&own[groom.range(strand)], frames[strand])));
        }
    }
    observer(&Progress::End);
    Ok(found)
}

impl Decoder {
    /// Trains codes of the strands of `scene`, of which `assets` are, for `steps` steps.
    fn train(
        scene: &Scene,
        assets: &Arc<Assets>,
        skinning: Skinning,
        steps: u32,
        observer: &mut Observer<'_>,
    ) -> Result<Self, BenchError> {
        let frames = root_frames(&assets.groom);
        let strands = shapes(scene, assets, &frames, observer)?;
        let options = CodeOptions { steps, seed: scene.seed, ..CodeOptions::default() };
        observer(&Progress::Begin { what: "training codes", done: 0, total: steps.into() });
        let codes = StrandCodes::train(&strands, &options, &mut || observer(&Progress::Step));
        observer(&Progress::End);
        let mut own = Self { codes, skinning, assets: assets.clone(), frames, error_m: 0.0 };
        let simd = Simd::Auto.resolve();
        let found = own.codes.decode_all(&own.codes.encoder().encode(&strands, simd), simd);
        let square = |(a, b): (&f32, &f32)| f64::from(a - b).powi(2);
        let sum: f64 = strands.as_flattened().iter().zip(found.as_flattened()).map(square).sum();
        own.error_m = UNIT_M * (sum / (strands.len() * INPUTS) as f64).sqrt();
        Ok(own)
    }

    /// Places all strands into `out`, metres, world space, from the positions of the guides'
    /// particles.
    fn carry(&self, head: &Pose, guides: &[Vec3], out: &mut Vec<Vec3>) {
        let (simd, groom) = (Simd::Auto.resolve(), &self.assets.groom);
        let own = of_head(head, guides);
        let strand = |(guide, strand): (usize, &usize)| {
            local(&own[self.skinning.guides().range(guide)], self.frames[*strand])
        };
        let locals: Vec<Local> = self.skinning.chosen().iter().enumerate().map(strand).collect();
        let codes = self.codes.encoder().encode(&locals, simd);
        let mean = |strand: usize| {
            let mut code = [0.0f32; CODE];
            for (guide, weight) in self.skinning.follows(strand) {
                let own = &codes[guide * CODE..][..CODE];
                code.iter_mut().zip(own).for_each(|(sum, z)| *sum += weight * z);
            }
            code
        };
        let codes: Vec<[f32; CODE]> = (0..groom.strand_count()).into_par_iter().map(mean).collect();
        let decoded = self.codes.decode_all(codes.as_flattened(), simd);
        out.clear();
        for (strand, local) in decoded.iter().enumerate() {
            let points: [Vec3; PARTICLES] = std::array::from_fn(|i| Vec3::from_slice(&local[3 * i..][..3]));
            let (rest, frame) = (groom.strand(strand), self.frames[strand].transpose());
            for i in 0..rest.len() {
                let place = at(&points, i as f64 / (rest.len() - 1).max(1) as f64) - points[0].as_dvec3();
                let x = rest[0].as_dvec3() + UNIT_M * (frame * place);
                out.push(head.transform_point(x).as_vec3());
            }
        }
    }
}

/// How the strands of a row got where they are.
#[derive(Default)]
struct Row {
    label: &'static str,
    simulated: usize,
    /// Largest share of the particles more than 1 mm inside the sphere at the end of a frame, and
    /// of the edges.
    in_sphere: [f64; 2],
    /// The same of particles in sphere or body.
    inside: f64,
    deepest_m: f64,
    /// Mean distance from the simulated strands over all frames, metres.
    away_m: f64,
    /// Mean change of an edge's length over all frames.
    stretch: f64,
    /// Milliseconds of all frames, without measures.
    times: Vec<f64>,
}

impl Row {
    fn new(label: &'static str, simulated: usize) -> Self {
        Self { label, simulated, ..Self::default() }
    }

    /// Measures a frame of `frames`: `positions`, beside those of all simulated strands.
    fn measure(&mut self, positions: &[Vec3], simulated: &[Vec3], player: &Player, frames: u32) {
        let solids = player.measured_solids();
        let all = Penetration::measure(positions, player.layout(), &solids);
        // The body comes first.
        let sphere = solids.get(1..).unwrap_or_default();
        let in_sphere = Penetration::measure(positions, player.layout(), sphere);
        let shares = [in_sphere.share_inside, in_sphere.edge_share_inside];
        self.in_sphere = [0, 1].map(|k| self.in_sphere[k].max(shares[k]));
        self.inside = self.inside.max(all.share_inside);
        self.deepest_m = self.deepest_m.max(all.deepest_m);
        let frames = f64::from(frames);
        let away: f64 = positions.iter().zip(simulated).map(|(a, b)| f64::from(a.distance(*b))).sum();
        self.away_m += away / positions.len().max(1) as f64 / frames;
        self.stretch += stretch(player.groom(), positions) / frames;
    }

    fn cells(&self) -> Vec<String> {
        let mut times = self.times.clone();
        times.sort_by(f64::total_cmp);
        let share = |share: f64| format!("{:.3} %", 100.0 * share);
        vec![
            self.label.to_owned(),
            format!("{}", self.simulated),
            share(self.in_sphere[0]),
            share(self.in_sphere[1]),
            share(self.inside),
            format!("{:.1}", 1e3 * self.deepest_m),
            format!("{:.1}", 1e3 * self.away_m),
            percent(self.stretch),
            format!("{:.1}", times.get(times.len() / 2).copied().unwrap_or_default()),
        ]
    }
}

/// The mean relative change of the lengths of all edges.
fn stretch(groom: &Groom, positions: &[Vec3]) -> f64 {
    let (mut sum, mut edges) = (0.0, 0usize);
    for strand in 0..groom.strand_count() {
        let (rest, now) = (groom.strand(strand), &positions[groom.range(strand)]);
        for (rest, now) in rest.windows(2).zip(now.windows(2)) {
            let length = |x: &[Vec3]| f64::from(x[0].distance(x[1]));
            sum += (length(now) / length(rest).max(1e-9) - 1.0).abs();
            edges += 1;
        }
    }
    sum / edges.max(1) as f64
}

/// Milliseconds that `work` takes.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let began = Instant::now();
    let done = work();
    (done, 1e3 * began.elapsed().as_secs_f64())
}

/// The guides and all variants at the moment of the pictures.
fn pictures(
    scene: &Scene,
    decoder: &Decoder,
    guides: &[Vec3],
    positions: &[Vec<Vec3>; 3],
) -> Result<Strip, BenchError> {
    let secs = f64::from(moment(scene)) / scene.time.fps;
    let few = Assets::around(scene, decoder.skinning.guides().clone())?;
    let [simulated, skinned, coded] = positions;
    let studio = Studio::new(scene, &decoder.assets);
    let mut shown = vec![(Studio::new(scene, &few).picture(guides, secs, 0.6)?, "GUIDES".to_owned())];
    for (positions, label) in
        [(skinned, "GUIDES, SKINNED"), (coded, "GUIDES, BY CODES"), (simulated, "ALL STRANDS SIMULATED")]
    {
        shown.push((studio.picture(positions, secs, 0.6)?, label.to_owned()));
    }
    let title = format!("Hair in a sphere with openings at {secs:.2} s");
    Ok(Strip { name: "sphere", title, image: labelled(&shown, 4)? })
}

/// The frame of the pictures.
fn moment(scene: &Scene) -> u32 {
    (MOMENT * f64::from(scene.time.frames)) as u32
}

/// What a run found.
struct Outcome {
    rows: [Row; 3],
    /// RMS error of a coordinate of the trained strands, encoded and decoded, metres.
    error_m: f64,
    frames: u32,
    strip: Option<Strip>,
}

/// Runs the scene with `share` of its strands, `keys` over it and codes of `steps` steps.
fn run(share: f64, keys: &[&str], steps: u32, observer: &mut Observer<'_>) -> Result<Outcome, BenchError> {
    let (scene, assets) = HOLLOW_SPHERE.load(share, keys, observer)?;
    let mut guided = scene.clone();
    guided.groom.guides = GUIDES.min(assets.groom.strand_count() as u32);
    let skinning = Skinning::new(&assets.groom, guided.groom.guides as usize, scene.seed)
        .map_err(forelock::PlayerError::from)?;
    let decoder = Decoder::train(&scene, &assets, skinning, steps, observer)?;
    let [mut all, mut few] = [scenes::player(&scene, &assets)?, scenes::player(&guided, &assets)?];
    let [strands, guides] = [all.simulated_strands(), few.simulated_strands()];
    let mut rows = [
        Row::new("all strands simulated", strands),
        Row::new("guides, skinned", guides),
        Row::new("guides, by codes (CT2Hair-like)", guides),
    ];
    let mut positions: [Vec<Vec3>; 3] = std::array::from_fn(|_| Vec::new());
    let frames = scene.time.frames;
    let mut shown = None;
    observer(&Progress::Begin { what: "simulating", done: 0, total: frames.into() });
    for frame in 1..=frames {
        let (done, whole) = timed(|| all.step().map(drop));
        done?;
        all.positions(&mut positions[0])?;
        let (done, simulation) = timed(|| few.step().map(drop));
        done?;
        let (done, skinned) = timed(|| few.positions(&mut positions[1]));
        done?;
        let chosen = decoder.skinning.chosen().iter();
        let of_guides: Vec<Vec3> =
            chosen.flat_map(|strand| &positions[1][assets.groom.range(*strand)]).copied().collect();
        let head = few.head_pose();
        let ((), decoded) = timed(|| decoder.carry(&head, &of_guides, &mut positions[2]));
        for (row, ms) in rows.iter_mut().zip([whole, simulation + skinned, simulation + decoded]) {
            row.times.push(ms);
        }
        for (row, own) in rows.iter_mut().zip(&positions) {
            row.measure(own, &positions[0], &all, frames);
        }
        if frame == moment(&scene) {
            shown = Some(pictures(&scene, &decoder, &of_guides, &positions)?);
        }
        observer(&Progress::Step);
    }
    observer(&Progress::End);
    Ok(Outcome { rows, error_m: decoder.error_m, frames, strip: shown })
}

/// Runs Fig. 8 with `share` of the strands.
pub(super) fn study(share: f64, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let steps = CodeOptions::default().steps;
    let Outcome { rows, error_m, frames, strip } = run(share, scenes::AS_IT_IS, steps, observer)?;
    let columns = [
        "variant",
        "simulated",
        "particles in the sphere, at most",
        "edges in the sphere",
        "particles in sphere or body",
        "deepest, mm",
        "from simulated strands, mean mm",
        "edges off by, mean",
        "ms a frame",
    ];
    let mut table = Table::new("", &columns);
    table.rows = rows.iter().map(Row::cells).collect();
    let strands = rows[0].simulated;
    Ok(Study {
        title: "AMS, Fig. 8: a sphere with openings in hair that guides carry, and that is simulated".to_owned(),
        claim: "a neural interpolation of 128 guides knows neither the head's pose nor the sphere, so strands \
                penetrate it; simulated ones do not."
            .to_owned(),
        notes: vec![
            format!(
                "Scene `{}`: {strands} strands, {frames} frames; counted is what is more than 1 mm inside at the \
                 end of a frame. The autoencoder was trained for {steps} steps on the strands at rest and as they \
                 are simulated in every {TRAINED_EVERY}th frame; its error is {:.1} mm RMS a coordinate.",
                HOLLOW_SPHERE.name,
                1e3 * error_m
            ),
            "The network is ours after the description of CT2Hair, whose code runs on its own data: guides are \
             encoded in the axes of the moving head, which the paper's comparison does not do, so the head's pose \
             is known here."
                .to_owned(),
        ],
        tables: vec![table],
        strips: strip.into_iter().collect(),
        ..Study::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper's claim: interpolated strands end up in the sphere, simulated ones do not.
    #[test]
    fn interpolated_strands_get_into_the_sphere() {
        let keys = ["body.sdf_cells=64"];
        let Outcome { rows, error_m, strip, .. } = run(0.03, &keys, 600, &mut |_| {}).unwrap();
        let [simulated, skinned, coded] = &rows;
        for row in &rows {
            println!("{:?}", row.cells());
        }
        assert_eq!([simulated.simulated, skinned.simulated, coded.simulated], [309, 128, 128]);
        assert!(error_m < 0.01, "the autoencoder's error: {error_m} m");
        assert!(simulated.in_sphere[0] <= 1e-3 && simulated.away_m == 0.0);
        for row in [skinned, coded] {
            assert!(row.in_sphere[0] > 5.0 * simulated.in_sphere[0].max(1e-3), "{}", row.label);
            assert!(row.away_m > 1e-3 && row.away_m < 0.1, "{}: {}", row.label, row.away_m);
        }
        assert!(strip.is_some_and(|strip| strip.image.width() > 500));
    }
}
