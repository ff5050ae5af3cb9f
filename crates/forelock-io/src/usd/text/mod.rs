//! Text layers, `.usda`.
//!
//! # Theory
//! A layer is `#usda 1.0`, metadata in parentheses, and prims. A prim is a specifier (`def`,
//! `over`, `class`), a schema, a name, metadata in parentheses, and in braces its attributes and
//! children: `type name = value (metadata)`. Samples are `name.timeSamples = { time: value, … }`.
//!
//! # Practice
//! Values are read by the declared type of their attribute. Lists and tuples are joined.
//!
//! # Limitations
//! Only `def` is read. Relationships, connections, splines, variants and dictionaries are skipped.

mod lexer;

use std::{
    collections::BTreeMap,
    io::{Read, Seek},
    rc::Rc,
};

use self::lexer::{Lexer, Token};
use super::{
    UsdError,
    crate_file::DEEPEST,
    layer::{Held, Layer, Prim, Samples, Value},
};

/// What the file begins with.
pub(super) const MAGIC: &str = "#usda ";

/// The type of an attribute's numbers or words.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Integer,
    Float,
    Double,
    /// A quaternion of single or double precision; in texts w comes first.
    Quaternion(bool),
    Word,
    /// Metadata: by the value itself.
    Any,
}

impl Kind {
    /// The kind of the type called `name`.
    fn of(name: &str) -> Self {
        let base = name.trim_end_matches(|c: char| c.is_ascii_digit());
        match name {
            "bool" | "uchar" | "int" | "uint" | "int64" | "uint64" | "int2" | "int3" | "int4" => {
                Self::Integer
            }
            "double" | "timecode" | "double2" | "double3" | "double4" | "matrix2d" | "matrix3d"
            | "matrix4d" | "frame4d" => Self::Double,
            "quatd" => Self::Quaternion(true),
            "quatf" | "quath" => Self::Quaternion(false),
            _ if ["half", "float"].contains(&base) => Self::Float,
            _ => {
                let roles = ["point3", "vector3", "normal3", "color3", "color4", "texCoord2", "texCoord3"];
                let precision = roles.iter().find_map(|role| name.strip_prefix(role));
                match precision {
                    Some("f" | "h") => Self::Float,
                    Some("d") => Self::Double,
                    _ => Self::Word,
                }
            }
        }
    }
}

/// Reads the layer in `text`.
pub(super) fn read<R: Read + Seek>(text: &str) -> Result<Layer<R>, UsdError> {
    let mut parser = Parser { lexer: Lexer::new(text), prims: Vec::new() };
    if !text.starts_with(MAGIC) {
        return Err(parser.lexer.error("the file does not begin with `#usda 1.0`"));
    }
    let metadata = parser.metadata()?;
    parser.prims()?;
    Ok(Layer::new(metadata, parser.prims, None, text.len() as u64))
}

struct Parser<'a> {
    lexer: Lexer<'a>,
    prims: Vec<Prim>,
}

impl<'a> Parser<'a> {
    /// The metadata in parentheses, if they are next.
    fn metadata(&mut self) -> Result<BTreeMap<Rc<str>, Held>, UsdError> {
        let mut metadata = BTreeMap::new();
        if !self.lexer.skip(b'(')? {
            return Ok(metadata);
        }
        loop {
            match self.lexer.next()? {
                Token::Mark(b')') => return Ok(metadata),
                Token::Text(_) | Token::Mark(b',') => {}
                // Words such as `prepend` stand before the key.
                Token::Word(_) if matches!(self.lexer.peek()?, Token::Word(_)) => {}
                Token::Word(key) => {
                    self.lexer.expect(b'=')?;
                    let value = self.value(Kind::Any)?;
                    // The path and the offset of a reference.
                    if matches!(self.lexer.peek()?, Token::Text(_)) {
                        self.lexer.next()?;
                    }
                    if self.lexer.skip(b'(')? {
                        self.lexer.skip_balanced()?;
                    }
                    metadata.insert(key.into(), value.into());
                }
                found => return Err(self.lexer.unexpected(&found, "metadata, or `)`")),
            }
        }
    }

