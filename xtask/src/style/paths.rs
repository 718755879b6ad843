//! Links and paths in the text: the files that they name exist.

use std::collections::BTreeSet;

use super::markdown::{code_spans, links, prose};

/// The files of the repository, and their folders.
pub(crate) struct Tree(BTreeSet<String>);

impl Tree {
    /// The tree of files with these names.
    pub(crate) fn new<'a>(files: impl IntoIterator<Item = &'a str>) -> Self {
        let mut all = BTreeSet::from([String::new()]);
        for file in files {
            let ends = file.match_indices('/').map(|(at, _)| at).chain([file.len()]);
            all.extend(ends.map(|end| file[..end].to_owned()));
        }
        Tree(all)
    }

    /// Whether a path from a folder names a file or a folder. Both use `/`.
    fn has(&self, folder: &str, path: &str) -> bool {
        let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
        for part in path.split('/') {
            match part {
                "" | "." => {}
                ".." if parts.pop().is_none() => return false,
                ".." => {}
                part => parts.push(part),
            }
        }
        self.0.contains(&parts.join("/"))
    }

    /// Whether any file has this name, or ends in this path.
    fn has_name(&self, name: &str) -> bool {
        let ends = |file: &String| file.strip_suffix(name).is_some_and(|rest| rest.ends_with('/'));
        self.0.contains(name) || self.0.iter().any(ends)
    }
}

/// The relative links of a Markdown file that lead to no file.
pub(crate) fn check_links(name: &str, text: &str, tree: &Tree) -> Vec<String> {
    let folder = folder(name);
    let mut findings = Vec::new();
    for (number, line) in prose(text) {
        for link in links(line) {
            let target = link.split('#').next().unwrap_or_default();
            let is_elsewhere = link.contains("://") || link.starts_with("mailto:");
            // Documentation comments link to items: `[a](crate::b)`.
            if !is_elsewhere && !link.contains("::") && !tree.has(folder, target) {
                findings.push(format!("{name}:{number}: the link to {link} leads to no file"));
            }
        }
    }
    findings
}

/// The paths in backticks that name no file. `text` is Markdown, or the comments of a program.
pub(crate) fn check_paths(name: &str, text: &str, tree: &Tree) -> Vec<String> {
    let mut findings = Vec::new();
    for (number, line) in prose(text) {
        for path in code_spans(line).filter(|span| is_path(span)) {
            let crate_folder = crate_folder(name);
            let bases = ["", "crates", &crate_folder, folder(name)];
            let is_file = bases.iter().any(|base| tree.has(base, path));
            let is_name = !path.contains('/') && tree.has_name(path);
            if !is_file && !is_name {
                findings.push(format!("{name}:{number}: `{path}` is no file or folder here"));
            }
        }
    }
    findings
}

/// The crates that a text names with the word "crate" and that are neither members of the workspace
/// nor packages that it uses.
pub(crate) fn check_crates(name: &str, text: &str, known: &BTreeSet<String>) -> Vec<String> {
    let mut findings = Vec::new();
    for (number, line) in prose(text) {
        for (at, _) in line.match_indices("crate `") {
            let is_word = !line[..at].ends_with(char::is_alphanumeric);
            let named = line[at..].split('`').nth(1).unwrap_or_default();
            if is_word && !named.is_empty() && !known.contains(named) {
                findings.push(format!("{name}:{number}: there is no crate `{named}`"));
            }
        }
    }
    findings
}

/// Whether text in backticks is meant as a path of the repository.
fn is_path(text: &str) -> bool {
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || "._-/".contains(c);
    let parts: Vec<&str> = text.trim_end_matches('/').split('/').collect();
    // A name in capitals stands for any: `crates/NAME/src`.
    let is_any = |part: &&str| part.len() > 1 && part.chars().all(|c| c.is_ascii_uppercase());
    if !text.chars().all(is_allowed) || parts[0].is_empty() || parts.iter().any(is_any) {
        return false;
    }
    let starts = ["crates", "docs", "xtask", "tests", ".ci", ".cargo"];
    let inside = ["src", "tests", "benches", "examples"];
    let has_folders = starts.contains(&parts[0]) || parts[1..].iter().any(|p| inside.contains(p));
    let is_rust = text.strip_suffix(".rs").is_some_and(|stem| !stem.is_empty());
    parts.len() > 1 && has_folders || is_rust
}

fn folder(name: &str) -> &str {
    name.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// The folder of the crate that a file belongs to.
fn crate_folder(name: &str) -> String {
    let depth = if name.starts_with("crates/") { 2 } else { 1 };
    name.split('/').take(depth).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree() -> Tree {
        Tree::new(["README.md", "docs/a.md", "crates/fit/src/run.rs", "crates/fit/tests/x/y.rs"])
    }

    #[test]
    fn a_link_leads_to_a_file_or_a_folder() {
        let text = "[a](a.md#b) [c](../crates/fit) ![d](../d.png) [e](https://x.y/z) [f](#f)\n\
                    ```\n[g](g.md)\n```\n[h](../../h)\n";
        let findings = check_links("docs/a.md", text, &tree());
        let lost = ["docs/a.md:1: the link to ../d.png", "docs/a.md:5: the link to ../../h"];
        assert_eq!(findings, lost.map(|start| format!("{start} leads to no file")));
    }

    #[test]
    fn a_path_in_backticks_names_a_file() {
        let good = "`crates/fit/src/run.rs`, `fit/src`, `run.rs`, `src/run.rs`, `tests/x`, `x/y`, \
                    `crates/NAME/src`, `docs/*.md`, `a + b/src`, `x.rs.bak`, `target/ci`, `fit`";
        assert_eq!(check_paths("crates/fit/src/run.rs", good, &tree()), [""; 0]);
        for bad in ["crates/old", "old/src/run.rs", "fit/src/old.rs", "old.rs", "docs/b.md"] {
            let findings = check_paths("docs/a.md", &format!("\n`{bad}`"), &tree());
            assert_eq!(findings, [format!("docs/a.md:2: `{bad}` is no file or folder here")]);
        }
    }

    #[test]
    fn a_named_crate_exists() {
        let known = BTreeSet::from(["fit".to_owned()]);
        let text = "The crate `fit`, and the crate `old`; crates `x`.";
        assert_eq!(check_crates("a.md", text, &known), ["a.md:1: there is no crate `old`"]);
    }
}
