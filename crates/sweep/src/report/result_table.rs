//! Results arranged in rows and columns, for tables and pictures.

use crate::report::metrics::Metric;
use crate::report::options::Settings;
use crate::report::results::{CellResult, known_numbers};
use crate::report::statistics::mean_interval;
use crate::report::sweep::Sweep;

/// A parameter with its values, along one side of a table.
#[derive(Clone)]
pub(crate) struct Axis {
    pub(crate) parameter: String,
    pub(crate) values: Vec<String>,
}

impl Axis {
    fn new(sweep: &Sweep, parameter: String) -> Self {
        Axis { values: sweep.values(&parameter), parameter }
    }

    /// The axis of a table with one column: no parameter and one empty value.
    fn single() -> Self {
        Axis { parameter: String::new(), values: vec![String::new()] }
    }
}

/// A table of a sweep: one data set with fixed values of all parameters that are neither rows nor
/// columns.
pub(crate) struct ResultTable {
    /// The data set and the fixed values.
    pub(crate) title: String,
    data: String,
    fixed: Settings,
    pub(crate) rows: Axis,
    pub(crate) columns: Axis,
}

impl ResultTable {
    /// All tables of a sweep.
    pub(crate) fn all(sweep: &Sweep) -> Vec<ResultTable> {
        let (rows, columns) = sweep.axes();
        let rows = Axis::new(sweep, rows);
        let columns = columns.map_or_else(Axis::single, |parameter| Axis::new(sweep, parameter));
        let others = |key: &&String| **key != rows.parameter && **key != columns.parameter;
        let combinations = sweep.combinations(sweep.parameters.keys().filter(others));
        let table = |data: &str, fixed: &Settings| ResultTable {
            title: fixed
                .iter()
                .fold(data.to_owned(), |title, (k, v)| format!("{title}, {k} = {v}")),
            data: data.to_owned(),
            fixed: fixed.clone(),
            rows: rows.clone(),
            columns: columns.clone(),
        };
        let data = sweep.data.iter();
        data.flat_map(|data| combinations.iter().map(move |fixed| table(&data.name, fixed)))
            .collect()
    }

    /// The results at one place of the table, one for each seed.
    pub(crate) fn at<'a>(
        &self,
        results: &'a [CellResult],
        row: &str,
        column: &str,
    ) -> Vec<&'a CellResult> {
        let fits = |r: &&CellResult| {
            r.data == self.data
                && self.fixed.iter().all(|(k, v)| r.value(k) == v)
                && r.value(&self.rows.parameter) == row
                && (self.columns.parameter.is_empty() || r.value(&self.columns.parameter) == column)
        };
        results.iter().filter(fits).collect()
    }

    /// The values of row and column at all places, row by row.
    pub(crate) fn places(&self) -> impl Iterator<Item = (&str, &str)> {
        let columns = &self.columns.values;
        self.rows.values.iter().flat_map(move |row| columns.iter().map(move |c| (&**row, &**c)))
    }
}

/// The mean of a metric over seeds with half its interval, in the metric's unit: `0.71 ± 0.05 %`.
/// If only some results have the metric, their number follows: ` (2 of 3)`.
pub(crate) fn mean_with_interval(results: &[&CellResult], metric: &Metric) -> String {
    let values = known_numbers(results, metric.name);
    if values.is_empty() {
        return "-".to_owned();
    }
    let missing = if values.len() < results.len() {
        format!(" ({} of {})", values.len(), results.len())
    } else {
        String::new()
    };
    let (factor, unit) = metric.shown;
    let found = mean_interval(&values.iter().map(|v| v * factor).collect::<Vec<_>>());
    let half = found.high - found.mean;
    if half.is_finite() && values.len() > 1 {
        format!("{} ± {}{unit}{missing}", three_digits(found.mean), three_digits(half))
    } else {
        format!("{}{unit}{missing}", three_digits(found.mean))
    }
}

/// The mean of a metric over seeds in the metric's unit, without its interval.
pub(crate) fn mean_alone(results: &[&CellResult], metric: &Metric) -> String {
    let values = known_numbers(results, metric.name);
    let (factor, unit) = metric.shown;
    let found = mean_interval(&values).mean * factor;
    if values.is_empty() { "-".to_owned() } else { format!("{}{unit}", three_digits(found)) }
}

/// A number with three significant digits, and at most six decimals.
pub(crate) fn three_digits(v: f64) -> String {
    let decimals = if v == 0.0 || !v.is_finite() {
        0
    } else {
        (2 - v.abs().log10().floor() as i32).clamp(0, 6)
    };
    format!("{v:.*}", decimals as usize)
}
