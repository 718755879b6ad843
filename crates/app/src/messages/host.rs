//! Programs around a command.

/// A program that runs commands inside its own process.
///
/// Several threads of a command may call it at the same time.
pub trait Host: Send + Sync {
    /// Takes the result of the command, as JSON.
    fn result(&self, json: &str);

    /// Takes a warning or a note of one line.
    fn line(&self, line: &str);

    /// Takes the progress of a step: its name, the fraction that is done, 0 to 1, and a text that
    /// may be empty.
    fn progress(&self, step: &str, fraction: f64, text: &dyn Fn() -> String);

    /// Whether the command shall stop. From the first `true` on, it stays so.
    fn is_interrupted(&self) -> bool;
}
