//! Tables as coloured maps, `heat.svg`.

use std::fmt::Write;

use crate::measure::plot::{escape, open_svg};

use crate::report::metrics::Metric;
use crate::report::result_table::{ResultTable, three_digits};
use crate::report::results::CellResult;
use crate::report::statistics::mean_interval;
use crate::report::sweep::Sweep;

/// Width and height of a field, in SVG units.
const FIELD: (f64, f64) = (64.0, 30.0);

/// One map: a metric over the rows and columns of a table.
struct HeatMap<'a> {
    table: &'a ResultTable,
    metric: &'a Metric,
    results: &'a [CellResult],
    /// Upper left corner of the first field, in SVG units.
    corner: (f64, f64),
}

/// Draws maps of the metrics beside each other, and of a sweep's tables below each other.
pub(crate) fn heat_maps(sweep: &Sweep, results: &[CellResult], metrics: &[&Metric]) -> String {
    let tables = ResultTable::all(sweep);
    let columns = tables.iter().map(|t| t.columns.values.len()).max().unwrap_or(1) as f64;
    let rows = tables.iter().map(|t| t.rows.values.len()).max().unwrap_or(1) as f64;
    let (width, height) = (columns * FIELD.0 + 120.0, rows * FIELD.1 + 60.0);
    let mut out = open_svg(width * metrics.len() as f64, height * tables.len() as f64);
    for (m, metric) in metrics.iter().enumerate() {
        for (t, table) in tables.iter().enumerate() {
            let corner = (m as f64 * width + 100.0, t as f64 * height + 40.0);
            HeatMap { table, metric, results, corner }.draw(&mut out);
        }
    }
    out + "</svg>\n"
}

impl HeatMap<'_> {
    /// The mean of the metric over the seeds at one place.
    fn value(&self, row: &str, column: &str) -> f64 {
        let own = self.table.at(self.results, row, column);
        mean_interval(&own.iter().map(|r| r.number(self.metric)).collect::<Vec<_>>()).mean
    }

    /// The logarithm of the error, which the colour shows. PSNR is logarithmic already.
    fn level(&self, v: f64) -> f64 {
        if self.metric.name == "psnr" { -v / 20.0 } else { v.max(self.metric.least).log10() }
    }

    /// The least and the largest level of the table.
    fn levels(&self) -> (f64, f64) {
        let values = self.table.places().map(|(row, column)| self.value(row, column));
        let levels: Vec<f64> = values.filter(|v| v.is_finite()).map(|v| self.level(v)).collect();
        let fold = |from, with: fn(f64, f64) -> f64| levels.iter().copied().fold(from, with);
        (fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max))
    }

    fn draw(&self, out: &mut String) {
        self.draw_title(out);
        let (x0, y0) = self.corner;
        let levels = self.levels();
        for (r, row) in self.table.rows.values.iter().enumerate() {
            let y = y0 + r as f64 * FIELD.1;
            let _ = writeln!(
                out,
                "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>",
                x0 - 6.0,
                y + 0.6 * FIELD.1,
                escape(row)
            );
            for (c, column) in self.table.columns.values.iter().enumerate() {
                let x = x0 + c as f64 * FIELD.0;
                self.draw_field(out, (x, y), self.value(row, column), levels);
            }
        }
        for (c, column) in self.table.columns.values.iter().enumerate() {
            let x = x0 + (c as f64 + 0.5) * FIELD.0;
            let _ = writeln!(
                out,
                "<text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                y0 - 3.0,
                escape(column)
            );
        }
    }

    fn draw_title(&self, out: &mut String) {
        let (x0, y0) = self.corner;
        let _ = writeln!(
            out,
            "<text x=\"{x0}\" y=\"{}\" font-weight=\"bold\">{}: {}</text>\
             <text x=\"{x0}\" y=\"{}\">{} ↓ {} →</text>",
            y0 - 26.0,
            escape(&self.table.title),
            self.metric.label,
            y0 - 14.0,
            self.table.rows.parameter,
            self.table.columns.parameter
        );
    }

    /// Draws one field at (x, y): green at the least level, red at the largest, grey without a
    /// value.
    fn draw_field(&self, out: &mut String, (x, y): (f64, f64), v: f64, (low, most): (f64, f64)) {
        let part = ((self.level(v) - low) / (most - low).max(1e-9)).clamp(0.0, 1.0);
        let ((red, green, blue), text) = if v.is_finite() {
            let (factor, unit) = self.metric.shown;
            let color = (120.0 + 125.0 * part, 190.0 - 90.0 * part, 130.0 - 50.0 * part);
            (color, three_digits(v * factor) + unit)
        } else {
            ((224.0, 224.0, 224.0), "-".to_owned())
        };
        let _ = writeln!(
            out,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{}\" height=\"{}\" \
             fill=\"rgb({red:.0},{green:.0},{blue:.0})\"/>\
             <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{text}</text>",
            FIELD.0 - 2.0,
            FIELD.1 - 2.0,
            x + 0.5 * FIELD.0,
            y + 0.6 * FIELD.1
        );
    }
}
