//! The tables of a page, as HTML.

use files::InputError;
use fit::{RunCameras, RunExposures};

use crate::escape::escaped;
use crate::surface::SurfaceShares;
use crate::{Run, State};

/// A table with a header. Cells are escaped.
fn table(caption: &str, header: &[&str], rows: &[Vec<String>]) -> String {
    let head = |text: &&str| format!("<th scope=\"col\">{}</th>", escaped(text));
    let head: String = header.iter().map(head).collect();
    let cell = |text: &String| format!("<td>{}</td>", escaped(text));
    let row =
        |row: &Vec<String>| format!("<tr>{}</tr>\n", row.iter().map(cell).collect::<String>());
    let body: String = rows.iter().map(row).collect();
    let caption = escaped(caption);
    format!(
        "<div class=\"scroll\"><table><caption>{caption}</caption><thead><tr>{head}</tr></thead>\
         <tbody>\n{body}</tbody></table></div>\n"
    )
}

/// Terms and their values.
fn terms(rows: &[(&str, String)]) -> String {
    let row = |(term, value): &(&str, String)| {
        format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escaped(term), escaped(value))
    };
    format!("<dl>\n{}</dl>\n", rows.iter().map(row).collect::<String>())
}

/// The main facts of a run. `spent` has its iterations and its time, as text.
pub(crate) fn summary(run: &Run<'_>, spent: &str) -> String {
    let [x, y, z, radius] = run.file.bounds;
    let (train, test) = (run.dataset.train.len(), run.dataset.test.len());
    let mut rows = vec![
        ("data set", run.dataset.path.display().to_string()),
        ("views", format!("{train} to fit, {test} held out")),
        (
            "sphere",
            format!(
                "centre {}, radius {}, data set units",
                files::point([x, y, z], radius),
                files::length(radius, radius)
            ),
        ),
        ("fit", spent.to_owned()),
    ];
    rows.extend(run.modelled.iter().filter_map(|line| {
        let (term, value) = line.split_once(": ")?;
        Some((term, value.to_owned()))
    }));
    if let State::Ended(verdict) = run.state {
        let evidence = &verdict.evidence;
        rows.push(("match", evidence.match_text()));
        if let Some(SurfaceShares { on_sphere, unseen, .. }) = &evidence.surface {
            let [on_sphere, unseen] = [on_sphere, unseen].map(|share| 100.0 * share);
            rows.push((
                "surface",
                format!(
                    "{on_sphere:.1} % of its area on the bounding sphere, {unseen:.1} % seen by \
                     no photograph"
                ),
            ));
        }
    }
    terms(&rows)
}

/// The warnings about the photographs and the files of the run.
pub(crate) fn warnings(warnings: &[&str]) -> String {
    if warnings.is_empty() {
        return "<p>There are no warnings about the photographs.</p>\n".to_owned();
    }
    let item = |text: &&str| format!("<li>{}</li>\n", escaped(text));
    format!("<ul>\n{}</ul>\n", warnings.iter().map(item).collect::<String>())
}

/// The corrections of cameras and the exposures, if the run fitted any.
///
/// # Errors
/// If a file of the run cannot be read.
pub(crate) fn corrections(run: &Run<'_>) -> Result<String, InputError> {
    let mut out = String::new();
    if let Some(cameras) = RunCameras::load(run.folder)? {
        let row = |own: &fit::RunCamera| {
            let length = own.shift.iter().map(|x| x * x).sum::<f64>().sqrt();
            vec![
                own.name.clone(),
                format!("{:.3}", own.degrees),
                format!("{length:.5}"),
                format!("{:.2}", own.pixels),
            ]
        };
        let rows: Vec<Vec<String>> = cameras.views.iter().map(row).collect();
        let header = ["view", "turn, degrees", "shift, data set units", "motion, pixels"];
        out += &table("Corrections of the cameras", &header, &rows);
    }
    if let Some(exposures) = RunExposures::load(run.folder)? {
        let row = |own: &fit::RunExposure| {
            let stops = own.stops.iter().map(|stops| format!("{stops:+.2}"));
            std::iter::once(own.name.clone()).chain(stops).collect()
        };
        let rows: Vec<Vec<String>> = exposures.views.iter().map(row).collect();
        let header = ["view", "red", "green", "blue"];
        out += &table("Exposures of the photographs, in stops", &header, &rows);
    }
    if out.is_empty() {
        out = "<p>The cameras and the exposures are those of the data set.</p>\n".to_owned();
    }
    Ok(out)
}

/// The options of the fit.
pub(crate) fn options(run: &Run<'_>) -> Result<String, toml::ser::Error> {
    let mut rows = Vec::new();
    flatten("", &toml::Table::try_from(&run.file.options)?, &mut rows);
    Ok(table("Options of the fit", &["option", "value"], &rows))
}

/// The entries of a table and its subtables.
fn flatten(prefix: &str, table: &toml::Table, rows: &mut Vec<Vec<String>>) {
    for (key, value) in table {
        match value {
            toml::Value::Table(inner) => flatten(&format!("{prefix}{key}."), inner, rows),
            toml::Value::String(text) => rows.push(vec![format!("{prefix}{key}"), text.clone()]),
            other => rows.push(vec![format!("{prefix}{key}"), other.to_string()]),
        }
    }
}
