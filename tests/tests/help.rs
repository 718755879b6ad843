//! The help of all commands.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use tests::dsdf;

/// Lines of a screen: a window of 1080 pixels has about 50.
const LINES: usize = 48;

/// Characters of a line.
const WIDTH: usize = 100;

/// The most options below one heading.
const OPTIONS: usize = 8;

#[test]
fn the_short_help_of_every_command_is_one_screen_with_groups() {
    let text = |arguments: &[&str]| String::from_utf8(dsdf(arguments).stdout).unwrap();
    let all = text(&["-h"]);
    let commands = all.split_once("Commands:\n").unwrap().1.split_once("\n\n").unwrap().0;
    let names: Vec<&str> = commands
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .collect();
    let names = names.iter().filter_map(|line| line.split_whitespace().next());
    let names: Vec<&str> = names.filter(|name| *name != "help").collect();
    assert!(names.len() >= 11 && names.contains(&"poses"), "{names:?}");
    for name in names {
        let help = text(&[name, "-h"]);
        let (lines, width) = (help.lines().count(), help.lines().map(|l| l.chars().count()).max());
        assert!(lines <= LINES && width.unwrap() <= WIDTH, "{name}: {lines}, {width:?}\n{help}");
        for group in help.split("\n\n") {
            let options = group.lines().filter(|line| line.trim_start().starts_with('-')).count();
            assert!(options <= OPTIONS, "{name}: {options} options in one group\n{group}");
        }
        assert!(text(&[name, "--help"]).len() >= help.len());
    }
}
