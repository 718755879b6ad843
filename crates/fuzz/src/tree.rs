//! Texts of nested values: JSON, TOML and the dictionaries of NumPy.

use serde_json::Value;

use crate::spoil::{Spoil, repetitions};

/// A nested value. Leaves and keys are bytes, so that they can be wrong in every way.
#[derive(Clone, Debug)]
pub(crate) enum Tree {
    /// A number, a quoted text, or harm.
    Leaf(Vec<u8>),
    /// A list.
    List(Vec<Tree>),
    /// Keys with their values, in order; a key may occur twice.
    Map(Vec<(Vec<u8>, Tree)>),
}

/// How a nested value is written.
#[derive(Clone, Copy)]
struct Syntax {
    equals: &'static [u8],
    list: [u8; 2],
    /// A comma after the last item of a list, as tuples of one need it.
    last_comma: bool,
}

const JSON: Syntax = Syntax { equals: b":", list: *b"[]", last_comma: false };
const TOML: Syntax = Syntax { equals: b"=", list: *b"[]", last_comma: false };
const PYTHON: Syntax = Syntax { equals: b":", list: *b"()", last_comma: true };

impl From<Value> for Tree {
    fn from(value: Value) -> Self {
        match value {
            Value::Array(list) => Tree::List(list.into_iter().map(Tree::from).collect()),
            Value::Object(map) => Tree::Map(
                map.into_iter().map(|(key, value)| (key.into_bytes(), value.into())).collect(),
            ),
            leaf => Tree::Leaf(leaf.to_string().into_bytes()),
        }
    }
}

impl Tree {
    /// The value at a key of a map.
    pub(crate) fn get_mut(&mut self, key: &str) -> Option<&mut Tree> {
        let Tree::Map(map) = self else { return None };
        map.iter_mut().find(|(k, _)| k == key.as_bytes()).map(|(_, value)| value)
    }

    /// The text as JSON.
    pub(crate) fn json(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.print(JSON, &mut out);
        out
    }

    /// The text as TOML: a line for each key, with inner tables inline.
    pub(crate) fn toml(&self) -> Vec<u8> {
        let Tree::Map(map) = self else { return self.json() };
        let mut out = Vec::new();
        for (key, value) in map {
            print_key(key, &mut out);
            out.extend(TOML.equals);
            value.print(TOML, &mut out);
            out.push(b'\n');
        }
        out
    }

    /// The text as a dictionary of Python with tuples.
    pub(crate) fn python(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.print(PYTHON, &mut out);
        out.iter().map(|b| if *b == b'"' { b'\'' } else { *b }).collect()
    }

    fn print(&self, syntax: Syntax, out: &mut Vec<u8>) {
        match self {
            Tree::Leaf(text) => out.extend(text),
            Tree::List(list) => {
                out.push(syntax.list[0]);
                for (i, item) in list.iter().enumerate() {
                    item.print(syntax, out);
                    if syntax.last_comma || i + 1 < list.len() {
                        out.push(b',');
                    }
                }
                out.push(syntax.list[1]);
            }
            Tree::Map(map) => {
                out.push(b'{');
                for (i, (key, value)) in map.iter().enumerate() {
                    print_key(key, out);
                    out.extend(syntax.equals);
                    value.print(syntax, out);
                    if i + 1 < map.len() {
                        out.push(b',');
                    }
                }
                out.push(b'}');
            }
        }
    }

    /// The number of values, with all inner ones.
    fn count(&self) -> usize {
        1 + match self {
            Tree::Leaf(_) => 0,
            Tree::List(list) => list.iter().map(Tree::count).sum(),
            Tree::Map(map) => map.iter().map(|(_, value)| value.count()).sum(),
        }
    }

    /// Value number `n`, counted from the outside; the number that remains if there are fewer.
    fn nth(&mut self, n: usize) -> Result<&mut Tree, usize> {
        if n == 0 {
            return Ok(self);
        }
        let mut left = n - 1;
        let inner: Vec<&mut Tree> = match self {
            Tree::Leaf(_) => Vec::new(),
            Tree::List(list) => list.iter_mut().collect(),
            Tree::Map(map) => map.iter_mut().map(|(_, value)| value).collect(),
        };
        for value in inner {
            match value.nth(left) {
                Ok(found) => return Ok(found),
                Err(rest) => left = rest,
            }
        }
        Err(left)
    }
}

