//! The reference of scene files: every key with its unit, default, range and meaning.
//!
//! All of it comes from the structs that scenes are read into: meaning, unit and range from the
//! documentation of their fields, which checks use too, and defaults from their `Default`.

use std::fmt::Write;
use std::sync::LazyLock;

use forelock_core::air::WindParams;
use forelock_core::groom::edit::{
    Ball, Capsule, Clump, Comb, Cuboid, Curl, Cut, Density, HalfSpace, Lengthen, Mirror, Pull, Resample,
    Selection, Smooth, Straighten, Stroke, Trim, TurnedBox,
};
use forelock_core::groom::grow::GrowParams;
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::interaction::sph::SphParams;
use forelock_core::params::{Documented, Key, Range, in_few_letters};
use serde::Serialize;

use super::edits::EditSection;
use super::error::nearest;
use super::hair::HairSection;
use super::{
    BodySection, CameraSection, ClipSection, ColliderSection, GroomSection, InteractionSection, Keyframe,
    MotionSection, OutputSection, Scene, SolverSection, TeleportSection, TimeSection, solver,
};

/// One key of a scene file.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Dotted key, without the numbers of list entries: `collider.radius`.
    pub key: String,
    /// The unit, if it has one.
    pub unit: Option<String>,
    /// The default, as in a file or in words.
    pub default: String,
    /// The range of its numbers, if it has any.
    pub range: Option<Range>,
    /// What it means, and what special values mean.
    pub meaning: String,
}

/// The keys of one table of a scene file.
pub(crate) struct Section {
    pub(crate) table: &'static str,
    /// Heading of the page; it starts with `#`.
    title: &'static str,
    /// What is to be known about the table as a whole.
    note: &'static str,
    pub(crate) entries: Vec<Entry>,
}

const PAGE: &str = "# Scene reference\n\n\
    Every key of a scene file with its unit, default and range. All lengths are metres, times seconds, y\n\
    points up. Unknown keys and values out of range are refused with the line. [Scenes](scenes.md)\n\
    explains how the tables work together. `forelock help scene KEY` prints a key or a table of this\n\
    page. Every run writes its scene with all keys spelt out, as `scene.toml`.\n\n\
    The program writes this page: `forelock help scene --markdown`.\n";

const GROW_NOTE: &str = "The default is the preset's value; the table shows the default without a preset. \
    \"Box\" is the bounding box of the roots.";
const MOTION_NOTE: &str = "Write a name, `motion = \"builtin:turn\"`, or a table with these keys. A collider \
    has the same keys in `[collider.motion]`.";
const EDIT_NOTE: &str = "`[edit.only]` selects strands. [Grooming](grooming.md) has examples.";
const SHAPE_NOTE: &str = "`[edit.only]` has `plane` and `sphere` too.";

