//! Settings and inputs at the extremes: the value, its error against the truth, or the line that
//! refuses.

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

use anyhow::{Context, bail, ensure};
use serde_json::{Value, json};
use sweep::measure::cargo_command;
use sweep::measure::dsdf::gradient;

use super::measurement::{Bench, Measurement};
use super::rows::{Planned, Rows, provenance};
use crate::output::write;

/// Values at the extremes.
pub(crate) struct Extremes;

/// The row of the settings of estimators: a test has all of them, and checks each.
const SETTINGS: &str = "settings of estimators";

/// The test of these settings.
const TEST: [&str; 10] =
    ["test", "--profile", "ci", "-p", "tests", "--test", "images", "extremes", "--", "--nocapture"];

/// An input at an extreme, by its name in the table.
#[derive(Clone, Copy)]
enum Input {
    /// A film of this size, in pixels, and the focal length.
    Film(u32, u32, f64),
    /// The ball and its camera, moved by this along each axis.
    Moved(f64),
    /// All lengths times this.
    Scaled(f64),
    /// The eye at this distance from the centre of the ball, whose radius is 0.7.
    Eye(f64),
    /// A distance network whose weights are zero.
    Zeros,
    /// A fit of this number of photographs of 64 × 64 pixels.
    Photographs(u32),
    /// A fit of 16 photographs of this size, in pixels.
    Photographed(&'static str),
}

/// The inputs, in the order of the table.
const INPUTS: [(&str, Input); 18] = [
    ("the film has 1 × 1 pixels", Input::Film(1, 1, 1.0)),
    ("the film has 65,535 × 1 pixels", Input::Film(65_535, 1, 60_000.0)),
    ("the film has 65,536 × 1 pixels", Input::Film(65_536, 1, 60_000.0)),
    ("1e3 units from the origin", Input::Moved(1e3)),
    ("1e6 units from the origin", Input::Moved(1e6)),
    ("1e9 units from the origin", Input::Moved(1e9)),
    ("units of 1e-6", Input::Scaled(1e-6)),
    ("units of 1e6", Input::Scaled(1e6)),
    ("units of 1e12", Input::Scaled(1e12)),
    ("the eye on the surface", Input::Eye(0.7)),
    ("the eye 1e-3 units in front of it", Input::Eye(0.701)),
    ("the eye 1e6 units away", Input::Eye(1e6)),
    ("a network of zeros", Input::Zeros),
    ("a fit of 1 photograph", Input::Photographs(1)),
    ("a fit of 2 photographs", Input::Photographs(2)),
    ("a fit of photographs of 1 × 1 pixels", Input::Photographed("1x1")),
    ("a fit of photographs of 2 × 2 pixels", Input::Photographed("2x2")),
    ("a fit of photographs of 1 × 64 pixels", Input::Photographed("1x64")),
];

impl Measurement for Extremes {
    fn name(&self) -> &'static str {
        "extremes"
    }

    fn measured(&self) -> &'static [&'static str] {
        &["scene", "estimate", "fit", "dataset", "inspect"]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let settings = Planned::new(SETTINGS, format!("cargo {}", TEST.join(" "))).seeds([1]);
        let input = |(name, input): (&str, Input)| {
            let command = match input {
                Input::Photographs(_) | Input::Photographed(_) => {
                    "dsdf synth demo_scene.json -o DATA; dsdf fit DATA -o RUN --iterations 300"
                }
                _ => "dsdf gradient SCENE --wrt /sdf/radius --spp 256 --precision f64 and f32",
            };
            Planned::new(name, command.to_owned()).seeds([0])
        };
        Ok(std::iter::once(settings).chain(INPUTS.map(input)).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        if row.name == SETTINGS {
            return settings();
        }
        let input = INPUTS.iter().find(|(name, _)| *name == row.name).context("an input")?.1;
        match input {
            Input::Photographs(views) => fit(bench, &views.to_string(), "64x64"),
            Input::Photographed(size) => fit(bench, "16", size),
            _ => image(input, bench),
        }
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let mut out = String::from("## Inputs\n\n| input | f64 | f32 |\n| --- | --- | --- |\n");
        let plan = self.plan()?;
        for (name, row) in rows.in_order(&plan).filter(|(name, _)| *name != SETTINGS) {
            let cells: Vec<String> = serde_json::from_value(row.values["cells"].clone())?;
            let _ = writeln!(out, "| {name} | {} |", cells.join(" | "));
        }
        if let Some(row) = rows.0.get(SETTINGS) {
            let table = row.values["table"].as_str().context("table")?;
            let _ = write!(out, "\n## Settings\n\n{table}");
        }
        write(folder, "extremes.md", out + "\n" + &provenance(rows) + "\n")
    }
}

