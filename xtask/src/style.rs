//! `cargo xtask style`: facts about the code and its documentation that no other tool checks.

mod circles;
mod crates;
mod markdown;
mod modules;
mod names;
mod paths;
mod quiet;
mod results;
mod source;
mod streams;
mod typed;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use anyhow::{Context, bail, ensure};

pub(crate) use crates::dependencies;
use paths::Tree;
pub(crate) use source::Source;

/// Packages that a renderer can be built of without a network, and the packages that they therefore
/// do not reach.
const WITHOUT_NETWORKS: [&str; 4] =
    ["dsdf-render", "dsdf-estimate", "dsdf-dataset", "dsdf-multiview"];
const NETWORKS: [&str; 3] = ["dsdf-sdf-nn", "sdf-nn", "safetensors"];

/// The crates that do no input or output, and read no clock and no environment. The invariants in
/// the documentation promise it of the same ones.
const QUIET: [&str; 15] = [
    "boundary",
    "estimate",
    "export",
    "field",
    "inspect",
    "lanes",
    "loss",
    "metrics",
    "multiview",
    "optim",
    "random",
    "render",
    "sdf-nn",
    "trace",
    "warp",
];

/// The programs, and the extension of Python: their errors have context in place of types. Errors of
/// libraries have types, so that a caller can tell them apart.
const WITH_CONTEXT: [&str; 4] = ["crates/app", "crates/fuzz", "crates/python", "xtask"];

/// The page about the crates and their invariants.
const ARCHITECTURE: &str = "docs/architecture.md";

/// Checks all facts, and lists the places that are wrong.
///
/// # Errors
/// If a place is wrong, or a file cannot be read.
pub(crate) fn run() -> anyhow::Result<()> {
    let findings = Repository::read(&sweep::measure::workspace_root())?.findings()?;
    if findings.is_empty() {
        return Ok(());
    }
    for finding in &findings {
        eprintln!("{finding}");
    }
    bail!("{} places are wrong", findings.len());
}

/// The files under version control.
struct Repository {
    tree: Tree,
    /// The text of files of Rust and Markdown, and of the programs beside them, by name.
    texts: BTreeMap<String, String>,
    /// The folders of the workspace's members.
    members: BTreeSet<String>,
}

