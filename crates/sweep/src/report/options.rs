//! Options of `dsdf fit`: names, values as text, and arguments of the command line.

use toml::Value;

/// Parameters with their values as text, in order.
pub type Settings = Vec<(String, String)>;

/// A value as the text of an option.
pub fn text(value: &Value) -> String {
    match value {
        Value::String(s) => s.clone(),
        // 1e-8, not 0.00000001.
        Value::Float(v) if *v != 0.0 && !(1e-3..1e15).contains(&v.abs()) => format!("{v:e}"),
        other => other.to_string(),
    }
}

/// Short names of options, as in the publication, with the long names of the program.
const ALIASES: [(&str, &str); 3] = [("k", "top_k"), ("N", "steps"), ("spp", "edge_rays")];

/// The program's name of an option, with underscores.
pub fn long_name(key: &str) -> &str {
    ALIASES.iter().find(|(short, _)| *short == key).map_or(key, |(_, long)| long)
}

/// An option of the command line: `--top-k=7` for `top_k` and 7. The value `true` gives a switch,
/// the value `false` nothing.
pub fn flag((key, value): (String, String)) -> Vec<String> {
    let name = format!("--{}", long_name(&key).replace('_', "-"));
    match value.as_str() {
        "true" => vec![name],
        "false" => Vec::new(),
        _ => vec![format!("{name}={value}")],
    }
}
