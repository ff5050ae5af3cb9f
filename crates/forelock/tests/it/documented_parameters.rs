//! The documentation of parameters is the reference that users read, and what scenes are held to:
//! the page and the defaults agree with it, every number has a range, and no value in its range
//! ends in positions that are not finite.

#![expect(clippy::unwrap_used, reason = "a test fails where its source is not as expected")]

use std::path::Path;

use forelock::Scene;
use forelock::core::params::{Documented, Key};
use forelock::player::Player;
use forelock::scene::reference::{self, Entry};
use forelock::scene::{
    BodySection, CameraSection, ColliderSection, GroomSection, HairSection, InteractionSection, Keyframe,
    MotionSection, OutputSection, Override, SolverSection, TimeSection,
};
use forelock_core::air::WindParams;
use forelock_core::groom::edit::{Clump, Curl, Density, Lengthen, Mirror, Resample, Selection, Smooth, Trim};
use forelock_core::groom::grow::GrowParams;
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::interaction::sph::SphParams;
use forelock_core::params::ParamsError;
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams};
use glam::Vec3;
use serde::Serialize;
use serde::de::DeserializeOwned;

#[test]
fn the_page_is_what_the_program_prints() {
    let page = include_str!("../../../../docs/scene-reference.md");
    assert!(
        page == reference::markdown(),
        "run `forelock help scene --markdown > docs/scene-reference.md`, and look at the difference"
    );
}

#[test]
fn the_page_of_trainings_is_what_the_program_prints() {
    let page = include_str!("../../../../docs/training-reference.md");
    assert!(
        page == forelock::training::markdown(),
        "run `forelock help training --markdown > docs/training-reference.md`"
    );
}

/// Compares the documented defaults of `D` with those of its `Default`; returns how many there are.
fn compare_defaults<D: Documented + Default + Serialize>() -> usize {
    let defaults = toml::Table::try_from(D::default()).unwrap();
    let mut compared = 0;
    for key in D::KEYS {
        let Some(held) = defaults
            .get(key.name())
            .filter(|value| !value.is_table() && value.as_array().is_none_or(|list| !list.is_empty()))
        else {
            continue;
        };
        let Some(words) = key.default_words() else { panic!("`{}` states no default", key.name()) };
        let words = words.split(" (").next().unwrap();
        let Ok(stated) = toml::from_str::<toml::Table>(&format!("x = {words}")) else { continue };
        let numbers = |value: &toml::Value| -> Option<Vec<f32>> {
            let one = |v: &toml::Value| Some(v.as_float().or(v.as_integer().map(|i| i as f64))? as f32);
            value.as_array().map_or_else(|| Some(vec![one(value)?]), |list| list.iter().map(one).collect())
        };
        match (numbers(&stated["x"]), numbers(held)) {
            (Some(stated), Some(held)) => assert_eq!(stated, held, "{}", key.name()),
            _ => assert_eq!(stated["x"], *held, "{}", key.name()),
        }
        compared += 1;
    }
    compared
}

#[test]
fn every_documented_default_holds() {
    let compared = [
        compare_defaults::<AmsParams>(),
        compare_defaults::<MassSpringParams>(),
        compare_defaults::<DftlParams>(),
        compare_defaults::<GridParams>(),
        compare_defaults::<SphParams>(),
        compare_defaults::<ContactParams>(),
        compare_defaults::<WindParams>(),
        compare_defaults::<GrowParams>(),
        compare_defaults::<Scene>(),
        compare_defaults::<GroomSection>(),
        compare_defaults::<BodySection>(),
        compare_defaults::<MotionSection>(),
        compare_defaults::<Keyframe>(),
        compare_defaults::<ColliderSection>(),
        compare_defaults::<SolverSection>(),
        compare_defaults::<InteractionSection>(),
        compare_defaults::<TimeSection>(),
        compare_defaults::<OutputSection>(),
        compare_defaults::<CameraSection>(),
        compare_defaults::<HairSection>(),
        compare_defaults::<Trim>(),
        compare_defaults::<Lengthen>(),
        compare_defaults::<Resample>(),
        compare_defaults::<Curl>(),
        compare_defaults::<Clump>(),
        compare_defaults::<Density>(),
        compare_defaults::<Mirror>(),
        compare_defaults::<Smooth>(),
        compare_defaults::<Selection>(),
    ];
    assert!(compared.iter().sum::<usize>() > 190, "{compared:?}");
}

