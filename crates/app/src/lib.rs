#![doc = include_str!("../README.md")]
#![allow(clippy::print_stderr, reason = "the program reports errors and progress")]

pub mod cli;
pub mod error;
pub mod messages;
pub mod prelude;
mod serve;

pub use ::{
    boundary, dataset, estimate, export, field, files, film, fit, glam, inspect, loss, mesh,
    metrics, multiview, optim, poses, random, render, report, scene, sdf_nn, trace, warp,
};
