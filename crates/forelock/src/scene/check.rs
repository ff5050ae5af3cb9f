//! Checks the values of a scene.
//!
//! An error names the dotted key and states which values are allowed. Ranges come from the
//! documentation of the fields.

use std::path::Path;

use forelock_core::body::{KeyframeInterpolation, Motion};
use forelock_core::groom::Import;
use forelock_core::params::FLOAT32_STIFFNESS_LIMIT;
use forelock_core::params::{ParamsError, Short};
use forelock_core::solver::StepCheck;

use forelock_io::{Format, animation};
use forelock_render::HairColour;

use super::document::Document;
use super::error::{SceneError, one_of};
use super::hair::CLAY;
use super::sections::{ColliderSection, GroomSource, ShapeKind};
use super::{ClipSection, Keyframe, MotionSection, Scene, SolverSection, TimeSection, reference};
use crate::{neural, sinks};

/// The bodies that have names.
const BODIES: [&str; 5] = ["builtin:head", "builtin:horse", "builtin:talker", "builtin:walker", "none"];

/// The key of a wrong value, and the error message.
type Wrong = (String, String);

/// Checks every value of `scene`. `document` tells which of the keys the scene file sets.
pub(super) fn check(scene: &Scene, document: &Document<'_>) -> Result<(), Wrong> {
    check_ranges(scene)?;
    check_model(scene)?;
    check_groom(scene)?;
    check_body_motion(scene)?;
    if scene.body.is_named() && !BODIES.contains(&scene.body.mesh.as_str()) {
        return Err(("body.mesh".to_owned(), one_of(&scene.body.mesh, &[&BODIES[..], &["a path"]].concat())));
    }
    check_import("body", &scene.body.import(), !scene.body.is_named(), "`body.mesh` is built in")?;
    let is_read = scene.groom.source != GroomSource::Grow;
    check_import("groom", &scene.groom.import(), is_read, "`groom.source` is \"grow\"")?;
    if !HairColour::NAMES.contains(&scene.hair.colour.as_str()) {
        return Err(("hair.colour".to_owned(), one_of(&scene.hair.colour, &HairColour::NAMES)));
    }
    let bodies = [&[CLAY][..], &HairColour::NAMES].concat();
    if !bodies.contains(&scene.hair.body_colour.as_str()) {
        return Err(("hair.body_colour".to_owned(), one_of(&scene.hair.body_colour, &bodies)));
    }
    for (index, collider) in scene.colliders.iter().enumerate() {
        check_collider(&format!("collider.{index}"), collider)?;
    }
    check_output(scene)?;
    check_growth(document)?;
    check_timed_edits(scene)?;
    for key in SolverSection::SUBSTEP {
        if scene.time.substep_secs.is_some() && document.sets(key) {
            let message = format!("is set, and so is `{key}`, which means the same: remove one of the two");
            return Err(("time.substep_secs".to_owned(), message));
        }
    }
    check_solver(scene)
}

/// Refuses the keys for a number of substeps a frame, and says what to write instead.
pub(super) fn refuse_former_keys(document: &Document<'_>) -> Result<(), SceneError> {
    let Some(key) = SolverSection::FORMER.into_iter().find(|key| document.sets(key)) else {
        return Ok(());
    };
    let fps = document.number_at("time.fps").unwrap_or(TimeSection::default().fps);
    let instead = key.replace("substeps", "substep_secs");
    let value = match document.number_at(key) {
        Some(substeps) if substeps > 0.0 && fps > 0.0 => {
            format!("{instead} = {:.6} (1/({fps} × {substeps}))", 1.0 / (fps * substeps))
        }
        _ => format!("{instead} = 1/(frames a second × substeps)"),
    };
    let message = format!(
        "is no longer a key: the length of a substep is, and frames take what they need; write {value}"
    );
    Err(document.refuse(key, message))
}

/// Checks that every number of the scene is finite and in the range that its documentation states.
fn check_ranges(scene: &Scene) -> Result<(), Wrong> {
    let value = toml::Value::try_from(scene)
        .map_err(|error| (String::new(), format!("holds a value that TOML cannot express: {error}")))?;
    check_range("", "", &value)
}

