//! The names of random decisions: `Name::new("…", N)`.
//!
//! Two names with one number would give two decisions the same random numbers.

use std::collections::BTreeMap;

use super::source::Source;

/// The crate that defines names; it declares none.
const DEFINES: &str = "crates/random/";

const CALL: &str = "Name::new(";

/// The declarations of names in `crates/*/src` whose text or number another one has, and those that
/// are no literals. Names in modules of tests do not count.
pub(crate) fn check(texts: &BTreeMap<String, String>) -> Vec<String> {
    let mut findings = Vec::new();
    let (mut of_text, mut of_number) = (BTreeMap::new(), BTreeMap::new());
    for (file, text) in texts.iter().filter(|(file, _)| is_checked(file)) {
        for (line, declared) in declarations(text) {
            let place = format!("{file}:{line}");
            let Some((text, number)) = declared else {
                findings.push(format!("{place}: the text and the number of a name are literals"));
                continue;
            };
            if let Some(other) = of_text.insert(text.clone(), place.clone()) {
                findings.push(format!("{place}: {other} has the name \"{text}\", too"));
            }
            if let Some(other) = of_number.insert(number, place.clone()) {
                findings.push(format!("{place}: {other} has the number {number} of a name, too"));
            }
        }
    }
    findings
}

fn is_checked(file: &str) -> bool {
    let mut parts = file.split('/');
    let is_source = parts.next() == Some("crates") && parts.nth(1) == Some("src");
    is_source && file.ends_with(".rs") && !file.starts_with(DEFINES)
}

/// The declarations in a file, each with its line: text and number, if they are literals.
fn declarations(text: &str) -> Vec<(usize, Option<(String, u64)>)> {
    // Both have the same characters in the same places, apart from blanks.
    let code: Vec<char> = Source::new(text).code.chars().collect();
    let text: Vec<char> = text.chars().collect();
    let call: Vec<char> = CALL.chars().collect();
    let is_call = |at: &usize| {
        let follows_a_letter = *at > 0 && (code[at - 1].is_alphanumeric() || code[at - 1] == '_');
        code[*at..].starts_with(&call) && !follows_a_letter
    };
    let declaration = |at: usize| {
        let line = 1 + code[..at].iter().filter(|c| **c == '\n').count();
        let after: String = text[at + call.len()..].iter().collect();
        (line, literals(&after))
    };
    (0..code.len()).filter(is_call).map(declaration).collect()
}

/// The text and the number at the start of arguments.
fn literals(arguments: &str) -> Option<(String, u64)> {
    let (text, after) = arguments.trim_start().strip_prefix('"')?.split_once('"')?;
    let (number, _) = after.trim_start().strip_prefix(',')?.split_once(')')?;
    let number = number.trim().trim_end_matches(',').replace('_', "");
    Some((text.to_owned(), number.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings(files: &[(&str, &str)]) -> Vec<String> {
        let text = |(name, text): &(&str, &str)| ((*name).to_owned(), (*text).to_owned());
        check(&files.iter().map(text).collect())
    }

    #[test]
    fn two_names_share_neither_text_nor_number() {
        let one = "// θ: Name::new(\"a\", 2)\nconst A: Name = Name::new(\"a\", 1);\n";
        let two = "const B: Name = random::Name::new(\n    \"b\",\n    2,\n);\n";
        let same_number = "const C: Name = Name::new(\"c\", 1);\n";
        let same_text = "\nconst D: Name = Name::new(\"b\", 4);\n";
        let (x, y) = ("crates/x/src/lib.rs", "crates/y/src/deep/file.rs");
        assert!(findings(&[(x, one), (y, two)]).is_empty());
        let found =
            "crates/y/src/deep/file.rs:1: crates/x/src/lib.rs:2 has the number 1 of a name, too";
        assert_eq!(findings(&[(x, one), (y, same_number)]), [found]);
        let found = "crates/y/src/deep/file.rs:2: crates/x/src/lib.rs:1 has the name \"b\", too";
        assert_eq!(findings(&[(x, two), (y, same_text)]), [found]);
    }

    #[test]
    fn names_are_literals() {
        let text = "fn f(n: u64) { Name::new(\"a\", n); FileName::new(n); Name::other(\"a\"); }";
        let found = "crates/x/src/lib.rs:1: the text and the number of a name are literals";
        assert_eq!(findings(&[("crates/x/src/lib.rs", text)]), [found]);
        // Tests, other folders, and the crate that defines names.
        let inside = format!("#[cfg(test)]\nmod tests {{ {text} }}");
        let others = ["tests/src/lib.rs", "crates/x/tests/a.rs", "crates/random/src/name.rs"];
        assert!(findings(&[("crates/x/src/lib.rs", &inside)]).is_empty());
        assert!(findings(&others.map(|name| (name, text))).is_empty());
    }
}
