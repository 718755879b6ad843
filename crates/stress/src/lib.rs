#![doc = include_str!("../README.md")]

pub mod campaign;
mod child;
pub mod fuzz;
mod random;
pub mod soak;

/// A wrong argument of a command.
#[derive(Clone, Debug)]
pub struct WrongArgument(String);

impl std::fmt::Display for WrongArgument {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl std::error::Error for WrongArgument {}
