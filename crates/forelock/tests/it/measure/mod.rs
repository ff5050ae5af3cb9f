//! What a run's cache shows, measured without the solver: depths against the triangles of the body
//! and of the other visible solids, not against the distance grids that pushed the strands out;
//! lengths, drift and jitter from positions alone.

#![expect(clippy::expect_used, reason = "what cannot be read cannot be measured")]

use std::path::Path;

use forelock::core::body::ClosedMesh;
use forelock::io::Cache;
use forelock::{Assets, MEASURED_EVERY, Scene};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Depth from which a particle counts as inside, metres.
const DEEP_M: f64 = 1e-3;
/// Standard gravity, m/s².
const GRAVITY: f64 = 9.80665;

/// What a cache shows over its frames.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shown {
    /// Strands, S.
    pub strands: usize,
    /// Particles, P.
    pub particles: usize,
    /// Coordinates that are not finite, over all frames.
    pub non_finite: usize,
    /// Largest |l/l₀ − 1| of an edge, against the first frame. No unit.
    pub stretch: f64,
    /// Largest share of the particles that are not clamped which is more than 1 mm inside a mesh in
    /// a frame looked at. No unit.
    pub share_inside: f64,
    /// The same at the start. No unit.
    pub share_inside_at_start: f64,
    /// Deepest particle that is not clamped inside a mesh in a frame looked at, metres.
    pub deepest_m: f64,
    /// Deepest clamped particle, metres.
    pub deepest_clamped_m: f64,
    /// Deepest point of an edge inside a mesh in a frame that the run measures, metres: of free
    /// particles, or from a clamped one that is outside.
    pub deepest_edge_m: f64,
    /// Largest share of those edges that is more than 1 mm inside in such a frame. No unit.
    pub edge_share_inside: f64,
    /// `share_inside` and `deepest_m` of the frames that the run measures.
    pub measured: [f64; 2],
    /// What the run's summary says of `measured`, `edge_share_inside` and `deepest_edge_m`.
    pub reported: [f64; 4],
    /// Farthest that a particle is from its rest place in the head's frame, in the last frame,
    /// metres.
    pub drift_m: f64,
    /// The median of that over particles, metres.
    pub median_drift_m: f64,
    /// Largest acceleration of a particle in the last half second, g.
    pub jitter_g: f64,
    /// Its root mean square over particles and frames, g.
    pub jitter_rms_g: f64,
}

