//! A scene's text with the overrides laid over it, and where each byte of the two came from.
//!
//! Each override is parsed as if it stood below the file and all overrides before it: the parser is
//! given as many blanks as there is text above. So one byte offset names one place, be it in the
//! file or on the command line, and `toml`'s spans serve for both.

use std::ops::Range;
use std::path::Path;

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::error::{Place, SceneError, reword};

/// One `key=value` laid over a scene file, as in `--set solver.ams.k_edge=1e7`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Override {
    /// How the user wrote it, for messages: `--set time.fps=30` or `--frames 10`.
    pub label: String,
    /// Dotted key.
    pub key: String,
    /// A TOML value; what is none is taken as text, so that words need no quotes.
    pub value: String,
}

impl Override {
    /// The override of `--set` followed by `assignment`, which must hold a `=`.
    ///
    /// # Errors
    /// [`SceneError::Assignment`] if there is no key or no `=`.
    pub fn set(assignment: &str) -> Result<Self, SceneError> {
        match assignment.split_once('=') {
            Some((key, value)) if !key.trim().is_empty() => Ok(Self {
                label: format!("--set {}", assignment.replace(char::is_control, " ")),
                key: key.trim().to_owned(),
                value: value.trim().to_owned(),
            }),
            _ => Err(SceneError::Assignment(assignment.to_owned())),
        }
    }

    /// The override of a command-line option such as `--frames 10`.
    pub fn option(option: &str, key: &str, value: impl ToString) -> Self {
        let value = value.to_string();
        Self { label: format!("{option} {value}"), key: key.to_owned(), value }
    }

    /// The override as a line of TOML: its value as it stands or, if that is no TOML, as text.
    fn line(&self) -> Result<String, SceneError> {
        let quoted = toml::Value::String(self.value.clone()).to_string();
        let mut first_error = None;
        for value in [self.value.as_str(), &quoted] {
            let line = format!("{} = {value}", self.key);
            match DeTable::parse(&line) {
                Ok(table) if table.get_ref().len() == 1 => return Ok(line),
                Ok(_) => {}
                Err(error) => first_error = first_error.or(Some(error)),
            }
        }
        Err(SceneError::Syntax {
            place: Place::Override(self.label.clone()),
            message: first_error.map_or_else(|| "more than one key".to_owned(), |e| e.message().to_owned()),
        })
    }
}

/// An override as TOML below everything that comes before it.
pub(crate) struct Layer {
    label: String,
    text: String,
}

impl Layer {
    /// The layers of `overrides` over a file of `above` bytes.
    pub(crate) fn stack(mut above: usize, overrides: &[Override]) -> Result<Vec<Self>, SceneError> {
        let mut layers = Vec::with_capacity(overrides.len());
        for over in overrides {
            let text = format!("{}{}", " ".repeat(above + 1), over.line()?);
            above = text.len();
            layers.push(Self { label: over.label.clone(), text });
        }
        Ok(layers)
    }
}

/// A parsed scene text with its overrides.
pub(crate) struct Document<'a> {
    path: &'a Path,
    text: &'a str,
    layers: &'a [Layer],
    table: DeTable<'a>,
    /// Where what the author wrote ends, and the defaults below it begin.
    end: usize,
}

impl<'a> Document<'a> {
    /// `text` with `layers` over it and `defaults` below it, which come from [`Document::below`].
    pub(crate) fn parse(
        text: &'a str,
        path: &'a Path,
        layers: &'a [Layer],
        defaults: &'a str,
    ) -> Result<Self, SceneError> {
        let end = layers.last().map_or(text.len(), |layer| layer.text.len());
        let mut document = Self { path, text, layers, table: DeTable::default(), end };
        let above = std::iter::once(text).chain(layers.iter().map(|layer| layer.text.as_str()));
        for text in std::iter::once(defaults).chain(above) {
            let table = DeTable::parse(text).map_err(|error| SceneError::Syntax {
                place: document.place(error.span().unwrap_or(0..0)),
                message: syntax_words(error.message()),
            })?;
            merge_table(&mut document.table, table.into_inner());
        }
        Ok(document)
    }

