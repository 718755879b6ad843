//! Circles of files: files of one crate that need each other.
//!
//! A file needs another if its code names an item of it, by `use` or by a path. A name that a module
//! only passes on (`pub use`) belongs to the file that defines it. Tests do not count.

use std::collections::{BTreeMap, BTreeSet};

use super::modules::{Module, modules};
use super::names::Names;

/// The circles of a crate, one line for each group of files that all need each other.
///
/// `files` has the text of each file by its name; `root` is the name of the crate's first file.
pub(crate) fn circles(files: &BTreeMap<String, String>, root: &str) -> Vec<String> {
    let modules = modules(files, root);
    let needs = Crate::new(&modules).needs();
    let reach: Vec<BTreeSet<usize>> = (0..modules.len()).map(|i| reachable(&needs, i)).collect();
    let mut findings = Vec::new();
    for first in 0..modules.len() {
        let group: Vec<usize> = (0..modules.len())
            .filter(|&i| reach[first].contains(&i) && reach[i].contains(&first))
            .collect();
        if group.len() > 1 && group[0] == first {
            let circle = shortest(&needs, first).into_iter().map(|i| modules[i].file.as_str());
            let circle = circle.collect::<Vec<_>>().join(" → ");
            findings.push(format!("a circle of {} files: {circle}", group.len()));
        }
    }
    findings
}

/// The files that a file needs, directly and through others.
fn reachable(needs: &[BTreeSet<usize>], from: usize) -> BTreeSet<usize> {
    let mut found = BTreeSet::new();
    let mut open = vec![from];
    while let Some(at) = open.pop() {
        open.extend(needs[at].iter().filter(|&&next| found.insert(next)));
    }
    found
}

/// The shortest way from a file back to itself.
fn shortest(needs: &[BTreeSet<usize>], from: usize) -> Vec<usize> {
    let mut before = BTreeMap::new();
    let mut open = std::collections::VecDeque::from([from]);
    while let Some(at) = open.pop_front() {
        for &next in &needs[at] {
            if let std::collections::btree_map::Entry::Vacant(entry) = before.entry(next) {
                entry.insert(at);
                open.push_back(next);
            }
        }
    }
    let mut way = vec![from];
    let mut at = from;
    while let Some(&previous) = before.get(&at) {
        way.push(previous);
        at = previous;
        if at == from {
            break;
        }
    }
    way.reverse();
    way
}

/// A thing that a path names.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Thing {
    /// A module of the crate.
    Module(usize),
    /// An item of a file.
    Item(usize),
    /// Something of another crate, or a local name.
    Other,
}

/// The modules of a crate with their names.
struct Crate<'a> {
    modules: &'a [Module],
    names: Vec<Names>,
    by_path: BTreeMap<&'a [String], usize>,
}

impl<'a> Crate<'a> {
    fn new(modules: &'a [Module]) -> Self {
        let names = modules.iter().map(|module| Names::new(&module.code)).collect();
        let by_path = modules.iter().enumerate().map(|(i, m)| (m.path.as_slice(), i)).collect();
        Crate { modules, names, by_path }
    }

    /// The files that each file needs.
    fn needs(&self) -> Vec<BTreeSet<usize>> {
        (0..self.modules.len()).map(|i| self.needs_of(i)).collect()
    }

    fn needs_of(&self, at: usize) -> BTreeSet<usize> {
        let names = &self.names[at];
        let mut needs = BTreeSet::new();
        for import in &names.uses {
            let is_used = !import.is_public || names.words.contains(&import.name);
            match self.resolve(at, &import.path, &mut vec![]) {
                Thing::Item(file) if is_used => needs.insert(file),
                // Of a module alone, the paths count that start with its name.
                Thing::Module(module) if import.name == "*" && !import.is_public => {
                    needs.insert(module)
                }
                _ => false,
            };
        }
        for path in &names.paths {
            if let Thing::Item(file) = self.resolve(at, path, &mut vec![]) {
                needs.insert(file);
            }
        }
        needs.remove(&at);
        needs
    }

    /// The module with a path from the root.
    fn module(&self, path: &[String]) -> Option<usize> {
        self.by_path.get(path).copied()
    }

    /// The thing that a path in a module names. `open` has the names that are being looked up.
    fn resolve(&self, from: usize, path: &[String], open: &mut Vec<(usize, String)>) -> Thing {
        let (mut module, mut is_rooted) = (from, false);
        let mut names = path.iter().peekable();
        while let Some(first) = names.next_if(|name| ROOTS.contains(&name.as_str())) {
            let path = &self.modules[module].path;
            let above = match first.as_str() {
                "crate" => &[],
                "super" => &path[..path.len().saturating_sub(1)],
                _ => &path[..],
            };
            let Some(above) = self.module(above) else { return Thing::Other };
            (module, is_rooted) = (above, true);
        }
        while let Some(name) = names.next() {
            let leads_further = !is_rooted && names.peek().is_some();
            match self.member(module, name, leads_further, open) {
                Some(Thing::Module(next)) => module = next,
                Some(thing) => return thing,
                // An item that a macro defines, or one that is unknown here.
                None if is_rooted => return Thing::Item(module),
                None => return Thing::Other,
            }
            is_rooted = true;
        }
        Thing::Module(module)
    }