/// The table of the test of settings.
fn settings() -> anyhow::Result<Value> {
    let output = cargo_command(&TEST).output()?;
    ensure!(output.status.success(), "cargo {} failed", TEST.join(" "));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let rows: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
    ensure!(rows.len() > 2, "the test of extremes prints no table");
    Ok(json!({ "table": rows.join("\n") + "\n" }))
}

/// The scene of an input: a white ball of radius 0.7 in front of black, with the sum over the film of
/// its derivative by the radius.
fn scene(input: Input, bench: &Bench<'_>) -> anyhow::Result<(Value, f64)> {
    let (mut width, mut height, mut focal) = (32, 32, 64.0);
    let (mut radius, mut distance, mut center) = (0.7, 4.0, 0.0);
    match input {
        Input::Film(w, h, f) => (width, height, focal) = (w, h, f),
        Input::Moved(by) => center = by,
        Input::Scaled(by) => (radius, distance) = (0.7 * by, 4.0 * by),
        Input::Eye(eye) => {
            distance = eye;
            // The outline keeps its place on the film, where it can.
            focal = if eye > 0.7 { 11.0 * (eye * eye - 0.49).sqrt() / 0.7 } else { 64.0 };
        }
        Input::Zeros => {}
        Input::Photographs(_) | Input::Photographed(_) => bail!("a fit has no scene"),
    }
    let origin = [center; 3];
    let mut sdf = json!({ "type": "sphere", "center": origin, "radius": radius });
    if matches!(input, Input::Zeros) {
        let path = bench.scratch.join("zeros.safetensors");
        std::fs::write(&path, zeros())?;
        sdf = json!({ "type": "neural", "weights": path });
    }
    let camera = json!({
        "width": width, "height": height, "focal": focal,
        "principal": [f64::from(width) / 2.0, f64::from(height) / 2.0],
        "eye": [center, center, center + distance], "target": origin, "up": [0, 1, 0],
    });
    let scene = json!({
        "camera": camera, "sdf": sdf,
        "appearance": { "type": "constant", "radiance": [1, 1, 1] }, "background": [0, 0, 0],
    });
    Ok((scene, slope(radius, distance, focal, f64::from(height))))
}

/// The derivative by the radius of the area that a ball covers on a film that is wide enough, and
/// `height` pixels high, in square pixels per unit. Inside of the ball there is no outline.
fn slope(radius: f64, distance: f64, focal: f64, height: f64) -> f64 {
    if distance <= radius {
        return 0.0;
    }
    let square = distance * distance - radius * radius;
    let (outline, by_radius) =
        (focal * radius / square.sqrt(), focal * distance * distance / square.powf(1.5));
    // The outline is a circle around the middle of the film, cut off above and below.
    let part = (0.5 * height / outline).min(1.0).asin();
    4.0 * part * outline * by_radius
}

/// The cells of a derivative image, in double and in single precision.
fn image(input: Input, bench: &Bench<'_>) -> anyhow::Result<Value> {
    let (scene, exact) = scene(input, bench)?;
    let zeros = matches!(input, Input::Zeros);
    let wrt = [if zeros { "/sdf/weights/0" } else { "/sdf/radius" }.to_owned()];
    let cell = |precision: &str| {
        let flags = ["--spp", "256", "--precision", precision];
        match gradient(bench.program, &scene, &wrt, &flags) {
            Ok(found) => {
                let sum: f64 = found.images[0].pixels.iter().map(|pixel| pixel[0]).sum();
                if zeros || exact == 0.0 {
                    format!("{sum:.1e}")
                } else {
                    format!("off by {:.1e}", (sum / exact - 1.0).abs())
                }
            }
            Err(error) => format!("refused: {}", reason(&error.to_string(), bench)),
        }
    };
    Ok(json!({ "cells": [cell("f64"), cell("f32")] }))
}

