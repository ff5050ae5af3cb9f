//! Lists of shots: results equal those of runs done singly, whatever ends in between.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{Workplace, json, shared_cache, stderr, stdout};

/// Shots of some frames that take long for their size, of one body and 20 numbers of strands.
fn list(place: &Workplace, frames: u32) {
    let strands: Vec<String> = (11..31).map(|count| count.to_string()).collect();
    let text = format!(
        "out = \"all\"\n[set]\n\"time.frames\" = {frames}\n\"time.substep_secs\" = 0.0005\n\
         \"groom.vertices_per_strand\" = 16\n\"body.sdf_cells\" = 24\n\"output.width\" = 32\n\
         \"output.height\" = 32\n\"output.film\" = false\n\"output.contact_sheet\" = false\n\
         \"output.report\" = false\n[[shot]]\nname = \"turn\"\nvary.\"groom.strands\" = [{}]\n",
        strands.join(", ")
    );
    place.write("list.toml", text);
}

/// The states at the ends of the shots, by name.
fn states(report: &serde_json::Value) -> Vec<(String, String)> {
    let text = |value: &serde_json::Value| value.as_str().unwrap_or_default().to_owned();
    let shots = report["shots"].as_array().unwrap().iter();
    shots.map(|shot| (text(&shot["name"]), text(&shot["state_hash"]))).collect()
}

