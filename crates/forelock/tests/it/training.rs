//! Training of the learned simulator: one result whatever the threads and interruptions, and errors
//! in words.

#![expect(clippy::unwrap_used, reason = "a test that cannot train fails")]

use forelock::scene::Override;
use forelock::training::{TRAINING, TrainingConfig, TrainingError, TrainingOptions, measure, train};
use forelock::{Observer, Progress};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// A training of a few steps.
const SMALL: [&str; 11] = [
    "hair.grooms=[\"straight\", \"curly\"]",
    "hair.lengths=[0.7]",
    "hair.grown=96",
    "hair.held_out=2",
    "motions.count=4",
    "motions.secs=1",
    "motions.held_out=1",
    "steps.codes=20",
    "steps.simulator=40",
    "steps.measure_every=16",
    "energies.body=2000",
];

fn config(more: &[&str]) -> Result<TrainingConfig, forelock::scene::SceneError> {
    let sets = SMALL.iter().chain(more).map(|set| Override::set(set)).collect::<Result<Vec<_>, _>>()?;
    TrainingConfig::builtin(&sets)
}

/// Trains into `out`, up to `stop_at` steps from where it began.
fn run(out: &Path, resume: bool, stop_at: u32) -> Result<u32, TrainingError> {
    let stop = AtomicBool::new(false);
    let (mut trains, mut steps) = (false, 0);
    let mut observer = |progress: &Progress<'_>| match progress {
        Progress::Begin { what, .. } => trains = *what == TRAINING,
        Progress::Step if trains => {
            steps += 1;
            stop.store(steps >= stop_at, Ordering::Relaxed);
        }
        _ => {}
    };
    let observer: &mut Observer<'_> = &mut observer;
    let options = TrainingOptions { out: out.to_path_buf(), resume };
    Ok(train(&config(&[]).unwrap(), &options, observer, &stop)?.steps)
}

#[test]
fn an_interrupted_training_on_two_threads_gives_the_model_of_a_whole_one_on_one_thread() {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let [whole, parts] = folders.each_ref().map(|folder| folder.path());
    let on = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    assert_eq!(on(1).install(|| run(whole, false, u32::MAX)).unwrap(), 40);
    assert_eq!(on(2).install(|| run(parts, false, 21)).unwrap(), 21);
    assert!(!parts.join("model.safetensors").exists());
    assert_eq!(on(2).install(|| run(parts, true, 10)).unwrap(), 31);
    assert_eq!(on(2).install(|| run(parts, true, u32::MAX)).unwrap(), 40);
    let [a, b] = [whole, parts].map(|folder| std::fs::read(folder.join("model.safetensors")).unwrap());
    assert!(a == b);
    let model = forelock_neural::model::Model::from_bytes(&a).unwrap();
    assert_eq!(model.info().training.grooms, ["straight x 0.7", "curly x 0.7"]);
    assert!(model.info().measures["curly x 0.7.stretch"] < 1e-5);
    for name in ["training.toml", "training.html", "checkpoint.safetensors"] {
        assert!(parts.join(name).exists(), "{name}");
    }
    // What it wrote is the same training.
    let again = TrainingConfig::load(&parts.join("training.toml"), &[]).unwrap();
    assert_eq!(again.digest(), config(&[]).unwrap().digest());

    let resume = TrainingOptions { out: parts.to_path_buf(), resume: true };
    let none = AtomicBool::new(false);
    let other = config(&["energies.drag=3"]).unwrap();
    let error = train(&other, &resume, &mut |_| {}, &none).unwrap_err();
    assert!(error.to_string().contains("of another training: `energies.drag` had another value"), "{error}");
    let path = parts.join("checkpoint.safetensors");
    let mut bytes = std::fs::read(&path).unwrap();
    // Of an older version, with other tensors.
    let mut replace = |from: &[u8], to: &[u8]| {
        let at = bytes.windows(from.len()).position(|bytes| bytes == from).unwrap();
        bytes[at..at + to.len()].copy_from_slice(to);
    };
    replace(b", training ", b", training-");
    replace(b"\"sides\"", b"\"sites\"");
    std::fs::write(&path, &bytes).unwrap();
    let error = train(&config(&[]).unwrap(), &resume, &mut |_| {}, &none).unwrap_err();
    assert!(error.to_string().contains("another version of Forelock wrote it"), "{error}");
    bytes.truncate(bytes.len() / 2);
    std::fs::write(&path, bytes).unwrap();
    let error = train(&config(&[]).unwrap(), &resume, &mut |_| {}, &none).unwrap_err();
    assert!(error.to_string().contains("no checkpoint of a training"), "{error}");
}

