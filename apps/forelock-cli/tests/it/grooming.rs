//! `forelock groom`: what it prints and writes, and what it answers to a script with mistakes.

use std::fs;

use crate::common::{SMALL, Workplace, json, lines_but_progress, sets, stderr, stdout};

const SCRIPT: &str = "\
[groom]\nstrands = 60\nvertices_per_strand = 12\n[body]\nsdf_cells = 24\n[output]\nwidth = 64\nheight = 64\n\
[[edit]]\nop = \"trim\"\nto = 0.1\n\
[[edit]]\nop = \"comb\"\npoints = [[0.0, 0.12, 0.0], [0.1, 0.05, 0.0]]\n[edit.only]\nplane = { point = [0, 0, 0], normal = [1, 0, 0] }\n\
[[edit]]\nop = \"density\"\nfactor = 2\n";

#[test]
fn a_script_is_replayed_and_leaves_groom_and_pictures() {
    let place = Workplace::new();
    place.write("bob.toml", SCRIPT);
    let done = json(&place.run(["groom", "bob.toml", "--out", "out", "--steps", "--json"]));
    assert_eq!(done["before"]["strands"], 60);
    assert_eq!((&done["after"]["strands"], &done["edits"][2]["added"]), (&120.into(), &60.into()));
    assert_eq!(done["edits"][0]["op"], "trim");
    assert!(done["edits"][1]["changed"].as_u64().is_some_and(|n| n > 0 && n < 60));
    for name in [
        "groom.npz",
        "before-after.png",
        "steps/00.png",
        "steps/01-trim.png",
        "steps/02-comb.png",
        "steps/03-density.png",
    ] {
        assert!(fs::metadata(place.path("out").join(name)).unwrap().len() > 100, "{name}");
    }
    let info = json(&place.run(["info", "out/groom.npz", "--json"]));
    assert_eq!(info["strands"], 120);
    assert!(info["length"]["max"].as_f64().unwrap() < 0.1005);
    // The same script again gives the same bytes, with any number of threads.
    let again = place.run(["groom", "bob.toml", "--out", "again", "--threads", "1"]);
    assert!(stdout(&again).contains("60 strands of 720 particles became 120 of"), "{}", stderr(&again));
    assert!(
        fs::read(place.path("out/groom.npz")).unwrap() == fs::read(place.path("again/groom.npz")).unwrap()
    );
}

#[test]
fn every_format_that_can_be_written_holds_the_result() {
    let place = Workplace::new();
    place.write("bob.toml", SCRIPT);
    for name in ["a.hair", "a.data", "a.npz"] {
        let set = format!("output.groom={name}");
        let run =
            place.run(["groom", "bob.toml", "--out", "out", "--set", &set, "--set", "output.picture=false"]);
        assert!(run.status.success(), "{}", stderr(&run));
        let info = json(&place.run(["info", &format!("out/{name}"), "--json"]));
        assert_eq!(info["strands"], 120, "{name}");
    }
}

#[test]
fn a_scene_with_edits_simulates_the_edited_groom() {
    let place = Workplace::new();
    place.write("bob.toml", SCRIPT);
    let mut arguments = vec!["simulate".to_owned(), "bob.toml".to_owned(), "--json".to_owned()];
    let small = SMALL.into_iter().filter(|key| !key.starts_with("groom."));
    arguments.extend(sets(small.chain(["output.film=false", "output.picture=false"])));
    let summary = json(&place.run(arguments));
    assert_eq!(summary["strands"], 120);
    assert!(summary["notes"].to_string().contains("edit 3 (density): 0 of 60 strands changed, 60 added"));
    let written = fs::read_to_string(place.path("forelock-out/bob/scene.toml")).unwrap();
    assert!(written.contains("op = \"comb\""), "{written}");
}

