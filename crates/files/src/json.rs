//! A strict reader of JSON objects: an unknown key is an error, like a missing or a wrong one.
//!
//! Code asks an [`Object`] for each key that it knows, and calls [`Object::finish`] at the end. All
//! errors name the file, the JSON pointer (RFC 6901) of the key, the value found and the value
//! expected.

#![warn(clippy::cast_possible_truncation)]

use std::cell::RefCell;
use std::path::Path;

use glam::DVec3;
use serde_json::{Map, Value};

use crate::InputError;
use crate::regular::{read_within, text};

/// The most characters of a value that a message shows.
const SHOWN_CHARACTERS: usize = 60;

/// The largest magnitude of a radiance in a file. Images hold single precision, which ends at
/// 3.4e38; the rest is room for derivatives.
const LARGEST_RADIANCE: f64 = 1e30;

/// A JSON object that is being read; it knows its place in the file, and which keys were asked for.
///
/// Every method that takes a key marks it as known. A method that returns a value without an
/// `Option` reports a missing key as an error, with `nothing` as the value found.
#[derive(Debug)]
pub struct Object<'a> {
    file: &'a Path,
    pointer: String,
    map: &'a Map<String, Value>,
    known: RefCell<Vec<&'static str>>,
}

type Result<T> = std::result::Result<T, InputError>;

/// Bytes of memory for each byte of a JSON file: `[0,0,` has a value of 32 bytes for every two, and
/// an array that grows has twice the room.
const MEMORY_PER_BYTE: u64 = 64;

/// Reads a JSON file. Python's `NaN`, `Infinity` and `-Infinity` become strings: a reader that
/// wants a number there refuses them by name.
///
/// # Errors
/// If it is no regular file, cannot be read, is too large for the memory or is not JSON. The error
/// names the line.
pub fn read(path: &Path) -> Result<Value> {
    let bytes = read_within(path, "file", "a JSON file", MEMORY_PER_BYTE)?;
    let text = text(path, "file", "a JSON file", bytes)?;
    serde_json::from_str(&text).or_else(|e| {
        let error = || {
            InputError::new(path, format!("line {} column {}", e.line(), e.column()), &e, "JSON")
        };
        serde_json::from_str(&quoted(&text)).map_err(|_| error())
    })
}

/// The words of numbers that are not finite, as Python writes them.
const NOT_FINITE: [&str; 3] = ["-Infinity", "Infinity", "NaN"];

/// Whether a value is a number that is not finite, as [`read`] returns it: a string.
fn not_finite(value: &Value) -> bool {
    value.as_str().is_some_and(|text| NOT_FINITE.contains(&text))
}

/// Whether a number is missing, or one in arrays of any depth: null, or not finite as [`read`]
/// returns it.
pub fn has_gap(value: &Value) -> bool {
    match value {
        Value::Array(items) => items.iter().any(has_gap),
        item => item.is_null() || not_finite(item),
    }
}

/// The text with Python's words for numbers that are not finite as strings: JSON has none.
fn quoted(text: &str) -> String {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    let (mut is_string, mut is_escaped) = (false, false);
    while let Some(c) = rest.chars().next() {
        let word = NOT_FINITE.iter().find(|word| !is_string && rest.starts_with(**word));
        if let Some(word) = word {
            out.extend(["\"", word, "\""]);
            rest = &rest[word.len()..];
            continue;
        }
        (is_string, is_escaped) = match c {
            '"' if !is_escaped => (!is_string, false),
            '\\' if is_string => (true, !is_escaped),
            _ => (is_string, false),
        };
        out.push(c);
        rest = &rest[c.len_utf8()..];
    }
    out
}

