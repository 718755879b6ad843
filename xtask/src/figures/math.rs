//! The figures of `docs/math`: drawings that are computed from the formulas on its pages, and
//! derivative images of a disc against their closed form.

mod ball;
mod border;
mod disc;
mod drawing;
mod lines;
mod measured;
mod opacity;
mod ray;
mod velocity;

use std::path::Path;

use crate::output::write;

/// Draws and measures all figures, and writes them into a folder.
pub(crate) fn run(binary: &Path, folder: &Path) -> anyhow::Result<()> {
    let drawings = [
        ("disc.svg", disc::draw()),
        ("ray.svg", ray::draw()),
        ("velocity.svg", velocity::draw()),
        ("border.svg", border::draw()),
        ("lines.svg", lines::draw()),
        ("opacity.svg", opacity::draw()),
    ];
    for (name, drawing) in drawings {
        write(folder, name, drawing)?;
    }
    write(folder, "images.svg", measured::pictures(binary)?)?;
    let (plot, table) = measured::errors(binary)?;
    write(folder, "errors.svg", plot)?;
    write(folder, "errors.csv", table)
}
