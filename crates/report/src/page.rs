//! The page: a template, its style and scripts, and the data of the run.

use serde::Serialize;

use crate::curves::Curve;
use crate::escape::escaped;
use crate::solid::{Buffers, Frame};
use crate::tables;
use crate::views::Picture;
use crate::{Error, Run, State};

const TEMPLATE: &str = include_str!("../assets/report.html");
const STYLE: &str = include_str!("../assets/report.css");
const SCRIPTS: [&str; 4] = [
    include_str!("../assets/viewer.js"),
    include_str!("../assets/controls.js"),
    include_str!("../assets/curves.js"),
    include_str!("../assets/views.js"),
];

/// The data that the scripts of a page read.
#[derive(Debug, Serialize)]
pub(crate) struct Scene {
    pub(crate) frame: Frame,
    pub(crate) mesh: Option<Buffers>,
    pub(crate) views: Vec<Picture>,
    pub(crate) curves: Vec<Curve>,
}

/// The page of a run, with these warnings. `spent` has its iterations and its time, as text.
pub(crate) fn html(
    run: &Run<'_>,
    scene: &Scene,
    warnings: &[&str],
    spent: &str,
) -> Result<String, Error> {
    let name = run.folder.file_name().unwrap_or(run.folder.as_os_str()).to_string_lossy();
    let (class, verdict) = match run.state {
        State::Running => ("live", "The fit goes on."),
        State::Stopped => ("live", "The fit was stopped before its end; --resume continues it."),
        State::Ended(verdict) if verdict.fault.is_some() => ("fault", verdict.text),
        State::Ended(verdict) => ("good", verdict.text),
    };
    // A "<" in a string of JSON could end the script element.
    let data = serde_json::to_string(scene)?.replace('<', "\\u003c");
    let values = [
        ("title", escaped(&name)),
        ("style", STYLE.to_owned()),
        ("class", class.to_owned()),
        ("verdict", escaped(verdict)),
        ("summary", tables::summary(run, spent)),
        ("warnings", tables::warnings(warnings)),
        ("corrections", tables::corrections(run)?),
        ("options", tables::options(run)?),
        ("data", data),
        ("scripts", SCRIPTS.concat()),
    ];
    Ok(filled(TEMPLATE, &values))
}

/// The template with each `{{name}}` replaced by the value of this name. Values are not searched
/// again.
fn filled(template: &str, values: &[(&str, String)]) -> String {
    let mut parts = template.split("{{");
    let mut page = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (name, rest) = part.split_once("}}").unwrap_or(("", part));
        if let Some((_, value)) = values.iter().find(|(known, _)| *known == name) {
            page += value;
        }
        page += rest;
    }
    page
}