    /// `defaults` as TOML that stands after all that the author wrote.
    pub(crate) fn below(&self, defaults: &str) -> String {
        format!("{}{defaults}", " ".repeat(self.end + 1))
    }

    pub(crate) fn deserialize<T: DeserializeOwned>(&self) -> Result<T, SceneError> {
        self.read(self.table.clone(), 0..self.text.len())
    }

    /// What stands at the top-level key `key`, if something does.
    pub(super) fn list(&self, key: &str) -> Option<&DeValue<'a>> {
        self.table.get(key).map(Spanned::get_ref)
    }

    /// A part of this document, `table`, which stands at `span`.
    pub(super) fn read<T: DeserializeOwned>(
        &self,
        table: DeTable<'_>,
        span: Range<usize>,
    ) -> Result<T, SceneError> {
        T::deserialize(toml::Deserializer::from(Spanned::new(span, table))).map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            reword(error.message(), self.key_at(&span), self.place(span))
        })
    }

    /// The error that `key` has a wrong value, with the place where it was set.
    pub(crate) fn refuse(&self, key: &str, message: String) -> SceneError {
        let place =
            self.span_of(key).map_or_else(|| Place::Whole(self.path.to_path_buf()), |span| self.place(span));
        SceneError::Value { place, key: key.to_owned(), message }
    }

    /// Whether the file or an override sets `key`.
    pub(super) fn sets(&self, key: &str) -> bool {
        self.span_of(key).is_some_and(|span| span.start <= self.end)
    }

    /// The text at `table.key`, if there is text.
    pub(super) fn text_at(&self, table: &str, key: &str) -> Option<String> {
        let table = self.table.get(table)?.get_ref().as_table()?;
        table.get(key)?.get_ref().as_str().map(str::to_owned)
    }

    /// Takes the table at `table.key` out, if there is one.
    pub(super) fn take_table(&mut self, table: &str, key: &str) -> Result<Option<toml::Table>, SceneError> {
        let Some(DeValue::Table(outer)) = self.table.get_mut(table).map(Spanned::get_mut) else {
            return Ok(None);
        };
        let Some(value) = outer.remove(key) else { return Ok(None) };
        let span = value.span();
        match value.into_inner() {
            DeValue::Table(inner) => self.read(inner, span).map(Some),
            _ => Err(SceneError::Value {
                place: self.place(span),
                key: format!("{table}.{key}"),
                message: "should be a table of keys".to_owned(),
            }),
        }
    }

    /// Removes `table.key`.
    pub(super) fn remove(&mut self, table: &str, key: &str) {
        if let Some(DeValue::Table(outer)) = self.table.get_mut(table).map(Spanned::get_mut) {
            outer.remove(key);
        }
    }

    /// The number at `key`, if there is one.
    pub(super) fn number_at(&self, key: &str) -> Option<f64> {
        let mut names = key.split('.');
        let mut value = self.table.get(names.next()?)?.get_ref();
        for name in names {
            value = value.as_table()?.get(name)?.get_ref();
        }
        let text = match value {
            DeValue::Integer(number) => number.as_str(),
            DeValue::Float(number) => number.as_str(),
            _ => return None,
        };
        text.parse().ok()
    }

    fn place(&self, span: Range<usize>) -> Place {
        if span.start > self.text.len() {
            let layer = self.layers.iter().find(|layer| span.start < layer.text.len());
            return layer.map_or_else(
                || Place::Whole(self.path.to_path_buf()),
                |layer| Place::Override(layer.label.clone()),
            );
        }
        let before = &self.text.as_bytes()[..span.start];
        let line = before.iter().filter(|&&b| b == b'\n').count() + 1;
        let line_start = before.iter().rposition(|&b| b == b'\n').map_or(0, |at| at + 1);
        let column = String::from_utf8_lossy(&before[line_start..]).chars().count() + 1;
        Place::Line { path: self.path.to_path_buf(), line, column }
    }

    fn span_of(&self, key: &str) -> Option<Range<usize>> {
        let mut found = None;
        visit(&self.table, "", &mut |path, _, value| {
            if path == key {
                found = Some(value);
            }
        });
        found
    }

    /// The dotted key whose name or value stands at `span`.
    fn key_at(&self, span: &Range<usize>) -> String {
        let mut found = String::new();
        visit(&self.table, "", &mut |path, key, value| {
            if key == *span || (value == *span && found.is_empty()) {
                path.clone_into(&mut found);
            }
        });
        found
    }
}

