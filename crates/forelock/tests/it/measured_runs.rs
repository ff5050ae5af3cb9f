//! What a run reports of its frames: the time by the clock, and how much hair lies inside solids.

#![expect(clippy::unwrap_used, reason = "a test that cannot build its scene fails")]

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use forelock::penetration::Penetration;
use forelock::scene::Override;
use forelock::{Backend, MEASURED_EVERY, Player, Progress, RunOptions, Scene, Summary, simulate};

/// A scene with edges of 4 cm, and `more`.
fn scene(frames: u32, more: &str) -> Scene {
    let sets = ["groom.strands=120", "groom.grow.vertices_per_strand=7", "groom.grow.step=0.04"];
    let quiet = ["body.sdf_cells=48", "output.film=false", "output.picture=false", "output.report=false"];
    let frames = format!("time.frames={frames}");
    let sets = sets.into_iter().chain(quiet).chain([frames.as_str()]);
    let sets: Vec<_> = sets.map(|set| Override::set(set).unwrap()).collect();
    let text = format!("[body]\nmotion = \"builtin:shake-and-jump\"\n{more}");
    Scene::parse(&text, Path::new("scene.toml"), &sets).unwrap()
}

/// A plate that cuts into the hair of a solver that keeps particles out of it badly.
const CUTTING: &str = "[solver]\nkind = \"dftl\"\n[solver.dftl]\nlevel_collisions = true\n\
    [[collider]]\nshape = \"box\"\nhalf_extents = [0.3, 0.3, 0.02]\n\
    [interaction]\nkind = \"none\"\ncontacts = false\n";

/// Runs `scene` into `out`; and how long its frames took.
fn run(scene: &Scene, out: &Path, resume: bool) -> (Summary, Duration) {
    let options = RunOptions { out: out.to_path_buf(), resume, backend: Backend::Cpu };
    let (mut began, mut took) = (None, Duration::ZERO);
    let mut observer = |progress: &Progress<'_>| match progress {
        Progress::Begin { what: "simulating", .. } => began = Some(Instant::now()),
        Progress::End => took = began.take().map_or(took, |began| began.elapsed()),
        _ => {}
    };
    let summary = simulate(scene, &options, &mut observer, &AtomicBool::new(false)).unwrap();
    (summary, took)
}

/// The milliseconds a frame are those of the clock, however long measuring and writing take: here
/// there are a thousand solids to measure against.
#[test]
fn reported_milliseconds_are_those_of_the_clock() {
    let mut spheres = String::new();
    for i in 0..1000 {
        let at = [i % 10, i / 10 % 10, i / 100].map(|c| f64::from(c) * 0.1 - 0.45);
        spheres += &format!("[[collider]]\nradius = 0.004\nvisible = false\nposition = {at:?}\n");
    }
    let folder = tempfile::tempdir().unwrap();
    let (summary, took) = run(&scene(24, &spheres), folder.path(), false);
    let reported = summary.ms_per_frame.mean * 24.0;
    let clock = took.as_secs_f64() * 1e3;
    assert!((reported - clock).abs() < 0.05 * clock, "{reported} ms reported, {clock} ms by the clock");
    assert!(summary.solver_ms_per_frame.mean < summary.ms_per_frame.mean);
}

#[test]
fn penetration_is_that_of_every_eleventh_frame_and_the_last() {
    let scene = scene(27, CUTTING);
    let folder = tempfile::tempdir().unwrap();
    let (summary, _) = run(&scene, folder.path(), false);
    assert_eq!(summary.penetration_measured_every, MEASURED_EVERY);
    let mut player = Player::new(scene).unwrap();
    let (mut expected, mut positions) = (Penetration::default(), Vec::new());
    for frame in 1..=27 {
        player.step().unwrap();
        if frame % 11 == 0 || frame == 27 {
            player.positions(&mut positions).unwrap();
            expected = expected.max(&player.penetration(&positions));
        }
    }
    assert_eq!(reported(&summary), expected);
    assert!(expected.share_inside > 0.0 && expected.deepest_m > 1e-3, "{expected:?}");
    assert!(expected.edge_share_inside > expected.share_inside, "{expected:?}");
    assert!(expected.deepest_edge_m > expected.deepest_m, "{expected:?}");
}

#[test]
fn resuming_does_not_change_what_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let (whole, _) = run(&scene(24, CUTTING), &out("whole"), false);
    run(&scene(13, CUTTING), &out("parts"), false);
    let (resumed, _) = run(&scene(24, CUTTING), &out("parts"), true);
    assert_eq!(reported(&resumed), reported(&whole));
}

fn reported(summary: &Summary) -> Penetration {
    Penetration {
        share_inside: summary.max_share_1mm_inside,
        deepest_m: summary.max_penetration_m,
        edge_share_inside: summary.max_edge_share_1mm_inside,
        deepest_edge_m: summary.max_edge_penetration_m,
    }
}