/// A value as JSON text for a message: its first 60 characters, then `…` if there are more.
pub fn shown(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(SHOWN_CHARACTERS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

impl<'a> Object<'a> {
    /// Starts to read `value`, which is at the JSON pointer `pointer` of `file`. The pointer of a
    /// whole file is empty.
    ///
    /// # Errors
    /// If the value is no object.
    pub fn new(file: &'a Path, pointer: impl Into<String>, value: &'a Value) -> Result<Self> {
        let pointer = pointer.into();
        let map = value.as_object().ok_or_else(|| {
            let field = if pointer.is_empty() { "/" } else { &pointer };
            InputError::new(file, field, shown(value), "an object")
        })?;
        Ok(Object { file, pointer, map, known: RefCell::default() })
    }

    /// The JSON pointer of `key`, for example `/camera/focal`. It does not mark the key as known.
    pub fn pointer(&self, key: &str) -> String {
        format!("{}/{key}", self.pointer)
    }

    /// The error of a wrong value at `key`; `expected` describes the values that are allowed there.
    /// It does not mark the key as known.
    pub fn error(&self, key: &str, expected: &str) -> InputError {
        let found = self.map.get(key).map_or_else(|| "nothing".to_owned(), shown);
        InputError::new(self.file, self.pointer(key), found, expected)
    }

    /// The value at `key`, unchecked; `None` if the key is missing.
    pub fn optional(&self, key: &'static str) -> Option<&'a Value> {
        let mut known = self.known.borrow_mut();
        if !known.contains(&key) {
            known.push(key);
        }
        self.map.get(key)
    }

    fn required(&self, key: &'static str, expected: &str) -> Result<&'a Value> {
        self.optional(key).ok_or_else(|| self.error(key, expected))
    }

    /// A finite number.
    ///
    /// # Errors
    /// If the key is missing or its value is no such number.
    pub fn number(&self, key: &'static str) -> Result<f64> {
        let value = self.required(key, "a number")?;
        value.as_f64().filter(|v| v.is_finite()).ok_or_else(|| self.error(key, "a number"))
    }

    /// A finite number above 0.
    ///
    /// # Errors
    /// If the key is missing or its value is no such number.
    pub fn positive(&self, key: &'static str) -> Result<f64> {
        let value = self.number(key)?;
        if value > 0.0 { Ok(value) } else { Err(self.error(key, "a number above 0")) }
    }

    /// A whole number from 1 to 65535: the width or the height of an image, in pixels.
    ///
    /// # Errors
    /// If the key is missing or its value is no such number.
    pub fn size(&self, key: &'static str) -> Result<u32> {
        let value = self.required(key, "a whole number from 1 to 65535")?;
        let size = value.as_u64().and_then(|v| u16::try_from(v).ok()).filter(|v| *v > 0);
        size.map(u32::from).ok_or_else(|| self.error(key, "a whole number from 1 to 65535"))
    }

    /// An array of exactly `N` finite numbers.
    ///
    /// # Errors
    /// If the key is missing or its value is no such array.
    pub fn numbers<const N: usize>(&self, key: &'static str) -> Result<[f64; N]> {
        let expected = format!("an array of {N} numbers");
        let value = self.required(key, &expected)?;
        numbers(value).ok_or_else(|| self.error(key, &expected))
    }

    /// A radiance, an intensity or an albedo: three numbers (linear RGB) of magnitude 1e30 at most.
    /// Images hold single precision, which ends at 3.4e38, and derivatives need room below that.
    ///
    /// # Errors
    /// If the key is missing or its value is no such array.
    pub fn light(&self, key: &'static str) -> Result<[f64; 3]> {
        let rgb = self.numbers(key)?;
        if rgb.iter().all(|c: &f64| c.abs() <= LARGEST_RADIANCE) {
            Ok(rgb)
        } else {
            Err(self.error(key, "an array of 3 numbers, none beyond 1e30"))
        }
    }

    /// A vector of three numbers that can be normalised; it is returned as it is in the file.
    ///
    /// # Errors
    /// If the key is missing, or its value is no such array or has no direction.
    pub fn direction(&self, key: &'static str) -> Result<DVec3> {
        let v = DVec3::from(self.numbers(key)?);
        if v.try_normalize().is_some() {
            Ok(v)
        } else {
            Err(self.error(key, "a vector other than zero"))
        }
    }

    /// A string.
    ///
    /// # Errors
    /// If the key is missing or its value is no string.
    pub fn string(&self, key: &'static str) -> Result<&'a str> {
        self.required(key, "a string")?.as_str().ok_or_else(|| self.error(key, "a string"))
    }

    /// A boolean; `default` if the key is missing.
    ///
    /// # Errors
    /// If the value is neither `true` nor `false`.
    pub fn boolean(&self, key: &'static str, default: bool) -> Result<bool> {
        match self.optional(key) {
            None => Ok(default),
            Some(value) => value.as_bool().ok_or_else(|| self.error(key, "true or false")),
        }
    }

    /// A nested object. The caller also finishes the nested one.
    ///
    /// # Errors
    /// If the key is missing or its value is no object.
    pub fn object(&self, key: &'static str) -> Result<Object<'a>> {
        Object::new(self.file, self.pointer(key), self.required(key, "an object")?)
    }

    /// The objects of an array, in its order. The caller also finishes each of them.
    ///
    /// # Errors
    /// If the key is missing, its value is no array of objects, or the array is empty although
    /// `at_least_one` is set.
    pub fn objects(&self, key: &'static str, at_least_one: bool) -> Result<Vec<Object<'a>>> {
        let expected =
            if at_least_one { "an array of one object or more" } else { "an array of objects" };
        let array = self
            .required(key, expected)?
            .as_array()
            .filter(|a| !at_least_one || !a.is_empty())
            .ok_or_else(|| self.error(key, expected))?;
        let object = |(i, v)| Object::new(self.file, format!("{}/{i}", self.pointer(key)), v);
        array.iter().enumerate().map(object).collect()
    }

    /// Ends the reading.
    ///
    /// # Errors
    /// If the object has a key that was not asked for.
    pub fn finish(self) -> Result<()> {
        let known = self.known.borrow();
        match self.map.keys().find(|key| !known.contains(&key.as_str())) {
            None => Ok(()),
            Some(key) => {
                let expected = format!("one of {}", known.join(", "));
                Err(InputError::new(self.file, self.pointer(key), "an unknown key", expected))
            }
        }
    }
}

/// The value as an array of exactly `N` finite numbers; `None` if it is no such array.
pub fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> =
        value.as_array()?.iter().map(|v| v.as_f64().filter(|v| v.is_finite())).collect();
    numbers?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn object(value: &Value) -> Object<'_> {
        Object::new(Path::new("a.json"), "/part", value).unwrap()
    }

    #[test]
    fn a_wrong_or_missing_value_is_named_by_its_pointer() {
        let value = json!({
            "size": 0, "radius": -1, "light": [1, 1e31, 0], "normal": [0, 0, 0], "on": 1,
            "list": [], "mixed": [{}, 3],
        });
        let part = object(&value);
        for (error, words) in [
            (part.size("size").err(), "/part/size: found 0, expected a whole number"),
            (part.positive("radius").err(), "/part/radius: found -1, expected a number above 0"),
            (part.light("light").err(), "/part/light: found [1,1e+31,0], expected an array of 3"),
            (part.direction("normal").err(), "/part/normal: found [0,0,0], expected a vector"),
            (part.boolean("on", true).err(), "/part/on: found 1, expected true or false"),
            (part.string("name").err(), "/part/name: found nothing, expected a string"),
            (part.objects("list", true).err(), "/part/list: found [], expected an array of one"),
            (part.objects("mixed", false).err(), "/part/mixed/1: found 3, expected an object"),
        ] {
            let error = error.expect(words).to_string();
            assert!(error.starts_with("a.json: ") && error.contains(words), "{error}");
        }
        part.finish().unwrap();
    }

    #[test]
    fn an_unknown_key_is_an_error() {
        let value = json!({"radius": 2, "radios": 3});
        let part = object(&value);
        assert_eq!(part.positive("radius"), Ok(2.0));
        assert_eq!(part.boolean("shadows", true), Ok(true));
        let error = part.finish().unwrap_err().to_string();
        assert!(error.contains("/part/radios") && error.contains("radius, shadows"), "{error}");
    }

    #[test]
    fn a_long_value_is_cut_in_messages() {
        assert_eq!(shown(&json!("x".repeat(90))), format!("\"{}…", "x".repeat(59)));
        assert_eq!(shown(&json!([1, 2])), "[1,2]");
    }
}
