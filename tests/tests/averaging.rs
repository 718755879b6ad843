//! The result of a fit is the mean of the parameters over the last part of its budget.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;
use std::path::Path;

use serde_json::Value;
use tests::dsdf_ok;
use tests::input::{Folder, ball};

/// The first numbers of a tensor of a safetensors file, in single precision; `None` without it.
fn tensor(file: &Path, name: &str) -> Option<Vec<f32>> {
    let bytes = fs::read(file).unwrap();
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let (header, data) = bytes[8..].split_at(length);
    let header: Value = serde_json::from_slice(header).unwrap();
    let place = |i: usize| header[name]["data_offsets"][i].as_u64().map(|n| n as usize);
    let numbers = data[place(0)?..place(1)?].chunks_exact(4);
    Some(numbers.map(|n| f32::from_le_bytes(n.try_into().unwrap())).collect())
}

#[test]
fn the_model_of_a_whole_fit_is_the_mean_and_a_longer_budget_begins_it_anew() {
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "8"), folder.path("run"));
    let run = run.as_str();
    let fit = ["fit", &data, "-o", run, "--iterations", "40", "--batch", "64"];
    let checkpoint = Path::new(run).join("checkpoint/state.safetensors");
    // The first weights of the first layer are the first parameters.
    let model = || tensor(&Path::new(run).join("model.safetensors"), "layers.0.weight").unwrap();
    let first = |name: &str| tensor(&checkpoint, name).map(|all| all[..3].to_vec());
    dsdf_ok(&[&fit[..], &["--stop-after", "36"]].concat());
    let place = first("parameters").unwrap();
    assert_eq!(model()[..3], place, "the model of a part of a fit is where the steps lead");
    let mean_of_two = first("average").unwrap();
    assert_ne!(mean_of_two, place);
    dsdf_ok(&["fit", "--resume", "-o", run]);
    let average = first("average").unwrap();
    assert_eq!(model()[..3], average);
    assert_ne!(average, first("parameters").unwrap());
    // In one session, the bits are the same.
    let whole = folder.path("whole");
    let fit = ["fit", &data, "-o", &whole, "--iterations", "40", "--batch", "64"];
    dsdf_ok(&fit);
    let of_whole = tensor(&Path::new(&whole).join("model.safetensors"), "layers.0.weight");
    assert_eq!(of_whole.unwrap(), model());
    dsdf_ok(&["fit", "--resume", "-o", run, "--iterations", "80", "--stop-after", "41"]);
    assert_eq!(first("average"), None);
    assert_eq!(model()[..3], first("parameters").unwrap());
}