#[test]
fn hair_is_cut_while_it_moves_and_a_resumed_run_is_the_same() {
    let place = Workplace::new();
    let edit =
        "[[edit]]\nop = \"trim\"\nto = 0.05\nat_secs = 0.05\n[[edit]]\nop = \"curl\"\nat_secs = 0.03\n";
    place.write("cut.toml", edit);
    let run = |out: &str, more: &[&str]| {
        let mut arguments: Vec<String> =
            ["simulate", "cut.toml", "--out", out, "--json"].map(str::to_owned).to_vec();
        arguments.extend(sets(SMALL.into_iter().chain(["output.picture=false"])));
        arguments.extend(more.iter().map(|s| (*s).to_owned()));
        json(&place.run(arguments))
    };
    let whole = run("whole", &[]);
    assert_eq!((&whole["strands"], &whole["particles"]), (&40.into(), &320.into()));
    assert!(whole["notes"].to_string().contains("edit 1 (trim) at 0.05 s: 40 of 40"), "{}", whole["notes"]);
    for frames in ["1", "2", "3", "4"] {
        run("parts", &["--frames", frames]);
        let resumed = run("parts", &["--resume"]);
        assert_eq!(resumed["state_hash"], whole["state_hash"], "from frame {frames}");
        assert!(
            fs::read(place.path("parts/hair.npz")).unwrap()
                == fs::read(place.path("whole/hair.npz")).unwrap()
        );
    }
}

#[test]
fn scripts_with_mistakes() {
    let place = Workplace::new();
    let edit = |text: &str| format!("[groom]\nstrands = 9\n[[edit]]\n{text}\n");
    for (text, words) in [
        (edit("op = \"trm\""), "line 4, column 6: `edit.0.op` cannot be \"trm\": it is one of trim, cut"),
        (
            edit("op = \"trim\"\ntoo = 1"),
            "line 5, column 1: there is no key `edit.0.too`; did you mean `edit.0.to`?",
        ),
        (edit("to = 0.1"), "`edit.0` has no `op`: it is one of trim"),
        (edit("op = 3"), "`edit.0.op` should be one of trim"),
        (
            edit("op = \"trim\"\nto = \"long\""),
            "line 5, column 6: `edit.0.to` should be a number, not the text",
        ),
        (
            edit("op = \"trim\"\nto = -0.1"),
            "line 5, column 6: `edit.0.to` should be from 0 to 1000, not -0.1",
        ),
        (edit("op = \"curl\"\nradius = inf"), "`edit.0.radius` should be"),
        (
            edit("op = \"curl\"\nkind = \"helx\""),
            "`edit.0.kind` cannot be \"helx\": it is one of helix, wave, roll",
        ),
        (edit("op = \"cut\""), "line 3, column 1: `edit.0` has no `shape`, which it needs"),
        (edit("op = \"cut\"\nshape.cone = {}"), "`edit.0.shape.cone`"),
        (
            edit("op = \"cut\"\nshape.sphere = { centre = [0, 0, 0], radius = 0 }"),
            "`edit.0.shape.sphere.radius` should be from 1e-6",
        ),
        (
            edit("op = \"cut\"\nshape.sphere = { centre = [0, 0], radius = 1 }"),
            "should be a list of 3 numbers, not of 2",
        ),
        (edit("op = \"comb\"\npoints = [[0, 0, 0]]"), "`edit.0.points` should be two points or more, not 1"),
        (edit("op = \"trim\"\nonly.share = 2"), "`edit.0.only.share` should be from 0 to 1, not 2"),
        (edit("op = \"trim\"\nonly.shere = 2"), "did you mean"),
        (edit("op = \"trim\"\n[output]\ngroom = \"x.bin\""), "`output.groom` should end in one of .hair"),
        (
            edit("op = \"trim\"\nat_secs = -1"),
            "line 5, column 11: `edit.0.at_secs` should be from 0 to 1000000, not -1",
        ),
        (edit("op = \"trim\"\nat_secs = \"soon\""), "`edit.0.at_secs` should be a number, not the text"),
        (edit("op = \"density\"\nat_secs = 1"), "`edit.0.at_secs` cannot be used with op = \"density\""),
        (edit("op = \"trim\"\nat_secs = 1\n[solver]\nkind = \"mass-spring\""), "virtual_particles` = false"),
        ("edit = 3".to_owned(), "`edit` should be a list of tables: write [[edit]]"),
        ("[[edits]]\nop = \"trim\"".to_owned(), "did you mean `edit`?"),
    ] {
        place.write("script.toml", &text);
        let before = place.files();
        let output = place.run(["groom", "script.toml"]);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{text}: {message}");
        assert!(message.contains(words), "{words:?} is not in {message:?}");
        assert_eq!((message.matches("error:").count(), lines_but_progress(&message)), (1, 1), "{message}");
        assert!(output.stdout.is_empty());
        assert_eq!(place.files(), before, "{text} left a file");
    }
    let missing = place.run(["groom", "none.toml"]);
    assert!(stderr(&missing).contains("there is no such file"), "{}", stderr(&missing));
}
