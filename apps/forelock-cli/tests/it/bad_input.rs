//! Bad input: each case prints one clear message on standard error, returns status 1 (2 for wrong
//! usage), does not panic and leaves no file.

use std::fs;

use crate::common::{Workplace, lines_but_progress, sets, shared_cache, small_demo, stderr};

/// One case: what it is called, the arguments, the status, and words of the message.
type Case<'a> = (&'a str, Vec<&'a str>, i32, &'a str);

/// Runs `cases` in `place` and looks at what they answer and leave.
fn check(place: &Workplace, cases: &[Case<'_>]) {
    let before = place.files();
    for (name, arguments, status, words) in cases {
        let output = place.run(arguments);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(*status), "{name}: {message}");
        assert!(message.contains(words), "{name}: {words:?} is not in {message:?}");
        assert!(!message.contains("No such file"), "{name} is told twice: {message}");
        assert_eq!(message.matches("error:").count(), 1, "{name}: {message}");
        assert!(!message.contains("panicked") && !message.contains("RUST_BACKTRACE"), "{name}: {message}");
        if *status == 1 {
            assert_eq!(lines_but_progress(&message), 1, "{name}: {message}");
        }
        assert!(output.stdout.is_empty(), "{name} wrote to standard output");
        assert_eq!(place.files(), before, "{name} left a file");
    }
}

fn scene(place: &Workplace, name: &str, text: &str) {
    place.write(name, text);
}

#[test]
fn scenes_with_mistakes() {
    let place = Workplace::new();
    let texts = [
        ("unknown.toml", "[groom]\nstrnds = 5\n", "did you mean `groom.strands`?"),
        ("section.toml", "[sovler]\n", "did you mean `solver`?"),
        ("type.toml", "[time]\nfps = \"60\"\n", "line 2, column 7: `time.fps` should be a number"),
        ("syntax.toml", "[time\nfps = 60\n", "this is not TOML"),
        ("negative.toml", "[solver.ams]\nk_edge = -1\n", "`solver.ams.k_edge` should be from 0 to 1e12"),
        ("nan.toml", "[solver.ams]\ndrag = nan\n", "should be a finite number"),
        ("zero_strands.toml", "[groom]\nstrands = 0\n", "`groom.strands` should be from 1 to 1000000, not 0"),
        ("substep.toml", "[time]\nsubstep_secs = 0\n", "`time.substep_secs` should be from 1e-5 to 1"),
        ("substeps.toml", "[time]\nsubsteps = 8\n", "write time.substep_secs = 0.002083"),
        ("fps.toml", "[time]\nfps = -60\n", "`time.fps` should be from 1 to 10000"),
        ("frames.toml", "[time]\nframes = 1.5\n", "should be a whole number"),
        ("stiff.toml", "[solver.ams]\nk_edge = 1e9\n", "lower time.substep_secs to 9.98e-4, or lower it"),
        (
            "solver.toml",
            "[solver]\nkind = \"neural\"\nneural.model = \"builtin:hed\"\n",
            "did you mean \"builtin:head\"?",
        ),
        ("motion.toml", "[body]\nmotion = \"builtin:trun\"\n", "did you mean \"builtin:turn\"?"),
        ("mesh.toml", "[body]\nmesh = \"no.obj\"\n", "no.obj: no such file"),
        ("groom.toml", "[groom]\nsource = \"no.hair\"\n", "no.hair: no such file"),
        ("ending.toml", "[groom]\nsource = \"no.xyz\"\n", "files ending in .xyz are not known"),
        ("collider.toml", "[[collider]]\nshape = \"mesh\"\nmesh = \"no.obj\"\n", "no.obj: no such file"),
    ];
    for (name, text, _) in texts {
        scene(&place, name, text);
    }
    place.write("binary.toml", [0xff, 0xfe, 0x00]);
    let mut cases: Vec<Case<'_>> =
        texts.iter().map(|(name, _, words)| (*name, vec!["simulate", *name], 1, *words)).collect();
    cases.push(("a scene that is not text", vec!["simulate", "binary.toml"], 1, "it is not UTF-8 text"));
    cases.push(("a scene that is not there", vec!["simulate", "none.toml"], 1, "there is no such file"));
    cases.push(("a folder as scene", vec!["simulate", "."], 1, "it is a directory"));
    check(&place, &cases);
}

