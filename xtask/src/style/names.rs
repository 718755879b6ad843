//! The names in the code of a file: its imports, its paths and its items.

use std::collections::BTreeSet;

/// A path of `use`, with the name that it binds. The name of a glob is `*`.
pub(crate) struct Use {
    pub(crate) path: Vec<String>,
    pub(crate) name: String,
    /// Whether it passes the name on.
    pub(crate) is_public: bool,
}

/// The names in a file.
#[derive(Default)]
pub(crate) struct Names {
    pub(crate) uses: Vec<Use>,
    /// Paths outside of `use`.
    pub(crate) paths: Vec<Vec<String>>,
    /// The items that it defines.
    pub(crate) items: BTreeSet<String>,
    /// The macros that it calls.
    pub(crate) macros: BTreeSet<String>,
    /// All words outside of `use`.
    pub(crate) words: BTreeSet<String>,
}

impl Names {
    /// The names in code without comments and strings.
    pub(crate) fn new(code: &str) -> Self {
        let words = words(code);
        let mut names = Names::default();
        let mut at = 0;
        let mut is_public = false;
        while at < words.len() {
            if words[at] == "use" && words.get(at + 1).is_some_and(|next| *next != "<") {
                let mut tree = Tree { words: &words, at: at + 1, is_public, uses: vec![] };
                tree.read(&[]);
                at = tree.at;
                names.uses.append(&mut tree.uses);
                continue;
            }
            is_public = match words[at] {
                "pub" => true,
                ";" | "{" | "}" => false,
                _ => is_public,
            };
            if ITEMS.contains(&words[at])
                && let Some(name) = words.get(at + 1)
            {
                names.items.insert((*name).to_owned());
            }
            if is_identifier(words[at]) {
                names.words.insert(words[at].to_owned());
                if words.get(at + 1) == Some(&"!") && words.get(at + 2) != Some(&"=") {
                    names.macros.insert(words[at].to_owned());
                }
                let starts = at == 0 || words[at - 1] != "::";
                let path = if starts { path(&words[at..]) } else { vec![] };
                if path.len() > 1 {
                    names.paths.push(path);
                }
            }
            at += 1;
        }
        names
    }
}

/// The words in front of the name of an item.
const ITEMS: [&str; 9] =
    ["fn", "struct", "enum", "union", "trait", "type", "const", "static", "macro_rules"];

fn is_identifier(word: &str) -> bool {
    word.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// The path at the start of words.
fn path(words: &[&str]) -> Vec<String> {
    let mut path = vec![words[0].to_owned()];
    let mut rest = &words[1..];
    while let ["::", name, ..] = rest
        && is_identifier(name)
    {
        path.push((*name).to_owned());
        rest = &rest[2..];
    }
    path
}

/// Reads the tree of a `use`.
struct Tree<'a> {
    words: &'a [&'a str],
    at: usize,
    is_public: bool,
    uses: Vec<Use>,
}

impl Tree<'_> {
    fn read(&mut self, prefix: &[String]) {
        let mut path = prefix.to_vec();
        while let Some(&word) = self.words.get(self.at) {
            self.at += 1;
            match word {
                "::" => {}
                "{" => return self.group(&path),
                "*" => return self.add(path, "*"),
                "as" => {
                    let name = self.words.get(self.at).copied().unwrap_or_default();
                    self.at += 1;
                    return self.add(path, name);
                }
                "," | "}" | ";" => {
                    self.at -= 1;
                    break;
                }
                // `a::{self}` is `a`.
                "self" if !path.is_empty() => {}
                word => path.push(word.to_owned()),
            }
        }
        let name = path.last().cloned().unwrap_or_default();
        self.add(path, &name);
    }

    fn group(&mut self, prefix: &[String]) {
        while let Some(&word) = self.words.get(self.at) {
            match word {
                "}" => {
                    self.at += 1;
                    return;
                }
                "," => self.at += 1,
                ";" => return,
                _ => self.read(prefix),
            }
        }
    }

    fn add(&mut self, path: Vec<String>, name: &str) {
        self.uses.push(Use { path, name: name.to_owned(), is_public: self.is_public });
    }
}

/// The words and signs of code: identifiers, `::`, and single characters.
pub(crate) fn words(code: &str) -> Vec<&str> {
    let mut out = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let length = if is_word(first) {
            rest.find(|c| !is_word(c)).unwrap_or(rest.len())
        } else if rest.starts_with("::") {
            2
        } else {
            first.len_utf8()
        };
        let (word, after) = rest.split_at(length);
        out.push(word);
        rest = after.trim_start();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trees_of_imports_become_paths_with_their_names() {
        let code = "pub(crate) use a::{self, b::{C as D, *}, e::F};\nuse super::g;\n\
                    fn h() -> i::J { k!(); a != l::<M>(); N::O }";
        let names = Names::new(code);
        let uses =
            names.uses.iter().map(|u| format!("{} {} {}", u.path.join("::"), u.name, u.is_public));
        let expected =
            ["a a true", "a::b::C D true", "a::b * true", "a::e::F F true", "super::g g false"];
        assert_eq!(uses.collect::<Vec<_>>(), expected);
        let paths: Vec<String> = names.paths.iter().map(|path| path.join("::")).collect();
        assert_eq!(paths, ["i::J", "N::O"]);
        assert_eq!(names.items, BTreeSet::from(["h".to_owned()]));
        assert_eq!(names.macros, BTreeSet::from(["k".to_owned()]));
    }
}