/// All sections, in the order of the page.
static SECTIONS: LazyLock<Vec<Section>> = LazyLock::new(|| {
    let mut grow = with::<GrowParams>("groom.grow", "## `[groom.grow]`: growth parameters", GROW_NOTE);
    grow.entries.retain(|entry| !matches!(entry.key.as_str(), "groom.grow.strands" | "groom.grow.seed"));
    let mut edit = without::<EditSection>("edit", "## `[[edit]]`: groom edits", EDIT_NOTE);
    let operation = Key { field: "op", lines: &["The operation, one of the tables below. No default."] };
    edit.entries.splice(0..0, entries("edit", &[operation], &toml::Table::new()));
    let mut sections = vec![
        with::<Scene>("", "## Top level", ""),
        with::<GroomSection>("groom", "## `[groom]`: the strands", ""),
        grow,
        with::<BodySection>("body", "## `[body]`: what the hair grows on", ""),
        with::<MotionSection>("body.motion", "## `[body.motion]`: how a body or collider moves", MOTION_NOTE),
        with::<ClipSection>("body.motion.clip", "### `[body.motion.clip]`", ""),
        with::<Keyframe>("body.motion.keyframe", "### `[[body.motion.keyframe]]`", ""),
        without::<TeleportSection>("teleport", "## `[[teleport]]`: jumps of the body", ""),
        with::<ColliderSection>("collider", "## `[[collider]]`: further solids", ""),
        with::<WindParams>("wind", "## `[wind]`: moving air", ""),
        with::<SolverSection>("solver", "## `[solver]`", ""),
        with::<InteractionSection>("interaction", "## `[interaction]`: hair–hair interaction", ""),
        with::<GridParams>("interaction.grid", "## `[interaction.grid]`", ""),
        with::<SphParams>("interaction.sph", "## `[interaction.sph]`", ""),
        with::<ContactParams>("interaction.contact", "## `[interaction.contact]`", ""),
        with::<TimeSection>("time", "## `[time]`", ""),
        with::<OutputSection>("output", "## `[output]`: what is written", ""),
        with::<CameraSection>("camera", "## `[camera]`: from where pictures are taken", ""),
        with::<HairSection>("hair", "## `[hair]`: how hair looks in pictures", ""),
        edit,
        with::<Trim>("edit.trim", "### `trim`: shortens strands by length", ""),
        without::<Cut>("edit.cut", "### `cut`: ends strands where they first enter a shape", ""),
        with::<Lengthen>("edit.lengthen", "### `lengthen`: extends strands and continues their curl", ""),
        with::<Resample>("edit.resample", "### `resample`: changes the number of particles", ""),
        without::<Comb>("edit.comb", "### `comb`: turns hair along a stroke", ""),
        without::<Pull>(
            "edit.attract",
            "### `attract` and `repel`: move hair to a point or away from it",
            "",
        ),
        with::<Curl>("edit.curl", "### `curl`: winds hair up", ""),
        with::<Straighten>("edit.straighten", "### `straighten`: removes curl", ""),
        with::<Clump>("edit.clump", "### `clump`: gathers strands into locks", ""),
        with::<Density>("edit.density", "### `density`: removes or adds strands", ""),
        with::<Mirror>("edit.mirror", "### `mirror`: mirrors strands at a plane", ""),
        with::<Smooth>(
            "edit.smooth",
            "### `smooth`: averages edges along strands and between neighbours",
            "",
        ),
        without::<HalfSpace>("edit.cut.shape.plane", "### `shape.plane` of `cut`", SHAPE_NOTE),
        without::<Ball>("edit.cut.shape.sphere", "### `shape.sphere` of `cut`", ""),
        without::<TurnedBox>("edit.cut.shape.box", "### `shape.box` of `cut`", ""),
        without::<Capsule>("edit.cut.shape.capsule", "### `shape.capsule` of `cut`", ""),
        without::<Stroke>("edit.cut.shape.stroke", "### `shape.stroke` of `cut`", ""),
        with::<Selection>("edit.only", "### `[edit.only]`: selection", "All conditions must hold."),
        without::<Cuboid>("edit.only.box", "### `box` of `[edit.only]`", ""),
    ];
    let place = sections.iter().position(|section| section.table == "interaction").unwrap_or(0);
    sections.splice(place..place, solver::sections());
    sections
});

/// The section of the keys of `D`, with the defaults of `D`.
pub(crate) fn with<D: Documented + Default + Serialize>(
    table: &'static str,
    title: &'static str,
    note: &'static str,
) -> Section {
    let defaults = toml::Table::try_from(D::default()).unwrap_or_default();
    Section { table, title, note, entries: entries(table, D::KEYS, &defaults) }
}

/// The section of the keys of `D`, some of which have no default.
fn without<D: Documented>(table: &'static str, title: &'static str, note: &'static str) -> Section {
    Section { table, title, note, entries: entries(table, D::KEYS, &toml::Table::new()) }
}

/// The entries of `keys`, but for tables, which have sections of their own.
fn entries(table: &str, keys: &[Key], defaults: &toml::Table) -> Vec<Entry> {
    let entry = |key: &Key| {
        let words = key.default_words()?;
        let default = match defaults.get(key.name()) {
            None | Some(toml::Value::Table(_)) => words,
            Some(toml::Value::String(text)) if text.is_empty() => words,
            Some(toml::Value::Array(list)) if list.is_empty() => words,
            Some(value) => shown(value),
        };
        Some(Entry {
            key: if table.is_empty() { key.name().to_owned() } else { format!("{table}.{}", key.name()) },
            unit: key.unit(),
            default,
            range: key.range(),
            meaning: key.meaning(),
        })
    };
    keys.iter().filter_map(entry).collect()
}