#[test]
fn command_lines_with_mistakes() {
    let place = Workplace::new();
    let cases: Vec<Case<'_>> = vec![
        ("unknown command", vec!["simulat"], 2, "unrecognized subcommand"),
        ("unknown option", vec!["demo", "--frame", "3"], 2, "unexpected argument"),
        (
            "unknown key of the reference",
            vec!["help", "scene", "solver.ams.k_egde"],
            1,
            "did you mean `solver.ams.k_edge`?",
        ),
        ("help of an unknown command", vec!["help", "simulat"], 1, "there is no command `simulat`"),
        ("no scene", vec!["simulate"], 2, "required arguments"),
        ("no threads", vec!["demo", "--threads", "0"], 2, "0 is not in 1..=1024"),
        ("wrong unit", vec!["info", "x.hair", "--unit", "ell"], 2, "not a unit of length"),
        ("wrong scale", vec!["info", "x.hair", "--scale", "-1"], 2, "should be a number above 0"),
        (
            "resampled to one",
            vec!["convert", "a.hair", "b.hair", "--resample", "1"],
            2,
            "1 is not in 2..=1000",
        ),
        (
            "wrong key",
            vec!["demo", "--set", "time.fsp=3"],
            1,
            "--set time.fsp=3: there is no key `time.fsp`; did",
        ),
        ("no equals sign", vec!["demo", "--set", "time.fps"], 1, "not of the form key=value"),
        ("negative frames", vec!["demo", "--frames", "-3"], 1, "--frames -3: `time.frames` should be"),
        ("wrong solver", vec!["demo", "--solver", "asm"], 1, "--solver asm: `solver.kind` cannot be \"asm\""),
        ("no such stage", vec!["demo", "--gpu-from", "solve_pressure"], 2, "the grid goes as splat_segments"),
        (
            "two backends",
            vec!["demo", "--gpu-from", "find_contacts", "--backend", "cpu"],
            2,
            "cannot be used with",
        ),
        ("wrong cache", vec!["demo", "--cache", "x.abc"], 1, "ends in .abc: this version writes .npz"),
        ("wrong preset", vec!["grow", "x.hair", "--preset", "wvay"], 1, "did you mean \"wavy\"?"),
        ("wrong growth", vec!["grow", "x.hair", "--set", "noise=-1"], 1, "`groom.grow.noise` should be"),
        (
            "frames of a figure",
            vec!["bench", "paper", "--figure", "9", "--frames", "3"],
            2,
            "cannot be used with",
        ),
    ];
    check(&place, &cases);
}

/// A `.hair` file of one strand of two points.
fn hair(strands: u32, points: u32, flags: u32) -> Vec<u8> {
    let mut bytes = b"HAIR".to_vec();
    bytes.extend(strands.to_le_bytes());
    bytes.extend(points.to_le_bytes());
    bytes.extend(flags.to_le_bytes());
    bytes.extend(1u32.to_le_bytes());
    bytes.resize(128, 0);
    for x in [0.0f32, 0.0, 0.0, 0.0, 0.0, 0.1] {
        bytes.extend(x.to_le_bytes());
    }
    bytes
}

