#![doc = include_str!("../README.md")]

pub mod cli;
pub mod error;
pub mod messages;
pub mod prelude;
