//! Runs on a graphics processor.

#![expect(clippy::unwrap_used, reason = "in a test a failure to run is a failure of the test")]

use crate::common::{Workplace, json};
use assert_cmd::Command;
use serde_json::Value;
use std::path::Path;

fn summary(command: &mut Command) -> Value {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Scenes: strands without interaction; with the grid and contacts, in a wind; with virtual
/// particles; cut and curled while they move; DFTL with two steps in some frames, as SPH in a wind;
/// rods in a wind, curled while they move.
const SCENES: [&str; 6] = [
    "[interaction]\nkind = \"none\"\ncontacts = false\n",
    "[interaction]\nkind = \"grid\"\ncontacts = true\n[wind]\nvelocity = [3, 0, 1]\nturbulence = 0.3\nshelter = 0.5\nhair_depth = 0.05\n",
    "[solver]\nkind = \"mass-spring\"\n[interaction]\nkind = \"none\"\ncontacts = false\n",
    "[interaction]\nkind = \"none\"\ncontacts = false\n[[edit]]\nop = \"trim\"\nto = 0.05\nat_secs = 0.05\n[[edit]]\nop = \"curl\"\nat_secs = 0.03\n",
    "[solver]\nkind = \"dftl\"\n[interaction]\nkind = \"sph\"\ncontacts = false\n[wind]\nvelocity = [3, 0, 1]\nturbulence = 0.3\n[time]\nfps = 40\n[[edit]]\nop = \"trim\"\nto = 0.05\nat_secs = 0.05\n",
    "[solver]\nkind = \"xpbd\"\n[interaction]\nkind = \"none\"\ncontacts = false\n[wind]\nvelocity = [3, 0, 1]\nturbulence = 0.3\n[[edit]]\nop = \"curl\"\nat_secs = 0.05\n",
];

/// Runs `scenes` on the GPU, in one and in two parts, and on the CPU.
fn is_like_the_cpu_and_resumes(scenes: &[&str]) {
    for scene in scenes {
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

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_run_on_a_gpu_is_like_one_on_the_cpu_and_resumes_bit_for_bit() {
    is_like_the_cpu_and_resumes(&SCENES[4..]);
}

/// Fur on a figure that jumps, whose roots the device moves; a reset brings it to rest meanwhile.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_run_on_a_body_that_bends_is_like_one_on_the_cpu_and_resumes_bit_for_bit() {
    let clip = "[groom]\npreset = \"short-fur\"\n[interaction]\nkind = \"none\"\ncontacts = false\n\
        [body]\nmesh = \"builtin:walker\"\ncollide = false\n\
        motion = { name = \"jump\", clip = { start_secs = 0.5, blend_secs = 0 } }\n[[teleport]]\nat_secs = 0.05\nmode = \"reset\"\n";
    is_like_the_cpu_and_resumes(&[clip]);
}

#[test]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_runs_on_a_gpu_are_like_those_on_the_cpu_and_resume_bit_for_bit() {
    is_like_the_cpu_and_resumes(&SCENES);
}

/// Runs `scene` in `folder` with `more` arguments.
fn run(folder: &Path, scene: &str, more: &[&str]) -> Value {
    let file = folder.join("scene.toml");
    std::fs::write(&file, scene).unwrap();
    let mut command = Command::cargo_bin("forelock").unwrap();
    command.arg("simulate").arg(&file).arg("--json").args(more).arg("--out").arg(folder.join("out"));
    let small = ["time.frames=6", "groom.strands=200", "body.sdf_cells=32", "output.picture=false"];
    small.iter().for_each(|key| _ = command.args(["--set", key]));
    summary(&mut command)
}

fn hash(summary: &Value) -> &Value {
    &summary["state_hash"]
}

/// Runs in which the GPU begins at a stage and the CPU computes those before. From the first stage
/// on, the run equals one on the GPU bit for bit; from the last, which changes nothing, one on the
/// CPU; between them it is close to both.
fn stages_before_are_on_the_cpu(stages: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    // So little friction that strands meet within a few frames.
    let meeting = "[interaction]\nkind = \"grid\"\ncontacts = true\n\
                   [interaction.contact]\nslip = 0.01\nhold = 0.2\n\
                   [body]\nmotion = \"builtin:shake\"\n";
    let run = |more: &[&str]| run(folder.path(), meeting, more);
    let [gpu, cpu] = ["gpu", "cpu"].map(|backend| run(&["--backend", backend]));
    let is_close = |own: &Value, stage: &str| {
        for key in ["max_penetration_m", "max_edge_stretch", "max_edge_stretch_after_solids"] {
            let [a, b] = [own, &cpu].map(|summary| summary[key].as_f64().unwrap());
            assert!((a - b).abs() < 1e-4 + 1e-3 * b, "{key}: {a} {b} from {stage}");
        }
        let [a, b] = [own, &cpu].map(|summary| summary["max_strand_contacts"].as_u64().unwrap());
        assert!(b > 0 && a.abs_diff(b) < 2, "contacts: {a} {b} from {stage}");
    };
    is_close(&gpu, "the first stage");
    for &stage in stages {
        let own = run(&["--gpu-from", stage]);
        assert_eq!(own["backend"], "gpu", "{stage}");
        is_close(&own, stage);
        let same = [&gpu, &cpu].map(|other| hash(&own) == hash(other));
        assert_eq!(same, [stage == "solve_strands", stage == "check_strands"], "{stage}");
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn stages_can_be_left_on_the_cpu() {
    stages_before_are_on_the_cpu(&["splat_segments", "check_strands"]);
}

/// All other stages, scenes without some of them, and runs in two parts.
#[test]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_all_stages_can_be_left_on_the_cpu() {
    stages_before_are_on_the_cpu(&[
        "solve_strands",
        "resolve_solids",
        "hold_hair",
        "restore_lengths",
        "find_contacts",
    ]);
    let folder = tempfile::tempdir().unwrap();
    let run = |scene: &str, more: &[&str]| run(folder.path(), scene, more);
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
    // DFTL that collides level by level on the CPU, with no stage after it that changes hair; SPH
    // alone on the CPU.
    let following = "[solver]\nkind = \"dftl\"\n[solver.dftl]\nlevel_collisions = true\n\
        [interaction]\nkind = \"sph\"\ncontacts = false\n[body]\nmotion = \"builtin:shake\"\n";
    let [gpu, cpu] = ["gpu", "cpu"].map(|backend| run(following, &["--backend", backend]));
    for (stage, same) in
        [("find_neighbours", [true, false]), ("follow_leader", [false; 2]), ("resolve_solids", [false, true])]
    {
        let own = run(following, &["--gpu-from", stage]);
        let notes = own["notes"].to_string();
        assert_eq!(notes.contains("no frame of this scene has"), stage == "resolve_solids", "{notes}");
        assert_eq!([&gpu, &cpu].map(|other| hash(&own) == hash(other)), same, "{stage}");
    }
    // Rods: their channels go with the other state from one device to the other.
    let rods = "[solver]\nkind = \"xpbd\"\n[body]\nmotion = \"builtin:shake\"\n";
    let [gpu, cpu] = ["gpu", "cpu"].map(|backend| run(rods, &["--backend", backend]));
    for (stage, same) in
        [("solve_rods", [true, false]), ("resolve_solids", [false; 2]), ("check_strands", [false, true])]
    {
        let own = run(rods, &["--gpu-from", stage]);
        assert_eq!([&gpu, &cpu].map(|other| hash(&own) == hash(other)), same, "{stage}");
        let [a, b] = [&own, &cpu].map(|summary| summary["max_edge_stretch"].as_f64().unwrap());
        assert!((a - b).abs() < 1e-4 + 1e-3 * b, "{a} {b} from {stage}");
        run(rods, &["--gpu-from", stage, "--frames", "3"]);
        let resumed = run(rods, &["--gpu-from", stage, "--resume"]);
        assert_eq!(hash(&resumed), hash(&own), "{stage}");
    }
    // Wind is sampled where the strands are solved.
    let [cpu, own] = [["--backend", "cpu"], ["--gpu-from", "find_contacts"]].map(|how| run(SCENES[1], &how));
    let [a, b] = [&own, &cpu].map(|summary| summary["max_penetration_m"].as_f64().unwrap());
    assert!((a - b).abs() < 1e-4, "{a} {b}");
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn what_a_gpu_cannot_do_is_said() {
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

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_gpu_is_measured_by_its_own_clock() {
    let place = Workplace::new();
    let output =
        place.run(["bench", "scaling", "--backend", "gpu", "--most", "1000", "--frames", "1", "--json"]);
    let table = json(&output);
    let row = &table["rows"][0];
    assert!(row["ms_per_frame"].as_f64().is_some_and(|ms| ms > 0.0), "{table}");
    assert!(row["ms_per_stage"]["solve_strands"].as_f64().is_some_and(|ms| ms > 0.0), "{table}");
    assert!(table["peak_bytes_per_sec"].as_f64().is_some_and(|rate| rate > 1e8), "{table}");
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_gpu_draws_the_pictures_of_the_cpu() {
    let place = Workplace::new();
    assert!(place.run(["grow", "curly.hair", "--strands", "200"]).status.success());
    let bytes = ["cpu", "gpu"].map(|backend| {
        let file = format!("{backend}.png");
        let output = place.run(["render", "curly.hair", "--sheet", "--backend", backend, "--out", &file]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read(place.path(&file)).unwrap()
    });
    // The same picture but for rounding, so that the files have nearly the same length.
    let [cpu, gpu] = bytes.map(|bytes| bytes.len() as f64);
    assert!(cpu > 10_000.0 && (cpu / gpu - 1.0).abs() < 0.05, "{cpu} {gpu}");
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn drawing_is_timed_stage_by_stage() {
    let place = Workplace::new();
    let small = ["--most", "10000", "--frames", "1", "--width", "96", "--height", "54"];
    let table = json(&place.run(["bench", "render", "--json"].iter().chain(&small).copied()));
    let rows = table["rows"].as_array().map(Vec::as_slice).unwrap_or_default();
    assert_eq!(rows.len(), 3, "{table}");
    for row in rows {
        assert!(row["ms_per_stage"]["resolve"].as_f64().is_some_and(|ms| ms > 0.0), "{row}");
        assert!(row["cpu_ms"].as_f64().is_some_and(|ms| ms > 0.0), "{row}");
        assert_eq!(row["dropped"].as_u64(), Some(0), "{row}");
        assert!(row["difference"].as_f64().is_some_and(|difference| difference < 2.0), "{row}");
    }
}

#[test]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_a_paper_s_table_is_measured_by_the_clock_of_a_gpu() {
    let place = Workplace::new();
    let small = ["bench", "paper", "--share", "0.001", "--frames", "1", "--warm-up", "0"];
    let table = json(&place.run(small.iter().copied().chain(["--backend", "gpu", "--json"])));
    let rows = table["rows"].as_array().map(Vec::as_slice).unwrap_or_default();
    let ran: Vec<_> = rows.iter().filter(|row| row["skipped"].is_null()).collect();
    // All but the one whose groom is not here.
    assert_eq!(ran.len(), rows.len() - 1, "{table}");
    assert!(
        ran.iter().all(|row| row["ms_per_frame"]["median"].as_f64().is_some_and(|ms| ms > 0.0)),
        "{table}"
    );
}