/// `value` as in a file, in few letters.
fn shown(value: &toml::Value) -> String {
    match value {
        toml::Value::Float(number) => in_few_letters(*number, 1e5),
        toml::Value::Array(list) => format!("[{}]", list.iter().map(shown).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

/// Every key of a scene file.
pub fn keys() -> impl Iterator<Item = &'static Entry> {
    SECTIONS.iter().flat_map(|section| &section.entries)
}

/// The entry of `key`, which may contain the numbers of list entries.
pub fn find(key: &str) -> Option<&'static Entry> {
    let key = canonical(key);
    keys().find(|entry| entry.key == key)
}

/// `key` without numbers, and under the table that describes it.
fn canonical(key: &str) -> String {
    let names: Vec<&str> = key.split('.').filter(|name| name.parse::<u32>().is_err()).collect();
    let key = names.join(".");
    let same = [
        ("collider.motion", "body.motion"),
        ("edit.repel", "edit.attract"),
        ("edit.only.sphere.", "edit.cut.shape.sphere."),
        ("edit.only.plane.", "edit.cut.shape.plane."),
    ];
    match same.iter().find_map(|(other, table)| Some((table, key.strip_prefix(other)?))) {
        Some((table, rest)) => format!("{table}{rest}"),
        None => key,
    }
}

/// The whole reference as a page in Markdown.
pub fn markdown() -> String {
    tables(PAGE, &SECTIONS)
}

/// A page in Markdown that begins with `start`, and has a table of keys for each of `sections`.
pub(crate) fn tables(start: &str, sections: &[Section]) -> String {
    let mut page = start.to_owned();
    for Section { title, note, entries, .. } in sections {
        let _ = write!(page, "\n{title}\n\n");
        if !note.is_empty() {
            let _ = write!(page, "{}\n\n", wrapped(note, "", 100));
        }
        page.push_str("| key | unit | default | range | meaning |\n| --- | --- | --- | --- | --- |\n");
        for entry in entries {
            let Entry { key, default, meaning, .. } = entry;
            let name = key.rsplit('.').next().unwrap_or(key);
            let is_code = default.parse::<f64>().is_ok()
                || default.starts_with(['[', '"'])
                || matches!(default.as_str(), "true" | "false");
            let default = if is_code { format!("`{default}`") } else { default.clone() };
            // A bar would end the cell, in code too.
            let [default, meaning] = [&default, meaning].map(|text| text.replace('|', "\\|"));
            let (unit, range) = (entry.unit.as_deref().unwrap_or("–"), range_words(entry));
            let range = if range.is_empty() { "–" } else { &range };
            let _ = writeln!(page, "| `{name}` | {unit} | {default} | {range} | {meaning} |");
        }
    }
    page
}

fn range_words(entry: &Entry) -> String {
    entry.range.map_or_else(String::new, |range| range.to_string().trim_start_matches("from ").to_owned())
}

/// The reference of `key` for a terminal: of one key, of a table and the tables in it, or, with an
/// empty `key`, of everything. The last part of a key is enough.
///
/// # Errors
/// A sentence that names the nearest key if there is no such key.
pub fn help(key: &str) -> Result<String, String> {
    let wanted = canonical(key);
    let is_in =
        |name: &str| name.strip_prefix(&wanted).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'));
    let text = listed(SECTIONS.iter().filter(|section| wanted.is_empty() || is_in(section.table)));
    if !text.is_empty() {
        return Ok(text);
    }
    let last = |entry: &Entry| entry.key.rsplit('.').next() == Some(wanted.as_str());
    let found: String = keys().filter(|entry| entry.key == wanted || last(entry)).map(described).collect();
    if !found.is_empty() {
        return Ok(found);
    }
    let known = keys().flat_map(|entry| [Some(entry.key.as_str()), entry.key.rsplit('.').next()]).flatten();
    let known = known.chain(SECTIONS.iter().map(|section| section.table));
    let near = nearest(&wanted, known).map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
    Err(format!("there is no key `{key}`{near}"))
}

/// All keys of `sections` for a terminal.
pub(crate) fn listed<'a>(sections: impl Iterator<Item = &'a Section>) -> String {
    let mut text = String::new();
    for Section { title, note, entries, .. } in sections {
        let title = title.trim_start_matches(['#', ' ']).replace('`', "");
        let _ = writeln!(text, "{}{title}\n", if text.is_empty() { "" } else { "\n" });
        if !note.is_empty() {
            let _ = writeln!(text, "{}\n", wrapped(note, "", 100));
        }
        entries.iter().for_each(|entry| text.push_str(&described(entry)));
    }
    text
}

/// One key for a terminal.
fn described(entry: &Entry) -> String {
    let mut facts = vec![format!("default {}", entry.default)];
    facts.extend(entry.unit.as_ref().map(|unit| format!("unit {unit}")));
    facts.extend(entry.range.map(|_| format!("range {}", range_words(entry))));
    format!("{}\n{}\n    {}\n", entry.key, wrapped(&entry.meaning, "    ", 100), facts.join("; "))
}

/// `text` in lines of at most `width` characters, each after `indent`.
fn wrapped(text: &str, indent: &str, width: usize) -> String {
    let mut lines = vec![indent.to_owned()];
    for word in text.split_whitespace() {
        let line = lines.last().map_or("", String::as_str);
        let is_first = line.len() == indent.len();
        if !is_first && line.chars().count() + 1 + word.chars().count() > width {
            lines.push(indent.to_owned());
        }
        if let Some(line) = lines.last_mut() {
            if line.len() > indent.len() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines.join("\n")
}
