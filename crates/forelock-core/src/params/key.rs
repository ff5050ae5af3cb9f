//! Parameters that describe themselves: the documentation of a field is its definition.
//!
//! # Practice
//! [`documented!`](crate::documented) declares a struct and keeps the documentation of its fields.
//! A field is documented in one line, however it is wrapped: "Meaning. Unit m, default 0.1, range 0
//! to 10; 0 means this." [`Key`] reads the parts. Checks, the reference of scene files and the
//! command's help take them from there, so none of them can differ from the others.
//!
//! # Limitations
//! Ranges are closed intervals, with or without 0 beside them. What depends on another parameter is
//! checked by code.

use std::fmt;

/// One parameter: a field and what its documentation says.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Name of the field.
    pub field: &'static str,
    /// Lines of its documentation; those that start with `#` are its other attributes.
    pub lines: &'static [&'static str],
}

/// A struct declared by [`documented!`](crate::documented).
pub trait Documented {
    /// Its fields, in order.
    const KEYS: &'static [Key];
}

/// Declares a struct whose fields can be listed with their documentation: see
/// [`params::Key`](crate::params::Key).
///
/// ```
/// use forelock_core::params::Documented;
///
/// forelock_core::documented! {
/// /// Parameters of a swing.
/// pub struct Swing {
///     /// Length of the rope. Unit m, default 2, range 0.1 to 10.
///     pub length: f64,
/// }
/// }
/// let [length] = Swing::KEYS else { unreachable!() };
/// assert_eq!((length.name(), length.unit().as_deref()), ("length", Some("m")));
/// assert_eq!(length.range().map(|range| range.to_string()).as_deref(), Some("from 0.1 to 10"));
/// ```
#[macro_export]
macro_rules! documented {
    (@line doc = $text:literal) => { $text };
    (@line $attribute:ident $($rest:tt)*) => { concat!("#", stringify!($($rest)*)) };
    (
        $(#[$outer:meta])*
        pub struct $name:ident {
            $( $(#[$attribute:ident $($rest:tt)*])* pub $field:ident : $type:ty, )*
        }
    ) => {
        $(#[$outer])*
        pub struct $name {
            $( $(#[$attribute $($rest)*])* pub $field: $type, )*
        }

        impl $crate::params::Documented for $name {
            const KEYS: &'static [$crate::params::Key] = &[$( $crate::params::Key {
                field: stringify!($field),
                lines: &[$( $crate::documented!(@line $attribute $($rest)*) ),*],
            } ),*];
        }
    };
}

impl Key {
    /// The name in files: that of the field, unless it is renamed.
    pub fn name(&self) -> &'static str {
        let attributes = self.lines.iter().filter(|line| line.starts_with('#'));
        let mut renamed = attributes.filter_map(|line| line.split_once("rename = \""));
        renamed.next().and_then(|(_, rest)| rest.split_once('"')).map_or(self.field, |(name, _)| name)
    }

    /// The documentation as one line.
    pub fn text(&self) -> String {
        let words = self.lines.iter().filter(|line| !line.starts_with('#'));
        words.flat_map(|line| line.split_whitespace()).collect::<Vec<_>>().join(" ")
    }

    /// Meaning, and what special values mean.
    pub fn meaning(&self) -> String {
        let text = self.text();
        let starts = [" Unit ", " No unit", " Default ", " No default"];
        let Some(end) = starts.into_iter().filter_map(|start| text.find(start)).min() else { return text };
        let facts = &text[end + 1..];
        let stop = [". ", "; "].into_iter().filter_map(|stop| facts.find(stop)).min();
        let note = stop.map_or("", |stop| &facts[stop + 2..]).trim_end_matches('.');
        let mut letters = note.chars();
        match letters.next() {
            Some(first) => format!("{} {}{}.", &text[..end], first.to_uppercase(), letters.as_str()),
            None => text[..end].to_owned(),
        }
    }

    /// The unit, if it has one.
    pub fn unit(&self) -> Option<String> {
        fact(&self.text(), " Unit ")
    }

    /// The default in words, if it is documented; a table of keys has none.
    pub fn default_words(&self) -> Option<String> {
        let text = self.text();
        if text.contains("o default") {
            return Some("–".to_owned());
        }
        fact(&text, "efault ")
    }

    /// The range of its numbers, if it has any.
    pub fn range(&self) -> Option<Range> {
        Range::parse(&fact(&self.text(), " range ")?)
    }
}

/// What follows `word` in `text`, up to the end of the statement.
fn fact(text: &str, word: &str) -> Option<String> {
    let (_, rest) = text.split_once(word)?;
    let stops = ["; ", ". ", ", range ", ", default ", ", no default"];
    let end = stops.into_iter().filter_map(|stop| rest.find(stop)).min().unwrap_or(rest.len());
    Some(rest[..end].trim_end_matches('.').to_owned())
}

/// The numbers that a parameter may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest, but for 0 if that is allowed too.
    pub low: f64,
    /// Largest.
    pub high: f64,
    /// Whether 0 is allowed, though it lies outside.
    pub or_zero: bool,
}

impl Range {
    /// Reads "1 to 10", "1 to 10 each", "1 to 10 or 0" and "0 or more", which ends where whole
    /// numbers do.
    pub fn parse(words: &str) -> Option<Self> {
        let (words, or_zero) = words.strip_suffix(" or 0").map_or((words, false), |words| (words, true));
        if words == "0 or more" {
            return Some(Self { low: 0.0, high: f64::INFINITY, or_zero });
        }
        let (low, high) = words.trim_end_matches(" each").split_once(" to ")?;
        Some(Self { low: low.parse().ok()?, high: high.parse().ok()?, or_zero })
    }

    /// Whether `value` is in it. Numbers with a fraction may be off by the rounding of float32.
    pub fn contains(self, value: f64) -> bool {
        let slack = if value.fract() == 0.0 { 0.0 } else { 1e-7 * value.abs() };
        let is_within = value >= self.low - slack && value <= self.high + slack;
        value.is_finite() && (is_within || (self.or_zero && value == 0.0))
    }
}

/// As in "should be from 1 to 10, or 0".
impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { low, high, or_zero } = *self;
        if high.is_infinite() {
            return write!(f, "{low} or more");
        }
        write!(f, "from {} to {}{}", Short(low), Short(high), if or_zero { ", or 0" } else { "" })
    }
}