#[test]
fn every_key_of_a_scene_is_in_the_reference() {
    let text = "[[collider]]\n[[teleport]]\nat_secs = 1\n[[edit]]\nop = \"trim\"\n[body.motion]\npivot = [0, 0, 0]\n";
    let scene = Scene::parse(text, Path::new("scene.toml"), &[]).unwrap();
    let mut keys = Vec::new();
    collect("", &toml::Value::try_from(&scene).unwrap(), &mut keys);
    assert!(keys.len() > 150, "{}", keys.len());
    for key in keys {
        let own = key.replace("edit.to", "edit.trim.to");
        let is_edit = key.starts_with("edit.") && !key.ends_with("op");
        let own = if is_edit { own.replace("edit.", "edit.trim.").replace("trim.trim", "trim") } else { own };
        // Set by `groom.strands` and `seed`.
        let is_inner = matches!(own.as_str(), "groom.grow.strands" | "groom.grow.seed");
        assert!(is_inner || reference::find(&own).is_some(), "`{own}`");
    }
    for entry in reference::keys() {
        // A list that is empty is one of names.
        let is_list = entry.default.starts_with('[') && entry.default != "[]";
        let is_number = entry.default.parse::<f64>().is_ok() || is_list;
        assert!(
            !(is_number || entry.unit.is_some()) || entry.range.is_some(),
            "`{}` has no range",
            entry.key
        );
    }
}

/// The dotted keys of all values in `value`, without the numbers of list entries.
fn collect(key: &str, value: &toml::Value, keys: &mut Vec<String>) {
    let join = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match value {
        toml::Value::Table(table) => table.iter().for_each(|(name, value)| collect(&join(name), value, keys)),
        toml::Value::Array(list) if list.iter().any(toml::Value::is_table) => {
            list.iter().for_each(|value| collect(key, value, keys));
        }
        _ => keys.push(key.to_owned()),
    }
}

#[test]
fn the_length_passes_have_their_names_in_scenes() {
    for table in ["solver.ams", "solver.mass_spring", "solver.xpbd"] {
        for name in ["projection", "dftl", "limit", "off"] {
            let set = Override::set(&format!("{table}.inextensibility={name}")).unwrap();
            let scene = Scene::parse("", Path::new("scene.toml"), &[set]).unwrap();
            assert!(scene.to_toml().contains(&format!("inextensibility = \"{name}\"")), "{table}: {name}");
        }
        let unknown = Override::set(&format!("{table}.inextensibility=follow-the-leader")).unwrap();
        assert!(Scene::parse("", Path::new("scene.toml"), &[unknown]).is_err());
    }
}

/// A groom of five strands on a moving body, in wind, beside a collider; an edit, a jump.
const SMALL: &str = "[groom]\nstrands = 5\nvertices_per_strand = 6\n\
    [body]\ncollide = false\n[body.motion]\nname = \"builtin:shake-and-jump\"\n\
    [wind]\nvelocity = [8, 1, 0]\ngust_strength = 0.5\nturbulence = 0.5\nshelter = 0.5\nhair_depth = 0.01\n\
    [[collider]]\nposition = [0.1, 0.1, 0]\n[[teleport]]\nat_secs = 0.02\n";