fn start(place: &Workplace, more: &[&str]) -> Child {
    Command::new(assert_cmd::cargo::cargo_bin("forelock"))
        .args(["shots", "list.toml"])
        .args(more)
        .current_dir(place.path(""))
        .env("XDG_CACHE_HOME", shared_cache())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Sends `signal` to `processes`, of which some may have ended.
#[cfg(target_os = "linux")]
fn send(signal: &str, processes: &[String]) {
    Command::new("kill").arg(signal).args(processes).stderr(Stdio::null()).status().unwrap();
}

/// The processes that `runner` has started.
#[cfg(target_os = "linux")]
fn children(runner: &Child) -> Vec<String> {
    let path = format!("/proc/{0}/task/{0}/children", runner.id());
    std::fs::read_to_string(path).unwrap_or_default().split_whitespace().map(str::to_owned).collect()
}

#[test]
#[cfg(target_os = "linux")]
fn killed_shots_and_a_killed_runner_cost_no_result() {
    let place = Workplace::new();
    list(&place, 12);
    // One shot crashes, then the runner is killed; the shots that it ran live on for a while.
    let mut runner = start(&place, &["--jobs", "2"]);
    let begun = Instant::now();
    let done = |name: &str| place.path("all").join(name).join("summary.json").is_file();
    let until = |what: &dyn Fn() -> bool| {
        while !what() {
            assert!(begun.elapsed() < Duration::from_secs(120));
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    until(&|| done("turn-strands12") && children(&runner).len() == 2);
    send("-KILL", &children(&runner)[..1]);
    until(&|| done("turn-strands17"));
    // What has begun must not end before it is listed.
    let listed = || place.run(["shots", "list.toml", "--list-only"]);
    until(&|| {
        send("-STOP", &children(&runner));
        let has_begun = stdout(&listed()).contains(": begun");
        if !has_begun {
            send("-CONT", &children(&runner));
        }
        has_begun
    });
    let stopped = children(&runner);
    runner.kill().unwrap();
    runner.wait().unwrap();
    let output = listed();
    send("-CONT", &stopped);
    let (new, all) = (stdout(&output).matches(": new").count(), stdout(&output).lines().count());
    assert!(all == 20 && new > 3 && stdout(&output).contains(": begun"), "{}", stdout(&output));
    let report = json(&place.run(["shots", "list.toml", "--json"]));
    assert_eq!((report["done"].as_u64(), report["failed"].as_u64()), (Some(20), Some(0)));
    let found = states(&report);
    for name in ["turn-strands11", "turn-strands12", "turn-strands13", "turn-strands18", "turn-strands30"] {
        let scene = format!("all/{name}/shot.toml");
        let single = json(&place.run(["simulate", &scene, "--out", "single", "--json"]));
        let (_, state) = found.iter().find(|(own, _)| own == name).unwrap();
        assert_eq!(single["state_hash"].as_str(), Some(&**state), "{name}");
    }
    assert!(place.path("all/index.html").is_file());
    // Nothing is left to do.
    let began = Instant::now();
    let again = json(&place.run(["shots", "list.toml", "--json"]));
    assert_eq!(states(&again), found);
    assert!(began.elapsed() < Duration::from_secs(3));
}

#[test]
fn a_shot_that_fails_costs_no_other_one() {
    let place = Workplace::new();
    let text = "[[shot]]\nname = \"good\"\nset.\"time.frames\" = 2\nset.\"groom.strands\" = 20\n\
                set.\"body.sdf_cells\" = 24\nset.\"output.film\" = false\n[[shot]]\nname = \"bad\"\n\
                set.\"groom.source\" = \"missing.tfx\"\n";
    place.write("list.toml", text);
    let output = place.run(["shots", "list.toml"]);
    assert_eq!(output.status.code(), Some(1));
    let (told, errors) = (stdout(&output), stderr(&output));
    assert!(
        told.contains("good: 2 frames") && told.contains("bad: ") && told.contains("missing.tfx"),
        "{told}"
    );
    assert!(errors.contains("1 of 2 shots are done"), "{errors}");
    let page = std::fs::read_to_string(place.path("forelock-out/list/index.html")).unwrap();
    assert!(page.contains("good/report.html") && page.contains("missing.tfx"));
}

#[test]
fn chunks_of_frames_end_like_whole_shots() {
    let place = Workplace::new();
    list(&place, 6);
    let only = ["shots", "list.toml", "--only", "turn-strands11", "--json"];
    for until in ["2", "4", "6"] {
        let report = json(&place.run(only.iter().copied().chain(["--until", until])));
        assert_eq!(report["shots"][0]["frames"].to_string(), until);
        // Pictures are taken of the whole, once.
        assert_eq!(place.path("all/turn-strands11/picture.png").is_file(), until == "6", "{until}");
    }
    let chunks = states(&json(&place.run(only)));
    let whole = states(&json(&place.run(only.iter().copied().chain(["--again"]))));
    assert_eq!(chunks, whole);
    let output = place.run(["shots", "list.toml", "--openjd", "job.yaml", "--chunk", "2"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let job = std::fs::read_to_string(place.path("job.yaml")).unwrap();
    assert_eq!(job.matches("dependsOn").count(), 20 * 2);
}

/// A part of a shot makes no exports, but what would keep them from being made is told at once.
#[test]
fn the_first_part_of_a_shot_tells_that_exports_cannot_be_made() {
    let place = Workplace::new();
    let text = "[set]\n\"time.frames\" = 4\n\"groom.strands\" = 20\n\"body.sdf_cells\" = 24\n\
                \"output.film\" = false\n\"output.exports\" = [\"a.abc\", \"./a.abc\"]\n\
                [[shot]]\nname = \"one\"\n";
    place.write("list.toml", text);
    let output = place.run(["shots", "list.toml", "--until", "2"]);
    assert_eq!(output.status.code(), Some(1));
    let told = stdout(&output);
    assert!(told.contains("one: ") && told.contains("which is another output of the run"), "{told}");
}

#[test]
#[cfg(unix)]
fn an_interrupted_list_ends_soon_and_goes_on() {
    let place = Workplace::new();
    list(&place, 200);
    let mut runner = start(&place, &["--jobs", "2", "--only", "turn-strands11", "--only", "turn-strands12"]);
    std::thread::sleep(Duration::from_secs(2));
    Command::new("kill").args(["-TERM", &runner.id().to_string()]).status().unwrap();
    let asked = Instant::now();
    let status = runner.wait().unwrap();
    assert!(asked.elapsed() < Duration::from_secs(3), "{:?}", asked.elapsed());
    assert!(status.code() == Some(130) || status.success(), "{status:?}");
}
