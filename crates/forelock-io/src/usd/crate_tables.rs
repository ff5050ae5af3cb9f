//! The tables of a crate file that is written, version 0.8.
//!
//! # Theory
//! See [`crate_file`](super::crate_file) and [`values`](super::values). The *tail* of a file is
//! what describes the arrays before it: the samples' times and representations, the sections and
//! the table of contents. A file is complete when bytes 16 to 23 hold the offset of the latter.
//!
//! # Practice
//! Nothing is compressed. So arrays can be mapped into memory, and are aligned to 8 bytes.

use glam::Vec3;

use super::{
    attributes::{Numbers, PARENT, PRIM as HAIR, Written},
    coding::{stored, stored_integers},
    crate_file::{ATTRIBUTE, LAYER, MAGIC, PRIM},
    curves::SCHEMA,
    values::{ARRAY, DOUBLE_VECTOR, INLINED, SAMPLES, TOKEN, TOKEN_VECTOR},
};

/// Where the offset of the table of contents is.
pub(super) const CONTENTS_AT: usize = 16;
const VERSION: [u8; 8] = [0, 8, 0, 0, 0, 0, 0, 0];

const BOOL: u64 = 1;
const INT: u64 = 3;
const UINT: u64 = 4;
const FLOAT: u64 = 8;
const DOUBLE: u64 = 9;
const VEC2F: u64 = 20;
const VEC3F: u64 = 24;
const VEC3I: u64 = 26;
const SPECIFIER: u64 = 42;
const VARIABILITY: u64 = 44;

/// An attribute whose arrays are in the file.
pub(super) struct Attribute {
    name: &'static str,
    /// The type, with brackets if it is an array.
    kind: String,
    default: Option<u64>,
    /// The value of each sample.
    pub samples: Vec<u64>,
    interpolation: Option<&'static str>,
    /// The word that is the value, in place of an array.
    word: Option<&'static str>,
}

impl Attribute {
    /// An attribute of an array type, with elements of type `kind`.
    pub fn new(name: &'static str, kind: &str, default: Option<u64>) -> Self {
        let kind = format!("{kind}[]");
        Self { name, kind, default, samples: Vec::new(), interpolation: None, word: None }
    }

    /// Appends the array of `written` to `out`, whose first byte is byte `start` of the file.
    pub fn append(written: &Written, out: &mut Vec<u8>, start: u64) -> Self {
        let default = match &written.numbers {
            Numbers::Word(word) => {
                let kind = written.kind.to_owned();
                return Self { kind, word: Some(word), ..Self::new(written.name, "", None) };
            }
            Numbers::Integers(each, list) => {
                let code = match (*each, written.kind) {
                    (1, "uint") => UINT,
                    (1, _) => INT,
                    _ => VEC3I,
                };
                #[expect(clippy::cast_possible_truncation, reason = "numbers of 32 bits")]
                let bytes: Vec<u8> = list.iter().flat_map(|&n| (n as i32).to_le_bytes()).collect();
                append_array(code, list.len() / each, &bytes, out, start)
            }
            Numbers::Floats(each, list) => {
                let code = match each {
                    1 => FLOAT,
                    2 => VEC2F,
                    _ => VEC3F,
                };
                append_array(code, list.len() / each, bytemuck::cast_slice(list), out, start)
            }
        };
        Self { interpolation: written.interpolation, ..Self::new(written.name, written.kind, Some(default)) }
    }
}

/// The first bytes of a file that has no table of contents yet.
pub(super) fn start() -> Vec<u8> {
    let mut out = MAGIC.to_vec();
    out.extend(VERSION);
    out.resize(super::crate_file::BOOT_BYTES as usize, 0);
    out
}

/// Completes the file `out`, whose table of contents is at byte `contents`.
pub(super) fn set_contents(out: &mut [u8], contents: u64) {
    out[CONTENTS_AT..CONTENTS_AT + 8].copy_from_slice(&contents.to_le_bytes());
}

/// Appends an array of `points` to `out`, which begins at byte `start` of the file. Returns its
/// value representation.
pub(super) fn append_points(points: &[Vec3], out: &mut Vec<u8>, start: u64) -> u64 {
    append_array(VEC3F, points.len(), bytemuck::cast_slice(points), out, start)
}

fn append_array(code: u64, count: usize, bytes: &[u8], out: &mut Vec<u8>, start: u64) -> u64 {
    if count == 0 {
        return ARRAY | (code << 48);
    }
    align(out, start);
    let at = start + out.len() as u64;
    out.extend((count as u64).to_le_bytes());
    out.extend_from_slice(bytes);
    ARRAY | (code << 48) | at
}