    /// The thing of this name in a module: a child, an item, or an import.
    ///
    /// A path that leads further from the name does not start at a function, so an import of the
    /// same name comes first.
    fn member(
        &self,
        module: usize,
        name: &str,
        leads_further: bool,
        open: &mut Vec<(usize, String)>,
    ) -> Option<Thing> {
        let path = [self.modules[module].path.as_slice(), &[name.to_owned()]].concat();
        if let Some(child) = self.module(&path) {
            return Some(Thing::Module(child));
        }
        let uses = &self.names[module].uses;
        let import = uses.iter().find(|import| import.name == name);
        if self.names[module].items.contains(name) && !(leads_further && import.is_some()) {
            return Some(Thing::Item(module));
        }
        let key = (module, name.to_owned());
        if open.contains(&key) {
            return None;
        }
        open.push(key);
        let thing = match import {
            Some(import) => Some(self.resolve(module, &import.path, open)),
            None => uses.iter().filter(|import| import.name == "*").find_map(|import| {
                match self.resolve(module, &import.path, open) {
                    Thing::Module(other) if other != module => {
                        self.member(other, name, false, open)
                    }
                    _ => None,
                }
            }),
        };
        open.pop();
        thing
    }
}

/// The words with which a path inside a crate starts.
const ROOTS: [&str; 3] = ["crate", "self", "super"];

#[cfg(test)]
mod tests {
    use super::*;

    /// The circles of files with these names and texts.
    fn found(files: &[(&str, &str)]) -> Vec<String> {
        let files = files.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned()));
        circles(&files.collect(), "src/lib.rs")
    }

    #[test]
    fn two_files_that_import_each_other_are_a_circle() {
        let root = ("src/lib.rs", "mod a;\nmod b;\nmod c;");
        let circle = found(&[
            root,
            ("src/a.rs", "use crate::b::{B, self};\npub struct A;"),
            ("src/b.rs", "pub struct B;\nfn f() -> super::a::A { crate::c::g() }"),
            ("src/c.rs", "pub fn g() {}"),
        ]);
        assert_eq!(circle, ["a circle of 2 files: src/a.rs → src/b.rs → src/a.rs"]);
        // In one direction, or in tests and comments alone, there is none.
        let line = found(&[
            root,
            ("src/a.rs", "use crate::b::B;\npub struct A;"),
            ("src/b.rs", "// crate::a::A\n#[cfg(test)]\nmod tests { use crate::a::A; }"),
            ("src/c.rs", "use super::a::A; use super::b::B;"),
        ]);
        assert_eq!(line, [""; 0]);
    }

    #[test]
    fn a_name_belongs_to_the_file_that_defines_it() {
        // The root passes names on; the children find them there.
        let root = "mod a;\nmod b;\npub use a::A;\npub use b::*;\nuse glam::Vec3;";
        let (a, b) = ("use crate::B;\npub struct A;", "use super::Vec3;\npub struct B;");
        assert_eq!(found(&[("src/lib.rs", root), ("src/a.rs", a), ("src/b.rs", b)]), [""; 0]);
        let b = "pub struct B;\nimpl B { fn a() { crate::A; } }";
        let circle = found(&[("src/lib.rs", root), ("src/a.rs", a), ("src/b.rs", b)]);
        assert_eq!(circle, ["a circle of 2 files: src/a.rs → src/b.rs → src/a.rs"]);
    }

    #[test]
    fn a_module_and_its_part_are_a_circle_if_both_have_items_of_the_other() {
        let root = ("src/lib.rs", "mod a;");
        let part = ("src/a/part.rs", "use super::Options;\npub fn run(o: Options) {}");
        let both = "mod part;\npub struct Options;\npub fn f() { part::run(Options) }";
        let circle = found(&[root, ("src/a/mod.rs", both), part]);
        assert_eq!(circle, ["a circle of 2 files: src/a/mod.rs → src/a/part.rs → src/a/mod.rs"]);
        let passes_on = "mod part;\npub use part::run;\npub struct Options;";
        assert_eq!(found(&[root, ("src/a/mod.rs", passes_on), part]), [""; 0]);
        // A name that is passed on and used is needed.
        let uses = "mod part;\npub use part::run;\npub struct Options;\nfn f() { run(Options) }";
        assert_eq!(found(&[root, ("src/a.rs", uses), part]).len(), 1);
        // An imported module counts by the paths that start with its name.
        let other = ("src/a/part.rs", "use super::super::a;\npub fn run() { a::g() }");
        let module = "mod part;\nuse part as p;\npub fn g() { p::run() }";
        assert_eq!(found(&[root, ("src/a.rs", module), other]).len(), 1);
    }

    #[test]
    fn a_function_does_not_hide_a_module_of_its_name() {
        let circle = found(&[
            ("src/lib.rs", "mod a;\nmod b;"),
            ("src/a.rs", "use crate::b;\npub struct A;\nimpl A { fn b() { b::f() } }"),
            ("src/b.rs", "pub fn f() {}\nfn g(a: crate::a::A) {}"),
        ]);
        assert_eq!(circle, ["a circle of 2 files: src/a.rs → src/b.rs → src/a.rs"]);
    }

    #[test]
    fn three_files_are_one_circle() {
        let circle = found(&[
            ("src/lib.rs", "mod a; mod b; mod c;"),
            ("src/a.rs", "use crate::b::B;\npub struct A;"),
            ("src/b.rs", "use crate::c::C;\npub struct B;"),
            ("src/c.rs", "use crate::a::A;\npub struct C;"),
        ]);
        assert_eq!(circle, ["a circle of 3 files: src/a.rs → src/b.rs → src/c.rs → src/a.rs"]);
    }
}