    /// The prims of the layer, with all that they contain.
    fn prims(&mut self) -> Result<(), UsdError> {
        // The prims whose braces are open.
        let mut open: Vec<usize> = Vec::new();
        loop {
            match self.lexer.next()? {
                Token::Mark(b'}') if open.pop().is_some() => {}
                Token::Word(specifier @ ("def" | "over" | "class")) => {
                    if let Some(prim) = self.prim(specifier, open.last().copied())? {
                        open.push(prim);
                    }
                    if open.len() > DEEPEST as usize {
                        return Err(self.lexer.error(format!("prims are nested deeper than {DEEPEST}")));
                    }
                }
                Token::Word("variantSet") => {
                    self.lexer.next()?;
                    self.lexer.expect(b'=')?;
                    self.lexer.expect(b'{')?;
                    self.lexer.skip_balanced()?;
                }
                Token::Word(word) => match open.last() {
                    Some(&prim) => self.property(word, prim)?,
                    // Such as `reorder rootPrims = […]`.
                    None if word == "reorder" => {
                        self.lexer.next()?;
                        self.lexer.expect(b'=')?;
                        self.value(Kind::Any)?;
                    }
                    None => return Err(self.lexer.unexpected(&Token::Word(word), "`def`")),
                },
                Token::End if open.is_empty() => return Ok(()),
                Token::End => return Err(self.lexer.error("the file ends within a prim; is it cut short?")),
                found => return Err(self.lexer.unexpected(&found, "a prim or an attribute")),
            }
        }
    }

    /// Reads the start of a prim, after its specifier. The braces of a prim that is not read are
    /// skipped.
    fn prim(&mut self, specifier: &str, parent: Option<usize>) -> Result<Option<usize>, UsdError> {
        let mut kind = "";
        let name = loop {
            match self.lexer.next()? {
                Token::Word(word) => kind = word,
                Token::Text(name) => break name,
                found => return Err(self.lexer.unexpected(&found, "the name of a prim")),
            }
        };
        let metadata = self.metadata()?;
        self.lexer.expect(b'{')?;
        let is_active =
            !matches!(metadata.get("active"), Some(Held::Value(value)) if value.word() == Some("false"));
        if specifier != "def" || !is_active {
            self.lexer.skip_balanced()?;
            return Ok(None);
        }
        self.prims.push(Prim {
            name: (*name).into(),
            kind: kind.into(),
            parent,
            attributes: BTreeMap::new(),
        });
        Ok(Some(self.prims.len() - 1))
    }

    /// Reads an attribute of `prim` that begins with `word`.
    fn property(&mut self, word: &'a str, prim: usize) -> Result<(), UsdError> {
        let mut kind = word;
        let mut is_list_edit = false;
        while let "custom" | "uniform" | "varying" | "config" | "prepend" | "append" | "add" | "delete"
        | "reorder" = kind
        {
            is_list_edit |= !matches!(kind, "custom" | "uniform" | "varying" | "config");
            kind = self.word("the type of an attribute")?;
        }
        // `reorder properties = […]` has no type.
        let has_type = self.lexer.peek()? != Token::Mark(b'=');
        let mut name = kind;
        if has_type {
            if self.lexer.skip(b'[')? {
                self.lexer.expect(b']')?;
            }
            name = self.word("the name of an attribute")?;
        }
        let (base, suffix) = name.split_once('.').unwrap_or((name, ""));
        let is_read = has_type && !is_list_edit && kind != "rel";
        let mut value = None;
        if self.lexer.skip(b'=')? {
            value = Some(match suffix {
                "timeSamples" if is_read => self.samples(Kind::of(kind))?,
                "" | "default" if is_read => self.value(Kind::of(kind))?,
                _ => self.value(Kind::Any)?,
            });
        }
        self.metadata()?;
        if !is_read {
            return Ok(());
        }
        let attribute = self.prims[prim].attributes.entry(base.into()).or_default();
        match suffix {
            "timeSamples" => attribute.samples = value.map(Held::from),
            "" | "default" => attribute.default = value.map(Held::from).or(attribute.default.take()),
            _ => {}
        }
        Ok(())
    }