#[test]
fn grooms_with_mistakes() {
    let place = Workplace::new();
    place.write("cut.hair", &hair(1, 2, 2)[..140]);
    place.write("header.hair", &hair(1, 2, 2)[..50]);
    place.write("empty.hair", "");
    place.write("huge.hair", hair(4_000_000_000, 4_000_000_000, 2));
    place.write("none.hair", hair(0, 0, 2));
    place.write("other.hair", "this is no groom, but a text that someone renamed to .hair");
    let mut nan = hair(1, 2, 2);
    nan[140..144].copy_from_slice(&f32::NAN.to_le_bytes());
    place.write("nan.hair", nan);
    place.write("huge.data", u32::MAX.to_le_bytes());
    place.write("cut.npz", b"PK\x03\x04");
    place.write("cut.tfxbone", 3u32.to_le_bytes());
    place.write("old.tfxskin", [7, 0, 0, 0, 1, 0, 0, 0]);
    place.write("cut.glb", b"glTF");
    fs::create_dir(place.path("folder.hair")).unwrap();
    let mut cases: Vec<Case<'_>> = vec![
        (
            "cut in the points",
            vec!["info", "cut.hair"],
            1,
            "cut.hair: .hair file, byte 128: the points take 24 bytes, but 12 are left",
        ),
        ("cut in the header", vec!["info", "header.hair"], 1, "header.hair"),
        ("empty", vec!["info", "empty.hair"], 1, "the file is empty"),
        ("counts of 4 billion", vec!["info", "huge.hair"], 1, "huge.hair"),
        ("zero strands", vec!["info", "none.hair"], 1, "none.hair"),
        ("another file's bytes", vec!["info", "other.hair"], 1, "other.hair"),
        ("only points that are no numbers", vec!["info", "nan.hair"], 1, "no usable strand"),
        ("counts of 4 billion in .data", vec!["info", "huge.data"], 1, "huge.data"),
        ("a cut archive", vec!["info", "cut.npz"], 1, "cut.npz"),
        ("bones without names", vec!["info", "cut.tfxbone"], 1, "byte 4: the bones take 4 bytes, but 0 are"),
        ("roots of another version", vec!["info", "old.tfxskin"], 1, "version 7 is not supported"),
        ("bytes that are no glTF", vec!["info", "cut.glb"], 1, "cut.glb: not a glTF 2.0 file"),
        ("a folder", vec!["info", "folder.hair"], 1, "this is a folder"),
        ("a missing file", vec!["info", "missing.hair"], 1, "no such file"),
        ("no ending", vec!["info", "missing"], 1, "no ending"),
    ];
    place.write("good.hair", hair(1, 2, 2));
    cases.extend([
        (
            "into a missing folder",
            vec!["convert", "good.hair", "no/such/out.hair"],
            1,
            "no such file or folder",
        ),
        ("into a folder", vec!["convert", "good.hair", "folder.hair"], 1, "this is a folder"),
        ("into an unknown format", vec!["convert", "good.hair", "out.xyz"], 1, "files ending in .xyz"),
        ("hair of glTF", vec!["convert", "cut.glb", "out.npz"], 1, "these can be read: .hair"),
        ("a film of a groom", vec!["render", "good.hair", "--film"], 1, "needs a cache"),
    ]);
    check(&place, &cases);
}

/// Every truncation of a small groom is refused. One run for each would take long, so only a few
/// bytes of each part are tried.
#[test]
fn truncated_at_any_byte() {
    let place = Workplace::new();
    let whole = hair(1, 2, 2);
    for length in [1, 3, 4, 7, 12, 16, 127, 128, 129, 139, 151] {
        place.write("cut.hair", &whole[..length]);
        check(&place, &[("truncated", vec!["info", "cut.hair"], 1, "cut.hair")]);
    }
}