/// Reads `hair.npz` beside the `scene.toml` that a run left in `folder`; depths in every `every`-th
/// frame.
pub fn shown(folder: &Path, every: usize) -> Shown {
    let scene = Scene::load(&folder.join("scene.toml"), &[]).expect("the scene of a run");
    let mut cache = Cache::open(&folder.join("hair.npz")).expect("the cache of a run");
    let offsets = cache.strand_offsets().to_vec();
    let mut rest = Vec::new();
    cache.read_frame(0, &mut rest).expect("a first frame");
    let groom = forelock::core::groom::Groom::new(rest.clone(), offsets.clone()).expect("a groom");
    let assets = Assets::around(&scene, groom).expect("the scene's assets");
    let surfaces = assets.body_mesh().into_iter().chain(assets.solid_meshes(0.0).into_iter().map(|s| s.0));
    let mut depths: Vec<_> = surfaces.map(|mesh| Depths::new(ClosedMesh::new(mesh), rest.len())).collect();
    let clamped = scene.solver.clamped();
    let is_free: Vec<bool> =
        offsets.windows(2).flat_map(|ends| (0..ends[1] - ends[0]).map(|i| i >= clamped)).collect();
    let free = is_free.iter().filter(|free| **free).count();

    let reported = reported(folder);
    let mut shown = Shown { strands: offsets.len() - 1, particles: rest.len(), reported, ..Shown::default() };
    let last = cache.frames() - 1;
    let settled = last.saturating_sub((scene.time.fps / 2.0) as usize).max(2);
    let mut window: [Vec<Vec3>; 3] = Default::default();
    let (mut squares, mut accelerations) = (0.0, 0usize);
    for frame in 0..=last {
        window.rotate_left(1);
        cache.read_frame(frame, &mut window[2]).expect("a whole frame");
        let positions = &window[2];
        shown.non_finite += positions.iter().filter(|p| !p.is_finite()).count();
        shown.stretch = shown.stretch.max(stretch(positions, &rest, &offsets));
        let time = frame as f64 / scene.time.fps;
        let head_from_world = assets.head_pose(time).inverse();
        let local = |p: &Vec3| head_from_world.transform_point(p.as_dvec3());
        if frame % every == 0 || frame == last {
            // The summary is about what was simulated and measured.
            let is_measured = frame > 0 && (frame % MEASURED_EVERY as usize == 0 || frame == last);
            let mut deepest = vec![0.0f64; rest.len()];
            let mut deepest_edges = vec![0.0f64; rest.len()];
            let own = assets.body_mesh().map(|_| head_from_world);
            let others = assets.solid_meshes(time).into_iter().map(|(_, pose)| pose.inverse());
            for (depths, local_from_world) in depths.iter_mut().zip(own.into_iter().chain(others)) {
                let local = |p: &Vec3| local_from_world.transform_point(p.as_dvec3());
                let local: Vec<DVec3> = positions.par_iter().map(local).collect();
                let found = depths.look(&local);
                if is_measured {
                    let edges = depths.look_along_edges(&local, &offsets, clamped, &found);
                    deepest_edges.iter_mut().zip(edges).for_each(|(edge, found)| *edge = edge.max(found));
                }
                deepest.iter_mut().zip(found).for_each(|(deepest, found)| *deepest = deepest.max(found));
            }
            let of = |wanted| deepest.iter().zip(&is_free).filter(move |(_, free)| **free == wanted);
            let share = of(true).filter(|(depth, _)| **depth > DEEP_M).count() as f64 / free.max(1) as f64;
            shown.deepest_clamped_m =
                of(false).map(|(depth, _)| *depth).fold(shown.deepest_clamped_m, f64::max);
            if is_measured {
                let deepest = of(true).map(|(depth, _)| *depth).fold(shown.measured[1], f64::max);
                shown.measured = [shown.measured[0].max(share), deepest];
                let cut = deepest_edges.iter().filter(|depth| **depth > DEEP_M).count();
                let edges = free - if clamped == 0 { offsets.len() - 1 } else { 0 };
                shown.edge_share_inside = shown.edge_share_inside.max(cut as f64 / edges.max(1) as f64);
                shown.deepest_edge_m = deepest_edges.iter().copied().fold(shown.deepest_edge_m, f64::max);
            }
            if frame == 0 {
                shown.share_inside_at_start = share;
            } else {
                shown.share_inside = shown.share_inside.max(share);
                shown.deepest_m = of(true).map(|(depth, _)| *depth).fold(shown.deepest_m, f64::max);
            }
        }
        if frame > settled {
            for ((a, b), c) in window[0].iter().zip(&window[1]).zip(positions) {
                let second = (a.as_dvec3() - 2.0 * b.as_dvec3() + c.as_dvec3()).length();
                let g = second * scene.time.fps * scene.time.fps / GRAVITY;
                shown.jitter_g = shown.jitter_g.max(g);
                squares += g * g;
                accelerations += 1;
            }
        }
        if frame == last {
            let start = assets.head_pose(0.0).inverse();
            let away = |(p, q): (&Vec3, &Vec3)| local(p).distance(start.transform_point(q.as_dvec3()));
            let mut drifts: Vec<f64> = positions.iter().zip(&rest).map(away).collect();
            drifts.sort_by(f64::total_cmp);
            shown.median_drift_m = drifts[drifts.len() / 2];
            shown.drift_m = drifts[drifts.len() - 1];
        }
    }
    shown.jitter_rms_g = (squares / accelerations.max(1) as f64).sqrt();
    shown
}