    fn word(&mut self, what: &str) -> Result<&'a str, UsdError> {
        match self.lexer.next()? {
            Token::Word(word) => Ok(word),
            found => Err(self.lexer.unexpected(&found, what)),
        }
    }

    /// The values at times, in braces.
    fn samples(&mut self, kind: Kind) -> Result<Value, UsdError> {
        self.lexer.expect(b'{')?;
        let mut samples: Vec<(f64, Held)> = Vec::new();
        loop {
            match self.lexer.next()? {
                Token::Mark(b'}') => break,
                Token::Mark(b',') => {}
                Token::Word(time) => {
                    let parsed = time.parse::<f64>().ok().filter(|time| time.is_finite());
                    let Some(parsed) = parsed else {
                        return Err(self.lexer.error(format!("`{time}` is not a time")));
                    };
                    self.lexer.expect(b':')?;
                    samples.push((parsed, self.value(kind)?.into()));
                }
                found => return Err(self.lexer.unexpected(&found, "a time, or `}`")),
            }
        }
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        if samples.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
            return Err(self.lexer.error("two samples have the same time"));
        }
        let (times, values): (Vec<f64>, Vec<Held>) = samples.into_iter().unzip();
        Ok(Value::Samples(Samples { times: times.into(), values: values.into() }))
    }

    /// A value: one number or word, or any nesting of lists and tuples of them.
    fn value(&mut self, kind: Kind) -> Result<Value, UsdError> {
        let mut list = List::new(kind);
        let mut depth = 0u64;
        loop {
            match self.lexer.next()? {
                Token::Mark(b'(' | b'[') => depth += 1,
                Token::Mark(b')' | b']') if depth > 0 => depth -= 1,
                Token::Mark(b',') if depth > 0 => {}
                Token::Mark(b'=') if depth > 0 && kind == Kind::Any => {}
                Token::Mark(b'{') => {
                    self.lexer.skip_balanced()?;
                    list.value = Value::Nothing;
                }
                Token::Word("None") => list.value = Value::Nothing,
                Token::Word(word) => {
                    if !list.push(word, true) {
                        return Err(self.lexer.error(format!("`{word}` is no value of this type")));
                    }
                }
                Token::Text(text) => {
                    if !list.push(&text, false) {
                        return Err(self.lexer.error("a text stands where a number should"));
                    }
                }
                found => return Err(self.lexer.unexpected(&found, "a value")),
            }
            if depth == 0 {
                return Ok(list.finish());
            }
        }
    }
}

/// A list that grows.
struct List {
    kind: Kind,
    value: Value,
}

impl List {
    fn new(kind: Kind) -> Self {
        let value = match kind {
            Kind::Integer => Value::Integers(Vec::new()),
            Kind::Float | Kind::Quaternion(false) => Value::Floats(Vec::new()),
            Kind::Double | Kind::Quaternion(true) => Value::Doubles(Vec::new()),
            Kind::Word | Kind::Any => Value::Words(Vec::new()),
        };
        Self { kind, value }
    }

    /// Appends `word`; false if it is no value of this kind. `is_bare` without quotes.
    fn push(&mut self, word: &str, is_bare: bool) -> bool {
        if let (Kind::Any, true, Value::Words(words)) = (self.kind, is_bare, &self.value)
            && words.is_empty()
            && word.parse::<f64>().is_ok()
        {
            self.value = Value::Doubles(Vec::new());
        }
        let is_pushed = match &mut self.value {
            Value::Integers(list) => match word {
                "true" => add(list, Some(1)),
                "false" => add(list, Some(0)),
                _ => add(list, word.parse().ok()),
            },
            Value::Floats(list) => add(list, word.parse().ok()),
            Value::Doubles(list) => add(list, word.parse().ok()),
            Value::Words(list) => add(list, Some(word.into())),
            Value::Samples(_) | Value::Nothing => true,
        };
        if !is_pushed && self.kind == Kind::Any {
            self.value = Value::Nothing;
            return true;
        }
        is_pushed
    }

    fn finish(mut self) -> Value {
        if let Kind::Quaternion(_) = self.kind {
            match &mut self.value {
                Value::Floats(list) => list.as_chunks_mut::<4>().0.iter_mut().for_each(|q| q.rotate_left(1)),
                Value::Doubles(list) => list.as_chunks_mut::<4>().0.iter_mut().for_each(|q| q.rotate_left(1)),
                _ => {}
            }
        }
        self.value
    }
}

/// Appends `value` if there is one, and returns whether there was.
fn add<T>(list: &mut Vec<T>, value: Option<T>) -> bool {
    let is_some = value.is_some();
    list.extend(value);
    is_some
}
