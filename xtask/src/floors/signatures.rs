//! No function takes an anonymous tuple apart in its arguments.
//!
//! `fn f((a, b): (A, B))` hides two arguments in one, so that neither has a name where the function
//! is called. A named struct, or two arguments, names them. Closures are not checked.

use super::files::File;
use super::source::{self, Kind, Token};

/// The functions that take a tuple apart in their arguments, a sentence each.
pub fn check(files: &[File]) -> Vec<String> {
    let mut faults = Vec::new();
    for file in files.iter().filter(|file| file.ending() == "rs") {
        let code = source::mask(&file.text, &[Kind::Code]);
        let tokens = source::tokens(&code);
        for index in 0..tokens.len() {
            if tokens[index].text == "fn"
                && let Some(open) = arguments(&tokens, index + 1)
                && takes_tuple_apart(&tokens, open)
            {
                faults.push(format!(
                    "{}:{}: fn {} takes an anonymous tuple apart; use a named struct or separate arguments",
                    file.path,
                    source::line(&code, tokens[index].at),
                    tokens[index + 1].text
                ));
            }
        }
    }
    faults
}

/// The index of the bracket that opens the arguments of the function whose name is at `name`.
/// `None` for the type of a function pointer.
fn arguments(tokens: &[Token], name: usize) -> Option<usize> {
    if !tokens.get(name)?.text.starts_with(source::is_name) {
        return None;
    }
    let mut index = name + 1;
    if tokens.get(index)?.text == "<" {
        let mut depth = 0;
        loop {
            match tokens.get(index)?.text {
                "<" => depth += 1,
                // The end of `->` closes nothing.
                ">" if tokens[index - 1].text != "-" => depth -= 1,
                _ => {}
            }
            index += 1;
            if depth == 0 {
                break;
            }
        }
    }
    (tokens.get(index)?.text == "(").then_some(index)
}

/// Whether one of the arguments between the bracket at `open` and its end starts with a tuple
/// pattern.
fn takes_tuple_apart(tokens: &[Token], open: usize) -> bool {
    let end = source::closing(tokens, open);
    let mut index = open + 1;
    // Angle brackets matter only here: a comma inside `A<B, C>` starts no argument.
    let mut angles = 0;
    let mut starts = true;
    while index < end {
        let text = tokens[index].text;
        match text {
            "#" if starts => index = source::closing(tokens, index + 1),
            "&" | "mut" if starts => {}
            "(" if starts => return true,
            "(" | "[" | "{" => index = source::closing(tokens, index),
            "<" => angles += 1,
            ">" if tokens[index - 1].text != "-" => angles -= 1,
            _ => {}
        }
        starts = (starts && matches!(text, "#" | "&" | "mut")) || (text == "," && angles == 0);
        index += 1;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(text: &str) -> Vec<String> {
        check(&[File { path: "a.rs".into(), text: text.into() }])
    }

    #[test]
    fn tuple_patterns_are_refused() {
        for text in [
            "\nfn f((a, b): (A, B)) {}",
            "\nfn f<T: Fn(A) -> B, const N: usize>(a: A<B, C>, (b, c): (B, C)) {}",
            "\npub(crate) const unsafe fn f(&self, &(a, b): &(A, B)) {}",
            "\nimpl A { fn f(self, #[x(y)] (mut a, _): (A, B),) {} }",
        ] {
            let found = faults(text);
            assert!(
                matches!(&found[..], [one] if one.starts_with("a.rs:2: fn f takes")),
                "{text}: {found:?}"
            );
        }
    }

    #[test]
    fn names_and_closures_are_allowed() {
        for text in [
            "fn f(pair: (A, B), g: fn((A, B)) -> C, h: impl Fn((A, B))) { x.map(|(a, b): (A, B)| a) }",
            "fn f(a: A<(B, C), (D, E)>, [x, y]: [f32; 2], Named { a, b }: Named, New(c): New) {}",
            "// fn f((a, b): (A, B)) {}\nconst A: &str = \"fn f((a, b): (A, B)) {}\";",
            "macro_rules! fn_of { ($(($a:ident)),*) => {} }",
        ] {
            assert!(faults(text).is_empty(), "{text}: {:?}", faults(text));
        }
    }
}
