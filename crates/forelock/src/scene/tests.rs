//! What a scene file may say, and what is answered when it says something else.

use forelock_core::groom::grow::GrowParams;

use super::*;
use forelock_render::HairColour;
use glam::Vec3;

fn parse(text: &str, sets: &[&str]) -> Result<Scene, SceneError> {
    let overrides: Result<Vec<_>, _> = sets.iter().map(|set| Override::set(set)).collect();
    Scene::parse(text, Path::new("dir/scene.toml"), &overrides?)
}

fn message(text: &str, sets: &[&str]) -> String {
    parse(text, sets).unwrap_err().to_string()
}

#[test]
fn the_empty_file_is_the_default_scene() {
    let scene = parse("", &[]).unwrap();
    let mut expected = Scene::default();
    expected.time.substep_secs = Some(1.0 / 240.0);
    expected.groom.grow.seed = 1;
    assert_eq!(scene, expected);
}

#[test]
fn the_built_in_scene_reads_and_round_trips() {
    let scene = Scene::builtin(&[]).unwrap();
    assert_eq!(scene.groom.strands, 10_000);
    let again = Scene::parse(&scene.to_toml(), Path::new(""), &[]);
    assert_eq!(again.unwrap(), scene);
}

#[test]
fn strands_that_an_override_changes_keep_their_vertices() {
    let text = "[groom]\nstrands = 1000\nvertices = 20500\n";
    for (sets, expected) in [
        (&[][..], [1000, 20_500]),
        (&["groom.strands=100"], [100, 2050]),
        (&["groom.strands=5", "groom.strands=100", "time.fps=30"], [100, 2050]),
        (&["groom.strands=100", "groom.vertices=900"], [100, 900]),
        (&["groom.vertices=4100"], [1000, 4100]),
    ] {
        let groom = parse(text, sets).unwrap().groom;
        assert_eq!([groom.strands, groom.vertices], expected, "{sets:?}");
    }
    // Files keep their strands.
    let file = format!("{text}source = \"hair.tfx\"\n");
    assert_eq!(parse(&file, &["groom.strands=100"]).unwrap().groom.vertices, 20_500);
}

#[test]
fn unknown_keys_are_refused_by_name_with_line_and_nearest_key() {
    assert_eq!(
        message("[groom]\nstrands = 5\nstrnds = 3\n", &[]),
        "dir/scene.toml, line 3, column 1: there is no key `groom.strnds`; did you mean `groom.strands`?"
    );
    assert_eq!(
        message("[grom]\nstrands = 5", &[]),
        "dir/scene.toml, line 1, column 2: there is no key `grom`; did you mean `groom`?"
    );
    assert!(message("[solver.ams]\nk_egde = 1.0", &[]).contains("did you mean `solver.ams.k_edge`?"));
    assert!(message("[[collider]]\n[[collider]]\nradios = 1", &[]).contains(
        "line 3, column 1: there is no key `collider.1.radios`; did you mean `collider.1.radius`?"
    ));
    assert!(
        message("[interaction]\nzzz = 1", &[])
            .ends_with("no key `interaction.zzz`; known here: kind, grid, sph, contacts, contact")
    );
    assert!(message("[body.motion]\nnam = \"x\"", &[]).contains("`body.motion.name`?"));
    for section in ["output.exports = [\"a.abc\"]", "time.fps = 24"] {
        let said = message(&format!("[body.motion]\nname = \"x\"\n{section}"), &[]);
        let (name, _) = section.split_once('.').unwrap();
        assert!(said.contains(&format!("`body.motion.{name}`; keys of `{name}` stand before")), "{said}");
    }
}