/// The words of the TOML parser, with what to do where a name is extended to a table.
fn syntax_words(message: &str) -> String {
    let extends = message.contains("extend value of type string");
    let remedy = "; a key is text or a table, not both (a motion's name is the key `name` of its table)";
    format!("{message}{}", if extends { remedy } else { "" })
}

/// Lays `upper` over `lower`, key by key.
fn merge_table<'a>(lower: &mut DeTable<'a>, upper: DeTable<'a>) {
    for (key, value) in upper {
        // Removed and put back, so that the key's span is the override's too.
        let merged = match lower.remove(&key) {
            // A motion may be its name alone.
            Some(old) if key.get_ref() == "motion" && old.get_ref().is_str() => {
                let span = old.span();
                let mut named = DeTable::new();
                named.insert(Spanned::new(span.clone(), "name".into()), old);
                merge_value(Spanned::new(span, DeValue::Table(named)), value)
            }
            Some(old) => merge_value(old, value),
            None => value,
        };
        lower.insert(key, merged);
    }
}

/// `upper` over `lower`: tables are merged, numbers as keys pick entries of an array, all else is
/// replaced.
fn merge_value<'a>(mut lower: Spanned<DeValue<'a>>, upper: Spanned<DeValue<'a>>) -> Spanned<DeValue<'a>> {
    match (lower.get_mut(), upper.get_ref()) {
        (DeValue::Table(below), DeValue::Table(above)) => merge_table(below, above.clone()),
        (DeValue::Array(below), DeValue::Table(above)) if indexes(above, below.len()) => {
            for (index, entry) in above {
                let index: usize = index.get_ref().parse().unwrap_or_default();
                if let (Some(DeValue::Table(below)), DeValue::Table(above)) =
                    (below.get_mut(index).map(Spanned::get_mut), entry.get_ref())
                {
                    merge_table(below, above.clone());
                }
            }
        }
        _ => return upper,
    }
    lower
}

/// Whether every key of `table` is the index of one of `len` entries, and holds a table.
fn indexes(table: &DeTable<'_>, len: usize) -> bool {
    table.iter().all(|(key, value)| {
        key.get_ref().parse::<usize>().is_ok_and(|index| index < len)
            && matches!(value.get_ref(), DeValue::Table(_))
    })
}

/// Calls `each(path, key's span, value's span)` for every key of `table`, parents before children.
fn visit(table: &DeTable<'_>, prefix: &str, each: &mut impl FnMut(&str, Range<usize>, Range<usize>)) {
    for (key, value) in table {
        let path =
            if prefix.is_empty() { key.get_ref().to_string() } else { format!("{prefix}.{}", key.get_ref()) };
        each(&path, key.span(), value.span());
        visit_value(value, &path, each);
    }
}

fn visit_value(
    value: &Spanned<DeValue<'_>>,
    path: &str,
    each: &mut impl FnMut(&str, Range<usize>, Range<usize>),
) {
    match value.get_ref() {
        DeValue::Table(inner) => visit(inner, path, each),
        DeValue::Array(entries) => {
            for (index, entry) in entries.iter().enumerate() {
                let path = format!("{path}.{index}");
                each(&path, entry.span(), entry.span());
                visit_value(entry, &path, each);
            }
        }
        _ => {}
    }
}
