//! Writing and reading `results.csv`.

use std::path::Path;

use csv::StringRecord;

use crate::error::Error;
use crate::report::files::read_text;
use crate::report::metrics::{METRICS, metric};
use crate::report::results::{CellResult, describe};
use files::InputError;

/// The columns that are neither parameters nor metrics. The parameters stand between the first and
/// the second of them.
const TEXTS: [&str; 5] = ["data", "seed", "status", "reason", "converged"];

/// The text of `results.csv`: a header and a row for each result.
pub(crate) fn to_csv(results: &[CellResult]) -> Result<String, Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let parameters: Vec<&str> =
        results.first().iter().flat_map(|r| &r.values).map(|(k, _)| k.as_str()).collect();
    let [data, rest @ ..] = TEXTS;
    let header = [&[data], &parameters[..], &rest[..], &METRICS.map(|m| m.name)[..]].concat();
    writer.write_record(header).map_err(Error::content)?;
    for result in results {
        writer.write_record(fields(result)).map_err(Error::content)?;
    }
    let text = writer.into_inner().map_err(Error::content)?;
    String::from_utf8(text).map_err(Error::content)
}

/// The fields of a result's row, in the order of the header.
fn fields(result: &CellResult) -> Vec<String> {
    let mut fields = vec![result.data.clone()];
    fields.extend(result.values.iter().map(|(_, v)| v.clone()));
    fields.extend([
        result.seed.to_string(),
        result.status.clone(),
        result.reason.clone(),
        result.converged.to_string(),
    ]);
    let number = |name: &str| result.numbers.get(name).map_or(String::new(), |v| digits(*v));
    fields.extend(METRICS.iter().map(|m| number(m.name)));
    fields
}

/// A number with seven significant digits, as many as single precision has; whole numbers exactly.
fn digits(v: f64) -> String {
    if v == v.trunc() && v.abs() < 1e15 { format!("{v}") } else { format!("{v:.6e}") }
}

/// The results in a `results.csv`.
///
/// # Errors
/// An [`InputError`] if the file cannot be read, lacks a column, has a field of the wrong type, or has
/// two rows for one cell.
pub(crate) fn from_csv(path: &Path) -> Result<Vec<CellResult>, Error> {
    let unreadable =
        |field: &str, e: csv::Error| InputError::new(path, field, e, "the results.csv of a sweep");
    let text = read_text(path).map_err(|e| unreadable("results", e.into()))?;
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header = reader.headers().map_err(|e| unreadable("header", e))?.clone();
    for needed in TEXTS {
        if !header.iter().any(|h| h == needed) {
            let found = header.iter().collect::<Vec<_>>().join(",");
            return Err(InputError::new(path, "header", found, needed).into());
        }
    }
    let mut results: Vec<CellResult> = Vec::new();
    for (index, record) in reader.records().enumerate() {
        let line = format!("line {}", index + 2);
        let record = record.map_err(|e| InputError::new(path, &line, e, "a row"))?;
        let result = parse(path, &line, &header, &record)?;
        if results.iter().any(|other| other.key() == result.key()) {
            let settings = describe(&result.values);
            let found = format!("{}, {settings}, seed {} twice", result.data, result.seed);
            return Err(InputError::new(path, &line, found, "a row for each cell").into());
        }
        results.push(result);
    }
    Ok(results)
}

/// The result in one row. A column that is no text and no metric is a parameter.
fn parse(
    path: &Path,
    line: &str,
    header: &StringRecord,
    record: &StringRecord,
) -> Result<CellResult, InputError> {
    let mut result = CellResult::default();
    for (name, field) in header.iter().zip(record) {
        let not_a_number = || InputError::new(path, format!("{line}, {name}"), field, "a number");
        match name {
            "data" => field.clone_into(&mut result.data),
            "status" => field.clone_into(&mut result.status),
            "reason" => field.clone_into(&mut result.reason),
            "converged" => result.converged = field == "true",
            "seed" => result.seed = field.parse().map_err(|_| not_a_number())?,
            _ if metric(name).is_none() => result.values.push((name.to_owned(), field.to_owned())),
            // An unknown number is an empty field.
            _ if field.is_empty() => {}
            _ => {
                let number = field.parse().ok().filter(|v: &f64| v.is_finite());
                result.numbers.insert(name.to_owned(), number.ok_or_else(not_a_number)?);
            }
        }
    }
    Ok(result)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_read_back_from_their_csv() {
        let mut result = CellResult {
            data: "knot".into(),
            seed: 3,
            status: "time".into(),
            ..CellResult::default()
        };
        result.values = vec![("gamma".into(), "1.0".into()), ("estimator".into(), "paper".into())];
        result.reason = "12 s, \"over\"".into();
        result.numbers = [("chamfer".to_owned(), 0.0125), ("values".to_owned(), 12345678.0)].into();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.csv");
        std::fs::write(&path, to_csv(std::slice::from_ref(&result)).unwrap()).unwrap();
        assert_eq!(from_csv(&path).unwrap(), [result]);
        std::fs::write(&path, "data,seed\nknot,x\n").unwrap();
        assert!(from_csv(&path).unwrap_err().to_string().contains("expected status"));
    }
}
