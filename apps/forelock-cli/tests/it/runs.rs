//! Runs of the command as a user makes them: what they print, write, and leave when interrupted.

use std::fs;

use crate::common::{Workplace, json, small_demo, stderr, stdout};

#[test]
fn a_demo_writes_everything_it_names() {
    let place = Workplace::new();
    let output = place.run(small_demo("out", &[]));
    assert!(output.status.success(), "{}", stderr(&output));
    for name in [
        "hair.npz",
        "snapshot.npz",
        "scene.toml",
        "picture.png",
        "contact-sheet.png",
        "film.png",
        "summary.json",
        "report.html",
    ] {
        let bytes = fs::read(place.path("out").join(name)).unwrap_or_else(|_| panic!("{name} is missing"));
        assert!(!bytes.is_empty(), "{name} is empty");
        assert!(stdout(&output).contains(name), "{name} is not named");
    }
    let report = fs::read_to_string(place.path("out/report.html")).unwrap();
    for words in [
        "largest stretch",
        "deepest edge inside a solid",
        "solve strands",
        "data:image/png;base64,",
        "film.png",
    ] {
        assert!(report.contains(words), "the report does not show {words:?}");
    }
    let leftovers = place.files().into_iter().filter(|path| path.to_string_lossy().contains(".part"));
    assert_eq!(leftovers.count(), 0);
}

#[test]
fn the_summary_is_json_alone_with_the_fields_of_the_interface() {
    let place = Workplace::new();
    let output = place.run(small_demo("out", &["--json", "--set", "output.film=false"]));
    let summary = json(&output);
    for field in [
        "scene",
        "solver",
        "backend",
        "device",
        "threads",
        "strands",
        "particles",
        "frames",
        "fps",
        "substeps",
        "ms_per_frame",
        "solver_ms_per_frame",
        "ms_per_stage",
        "peak_memory_bytes",
        "max_edge_stretch",
        "max_penetration_m",
        "max_edge_penetration_m",
        "max_edge_share_1mm_inside",
        "quarantined_strands",
        "teleports",
        "state_hash",
        "outputs",
    ] {
        assert!(summary.get(field).is_some(), "there is no `{field}`");
    }
    assert_eq!(
        (&summary["strands"], &summary["particles"], &summary["frames"]),
        (&40.into(), &320.into(), &6.into())
    );
    assert!(summary["ms_per_frame"]["median"].is_number());
    assert_eq!(summary["quarantined_strands"], 0);
    assert!(summary["max_edge_stretch"].as_f64().unwrap() < 1e-4);
    let written: serde_json::Value =
        serde_json::from_slice(&fs::read(place.path("out/summary.json")).unwrap()).unwrap();
    assert_eq!(written["state_hash"], summary["state_hash"]);
}

/// The state hash of a small run with `threads` threads.
fn hash_with(threads: &str) -> serde_json::Value {
    let place = Workplace::new();
    let quiet =
        ["--json", "--set", "output.film=false", "--set", "output.picture=false", "--threads", threads];
    json(&place.run(small_demo("out", &quiet)))["state_hash"].clone()
}

#[test]
fn threads_do_not_change_the_result() {
    assert_eq!(hash_with("1"), hash_with("2"));
}

#[test]
fn a_shorter_run_resumed_is_the_longer_run() {
    let place = Workplace::new();
    let quiet = ["--json", "--set", "output.film=false", "--set", "output.picture=false"];
    let run = |out: &str, more: &[&str]| json(&place.run(small_demo(out, &[&quiet[..], more].concat())));
    let whole = run("whole", &[]);
    // Where there is nothing to resume, a run starts anew and says so.
    let begun = run("parts", &["--frames", "2", "--resume"]);
    assert!(begun["notes"].to_string().contains("nothing to resume in parts"), "{begun}");
    let resumed = run("parts", &["--resume"]);
    assert_eq!(resumed["state_hash"], whole["state_hash"]);
    assert_eq!(resumed["max_edge_stretch"], whole["max_edge_stretch"]);
    assert!(
        fs::read(place.path("parts/hair.npz")).unwrap() == fs::read(place.path("whole/hair.npz")).unwrap()
    );
    // With nothing left to do, what frames took is told as before.
    let again = run("parts", &["--resume"]);
    assert!(resumed["ms_per_frame"]["median"].as_f64().unwrap() > 0.0, "{resumed}");
    for key in ["frames", "ms_per_frame", "solver_ms_per_frame", "ms_per_stage", "state_hash"] {
        assert_eq!(again[key], resumed[key], "{key}");
    }
    // Another scene must not go on from here.
    let other =
        place.run(small_demo("parts", &[&quiet[..], &["--resume", "--set", "solver.ams.drag=3"]].concat()));
    assert_eq!(other.status.code(), Some(1));
    assert!(stderr(&other).contains("has changed since"), "{}", stderr(&other));
}

