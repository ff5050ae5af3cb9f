//! Runs that are killed, terminated or started twice: nothing is lost but the work since the last
//! checkpoint, and nothing is mixed.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

use crate::common::{Workplace, sets, shared_cache, stderr};

/// Keys of a run whose frames take long for their size.
const SLOW: [&str; 10] = [
    "groom.strands=200",
    "groom.vertices_per_strand=16",
    "body.sdf_cells=24",
    "time.substep_secs=0.0001",
    "output.width=64",
    "output.height=64",
    "output.film_every=1000",
    "output.cache_every=3",
    "output.contact_sheet=false",
    "output.report=false",
];

/// Work that a kill may cost.
const LOSS: Duration = Duration::from_secs(5);

/// Starts the slow run into `out` with one thread.
fn start(place: &Workplace, out: &str, frames: u32, more: &[&str]) -> Child {
    let frames = format!("time.frames={frames}");
    Command::new(assert_cmd::cargo::cargo_bin("forelock"))
        .args(["demo", "--out", out, "--threads", "1"])
        .args(sets(SLOW))
        .args(["--set", &frames])
        .args(more)
        .current_dir(place.path(""))
        .env("XDG_CACHE_HOME", shared_cache())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Names and, of the results that do not depend on time, contents of the files in `folder`.
fn results(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    let mut files: Vec<_> = entries
        .map(|entry| {
            let name = entry.file_name().into_string().unwrap();
            let timed = ["snapshot.npz", "summary.json"].contains(&name.as_str());
            (name, if timed { Vec::new() } else { std::fs::read(entry.path()).unwrap() })
        })
        .collect();
    files.sort();
    files
}

fn state_hash(folder: &Path) -> serde_json::Value {
    let summary = std::fs::read(folder.join("summary.json")).unwrap();
    serde_json::from_slice::<serde_json::Value>(&summary).unwrap()["state_hash"].clone()
}

/// Numbers from 0 to 1 that look random.
struct Random(u64);

impl Random {
    fn draw(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f64 / (1u64 << 24) as f64
    }
}

/// Interrupts the run in `out` at random moments with `signals` until it has ended by itself:
/// how many times. After the signals are used up, the run ends undisturbed.
fn interrupt(place: &Workplace, frames: u32, signals: &[&str], longest: Duration) -> usize {
    let mut random = Random(7);
    for (count, signal) in signals.iter().enumerate() {
        let begun = SystemTime::now();
        let mut child = start(place, "killed", frames, &["--resume"]);
        std::thread::sleep(longest.mul_f64(random.draw()));
        Command::new("kill").args([*signal, &child.id().to_string()]).status().unwrap();
        let (killed, asked) = (SystemTime::now(), Instant::now());
        let status = child.wait().unwrap();
        assert!(asked.elapsed() < Duration::from_secs(2), "{signal} took {:?}", asked.elapsed());
        if status.success() {
            return count;
        }
        assert!(*signal != "-TERM" || status.code() == Some(130), "{status:?}");
        let saved = std::fs::metadata(place.path("killed/snapshot.npz")).and_then(|file| file.modified());
        let since = saved.unwrap_or(begun).max(begun);
        let lost = killed.duration_since(since).unwrap_or_default();
        assert!(lost < LOSS, "{signal}: {lost:?} of work are lost");
        if place.path("killed/hair.npz").exists() {
            let info = place.run(["info", "killed/hair.npz", "--json"]);
            assert!(info.status.success(), "{}", stderr(&info));
        }
    }
    let last = start(place, "killed", frames, &["--resume"]).wait_with_output().unwrap();
    assert!(last.status.success(), "{}", stderr(&last));
    signals.len()
}

/// A run that is interrupted by `signals` gives the files of one that is not.
fn interrupted_runs_end_alike(frames: u32, signals: &[&str], longest: Duration) {
    let place = Workplace::new();
    assert!(start(&place, "whole", frames, &[]).wait().unwrap().success());
    let count = interrupt(&place, frames, signals, longest);
    assert!(2 * count >= signals.len(), "the run ended after {count} of {} signals", signals.len());
    assert_eq!(state_hash(&place.path("killed")), state_hash(&place.path("whole")));
    assert!(results(&place.path("killed")) == results(&place.path("whole")));
}

#[test]
fn a_killed_run_goes_on_bit_for_bit() {
    interrupted_runs_end_alike(60, &["-KILL", "-TERM", "-KILL"], Duration::from_millis(700));
}

#[test]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_two_hundred_kills() {
    let signals: Vec<&str> = (0..250).map(|index| if index % 5 == 4 { "-TERM" } else { "-KILL" }).collect();
    interrupted_runs_end_alike(12_000, &signals, Duration::from_millis(2500));
}

/// Of `pairs` of runs into one folder, one succeeds and the other ends with one error.
fn one_of_two_runs_writes(pairs: usize) {
    let place = Workplace::new();
    assert!(start(&place, "whole", 30, &[]).wait().unwrap().success());
    let whole = results(&place.path("whole"));
    for pair in 0..pairs {
        let children = [(); 2].map(|()| start(&place, "both", 30, &[]));
        let mut ended = children.map(|child| child.wait_with_output().unwrap());
        ended.sort_by_key(|output| output.status.code());
        let [done, refused] = &ended;
        assert!(done.status.success(), "pair {pair}: {}", stderr(done));
        let error = stderr(refused);
        assert_eq!(refused.status.code(), Some(1), "pair {pair}: {error}");
        assert!(error.contains("both: another run writes here"), "pair {pair}: {error}");
        assert!(results(&place.path("both")) == whole, "pair {pair}");
    }
}

#[test]
fn two_runs_into_one_folder_do_not_mix() {
    one_of_two_runs_writes(2);
}

#[test]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_fifty_pairs_of_runs() {
    one_of_two_runs_writes(50);
}

/// An interruption ends the program in any phase of its work.
#[test]
fn an_interruption_ends_growth_and_films() {
    let place = Workplace::new();
    // Growth of many strands, then a film of many frames.
    for (keys, phase) in [
        (&["groom.strands=400000", "output.film=false"][..], "growing"),
        (&["time.frames=40", "output.film_every=1", "output.width=2000", "output.height=2000"], "filming"),
    ] {
        let more = sets(keys.iter().copied());
        let more: Vec<&str> = more.iter().map(String::as_str).collect();
        let mut child = start(&place, phase, 40, &more);
        wait_for_line(&mut child, phase);
        std::thread::sleep(Duration::from_millis(100));
        let asked = Instant::now();
        Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
        let status = child.wait().unwrap();
        assert_eq!(status.code(), Some(130), "{phase}");
        assert!(asked.elapsed() < Duration::from_secs(2), "{phase}: {:?}", asked.elapsed());
        let left = place.files().into_iter().filter(|path| path.to_string_lossy().contains(".forelock"));
        assert_eq!(left.count(), 0, "{phase}");
    }
}

/// Waits until `child` writes a line that begins with `word` to standard error.
fn wait_for_line(child: &mut Child, word: &str) {
    use std::io::BufRead as _;
    let reader = std::io::BufReader::new(child.stderr.take().unwrap());
    let mut lines = reader.lines().map(Result::unwrap);
    assert!(lines.any(|line| line.starts_with(word)), "there is no line {word}");
    // The pipe stays open, so that later lines are no error.
    std::thread::spawn(move || lines.for_each(drop));
}
