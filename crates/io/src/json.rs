//! Reading JSON objects strictly: every key is asked for, and what is left over is an error.

use std::cell::RefCell;
use std::path::Path;

use glam::DVec3;
use serde_json::{Map, Value};

use crate::InputError;

/// One JSON object being read; knows where it stands, for messages.
pub struct Object<'a> {
    file: &'a Path,
    pointer: String,
    map: &'a Map<String, Value>,
    known: RefCell<Vec<&'static str>>,
}

type Result<T> = std::result::Result<T, InputError>;

/// The value as a message shows it, cut short.
pub fn shown(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

impl<'a> Object<'a> {
    /// Starts on `value`, which stands at `pointer` of `file`.
    pub fn new(file: &'a Path, pointer: impl Into<String>, value: &'a Value) -> Result<Self> {
        let pointer = pointer.into();
        let map = value.as_object().ok_or_else(|| {
            let place = if pointer.is_empty() { "/" } else { &pointer };
            InputError::new(file, place, shown(value), "an object")
        })?;
        Ok(Object { file, pointer, map, known: RefCell::default() })
    }

    /// The JSON pointer of a key.
    pub fn pointer(&self, key: &str) -> String {
        format!("{}/{key}", self.pointer)
    }

    /// The error of a key whose value will not do.
    pub fn error(&self, key: &str, expected: &str) -> InputError {
        let found = self.map.get(key).map_or_else(|| "nothing".to_owned(), shown);
        InputError::new(self.file, self.pointer(key), found, expected)
    }

    /// The value under `key`, if it is there; the key counts as known from now on.
    pub fn optional(&self, key: &'static str) -> Option<&'a Value> {
        self.known.borrow_mut().push(key);
        self.map.get(key)
    }

    fn required(&self, key: &'static str, expected: &str) -> Result<&'a Value> {
        self.optional(key).ok_or_else(|| self.error(key, expected))
    }

    /// A finite number.
    pub fn number(&self, key: &'static str) -> Result<f64> {
        let value = self.required(key, "a number")?;
        value.as_f64().filter(|v| v.is_finite()).ok_or_else(|| self.error(key, "a number"))
    }

    /// A number above zero.
    pub fn positive(&self, key: &'static str) -> Result<f64> {
        let value = self.number(key)?;
        if value > 0.0 { Ok(value) } else { Err(self.error(key, "a number above 0")) }
    }

    /// A whole number from 1 to 65535.
    pub fn size(&self, key: &'static str) -> Result<u32> {
        let value = self.required(key, "a whole number from 1 to 65535")?;
        let size = value.as_u64().filter(|v| (1..=65535).contains(v));
        size.map(|v| v as u32).ok_or_else(|| self.error(key, "a whole number from 1 to 65535"))
    }

    /// An array of `N` finite numbers.
    pub fn numbers<const N: usize>(&self, key: &'static str) -> Result<[f64; N]> {
        let expected = format!("an array of {N} numbers");
        let value = self.required(key, &expected)?;
        numbers(value).ok_or_else(|| self.error(key, &expected))
    }

    /// Three numbers that radiance is made of, no larger than 1e30: images hold single precision,
    /// and their derivatives need room.
    pub fn light(&self, key: &'static str) -> Result<[f64; 3]> {
        let rgb = self.numbers(key)?;
        let held = rgb.iter().all(|c: &f64| c.abs() <= 1e30);
        if held { Ok(rgb) } else { Err(self.error(key, "an array of 3 numbers, none beyond 1e30")) }
    }

    /// A vector other than zero.
    pub fn direction(&self, key: &'static str) -> Result<DVec3> {
        let v = DVec3::from(self.numbers(key)?);
        if v.try_normalize().is_some() {
            Ok(v)
        } else {
            Err(self.error(key, "a vector other than zero"))
        }
    }

    /// A string.
    pub fn string(&self, key: &'static str) -> Result<&'a str> {
        self.required(key, "a string")?.as_str().ok_or_else(|| self.error(key, "a string"))
    }

    /// A truth value, `default` where the key is absent.
    pub fn boolean(&self, key: &'static str, default: bool) -> Result<bool> {
        match self.optional(key) {
            None => Ok(default),
            Some(value) => value.as_bool().ok_or_else(|| self.error(key, "true or false")),
        }
    }

    /// A nested object.
    pub fn object(&self, key: &'static str) -> Result<Object<'a>> {
        Object::new(self.file, self.pointer(key), self.required(key, "an object")?)
    }

    /// The objects of an array that may not be empty if `at_least_one`.
    pub fn objects(&self, key: &'static str, at_least_one: bool) -> Result<Vec<Object<'a>>> {
        let expected =
            if at_least_one { "an array of one object or more" } else { "an array of objects" };
        let array = self.required(key, expected)?.as_array();
        let array = array
            .filter(|a| !at_least_one || !a.is_empty())
            .ok_or_else(|| self.error(key, expected))?;
        array
            .iter()
            .enumerate()
            .map(|(i, v)| Object::new(self.file, format!("{}/{i}", self.pointer(key)), v))
            .collect()
    }

    /// Ends the reading: a key that nobody asked for is an error.
    pub fn finish(self) -> Result<()> {
        let known = self.known.into_inner();
        match self.map.keys().find(|key| !known.contains(&key.as_str())) {
            None => Ok(()),
            Some(key) => {
                let expected = format!("one of {}", known.join(", "));
                Err(InputError::new(
                    self.file,
                    format!("{}/{key}", self.pointer),
                    "an unknown key",
                    expected,
                ))
            }
        }
    }
}

/// `N` finite numbers, or nothing.
pub fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> =
        value.as_array()?.iter().map(|v| v.as_f64().filter(|v| v.is_finite())).collect();
    numbers?.try_into().ok()
}
