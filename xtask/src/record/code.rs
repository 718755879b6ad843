//! Digests of code: whether a row of the record is older than what it measures.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};

use crate::style::{Source, dependencies};

/// The length of a digest, in hexadecimal digits.
const DIGITS: usize = 12;

/// The code of the workspace: the text of each file without comments, tests, blank space and the
/// content of strings, by its name.
pub(crate) struct Code {
    files: BTreeMap<String, String>,
    /// The crates that each crate depends on, by the names of their folders.
    dependencies: BTreeMap<String, BTreeSet<String>>,
    root: PathBuf,
}

impl Code {
    /// Reads the code of the workspace.
    ///
    /// # Errors
    /// If a file cannot be read, or the crates cannot be listed.
    pub(crate) fn read(root: &Path) -> anyhow::Result<Self> {
        let mut files = BTreeMap::new();
        for folder in ["crates", "xtask"] {
            for path in rust_files(&root.join(folder))? {
                let text =
                    std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
                let name = path.strip_prefix(root)?.to_string_lossy().replace('\\', "/");
                if !is_test(&name) {
                    files.insert(name, bare(&text));
                }
            }
        }
        Ok(Code { files, dependencies: dependencies()?, root: root.to_owned() })
    }

    /// The digest of what a measurement depends on: crates with all that they depend on, by the
    /// names of their folders, and other files and folders, by their paths in the workspace.
    ///
    /// # Errors
    /// If there is no such crate or file, or git does not start.
    pub(crate) fn digest(&self, measured: &[&str]) -> anyhow::Result<String> {
        let mut text = String::new();
        for (name, code) in self.of(measured)? {
            text += &format!("{name}\n{code}\n");
        }
        short_digest(&text)
    }

    /// How the code of a measurement differs from that at a commit, in words; none if it is the same.
    ///
    /// A list of what is measured can so get more precise without making old rows older.
    ///
    /// # Errors
    /// If there is no such crate or file, or git does not start.
    pub(crate) fn difference(
        &self,
        commit: &str,
        measured: &[&str],
    ) -> anyhow::Result<Option<String>> {
        let Some(changed) =
            git(&self.root, &["diff", "-z", "--name-only", "--no-renames", commit])?
        else {
            return Ok(Some("its commit is not here".to_owned()));
        };
        let added = git(&self.root, &["ls-files", "-z", "--others", "--exclude-standard"])?;
        let (own, crates) = (self.of(measured)?, self.crates(measured));
        for name in changed.split('\0').chain(added.as_deref().unwrap_or_default().split('\0')) {
            if !is_part(name, measured, &crates) {
                continue;
            }
            let old = git(&self.root, &["show", &format!("{commit}:{name}")])?;
            let old = old.map(|old| if is_rust(name) { bare(&old) } else { old });
            if old.as_ref() != own.get(name) {
                return Ok(Some(format!("{name} differs")));
            }
        }
        Ok(None)
    }

    /// The files of a measurement, with their code, or their content if they are not of Rust.
    fn of(&self, measured: &[&str]) -> anyhow::Result<BTreeMap<String, String>> {
        let crates = self.crates(measured);
        let own = self.files.iter().filter(|(name, _)| is_part(name, measured, &crates));
        let mut out: BTreeMap<_, _> =
            own.map(|(name, code)| (name.clone(), code.clone())).collect();
        let is_other = |name: &&&str| {
            !crates.contains(**name) && !name.ends_with('/') && !self.files.contains_key(**name)
        };
        let mut others: Vec<String> =
            measured.iter().filter(is_other).map(|name| (*name).to_owned()).collect();
        for folder in measured.iter().filter(|name| name.ends_with('/')) {
            let below = git(&self.root, &["ls-files", "-z", "--", folder])?.unwrap_or_default();
            let below = below.split('\0').filter(|name| !name.is_empty() && !is_rust(name));
            others.extend(below.map(str::to_owned));
        }
        for name in others {
            let path = self.root.join(&name);
            let text = std::fs::read(&path).with_context(|| format!("{name}: no such file"))?;
            out.insert(name, String::from_utf8_lossy(&text).into_owned());
        }
        Ok(out)
    }

    /// The crates of a measurement, with all that they depend on.
    fn crates(&self, measured: &[&str]) -> BTreeSet<String> {
        let mut out = BTreeSet::new();
        for name in measured.iter().filter(|name| self.dependencies.contains_key(**name)) {
            self.add_crates(name, &mut out);
        }
        out
    }

    /// Adds a crate and all that it depends on.
    fn add_crates(&self, name: &str, to: &mut BTreeSet<String>) {
        if to.insert(name.to_owned()) {
            for next in self.dependencies.get(name).into_iter().flatten() {
                self.add_crates(next, to);
            }
        }
    }
}

/// Whether a file is a part of a measurement with these crates.
fn is_part(name: &str, measured: &[&str], crates: &BTreeSet<String>) -> bool {
    let is_of_crate = || {
        let path = name.strip_prefix("crates/").and_then(|rest| rest.split_once("/src/"));
        path.is_some_and(|(own, _)| crates.contains(own))
    };
    let is_below = || measured.iter().any(|part| part.ends_with('/') && name.starts_with(part));
    let is_code = is_rust(name) && !is_test(name);
    measured.contains(&name)
        || is_code && is_of_crate()
        || (is_code || !is_rust(name)) && is_below()
}

/// The output of a command of git; none if it fails.
pub(super) fn git(root: &Path, arguments: &[&str]) -> anyhow::Result<Option<String>> {
    let output = Command::new("git").args(arguments).current_dir(root).output();
    let output = output.context("cannot start git")?;
    Ok(output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned()))
}