#[test]
fn wrong_types_say_what_is_expected() {
    for (text, expected) in [
        ("[time]\nfps = \"fast\"", "line 2, column 7: `time.fps` should be a number, not the text \"fast\""),
        (
            "[groom]\nstrands = -3",
            "line 2, column 11: `groom.strands` should be a whole number, 0 or more, not -3",
        ),
        ("[groom]\nstrands = 2.5", "should be a whole number, 0 or more, not 2.5"),
        ("gravity = [0, 1]", "`gravity` should be a list of 3, not of 2"),
        ("groom = 3", "`groom` should be a table of keys, not 3"),
        ("[output]\npicture = 1", "`output.picture` should be true or false, not 1"),
        ("[groom]\nsource = 3", "should be \"grow\", a file's path or a list of paths, not 3"),
        ("[groom]\nunit = \"furlong\"", "`groom.unit` is wrong: `furlong` is not a unit of length"),
        ("[solver]\nkind = \"amx\"", "`solver.kind` cannot be \"amx\": it is one of ams, mass-spring"),
        ("[time]\nfps = ", "line 2, column 7: this is not TOML"),
        ("[time]\nfps = 1\nfps = 2", "line 3, column 1: this is not TOML: duplicate key"),
    ] {
        let message = message(text, &[]);
        assert!(message.contains(expected), "{text:?}: {message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
}

#[test]
fn values_out_of_range_are_refused_where_they_are_set() {
    for (text, expected) in [
        ("[time]\nfps = 0", "line 2, column 7: `time.fps` should be from 1 to 10000, not 0"),
        ("[time]\nfps = nan", "`time.fps` should be a finite number, not NaN"),
        ("gravity = [0, inf, 0]", "`gravity` should be a finite number"),
        ("[time]\nsubstep_secs = 0", "`time.substep_secs` should be from 1e-5 to 1, not 0"),
        ("[time]\nframes = 0", "`time.frames` should be from 1 to 1000000"),
        (
            "[solver.ams]\nk_bend = -1.0",
            "line 2, column 10: `solver.ams.k_bend` should be from 0 to 1e12, not -1",
        ),
        ("[groom]\nvertices_per_strand = 1", "should be from 2 to 1000, or 0, not 1"),
        ("[groom]\npreset = \"wayv\"", "`groom.preset` cannot be \"wayv\": it is one of straight, wavy"),
        ("[groom.grow]\nnoise = -1", "line 2, column 9: `groom.grow.noise` should be from 0 to 10, not -1"),
        ("[groom.grow]\nseed = 2", "`groom.grow.seed` is not a key of a scene: set `seed` instead"),
        ("[body]\nmotion = \"builtin:trn\"", "did you mean \"builtin:turn\"?"),
        (
            "[body]\nmesh = \"builtin:walker\"\nmotion = { name = \"walk\", amplitude = 2 }",
            "`body.motion.amplitude` is for builtin motions and keyframes, but the body plays a clip",
        ),
        (
            "[body]\nmotion = \"walk\"\n[body.motion.clip]\nspeed = 2",
            "a motion's name is the key `name` of its table",
        ),
        ("[hair]\ncolour = \"blond\"", "did you mean \"blonde\"?"),
        ("[groom]\nsource = []", "is an empty list"),
        ("[body]\nscale = 2", "line 2, column 9: `body.scale` is for files, but `body.mesh` is built in"),
        ("[groom]\nunit = \"cm\"", "`groom.unit` is for files, but `groom.source` is \"grow\": remove it"),
        ("[[collider]]\nup = \"z\"", "`collider.0.up` is for files, but this `shape` (sphere) is not read"),
        ("[body]\nmesh = \"none\"", "hair needs a body to grow on"),
        ("[[collider]]\nshape = \"box\"\nradius = 1", "does not apply to this `shape` (box)"),
        ("[[collider]]\nshape = \"mesh\"", "there is no `mesh` file"),
        (
            "[[collider]]\nradius = -1",
            "line 2, column 10: `collider.0.radius` should be from 1e-4 to 10000, not -1",
        ),
        ("[output]\ncache = \"x.abc\"", "ends in .abc: this version writes .npz"),
        (
            "[time]\nsubstep_secs = 0.01\n[solver.ams]\nsubstep_secs = 0.01",
            "which means the same: remove one of the two",
        ),
        (
            "[solver]\nkind = \"neural\"\n[solver.neural]\nmodel = \"builtin:hed\"",
            "line 4, column 9: `solver.neural.model` cannot be \"builtin:hed\"",
        ),
        (
            "[interaction.grid]\nresolution = 4",
            "`interaction.grid.resolution` should be from 8 to 512, not 4",
        ),
        ("[wind]\ngusts = 1", "there is no key `wind.gusts`"),
        ("[wind]\ngust_strength = 2", "line 2, column 17: `wind.gust_strength` should be from 0 to 1, not 2"),
        ("[wind]\nturbulence_scale = 0", "`wind.turbulence_scale` should be from 0.001 to 1000, not 0"),
        ("[wind]\nvelocity = [1, 0]", "`wind.velocity`"),
        (
            "[[collider]]\nshape = \"mesh\"\nmesh = \"a.obj\"\nmesh_sequence = [\"b.obj\"]",
            "`collider.0.mesh_sequence` is set, and so is `mesh`",
        ),
        ("[[collider]]\nmesh_sequence = [\"b.obj\"]", "does not apply to this `shape` (sphere)"),
        ("[[collider]]\nshape = \"comb\"\nradius = 1", "does not apply to this `shape` (comb)"),
        (
            "[[collider]]\nshape = \"hand\"\nsdf_cells = 4",
            "`collider.0.sdf_cells` should be from 8 to 512, not 4",
        ),
    ] {
        let message = message(text, &[]);
        assert!(message.contains(expected), "{text:?}: {message}");
    }
}

#[test]
fn stiffness_beyond_float32_says_how_to_mend_it() {
    // h = 1/240 s: the bound is 1e3 · 240² = 5.76e7 s⁻².
    assert!(parse("[solver.ams]\nk_edge = 5.76e7", &[]).is_ok());
    let message = message("[solver.ams]\nk_edge = 1e9", &[]);
    assert!(message.contains("lower time.substep_secs to 9.98e-4, or lower it to 5.760e7"), "{message}");
    assert!(parse("[solver.ams]\nk_edge = 1e9", &["time.substep_secs=9.98e-4"]).is_ok());
    assert!(parse("[solver.ams]\nk_edge = 1e9", &["time.substep_secs=1.04e-3"]).is_err());
}

#[test]
fn a_number_of_substeps_is_refused_with_what_to_write_instead() {
    let old = message("[time]\nfps = 30\nsubsteps = 8", &[]);
    assert_eq!(
        old,
        "dir/scene.toml, line 3, column 12: `time.substeps` is no longer a key: the length of a substep is, \
         and frames take what they need; write time.substep_secs = 0.004167 (1/(30 × 8))"
    );
    // What the message names means the same number of substeps.
    assert_eq!(parse("[time]\nfps = 30\nsubstep_secs = 0.004167", &[]).unwrap().substeps(), 8);
    let old = message("", &["solver.mass_spring.substeps=5"]);
    assert!(old.contains("write solver.mass_spring.substep_secs = 0.003333 (1/(60 × 5))"), "{old}");
    assert_eq!(parse("[solver.ams]\nsubstep_secs = 0.003333", &[]).unwrap().substeps(), 5);
    let odd = message("[solver.ams]\nsubsteps = \"many\"", &[]);
    assert!(odd.contains("1/(frames a second × substeps)"), "{odd}");
}

#[test]
fn frames_take_the_substeps_that_they_need() {
    for (fps, expected) in [
        ("24", 10),
        ("25", 10),
        ("30", 8),
        ("48", 5),
        ("50", 5),
        ("59.94", 4),
        ("60", 4),
        ("72", 4),
        ("90", 3),
        ("120", 2),
        ("144", 2),
        ("240", 1),
        ("1000", 1),
    ] {
        assert_eq!(parse("", &[&format!("time.fps={fps}")]).unwrap().substeps(), expected, "{fps}");
    }
}

#[test]
fn overrides_are_read_like_the_file() {
    let sets = ["time.fps=30", "solver.kind=mass-spring", "collider.0.radius=0.5", "body.motion.amplitude=2"];
    let scene = parse("[[collider]]\nradius = 1", &sets).unwrap();
    assert_eq!((scene.time.fps, scene.solver.kind), (30.0, SolverKind::MassSpring));
    assert_eq!(scene.colliders[0].radius, Some(0.5));
    assert_eq!(scene.body.motion.amplitude, 2.0);
    // Keys of a motion that the file only names.
    let sets = ["body.motion.clip.speed=2"];
    let scene = parse("[body]\nmesh = \"builtin:walker\"\nmotion = \"walk\"", &sets).unwrap();
    let motion = &scene.body.motion;
    assert_eq!((motion.name.as_str(), motion.clip.speed), ("walk", 2.0));
    for (set, expected) in [
        ("time.fsp=30", "--set time.fsp=30: there is no key `time.fsp`; did you mean `time.fps`?"),
        ("time.fps=6O", "--set time.fps=6O: `time.fps` should be a number, not the text \"6O\""),
        ("time.fps=-1", "--set time.fps=-1: `time.fps` should be from 1 to 10000, not -1"),
        ("time.=1", "--set time.=1: this is not TOML"),
        ("nothing", "`nothing` is not of the form key=value"),
        ("time.fps=1\nseed=2", "--set time.fps=1 seed=2: `time.fps` should be a number, not the text"),
    ] {
        let message = message("[time]\nfps = 24 # ä", &[set]);
        assert!(message.starts_with(expected) || message.contains(expected), "{set:?}: {message}");
    }
    // The last of two overrides is the one that holds, and the one that is named.
    assert!(message("", &["seed=1", "time.fps=0"]).starts_with("--set time.fps=0:"));
    assert_eq!(parse("", &["seed=5", "seed=7"]).unwrap().seed, 7);
}

#[test]
fn growth_parameters_lie_over_their_preset() {
    let scene =
        parse("[groom]\npreset = \"bob\"\nstrands = 7\n[groom.grow]\nnoise = 0.5", &["seed=3"]).unwrap();
    let expected = GrowParams { noise: 0.5, strands: 7, seed: 3, ..GrowParams::preset("bob").unwrap() };
    assert_eq!(scene.groom.grow, expected);
    assert!(
        message("[groom.grow]\nnoize = 1", &[])
            .contains("line 2, column 1: there is no key `groom.grow.noize`; did")
    );
}

#[test]
fn paths_are_relative_to_the_file() {
    let scene =
        parse("[groom]\nsource = [\"a.hair\", \"/b.hair\"]\n[body]\nmesh = \"head.obj\"", &[]).unwrap();
    let expected = GroomSource::Files(vec!["dir/a.hair".into(), "/b.hair".into()]);
    assert_eq!((scene.groom.source, scene.body.mesh.as_str()), (expected, "dir/head.obj"));
}

#[test]
fn a_scene_with_absolute_paths_means_the_same_in_any_folder() {
    let text =
        "groom.source = \"a.hair\"\nbody.mesh = \"b.obj\"\n[[collider]]\nshape = \"mesh\"\nmesh = \"c.obj\"";
    let scene = parse(text, &[]).unwrap().with_absolute_paths();
    let elsewhere = Scene::parse(&scene.to_toml(), Path::new("other/scene.toml"), &[]).unwrap();
    assert_eq!(elsewhere, scene);
    assert_eq!(Path::new(&scene.body.mesh), std::env::current_dir().unwrap().join("dir/b.obj"));
    let named = parse("", &[]).unwrap();
    assert_eq!(named.clone().with_absolute_paths(), named);
}

#[test]
fn edits_are_read_in_order_and_round_trip() {
    use forelock_core::groom::edit::{CutShape, Operation};
    let text = "[[edit]]\nop = \"trim\"\nto = 0.3\nat_secs = 1\n[[edit]]\nop = \"cut\"\nshape.sphere = { centre = [0, 0.1, 0], radius = 0.05 }\n\
                [edit.only]\nbox = { from = [-1, -1, -1], to = [1, 1, 0.25] }\n";
    let scene = parse(text, &["edit.0.by=0.1"]).unwrap();
    let [trim, cut] = scene.edits.0.as_slice() else { panic!("{:?}", scene.edits) };
    assert!(matches!(&trim.edit.operation, Operation::Trim(trim) if trim.to == 0.3 && trim.by == 0.1));
    assert!(
        matches!(&cut.edit.operation, Operation::Cut(cut) if matches!(cut.shape, CutShape::Sphere(_)) && cut.seed == 1)
    );
    assert!(cut.edit.only.cuboid.is_some() && cut.edit.only.share == 1.0);
    assert_eq!(Scene::parse(&scene.to_toml(), Path::new(""), &[]).unwrap(), scene);
    for name in Operation::NAMES {
        let message = message(&format!("[[edit]]\nop = \"{name}\"\nzzz = 1"), &[]);
        assert!(message.contains("`edit.0.zzz`"), "{name}: {message}");
    }
}

#[test]
fn scripts_that_come_along_are_scenes() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/grooms");
    let mut scripts = 0;
    for file in std::fs::read_dir(folder).unwrap() {
        let scene = Scene::load(&file.unwrap().path(), &[]).unwrap_or_else(|error| panic!("{error}"));
        assert!(!scene.edits.is_empty(), "{}", scene.name);
        scripts += 1;
    }
    assert!(scripts > 0);
}

#[test]
fn teleports_and_keyframes_that_jump_are_read_and_checked() {
    let text = "[[teleport]]\nat_secs = 1.0\n[[teleport]]\nat_secs = 2.0\nmode = \"reset\"\n";
    let scene = parse(text, &[]).unwrap();
    assert_eq!(scene.teleports[0].mode, forelock_core::simulation::Teleport::CarryShape);
    assert_eq!(scene.teleports[1].mode, forelock_core::simulation::Teleport::Reset);
    assert_eq!(Scene::parse(&scene.to_toml(), Path::new("scene.toml"), &[]).unwrap(), scene);
    assert!(
        message("[[teleport]]\nat_secs = 0\n", &[]).contains("`teleport.0.at_secs` should be from 1e-6 to")
    );
    assert!(message("[[teleport]]\nmode = \"rest\"\n", &[]).contains("did you mean \"reset\"?"));
    assert!(message("", &["body.teleport_speed=-1"]).contains("should be from 0 to 1000000000"));
    let keys = |second: &str| {
        let keyframe = "[[body.motion.keyframe]]\ntime_secs = ";
        parse(&format!("{keyframe}0\n{keyframe}1\n{keyframe}1\n{second}\n"), &[])
    };
    assert!(keys("").unwrap_err().to_string().contains("`body.motion.keyframe.2.time_secs` should be later"));
    assert!(keys("jump = true").unwrap().body.motion.keyframes[2].jump);
    let held = "[body.motion]\nkeyframe = [{}, {time_secs = 1, interpolation = \"hold\"}, {time_secs = 1}]\n";
    let scene = parse(held, &[]).unwrap();
    assert_eq!(Scene::parse(&scene.to_toml(), Path::new("scene.toml"), &[]).unwrap(), scene);
    assert!(message("[body.motion]\ninterpolation = \"holt\"\n", &[]).contains("\"hold\""));
}

#[test]
fn the_colour_of_hair_has_white_hairs_and_dye() {
    let text = "[hair]\ncolour = \"grey\"\n";
    assert_eq!(parse(text, &[]).unwrap().hair.hair_colour(), HairColour::GREY);
    let scene = parse(text, &["hair.greying=0.1", "hair.dye=[1, 0.5, 0]"]).unwrap();
    let colour = scene.hair.hair_colour();
    assert!((colour.greying - 0.1).abs() < 1e-6 && colour.eumelanin == HairColour::GREY.eumelanin);
    assert!(colour.dye.distance(Vec3::new(1.0, 0.2140, 0.0)) < 1e-3, "{}", colour.dye);
    assert_eq!(Scene::parse(&scene.to_toml(), Path::new("scene.toml"), &[]).unwrap(), scene);
    assert!(message(text, &["hair.greying=1.1"]).contains("`hair.greying` should be from 0 to 1"));
    assert!(message(text, &["hair.dye=[0, 2, 0]"]).contains("hair.dye"));
    assert!(message("[hair]\ncolour = \"gray\"\n", &[]).contains("did you mean \"grey\"?"));
}

#[test]
fn registered_solvers_have_a_name_and_a_table() {
    let text = "[solver]\nkind = \"chain\"\n[solver.chain]\nlinks = 3\n";
    let scene = Scene::parse_with(text, Path::new("scene.toml"), &[], &["chain"]).unwrap();
    assert_eq!(scene.solver.kind, SolverKind::Custom("chain".to_owned()));
    assert_eq!(scene.solver.custom["links"].as_integer(), Some(3));
    let again = Scene::parse_with(&scene.to_toml(), Path::new("scene.toml"), &[], &["chain"]).unwrap();
    assert_eq!(again, scene);
    // An override reaches the table, and the table of a solver that is not chosen is allowed.
    let set = Override::set("solver.chain.links=4").unwrap();
    let scene = Scene::parse_with(text, Path::new("scene.toml"), &[set], &["chain"]).unwrap();
    assert_eq!(scene.solver.custom["links"].as_integer(), Some(4));
    let other = text.replace("\"chain\"", "\"dftl\"");
    let other = Scene::parse_with(&other, Path::new("scene.toml"), &[], &["chain"]).unwrap();
    assert_eq!(other.solver.kind, SolverKind::Dftl);
    // Without the registration both are unknown.
    assert!(
        message(text, &[]).contains("`solver.chain`") || message(text, &[]).contains("cannot be \"chain\"")
    );
    let wrong = text.replace("\"chain\"", "\"chian\"");
    let error = Scene::parse_with(&wrong, Path::new("scene.toml"), &[], &["chain"]).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("line 2") && error.contains("did you mean \"chain\"?"), "{error}");
}
