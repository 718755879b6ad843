//! Other programs beside dsdf: passes of networks in Dr.Jit and JAX, derivative images of silhouettes
//! in Mitsuba 3, and surfaces by multi-view stereo. The scripts are in `xtask/peers`.

mod script;
mod stereo;

use std::fmt::Write;
use std::path::Path;

use serde_json::{Value, json};
use sweep::measure::plot::{Curve, Panel, svg};

use super::measurement::{Bench, Measurement};
use super::rows::{Planned, Row, Rows, provenance};
use crate::bench::Machine;
use crate::output::write;
use script::{python, script};
use stereo::{OBJECTS, Object};

/// Other programs beside dsdf.
pub(crate) struct Peers;

/// The row of passes of networks.
const NETWORKS: &str = "networks";

/// The cases of silhouettes, with their names in tables.
const CASES: [(&str, &str); 5] = [
    ("sphere-radius", "a ball, by its radius"),
    ("sphere-depth", "a ball, towards the camera"),
    ("sphere-across", "a ball, across the view"),
    ("cube-depth", "a cube, towards the camera"),
    ("ball-vertical", "a ball of triangles, upwards"),
];

/// The rows of a case, apart: a name, and the values of their labels.
const METHODS: [(&str, [(&str, &str); 3]); 5] = [
    ("dsdf", [("program", "dsdf"), ("estimator", "refined"), ("precision", "f64")]),
    (
        "direct_projective, primary",
        [("program", "mitsuba"), ("estimator", "direct_projective"), ("terms", "primary")],
    ),
    (
        "direct_projective",
        [("program", "mitsuba"), ("estimator", "direct_projective"), ("terms", "all")],
    ),
    (
        "prb_projective, primary",
        [("program", "mitsuba"), ("estimator", "prb_projective"), ("terms", "primary")],
    ),
    ("prb_projective", [("program", "mitsuba"), ("estimator", "prb_projective"), ("terms", "all")]),
];

/// The passes of the table, as dsdf's bench and the scripts name them.
const PASSES: [&str; 3] = ["value", "value + gradient", "parameter VJP"];

/// The network of the table, as dsdf's bench names it.
const NETWORK: &str = "3 × 64, 6 octaves";

impl Measurement for Peers {
    fn name(&self) -> &'static str {
        "peers"
    }

    fn measured(&self) -> &'static [&'static str] {
        &[
            "scene",
            "estimate",
            "xtask/peers/peers.py",
            "xtask/peers/kernels_drjit.py",
            "xtask/peers/kernels_jax.py",
            "xtask/peers/silhouettes_mitsuba.py",
            "xtask/peers/stereo_opencv.py",
            "inspect",
            "metrics",
        ]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let networks = "cargo bench -p dsdf-sdf-nn --bench machine; kernels_jax.py --threads 1; \
                        kernels_drjit.py --threads 1";
        let networks = Planned::new(NETWORKS, networks.to_owned()).seeds([1]);
        let case = |(name, _): (&str, &str)| {
            let command = format!("silhouettes_mitsuba.py --dsdf dsdf --threads 1 --case {name}");
            Planned::new(name, command).seeds(0..3)
        };
        let stereo = OBJECTS.iter().map(Object::row);
        Ok(std::iter::once(networks).chain(CASES.map(case)).chain(stereo).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let python = python()?;
        if row.name == NETWORKS {
            return Ok(json!({
                "dsdf": Machine::measure()?,
                "jax": script(&python, "kernels_jax.py", &["--threads", "1"])?,
                "drjit": script(&python, "kernels_drjit.py", &["--threads", "1"])?,
            }));
        }
        if let Some(object) = Object::of(&row.name) {
            return object.measure(&python, bench);
        }
        let program = bench.program.to_string_lossy();
        let arguments = ["--dsdf", &program, "--threads", "1", "--case", &row.name];
        script(&python, "silhouettes_mitsuba.py", &arguments)
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let mut panels = Vec::new();
        for (case, title) in CASES {
            let Some(row) = rows.0.get(case) else { continue };
            let curve = |(name, label): (&str, [(&str, &str); 3])| {
                let points = points(row, label);
                let points =
                    points.into_iter().map(|(_, seconds, error)| (seconds, error)).collect();
                Curve { name: name.to_owned(), points }
            };
            let curves = METHODS.map(curve).into();
            panels.push(Panel { title: title.to_owned(), curves, front: false });
        }
        write(folder, "silhouettes.svg", svg(&panels, "seconds of one core", "relative L2 error"))?;
        let (networks, silhouettes) = (networks(rows), silhouettes(rows));
        let fits = Rows::load(&folder.with_file_name("fits"))?;
        let (surfaces, source) = (stereo::table(rows, &fits), provenance(rows));
        let page = format!(
            "## Surfaces\n\n{surfaces}\n## Networks\n\n{networks}\n## Silhouettes\n\n{silhouettes}\n{source}\n"
        );
        write(folder, "peers.md", page)
    }
}

