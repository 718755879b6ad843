//! Progress on standard error: a bar on a terminal, else a line about every ten seconds.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::messages::Console;
use crate::messages::clock::Clock;

/// The length of the bar: it moves in steps of 0.01 %.
const LENGTH: u64 = 10_000;

/// The progress of a step of a command: on standard error, or for the host.
#[derive(Debug)]
pub struct Progress {
    name: String,
    bar: ProgressBar,
    /// The clock of lines in place of a bar that is not drawn; `None` with a bar, and with
    /// `--quiet`.
    lines: Option<Clock>,
    start: Instant,
    /// The fraction that was shown first.
    first: OnceLock<f64>,
    console: Console,
}

impl Console {
    /// The progress of the step `name`: a bar on a terminal, else a line about every ten seconds on
    /// standard error; nothing with `quiet`. `template` is that of the bar: `{msg}` in it is the
    /// name, or the text of the progress. A host gets all of it, with `quiet` too.
    pub fn progress(&self, name: &str, template: &str, quiet: bool) -> Progress {
        Progress::new(name, template, quiet || self.is_hosted(), self)
    }
}

impl Progress {
    /// See [`Console::progress`].
    fn new(name: &str, template: &str, quiet: bool, console: &Console) -> Self {
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(LENGTH) };
        let bar = match ProgressStyle::with_template(template) {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        };
        let lines = (!quiet && bar.is_hidden()).then(|| console.clock.clone());
        bar.set_message(name.to_owned());
        let (start, first) = (Instant::now(), OnceLock::new());
        Progress { name: name.to_owned(), bar, lines, start, first, console: console.clone() }
    }

    /// Shows a fraction between 0 and 1, and a text.
    pub fn show(&self, fraction: f64, text: &dyn Fn() -> String) {
        if self.lines.is_none() && !self.console.is_hosted() {
            self.bar.set_message(text());
        }
        self.advance(fraction, text);
    }

    /// A callback that shows a fraction between 0 and 1, on any thread.
    pub fn mover(&self) -> impl Fn(f64) + Sync + '_ {
        |fraction| self.advance(fraction, &String::new)
    }

    fn advance(&self, fraction: f64, text: &dyn Fn() -> String) {
        let fraction = fraction.clamp(0.0, 1.0);
        self.console.tell_host(&self.name, fraction, text);
        self.bar.set_position((fraction * LENGTH as f64) as u64);
        let first = *self.first.get_or_init(|| fraction);
        let times = || times(first, fraction, self.start.elapsed());
        self.console.tell_page(&self.name, fraction, text, &times);
        let Some(clock) = &self.lines else { return };
        if clock.is_due(clock.elapsed()) {
            let (text, times, percent) = (text(), times(), 100.0 * fraction);
            let text = if text.is_empty() { text } else { format!(", {text}") };
            let line = format!("{}: {percent:.0} %, {times}{text}", self.name);
            eprintln!("{}", files::printable(&line));
        }
    }

    /// Removes the bar.
    pub fn finish_and_clear(&self) {
        self.bar.finish_and_clear();
    }
}

/// The elapsed time, and the remaining time if it is known. `first` is the fraction at the start: a
/// resumed fit starts above 0.
fn times(first: f64, fraction: f64, elapsed: Duration) -> String {
    let (done, left) = (fraction - first, 1.0 - fraction);
    let elapsed = elapsed.as_secs_f64();
    let remaining = (done > 0.0).then(|| format!(", {} left", clock(elapsed * left / done)));
    format!("{} elapsed{}", clock(elapsed), remaining.unwrap_or_default())
}

/// A time as hours, minutes and seconds, the hours only from one hour on.
fn clock(seconds: f64) -> String {
    let seconds = seconds as u64;
    let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    match hours {
        0 => format!("{minutes}:{seconds:02}"),
        _ => format!("{hours}:{minutes:02}:{seconds:02}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_remaining_time_counts_from_the_start_of_the_process() {
        let text = |first, fraction, seconds| times(first, fraction, Duration::from_secs(seconds));
        assert_eq!(text(0.0, 0.25, 30), "0:30 elapsed, 1:30 left");
        assert_eq!(text(0.5, 0.75, 3700), "1:01:40 elapsed, 1:01:40 left");
        assert_eq!(text(0.5, 0.5, 12), "0:12 elapsed");
    }
}
