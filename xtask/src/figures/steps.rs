//! Error against the number of points along a ray.

use std::fmt::Write;
use std::path::Path;

use sweep::measure::dsdf::gradient;
use sweep::measure::plot::{Curve, Panel, svg};
use sweep::measure::reference::box_filtered;
use sweep::measure::suite::scene;

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

/// Measures all scenes, and writes `steps.csv` and `steps.svg`.
pub(crate) fn run(binary: &Path, folder: &Path) -> anyhow::Result<()> {
    let mut csv = String::from("scene,wrt,estimator,steps,seconds,evaluations,relative_l2\n");
    let mut panels = Vec::new();
    for (name, wrt) in SCENES {
        eprintln!("{name}");
        panels.extend(measure(binary, name, wrt, &mut csv)?);
    }
    write(folder, "steps.csv", csv)?;
    let plot = svg(&panels, "points along a ray", "relative L2 error at 256 spp");
    write(folder, "steps.svg", plot)
}

/// One panel for each parameter of a scene, with a curve for each estimator. Adds rows to `csv`.
fn measure(
    binary: &Path,
    name: &str,
    wrt: &[&str],
    csv: &mut String,
) -> anyhow::Result<Vec<Panel>> {
    let scene = scene(name)?;
    let wrt: Vec<String> = wrt.iter().map(|w| (*w).to_owned()).collect();
    let reference = box_filtered(binary, &scene, &wrt)?;
    let mut curves: Vec<Vec<Curve>> = wrt.iter().map(|_| Vec::new()).collect();
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
        for (curves, points) in curves.iter_mut().zip(points) {
            curves.push(Curve { name: estimator.to_owned(), points });
        }
    }
    let panel = |(wrt, curves): (&String, Vec<Curve>)| Panel {
        title: format!("{name} {wrt}"),
        curves,
        front: false,
    };
    Ok(wrt.iter().zip(curves).map(panel).collect())
}
