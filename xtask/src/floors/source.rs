//! Splits source text into code, comments and literals, and code into tokens.
//!
//! A small lexer for Rust and WGSL. It knows nested block comments, raw strings, and the difference
//! between a character literal and a lifetime; it does not parse expressions.

/// What a byte of a source file belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Code,
    Comment,
    /// A string or character literal, with its quotes.
    Literal,
}

/// A name, a number, `::`, or one character of punctuation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Token<'a> {
    pub text: &'a str,
    /// The byte at which it starts.
    pub at: usize,
}

/// The kind of each byte of `text`.
pub fn classify(text: &str) -> Vec<Kind> {
    let bytes = text.as_bytes();
    let mut kinds = vec![Kind::Code; bytes.len()];
    let mut at = 0;
    while at < bytes.len() {
        let (kind, length) = piece(&bytes[at..]);
        let end = bytes.len().min(at + length);
        kinds[at..end].fill(kind);
        at = end;
    }
    kinds
}

/// `text` with a space in place of each byte whose kind is not in `kept`. Line breaks and offsets
/// stay.
pub fn mask(text: &str, kept: &[Kind]) -> String {
    let kinds = classify(text);
    let bytes = text.bytes().zip(kinds);
    let masked: Vec<u8> =
        bytes.map(|(byte, kind)| if byte == b'\n' || kept.contains(&kind) { byte } else { b' ' }).collect();
    String::from_utf8_lossy(&masked).into_owned()
}

/// The tokens of a text in which comments and literals are masked.
pub fn tokens(code: &str) -> Vec<Token<'_>> {
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(first) = code[at..].chars().next() {
        let length = match first {
            c if is_name(c) => code[at..].find(|c| !is_name(c)).unwrap_or(code.len() - at),
            ':' if code[at..].starts_with("::") => 2,
            c => c.len_utf8(),
        };
        if !first.is_whitespace() {
            found.push(Token { text: &code[at..at + length], at });
        }
        at += length;
    }
    found
}

/// The line of byte `at`, counted from 1.
pub fn line(text: &str, at: usize) -> usize {
    1 + text.as_bytes()[..at].iter().filter(|&&byte| byte == b'\n').count()
}

/// The index of the bracket that closes the one at `open`, or the last index if none does.
pub fn closing(tokens: &[Token], open: usize) -> usize {
    let mut depth = 0;
    for (index, token) in tokens.iter().enumerate().skip(open) {
        match token.text {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return index;
        }
    }
    tokens.len() - 1
}

/// Whether a name can hold `c`.
pub fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The kind and the length in bytes of the first piece of `rest`.
fn piece(rest: &[u8]) -> (Kind, usize) {
    match rest {
        [b'/', b'/', ..] => {
            (Kind::Comment, rest.iter().position(|&byte| byte == b'\n').unwrap_or(rest.len()))
        }
        [b'/', b'*', ..] => (Kind::Comment, block_comment(rest)),
        [b'"', ..] => (Kind::Literal, quoted(rest, b'"')),
        [b'\'', b'\\', ..] => (Kind::Literal, quoted(rest, b'\'')),
        [b'\'', first, ..] => {
            // A lifetime has no quote after its first character.
            let length = 1 + utf8_length(*first);
            if rest.get(length) == Some(&b'\'') { (Kind::Literal, length + 1) } else { (Kind::Code, 1) }
        }
        [first, ..] if is_name(char::from(*first)) => {
            let length = rest.iter().position(|&byte| !is_name(char::from(byte))).unwrap_or(rest.len());
            match &rest[..length] {
                b"r" | b"br" | b"cr" => match raw_string(&rest[length..]) {
                    Some(more) => (Kind::Literal, length + more),
                    None => (Kind::Code, length),
                },
                _ => (Kind::Code, length),
            }
        }
        _ => (Kind::Code, 1),
    }
}

/// The bytes of the UTF-8 character that starts with `first`.
fn utf8_length(first: u8) -> usize {
    match first.leading_ones() {
        0 => 1,
        ones => ones as usize,
    }
}

/// The length of the literal at the start of `rest`, with both its quotes.
fn quoted(rest: &[u8], quote: u8) -> usize {
    let mut at = 1;
    while at < rest.len() && rest[at] != quote {
        at += if rest[at] == b'\\' { 2 } else { 1 };
    }
    at + 1
}

/// The length of `#"…"#` with any number of `#`; `None` if no such string starts here.
fn raw_string(rest: &[u8]) -> Option<usize> {
    let hashes = rest.iter().take_while(|&&byte| byte == b'#').count();
    if rest.get(hashes) != Some(&b'"') {
        return None;
    }
    let end = [&b"\""[..], &rest[..hashes]].concat();
    let body = &rest[hashes + 1..];
    let length = body.windows(end.len()).position(|window| window == end).unwrap_or(body.len());
    Some(hashes + 1 + length + end.len())
}

fn block_comment(rest: &[u8]) -> usize {
    let mut depth = 0;
    let mut at = 0;
    while at < rest.len() {
        let step = if rest[at..].starts_with(b"/*") {
            depth += 1;
            2
        } else if rest[at..].starts_with(b"*/") {
            depth -= 1;
            2
        } else {
            1
        };
        at += step;
        if depth == 0 {
            break;
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_literals_are_separated_from_code() {
        let text = r####"a /* b /* c */ d */ "e // \" f" g 'h' 'i: '\'' r#"j " k"# 'é' for r#l // m
n"####;
        let code = mask(text, &[Kind::Code]);
        let words: Vec<&str> = code.split_whitespace().collect();
        assert_eq!(words, ["a", "g", "'i:", "for", "r#l", "n"]);
        assert_eq!(code.len(), text.len());
        assert_eq!(line(text, text.len() - 1), 2);
        let comments = mask(text, &[Kind::Comment]);
        assert_eq!(
            comments.split_whitespace().collect::<Vec<_>>(),
            "/* b /* c */ d */ // m".split(' ').collect::<Vec<_>>()
        );
    }

    #[test]
    fn tokens_keep_their_place() {
        let code = "use crate::{a};";
        let found: Vec<&str> = tokens(code).iter().map(|token| token.text).collect();
        assert_eq!(found, ["use", "crate", "::", "{", "a", "}", ";"]);
        let found = tokens(code);
        assert_eq!(found[4].at, 12);
        assert_eq!(closing(&found, 3), 5);
    }
}
