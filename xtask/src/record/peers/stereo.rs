//! Multi-view stereo beside fits: the distance to the surface of an object, and the time of one core.

use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, ensure};
use mesh::read_mesh;
use metrics::compare;
use serde_json::{Value, json};
use sweep::measure::dsdf::run_json;

use super::super::fits;
use super::super::measurement::{Bench, shared};
use super::super::rows::{Planned, Row, Rows};
use super::script::script;

/// The script.
const SCRIPT: &str = "stereo_opencv.py";

/// Points on each surface that distances are measured from.
const SAMPLES: usize = 200_000;

/// An object that is reconstructed by stereo, too.
pub(super) struct Object {
    /// Its name among the fits, and its folder.
    set: &'static str,
    /// What a reader would call it.
    about: &'static str,
    /// The true surface, in front of one colour; none in a room.
    truth: Option<&'static str>,
}

pub(super) const OBJECTS: [Object; 5] = [
    Object { set: "spot", about: "a smooth cow", truth: Some("mesh_normalized.ply") },
    Object { set: "bob", about: "a shiny ring", truth: Some("mesh_normalized.ply") },
    Object { set: "ridged", about: "fine ridges", truth: Some("mesh_normalized.ply") },
    Object { set: "spot_room", about: "the cow in a room", truth: None },
    Object { set: "bob_room", about: "the ring in a room", truth: None },
];

/// The iterations of the fits beside it: the default, and a long one.
const ITERATIONS: [u32; 2] = [6_000, 18_000];

impl Object {
    /// The name of its row.
    fn row_name(&self) -> String {
        format!("stereo, {}", self.set)
    }

    pub(super) fn row(&self) -> Planned {
        let measured = match self.truth {
            Some(truth) => format!("distances of the meshes to {truth}"),
            None => format!("room_eval.py MESH {}", self.set),
        };
        let command = format!(
            "{SCRIPT} {0} -o FOLDER --center X Y Z --radius R, by dsdf inspect {0}; {measured}",
            self.set
        );
        Planned {
            needs: Some(shared().join("data").join(self.set)),
            ..Planned::new(self.row_name(), command)
        }
    }

    /// The object of a row; none if the row is of another peer.
    pub(super) fn of(row: &str) -> Option<&'static Object> {
        OBJECTS.iter().find(|object| object.row_name() == row)
    }

    /// Runs the script, and measures its meshes.
    pub(super) fn measure(&self, python: &Path, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let data = shared().join("data").join(self.set);
        let folder = data.to_string_lossy().into_owned();
        let picture = bench.scratch.join("inspect.png").to_string_lossy().into_owned();
        let found = run_json(bench.program, &["inspect", &folder, "-o", &picture])?;
        let radius = found["radius"].as_f64().context("radius")?;
        let center: Vec<String> =
            found["center"].as_array().context("center")?.iter().map(Value::to_string).collect();
        ensure!(center.len() == 3, "dsdf inspect: the center has {} numbers", center.len());
        let (output, size) = (bench.scratch.to_string_lossy(), radius.to_string());
        let mut arguments = vec![&*folder, "-o", &output, "--radius", &size, "--center"];
        arguments.extend(center.iter().map(String::as_str));
        let mut result = script(python, SCRIPT, &arguments)?;
        let rows = result["rows"].as_array_mut().context("rows")?;
        for row in rows {
            let path = row["mesh"].as_str().context("mesh")?.to_owned();
            row["distance"] = match self.truth {
                Some(truth) => {
                    let (own, truth) =
                        (read_mesh(Path::new(&path))?, read_mesh(&data.join(truth))?);
                    json!(compare(&own, &truth, SAMPLES, 0.01 * radius).chamfer / radius)
                }
                // A mesh without surface above the table has no distance.
                None => json!(fits::room(&path, &data).ok().and_then(|all| Some(all.first()?.1))),
            };
            row.as_object_mut().context("a row")?.remove("mesh");
        }
        Ok(result)
    }
}

/// The seconds and the distance of the better of the two meshes.
fn best(row: &Row) -> Option<(f64, f64)> {
    let rows = row.values["rows"].as_array()?;
    let of = |row: &Value| Some((row["seconds"].as_f64()?, row["distance"].as_f64()?));
    rows.iter().filter_map(of).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The distances and times of the fits, and of stereo beside them.
pub(super) fn table(rows: &Rows, fits: &Rows) -> String {
    let mut out = String::from("| object |");
    for iterations in ITERATIONS {
        let _ = write!(out, " dsdf, {} iterations |", fits::thousands(iterations));
    }
    out += " multi-view stereo |\n| --- | --- | --- | --- |\n";
    let cell = |found: Option<(f64, f64)>| {
        found.map_or(String::new(), |(seconds, distance)| {
            format!("{}: {:.2} %", fits::duration(seconds), 100.0 * distance)
        })
    };
    for object in &OBJECTS {
        let Some(row) = rows.0.get(&object.row_name()) else { continue };
        let own = ITERATIONS.map(|n| cell(fits::time_and_distance(fits, object.set, n)));
        let _ = writeln!(
            out,
            "| `{}`, {} | {} | {} |",
            object.set,
            object.about,
            own.join(" | "),
            cell(best(row))
        );
    }
    out
}