#[test]
fn hair_that_meets_itself_and_keeps_wind_off_resumes() {
    let place = Workplace::new();
    let sets =
        ["interaction.kind=grid", "wind.velocity=[5,0,2]", "wind.turbulence=0.3", "wind.hair_depth=0.02"];
    let sets = ["output.film=false", "output.picture=false"].into_iter().chain(sets);
    let quiet: Vec<&str> = std::iter::once("--json").chain(sets.flat_map(|set| ["--set", set])).collect();
    let run = |out: &str, more: &[&str]| json(&place.run(small_demo(out, &[&quiet[..], more].concat())));
    let whole = run("whole", &[]);
    run("parts", &["--frames", "3"]);
    let resumed = run("parts", &["--resume"]);
    assert_eq!(resumed["state_hash"], whole["state_hash"]);
    let open = run("open", &["--set", "wind.hair_depth=0"]);
    assert_ne!(open["state_hash"], whole["state_hash"], "hair keeps wind off");
}

#[test]
fn follow_the_leader_resumes_between_its_steps() {
    let place = Workplace::new();
    let sets = ["solver.kind=dftl", "interaction.kind=sph", "time.fps=100", "wind.turbulence=0.3"];
    let sets = ["output.film=false", "output.picture=false"].into_iter().chain(sets);
    let quiet: Vec<&str> = std::iter::once("--json").chain(sets.flat_map(|set| ["--set", set])).collect();
    let run = |out: &str, more: &[&str]| json(&place.run(small_demo(out, &[&quiet[..], more].concat())));
    let whole = run("whole", &[]);
    assert_eq!(whole["solver"], "dftl");
    assert!(whole["max_edge_stretch"].as_f64().unwrap() < 1e-4, "{whole}");
    for frames in ["1", "2", "3"] {
        run("parts", &["--frames", frames]);
        let resumed = run("parts", &["--resume"]);
        assert_eq!(resumed["state_hash"], whole["state_hash"], "after {frames}");
        assert!(
            fs::read(place.path("parts/hair.npz")).unwrap()
                == fs::read(place.path("whole/hair.npz")).unwrap()
        );
    }
}

#[test]
fn guides_carry_all_strands_and_resume() {
    let place = Workplace::new();
    let quiet = ["--json", "--set", "output.film=false", "--set", "output.picture=false"];
    let run = |out: &str, more: &[&str]| json(&place.run(small_demo(out, &[&quiet[..], more].concat())));
    let guides = ["--set", "groom.guides=7"];
    let whole = run("whole", &guides);
    assert_eq!(
        (&whole["strands"], &whole["guides"], &whole["particles"]),
        (&40.into(), &7.into(), &320.into())
    );
    assert!(whole["ms_per_stage"]["skin_strands"].is_number());
    assert_eq!(json(&place.run(["info", "whole/hair.npz", "--json"]))["strands"], 40);
    run("parts", &["--set", "groom.guides=7", "--frames", "2"]);
    run("parts", &["--set", "groom.guides=7", "--resume"]);
    assert!(
        fs::read(place.path("parts/hair.npz")).unwrap() == fs::read(place.path("whole/hair.npz")).unwrap()
    );
    // As many guides as strands: each follows itself.
    let (all, each) = (run("all", &[]), run("each", &["--set", "groom.guides=40"]));
    assert_eq!((&all["state_hash"], &all["guides"]), (&each["state_hash"], &0.into()));
}

