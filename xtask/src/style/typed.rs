//! Measured numbers that were typed into tables of pages.
//!
//! Tables with measured numbers come from files of the record: between `<!-- table: FILE -->` and
//! `<!-- end of table -->`, or with `<!-- result: FILE -->`. Two comments make exceptions:
//!
//! - `<!-- journal -->` in front of the first section of a page, or of a table: it compares candidates,
//!   each by the program of its day, most of which are gone, or needs what `record` does not have.
//! - `<!-- not measured -->` in front of a table: its numbers are settings, not results.

use super::markdown::prose;

/// The units of measured numbers.
const UNITS: [&str; 11] =
    ["%", "dB", "°", "ms", "s", "min", "MiB", "GiB", "M points/s", "GFLOP/s", "times"];

/// The rows of tables with a number of such a unit that is from no file.
pub(crate) fn check(name: &str, page: &str) -> Vec<String> {
    let mut findings = Vec::new();
    let start = page.split("\n## ").next().unwrap_or_default();
    if start.lines().any(|line| line == "<!-- journal -->") {
        return findings;
    }
    // Whether a comment speaks of the table that follows, or of this one.
    let (mut is_marked, mut is_written, mut is_table) = (false, false, false);
    for (number, line) in prose(page) {
        let is_row = line.starts_with('|');
        if is_table && !is_row {
            is_marked = false;
        }
        is_table = is_row;
        match line {
            _ if line.starts_with("<!-- table: ") => is_written = true,
            "<!-- end of table -->" => is_written = false,
            "<!-- not measured -->" | "<!-- journal -->" => is_marked = true,
            _ if line.starts_with("<!-- result: ") => is_marked = true,
            _ => {}
        }
        let is_typed = is_row && !is_marked && !is_written && !line.contains("<!-- result: ");
        if is_typed && let Some(found) = measured(line) {
            findings.push(format!(
                "{name}:{number}: {found} was typed: take the table from docs/results, or say \
                 `<!-- journal -->` or `<!-- not measured -->`"
            ));
        }
    }
    findings
}

/// The first number with the unit of a measurement.
fn measured(line: &str) -> Option<&str> {
    let digits = line.char_indices().filter(|(_, c)| c.is_ascii_digit()).map(|(at, _)| at);
    digits.into_iter().find_map(|at| {
        let after = line[at + 1..].strip_prefix([' ', '\u{a0}']).unwrap_or(&line[at + 1..]);
        let unit = UNITS.iter().find(|unit| {
            let rest = after.strip_prefix(**unit);
            rest.is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric()))
        })?;
        let before = |c: char| !c.is_ascii_digit() && c != '.' && c != ',';
        let start = line[..at].char_indices().rfind(|(_, c)| before(*c));
        let start = start.map_or(0, |(at, c)| at + c.len_utf8());
        let end = line.len() - after.len() + unit.len();
        line.get(start..end)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_typed_result_is_found() {
        let page = "| a | b |\n| --- | --- |\n| `spot` | Chamfer 0.080 %, 41 dB |\n";
        let found = check("a.md", page);
        assert_eq!(found.len(), 1);
        assert!(found[0].starts_with("a.md:3: 0.080 % was typed"), "{found:?}");
        for marked in [
            format!("<!-- journal -->\n\n{page}"),
            format!("<!-- not measured -->\n\n{page}"),
            format!("<!-- result: docs/results/a.md -->\n\n{page}"),
            format!("<!-- table: docs/results/a.md -->\n{page}<!-- end of table -->\n"),
            format!("```text\n{page}```\n"),
            page.replace(" dB", " dB <!-- result: a.md#x -->"),
        ] {
            assert_eq!(check("a.md", &marked), [""; 0], "{marked}");
        }
        // Behind the first section, a comment speaks of one table.
        let two = format!("# A\n\n## B\n\n<!-- journal -->\n\n{page}\nText.\n\n{page}");
        assert_eq!(check("a.md", &two).len(), 1);
        let two = format!("<!-- not measured -->\n\n{page}\nText.\n\n{page}");
        assert_eq!(check("a.md", &two).len(), 1);
    }

    #[test]
    fn settings_without_units_are_no_results() {
        let found = |line| measured(line);
        assert_eq!(found("| 32 views of 256 × 256 | k = 14 | 3 hidden layers |"), None);
        assert_eq!(found("| x | 10 seeds, 5 scenes |"), None);
        assert_eq!(found("| x | 2.9 M points/s |"), Some("2.9 M points/s"));
        assert_eq!(found("| x | −0.5 dB |"), Some("0.5 dB"));
        assert_eq!(found("| x | 10s |"), Some("10s"));
        assert_eq!(found("| x | 1.3° |"), Some("1.3°"));
    }
}
