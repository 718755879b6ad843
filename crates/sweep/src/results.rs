//! What a cell gives: a row of `results.csv`.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use serde::{Deserialize, Serialize};

use super::refusal::Refusal;
use super::sweep::{Cell, Sweep, long_name};

/// A number of a row.
#[derive(Debug)]
pub(super) struct Metric {
    /// Its column.
    pub(super) name: &'static str,
    pub(super) label: &'static str,
    pub(super) better: Better,
    /// What a fit without this number counts as; not a number where it says nothing.
    pub(super) worst: f64,
    /// Errors below this are not told apart.
    pub(super) least: f64,
    /// Factor and unit for people.
    pub(super) shown: (f64, &'static str),
}

/// Which way a number is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Better {
    Less,
    More,
    /// A cost.
    Cost,
}

const fn metric_of(
    name: &'static str,
    label: &'static str,
    better: Better,
    [worst, least]: [f64; 2],
    shown: (f64, &'static str),
) -> Metric {
    Metric { name, label, better, worst, least, shown }
}

/// All numbers, in the order of the columns.
pub(super) const METRICS: [Metric; 17] = [
    metric_of(
        "chamfer",
        "Chamfer distance, of the bounding radius",
        Better::Less,
        [1.0, 1e-6],
        (100.0, " %"),
    ),
    metric_of("psnr", "PSNR of held-out views", Better::More, [0.0, 1e-6], (1.0, " dB")),
    metric_of("ssim", "SSIM of held-out views", Better::More, [0.0, 1e-4], (1.0, "")),
    metric_of("mask_iou", "mask IoU of held-out views", Better::More, [0.0, 1e-4], (1.0, "")),
    metric_of(
        "f_score",
        "F-score at 1 % of the bounding radius",
        Better::More,
        [0.0, 1e-4],
        (1.0, ""),
    ),
    metric_of("loss", "final loss, in thousandths", Better::Less, [1.0, 1e-9], (1e3, "")),
    metric_of("best_loss", "lowest loss, in thousandths", Better::Less, [1.0, 1e-9], (1e3, "")),
    metric_of(
        "first_bias",
        "bias of the gradient, first iterate",
        Better::Less,
        [f64::NAN, 1e-2],
        (100.0, " %"),
    ),
    metric_of(
        "first_variance",
        "variance of the gradient, first iterate",
        Better::Less,
        [f64::NAN, 1e-4],
        (1.0, ""),
    ),
    metric_of(
        "last_bias",
        "bias of the gradient, last iterate",
        Better::Less,
        [f64::NAN, 1e-2],
        (100.0, " %"),
    ),
    metric_of(
        "last_variance",
        "variance of the gradient, last iterate",
        Better::Less,
        [f64::NAN, 1e-4],
        (1.0, ""),
    ),
    metric_of("values", "values of f", Better::Cost, [f64::NAN, 1e-9], (1e-6, " M")),
    metric_of("gradients", "gradients of f", Better::Cost, [f64::NAN, 1e-9], (1e-6, " M")),
    metric_of(
        "hessian_vectors",
        "Hessian–vector products",
        Better::Cost,
        [f64::NAN, 1e-9],
        (1e-6, " M"),
    ),
    metric_of("parameters", "parameter gradients", Better::Cost, [f64::NAN, 1e-9], (1e-6, " M")),
    metric_of("iterations", "iterations", Better::Cost, [f64::NAN, 1e-9], (1.0, "")),
    metric_of("seconds", "seconds of the fit", Better::Cost, [f64::NAN, 1e-9], (1.0, " s")),
];

/// The metric of a name.
pub(super) fn metric(name: &str) -> Option<&'static Metric> {
    METRICS.iter().find(|m| m.name == name)
}

/// All names.
pub(super) fn metric_names() -> String {
    format!("one of {}", METRICS.map(|m| m.name).join(", "))
}

/// A row.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub(super) struct Row {
    pub(super) data: String,
    /// The parameters, in the sweep's order.
    pub(super) values: Vec<(String, String)>,
    pub(super) seed: u64,
    /// `done`, `failed`, `time` or `memory`.
    pub(super) status: String,
    /// Why it is not done.
    pub(super) reason: String,
    pub(super) converged: bool,
    /// By metric; what is not known is not there.
    pub(super) numbers: BTreeMap<String, f64>,
    /// Iterations with the mean loss around them.
    #[serde(default)]
    pub(super) curve: Vec<(f64, f64)>,
}

impl Row {
    pub(super) fn new(sweep: &Sweep, cell: &Cell) -> Self {
        Row {
            data: sweep.data[cell.data].name.clone(),
            values: cell.values.clone(),
            seed: cell.seed,
            status: "done".to_owned(),
            ..Row::default()
        }
    }

    /// What tells it from other rows: parameters in any order, under any of their names.
    pub(super) fn key(&self) -> (String, u64, Vec<(String, String)>) {
        let mut values: Vec<(String, String)> = self
            .values
            .iter()
            .map(|(key, value)| (long_name(key).to_owned(), value.clone()))
            .collect();
        values.sort();
        (self.data.clone(), self.seed, values)
    }

    /// The value of a parameter.
    pub(super) fn value(&self, parameter: &str) -> &str {
        self.values.iter().find(|(k, _)| k == parameter).map_or("", |(_, v)| v)
    }