#[test]
fn a_strip_has_a_picture_for_every_time() {
    let place = Workplace::new();
    place.run(small_demo("out", &["--set", "output.film=false", "--set", "output.picture=false"]));
    let strip =
        |input: &str, times: &str, out: &str| place.run(["render", input, "--at", times, "--out", out]);
    for (times, columns, rows) in [("0,0.02,0.05", 3, 1), ("0,0.01,0.02,0.05", 2, 2), ("0,0,0,0,0", 3, 2)] {
        assert!(strip("out/hair.npz", times, "strip.png").status.success());
        let png = fs::read(place.path("strip.png")).unwrap();
        // The header's width and height, big-endian.
        let side = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
        assert_eq!((side(16), side(20)), (columns * 64, rows * 64));
    }
    for time in ["9", "-1", "nan"] {
        let refused = place.run(["render", "out/hair.npz", &format!("--at={time}"), "--out", "strip.png"]);
        assert!(stderr(&refused).contains("the cache has frames from 0 to "), "{}", stderr(&refused));
    }
    let refused = strip("out/scene.toml", "0", "strip.png");
    assert!(stderr(&refused).contains("needs a cache"), "{}", stderr(&refused));

    assert!(strip("out/hair.npz", "0", "strip.JPG").status.success());
    assert_eq!(fs::read(place.path("strip.JPG")).unwrap()[..3], [0xff, 0xd8, 0xff]);
    let refused = strip("out/hair.npz", "0", "strip.gif");
    assert!(stderr(&refused).contains("strip.gif: a picture is a .png or .jpg"), "{}", stderr(&refused));
    let refused = place.run(["render", "out/hair.npz", "--film", "--out", "film.jpg"]);
    assert!(stderr(&refused).contains("animated PNG"), "{}", stderr(&refused));
}

#[test]
#[cfg(target_os = "linux")]
fn without_a_gpu_one_clear_error_or_the_cpu() {
    let place = Workplace::new();
    // The loader finds no driver.
    let run = |backend: &str| {
        let quiet = ["--json", "--backend", backend, "--set", "output.film=false"];
        let mut command = place.command();
        command.env("VK_DRIVER_FILES", "/nowhere.json").env("VK_ICD_FILENAMES", "/nowhere.json");
        command.args(small_demo("out", &quiet)).output().unwrap()
    };
    let refused = run("gpu");
    let text = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{text}");
    assert!(text.contains("there is no GPU to run on") && text.contains("run on the CPU"), "{text}");
    assert!(place.run(["grow", "few.hair", "--strands", "5"]).status.success());
    let mut command = place.command();
    command.env("VK_DRIVER_FILES", "/nowhere.json").env("VK_ICD_FILENAMES", "/nowhere.json");
    let drawn = command.args(["render", "few.hair", "--backend", "gpu"]).output().unwrap();
    let text = stderr(&drawn);
    assert_eq!(drawn.status.code(), Some(1), "{text}");
    assert!(text.contains("there is no GPU to run on") && text.contains("run on the CPU"), "{text}");
    let auto = json(&run("auto"));
    assert_eq!(auto["backend"], "cpu");
    let notes = auto["notes"].to_string();
    assert!(notes.contains("on the CPU: there is no GPU"), "{notes}");
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_is_whole_and_goes_on_bit_for_bit() {
    use std::io::{BufRead as _, BufReader};
    use std::process::{Command, Stdio};
    let place = Workplace::new();
    let quiet = [
        "--set",
        "output.film=false",
        "--set",
        "output.picture=false",
        "--set",
        "output.contact_sheet=false",
    ];
    let long =
        |out: &str, more: &[&str]| small_demo(out, &[&quiet[..], &["--frames", "4000"], more].concat());
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("forelock"))
        .args(long("parts", &[]))
        .current_dir(place.path(""))
        .env("XDG_CACHE_HOME", place.path("cache"))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line.starts_with("simulating")));
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let said = lines.collect::<Vec<_>>().join("\n");
    assert_eq!(child.wait().unwrap().code(), Some(130), "{said}");
    assert!(said.contains("--resume goes on"), "{said}");
    let summary: serde_json::Value =
        serde_json::from_slice(&fs::read(place.path("parts/summary.json")).unwrap()).unwrap();
    let done = summary["frames"].as_u64().unwrap();
    assert!(done < 4000, "it was over before it could be interrupted");
    let info = json(&place.run(["info", "parts/hair.npz", "--json"]));
    assert_eq!(info["frames"], done + 1);

    let frames = (done + 5).to_string();
    let resumed = json(&place.run(long("parts", &["--resume", "--json", "--frames", &frames])));
    let whole = json(&place.run(long("whole", &["--json", "--frames", &frames])));
    assert_eq!(resumed["state_hash"], whole["state_hash"]);
    assert!(
        fs::read(place.path("parts/hair.npz")).unwrap() == fs::read(place.path("whole/hair.npz")).unwrap()
    );
}