impl Repository {
    fn read(root: &Path) -> anyhow::Result<Self> {
        let output = Command::new("git").arg("ls-files").current_dir(root).output();
        let output = output.context("cannot start git")?;
        let error = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "git ls-files: {error}");
        let names = String::from_utf8(output.stdout)?;
        // A file that was removed is tracked until the next commit.
        let names: Vec<&str> = names.lines().filter(|name| root.join(name).exists()).collect();
        let is_text = |name: &&&str| TEXTS.iter().any(|end| name.ends_with(end));
        let text = |name: &&str| {
            let text = std::fs::read_to_string(root.join(name)).with_context(|| (*name).to_owned());
            Ok(((*name).to_owned(), text?))
        };
        let texts = names.iter().filter(is_text).map(text).collect::<anyhow::Result<_>>()?;
        Ok(Repository { tree: Tree::new(names), texts, members: crates::members()? })
    }

    fn findings(&self) -> anyhow::Result<Vec<String>> {
        let mut findings = Vec::new();
        for package in WITHOUT_NETWORKS {
            findings.extend(match crates::reached(package, &NETWORKS) {
                Ok(reached) => {
                    reached.into_iter().map(|to| format!("{package} reaches {to}")).collect()
                }
                Err(error) => vec![error.to_string()],
            });
        }
        let with_context = crates::dependents("anyhow")?;
        let checked = BTreeSet::from(WITH_CONTEXT.map(str::to_owned));
        findings.extend(with_context.symmetric_difference(&checked).map(|folder| {
            if checked.contains(folder) {
                format!("{folder} has typed errors: remove it from WITH_CONTEXT")
            } else {
                format!("{folder} depends on anyhow: its errors have no types")
            }
        }));
        findings.extend(self.about_architecture()?);
        let (circles, others) = self.about_modules();
        findings.extend(others);
        findings.extend(circles);
        findings.extend(streams::check(&self.texts));
        for (name, text) in &self.texts {
            findings.extend(self.about_text(name, text));
        }
        Ok(findings)
    }

    /// The table of crates, the picture of their layers, and the promise of no input and output.
    fn about_architecture(&self) -> anyhow::Result<Vec<String>> {
        let page = self.texts.get(ARCHITECTURE).context(ARCHITECTURE)?;
        let mut findings = crates::table(page, &self.members);
        findings.extend(crates::layers(page, &self.members, &dependencies()?));
        let promised = quiet::promised(page);
        let checked = BTreeSet::from(QUIET.map(str::to_owned));
        let difference = promised.symmetric_difference(&checked);
        findings.extend(difference.map(|name| {
            let place = if checked.contains(name) {
                "the page promises it not"
            } else {
                "QUIET in xtask/src/style.rs lacks it"
            };
            format!("`{name}` does no input or output: {place}")
        }));
        Ok(findings.into_iter().map(|finding| format!("{ARCHITECTURE}: {finding}")).collect())
    }

    /// The circles of files in each crate, and input and output in crates that promise none.
    fn about_modules(&self) -> (Vec<String>, Vec<String>) {
        let (mut found, mut findings) = (Vec::new(), Vec::new());
        for member in &self.members {
            let start = format!("{member}/src/");
            let files: BTreeMap<_, _> = self.texts.range(start.clone()..).collect();
            let files = files.into_iter().take_while(|(name, _)| name.starts_with(&start));
            let files = files.map(|(name, text)| (name.clone(), text.clone())).collect();
            for root in ["lib.rs", "main.rs"].map(|file| format!("{start}{file}")) {
                found.extend(circles::circles(&files, &root));
                if QUIET.iter().any(|name| *member == format!("crates/{name}")) {
                    findings.extend(quiet::check(&files, &root));
                }
            }
        }
        (found, findings)
    }

    /// The links, paths and numbers of a file.
    fn about_text(&self, name: &str, text: &str) -> Vec<String> {
        // Measured results are written by programs. The changes name files of their time.
        if name.starts_with("docs/results/") {
            return Vec::new();
        }
        let is_markdown = name.ends_with(".md");
        let mut findings = Vec::new();
        if is_markdown {
            findings.extend(crate::record::check_page(
                name,
                text,
                &sweep::measure::workspace_root(),
            ));
            if name == "README.md" || name.starts_with("docs/") {
                findings.extend(typed::check(name, text));
            }
            findings.extend(paths::check_links(name, text, &self.tree));
            findings.extend(results::check(name, text, |file| {
                let path = sweep::measure::workspace_root().join(file);
                std::fs::read_to_string(path).with_context(|| file.to_owned())
            }));
        }
        if name != "CHANGELOG.md" {
            let of_rust = name.ends_with(".rs").then(|| Source::new(text).prose());
            let prose = of_rust.as_deref().unwrap_or(text);
            findings.extend(paths::check_paths(name, prose, &self.tree));
            findings.extend(paths::check_crates(name, prose, &self.crates()));
        }
        findings
    }

    /// The names of the members and of the packages that they use.
    fn crates(&self) -> BTreeSet<String> {
        let folders = self.members.iter().filter_map(|folder| folder.rsplit('/').next());
        let lock = self.texts.get("Cargo.lock").map_or("", String::as_str);
        let packages =
            lock.lines().filter_map(|line| line.strip_prefix("name = \"")?.strip_suffix('"'));
        folders.chain(packages).map(str::to_owned).collect()
    }
}

/// The ends of the names of texts that are checked.
const TEXTS: [&str; 5] = [".rs", ".md", ".sh", ".toml", "Cargo.lock"];
