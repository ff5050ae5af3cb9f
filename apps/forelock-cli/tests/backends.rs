//! Runs on a graphics processor, and without one.

#![expect(clippy::unwrap_used, reason = "in a test a failure to run is a failure of the test")]
#![expect(clippy::print_stdout, reason = "a test that is passed over says so")]

use assert_cmd::Command;
use serde_json::Value;
use std::path::Path;

/// A short, small demo in `folder`, with `more` arguments and without pictures.
fn demo(folder: &Path, more: &[&str]) -> Command {
    let mut command = Command::cargo_bin("forelock").unwrap();
    command.args([
        "demo",
        "--json",
        "--frames",
        "12",
        "--set",
        "groom.strands=60",
        "--set",
        "body.sdf_cells=32",
    ]);
    command.args(["--set", "output.film=false", "--set", "output.contact_sheet=false"]).args(more);
    command.arg("--out").arg(folder);
    command
}

/// The same where the loader finds no driver.
#[cfg(target_os = "linux")]
fn without_driver(command: &mut Command) -> &mut Command {
    command.env("VK_DRIVER_FILES", "/nowhere.json").env("VK_ICD_FILENAMES", "/nowhere.json")
}

fn summary(command: &mut Command) -> Value {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Whether there is a GPU to test on; where one is asked for there must be.
fn has_gpu() -> bool {
    let folder = tempfile::tempdir().unwrap();
    let output = demo(folder.path(), &["--backend", "gpu"]).output().unwrap();
    if output.status.success() {
        return true;
    }
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(std::env::var_os("FORELOCK_REQUIRE_GPU").is_none(), "{text}");
    assert!(text.contains("there is no GPU"), "{text}");
    println!("not tested: {text}");
    false
}

/// Strands apart; that meet and touch, in a wind; with virtual particles; that are cut and curled while they move; that follow the leader, two steps in some frames, as smoothed particles in a wind.
const SCENES: [&str; 5] = [
    "",
    "[interaction]\nkind = \"grid\"\ncontacts = true\n[wind]\nvelocity = [3, 0, 1]\nturbulence = 0.3\nshelter = 0.5\nhair_depth = 0.05\n",
    "[solver]\nkind = \"mass-spring\"\n",
    "[[edit]]\nop = \"trim\"\nto = 0.05\nat_secs = 0.05\n[[edit]]\nop = \"curl\"\nat_secs = 0.03\n",
    "[solver]\nkind = \"dftl\"\n[interaction]\nkind = \"sph\"\n[wind]\nvelocity = [3, 0, 1]\nturbulence = 0.3\n[time]\nfps = 40\n[[edit]]\nop = \"trim\"\nto = 0.05\nat_secs = 0.05\n",
];

#[test]
fn a_run_on_a_gpu_is_like_one_on_the_cpu_and_resumes_bit_for_bit() {
    if !has_gpu() {
        return;
    }
    for scene in SCENES {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        std::fs::write(&file, scene).unwrap();
        let run = |name: &str, backend: &str, more: &[&str]| {
            let mut command = Command::cargo_bin("forelock").unwrap();
            command.arg("simulate").arg(&file).args(["--json", "--backend", backend]);
            let small = ["time.frames=8", "groom.strands=60", "body.sdf_cells=32", "output.picture=false"];
            small.iter().for_each(|key| _ = command.args(["--set", key]));
            summary(command.args(more).arg("--out").arg(folder.path().join(name)))
        };
        let whole = run("whole", "gpu", &[]);
        assert_eq!(whole["backend"], "gpu", "{scene}");
        assert_eq!(whole["quarantined_strands"], 0, "{scene}");
        run("parts", "gpu", &["--frames", "5"]);
        let resumed = run("parts", "gpu", &["--resume"]);
        assert_eq!(resumed["state_hash"], whole["state_hash"], "{scene}");
        let cpu = run("cpu", "cpu", &[]);
        assert_eq!(cpu["backend"], "cpu");
        for key in ["max_penetration_m", "max_edge_stretch", "max_edge_stretch_after_solids"] {
            let [a, b] = [&whole, &cpu].map(|summary| summary[key].as_f64().unwrap());
            assert!((a - b).abs() < 1e-4 + 1e-3 * b, "{key}: {a} {b} in {scene}");
        }
    }
}

/// Stages before one on the CPU: with the first it is a run on the GPU, with the last, which only looks, one on the CPU, bit for bit; between them like both; and it goes on like any run.
#[test]
fn stages_can_be_left_on_the_cpu() {
    if !has_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    let run = |scene: &str, more: &[&str]| {
        std::fs::write(&file, scene).unwrap();
        let mut command = Command::cargo_bin("forelock").unwrap();
        command
            .arg("simulate")
            .arg(&file)
            .arg("--json")
            .args(more)
            .arg("--out")
            .arg(folder.path().join("out"));
        let small = ["time.frames=6", "groom.strands=200", "body.sdf_cells=32", "output.picture=false"];
        small.iter().for_each(|key| _ = command.args(["--set", key]));
        summary(&mut command)
    };
    let hash = |summary: &Value| summary["state_hash"].clone();
    let meeting = "[interaction]\nkind = \"grid\"\ncontacts = true\n[body]\nmotion = \"builtin:shake\"\n";
    let [gpu, cpu] = ["gpu", "cpu"].map(|backend| run(meeting, &["--backend", backend]));
    for stage in [
        "solve_strands",
        "resolve_solids",
        "restore_lengths",
        "splat_segments",
        "find_contacts",
        "check_strands",
    ] {
        let own = run(meeting, &["--gpu-from", stage]);
        assert_eq!(own["backend"], "gpu", "{stage}");
        for key in ["max_penetration_m", "max_edge_stretch", "max_edge_stretch_after_solids"] {
            let [a, b] = [&own, &cpu].map(|summary| summary[key].as_f64().unwrap());
            assert!((a - b).abs() < 1e-4 + 1e-3 * b, "{key}: {a} {b} from {stage}");
        }
        let [a, b] = [&own, &cpu].map(|summary| summary["max_strand_contacts"].as_u64().unwrap());
        assert!(b > 0 && a.abs_diff(b) < 2, "contacts: {a} {b} from {stage}");
        let same = [&gpu, &cpu].map(|other| hash(&own) == hash(other));
        assert_eq!(same, [stage == "solve_strands", stage == "check_strands"], "{stage}");
    }
    // Virtual particles without a length pass; edits while the hair moves.
    for scene in [SCENES[2], SCENES[3]] {
        let [cpu, own] = [["--backend", "cpu"], ["--gpu-from", "check_strands"]].map(|how| run(scene, &how));
        assert_eq!(hash(&own), hash(&cpu), "{scene}");
        assert_eq!(own["max_penetration_m"], cpu["max_penetration_m"], "{scene}");
        let whole = run(scene, &["--gpu-from", "restore_lengths"]);
        run(scene, &["--gpu-from", "restore_lengths", "--frames", "3"]);
        let resumed = run(scene, &["--gpu-from", "restore_lengths", "--resume"]);
        assert_eq!(hash(&resumed), hash(&whole), "{scene}");
    }
    // Follow the leader on the CPU, and nothing after it that changes hair; smoothed particles there alone.
    let following =
        "[solver]\nkind = \"dftl\"\n[interaction]\nkind = \"sph\"\n[body]\nmotion = \"builtin:shake\"\n";
    let [gpu, cpu] = ["gpu", "cpu"].map(|backend| run(following, &["--backend", backend]));
    for (stage, same) in
        [("find_neighbours", [true, false]), ("follow_leader", [false; 2]), ("resolve_solids", [false, true])]
    {
        let own = run(following, &["--gpu-from", stage]);
        let notes = own["notes"].to_string();
        assert_eq!(notes.contains("no frame of this scene has"), stage == "resolve_solids", "{notes}");
        assert_eq!([&gpu, &cpu].map(|other| hash(&own) == hash(other)), same, "{stage}");
    }
    // Wind is sampled where the strands are solved.
    let [cpu, own] = [["--backend", "cpu"], ["--gpu-from", "find_contacts"]].map(|how| run(SCENES[1], &how));
    let [a, b] = [&own, &cpu].map(|summary| summary["max_penetration_m"].as_f64().unwrap());
    assert!((a - b).abs() < 1e-4, "{a} {b}");
}

#[test]
#[cfg(target_os = "linux")]
fn without_a_gpu_one_clear_error_or_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    let output = without_driver(&mut demo(folder.path(), &["--backend", "gpu"])).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("there is no GPU to run on") && text.contains("run on the CPU"), "{text}");
    let auto = summary(without_driver(&mut demo(folder.path(), &["--backend", "auto"])));
    assert_eq!(auto["backend"], "cpu");
    let notes = auto["notes"].to_string();
    assert!(notes.contains("on the CPU: there is no GPU"), "{notes}");
}

#[test]
fn what_a_gpu_cannot_do_is_said() {
    if !has_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("crowd.toml");
    std::fs::write(&file, "[[collider]]\nshape = \"sphere\"\nradius = 0.01\n".repeat(33)).unwrap();
    let mut command = Command::cargo_bin("forelock").unwrap();
    command.arg("simulate").arg(&file).args(["--backend", "gpu", "--frames", "2"]);
    for key in ["groom.strands=60", "body.sdf_cells=32", "output.picture=false"] {
        command.args(["--set", key]);
    }
    let output = command.arg("--out").arg(folder.path().join("out")).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("more than 32 solids at once cannot run on a GPU yet: run on the CPU"), "{text}");
}