/// Shares inside and largest depths that the summary in `folder` reports.
fn reported(folder: &Path) -> [f64; 4] {
    let text = std::fs::read(folder.join("summary.json")).expect("the summary of a run");
    let summary: serde_json::Value = serde_json::from_slice(&text).expect("a summary in JSON");
    let keys =
        ["max_share_1mm_inside", "max_penetration_m", "max_edge_share_1mm_inside", "max_edge_penetration_m"];
    keys.map(|key| summary[key].as_f64().expect("a number"))
}

fn stretch(positions: &[Vec3], rest: &[Vec3], offsets: &[u32]) -> f64 {
    let length = |points: &[Vec3], i: usize| points[i].as_dvec3().distance(points[i + 1].as_dvec3());
    let strand = |ends: &[u32]| {
        let edges = ends[0] as usize..(ends[1] as usize).saturating_sub(1);
        edges.map(|i| (length(positions, i) / length(rest, i) - 1.0).abs()).fold(0.0, f64::max)
    };
    offsets.par_windows(2).map(strand).reduce(|| 0.0, f64::max)
}

/// Depths under a surface of particles that move: the distance falls no faster than a particle
/// moves, so that only those which may have come inside are measured again.
struct Depths {
    surface: ClosedMesh,
    /// Where a particle was when it was measured last, and its signed distance then, metres.
    known: Vec<(DVec3, f64)>,
}

impl Depths {
    fn new(surface: ClosedMesh, particles: usize) -> Self {
        Self { surface, known: vec![(DVec3::ZERO, f64::NEG_INFINITY); particles] }
    }

    /// The depth in metres of each particle, for `positions` in the surface's frame.
    fn look(&mut self, positions: &[DVec3]) -> Vec<f64> {
        let surface = &self.surface;
        let depth = |(known, p): (&mut (DVec3, f64), &DVec3)| {
            if known.1 - known.0.distance(*p) <= 0.0 {
                *known = (*p, surface.signed_distance(p.as_vec3()).into());
                return (-known.1).max(0.0);
            }
            0.0
        };
        self.known.par_iter_mut().zip(positions).map(depth).collect()
    }

    /// The greatest depth in metres along each edge, at its second particle: marched from end to
    /// end, by the distance outside and by 0.1 mm inside. `found` are the depths of the particles,
    /// `positions` those of the last look.
    fn look_along_edges(
        &self,
        positions: &[DVec3],
        offsets: &[u32],
        clamped: u32,
        found: &[f64],
    ) -> Vec<f64> {
        let surface = &self.surface;
        let least = |i: usize| self.known[i].1 - self.known[i].0.distance(positions[i]);
        let along = |i: usize| {
            let (a, b) = (positions[i - 1], positions[i]);
            let length = a.distance(b);
            if least(i - 1) + least(i) > length {
                return 0.0;
            }
            let (mut at, mut deepest) = (0.0, 0.0f64);
            while at <= length {
                let distance = f64::from(surface.signed_distance(a.lerp(b, at / length).as_vec3()));
                deepest = deepest.max(-distance);
                at += distance.max(1e-4);
            }
            deepest.max(found[i])
        };
        let strand = |ends: &[u32]| -> Vec<f64> {
            let counts = |i: usize| {
                let before = i.wrapping_sub(ends[0] as usize);
                let is_rooted = before == clamped as usize;
                before > 0 && before >= clamped as usize && !(is_rooted && clamped > 0 && found[i - 1] > 0.0)
            };
            (ends[0] as usize..ends[1] as usize).map(|i| if counts(i) { along(i) } else { 0.0 }).collect()
        };
        offsets.par_windows(2).flat_map_iter(strand).collect()
    }
}
