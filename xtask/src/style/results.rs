//! Numbers of the documentation that come from files in `docs/results`.
//!
//! A comment names the file, and after `#` the text that the number's line in the file has:
//!
//! - Behind a number, on the same line, it says where this number is from.
//! - On a line of its own in front of a table, it speaks of all numbers of the table. `*` stands for
//!   the first cell of a row, and is the text if there is none.
//!
//! ```text
//! | k = 2 | 1.16 <!-- result: docs/results/ablate/x/report.md#top_k = 2 against 7 --> |
//! <!-- result: docs/results/tradeoff/tradeoff.md -->
//! ```
//!
//! A number agrees if a number of these lines is the same, rounded to the digits that are written.

use std::collections::BTreeMap;

use super::markdown::prose;

const START: &str = "<!-- result: ";
const END: &str = " -->";

/// The numbers of a page that differ from their sources, and sources that are missing. `read` gives
/// the text of a file of the repository.
pub(crate) fn check(
    name: &str,
    page: &str,
    read: impl Fn(&str) -> anyhow::Result<String>,
) -> Vec<String> {
    let mut files = BTreeMap::new();
    let mut findings = Vec::new();
    let mut check = |number: usize, source: Source, row: &str, quoted: &[Number]| {
        let file = files.entry(source.file.clone()).or_insert_with(|| read(&source.file));
        let finding = match file {
            Ok(text) => source.difference(text, row, quoted),
            Err(error) => Some(error.to_string()),
        };
        findings.extend(finding.map(|finding| format!("{name}:{number}: {finding}")));
    };
    // The source of the table that follows, and the number of rows so far.
    let mut table: Option<(Source, usize)> = None;
    for (number, line) in prose(page) {
        let is_row = line.starts_with('|');
        if let Some((source, rows)) = &mut table {
            *rows += usize::from(is_row);
            if is_row && *rows > 2 {
                let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
                let quoted: Vec<_> = cells[1..].iter().flat_map(|cell| numbers(cell)).collect();
                check(number, source.clone(), cells[0].trim_matches('`'), &quoted);
            } else if !is_row && *rows > 0 {
                table = None;
            }
        }
        let mut text = String::new();
        let mut rest = line;
        while let Some((before, after)) = rest.split_once(START) {
            let (source, after) = after.split_once(END).unwrap_or((after, ""));
            text.push_str(before);
            let source = Source::new(source);
            if text.trim().is_empty() {
                table = Some((source, 0));
            } else {
                let last: Vec<_> = numbers(&text).into_iter().last().into_iter().collect();
                check(number, source, "", &last);
            }
            rest = after;
        }
    }
    findings
}

/// The lines of a file that a comment names.
#[derive(Clone)]
struct Source {
    file: String,
    /// The text that the lines have, with `*` for the name of a row.
    key: String,
}

impl Source {
    fn new(text: &str) -> Self {
        let (file, key) = text.split_once('#').unwrap_or((text, "*"));
        Source { file: file.trim().to_owned(), key: key.trim().to_owned() }
    }

    /// The first number that is not in the lines of the file.
    fn difference(&self, text: &str, row: &str, quoted: &[Number]) -> Option<String> {
        let key = self.key.replace('*', row);
        let lines: Vec<&str> = text.lines().filter(|line| has_words(line, &key)).collect();
        if lines.is_empty() {
            return Some(format!("{} has no line with {key:?}", self.file));
        }
        let found: Vec<Number> = lines.iter().flat_map(|line| numbers(line)).collect();
        if quoted.is_empty() {
            return Some("no number for the comment about its source".to_owned());
        }
        let other = quoted.iter().find(|number| !found.iter().any(|f| number.agrees(f)))?;
        Some(format!("{} is in no line with {key:?} of {}", other.text, self.file))
    }
}

/// Whether a line has a text that neither starts nor ends inside a word or a number.
fn has_words(line: &str, text: &str) -> bool {
    !text.is_empty()
        && line.match_indices(text).any(|(at, _)| {
            let is_part = |c: char| c.is_alphanumeric();
            !line[..at].ends_with(is_part) && !line[at + text.len()..].starts_with(is_part)
        })
}

/// A number in a text.
#[derive(Debug)]
struct Number {
    text: String,
    /// Its value; of per cent, a hundredth.
    value: f64,
    /// The distance between neighbouring numbers with as many digits.
    step: f64,
    /// Whether milliseconds are its unit.
    is_milliseconds: bool,
}

impl Number {
    /// Whether another number is this one, rounded, in the same unit. A table may give seconds where
    /// the text has milliseconds, and bare values where it has per cent.
    fn agrees(&self, exact: &Number) -> bool {
        let scales: &[f64] = if self.is_milliseconds { &[1.0, 1e3] } else { &[1.0] };
        // A number of a table may be rounded already.
        let most = 0.5 * self.step * (1.0 + 1e-6) + 0.5 * exact.step.min(0.1 * self.step);
        scales.iter().any(|scale| (self.value - scale * exact.value).abs() <= most)
    }
}

