//! Presets: names for measured points of the trade of speed for accuracy.

use std::ffi::OsString;

use clap::ValueEnum;

/// How much to spend. `cargo xtask tradeoff` measures each; docs/tradeoff.md has the figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// A look at the answer
    Fast,
    /// The defaults
    Balanced,
    /// When it matters more than the time
    Accurate,
}

impl Preset {
    /// The flags that the preset stands for.
    fn flags(self, command: &str) -> &'static [[&'static str; 2]] {
        match (command, self) {
            ("gradient", Preset::Fast) => &[["--spp", "16"]],
            ("gradient", Preset::Accurate) => &[["--spp", "1024"]],
            ("fit", Preset::Fast) => &[["--iterations", "2000"]],
            ("fit", Preset::Accurate) => &[["--iterations", "20000"], ["--width", "96"]],
            _ => &[],
        }
    }
}

/// The arguments with the flags of a preset put in, but for those that are given anyway: what is
/// asked for by name counts.
pub(super) fn expand(arguments: Vec<OsString>) -> Vec<OsString> {
    let text: Vec<&str> = arguments.iter().map(|a| a.to_str().unwrap_or_default()).collect();
    let command = text.iter().skip(1).position(|a| *a == "gradient" || *a == "fit");
    let Some(at) = command.map(|i| i + 1) else { return arguments };
    let given = |flag: &str| {
        text[at..].iter().any(|a| {
            a.strip_prefix(flag).is_some_and(|rest| rest.is_empty() || rest.starts_with('='))
        })
    };
    let follows = |pair: &[&str]| (pair[0] == "--preset").then(|| pair[1].to_owned());
    let joined = |a: &&str| a.strip_prefix("--preset=").map(str::to_owned);
    let name =
        text[at..].windows(2).find_map(follows).or_else(|| text[at..].iter().find_map(joined));
    let Some(preset) = name.and_then(|name| Preset::from_str(&name, false).ok()) else {
        return arguments;
    };
    // A resumed run has its options.
    if given("--resume") {
        return arguments;
    }
    let asked = |flag: &str| given(flag) || (flag == "--iterations" && given("--time"));
    let flags = preset
        .flags(text[at])
        .iter()
        .filter(|[flag, _]| !asked(flag))
        .flatten()
        .map(OsString::from);
    let flags: Vec<OsString> = flags.collect();
    let mut expanded = arguments;
    expanded.splice(at + 1..at + 1, flags);
    expanded
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expanded(line: &str) -> String {
        let words = expand(line.split(' ').map(OsString::from).collect());
        words.iter().map(|w| w.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn presets_give_way_to_what_is_asked_for() {
        assert_eq!(
            expanded("dsdf gradient s.json --preset fast"),
            "dsdf gradient --spp 16 s.json --preset fast"
        );
        assert_eq!(
            expanded("dsdf fit d --preset=accurate --width=8"),
            "dsdf fit --iterations 20000 d --preset=accurate --width=8"
        );
        assert_eq!(
            expanded("dsdf fit d --preset fast --time 1m"),
            "dsdf fit d --preset fast --time 1m"
        );
        for same in [
            "dsdf gradient s.json",
            "dsdf fit d --preset balanced",
            "dsdf fit --preset wrong",
            "fit",
            "dsdf fit --resume --preset fast",
        ] {
            assert_eq!(expanded(same), same);
        }
    }
}