fn print_key(key: &[u8], out: &mut Vec<u8>) {
    out.push(b'"');
    out.extend(key);
    out.push(b'"');
}

/// Wrong values of all three languages. A value of another language is a fault of syntax.
const LEAVES: [&str; 44] = [
    "0",
    "-1",
    "-0.0",
    "1",
    "7",
    "2147483647",
    "2147483648",
    "4294967296",
    "9007199254740992",
    "1152921504606846976",
    "9223372036854775807",
    "9223372036854775808",
    "18446744073709551615",
    "18446744073709551616",
    "1e300",
    "-1e300",
    "1e-320",
    "1e999",
    "1e38",
    "0.5",
    "1000000000",
    "65536",
    "NaN",
    "nan",
    "inf",
    "-inf",
    "null",
    "true",
    "False",
    "\"\"",
    "\"\\u0000\"",
    "\"\\u001b[31m\\u0007\"",
    "\"a\\nb\\r\"",
    "\"../../../../../../dev/zero\"",
    "\"/dev/zero\"",
    "\"/proc/self/mem\"",
    "\"/\"",
    "\".\"",
    "[]",
    "{}",
    "[2147483648,0]",
    "[1152921504606846976,0]",
    "[[[[]]]]",
    "\"|O8\"",
];

/// A hostile value. `[0, 1, 2, …]` multiplies the cells of a sweep.
fn hostile(harm: usize) -> Vec<u8> {
    let nested = |open: &str, close: &str, depth: usize| {
        [open.repeat(depth), close.repeat(depth)].concat().into_bytes()
    };
    let quoted = |text: &[u8]| [b"\"", text, b"\""].concat();
    let numbers = |n: usize| {
        format!("[{}]", (0..n).map(|i| i.to_string()).collect::<Vec<_>>().join(",")).into_bytes()
    };
    match harm % (LEAVES.len() + 16) {
        0 => nested("[", "]", 22),
        1 => nested("[", "]", 120),
        2 => nested("[", "]", 50_000),
        3 => nested("(", ")", 22),
        4 => nested("(", ")", 300),
        5 => nested("{\"a\":", "}", 50_000),
        6 => nested("{\"a\"=", "}", 50_000),
        7 => nested("[{\"type\":\"union\",\"children\":", "}]", 60),
        8 => quoted(&[b'n'; 300]),
        9 => quoted(&[b'n'; 100_000]),
        10 => quoted(b"\xff\xfe"),
        11 => quoted(b"\x1b[2J\x07"),
        12 => numbers(300),
        13 => numbers(3000),
        14 => nested("\"a/", "b\"", 2000),
        15 => nested("[0.5", "]", 3),
        other => LEAVES[other - 16].as_bytes().to_vec(),
    }
}

impl Spoil for Tree {
    fn spoil(&mut self, place: usize, harm: usize) {
        let place = place % self.count();
        let Ok(target) = self.nth(place) else { return };
        // Half of the harm to lists and tables is to their items.
        let (kind, item) = (harm % 10, harm / 10);
        match target {
            Tree::List(list) if !list.is_empty() && kind < 5 => spoil_list(list, kind, item),
            Tree::Map(map) if !map.is_empty() && kind < 7 => spoil_map(map, kind, item),
            target => *target = Tree::Leaf(hostile(harm)),
        }
    }
}

fn spoil_list(list: &mut Vec<Tree>, kind: usize, item: usize) {
    let i = item % list.len();
    match kind {
        0 => list.clear(),
        1 => drop(list.remove(i)),
        2 => list.push(list[i].clone()),
        3 => {
            let item = list[i].clone();
            *list = vec![item.clone(); repetitions(item.json().len(), 2000)];
        }
        _ => list.truncate(1),
    }
}

fn spoil_map(map: &mut Vec<(Vec<u8>, Tree)>, kind: usize, item: usize) {
    let i = item % map.len();
    let unknown: [&[u8]; 6] = [b"unknown", b"", b"\\u001b[31m", b"\xff", b"a/b~c", &[b'k'; 3000]];
    let key = unknown[item % unknown.len()].to_vec();
    match kind {
        0..3 => drop(map.remove(i)),
        3 => map.push(map[i].clone()),
        4 => map[i].0 = key,
        5 => map.push((key, Tree::Leaf(b"1".to_vec()))),
        _ => map[i].1 = Tree::Leaf(hostile(item)),
    }
}
