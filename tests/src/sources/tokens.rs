//! Words and signs of a source.

use super::code;
use std::collections::BTreeSet;

/// Words and signs of a source, in order, without comments, strings and characters; `::` is one sign.
#[must_use]
pub fn tokens(source: &str) -> Vec<String> {
    let code: Vec<char> = code(source).chars().collect();
    let (mut out, mut i) = (Vec::new(), 0);
    while i < code.len() {
        let c = code[i];
        if c.is_alphanumeric() || c == '_' {
            let end = (i..code.len()).find(|&k| !(code[k].is_alphanumeric() || code[k] == '_')).unwrap_or(code.len());
            out.push(code[i..end].iter().collect());
            i = end;
        } else if c == '\'' {
            i = after_quote(&code, i);
        } else if c == ':' && code.get(i + 1) == Some(&':') {
            out.push("::".into());
            i += 2;
        } else {
            if !c.is_whitespace() {
                out.push(c.into());
            }
            i += 1;
        }
    }
    out
}

/// What follows a character, or the sign of a lifetime, that begins at `i`.
fn after_quote(code: &[char], i: usize) -> usize {
    match (code.get(i + 1), code.get(i + 2)) {
        (Some('\\'), _) => (i + 3..code.len()).find(|&k| code[k] == '\'').map_or(code.len(), |end| end + 1),
        (Some(_), Some('\'')) => i + 3,
        _ => i + 1,
    }
}

/// Tokens without what is compiled for tests alone, and the names of the modules in files of their own that are.
#[must_use]
pub fn without_tests(tokens: &[String]) -> (Vec<String>, BTreeSet<String>) {
    let (mut out, mut modules, mut i) = (Vec::new(), BTreeSet::new(), 0);
    while i < tokens.len() {
        if !is_for_tests(&tokens[i..]) {
            out.push(tokens[i].clone());
            i += 1;
            continue;
        }
        while tokens.get(i).is_some_and(|t| t == "#") {
            i = closed(tokens, i + 1) + 1;
        }
        if let Some(m) = (i..(i + 5).min(tokens.len())).find(|&k| tokens[k] == "mod")
            && tokens.get(m + 2).is_some_and(|t| t == ";")
        {
            modules.insert(tokens[m + 1].clone());
        }
        i = end_of_item(tokens, i);
    }
    (out, modules)
}

/// Whether an attribute begins here that says `cfg(test)` or `cfg(all(test, ..))`.
fn is_for_tests(tokens: &[String]) -> bool {
    let begins = |with: &[&str]| tokens.len() >= with.len() && with.iter().zip(tokens).all(|(a, b)| a == b);
    begins(&["#", "[", "cfg", "(", "test", ")"]) || begins(&["#", "[", "cfg", "(", "all", "(", "test", ","])
}

/// The bracket that closes the one at `i`, or the last token.
pub(super) fn closed(tokens: &[String], i: usize) -> usize {
    let mut depth = 0;
    for (k, token) in tokens.iter().enumerate().skip(i) {
        match token.as_str() {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return k;
        }
    }
    tokens.len() - 1
}

/// What follows the item at `i`: behind its `;`, or behind its braces.
fn end_of_item(tokens: &[String], mut i: usize) -> usize {
    // What a module uses stands behind its brace.
    let is_use = tokens[i..].iter().take_while(|t| *t != "{").take(5).any(|t| t == "use");
    while i < tokens.len() {
        match tokens[i].as_str() {
            ";" => return i + 1,
            "{" if !is_use => return closed(tokens, i) + 1,
            "(" | "[" | "{" => i = closed(tokens, i) + 1,
            _ => i += 1,
        }
    }
    i
}