fn align(out: &mut Vec<u8>, start: u64) {
    let end = start + out.len() as u64;
    out.resize(out.len() + (end.next_multiple_of(8) - end) as usize, 0);
}

/// The times of the samples.
pub(super) struct Times<'a> {
    pub codes: &'a [f64],
    pub codes_per_second: f64,
}

/// The end of a file.
pub(super) struct Tail {
    pub bytes: Vec<u8>,
    /// The offset of the table of contents in the file.
    pub contents: u64,
}

impl Tail {
    /// The tail at byte `start` of a file with the arrays of `attributes`.
    pub fn new(start: u64, attributes: &[&Attribute], times: Option<&Times<'_>>) -> Self {
        let mut tables = Tables { start, ..Tables::default() };
        // Property names are stored as negative tokens, so none may have the number 0.
        tables.token("");
        tables.describe(attributes, times);
        tables.finish(attributes.len())
    }
}

#[derive(Default)]
struct Tables {
    start: u64,
    out: Vec<u8>,
    tokens: Vec<String>,
    field_names: Vec<i32>,
    field_values: Vec<u64>,
    sets: Vec<i32>,
    /// The first field of each spec, its kind, and the token of its name.
    spec_sets: Vec<i32>,
    spec_kinds: Vec<u32>,
    names: Vec<i32>,
}

impl Tables {
    fn token(&mut self, word: &str) -> u64 {
        let known = self.tokens.iter().position(|token| token == word);
        known.unwrap_or_else(|| {
            self.tokens.push(word.to_owned());
            self.tokens.len() - 1
        }) as u64
    }

    /// The value of a word.
    fn word(&mut self, word: &str) -> u64 {
        INLINED | (TOKEN << 48) | self.token(word)
    }

    /// The value of a number.
    fn double(&mut self, number: f64) -> u64 {
        align(&mut self.out, self.start);
        let at = self.start + self.out.len() as u64;
        self.out.extend(number.to_le_bytes());
        (DOUBLE << 48) | at
    }