/// The numbers of a text. Digits inside words, such as `f32`, are none.
fn numbers(text: &str) -> Vec<Number> {
    let mut out = Vec::new();
    let characters: Vec<(usize, char)> = text.char_indices().collect();
    let mut i = 0;
    while i < characters.len() {
        let (at, c) = characters[i];
        let before = i.checked_sub(1).map(|i| characters[i].1);
        let is_start =
            c.is_ascii_digit() && !before.is_some_and(|c| c.is_alphanumeric() || c == '_');
        if !is_start {
            i += 1;
            continue;
        }
        let is_negative = before.is_some_and(|c| c == '-' || c == '−')
            && !i.checked_sub(2).is_some_and(|i| characters[i].1.is_alphanumeric());
        let length = number_length(&text[at..]);
        out.extend(number(&text[at..at + length], &text[at + length..], is_negative));
        while i < characters.len() && characters[i].0 < at + length {
            i += 1;
        }
    }
    out
}

/// The length of the number at the start of a text: digits, a fraction, an exponent. A space may
/// divide groups of three digits.
fn number_length(text: &str) -> usize {
    let digits =
        |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let mut length = digits(text);
    while let Some(rest) = text[length..].strip_prefix([' ', ','])
        && digits(rest) == 3
        && length <= 3
    {
        length += 4;
    }
    if let Some(rest) = text[length..].strip_prefix('.')
        && digits(rest) > 0
    {
        length += 1 + digits(rest);
    }
    if let Some(rest) = text[length..].strip_prefix('e') {
        let sign = usize::from(rest.starts_with('-'));
        if digits(&rest[sign..]) > 0 {
            length += 1 + sign + digits(&rest[sign..]);
        }
    }
    length
}

fn number(text: &str, after: &str, is_negative: bool) -> Option<Number> {
    let plain = text.replace([' ', ','], "");
    let mantissa = plain.split('e').next().unwrap_or_default();
    let exponent: i32 = plain.split_once('e').map_or(Ok(0), |(_, e)| e.parse()).ok()?;
    let unit = after.trim_start();
    let per_cent = unit.starts_with('%');
    let scale = if per_cent { 0.01 } else { 1.0 };
    let value: f64 = plain.parse().ok()?;
    // Zeros at the end of a whole number may be no digits of it.
    let places = match mantissa.split_once('.') {
        Some((_, fraction)) => -(fraction.len() as i32),
        None => (mantissa.len() - mantissa.trim_end_matches('0').len()) as i32,
    };
    let places = if value == 0.0 { places.min(0) } else { places };
    Some(Number {
        text: format!("{text}{}", if per_cent { " %" } else { "" }),
        value: scale * if is_negative { -value } else { value },
        step: scale * 10_f64.powi(places + exponent),
        is_milliseconds: unit
            .strip_prefix("ms")
            .is_some_and(|rest| !rest.starts_with(char::is_alphanumeric)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "| preset | ms | RMSE |\n|---|---|---|\n| fast | 11.47 | 0.1069 |\n\
                         | accurate | 243.70 | 0.0038 |\nfast, 10 s, 1.06 %, 0.97 (0.90 to 1.05)\n";

    fn found(page: &str) -> Vec<String> {
        let read = |file: &str| {
            anyhow::ensure!(file == "r.md", "{file}: no such file");
            Ok(TABLE.to_owned())
        };
        check("a.md", page, read)
    }

    #[test]
    fn a_number_is_compared_by_its_own_digits() {
        let agrees = |a: &str, b: &str| numbers(a)[0].agrees(&numbers(b)[0]);
        for (a, b) in [
            ("11 %", "0.1069"),
            ("11 ms", "0.01147"),
            ("240", "243.70"),
            ("0.4 %", "0.0038"),
            ("3 times", "300 %"),
            ("20 000", "20000"),
            ("1,500", "1500"),
            ("2.3e-1", "2.275e-1"),
            ("−0.5", "-0.51"),
            ("0", "0.2"),
        ] {
            assert!(agrees(a, b), "{a} {b}");
        }
        for (a, b) in [("12 %", "0.1069"), ("240", "247"), ("11.5", "11.4"), ("10 s", "0.01")] {
            assert!(!agrees(a, b), "{a} {b}");
        }
        let all = numbers("f32, N = 22: 1.16 to 1.19 × 10, x_3, 3 × 64, 2-3");
        let all: Vec<f64> = all.iter().map(|number| number.value).collect();
        assert_eq!(all, [22.0, 1.16, 1.19, 10.0, 3.0, 64.0, 2.0, 3.0]);
    }

    #[test]
    fn a_table_agrees_with_the_rows_of_the_same_names() {
        let page = |rows: &str| {
            format!("<!-- result: r.md -->\n\n| p | q |\n| --- | --- |\n{rows}\n\nNo 77.\n")
        };
        let good =
            page("| `fast` | 11 ms, RMSE 11 %, 10 s, 1.06 % |\n| accurate | 240 ms, 0.4 % |");
        assert_eq!(found(&good), [""; 0]);
        let wrong = found(&page("| `fast` | 12 ms |\n| slow | 1 ms |"));
        let expected = [
            "a.md:5: 12 is in no line with \"fast\" of r.md",
            "a.md:6: r.md has no line with \"slow\"",
        ];
        assert_eq!(wrong, expected);
    }

    #[test]
    fn a_comment_behind_a_number_names_its_source() {
        let cell = "| a | 11 ms <!-- result: r.md#fast -->, 240 <!-- result: r.md#accurate --> |";
        assert_eq!(found(cell), [""; 0]);
        let wrong = found("In all 9.9 <!-- result: r.md#fast -->\nand 3 <!-- result: s.md#x -->");
        let expected =
            ["a.md:1: 9.9 is in no line with \"fast\" of r.md", "a.md:2: s.md: no such file"];
        assert_eq!(wrong, expected);
        assert_eq!(found("no number <!-- result: r.md#fast -->").len(), 1);
    }
}
