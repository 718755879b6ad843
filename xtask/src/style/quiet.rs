//! Crates that promise to do no input or output, and to read no clock and no environment.

use std::collections::{BTreeMap, BTreeSet};

use super::markdown::section;
use super::modules::modules;
use super::names::Names;

/// The modules and types of the standard library that such a crate does not name.
const PATHS: [&[&str]; 10] = [
    &["std", "fs"],
    &["std", "env"],
    &["std", "process"],
    &["std", "net"],
    &["std", "os"],
    &["std", "time", "Instant"],
    &["std", "time", "SystemTime"],
    &["std", "io", "stdin"],
    &["std", "io", "stdout"],
    &["std", "io", "stderr"],
];

/// The macros that print.
const MACROS: [&str; 5] = ["print", "println", "eprint", "eprintln", "dbg"];

/// The places where a crate breaks its promise. Tests, benches and examples may print.
pub(crate) fn check(files: &BTreeMap<String, String>, root: &str) -> Vec<String> {
    let mut findings = Vec::new();
    for module in modules(files, root) {
        let names = Names::new(&module.code);
        let uses = names.uses.iter().map(|import| &import.path);
        let paths: BTreeSet<_> = uses.chain(&names.paths).collect();
        for path in paths.into_iter().filter(|path| is_refused(path)) {
            findings.push(format!(
                "{}: {}: the crate promises no I/O",
                module.file,
                path.join("::")
            ));
        }
        for name in MACROS.iter().filter(|name| names.macros.contains(**name)) {
            findings.push(format!("{}: {name}!: the crate promises no I/O", module.file));
        }
    }
    findings
}

/// Whether a path starts with one of [`PATHS`].
fn is_refused(path: &[String]) -> bool {
    let starts = |refused: &&[&str]| {
        path.len() >= refused.len() && path.iter().zip(*refused).all(|(a, b)| a == b)
    };
    PATHS.iter().any(starts)
}

/// The crates that a page promises to be so, below its heading "Invariants": the names in backticks
/// in front of the words "no input or output", in the same item of a list.
pub(crate) fn promised(page: &str) -> BTreeSet<String> {
    let promise = |text| str::split_once(text, "no input or output");
    let Some((before, _)) = section(page, "Invariants").and_then(promise) else {
        return BTreeSet::new();
    };
    let item = before.rsplit("\n- ").next().unwrap_or_default();
    item.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn input_and_output_are_found_outside_of_tests() {
        let text = "use std::{fmt, fs::File};\nfn f() { println!(\"\"); std::time::Instant::now(); }\n\
                    use std::time::Duration; use std::io::Write; // std::env\n\
                    #[cfg(test)]\nmod tests { fn g() { std::process::exit(1); } }";
        let files = BTreeMap::from([("crates/a/src/lib.rs".to_owned(), text.to_owned())]);
        let findings = check(&files, "crates/a/src/lib.rs");
        let said = |what: &str| format!("crates/a/src/lib.rs: {what}: the crate promises no I/O");
        let expected = ["std::fs::File", "std::time::Instant::now", "println!"].map(said);
        assert_eq!(findings, expected);
    }

    #[test]
    fn the_promise_is_an_item_of_the_page() {
        let page = "# A\n`a` does no input or output.\n\n## Invariants\n\n- `x` never sees y.\n- `field`, `trace`\n  and `warp` do no input or output, and\n  `z`.\n";
        let names = ["field", "trace", "warp"].map(str::to_owned);
        assert_eq!(promised(page), BTreeSet::from(names));
        assert!(promised("# A\n\n## Invariants\n\n- `a` does input.").is_empty());
    }
}
