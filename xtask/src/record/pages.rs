//! Tables of pages that come from files of the record.
//!
//! A page has a table between two comments, and `record` writes it there:
//!
//! ```text
//! <!-- table: docs/results/fits/fits.md -->
//! (the first table of the file)
//! <!-- end of table -->
//! ```
//!
//! `FILE#HEADING` names the first table below a heading of the file.

use std::path::Path;

use anyhow::{Context, bail};

use super::code::git;

const START: &str = "<!-- table: ";
const END: &str = "<!-- end of table -->";

/// Writes the tables of all pages of the README, of docs and of the crates again.
///
/// # Errors
/// If a page cannot be read or written, or names a table that is not there.
pub(crate) fn refresh(root: &Path) -> anyhow::Result<()> {
    for name in git(root, &["ls-files", "*.md"])?.unwrap_or_default().lines() {
        let path = root.join(name);
        let Ok(page) = std::fs::read_to_string(&path) else { continue };
        let fresh = refreshed(&page, &read_in(root)).with_context(|| name.to_owned())?;
        if fresh != page {
            let folder = path.parent().unwrap_or(root);
            let file = path.file_name().unwrap_or_default().to_string_lossy();
            crate::output::write(folder, &file, fresh)?;
        }
    }
    Ok(())
}

/// Reads files of the workspace.
fn read_in(root: &Path) -> impl Fn(&str) -> anyhow::Result<String> {
    |file| std::fs::read_to_string(root.join(file)).with_context(|| file.to_owned())
}

/// The tables of a page that differ from their files.
pub(crate) fn check(name: &str, page: &str, root: &Path) -> Vec<String> {
    match refreshed(page, &read_in(root)) {
        Ok(fresh) if fresh == page => Vec::new(),
        Ok(fresh) => {
            let same = page.lines().zip(fresh.lines()).take_while(|(a, b)| a == b).count();
            vec![format!(
                "{name}:{}: differs from its file: `cargo xtask record --tables` writes it",
                same + 1
            )]
        }
        Err(error) => vec![format!("{name}: {error:#}")],
    }
}

/// A page with the tables of its files.
fn refreshed(page: &str, read: &dyn Fn(&str) -> anyhow::Result<String>) -> anyhow::Result<String> {
    let mut out = String::with_capacity(page.len());
    let mut lines = page.lines();
    while let Some(line) = lines.next() {
        out += line;
        out.push('\n');
        let source = line.strip_prefix(START).and_then(|rest| rest.strip_suffix(" -->"));
        let Some(source) = source else { continue };
        let (file, heading) = source.split_once('#').unwrap_or((source, ""));
        let text = read(file)?;
        let table = table(&text, heading);
        let table = table.with_context(|| format!("{file} has no table {heading:?}"))?;
        out += &format!("\n{table}\n{END}\n");
        // Only a table and blank lines are taken out.
        let is_table = |line: &&str| line.is_empty() || line.starts_with('|');
        if lines.find(|line| !is_table(line)) != Some(END) {
            bail!("something other than a table between {line:?} and {END:?}");
        }
    }
    Ok(out)
}

/// The first table of a text, or the first below a heading, with a line break after each row.
fn table(text: &str, heading: &str) -> Option<String> {
    let is_heading = |line: &str| line.trim_start_matches('#').trim() == heading;
    let mut lines = text.lines();
    if !heading.is_empty() {
        lines.find(|line| line.starts_with('#') && is_heading(line))?;
    }
    let rows = lines.skip_while(|line| !line.starts_with('|'));
    let rows: Vec<&str> = rows.take_while(|line| line.starts_with('|')).collect();
    (!rows.is_empty()).then(|| rows.join("\n") + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str =
        "Text.\n\n| a |\n| --- |\n| 1 |\n\n## Second\n\n| b |\n| --- |\n| 2 |\nend\n";

    fn fresh(page: &str) -> anyhow::Result<String> {
        refreshed(page, &|file| {
            anyhow::ensure!(file == "r.md", "{file}: no such file");
            Ok(FILE.to_owned())
        })
    }

    #[test]
    fn a_page_gets_the_tables_of_its_files() {
        let page = "A.\n<!-- table: r.md -->\n| old |\n<!-- end of table -->\nB.\n\
                    <!-- table: r.md#Second -->\n<!-- end of table -->\n";
        let expected = "A.\n<!-- table: r.md -->\n\n| a |\n| --- |\n| 1 |\n\n<!-- end of table -->\n\
                        B.\n<!-- table: r.md#Second -->\n\n| b |\n| --- |\n| 2 |\n\n\
                        <!-- end of table -->\n";
        assert_eq!(fresh(page).unwrap(), expected);
        assert_eq!(fresh(expected).unwrap(), expected);
    }

    #[test]
    fn missing_tables_and_ends_are_errors() {
        for page in [
            "<!-- table: s.md -->\n<!-- end of table -->\n",
            "<!-- table: r.md#Third -->\n<!-- end of table -->\n",
            "<!-- table: r.md -->\n| a |\n",
        ] {
            assert!(fresh(page).is_err(), "{page}");
        }
    }
}
