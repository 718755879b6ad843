//! `cargo xtask style`: rules of the text that no other tool checks.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, bail, ensure};

/// The widest line of code, comments and Markdown, in characters.
const WIDTH: usize = 100;

/// First characters of lines of Markdown that may be wider: formulas, tables, names and pictures.
const UNBROKEN: [char; 4] = ['$', '|', '`', '!'];

/// The most lines of a Rust file.
const FILE_LINES: usize = 500;

/// The most lines of Rust in a crate.
const CRATE_LINES: usize = 4000;

/// Checks every tracked Rust and Markdown file, and lists the places that break a rule.
///
/// # Errors
/// If a rule is broken, or a file cannot be read.
pub(crate) fn run() -> anyhow::Result<()> {
    let root = sweep::measure::dsdf::root();
    let mut findings = Vec::new();
    let mut crate_lines = std::collections::BTreeMap::<String, usize>::new();
    for name in tracked(&root)? {
        let text = std::fs::read_to_string(root.join(&name)).with_context(|| name.clone())?;
        check_lines(&name, &text, &mut findings);
        if let Some(package) = name.strip_prefix("crates/").and_then(|rest| rest.split('/').next())
            && name.ends_with(".rs")
        {
            *crate_lines.entry(package.to_owned()).or_default() += text.lines().count();
        }
    }
    for (package, lines) in crate_lines.into_iter().filter(|(_, lines)| *lines > CRATE_LINES) {
        findings.push(format!("crates/{package}: {lines} lines, at most {CRATE_LINES}"));
    }
    if findings.is_empty() {
        return Ok(());
    }
    for finding in &findings {
        eprintln!("{finding}");
    }
    bail!("{} places break a rule of the text", findings.len());
}

/// The Rust and Markdown files under version control, without generated results.
fn tracked(root: &Path) -> anyhow::Result<Vec<String>> {
    let output = Command::new("git")
        .args(["ls-files", "*.rs", "*.md"])
        .current_dir(root)
        .output()
        .context("cannot start git")?;
    ensure!(output.status.success(), "git ls-files: {}", String::from_utf8_lossy(&output.stderr));
    let names = String::from_utf8(output.stdout)?;
    let written = |name: &&str| !name.starts_with("docs/results/");
    Ok(names.lines().filter(written).map(str::to_owned).collect())
}

fn check_lines(name: &str, text: &str, findings: &mut Vec<String>) {
    for (number, line) in text.lines().enumerate() {
        let mut report = |rule: String| findings.push(format!("{name}:{}: {rule}", number + 1));
        let width = line.chars().count();
        let may_be_wide = name.ends_with(".md") && line.starts_with(UNBROKEN);
        if width > WIDTH && !may_be_wide {
            report(format!("{width} characters wide, at most {WIDTH}"));
        }
        let prose = if name.ends_with(".md") { Some(line) } else { comment(line) };
        if prose.is_some_and(has_what_clause) {
            report("a clause with \"what\" in place of a noun: name the thing".to_owned());
        }
    }
    let lines = text.lines().count();
    if name.ends_with(".rs") && lines > FILE_LINES {
        findings.push(format!("{name}: {lines} lines, at most {FILE_LINES}"));
    }
}

/// The text of a line that is a comment.
fn comment(line: &str) -> Option<&str> {
    let text = line.trim_start().strip_prefix("//")?;
    Some(text.trim_start_matches(['/', '!']).trim_start())
}

/// Words before a clause whose subject or object is "what".
const BEFORE_CLAUSE: [&str; 16] = [
    "of", "on", "with", "from", "to", "by", "for", "in", "is", "are", "as", "and", "than", "like",
    "at", "about",
];

/// Whether a line of prose has a clause with "what" in place of a noun.
fn has_what_clause(prose: &str) -> bool {
    let words: Vec<&str> = prose.split_whitespace().collect();
    let what = |word: &str| word == "what" || word == "What";
    let capitalised = |word: &str| word.chars().next().is_some_and(char::is_uppercase);
    words.first().is_some_and(|first| what(first))
        || words.windows(2).enumerate().any(|(i, pair)| {
            let starts = i == 0 && capitalised(pair[0]);
            what(pair[1]) && (starts || BEFORE_CLAUSE.contains(&pair[0]))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_reported_with_their_place() {
        let text =
            format!("/// Returns \u{77}hat is seen.\nlet ok = 1; // what\n{}\n", "é".repeat(101));
        let mut findings = Vec::new();
        check_lines("a.rs", &text, &mut findings);
        assert_eq!(findings.len(), 2, "{findings:?}");
        assert!(findings[0].starts_with("a.rs:1:") && findings[1].starts_with("a.rs:3:"));
        findings.clear();
        check_lines("a.md", "It depends on what it is for.\nIt says what.\n", &mut findings);
        assert_eq!(findings.len(), 1, "{findings:?}");
        findings.clear();
        check_lines("a.rs", &"x\n".repeat(501), &mut findings);
        assert_eq!(findings, ["a.rs: 501 lines, at most 500"]);
    }
}
