//! Derivative images of the disc against their closed form: pictures, and errors over the settings
//! of the warp.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use sweep::measure::dsdf::gradient;
use sweep::measure::plot::{Curve, Panel, svg};
use sweep::measure::suite::scene;

use super::ball::Parameter;
use super::disc::{SIDE, derivative};
use super::drawing::{Anchor, Drawing};

/// Parameters of the scene `disc.constant`, with their names in the plots.
const PARAMETERS: [(&str, Parameter, &str); 3] = [
    ("/sdf/radius", Parameter::Radius, "radius"),
    ("/sdf/center/0", Parameter::Center(0), "across the view"),
    ("/sdf/center/2", Parameter::Center(2), "along the view"),
];

/// Estimators of the pictures.
const ESTIMATORS: [&str; 4] = ["interior", "paper", "gaussian", "refined"];

/// A setting of the warp with the values that are measured.
const SETTINGS: [(&str, &str, &[f64]); 3] = [
    ("--gamma", "γ, with N = 22 and k = 14", &[1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 8.0]),
    ("--top-k", "k, with N = 22 and γ = 3", &[2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 18.0, 22.0]),
    ("--steps", "N, with k = 14 and γ = 3", &[6.0, 10.0, 22.0, 64.0, 200.0]),
];

/// The red channel of the derivative by each parameter.
fn measured(binary: &Path, flags: &[&str]) -> anyhow::Result<Vec<Vec<f64>>> {
    let wrt: Vec<String> = PARAMETERS.iter().map(|(pointer, _, _)| (*pointer).to_owned()).collect();
    let got = gradient(binary, &scene("disc.constant")?, &wrt, flags)?;
    let red = |image: &sweep::measure::image::Image| image.pixels.iter().map(|p| p[0]).collect();
    Ok(got.images.iter().map(red).collect())
}

/// The distance of two images over the norm of the second.
fn relative_error(image: &[f64], exact: &[f64]) -> f64 {
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    norm(&mut image.iter().zip(exact).map(|(a, b)| a - b)) / norm(&mut exact.iter().copied())
}

/// Derivative images by the radius and along the view at 16 samples per pixel.
pub(super) fn pictures(binary: &Path) -> anyhow::Result<String> {
    let mut out = Drawing::new(640.0, 345.0);
    let rows = [0, 2];
    for (row, parameter) in rows.into_iter().enumerate() {
        let exact = derivative(PARAMETERS[parameter].1);
        let largest = exact.iter().copied().fold(0.0, f64::max);
        let y = 50.0 + 165.0 * row as f64;
        let name = ["derivative by the radius", "derivative by motion towards the camera"][row];
        out.title([15.0, y - 25.0], name);
        draw_image(&mut out, [15.0, y], "closed form", &exact, largest);
        for (i, estimator) in ESTIMATORS.into_iter().enumerate() {
            let flags = ["--estimator", estimator, "--spp", "16", "--seed", "1"];
            let image = &measured(binary, &flags)?[parameter];
            let title = format!("{estimator}, error {:.2}", relative_error(image, &exact));
            let x = 140.0 + 125.0 * i as f64;
            draw_image(&mut out, [x, y], &title, image, largest);
        }
    }
    Ok(out.finish())
}

/// An image in shades: red is positive, blue negative.
fn draw_image(out: &mut Drawing, [x, y]: [f64; 2], title: &str, image: &[f64], largest: f64) {
    const SIZE: usize = 7;
    out.text([x, y - 6.0], Anchor::Start, title);
    let side = (SIDE * SIZE) as f64;
    out.rect([x, y], [side; 2], "fill=\"white\" stroke=\"#888\"");
    // One path for each of 16 shades.
    let mut shades: BTreeMap<i32, Vec<[f64; 2]>> = BTreeMap::new();
    for (i, value) in image.iter().enumerate() {
        let shade = (value / largest * 16.0).round().clamp(-16.0, 16.0) as i32;
        let place = [x + (i % SIDE * SIZE) as f64, y + (i / SIDE * SIZE) as f64];
        shades.entry(shade).or_default().push(place);
    }
    for (shade, places) in shades.into_iter().filter(|(shade, _)| *shade != 0) {
        let [strong, weak] = [255 - 2 * shade.abs(), 255 - 14 * shade.abs()];
        let color = if shade > 0 { [strong, weak, weak] } else { [weak, weak, strong] };
        let style = format!("fill=\"rgb({},{},{})\"", color[0], color[1], color[2]);
        out.squares(&places, SIZE as f64, &style);
    }
}

/// Errors over each setting, as a plot and as a table.
pub(super) fn errors(binary: &Path) -> anyhow::Result<(String, String)> {
    let exact = PARAMETERS.map(|(_, parameter, _)| derivative(parameter));
    let base = ["--spp", "256", "--seed", "1"];
    let refined = measured(binary, &[&base[..], &["--estimator", "refined"]].concat())?;
    let refined = [0, 1, 2].map(|i| relative_error(&refined[i], &exact[i]));
    let mut csv = String::from("estimator,setting,value,radius,across,along\n");
    let row = |csv: &mut String, name: &str, value: f64, errors: [f64; 3]| {
        let [radius, across, along] = errors;
        let _ = writeln!(csv, "{name},{value},{radius:.4},{across:.4},{along:.4}");
    };
    row(&mut csv, "refined,default", f64::NAN, refined);
    let mut panels = Vec::new();
    for (flag, title, values) in SETTINGS {
        let mut points: [Vec<(f64, f64)>; 3] = Default::default();
        for value in values {
            let text = value.to_string();
            let flags = [&base[..], &["--estimator", "paper", flag, &text]].concat();
            let images = measured(binary, &flags)?;
            let errors = [0, 1, 2].map(|i| relative_error(&images[i], &exact[i]));
            row(&mut csv, &format!("paper,{}", flag.trim_start_matches('-')), *value, errors);
            points.iter_mut().zip(errors).for_each(|(points, error)| points.push((*value, error)));
        }
        panels.push(Panel {
            title: title.to_owned(),
            curves: curves(points, refined),
            front: false,
        });
    }
    Ok((svg(&panels, "value of the setting", "relative L2 error at 256 samples"), csv))
}

/// The curves of `paper`, and a level one of `refined`: the largest of its three errors.
fn curves(points: [Vec<(f64, f64)>; 3], refined: [f64; 3]) -> Vec<Curve> {
    let ends = [points[0][0].0, points[0][points[0].len() - 1].0];
    let error = refined.into_iter().fold(0.0, f64::max);
    let level = Curve {
        name: "refined, all".to_owned(),
        points: ends.iter().map(|x| (*x, error)).collect(),
    };
    let paper = PARAMETERS.iter().zip(points);
    let paper = paper.map(|((_, _, name), points)| Curve {
        name: name.trim_end_matches(" the view").to_owned(),
        points,
    });
    paper.chain([level]).collect()
}