/// Checks `value` at `key`, whose entry of the reference is `entry`.
fn check_range(key: &str, entry: &str, value: &toml::Value) -> Result<(), Wrong> {
    let number = match value {
        toml::Value::Float(number) => *number,
        toml::Value::Integer(number) => *number as f64,
        toml::Value::Table(table) => {
            // The keys of an edit depend on its operation.
            let operation = table.get("op").and_then(toml::Value::as_str);
            return table.iter().try_for_each(|(name, value)| {
                let join = |parent: &str| {
                    if parent.is_empty() { name.clone() } else { format!("{parent}.{name}") }
                };
                let entry = match operation {
                    Some(op) if !matches!(name.as_str(), "only" | "at_secs") => {
                        join(&format!("{entry}.{op}"))
                    }
                    _ => join(entry),
                };
                check_range(&join(key), &entry, value)
            });
        }
        // The key is that of the list, not of its entry: users think of a vector as one value.
        toml::Value::Array(list) => {
            return list.iter().enumerate().try_for_each(|(index, value)| {
                let place = if value.is_table() { format!("{key}.{index}") } else { key.to_owned() };
                check_range(&place, entry, value)
            });
        }
        _ => return Ok(()),
    };
    if !number.is_finite() {
        return Err((key.to_owned(), format!("should be a finite number, not {number}")));
    }
    match reference::find(entry).and_then(|entry| entry.range) {
        Some(range) if !range.contains(number) => {
            Err((key.to_owned(), format!("should be {range}, not {}", Short(number))))
        }
        _ => Ok(()),
    }
}

/// Checks that the model of a learned solver may exist.
fn check_model(scene: &Scene) -> Result<(), Wrong> {
    let section = &scene.solver.neural;
    if !scene.solver.is_learned() {
        return Ok(());
    }
    let known: Vec<&str> = neural::builtin_names().chain(["a path"]).collect();
    let is_known = neural::builtin_names().any(|name| name == section.model);
    if section.model.is_empty() || (section.is_builtin() && !is_known) {
        return Err(("solver.neural.model".to_owned(), one_of(&section.model, &known)));
    }
    Ok(())
}

/// Checks that the keys of the groom agree with each other.
fn check_groom(scene: &Scene) -> Result<(), Wrong> {
    let (groom, body) = (&scene.groom, &scene.body);
    if groom.vertices != 0 && groom.vertices_per_strand != 0 {
        let message = "is set, and so is `groom.vertices_per_strand`: remove one of the two".to_owned();
        return Err(("groom.vertices".to_owned(), message));
    }
    match &groom.source {
        GroomSource::Files(files) if files.is_empty() => {
            Err(("groom.source".to_owned(), "is an empty list: name a file, or use \"grow\"".to_owned()))
        }
        GroomSource::Grow if body.mesh == "none" => {
            let message = "is \"grow\", but `body.mesh` is \"none\": hair needs a body to grow on".to_owned();
            Err(("groom.source".to_owned(), message))
        }
        _ => Ok(()),
    }
}

/// Checks that unit, axis and scale of files are set only where a file `is_read`.
fn check_import(table: &str, import: &Import, is_read: bool, instead: &str) -> Result<(), Wrong> {
    let usual = Import::default();
    let set = [
        ("unit", import.unit != usual.unit),
        ("up", import.up != usual.up),
        ("scale", import.scale != usual.scale),
    ];
    match set.into_iter().find(|(_, set)| *set && !is_read) {
        Some((name, _)) => {
            let message = format!("is for files, but {instead}: remove it, or name a file");
            Err((format!("{table}.{name}"), message))
        }
        None => Ok(()),
    }
}

/// Checks the body's motion, which may be a clip or a file if it is a character.
fn check_body_motion(scene: &Scene) -> Result<(), Wrong> {
    let (body, motion) = (&scene.body, &scene.body.motion);
    let is_clip = motion.builtin_name().is_none() && motion.keyframes.is_empty();
    if !is_clip || !body.is_character() {
        if is_clip && motion.is_file() {
            let message =
                "is a .bvh file, which moves characters: `body.mesh` should be a .glb or .gltf file";
            return Err(("body.motion".to_owned(), message.to_owned()));
        }
        return check_motion("body.motion", motion);
    }
    let usual = MotionSection::named(&motion.name);
    let set = [
        ("amplitude", motion.amplitude != usual.amplitude),
        ("frequency_hz", motion.frequency_hz.is_some()),
        ("rest_after_secs", motion.rest_after_secs != usual.rest_after_secs),
        ("pivot", motion.pivot.is_some()),
        ("interpolation", motion.interpolation != usual.interpolation),
    ];
    if let Some((name, _)) = set.into_iter().find(|(_, is_set)| *is_set) {
        let message = "is for builtin motions and keyframes, but the body plays a clip or a .bvh file: remove \
                       it, or set it to its default; see `body.motion.clip`";
        return Err((format!("body.motion.{name}"), message.to_owned()));
    }
    if scene.groom.guides > 0 {
        let message = "should be 0: guides do not follow a body that bends yet".to_owned();
        return Err(("groom.guides".to_owned(), message));
    }
    Ok(())
}

