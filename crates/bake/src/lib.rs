#![doc = include_str!("../README.md")]

mod bake;

pub use bake::{Baked, GREY, bake};