#[cfg(unix)]
#[test]
fn places_that_cannot_be_written() {
    use std::os::unix::fs::PermissionsExt;
    let place = Workplace::new();
    place.write("good.hair", hair(1, 2, 2));
    place.write("file", "not a folder");
    check(
        &place,
        &[(
            "a file as output folder",
            vec!["demo", "--out", "file", "--frames", "1", "--set", "body.sdf_cells=24"],
            1,
            "file: the output",
        )],
    );
    let locked = place.path("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    // Root may write anywhere: there the case shows nothing.
    if fs::write(locked.join("probe"), "").is_err() {
        let case = ("no permission", vec!["convert", "good.hair", "locked/out.hair"], 1, "permission denied");
        check(&place, &[case]);
    } else {
        fs::remove_file(locked.join("probe")).unwrap();
        println!("skipped: this user may write to folders without write permission");
    }
}

/// What does not fit into the memory, here of 16 GB, is refused before it is tried.
#[cfg(target_os = "linux")]
#[test]
fn more_than_the_memory() {
    let place = Workplace::new();
    fs::File::create(place.path("huge.hair")).unwrap().set_len(4_000_000_000_000).unwrap();
    // A count of strands; of each, its count of points and two points.
    let strand = [2, 0, 0, 0, 0, 0, 0.1f32.to_bits()].map(u32::to_le_bytes).concat();
    place.write("many.data", [&500_000u32.to_le_bytes()[..], &strand.repeat(500_000)].concat());
    let many = ["groom.strands=1000000", "groom.vertices_per_strand=1000"];
    let cells = ["interaction.kind=grid", "interaction.grid.max_cells=1000000000"];
    let demo = |keys: &[&'static str], more: &[&'static str]| {
        [small_demo("out", more), sets(keys.iter().copied())].concat()
    };
    let words = |line: &str| line.split(' ').map(str::to_owned).collect::<Vec<_>>();
    let strands = "lower the number of strands or of their particles";
    let cases = [
        (demo(&many, &[]), "the simulation needs 150 GB of memory, ", strands),
        (demo(&many, &["--json"]), "the simulation needs 150 GB of memory, ", strands),
        (demo(&cells, &[]), "the grid of hair–hair interaction needs 60 GB of memory, ", "max_cells"),
        (words("grow x.npz --strands 1000000 --vertices 1000"), "the groom needs 28 GB of memory, ", strands),
        (words("convert many.data x.npz --resample 1000"), "resampling needs 18 GB of memory, ", "fewer"),
        (words("info huge.hair"), "huge.hair: reading needs 4.0 TB of memory, ", "split the file"),
    ];
    for (arguments, needs, remedy) in cases {
        let output = std::process::Command::new("sh")
            .args(["-c", "ulimit -v 16000000; exec \"$0\" \"$@\""])
            .arg(assert_cmd::cargo::cargo_bin("forelock"))
            .args(&arguments)
            .current_dir(place.path(""))
            .env("XDG_CACHE_HOME", shared_cache())
            .output()
            .unwrap();
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
        assert!(message.contains(needs) && message.contains(remedy), "{arguments:?}: {message}");
        assert_eq!(lines_but_progress(&message), 1, "{arguments:?}: {message}");
        assert!(!place.path("out/hair.npz").exists());
    }
}

/// Standard output on a full device: one message, after the work is done.
#[cfg(target_os = "linux")]
#[test]
fn results_that_cannot_be_written() {
    let place = Workplace::new();
    place.write("good.hair", hair(1, 2, 2));
    let demo = small_demo("out", &["--json", "--set", "output.film=false"]);
    let demo: Vec<&str> = demo.iter().map(String::as_str).collect();
    let cases = [
        vec!["info", "good.hair"],
        vec!["info", "good.hair", "--json"],
        vec!["convert", "good.hair", "out.hair"],
        vec!["completions", "bash"],
        vec!["--version"],
        vec!["grow", "--help"],
        demo,
    ];
    for arguments in cases {
        let output = std::process::Command::new(assert_cmd::cargo::cargo_bin("forelock"))
            .args(&arguments)
            .current_dir(place.path(""))
            .env("XDG_CACHE_HOME", shared_cache())
            .stdout(fs::File::create("/dev/full").unwrap())
            .output()
            .unwrap();
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
        let expected = "error: the result cannot be written to standard output: No space left on device";
        assert_eq!(message.matches(expected).count(), 1, "{arguments:?}: {message}");
        assert!(!message.contains("panicked"), "{arguments:?}: {message}");
    }
    // The reader of a pipe may close it, as `head` does.
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let closed = std::process::Command::new(assert_cmd::cargo::cargo_bin("forelock"))
        .args(["completions", "bash"])
        .stdout(writer)
        .output()
        .unwrap();
    assert_eq!(closed.status.code(), Some(0), "{}", stderr(&closed));
}

/// A disk that is full after 16 KiB, as the limit on file sizes makes it.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_no_broken_file() {
    use std::process::Command;
    let place = Workplace::new();
    let arguments = small_demo("out", &["--frames", "100", "--set", "output.film=false"]);
    let output = Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 32; exec \"$0\" \"$@\""])
        .arg(assert_cmd::cargo::cargo_bin("forelock"))
        .args(arguments)
        .current_dir(place.path(""))
        .env("XDG_CACHE_HOME", place.path("cache"))
        .output()
        .unwrap();
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert_eq!(message.matches("error:").count(), 1, "{message}");
    assert!(message.contains("cannot write"), "{message}");
    for name in ["hair.npz", "snapshot.npz", "summary.json", "report.html"] {
        assert!(!place.path("out").join(name).exists(), "{name} is there");
    }
}