/// What else `entry` needs to count, as lines of TOML and as overrides.
fn context(key: &str) -> (String, Vec<String>) {
    let (mut text, mut sets) = (String::new(), Vec::new());
    let mut set = |over: &str| sets.push(over.to_owned());
    let names: Vec<&str> = key.split('.').collect();
    match names[..] {
        ["solver", "mass_spring", _] => set("solver.kind=mass-spring"),
        ["solver", "dftl", _] => set("solver.kind=dftl"),
        ["solver", "xpbd", name] => {
            set("solver.kind=xpbd");
            if name == "max_stretch" {
                set("solver.xpbd.inextensibility=limit");
            }
        }
        ["solver", "ams", name] => {
            set("solver.ams.non_hookean=true");
            if name.starts_with("breaking") || name.starts_with("healing") {
                set("solver.ams.elastic_limit=0");
            }
            if name == "max_stretch" {
                set("solver.ams.inextensibility=limit");
            }
        }
        ["interaction", "contact", _] => set("interaction.contacts=true"),
        ["interaction", kind, _] => set(&format!("interaction.kind={kind}")),
        ["body", "friction" | "sdf_cells" | "sdf_near_cell"] => {
            set("body.collide=true");
            set("body.sdf_cells=16");
        }
        ["body", "motion", "keyframe", _] => {
            for at in ["0", "0.01"] {
                text.push_str(&format!("[[body.motion.keyframe]]\ntime_secs = {at}\n"));
            }
        }
        ["collider", "half_length"] => set("collider.0.shape=capsule"),
        ["collider", "half_extents"] => set("collider.0.shape=box"),
        ["collider", "sdf_cells" | "sdf_near_cell"] => {
            set("collider.0.shape=comb");
            set("collider.0.sdf_cells=16");
        }
        ["collider", "scale" | "sequence_fps"] => set("collider.0.shape=mesh"),
        ["edit", "only", "box", _] => {
            text.push_str("[[edit]]\nop = \"trim\"\nonly.box = { from = [0, 0, 0], to = [1, 1, 1] }\n")
        }
        ["edit", "only" | "at_secs", ..] => text.push_str("[[edit]]\nop = \"trim\"\nto = 0.1\n"),
        ["edit", "cut", "shape", shape, _] => {
            let keys = match shape {
                "plane" => "point = [0, 0, 0], normal = [0, -1, 0]",
                "sphere" => "centre = [0, 0, 0], radius = 0.1",
                "box" => "centre = [0, 0, 0], half_extents = [0.1, 0.1, 0.1]",
                "capsule" => "from = [0, 0, 0], to = [0, 0.1, 0], radius = 0.1",
                _ => "points = [[0, 0, 0], [0, 0.1, 0]], radius = 0.1",
            };
            text.push_str(&format!("[[edit]]\nop = \"cut\"\nshape.{shape} = {{ {keys} }}\n"));
        }
        ["edit", op, _] => {
            let more = match op {
                "cut" => "shape.sphere = { centre = [0, 0, 0], radius = 0.1 }",
                "comb" => "points = [[0, 0, 0], [0, 0.1, 0]]",
                "attract" => "centre = [0, 0.1, 0]",
                _ => "",
            };
            text.push_str(&format!("[[edit]]\nop = \"{op}\"\n{more}\n"));
        }
        _ => {}
    }
    (text, sets)
}

/// The override that sets every number of `entry` to `value`.
fn assignment(entry: &Entry, value: f64) -> String {
    let names: Vec<&str> = entry.key.split('.').collect();
    let path = match names[..] {
        [list @ ("collider" | "teleport"), name] => format!("{list}.0.{name}"),
        ["body", "motion", "keyframe", name] => format!("body.motion.keyframe.1.{name}"),
        ["edit", "only", ref rest @ ..] => format!("edit.0.only.{}", rest.join(".")),
        ["edit", "cut", "shape", ref rest @ ..] => format!("edit.0.shape.{}", rest.join(".")),
        ["edit", "at_secs"] => "edit.0.at_secs".to_owned(),
        ["edit", _, name] => format!("edit.0.{name}"),
        _ => entry.key.clone(),
    };
    let whole =
        ["strands", "particles", "cells", "contacts", "rounds", "frames", "pixels", "times", "iterations"];
    let unit = entry.unit.as_deref().unwrap_or("");
    let is_whole = whole.contains(&unit) || matches!(names.last(), Some(&"seed" | &"strands"));
    let number = if is_whole { format!("{value:.0}") } else { format!("{value:?}") };
    let count = match names.last() {
        Some(&"region_box") => return format!("{path}=[[{number}, {number}, {number}], [0, 0, 0]]"),
        Some(&"points") => return format!("{path}=[[{number}, {number}, {number}], [0, 0, 0]]"),
        Some(&"strands") if path.contains("only") => 2,
        Some(&("pivot" | "look_at" | "centre" | "point" | "normal" | "from" | "to" | "half_extents"))
            if !(path.ends_with(".to") && entry.key.starts_with("edit.trim")) =>
        {
            3
        }
        _ if entry.default.starts_with('[') => 3,
        _ => return format!("{path}={number}"),
    };
    format!("{path}=[{}]", vec![number; count].join(", "))
}

/// The scene in which `entry` is `value` and counts; or why it is refused.
fn scene_with(entry: &Entry, value: f64) -> Result<Scene, String> {
    let (text, mut sets) = context(&entry.key);
    sets.push(assignment(entry, value));
    let sets: Vec<Override> = sets.iter().map(|set| Override::set(set).unwrap()).collect();
    let scene = Scene::parse(&format!("{SMALL}{text}"), Path::new("scene.toml"), &sets);
    scene.map_err(|error| error.to_string())
}