/// A number in few letters, for messages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Short(pub f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&in_few_letters(self.0, 1e10))
    }
}

/// `value` in few letters: with an exponent from `largest` on and below 0.001, and as float32 if it
/// is one.
pub fn in_few_letters(value: f64, largest: f64) -> String {
    let (size, single) = (value.abs(), value as f32);
    let is_plain = size == 0.0 || (1e-3..largest).contains(&size) || !size.is_finite();
    match f64::from(single).to_bits() == value.to_bits() {
        true if is_plain => single.to_string(),
        true => format!("{single:e}"),
        false if is_plain => value.to_string(),
        false => format!("{value:e}"),
    }
}

/// A value that is out of the range of its parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OutOfRange {
    /// The parameter.
    pub name: &'static str,
    /// The value.
    pub value: f64,
    /// Its range.
    pub range: Range,
}

/// Checks parameters of `D`, each its name in files and its numbers.
pub(crate) fn check<D: Documented, T: Copy + Into<f64>>(
    values: &[(&'static str, &[T])],
) -> Result<(), OutOfRange> {
    for (name, numbers) in values {
        let range = D::KEYS.iter().find(|key| key.name() == *name).and_then(Key::range);
        debug_assert!(range.is_some(), "`{name}` documents no range");
        let Some(range) = range else { continue };
        if let Some(value) = numbers.iter().map(|number| (*number).into()).find(|x| !range.contains(*x)) {
            return Err(OutOfRange { name, value, range });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::documented! {
        /// A struct.
        #[expect(dead_code, reason = "only its documentation is read")]
        pub struct Sample {
            /// How far a thing
            /// reaches. Unit m, default 2.5, range 0.1 to 10 or 0; 0 reaches
            /// nowhere.
            pub reach: f32,
            /// Where it lies, [x, y, z]. Unit m, default [0, -1, 0], range -10 to 10 each.
            #[cfg_attr(any(), serde(rename = "place"))]
            pub position: [f32; 3],
            /// Its kind: "a" or "b". Default "a". Changed rarely.
            pub kind: u8,
            /// Other keys.
            pub rest: u8,
        }
    }

    #[test]
    fn documentation_is_read() {
        let [reach, position, kind, rest] = Sample::KEYS else { unreachable!() };
        assert_eq!(reach.meaning(), "How far a thing reaches. 0 reaches nowhere.");
        assert_eq!(reach.unit().as_deref(), Some("m"));
        assert_eq!(reach.default_words().as_deref(), Some("2.5"));
        assert_eq!(reach.range(), Some(Range { low: 0.1, high: 10.0, or_zero: true }));
        assert_eq!((position.name(), position.field), ("place", "position"));
        assert_eq!(position.default_words().as_deref(), Some("[0, -1, 0]"));
        assert_eq!(position.range().unwrap().to_string(), "from -10 to 10");
        assert_eq!(kind.meaning(), "Its kind: \"a\" or \"b\". Changed rarely.");
        assert_eq!((kind.unit(), kind.range()), (None, None));
        assert_eq!((rest.meaning().as_str(), rest.default_words()), ("Other keys.", None));
    }

    #[test]
    fn values_are_held_to_the_documented_ranges() {
        let check = |reach: f32, x: f32| check::<Sample, f32>(&[("reach", &[reach]), ("place", &[0.0, x])]);
        for (reach, x) in [(0.1, -10.0), (10.0, 10.0), (0.0, 0.0)] {
            assert_eq!(check(reach, x), Ok(()));
        }
        for (reach, x, name) in
            [(0.09, 0.0, "reach"), (-1.0, 0.0, "reach"), (f32::NAN, 0.0, "reach"), (1.0, 10.1, "place")]
        {
            assert_eq!(check(reach, x).unwrap_err().name, name);
        }
        assert_eq!(Range::parse("1e-6 to 1e12").unwrap().to_string(), "from 1e-6 to 1e12");
        let short = [0.1f32.into(), 0.1, -2e50, 59.94, 1e9].map(|value: f64| Short(value).to_string());
        assert_eq!(short, ["0.1", "0.1", "-2e50", "59.94", "1000000000"]);
        assert!(Range::parse("0 or more").unwrap().contains(1e19) && Range::parse("some").is_none());
    }
}