fn check_motion(key: &str, motion: &MotionSection) -> Result<(), Wrong> {
    if motion.clip != ClipSection::default() {
        let message = "is for a body that plays a clip or a .bvh file: remove it".to_owned();
        return Err((format!("{key}.clip"), message));
    }
    if motion.builtin_name().is_none_or(|name| !Motion::NAMES.contains(&name)) {
        let known = Motion::NAMES.map(|name| format!("builtin:{name}"));
        return Err((key.to_owned(), one_of(&motion.name, &known.each_ref().map(String::as_str))));
    }
    let frames = &motion.keyframes;
    if frames.first().is_some_and(|first| first.time_secs != 0.0) {
        return Err((
            format!("{key}.keyframe.0.time_secs"),
            "should be 0: the first keyframe is the start".to_owned(),
        ));
    }
    if frames.first().is_some_and(|first| first.jump) {
        let message = "should be false: nothing comes before the first keyframe".to_owned();
        return Err((format!("{key}.keyframe.0.jump"), message));
    }
    let follows = |before: &Keyframe, next: &Keyframe| {
        let held = before.interpolation.unwrap_or(motion.interpolation) == KeyframeInterpolation::Hold;
        next.time_secs > before.time_secs || ((next.jump || held) && next.time_secs == before.time_secs)
    };
    match frames.windows(2).position(|pair| !follows(&pair[0], &pair[1])) {
        None => Ok(()),
        Some(index) => {
            let message = "should be later than the time of the keyframe before it".to_owned();
            Err((format!("{key}.keyframe.{}.time_secs", index + 1), message))
        }
    }
}

fn check_collider(key: &str, collider: &ColliderSection) -> Result<(), Wrong> {
    let shape = collider.shape;
    for (name, set, fits) in [
        ("radius", collider.radius.is_some(), shape.is_round()),
        ("half_length", collider.half_length.is_some(), shape == ShapeKind::Capsule),
        ("half_extents", collider.half_extents.is_some(), shape == ShapeKind::Box),
        ("mesh", collider.mesh.is_some(), shape == ShapeKind::Mesh),
        ("mesh_sequence", !collider.mesh_sequence.is_empty(), shape == ShapeKind::Mesh),
        ("sequence_fps", collider.sequence_fps.is_some(), !collider.mesh_sequence.is_empty()),
        ("sdf_cells", collider.sdf_cells.is_some(), shape.has_grid()),
        ("sdf_near_cell", collider.sdf_near_cell.is_some(), shape.has_grid()),
    ] {
        if set && !fits {
            let message = format!("does not apply to this `shape` ({}): remove one of the two", shape.name());
            return Err((format!("{key}.{name}"), message));
        }
    }
    let no_mesh = format!("this `shape` ({}) is not read from one", shape.name());
    check_import(key, &collider.import(), shape == ShapeKind::Mesh, &no_mesh)?;
    if collider.mesh.is_some() && !collider.mesh_sequence.is_empty() {
        let message =
            "is set, and so is `mesh`, which does not change over time: remove one of the two".to_owned();
        return Err((format!("{key}.mesh_sequence"), message));
    }
    if shape == ShapeKind::Mesh && collider.mesh.is_none() && collider.mesh_sequence.is_empty() {
        return Err((
            format!("{key}.shape"),
            "is \"mesh\", but there is no `mesh` file: name one".to_owned(),
        ));
    }
    let from = collider.from_secs.unwrap_or(0.0);
    if collider.until_secs.is_some_and(|until| until <= from) {
        let message = format!("should be later than `from_secs`, {from}");
        return Err((format!("{key}.until_secs"), message));
    }
    check_motion(&format!("{key}.motion"), &collider.motion)
}

/// Checks the edits that are made while the hair moves. They must not add particles, because all
/// frames of the cache have the same layout, and not every solver can continue with an edited
/// groom.
fn check_timed_edits(scene: &Scene) -> Result<(), Wrong> {
    for (number, _) in scene.edits.timed() {
        let wrong = |message: String| Err((format!("edit.{number}.at_secs"), message));
        let name = scene.edits.0[number].edit.operation.name();
        if matches!(name, "lengthen" | "resample" | "density" | "mirror") {
            return wrong(format!(
                "cannot be used with op = \"{name}\": no particles can be added while the hair moves"
            ));
        }
        if scene.groom.guides > 0 {
            return wrong("cannot be used with `groom.guides`: remove one of the two".to_owned());
        }
        if let Some(key) = scene.solver.refining_key() {
            return wrong(format!("needs `{key}` = false"));
        }
    }
    Ok(())
}

