//! What can be wrong with a scene, and the words for it.

use std::fmt;
use std::path::PathBuf;

/// Where in a scene something stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A line and column of the file, from 1.
    Line {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
    },
    /// An option of the command line, as the user wrote it.
    Override(String),
    /// The file as a whole: the value is a default.
    Whole(PathBuf),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line { path, line, column } => {
                write!(f, "{}, line {line}, column {column}", path.display())
            }
            Self::Override(label) => f.write_str(label),
            Self::Whole(path) => write!(f, "{}", path.display()),
        }
    }
}

/// Why a scene was refused.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The file cannot be read.
    #[error("{}: the scene file cannot be read: {}", .path.display(), read_words(.error))]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// An override is not `key=value`.
    #[error("`{0}` is not of the form key=value, as in time.frames=100")]
    Assignment(String),
    /// The text is not TOML.
    #[error("{place}: this is not TOML: {message}")]
    Syntax {
        /// Where.
        place: Place,
        /// What the parser said.
        message: String,
    },
    /// A key that no scene has.
    #[error("{place}: there is no key `{key}`{}", hint(.nearest.as_deref(), .known, .key))]
    UnknownKey {
        /// Where.
        place: Place,
        /// The dotted key as written.
        key: String,
        /// The known key nearest to it, if one is near.
        nearest: Option<String>,
        /// All keys that could stand there.
        known: Vec<String>,
    },
    /// A value of the wrong type, out of range, or not available.
    #[error("{place}: `{key}` {message}")]
    Value {
        /// Where.
        place: Place,
        /// The dotted key.
        key: String,
        /// What is wrong, and what would be right.
        message: String,
    },
}

fn read_words(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "there is no such file; check the name".to_owned(),
        std::io::ErrorKind::IsADirectory => "it is a directory; name a .toml file in it".to_owned(),
        std::io::ErrorKind::InvalidData => "it is not UTF-8 text; save it as UTF-8".to_owned(),
        _ => error.to_string(),
    }
}

/// The last name of `key`, which stands in a table, if it is that of a section of scenes.
fn section(key: &str) -> Option<&str> {
    let (_, name) = key.rsplit_once('.')?;
    ["groom", "body", "time", "solver", "output", "camera"].contains(&name).then_some(name)
}

fn hint(nearest: Option<&str>, known: &[String], key: &str) -> String {
    match (section(key), nearest) {
        (Some(name), _) => {
            format!("; keys of `{name}` stand before the first table, or below a line `[{name}]`")
        }
        (None, Some(nearest)) => format!("; did you mean `{nearest}`?"),
        (None, None) => format!("; known here: {}", known.join(", ")),
    }
}

/// The entry of `known` nearest to `word` by edit distance, if it is near enough to be what was
/// meant.
pub(crate) fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    known
        .into_iter()
        .map(|candidate| (strsim::normalized_damerau_levenshtein(word, candidate), candidate))
        .filter(|(likeness, _)| *likeness > 0.4)
        .fold(None, |best: Option<(f64, &str)>, this| match best {
            Some(b) if b.0 >= this.0 => Some(b),
            _ => Some(this),
        })
        .map(|(_, candidate)| candidate)
}

/// Turns what serde says about `key` at `place` into an error in the words of a scene file.
pub(super) fn reword(message: &str, key: String, place: Place) -> SceneError {
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    if message.starts_with("unknown field") {
        let (parent, name) = key.rsplit_once('.').map_or(("", key.as_str()), |(p, n)| (p, n));
        let known: Vec<String> = quoted.iter().skip(1).map(|k| (*k).to_owned()).collect();
        let full = |k: &str| if parent.is_empty() { k.to_owned() } else { format!("{parent}.{k}") };
        let nearest = nearest(name, known.iter().map(String::as_str)).map(full);
        return SceneError::UnknownKey { place, nearest, known, key };
    }
    if message.starts_with("unknown variant") {
        let found = quoted.first().copied().unwrap_or_default();
        return SceneError::Value { place, message: one_of(found, &quoted[1.min(quoted.len())..]), key };
    }
    if let Some(field) = message.strip_prefix("missing field `").and_then(|rest| rest.strip_suffix('`')) {
        return SceneError::Value { place, key, message: format!("has no `{field}`, which it needs") };
    }
    let message = ["invalid type: ", "invalid value: ", "invalid length "]
        .iter()
        .find_map(|start| message.strip_prefix(start))
        .and_then(|rest| rest.rsplit_once(", expected "))
        .map_or_else(
            || format!("is wrong: {message}"),
            |(found, expected)| format!("should be {}, not {}", type_words(expected), found_words(found)),
        );
    SceneError::Value { place, key, message }
}

/// The message that `found` is none of `known`, with the nearest of them.
pub(crate) fn one_of(found: &str, known: &[&str]) -> String {
    let near = nearest(found, known.iter().copied())
        .map_or_else(String::new, |n| format!("; did you mean \"{n}\"?"));
    format!("cannot be \"{found}\": it is one of {}{near}", known.join(", "))
}

fn type_words(expected: &str) -> String {
    match expected {
        "f64" | "f32" => "a number".to_owned(),
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, 0 or more".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a string" => "text in quotes".to_owned(),
        "a sequence" => "a list".to_owned(),
        "a sequence of 3 f32 values" => "a list of 3 numbers".to_owned(),
        _ if expected.starts_with("struct ") => "a table of keys".to_owned(),
        _ => expected.replace("an array of length", "a list of").replace("string or map", "text in quotes"),
    }
}

fn found_words(found: &str) -> String {
    let found = found.replace('`', "");
    match found.split_once(' ') {
        Some(("string", text)) => format!("the text {text}"),
        Some(("integer" | "floating", rest)) => rest.trim_start_matches("point ").to_owned(),
        Some(("boolean", value)) => value.to_owned(),
        _ if found == "map" => "a table".to_owned(),
        _ if found == "sequence" => "a list".to_owned(),
        _ if found.chars().all(|c| c.is_ascii_digit()) => format!("of {found}"),
        _ => found,
    }
}
