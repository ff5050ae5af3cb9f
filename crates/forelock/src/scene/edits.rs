//! `[[edit]]`: what is done to the groom, before it is simulated or while it is.
//!
//! # Practice
//! An edit's table names its operation, `op = "comb"`, and holds that operation's parameters beside
//! it; `[edit.only]` picks the strands. `at_secs` puts it off until the hair moves. Which keys
//! there are depends on `op`, so each table is read twice: for its `op`, and then for what that
//! takes. Messages name line and key as everywhere in a scene.

use forelock_core::groom::edit::{Edit, EditError, Operation, Selection};
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::document::Document;
use super::error::{SceneError, one_of};

/// The edits of a scene, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EditSections(pub Vec<EditSection>);

forelock_core::documented! {
/// `[[edit]]`: one edit.
#[derive(Clone, Debug, PartialEq)]
pub struct EditSection {
    /// What is done, and to which strands.
    pub edit: Edit,
    /// When, while the hair moves. Unit s, default none, range 0 to 1e6; without it the edit is
    /// done before the first frame.
    pub at_secs: Option<f64>,
}
}

impl EditSections {
    /// The edits that are done before the first frame, with their numbers from 0.
    pub fn before(&self) -> impl Iterator<Item = (usize, &Edit)> {
        self.0.iter().enumerate().filter(|(_, section)| section.at_secs.is_none()).map(|(n, s)| (n, &s.edit))
    }

    /// The edits that are done while the hair moves: their numbers from 0, and when, seconds; in
    /// order of time.
    pub fn timed(&self) -> Vec<(usize, f64)> {
        let timed =
            self.0.iter().enumerate().filter_map(|(number, section)| Some((number, section.at_secs?)));
        let mut timed: Vec<(usize, f64)> = timed.collect();
        timed.sort_by(|a, b| a.1.total_cmp(&b.1));
        timed
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// A scene's other keys are read first; these wait for `read`.
impl<'de> Deserialize<'de> for EditSections {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        IgnoredAny::deserialize(deserializer).map(|_| Self::default())
    }
}

impl Serialize for EditSections {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let tables: Result<Vec<toml::Table>, _> = self.0.iter().map(table).collect();
        tables.map_err(serde::ser::Error::custom)?.serialize(serializer)
    }
}

/// The keys of an edit.
fn table(section: &EditSection) -> Result<toml::Table, toml::ser::Error> {
    let edit = &section.edit;
    let mut table = match &edit.operation {
        Operation::Trim(op) => toml::Table::try_from(op),
        Operation::Cut(op) => toml::Table::try_from(op),
        Operation::Lengthen(op) => toml::Table::try_from(op),
        Operation::Resample(op) => toml::Table::try_from(op),
        Operation::Comb(op) => toml::Table::try_from(op),
        Operation::Attract(op) | Operation::Repel(op) => toml::Table::try_from(op),
        Operation::Curl(op) => toml::Table::try_from(op),
        Operation::Straighten(op) => toml::Table::try_from(op),
        Operation::Clump(op) => toml::Table::try_from(op),
        Operation::Density(op) => toml::Table::try_from(op),
        Operation::Mirror(op) => toml::Table::try_from(op),
        Operation::Smooth(op) => toml::Table::try_from(op),
    }?;
    table.insert("op".to_owned(), edit.operation.name().into());
    if edit.only != Selection::default() {
        table.insert("only".to_owned(), toml::Value::try_from(&edit.only)?);
    }
    table.iter_mut().for_each(|(_, value)| super::shorten(value));
    table.extend(section.at_secs.map(|secs| ("at_secs".to_owned(), secs.into())));
    Ok(table)
}

/// The edits of `document`, checked.
pub(super) fn read(document: &Document<'_>) -> Result<EditSections, SceneError> {
    let Some(entries) = document.list("edit") else { return Ok(EditSections::default()) };
    let wrong = |key: &str, message: &str| document.refuse(key, message.to_owned());
    let DeValue::Array(entries) = entries else {
        return Err(wrong("edit", "should be a list of tables: write [[edit]]"));
    };
    let edits = entries.iter().enumerate().map(|(index, entry)| {
        let key = format!("edit.{index}");
        let DeValue::Table(table) = entry.get_ref() else {
            return Err(wrong(&key, "should be a table of keys"));
        };
        let section = read_edit(document, &key, table, entry.span())?;
        let refuse = |error: EditError| match error {
            EditError::Parameter { name, value, expected } => {
                document.refuse(&format!("{key}.{name}"), format!("should be {expected}, not {value}"))
            }
            other => document.refuse(&key, other.to_string()),
        };
        section.edit.validate().map_err(refuse)?;
        Ok(section)
    });
    edits.collect::<Result<_, _>>().map(EditSections)
}

/// When an edit is done.
#[derive(Deserialize)]
struct Timed {
    at_secs: f64,
}

fn read_edit(
    document: &Document<'_>,
    key: &str,
    table: &DeTable<'_>,
    span: std::ops::Range<usize>,
) -> Result<EditSection, SceneError> {
    let mut table = table.clone();
    let names = Operation::NAMES.join(", ");
    let Some(op) = table.remove("op") else {
        return Err(document.refuse(key, format!("has no `op`: it is one of {names}")));
    };
    let refuse = |message: String| document.refuse(&format!("{key}.op"), message);
    let Some(op) = op.get_ref().as_str() else { return Err(refuse(format!("should be one of {names}"))) };
    let only = match table.remove("only") {
        None => Selection::default(),
        Some(only) => match only.get_ref() {
            DeValue::Table(inner) => document.read(inner.clone(), only.span())?,
            _ => return Err(document.refuse(&format!("{key}.only"), "should be a table of keys".to_owned())),
        },
    };
    let at_secs = match table.remove_entry("at_secs") {
        None => None,
        Some((name, value)) => {
            let mut alone = DeTable::default();
            alone.insert(name, value);
            let Timed { at_secs } = document.read(alone, span.clone())?;
            Some(at_secs)
        }
    };
    let table = Spanned::new(span, table);
    let operation = match op {
        "trim" => Operation::Trim(take(document, table)?),
        "cut" => Operation::Cut(take(document, table)?),
        "lengthen" => Operation::Lengthen(take(document, table)?),
        "resample" => Operation::Resample(take(document, table)?),
        "comb" => Operation::Comb(take(document, table)?),
        "attract" => Operation::Attract(take(document, table)?),
        "repel" => Operation::Repel(take(document, table)?),
        "curl" => Operation::Curl(take(document, table)?),
        "straighten" => Operation::Straighten(take(document, table)?),
        "clump" => Operation::Clump(take(document, table)?),
        "density" => Operation::Density(take(document, table)?),
        "mirror" => Operation::Mirror(take(document, table)?),
        "smooth" => Operation::Smooth(take(document, table)?),
        _ => return Err(refuse(one_of(op, &Operation::NAMES))),
    };
    Ok(EditSection { edit: Edit { operation, only }, at_secs })
}

fn take<T: serde::de::DeserializeOwned>(
    document: &Document<'_>,
    table: Spanned<DeTable<'_>>,
) -> Result<T, SceneError> {
    let span = table.span();
    document.read(table.into_inner(), span)
}