/// The rows of a case with these labels, of the best shape of each number of samples: samples a pixel,
/// seconds, and the error of the image. Rows that failed have no error.
fn points(row: &Row, label: [(&str, &str); 3]) -> Vec<(u64, f64, f64)> {
    let cases = row.values["cases"].as_array().into_iter().flatten();
    let all = cases.flat_map(|case| case["rows"].as_array().into_iter().flatten());
    let own = all.filter(|row| label.iter().all(|(key, value)| row[*key] == **value));
    let point = |row: &Value| {
        Some((row["spp"].as_u64()?, row["seconds"].as_f64()?, row["image_error"].as_f64()?))
    };
    let mut points: Vec<(u64, f64, f64)> = own.filter_map(point).collect();
    // The first shape of a case is that of the issue: cubes and balls with seams.
    points.sort_by_key(|(spp, _, _)| *spp);
    points.dedup_by_key(|(spp, _, _)| *spp);
    points
}

/// The errors of each method at its largest number of samples, with its seconds.
fn silhouettes(rows: &Rows) -> String {
    let mut out = String::from("| case |");
    METHODS.iter().for_each(|(name, _)| out += &format!(" {name} |"));
    out += &format!("\n| --- |{}\n", " --- |".repeat(METHODS.len()));
    for (case, title) in CASES {
        let Some(row) = rows.0.get(case) else { continue };
        let _ = write!(out, "| {title} |");
        for (_, label) in METHODS {
            let cell = points(row, label).last().map_or_else(
                || "not finite".to_owned(),
                |(spp, seconds, error)| {
                    format!("{:.2} %, {seconds:.2} s, {spp} samples", 100.0 * error)
                },
            );
            let _ = write!(out, " {cell} |");
        }
        out.push('\n');
    }
    out
}

/// The passes of a network of 3 layers of 64 in each program, in millions of points per second.
fn networks(rows: &Rows) -> String {
    let mut out = String::from("| M points/s |");
    PASSES.iter().for_each(|name| out += &format!(" {name} |"));
    out += "\n| --- | --- | --- | --- |\n";
    let Some(values) = rows.0.get(NETWORKS).map(|row| &row.values) else { return out };
    let cell =
        |points: Option<f64>| points.map_or("none".to_owned(), |v| format!("{:.3}", v / 1e6));
    let dsdf = |pass: &str| {
        let all = values["dsdf"]["passes"].as_array()?;
        let own = all.iter().find(|row| row["network"] == NETWORK && row["pass"] == pass)?;
        own["points_per_second"].as_f64()
    };
    let cells = PASSES.map(|pass| cell(dsdf(pass)));
    let _ = writeln!(out, "| dsdf | {} |", cells.join(" | "));
    for (program, name) in [("jax", "JAX"), ("drjit", "Dr.Jit")] {
        for row in values[program]["rows"].as_array().into_iter().flatten() {
            let of = |key: &str| row[key].as_str().unwrap_or_default();
            let points = row["points"].as_u64().unwrap_or_default();
            let layers = [of("encoding"), of("layers")].join(" ");
            let best = |pass: &str| row["passes"][pass]["points_per_second"]["best"].as_f64();
            let cells = PASSES.map(|pass| cell(best(pass))).join(" | ");
            let _ = writeln!(out, "| {name}, {}, {points} points | {cells} |", layers.trim());
        }
    }
    out
}