#[test]
fn a_quasi_static_model_has_no_history() {
    let folder = tempfile::tempdir().unwrap();
    let options = TrainingOptions { out: folder.path().to_path_buf(), resume: false };
    let own = config(&["method.kind=quasi-static", "steps.simulator=16"]).unwrap();
    let summary = train(&own, &options, &mut |_| {}, &AtomicBool::new(false)).unwrap();
    let model = forelock_neural::model::Model::read(&summary.outputs[0]).unwrap();
    assert_eq!((model.info().history, model.network().shape().shared), (0, 34));
}

#[test]
fn a_model_of_displacements_without_lock_codes_is_trained_and_measured() {
    let folder = tempfile::tempdir().unwrap();
    let options = TrainingOptions { out: folder.path().to_path_buf(), resume: false };
    let sets = ["method.head=displacement", "method.lock_codes=false", "steps.choose_best=false"];
    let own = config(&[&sets[..], &["steps.simulator=16"]].concat()).unwrap();
    let summary = train(&own, &options, &mut |_| {}, &AtomicBool::new(false)).unwrap();
    assert_eq!((summary.best_step, summary.scores.len()), (16, 2));
    let model = forelock_neural::model::Model::read(&summary.outputs[0]).unwrap();
    assert_eq!(model.info().head, forelock_neural::model::OutputHead::Displacement);
    assert!(summary.scores.iter().all(|own| own.score.stretch > 1e-6), "displacements stretch");
    let again = measure(&own, &model, &mut |_| {}).unwrap();
    for (again, own) in again.iter().zip(&summary.scores) {
        assert!((again.score.nrmse - own.score.nrmse).abs() < 1e-6, "{again:?} {own:?}");
    }
}

#[test]
fn the_papers_preset_gives_way_to_keys() {
    let own = config(&["preset=paper", "energies.drag=2"]).unwrap();
    let options = own.options();
    assert_eq!(options.head, forelock_neural::model::OutputHead::Displacement);
    assert_eq!((options.rate, options.warm_start, options.energies.motion.drag), (5e-4, 0.0, 2.0));
    assert_eq!(options.extra_margin, 0.0);
    assert!(options.energies.prints_adhesion && options.energies.repulsion.is_some());
    assert_eq!(own.energies.body, 2000.0, "of the other keys");
    let again = TrainingConfig::parse(&own.to_toml(), Path::new("again.toml"), &[]).unwrap();
    assert_eq!(again, own);
}

/// Twelve seconds of a body that turns and sways.
fn recording(path: &Path) {
    let joint = |name: &str| format!("JOINT {name}\n{{\nOFFSET 0 0.4 0\nCHANNELS 0\n");
    let joints = ["Spine1", "Neck1", "Head"].map(joint).concat();
    let root = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 1 0\nCHANNELS 2 Xposition Yrotation\n";
    let frame = |k: i32| {
        let secs = f64::from(k) / 30.0;
        format!("{} {}\n", 0.1 * (2.0 * secs).sin(), 40.0 * (3.0 * secs).sin())
    };
    let frames: String = (0..=360).map(frame).collect();
    let end = "End Site\n{\nOFFSET 0 0.2 0\n}\n}\n}\n}\n}\n";
    let motion = "MOTION\nFrames: 361\nFrame Time: 0.0333333333\n";
    std::fs::write(path, [root, &joints, end, motion, &frames].concat()).unwrap();
}

