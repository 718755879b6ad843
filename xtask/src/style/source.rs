//! The text of a Rust file, apart: code without comments, strings and tests; and the comments.

/// The parts of a Rust file. Both have the lines of the file.
pub(crate) struct Source {
    /// The code, with spaces in place of comments, of the content of strings, and of items that
    /// only tests have.
    pub(crate) code: String,
    /// The text of the comments.
    pub(crate) comments: String,
}

impl Source {
    /// Takes a file apart.
    pub(crate) fn new(text: &str) -> Self {
        let (code, comments) = split(text);
        Source { code: without_tests(&code), comments }
    }

    /// The comments without the marks in front of their lines.
    pub(crate) fn prose(&self) -> String {
        let line = |line: &str| line.trim_start().trim_start_matches(['/', '!']).to_owned() + "\n";
        self.comments.lines().map(line).collect()
    }
}

/// Code and comments, each with spaces in place of the other.
fn split(text: &str) -> (String, String) {
    let (mut code, mut comments) = (String::new(), String::new());
    let mut rest = text;
    let mut last = ' ';
    while let Some(first) = rest.chars().next() {
        let inside = last.is_alphanumeric() || last == '_';
        let (length, kind) = token(rest, inside);
        let (token, after) = rest.split_at(length);
        match kind {
            Kind::Code => code.push_str(token),
            Kind::Comment => comments.push_str(token),
            Kind::Text => {}
        }
        if kind != Kind::Code {
            code.extend(token.chars().map(blank));
        }
        if kind != Kind::Comment {
            comments.extend(token.chars().map(blank));
        }
        last = if length == first.len_utf8() { first } else { ' ' };
        rest = after;
    }
    (code, comments)
}

fn blank(c: char) -> char {
    if c == '\n' { '\n' } else { ' ' }
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Code,
    Comment,
    /// A string or a character.
    Text,
}

/// The length of the first token, in bytes. `inside` says that it continues a word.
fn token(text: &str, inside: bool) -> (usize, Kind) {
    let first = text.chars().next().map_or(0, char::len_utf8);
    if text.starts_with("//") {
        return (text.find('\n').unwrap_or(text.len()), Kind::Comment);
    }
    if text.starts_with("/*") {
        return (block_comment(text), Kind::Comment);
    }
    if text.starts_with('"') {
        return (string(text), Kind::Text);
    }
    if let Some(after) = text.strip_prefix('r').filter(|_| !inside) {
        let hashes = after.len() - after.trim_start_matches('#').len();
        if after[hashes..].starts_with('"') {
            let end = format!("\"{}", "#".repeat(hashes));
            let content = &after[hashes + 1..];
            let length = content.find(&end).map_or(content.len(), |at| at + end.len());
            return (1 + hashes + 1 + length, Kind::Text);
        }
    }
    if let Some(after) = text.strip_prefix('\'') {
        // 'a' and '\n' are characters, 'a is a lifetime.
        let mut characters = after.chars();
        match (characters.next(), characters.next()) {
            (Some('\\'), Some(escaped)) => {
                let skipped = 1 + escaped.len_utf8();
                let end = after[skipped..].find('\'').unwrap_or(0);
                return (1 + skipped + end + 1, Kind::Text);
            }
            (Some(c), Some('\'')) => return (1 + c.len_utf8() + 1, Kind::Text),
            _ => {}
        }
    }
    (first, Kind::Code)
}

/// The length of a block comment, which may hold others.
fn block_comment(text: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < text.len() {
        let rest = &text[at..];
        if rest.starts_with("/*") {
            depth += 1;
            at += 2;
        } else if rest.starts_with("*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return at;
            }
        } else {
            at += rest.chars().next().map_or(1, char::len_utf8);
        }
    }
    text.len()
}

/// The length of a string with escapes.
fn string(text: &str) -> usize {
    let mut is_escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return at + 1,
            _ => {}
        }
    }
    text.len()
}

/// The code with spaces in place of items with the attribute `#[cfg(test)]` or `#[test]`.
fn without_tests(code: &str) -> String {
    let mut out = String::new();
    let mut rest = code;
    let starts = ["#[cfg(test)]", "#[cfg(all(test", "#[test]"];
    while let Some(start) = starts.iter().filter_map(|start| rest.find(start)).min() {
        let (kept, item) = rest.split_at(start);
        let (item, after) = item.split_at(item_length(item));
        out.push_str(kept);
        out.extend(item.chars().map(blank));
        rest = after;
    }
    out + rest
}

/// The length of an item with its attributes: up to a semicolon or to the end of a block.
fn item_length(code: &str) -> usize {
    let (mut inner, mut braces) = (0_i32, 0_i32);
    for (at, c) in code.char_indices() {
        match c {
            '(' | '[' => inner += 1,
            ')' | ']' => inner -= 1,
            '{' => braces += 1,
            '}' => braces -= 1,
            _ => {}
        }
        let is_closed = c == '}' && braces <= 0 || c == ';' && braces == 0;
        if is_closed && inner <= 0 {
            return at + 1;
        }
    }
    code.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_strings_and_tests_are_no_code() {
        let text = concat!(
            "// use a::b;\nlet s = \"std::fs // no\"; /* x /* y */ z */ let c = '\"'; // end\n",
            "let r = r#\"std::env \" \"#; fn f<'a>(x: &'a str) {}\n",
            "#[cfg(test)]\nmod tests {\n    fn g() { std::fs::read(); }\n}\nlet last = 1;\n",
            "#[cfg(test)]\nmod others;\n#[test]\nfn t(x: [u8; 3]) { panic!() }\nlet very_last = 2;\n",
        );
        let source = Source::new(text);
        for gone in ["use a", "std", "no", " z ", "mod tests", "others", "panic"] {
            assert!(!source.code.contains(gone), "{gone}: {}", source.code);
        }
        for kept in ["let c", "fn f<'a>(x: &'a str)", "let last", "let very_last"] {
            assert!(source.code.contains(kept), "{kept}: {}", source.code);
        }
        assert!(source.comments.contains("use a::b;") && source.comments.contains("y */ z"));
        assert_eq!(source.code.lines().count(), text.lines().count());
        assert_eq!(source.comments.lines().count(), text.lines().count());
    }
}