/// The last part of the key of `entry`, as messages quote it.
fn name(entry: &Entry) -> &str {
    entry.key.rsplit('.').next().unwrap()
}

#[test]
fn values_out_of_range_are_refused_by_name() {
    for entry in reference::keys() {
        let Some(range) = entry.range else { continue };
        let below = if range.low > 0.0 { 0.5 * range.low } else { range.low - 1.0 };
        for value in [below, 1.001 * range.high + 1.0] {
            if !value.is_finite() || (range.or_zero && value < 1.0 && range.low >= 1.0) {
                continue;
            }
            let Err(message) = scene_with(entry, value) else {
                panic!("`{}` = {value} is accepted", entry.key)
            };
            assert!(message.contains(name(entry)), "{} = {value}: {message}", entry.key);
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
}

/// Sizes that would take long, which this test only reads.
const LARGE: [&str; 5] =
    ["groom.strands", "groom.vertices", "body.sdf_cells", "collider.sdf_cells", "interaction.grid.max_cells"];

/// Runs three frames of the scene in which `entry` is `value`; what is wrong with the result.
fn fault(entry: &Entry, value: f64) -> Option<String> {
    let scene = match scene_with(entry, value) {
        Ok(scene) => scene,
        Err(message) if message.contains(name(entry)) => return None,
        // A mesh is needed, which this test has not.
        Err(message) if message.contains("`mesh` file") => return None,
        Err(message) => return Some(message),
    };
    let is_large = value > 1e4 && LARGE.contains(&entry.key.as_str());
    if is_large || (value >= 512.0 && entry.key.contains("sdf_cells")) {
        return None;
    }
    let mut player = match Player::builder(scene).build() {
        Ok(player) => player,
        Err(error) if [name(entry), "edit 1 ("].iter().any(|own| error.to_string().contains(own)) => {
            return None;
        }
        Err(error) => return Some(error.to_string()),
    };
    let mut positions = Vec::new();
    for _ in 0..3 {
        let reset = match player.step() {
            Ok(report) => report.solver.quarantined_strands,
            Err(error) => return Some(error.to_string()).filter(|message| !message.contains(name(entry))),
        };
        if reset > 0 {
            return Some(format!("{reset} strands were not finite and were reset"));
        }
        player.positions(&mut positions).unwrap();
    }
    let is_usable = |p: &Vec3| p.is_finite() && p.abs().max_element() < 1e9;
    (!positions.iter().all(is_usable)).then(|| format!("{:?}", positions.iter().find(|p| !is_usable(p))))
}

#[test]
fn the_ends_of_every_range_keep_positions_finite() {
    let mut faults = Vec::new();
    let mut tried = 0;
    for entry in reference::keys() {
        let Some(range) = entry.range else { continue };
        let high = if range.high.is_finite() { range.high } else { i64::MAX as f64 / 2.0 };
        for value in [range.low, high].into_iter().chain(range.or_zero.then_some(0.0)) {
            tried += 1;
            faults.extend(fault(entry, value).map(|fault| format!("{} = {value:?}: {fault}", entry.key)));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(tried > 320, "{tried}");
}

/// Checks that parameters of the library are held to their ranges without a scene too.
fn refuses<D: Documented + Serialize + DeserializeOwned>(validate: impl Fn(&D) -> Result<(), ParamsError>) {
    let mut checked = 0;
    for key in D::KEYS {
        let Some(range) = Key::range(key).filter(|range| range.high.is_finite()) else { continue };
        let value = if range.high > 4e9 { range.low - 1.0 } else { range.high + 1.0 };
        let value = if key.default_words().is_some_and(|words| words.starts_with('[')) {
            format!("[0.0, {value:?}, 0.0]")
        } else {
            format!("{value:?}")
        };
        let text = |value: &str| toml::from_str::<D>(&format!("{} = {value}", key.name()));
        let params = text(&value).or_else(|_| text(value.trim_end_matches(".0"))).unwrap();
        let error = validate(&params).unwrap_err();
        assert!(matches!(error, ParamsError::Range { name, .. } if name == key.name()), "{error}");
        checked += 1;
    }
    assert!(checked > 3, "{checked}");
}

#[test]
fn the_library_holds_parameters_to_their_ranges() {
    refuses(AmsParams::validate);
    refuses(MassSpringParams::validate);
    refuses(DftlParams::validate);
    refuses(GridParams::validate);
    refuses(SphParams::validate);
    refuses(ContactParams::validate);
    refuses(WindParams::validate);
}
