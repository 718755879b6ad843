//! A case: the files of a folder.

use std::io;
use std::path::Path;

use proptest::prelude::*;

use crate::spoil::{Spoil, bytes};

/// An entry of a folder.
#[derive(Clone, Debug)]
enum Entry {
    File(Vec<u8>),
    Folder,
    /// A link to this path.
    Link(&'static str),
    /// A pipe, whose reader waits for a writer that never comes.
    Pipe,
}

/// The files of a folder, by their paths in it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Case {
    entries: Vec<(String, Entry)>,
}

impl Case {
    /// Adds a file.
    pub(crate) fn file(mut self, name: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        self.entries.push((name.into(), Entry::File(bytes.into())));
        self
    }

    /// Adds all files of another case, in the folder `folder`.
    pub(crate) fn case(mut self, folder: &str, case: Case) -> Self {
        let inside = |(name, entry)| (format!("{folder}/{name}"), entry);
        self.entries.extend(case.entries.into_iter().map(inside));
        self
    }

    /// Writes the files into a folder.
    ///
    /// # Errors
    /// If an entry cannot be written.
    pub(crate) fn write(&self, folder: &Path) -> io::Result<()> {
        for (name, entry) in &self.entries {
            let path = folder.join(name);
            if let Some(parent) = path.parent() {
                std::fs::create_dir_all(parent)?;
            }
            match entry {
                Entry::File(bytes) => std::fs::write(path, bytes)?,
                Entry::Folder => std::fs::create_dir_all(path)?,
                Entry::Link(target) => link(target, &path)?,
                Entry::Pipe => pipe(&path)?,
            }
        }
        Ok(())
    }
}

#[cfg(unix)]
fn link(target: &str, path: &Path) -> io::Result<()> {
    std::os::unix::fs::symlink(target, path)
}

#[cfg(unix)]
fn pipe(path: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    Ok(mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0)?)
}

/// Without links: an empty file.
#[cfg(not(unix))]
fn link(_target: &str, path: &Path) -> io::Result<()> {
    std::fs::write(path, "")
}

/// Without pipes: an empty file.
#[cfg(not(unix))]
fn pipe(path: &Path) -> io::Result<()> {
    std::fs::write(path, "")
}

impl Spoil for Case {
    fn spoil(&mut self, place: usize, harm: usize) {
        if self.entries.is_empty() {
            return;
        }
        let i = place % self.entries.len();
        let (name, entry) = &mut self.entries[i];
        match (harm % 12, &mut *entry) {
            (0, _) => *entry = Entry::Pipe,
            (1, _) => *entry = Entry::Folder,
            (2, _) => *entry = Entry::Link("/dev/zero"),
            (3, _) => *entry = Entry::Link("/proc/self/mem"),
            (4, _) => *entry = Entry::Link("missing"),
            (5, _) => drop(self.entries.remove(i)),
            (6, _) => *entry = Entry::File(Vec::new()),
            (7, _) => name.push_str("\u{1b}[31m\n"),
            (8, Entry::File(content)) => content.truncate(harm / 12 % content.len().max(1)),
            (9, Entry::File(content)) => {
                let at = harm / 12 % content.len().max(1);
                content.splice(at..at, *b"\xff\x00\xfe");
            }
            (_, Entry::File(content)) => *content = bytes(content, harm / 12),
            _ => {}
        }
    }
}

/// Cases of which one in sixteen has a file that is missing, cut, foreign, or no regular file.
pub(crate) fn damaged(base: impl Strategy<Value = Case> + 'static) -> BoxedStrategy<Case> {
    let harm = prop_oneof![15 => Just(None), 1 => any::<(usize, usize)>().prop_map(Some)];
    (base, harm)
        .prop_map(|(mut case, harm)| {
            if let Some((place, harm)) = harm {
                case.spoil(place, harm);
            }
            case
        })
        .boxed()
}
