//! The tokens of a text layer.

use std::borrow::Cow;

use super::super::UsdError;
use crate::error::{FormatError, Problem};

/// A token.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token<'a> {
    /// A name, a keyword or a number.
    Word(&'a str),
    /// A text in quotes, an asset between `@` or a path between `<` and `>`.
    Text(Cow<'a, str>),
    /// Another character.
    Mark(u8),
    /// The end of the file.
    End,
}

/// Splits a text into tokens.
pub(super) struct Lexer<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Lexer<'a> {
    pub fn new(text: &'a str) -> Self {
        Self { text, at: 0 }
    }

    fn rest(&self) -> &'a [u8] {
        &self.text.as_bytes()[self.at..]
    }

    /// The next token, which stays the next one.
    pub fn peek(&mut self) -> Result<Token<'a>, UsdError> {
        self.skip_space();
        let start = self.at;
        let token = self.next();
        self.at = start;
        token
    }

    /// The next token.
    pub fn next(&mut self) -> Result<Token<'a>, UsdError> {
        self.skip_space();
        let Some(&first) = self.rest().first() else { return Ok(Token::End) };
        let length = match first {
            b'0'..=b'9' | b'+' | b'-' | b'.' => {
                self.run(|b| b.is_ascii_alphanumeric() || b"+-.".contains(&b))
            }
            b'a'..=b'z' | b'A'..=b'Z' | b'_' | 128.. => {
                self.run(|b| b.is_ascii_alphanumeric() || b"_:.".contains(&b) || b > 127)
            }
            b'"' | b'\'' => return self.quoted(first, true),
            b'@' => return self.quoted(first, false),
            b'<' => {
                let length = self.run(|b| b != b'>' && b != b'\n');
                if self.rest().get(length) != Some(&b'>') {
                    return Err(self.error("a path has no end `>`"));
                }
                let text = &self.text[self.at + 1..self.at + length];
                self.at += length + 1;
                return Ok(Token::Text(text.into()));
            }
            mark => {
                self.at += 1;
                return Ok(Token::Mark(mark));
            }
        };
        let word = &self.text[self.at..self.at + length];
        self.at += length;
        Ok(Token::Word(word))
    }

    /// Skips one `mark`, which must be next.
    pub fn expect(&mut self, mark: u8) -> Result<(), UsdError> {
        match self.next()? {
            Token::Mark(found) if found == mark => Ok(()),
            found => Err(self.unexpected(&found, &format!("`{}`", char::from(mark)))),
        }
    }

    /// Skips one `mark` if it is next, and returns whether it was.
    pub fn skip(&mut self, mark: u8) -> Result<bool, UsdError> {
        let is_next = self.peek()? == Token::Mark(mark);
        if is_next {
            self.next()?;
        }
        Ok(is_next)
    }

    /// Skips the rest of what a bracket opened.
    pub fn skip_balanced(&mut self) -> Result<(), UsdError> {
        let mut depth = 1u64;
        while depth > 0 {
            match self.next()? {
                Token::Mark(b'(' | b'[' | b'{') => depth += 1,
                Token::Mark(b')' | b']' | b'}') => depth -= 1,
                Token::End => return Err(self.error("the file ends within brackets; is it cut short?")),
                _ => {}
            }
        }
        Ok(())
    }

    /// Bytes from here on for which `belongs` holds.
    fn run(&self, belongs: impl Fn(u8) -> bool) -> usize {
        self.rest().iter().position(|&b| !belongs(b)).unwrap_or(self.rest().len())
    }

    /// Skips white space, semicolons and comments.
    fn skip_space(&mut self) {
        loop {
            self.at += self.run(|b| b.is_ascii_whitespace() || b == b';');
            if self.rest().first() != Some(&b'#') {
                return;
            }
            self.at += self.run(|b| b != b'\n');
        }
    }

    /// A text between single or triple `quote`s.
    fn quoted(&mut self, quote: u8, has_escapes: bool) -> Result<Token<'a>, UsdError> {
        let marks = if self.rest().starts_with(&[quote; 3]) { 3 } else { 1 };
        let bytes = self.rest();
        let mut end = marks;
        loop {
            match bytes.get(end..) {
                None | Some([]) => return Err(self.error("a text has no end; is the file cut short?")),
                Some([b'\\', ..]) if has_escapes => end += 2,
                Some(rest) if rest.starts_with(&[quote; 3][..marks]) => break,
                Some(_) => end += 1,
            }
        }
        let text = &self.text[self.at + marks..self.at + end];
        self.at += end + marks;
        if !has_escapes || !text.contains('\\') {
            return Ok(Token::Text(text.into()));
        }
        let mut plain = String::with_capacity(text.len());
        let mut characters = text.chars();
        while let Some(character) = characters.next() {
            match character {
                '\\' => plain.extend(characters.next().map(|escaped| match escaped {
                    'n' => '\n',
                    't' => '\t',
                    'r' => '\r',
                    other => other,
                })),
                other => plain.push(other),
            }
        }
        Ok(Token::Text(plain.into()))
    }

    /// The error that `found` stands where `wanted` should.
    pub fn unexpected(&self, found: &Token<'_>, wanted: &str) -> UsdError {
        let found = match found {
            Token::Word(word) => format!("`{word}`"),
            Token::Text(text) => format!("\"{text}\""),
            Token::Mark(mark) => format!("`{}`", char::from(*mark)),
            Token::End => "the end of the file".into(),
        };
        let found: String = found.chars().take(60).collect();
        self.error(format!("{wanted} was expected, but {found} was found"))
    }

    /// An error in the line of the last token.
    pub fn error(&self, words: impl AsRef<str>) -> UsdError {
        let lines = self.text.as_bytes()[..self.at].iter().filter(|&&b| b == b'\n').count();
        let problem = Problem::Invalid(format!("line {}: {}", lines + 1, words.as_ref()));
        FormatError { format: ".usda", offset: self.at as u64, strand: None, problem }.into()
    }
}