#[test]
fn grooms_grow_convert_and_tell_what_they_are() {
    let place = Workplace::new();
    let grown = json(&place.run(["grow", "a.hair", "--strands", "30", "--vertices", "9", "--json"]));
    assert_eq!((&grown["strands"], &grown["particles"]), (&30.into(), &270.into()));
    let converted = json(&place.run(["convert", "a.hair", "b.npz", "--resample", "5", "--json"]));
    assert_eq!(converted["particles"], 150);
    let info = json(&place.run(["info", "b.npz", "--json"]));
    assert_eq!((&info["strands"], &info["particles"]), (&30.into(), &150.into()));
    assert!(info["frames"].is_null(), "a groom does not move: {info}");
    assert!(stdout(&place.run(["info", "b.npz"])).contains("30"));
    // Of moving hair it prints frames and times, in every binary format that is read.
    place.run(small_demo("moving", &["--frames", "4"]));
    for name in ["moving.abc", "moving.usdc"] {
        place.run(["convert", "moving/hair.npz", name, "--animated"]);
    }
    for name in ["moving/hair.npz", "moving.abc", "moving.usdc"] {
        let info = json(&place.run(["info", name, "--json"]));
        let secs = ["first_secs", "last_secs"].map(|key| info[key].as_f64().unwrap());
        assert_eq!((info["frames"].as_u64(), secs[0]), (Some(5), 0.0), "{name}: {info}");
        assert!((secs[1] - 4.0 / 60.0).abs() < 1e-6, "{name}: {info}");
    }
}

#[test]
fn pictures_of_scenes_caches_and_grooms() {
    let place = Workplace::new();
    assert!(place.run(small_demo("out", &["--set", "output.film=false"])).status.success());
    place.run(["grow", "a.hair", "--strands", "30"]);
    let png = b"\x89PNG\r\n\x1a\n";
    for arguments in [
        &["render", "out/hair.npz", "--frame", "2", "--out", "frame.png"][..],
        &["render", "out/hair.npz", "--film", "--out", "film.png"],
        &["render", "out/scene.toml", "--sheet", "--out", "sides.png"],
        &["render", "a.hair", "--set", "output.width=50", "--set", "output.height=40", "--out", "groom.png"],
    ] {
        let output = place.run(arguments);
        assert!(output.status.success(), "{}", stderr(&output));
        let bytes = fs::read(place.path(arguments[arguments.len() - 1])).unwrap();
        assert_eq!(&bytes[..8], png, "{arguments:?}");
    }
    let beyond = place.run(["render", "out/hair.npz", "--frame", "7"]);
    assert!(stderr(&beyond).contains("there is no frame 7: the cache has 7"), "{}", stderr(&beyond));
}

#[test]
fn help_and_completions() {
    let place = Workplace::new();
    let help = place.run(["help"]);
    for command in ["demo", "simulate", "render", "grow", "groom", "info", "convert", "bench", "completions"]
    {
        assert!(stdout(&help).contains(command), "{command}");
    }
    assert!(stdout(&place.run(["help", "simulate"])).contains("--resume"));
    assert!(stdout(&place.run(["completions", "bash"])).contains("_forelock"));
}