/// Whether a file is one of Rust.
fn is_rust(name: &str) -> bool {
    name.ends_with(".rs")
}

/// The files of Rust in the folders `src` of a folder; none of build outputs.
fn rust_files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut out = Vec::new();
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    for entry in entries {
        let path = entry?.path();
        if path.is_dir() && !path.ends_with("target") {
            out.extend(rust_files(&path)?);
        } else if path.extension().is_some_and(|end| end == "rs") {
            out.push(path);
        }
    }
    Ok(out)
}

/// Whether only tests have a file of the workspace.
fn is_test(name: &str) -> bool {
    name.ends_with("tests.rs") || name.split('/').any(|part| part == "tests")
}

/// The code of a file without what changes no number: comments, tests, blank space with the commas
/// in front of it, the content of strings, and the lines that name other files.
fn bare(text: &str) -> String {
    let code = Source::new(text).code;
    let names_file = |line: &&str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        matches!(words[..], [.., "mod", name] if name.ends_with(';'))
    };
    let lines = code.lines().filter(|line| !names_file(line));
    let mut code: String = lines.flat_map(str::split_whitespace).collect();
    for closing in [")", "]", "}"] {
        code = code.replace(&format!(",{closing}"), closing);
    }
    code
}

/// The first digits of the object name that git gives a text.
pub(crate) fn short_digest(text: &str) -> anyhow::Result<String> {
    let mut git = Command::new("git")
        .args(["hash-object", "--stdin"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .context("cannot start git")?;
    git.stdin.take().context("standard input of git")?.write_all(text.as_bytes())?;
    let output = git.wait_with_output()?;
    ensure!(output.status.success(), "git hash-object failed");
    Ok(String::from_utf8(output.stdout)?.chars().take(DIGITS).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `fit` depends on `trace`, and `trace` on `field`.
    fn code(constant: &str) -> Code {
        let file = |name: &str, text: &str| (name.to_owned(), bare(text));
        let on = |name: &str, others: &[&str]| {
            (name.to_owned(), others.iter().map(|&other| other.to_owned()).collect())
        };
        Code {
            files: [
                file("crates/field/src/lib.rs", "pub fn f() {}"),
                file(
                    "crates/trace/src/lib.rs",
                    &format!("/// Steps.\nconst STEPS: u32 = {constant};"),
                ),
                file("crates/fit/src/lib.rs", "fn fit() { trace::steps() }"),
                file("crates/app/src/preset.rs", "const ITERATIONS: u32 = 2000;"),
            ]
            .into(),
            dependencies: [
                on("field", &[]),
                on("trace", &["field"]),
                on("fit", &["trace"]),
                on("app", &["fit"]),
            ]
            .into(),
            root: PathBuf::new(),
        }
    }

    #[test]
    fn a_constant_changes_the_digest_of_all_that_depends_on_it() {
        let (old, new) = (code("64"), code("65"));
        let differs =
            |measured: &[&str]| old.digest(measured).unwrap() != new.digest(measured).unwrap();
        assert!(differs(&["fit"]) && differs(&["trace"]) && differs(&["field", "app"]));
        assert!(!differs(&["field"]) && !differs(&["crates/app/src/preset.rs", "field"]));
        assert!(old.digest(&["fits"]).is_err());
        assert_eq!(old.digest(&["fit"]).unwrap().len(), DIGITS);
    }

    #[test]
    fn a_commit_with_the_same_code_does_not_differ() {
        let folder = tempfile::tempdir().unwrap();
        let git = |arguments: &[&str]| {
            let identity = ["-c", "user.name=a", "-c", "user.email=a@b.c"];
            let mut command = Command::new("git");
            let command = command.args(identity).args(arguments).current_dir(folder.path());
            assert!(command.output().unwrap().status.success());
        };
        let write =
            |text: &str| std::fs::write(folder.path().join("crates/trace/src/lib.rs"), text);
        std::fs::create_dir_all(folder.path().join("crates/trace/src")).unwrap();
        write("const STEPS: u32 = 64;").unwrap();
        git(&["init", "--quiet"]);
        git(&["add", "--all"]);
        git(&["commit", "--quiet", "--message", "a"]);
        let difference = |constant: &str, commit: &str, measured: &str| {
            write(&format!("/// Steps.\nconst STEPS: u32 = {constant};")).unwrap();
            let code = Code { root: folder.path().to_owned(), ..code(constant) };
            code.difference(commit, &[measured]).unwrap()
        };
        assert_eq!(difference("64", "HEAD", "trace"), None);
        let changed = difference("65", "HEAD", "trace");
        assert_eq!(changed.as_deref(), Some("crates/trace/src/lib.rs differs"));
        // `field` does not depend on `trace`.
        assert_eq!(difference("65", "HEAD", "field"), None);
        assert!(difference("64", "no-commit", "trace").is_some());
    }

    #[test]
    fn comments_tests_and_messages_do_not_change_the_digest() {
        let text = "/// A.\nfn f() -> u32 { error(\"too few\"); 1 }\n#[cfg(test)]\nmod tests { fn g() {} }\n";
        let other = "/// Better words.\nfn f() -> u32 {\n    error(\"fewer than 2\");\n    1\n}\n";
        assert_eq!(bare(text), bare(other));
        assert_eq!(bare("f(\n    a,\n    b,\n)"), bare("f(a, b)"));
        assert_ne!(bare(other), bare(&other.replace('1', "2")));
        assert_eq!(bare("mod a;\nmod b {\n}\n"), bare("pub(crate) mod c;\nmod b {}\n"));
        assert!(is_test("src/file_tests.rs") && is_test("src/tests/a.rs"));
        assert!(!is_test("src/test_model.rs"));
    }
}
