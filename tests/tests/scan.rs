//! `dsdf scan`: photographs, or a data set with poses, become a mesh in one command.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use tests::binary;
use tests::input::{Folder, ball, refused};

fn scan(photos: &str, output: &str) -> Output {
    let options = ["--time", "12", "--threads", "2", "--json"];
    Command::new(binary()).args(["scan", photos, "-o", output]).args(options).output().unwrap()
}

/// The result and standard error of a scan that succeeds.
fn scanned(photos: &str, output: &str) -> (Value, String) {
    let output = scan(photos, output);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{text}");
    (serde_json::from_slice(&output.stdout).unwrap(), text)
}

#[test]
fn a_data_set_becomes_a_mesh_and_a_page_and_finished_steps_are_kept() {
    let folder = Folder::new();
    let (data, out) = (ball(&folder, "6"), folder.path("out"));
    let (first, text) = scanned(&data, &out);
    println!("{text}");
    for line in ["step 1 of 3: the data set has poses", "step 2 of 3", "step 3 of 3"] {
        assert!(text.contains(line), "no {line:?} in {text}");
    }
    assert!(first["fit"]["verdict"]["text"].is_string() && first["poses"].is_null(), "{first}");
    assert!(first["shape"]["faces"].as_u64().unwrap() > 1000, "{first}");
    let [mesh, page] = ["mesh", "page"].map(|key| first[key].as_str().unwrap().to_owned());
    assert!(fs::read(&mesh).unwrap().starts_with(b"glTF"));
    assert!(fs::read_to_string(&page).unwrap().contains("<canvas"));
    // The run is that of `dsdf fit`, whose page is elsewhere.
    assert!(Path::new(&out).join("run/model.safetensors").is_file());
    assert!(!Path::new(&out).join("run/report.html").exists());

    fs::remove_file(&mesh).unwrap();
    let (again, text) = scanned(&data, &out);
    assert!(text.contains("fit: done already, ") && !text.contains("WARNING the run"), "{text}");
    assert_eq!(again["fit"]["iterations"], first["fit"]["iterations"]);
    assert!(Path::new(&mesh).is_file());
}

#[test]
fn neither_photographs_nor_a_data_set_are_refused_in_one_line() {
    let folder = Folder::new();
    fs::create_dir(folder.path("empty")).unwrap();
    let scan = |photos: &str, words: &[&str]| {
        refused(&["scan", photos, "-o", &folder.path("out")], 2, words);
        assert!(!Path::new(&folder.path("out")).exists(), "nothing is written");
    };
    scan(&folder.path("empty"), &["empty: photographs: found ", "expected 3 or more photographs"]);
    scan(&folder.path("nothing"), &["nothing: photographs: found no such folder"]);
    // An error in a data set is not taken for a folder of photographs.
    let data = ball(&folder, "3");
    let file = format!("{data}/transforms_train.json");
    fs::write(&file, "{").unwrap();
    scan(&data, &["transforms_train.json"]);
    scan(&file, &["transforms_train.json"]);
    // The files of the end are checked at the start.
    let (data, out) = (ball(&folder, "3"), folder.path("out"));
    fs::create_dir_all(format!("{out}/mesh.glb")).unwrap();
    refused(&["scan", &data, "-o", &out], 2, &["out/mesh.glb"]);
    assert!(!Path::new(&out).join("run").exists());
}