/// Checks that no growth parameter is set by two keys.
fn check_growth(document: &Document<'_>) -> Result<(), Wrong> {
    for (key, same) in [("groom.grow.strands", "groom.strands"), ("groom.grow.seed", "seed")] {
        if document.sets(key) {
            return Err((key.to_owned(), format!("is not a key of a scene: set `{same}` instead")));
        }
    }
    Ok(())
}

fn check_output(scene: &Scene) -> Result<(), Wrong> {
    let output = &scene.output;
    if !Format::of(&output.groom).is_some_and(Format::is_written) {
        let written = Format::ALL.into_iter().filter(|format| format.is_written());
        let written: Vec<String> =
            written.flat_map(Format::endings).map(|ending| format!(".{ending}")).collect();
        let message = format!("should end in one of {}", written.join(", "));
        return Err(("output.groom".to_owned(), message));
    }
    let is_export = |name: &Path| animation::is_written(name) && Format::of(name) != Some(Format::Npz);
    if let Some(name) = output.exports.iter().find(|name| !is_export(name)) {
        let message =
            format!("holds \"{}\", but takes names that end in .abc, .usdc, .usd or .glb", name.display());
        return Err(("output.exports".to_owned(), message));
    }
    if !output.exports.is_empty() && output.cache.as_os_str().is_empty() {
        let message = "needs `output.cache`, which is empty: exports are made from the cache";
        return Err(("output.exports".to_owned(), message.to_owned()));
    }
    let key = || "output.cache".to_owned();
    if output.cache.as_os_str().is_empty() {
        return match (output.film, output.contact_sheet) {
            (false, false) => Ok(()),
            _ => Err((key(), "is empty, but the film and the contact sheet are made from it".to_owned())),
        };
    }
    match output.cache.extension().and_then(|ending| ending.to_str()) {
        Some(ending) if sinks::CACHE_ENDINGS.contains(&ending) => Ok(()),
        ending => {
            let ending = ending.map_or("has no ending".to_owned(), |e| format!("ends in .{e}"));
            let known = sinks::CACHE_ENDINGS.map(|ending| format!(".{ending}")).join(", ");
            Err((key(), format!("{ending}: this version writes {known}")))
        }
    }
}

/// Checks the parameters of the solvers and of the hair–hair interactions. Errors name the keys of
/// the scene.
fn check_solver(scene: &Scene) -> Result<(), Wrong> {
    let mut solver = scene.solver.clone();
    if let Some(secs) = scene.time.substep_secs {
        solver.set_substep_secs(secs);
    }
    scene.interaction.grid.validate().map_err(|error| params_error("interaction.grid", &error))?;
    scene.interaction.sph.validate().map_err(|error| params_error("interaction.sph", &error))?;
    let contact = scene.interaction.contact.validate();
    contact.map_err(|error| params_error("interaction.contact", &error))?;
    for own in solver.built_in() {
        own.solver.validate().map_err(|error| params_error(own.table, &error))?;
    }
    let Some(chosen) = solver.chosen() else { return Ok(()) };
    // The masses are known once the groom is: the player checks the step again.
    let (dt_secs, beyond_float32) = (chosen.solver.rate().secs(1.0 / scene.time.fps), solver.beyond_float32);
    let checked = chosen.solver.validate_step(&StepCheck { dt_secs, least_mass: 1.0, beyond_float32 });
    checked.map_err(|error| params_error(chosen.table, &error))
}

fn params_error(table: &str, error: &ParamsError) -> Wrong {
    match error {
        ParamsError::Range { name, value, expected } => {
            (format!("{table}.{name}"), format!("should be {expected}, not {value}"))
        }
        ParamsError::Count { name, found, expected, of } => {
            (format!("{table}.{name}"), format!("has {found} entries, but there are {expected} {of}"))
        }
        ParamsError::TooStiff { name, value, substeps, dt_secs, product, needed_secs, allowed } => {
            let shorten = needed_secs.map(|secs| format!("lower time.substep_secs to {secs:e}, or "));
            let shorten = shorten.unwrap_or_default();
            let message = format!(
                "= {value:e} with {substeps} substeps in {dt_secs:.4} s makes h²κ = {product:.3e}, but \
                 float32 is reliable only up to {FLOAT32_STIFFNESS_LIMIT:e}: {shorten}lower it to {allowed:.3e}"
            );
            (format!("{table}.{name}"), message)
        }
    }
}