/// The cells of a fit: its verdict, or the line that refuses. It works in single precision.
fn fit(bench: &Bench<'_>, views: &str, size: &str) -> anyhow::Result<Value> {
    let folder = tempfile::tempdir_in(bench.scratch)?;
    let scene = sweep::measure::workspace_root().join("crates/app/src/cli/demo_scene.json");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (data, run, scene) = (path("data"), path("run"), scene.to_string_lossy().into_owned());
    let call = |arguments: &[&str]| Command::new(bench.program).args(arguments).output();
    let synth = call(&["synth", &scene, "-o", &data, "--views", views, "--size", size, "--quiet"])?;
    let fit = ["fit", &data, "-o", &run, "--iterations", "300", "--held-out", "none", "--quiet"];
    let cell = match synth.status.success() {
        false => outcome(&synth, bench),
        true => outcome(&call(&fit)?, bench),
    };
    Ok(json!({ "cells": ["", cell] }))
}

/// The first line of a verdict, or the line of an error.
fn outcome(output: &Output, bench: &Bench<'_>) -> String {
    if !output.status.success() {
        let status = output.status.code().map_or("a signal".to_owned(), |code| code.to_string());
        let line = reason(&String::from_utf8_lossy(&output.stderr), bench);
        return format!("refused with status {status}: {line}");
    }
    let text = String::from_utf8_lossy(&output.stdout);
    text.lines().nth(1).or(text.lines().next()).unwrap_or_default().trim().to_owned()
}

/// The line of an error, without the folder of the measurement and its temporary ones.
fn reason(text: &str, bench: &Bench<'_>) -> String {
    let line = text.lines().find(|line| line.contains("error: ")).unwrap_or(text.trim());
    let line = line.split_once("error: ").map_or(line, |(_, after)| after);
    let own = bench.scratch.to_string_lossy().into_owned();
    let words = line.split_whitespace().map(|word| {
        let is_path = word.contains(&*own) || word.starts_with('/');
        let name = word.rsplit('/').next().unwrap_or(word);
        if is_path { name.to_owned() } else { word.to_owned() }
    });
    words.collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

/// A distance network of one hidden layer whose weights are zero, as a model file.
fn zeros() -> Vec<u8> {
    let shapes: [(&str, &[usize]); 4] = [
        ("layers.0.weight", &[8, 3]),
        ("layers.0.bias", &[8]),
        ("layers.1.weight", &[1, 8]),
        ("layers.1.bias", &[1]),
    ];
    let mut header = serde_json::Map::new();
    header.insert(
        "__metadata__".to_owned(),
        json!({ "activation": "softplus", "beta": "100", "encoding": "none" }),
    );
    let mut end = 0;
    for (name, shape) in shapes {
        let start = end;
        end += 4 * shape.iter().product::<usize>();
        let entry = json!({ "dtype": "F32", "shape": shape, "data_offsets": [start, end] });
        header.insert(name.to_owned(), entry);
    }
    let header = Value::Object(header).to_string();
    let length = (header.len() as u64).to_le_bytes();
    [&length[..], header.as_bytes(), &vec![0; end]].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_is_that_of_the_covered_area() {
        let area = |radius: f64, height: f64| {
            let outline = 64.0 * radius / (16.0 - radius * radius).sqrt();
            let half = (0.5 * height).min(outline);
            // Twice the integral of √(R² − y²) over the rows of the film.
            let rest = (outline * outline - half * half).max(0.0).sqrt();
            2.0 * (half * rest + outline * outline * (half / outline).asin())
        };
        for height in [1.0, 8.0, 32.0] {
            let h = 1e-6;
            let difference = (area(0.7 + h, height) - area(0.7 - h, height)) / (2.0 * h);
            assert!((slope(0.7, 4.0, 64.0, height) / difference - 1.0).abs() < 1e-6);
        }
        assert_eq!(slope(0.7, 0.3, 64.0, 32.0), 0.0);
    }
}