    /// The value of a list of words.
    fn words<'a>(&mut self, words: impl ExactSizeIterator<Item = &'a str>) -> u64 {
        let count = words.len() as u64;
        let tokens: Vec<u64> = words.map(|word| self.token(word)).collect();
        align(&mut self.out, self.start);
        let at = self.start + self.out.len() as u64;
        self.out.extend(count.to_le_bytes());
        self.out.extend(tokens.iter().flat_map(|&token| low(token).to_le_bytes()));
        (TOKEN_VECTOR << 48) | at
    }

    /// Begins a spec; the fields that follow belong to it.
    fn spec(&mut self, kind: u32, name: &str) {
        if !self.sets.is_empty() {
            self.sets.push(-1);
        }
        let name = self.token(name);
        self.names.push(integer(name));
        self.spec_kinds.push(kind);
        self.spec_sets.push(integer(self.sets.len() as u64));
    }

    fn field(&mut self, name: &str, value: u64) {
        let name = self.token(name);
        self.sets.push(integer(self.field_names.len() as u64));
        self.field_names.push(integer(name));
        self.field_values.push(value);
    }

    /// The specs of the layer, its two prims and `attributes`.
    fn describe(&mut self, attributes: &[&Attribute], times: Option<&Times<'_>>) {
        let times_at = times.map(|times| {
            align(&mut self.out, self.start);
            let at = self.start + self.out.len() as u64;
            self.out.extend((times.codes.len() as u64).to_le_bytes());
            self.out.extend(times.codes.iter().flat_map(|code| code.to_le_bytes()));
            (DOUBLE_VECTOR << 48) | at
        });
        self.spec(LAYER, "");
        let parent = self.word(PARENT);
        self.field("defaultPrim", parent);
        let metre = INLINED | (DOUBLE << 48) | u64::from(1f32.to_bits());
        self.field("metersPerUnit", metre);
        let up = self.word("Y");
        self.field("upAxis", up);
        if let Some(times) = times {
            let ends = [times.codes.first(), times.codes.last()].map(|code| code.copied().unwrap_or(0.0));
            let numbers = [times.codes_per_second, times.codes_per_second, ends[0], ends[1]];
            let names = ["timeCodesPerSecond", "framesPerSecond", "startTimeCode", "endTimeCode"];
            for (name, number) in names.into_iter().zip(numbers) {
                let value = self.double(number);
                self.field(name, value);
            }
        }
        let children = self.words([PARENT].into_iter());
        self.field("primChildren", children);
        self.prim(PARENT, "Xform");
        let children = self.words([HAIR].into_iter());
        self.field("primChildren", children);
        self.prim(HAIR, SCHEMA);
        let properties = self.words(attributes.iter().map(|attribute| attribute.name));
        self.field("properties", properties);
        for attribute in attributes {
            self.attribute(attribute, times_at);
        }
        self.sets.push(-1);
    }

    fn prim(&mut self, name: &str, kind: &str) {
        self.spec(PRIM, name);
        self.field("specifier", INLINED | (SPECIFIER << 48));
        let kind = self.word(kind);
        self.field("typeName", kind);
    }

    fn attribute(&mut self, attribute: &Attribute, times: Option<u64>) {
        self.spec(ATTRIBUTE, attribute.name);
        let kind = self.word(&attribute.kind);
        self.field("typeName", kind);
        if let Some(interpolation) = attribute.interpolation {
            let interpolation = self.word(interpolation);
            self.field("interpolation", interpolation);
        }
        if let Some(word) = attribute.word {
            self.field("variability", INLINED | (VARIABILITY << 48) | BOOL);
            let word = self.word(word);
            self.field("default", word);
        }
        if let Some(default) = attribute.default {
            self.field("default", default);
        }
        if let Some(times) = times.filter(|_| !attribute.samples.is_empty()) {
            align(&mut self.out, self.start);
            let at = self.start + self.out.len() as u64;
            // Both jumps lead to what follows them.
            for number in [8, times, 8, attribute.samples.len() as u64].iter().chain(&attribute.samples) {
                self.out.extend(number.to_le_bytes());
            }
            self.field("timeSamples", (SAMPLES << 48) | at);
        }
    }

    /// The sections, and the table of contents.
    fn finish(mut self, attributes: usize) -> Tail {
        let specs = self.names.len();
        let text: Vec<u8> = self.tokens.iter().flat_map(|token| [token.as_bytes(), &[0]].concat()).collect();
        let mut tokens = count(self.tokens.len());
        tokens.extend(count(text.len()));
        sized(&mut tokens, &stored(&text));
        let mut fields = count(self.field_names.len());
        sized(&mut fields, &stored_integers(&self.field_names));
        sized(&mut fields, &stored(bytemuck::cast_slice(&self.field_values)));
        let mut sets = count(self.sets.len());
        sized(&mut sets, &stored_integers(&self.sets));
        // The layer, the two prims one in the other, and the attributes side by side.
        let properties = specs - attributes;
        let indices: Vec<i32> = (0..specs as u64).map(integer).collect();
        let names = self.names.iter().enumerate();
        let names: Vec<i32> = names.map(|(i, &name)| if i < properties { name } else { -name }).collect();
        let jump = |i: usize| match i {
            _ if i + 1 == specs => -2,
            _ if i < properties => -1,
            _ => 0,
        };
        let mut paths = count(specs);
        paths.extend(count(specs));
        for list in [&indices, &names, &(0..specs).map(jump).collect()] {
            sized(&mut paths, &stored_integers(list));
        }
        let kinds: Vec<i32> = self.spec_kinds.iter().map(|&kind| integer(kind.into())).collect();
        let mut spec = count(specs);
        for list in [&indices, &self.spec_sets, &kinds] {
            sized(&mut spec, &stored_integers(list));
        }
        let sections = [
            ("TOKENS", tokens),
            ("STRINGS", count(0)),
            ("FIELDS", fields),
            ("FIELDSETS", sets),
            ("PATHS", paths),
            ("SPECS", spec),
        ];
        let mut contents = count(sections.len());
        for (name, bytes) in sections {
            let mut entry = name.as_bytes().to_vec();
            entry.resize(16, 0);
            entry.extend((self.start + self.out.len() as u64).to_le_bytes());
            entry.extend((bytes.len() as u64).to_le_bytes());
            contents.extend(entry);
            self.out.extend(bytes);
        }
        let at = self.start + self.out.len() as u64;
        self.out.extend(contents);
        Tail { bytes: self.out, contents: at }
    }
}

fn count(count: usize) -> Vec<u8> {
    (count as u64).to_le_bytes().to_vec()
}

/// Appends `buffer` after its size.
fn sized(out: &mut Vec<u8>, buffer: &[u8]) {
    out.extend((buffer.len() as u64).to_le_bytes());
    out.extend(buffer);
}

/// `number` as an integer of the tables, which have far fewer entries than that.
fn integer(number: u64) -> i32 {
    i32::try_from(number).unwrap_or(i32::MAX)
}

fn low(number: u64) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}
