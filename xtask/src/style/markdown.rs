//! Lines of Markdown, and the things in them.

/// A line of Markdown outside of code blocks, with its number from 1.
pub(crate) fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut fence: Option<&str> = None;
    text.lines().zip(1..).filter_map(move |(line, number)| {
        let start = line.trim_start();
        let mark = ["```", "~~~"].into_iter().find(|mark| start.starts_with(mark));
        match (fence, mark) {
            (None, Some(mark)) => fence = Some(mark),
            (Some(open), Some(mark)) if open == mark => fence = None,
            (None, None) => return Some((number, line)),
            _ => {}
        }
        None
    })
}

/// The pieces of a line in backticks.
pub(crate) fn code_spans(line: &str) -> impl Iterator<Item = &str> {
    // Without a closing mark, the last piece is none.
    let count = line.matches('`').count() / 2;
    line.split('`').skip(1).step_by(2).take(count)
}

/// The targets of the links and images of a line.
pub(crate) fn links(line: &str) -> Vec<&str> {
    // Brackets in code are no links; a link's text may have code.
    let mut out = Vec::new();
    let mut is_code = false;
    for (at, c) in line.char_indices() {
        is_code ^= c == '`';
        if !is_code && let Some(rest) = line[at..].strip_prefix("](") {
            out.extend(rest.split([')', ' ']).next());
        }
    }
    // `[^name]: ` starts the text of a footnote.
    let definition = line.strip_prefix('[').filter(|rest| !rest.starts_with('^'));
    let definition = definition.and_then(|rest| rest.split_once("]: "));
    out.extend(definition.and_then(|(_, target)| target.split_whitespace().next()));
    out
}

/// The section of a page below a heading of level 2.
pub(crate) fn section<'a>(page: &'a str, heading: &str) -> Option<&'a str> {
    page.split("\n## ").find_map(|section| section.strip_prefix(heading)?.strip_prefix('\n'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_code_are_no_prose() {
        let text = "a\n```sh\nb ~~~\n```\nc\n  ~~~\n```\n  ~~~\nd\n";
        assert_eq!(prose(text).collect::<Vec<_>>(), [(1, "a"), (5, "c"), (9, "d")]);
    }

    #[test]
    fn code_and_links_of_a_line() {
        let line = "`a/b` and [`c`](d.md#e \"title\"), ![f](g.png) `[x](y)` and `open";
        assert_eq!(code_spans(line).collect::<Vec<_>>(), ["a/b", "c", "[x](y)"]);
        assert_eq!(links(line), ["d.md#e", "g.png"]);
        assert_eq!(links("[name]: path/to.md"), ["path/to.md"]);
        assert_eq!(links("[^name]: Text, and [a link](c.md)."), ["c.md"]);
    }
}
