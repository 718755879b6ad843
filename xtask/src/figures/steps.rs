//! Error against the number of points along a ray.

use std::fmt::Write;
use std::path::Path;

use measure::dsdf::{gradient, scene};
use measure::plot::{Curve, Panel, svg};
use measure::reference::box_filtered;

const STEPS: [u32; 5] = [6, 10, 22, 64, 200];
const SCENES: [(&str, &[&str]); 3] = [
    ("off-axis.constant", &["/sdf/radius", "/sdf/center/0", "/sdf/center/2"]),
    ("torus.constant", &["/sdf/major", "/sdf/center/0", "/sdf/center/2"]),
    ("smooth-union.lambert", &["/sdf/k", "/sdf/children/0/radius", "/sdf/children/1/b/2"]),
];

pub(crate) fn run(binary: &Path, folder: &Path) -> anyhow::Result<()> {
    let mut csv = String::from("scene,wrt,estimator,steps,seconds,evaluations,relative_l2\n");
    let mut panels = Vec::new();
    for (name, wrt) in SCENES {
        eprintln!("{name}");
        let scene = scene(name)?;
        let wrt: Vec<String> = wrt.iter().map(|w| (*w).to_owned()).collect();
        let reference = box_filtered(binary, &scene, &wrt)?;
        let mut curves: Vec<Vec<Curve>> = wrt.iter().map(|_| Vec::new()).collect();
        for estimator in ["paper-all", "paper", "refined"] {
            let mut points = vec![Vec::new(); wrt.len()];
            for steps in STEPS {
                let flags =
                    ["--estimator", estimator, "--spp", "256", "--steps", &steps.to_string()]
                        .map(str::to_owned);
                let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
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
        for (wrt, curves) in wrt.iter().zip(curves) {
            panels.push(Panel { title: format!("{name} {wrt}"), curves, front: false });
        }
    }
    super::write(folder, "steps.csv", csv)?;
    super::write(
        folder,
        "steps.svg",
        svg(&panels, "points along a ray", "relative L2 error at 256 spp"),
    )
}
