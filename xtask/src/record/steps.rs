//! Error against the number of points along a ray.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
use serde_json::{Value, json};
use sweep::measure::dsdf::gradient;
use sweep::measure::plot::{Curve, Panel, svg};
use sweep::measure::reference::box_filtered;
use sweep::measure::suite::scene;

use super::measurement::{Bench, Measurement};
use super::rows::{Planned, Rows};
use crate::output::write;

/// Points along a ray.
const STEPS: [u32; 5] = [6, 10, 22, 64, 200];

/// The estimators of the plot.
const ESTIMATORS: [&str; 3] = ["paper-all", "paper", "refined"];

/// Scenes of the suite with the parameters that they are differentiated by.
const SCENES: [(&str, &[&str]); 3] = [
    ("off-axis.constant", &["/sdf/radius", "/sdf/center/0", "/sdf/center/2"]),
    ("torus.constant", &["/sdf/major", "/sdf/center/0", "/sdf/center/2"]),
    ("smooth-union.lambert", &["/sdf/k", "/sdf/children/0/radius", "/sdf/children/1/b/2"]),
];

/// Errors of derivative images over the number of points along a ray.
pub(crate) struct Steps;

impl Measurement for Steps {
    fn name(&self) -> &'static str {
        "steps"
    }

    fn measured(&self) -> &'static [&'static str] {
        &["scene", "estimate", "crates/sweep/src/measure/", "tests/gradients/"]
    }

    fn plan(&self) -> anyhow::Result<Vec<Planned>> {
        let row = |(name, wrt): &(&str, &[&str])| {
            let wrt = wrt.join(" --wrt ");
            let command = format!(
                "dsdf gradient tests/gradients/{name}.json --wrt {wrt} --estimator E --spp 256 \
                 --steps {} to {}",
                STEPS[0],
                STEPS[STEPS.len() - 1]
            );
            Planned::new(*name, command).seeds([0])
        };
        Ok(SCENES.iter().map(row).collect())
    }

    fn measure(&self, row: &Planned, bench: &Bench<'_>) -> anyhow::Result<Value> {
        let of_name = SCENES.into_iter().find(|(name, _)| *name == row.name);
        let (name, wrt) = of_name.context("a scene")?;
        let mut csv = String::new();
        let curves = curves(bench.program, name, wrt, &mut csv)?;
        Ok(json!({ "csv": csv, "curves": curves }))
    }

    fn write(&self, rows: &Rows, folder: &Path) -> anyhow::Result<()> {
        let plan = self.plan()?;
        let mut panels = Vec::new();
        for (name, row) in rows.in_order(&plan) {
            let of_scene: Vec<Vec<ErrorCurve>> =
                serde_json::from_value(row.values["curves"].clone())?;
            let wrt = SCENES.iter().find(|(own, _)| *own == name).map_or(&[][..], |own| own.1);
            for (wrt, curves) in wrt.iter().zip(of_scene) {
                let curve = |(estimator, points): (&&str, ErrorCurve)| Curve {
                    name: (*estimator).to_owned(),
                    points,
                };
                let curves = ESTIMATORS.iter().zip(curves).map(curve).collect();
                panels.push(Panel { title: format!("{name} {wrt}"), curves, front: false });
            }
        }
        let header = "scene,wrt,estimator,steps,seconds,evaluations,relative_l2\n";
        write(folder, "steps.csv", rows.csv(&plan, header))?;
        write(
            folder,
            "steps.svg",
            svg(&panels, "points along a ray", "relative L2 error at 256 spp"),
        )
    }
}

/// Numbers of points along a ray, and relative errors.
type ErrorCurve = Vec<(f64, f64)>;

/// For each parameter of a scene, the curve of each estimator. Adds rows to `csv`.
fn curves(
    binary: &Path,
    name: &str,
    wrt: &[&str],
    csv: &mut String,
) -> anyhow::Result<Vec<Vec<ErrorCurve>>> {
    let scene = scene(name)?;
    let wrt: Vec<String> = wrt.iter().map(|w| (*w).to_owned()).collect();
    let reference = box_filtered(binary, &scene, &wrt)?;
    let mut curves = vec![Vec::new(); wrt.len()];
    for estimator in ESTIMATORS {
        let mut points = vec![Vec::new(); wrt.len()];
        for steps in STEPS {
            let steps_text = steps.to_string();
            let flags = ["--estimator", estimator, "--spp", "256", "--steps", &steps_text];
            let got = gradient(binary, &scene, &wrt, &flags)?;
            for (i, (image, reference)) in got.images.iter().zip(&reference).enumerate() {
                let error = image.distance(reference) / reference.norm();
                points[i].push((f64::from(steps), error));
                let _ = writeln!(
                    csv,
                    "{name},{},{estimator},{steps},{:.5},{},{error:.6}",
                    wrt[i], got.seconds, got.evaluations
                );
            }
        }
        curves.iter_mut().zip(points).for_each(|(curves, points)| curves.push(points));
    }
    Ok(curves)
}