    /// Field evaluations of the fit in units of a value: what it costs on a machine of any speed,
    /// within one precision.
    pub(super) fn passes(&self) -> Option<f64> {
        let kinds =
            [("values", 1.0), ("gradients", 2.0), ("hessian_vectors", 4.0), ("parameters", 6.0)];
        kinds.iter().map(|(name, cost)| Some(cost * self.numbers.get(*name)?)).sum()
    }

    /// A metric; its worst where there is none.
    pub(super) fn number(&self, metric: &Metric) -> f64 {
        self.numbers.get(metric.name).copied().unwrap_or(metric.worst)
    }
}

/// Parameters with their values, as people read them.
pub(super) fn settings(values: &[(String, String)]) -> String {
    values.iter().map(|(k, v)| format!("{k} = {v}")).collect::<Vec<_>>().join(", ")
}

/// Columns that are not numbers.
const TEXTS: [&str; 5] = ["data", "seed", "status", "reason", "converged"];

/// `results.csv` of rows.
pub(super) fn to_csv(rows: &[Row]) -> anyhow::Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let parameters: Vec<&str> =
        rows.first().iter().flat_map(|r| &r.values).map(|(k, _)| k.as_str()).collect();
    let [data, rest @ ..] = TEXTS;
    writer.write_record(
        [&[data], &parameters[..], &rest[..], &METRICS.map(|m| m.name)[..]].concat(),
    )?;
    for row in rows {
        let own = row.values.iter().map(|(_, v)| v.clone());
        let fixed = [
            row.seed.to_string(),
            row.status.clone(),
            row.reason.clone(),
            row.converged.to_string(),
        ];
        let numbers =
            METRICS.iter().map(|m| row.numbers.get(m.name).map_or(String::new(), |v| digits(*v)));
        writer
            .write_record([row.data.clone()].into_iter().chain(own).chain(fixed).chain(numbers))?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// Seven digits: as many as single precision has.
fn digits(v: f64) -> String {
    if v == v.trunc() && v.abs() < 1e15 { format!("{v}") } else { format!("{v:.6e}") }
}

/// The rows of a `results.csv`.
pub(super) fn from_csv(path: &Path) -> anyhow::Result<Vec<Row>> {
    let refuse =
        |field: String, found: &str, expected: &str| Refusal::new(path, field, found, expected);
    let mut reader = csv::Reader::from_path(path)
        .map_err(|e| refuse("results".into(), &e.to_string(), "the results.csv of a sweep"))?;
    let header = reader
        .headers()
        .map_err(|e| refuse("header".into(), &e.to_string(), "the results.csv of a sweep"))?
        .clone();
    for needed in TEXTS {
        if !header.iter().any(|h| h == needed) {
            return Err(refuse(
                "header".into(),
                &header.iter().collect::<Vec<_>>().join(","),
                needed,
            )
            .into());
        }
    }
    let mut rows = Vec::new();
    for (line, record) in reader.records().enumerate() {
        let record =
            record.map_err(|e| refuse(format!("line {}", line + 2), &e.to_string(), "a row"))?;
        let mut row = Row::default();
        for (name, field) in header.iter().zip(&record) {
            match name {
                "data" => field.clone_into(&mut row.data),
                "status" => field.clone_into(&mut row.status),
                "reason" => field.clone_into(&mut row.reason),
                "converged" => row.converged = field == "true",
                "seed" => {
                    let bad = || refuse(format!("line {}, seed", line + 2), field, "a number");
                    row.seed = field.parse().map_err(|_| bad())?;
                }
                _ if metric(name).is_some() => {
                    if !field.is_empty() {
                        let bad =
                            || refuse(format!("line {}, {name}", line + 2), field, "a number");
                        let number = field.parse().ok().filter(|v: &f64| v.is_finite());
                        row.numbers.insert(name.to_owned(), number.ok_or_else(bad)?);
                    }
                }
                _ => row.values.push((name.to_owned(), field.to_owned())),
            }
        }
        if rows.iter().any(|other: &Row| other.key() == row.key()) {
            let found = format!("{}, {}, seed {} twice", row.data, settings(&row.values), row.seed);
            return Err(refuse(format!("line {}", line + 2), &found, "a row for each cell").into());
        }
        rows.push(row);
    }
    Ok(rows)
}

/// The finished row of a cell's folder, if there is one.
pub(super) fn finished(folder: &Path) -> Option<Row> {
    serde_json::from_str(&std::fs::read_to_string(folder.join("result.json")).ok()?).ok()
}

/// Writes a file at once or not at all.
pub(super) fn write(path: &Path, content: impl AsRef<[u8]>) -> anyhow::Result<()> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    std::fs::write(&part, content).with_context(|| path.display().to_string())?;
    std::fs::rename(&part, path).with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_from_their_csv() {
        let mut row = Row { data: "knot".into(), seed: 3, status: "time".into(), ..Row::default() };
        row.values = vec![("gamma".into(), "1.0".into()), ("estimator".into(), "paper".into())];
        row.reason = "12 s, \"over\"".into();
        row.numbers = [("chamfer".to_owned(), 0.0125), ("values".to_owned(), 12345678.0)].into();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.csv");
        std::fs::write(&path, to_csv(std::slice::from_ref(&row)).unwrap()).unwrap();
        assert_eq!(from_csv(&path).unwrap(), [row]);
        std::fs::write(&path, "data,seed\nknot,x\n").unwrap();
        assert!(from_csv(&path).unwrap_err().to_string().contains("expected status"));
    }
}
