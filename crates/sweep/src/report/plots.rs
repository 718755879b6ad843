//! Curves of a sweep, `curves.svg` and `pareto.svg`, and the writing of all pictures.

use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::measure::plot::{Curve, Panel, svg};

use crate::report::files::write_whole;
use crate::report::grid::grid;
use crate::report::heat_map::heat_maps;
use crate::report::metrics::{Metric, metric};
use crate::report::result_table::ResultTable;
use crate::report::results::{CellResult, known_numbers};
use crate::report::statistics::mean_interval;
use crate::report::sweep::Sweep;

/// The metrics of the heat maps.
const MAPPED: [&str; 4] = ["chamfer", "psnr", "last_bias", "last_variance"];

/// Writes `grid.png`, `heat.svg`, `curves.svg` and `pareto.svg` into a folder.
///
/// `picture` gives the file of a result's picture.
pub(crate) fn save_pictures(
    sweep: &Sweep,
    results: &[CellResult],
    folder: &Path,
    picture: &dyn Fn(&CellResult) -> PathBuf,
) -> Result<(), Error> {
    let mut png = std::io::Cursor::new(Vec::new());
    grid(sweep, results, picture)
        .write_to(&mut png, image::ImageFormat::Png)
        .map_err(Error::content)?;
    write_whole(&folder.join("grid.png"), png.into_inner())?;
    let mapped: Vec<&Metric> = MAPPED.into_iter().filter_map(metric).collect();
    write_whole(&folder.join("heat.svg"), heat_maps(sweep, results, &mapped))?;
    write_whole(&folder.join("curves.svg"), loss_curves(sweep, results))?;
    write_whole(&folder.join("pareto.svg"), error_over_time(sweep, results))
}

/// Loss over iterations: one panel for each row of a table, one curve for each column.
fn loss_curves(sweep: &Sweep, results: &[CellResult]) -> String {
    let mut panels = Vec::new();
    for table in ResultTable::all(sweep) {
        for row in &table.rows.values {
            let curve = |column: &String| Curve {
                name: format!("{} {column}", table.columns.parameter),
                points: mean_curve(&table.at(results, row, column)),
            };
            let title = format!("{}, {} = {row}", table.title, table.rows.parameter);
            let curves = table.columns.values.iter().map(curve).collect();
            panels.push(Panel { title, curves, front: false });
        }
    }
    svg(&panels, "iteration", "loss")
}

/// The mean over seeds of the longest loss curves. A fit that was ended early has other iterations
/// and is left out.
fn mean_curve(results: &[&CellResult]) -> Vec<(f64, f64)> {
    let length = results.iter().map(|r| r.curve.len()).max().unwrap_or(0);
    let whole: Vec<&&CellResult> = results.iter().filter(|r| r.curve.len() == length).collect();
    let point = |i: usize| {
        let iteration = whole[0].curve[i].0.max(1.0);
        (iteration, mean_interval(&whole.iter().map(|r| r.curve[i].1).collect::<Vec<_>>()).mean)
    };
    (0..length).map(point).filter(|p| p.1 > 0.0 && p.1.is_finite()).collect()
}

/// Chamfer distance over seconds: one panel for each table, one curve for each row, with the Pareto
/// front.
fn error_over_time(sweep: &Sweep, results: &[CellResult]) -> String {
    let drawable = |p: &(f64, f64)| p.0 > 0.0 && p.1 > 0.0 && p.0.is_finite() && p.1.is_finite();
    let mut panels = Vec::new();
    for table in ResultTable::all(sweep) {
        let point = |row: &str, column: &str| {
            let own = table.at(results, row, column);
            let mean = |name: &str| mean_interval(&known_numbers(&own, name)).mean;
            (mean("seconds"), mean("chamfer"))
        };
        let curve = |row: &String| {
            let points = table.columns.values.iter().map(|column| point(row, column));
            let points = points.filter(drawable).collect();
            Curve { name: format!("{} {row}", table.rows.parameter), points }
        };
        let curves = table.rows.values.iter().map(curve).collect();
        panels.push(Panel { title: table.title.clone(), curves, front: true });
    }
    svg(&panels, "seconds", "Chamfer distance, bounding radii")
}