#[test]
fn recorded_motions_are_trained_and_measured_under_another_gravity() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("sway.bvh");
    recording(&file);
    let files = format!("motions.files=[{:?}]", file.to_str().unwrap());
    let sets = [&files, "steps.simulator=16", "motions.unit=1", "energies.gravity=[0, -500, 0]"];
    let own = config(&sets).unwrap();
    let options = TrainingOptions { out: folder.path().join("out"), resume: false };
    let summary = train(&own, &options, &mut |_| {}, &AtomicBool::new(false)).unwrap();
    let names: Vec<_> = summary.scores.iter().map(|own| own.groom.as_str()).collect();
    let kinds = ["straight x 0.7", "curly x 0.7"];
    assert_eq!(names[..2], kinds);
    assert_eq!(names[2..], kinds.map(|name| format!("{name}, recorded")));
    let [generated, recorded] = [0, 2].map(|k| summary.scores[k].score);
    assert!(recorded.nrmse > 0.0 && recorded.nrmse != generated.nrmse);
    let model = forelock_neural::model::Model::read(&summary.outputs[0]).unwrap();
    assert_eq!(model.info().energies.gravity, [0.0, -500.0, 0.0]);
    assert_eq!(model.info().training.motions[1..], ["sway.bvh"]);

    std::fs::write(&file, "HIERARCHY").unwrap();
    let error = train(&own, &options, &mut |_| {}, &AtomicBool::new(false)).unwrap_err().to_string();
    assert!(error.contains("sway.bvh"), "{error}");
}

#[test]
fn wrong_configurations_are_refused_with_their_key() {
    for (set, words) in [
        ("preset=printed", "default"),
        ("energies.gravity=[0, -2e5, 0]", "should be from -100000 to 100000"),
        ("motions.recorded=2", "should be from 0 to 1"),
        ("steps.simulatr=3", "did you mean `steps.simulator`?"),
        ("energies.drag=-1", "should be from 0 to 100"),
        ("method.transport=\"along\"", "sequential"),
        ("hair.grooms=[]", "name at least one"),
        ("hair.grown=20", "should be from 64"),
        ("seed=\"one\"", "should be a whole number"),
        ("method.objective=drapes", "set method.kind = \"quasi-static\""),
    ] {
        let error = config(&[set]).unwrap_err().to_string();
        assert!(error.contains(words), "{set}: {error}");
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("training.toml"), "seed = 3\n").unwrap();
    let error = run(folder.path(), false, 1).unwrap_err().to_string();
    assert!(error.contains("was not written by a training"), "{error}");
    let refused = |set: &str| {
        let folder = tempfile::tempdir().unwrap();
        let options = TrainingOptions { out: folder.path().to_path_buf(), resume: false };
        train(&config(&[set]).unwrap(), &options, &mut |_| {}, &AtomicBool::new(false))
            .unwrap_err()
            .to_string()
    };
    let missing = refused("hair.grooms=[\"no-such.hair\"]");
    assert!(missing.contains("no-such.hair"), "{missing}");
    let missing = refused("hair.scene=no-such.toml");
    assert!(missing.contains("no-such.toml"), "{missing}");
}

#[test]
fn a_model_of_other_frames_cannot_be_measured() {
    let own = forelock::builtin_model().unwrap();
    let mut info = own.info().clone();
    info.dt_secs = 0.1;
    let (network, encoder) = (own.network().clone(), own.encoder().clone());
    let other = forelock_neural::model::Model::new(network, own.basis(), encoder, info).unwrap();
    let error = measure(&config(&[]).unwrap(), &other, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("steps by 0.1 s, and this version by 1/30 s: train it again"), "{error}");
}

/// The model that scenes use by default, on two motions and thirty-two strands that it was not
/// trained on.
#[test]
fn the_built_in_model_moves_hair_as_the_reference() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("models");
    let model = forelock_neural::model::Model::read(folder.join("head.safetensors")).unwrap();
    let sets = [Override::set("motions.held_out=2").unwrap()];
    let config = TrainingConfig::load(&folder.join("head.toml"), &sets).unwrap();
    let whole = TrainingConfig::load(&folder.join("head.toml"), &[]).unwrap();
    assert_eq!(model.info().training.config_digest, whole.digest(), "the model and its configuration");
    let parameters = model.network().parameters().len();
    assert!(4 * (parameters + forelock_neural::EDGES.pow(2)) <= 1_200_000);
    for own in measure(&config, &model, &mut |_| {}).unwrap() {
        let (groom, score) = (own.groom, own.score);
        println!("{groom}: {score:?}");
        assert!(score.inside <= 1e-3 && score.stretch <= 1e-5, "{groom}: {score:?}");
        assert!(score.corr >= 0.75 && score.corr_vel >= 0.6, "{groom}: {score:?}");
        assert!(score.nrmse_dyn <= 0.65, "{groom}: {score:?}");
        assert!((0.6..=0.95).contains(&score.motion_ratio), "{groom}: {score:?}");
        assert!(score.nrmse <= 0.5, "{groom}: {score:?}");
    }
}
