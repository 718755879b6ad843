//! The modules of a crate and their files.

use std::collections::{BTreeMap, BTreeSet};

use super::names::words;
use super::source::Source;

/// A module with a file of its own.
pub(crate) struct Module {
    /// Its path from the crate's root, which has an empty one.
    pub(crate) path: Vec<String>,
    /// The name of its file.
    pub(crate) file: String,
    /// Its code, without comments, strings and tests.
    pub(crate) code: String,
}

/// The modules of a crate, from its root file on. Modules that only tests have are left out.
///
/// `files` has the text of each file by its name.
pub(crate) fn modules(files: &BTreeMap<String, String>, root: &str) -> Vec<Module> {
    let mut found = Vec::new();
    let mut open = vec![(Vec::new(), root.to_owned())];
    while let Some((path, file)) = open.pop() {
        let Some(text) = files.get(&file) else { continue };
        let code = Source::new(text).code;
        let folder = match file.rsplit_once('/') {
            Some((folder, "mod.rs" | "lib.rs" | "main.rs")) => folder.to_owned(),
            _ => file.trim_end_matches(".rs").to_owned(),
        };
        for child in declared(&code) {
            let names = [format!("{folder}/{child}.rs"), format!("{folder}/{child}/mod.rs")];
            if let Some(name) = names.into_iter().find(|name| files.contains_key(name)) {
                open.push(([path.clone(), vec![child]].concat(), name));
            }
        }
        found.push(Module { path, file, code });
    }
    found.sort_by(|a, b| a.file.cmp(&b.file));
    found
}

/// The names of `mod name;` in code.
fn declared(code: &str) -> BTreeSet<String> {
    let words = words(code);
    let names = words.windows(3).filter(|w| w[0] == "mod" && w[2] == ";");
    names.map(|w| w[1].to_owned()).collect()
}
