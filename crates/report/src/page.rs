//! The page: a template, its style and scripts, and the data of the run.

use fit::{Budget, RunFolder, Solid};
use serde::Serialize;

use crate::curves::{self, Curve, Metrics};
use crate::escape::escaped;
use crate::solid::{self, Buffers, Frame};
use crate::tables;
use crate::views::{self, Picture};
use crate::{Detail, Error, Run, State};

const TEMPLATE: &str = include_str!("../assets/report.html");
const STYLE: &str = include_str!("../assets/report.css");
const SCRIPTS: [&str; 4] = [
    include_str!("../assets/viewer.js"),
    include_str!("../assets/controls.js"),
    include_str!("../assets/curves.js"),
    include_str!("../assets/views.js"),
];

/// The bar with the progress of a fit that goes on.
const LIVE: &str = include_str!("../assets/live.html");
const LIVE_SCRIPT: &str = include_str!("../assets/live.js");

/// The data that the scripts of a page read.
#[derive(Debug, Serialize)]
struct Scene {
    frame: Frame,
    mesh: Option<Buffers>,
    views: Vec<Picture>,
    curves: Vec<Curve>,
}

/// The sentence at the top of a page.
#[derive(Debug, Serialize)]
struct Headline {
    /// `good`, `fault` or `live`: the class of its element.
    state: &'static str,
    text: String,
}

/// The parts of a page that are HTML.
#[derive(Debug, Default, Serialize)]
struct Fragments {
    summary: String,
    warnings: String,
    corrections: String,
    options: String,
}

/// All that a page shows of a run.
#[derive(Debug, Serialize)]
pub struct Content {
    #[serde(skip)]
    name: String,
    scene: Scene,
    verdict: Headline,
    html: Fragments,
}

impl Content {
    /// The content of the page of a run. It renders views and extracts the surface, as `detail`
    /// says, and reads the metrics. `progress` gets the fraction done, on any thread.
    ///
    /// # Errors
    /// If the field gives a NaN or an infinity, or a file of the run cannot be read.
    pub fn of(
        run: &Run<'_>,
        detail: Detail,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Self, Error> {
        let solid = Solid::new(run.model, run.file);
        let views = views::views(run, &solid, detail, &|p| progress(0.6 * p))?;
        let metrics = curves::metrics(&RunFolder::new(run.folder).metrics())?;
        let Metrics { curves, iterations, seconds, warning } = metrics;
        let scene = Scene {
            frame: Frame::of(run),
            mesh: solid::mesh(run, &solid, detail, &|p| progress(0.6 + 0.4 * p))?,
            views,
            curves,
        };
        let warnings: Vec<&str> =
            run.warnings.iter().map(String::as_str).chain(warning.as_deref()).collect();
        let (state, text) = match run.state {
            State::Running(None) => {
                ("live", "The fit goes on. It is too early for more.".to_owned())
            }
            State::Running(Some(verdict)) => {
                ("live", format!("The fit goes on. So far: {}", verdict.text))
            }
            State::Stopped => {
                ("live", "The fit was stopped before its end; --resume continues it.".to_owned())
            }
            State::Ended(verdict) if verdict.fault.is_some() => ("fault", verdict.text.to_owned()),
            State::Ended(verdict) => ("good", verdict.text.to_owned()),
        };
        let html = Fragments {
            summary: tables::summary(run, &spent(run, iterations, seconds)),
            warnings: tables::warnings(&warnings),
            corrections: tables::corrections(run)?,
            options: tables::options(run)?,
        };
        let name = run.folder.file_name().unwrap_or(run.folder.as_os_str()).to_string_lossy();
        Ok(Content { name: name.into_owned(), scene, verdict: Headline { state, text }, html })
    }

    /// The page: one HTML file that needs no other.
    ///
    /// # Errors
    /// If a number has no form in JSON.
    pub fn html(&self) -> Result<String, Error> {
        let data = serde_json::to_string(&self.scene)?;
        Ok(filled(&self.name, &self.verdict, &self.html, &data, ["", ""]))
    }

    /// What an open page of [`live_page`] shows next, as JSON.
    ///
    /// # Errors
    /// As [`html`](Self::html).
    pub fn json(&self) -> Result<String, Error> {
        Ok(serde_json::to_string(self)?)
    }
}

/// The page of a fit that runs, named `name`, before it has a surface.
///
/// Its script asks the server of the page for more, each time with the `token` of the page's own
/// address: `news` is a stream of events, of which each is a JSON object with `state` (`running`,
/// `stopped`, `ended` or `failed`), `step`, `fraction`, `times`, `text`, `stops` and the `version`
/// of the surface; `scene` is the newest [`Content::json`], with its version in the header
/// `dsdf-version`; a POST of `stop` asks the fit to stop.
pub fn live_page(name: &str) -> String {
    let verdict = Headline { state: "live", text: "There is no surface yet.".to_owned() };
    filled(name, &verdict, &Fragments::default(), "null", [LIVE, LIVE_SCRIPT])
}

/// The last line of the metrics is older than the end of the fit by the time of its last files. So
/// this share of the budget and a second may lack.
const UNRECORDED: f64 = 0.01;

/// The budget that a run has spent. A run that was stopped has spent a part of it.
fn spent(run: &Run<'_>, iterations: u64, seconds: f64) -> String {
    let budget = run.file.options.budget();
    match budget {
        Budget::Time(time) if seconds + 1.0 < (1.0 - UNRECORDED) * time.as_secs_f64() => {
            let all = time.as_secs_f64();
            format!("{iterations} iterations, {seconds:.0} s of {all:.0} s: not finished")
        }
        Budget::Iterations(all) if iterations < all => {
            format!("{iterations} of {all} iterations, {seconds:.0} s: not finished")
        }
        _ => format!("{iterations} iterations, {seconds:.0} s"),
    }
}

/// The template with its values: the bar and the script are those of a fit that runs.
fn filled(
    name: &str,
    verdict: &Headline,
    html: &Fragments,
    data: &str,
    [bar, script]: [&str; 2],
) -> String {
    // A "<" in a string of JSON could end the script element.
    let data = data.replace('<', "\\u003c");
    let values = [
        ("title", escaped(name)),
        ("style", STYLE.to_owned()),
        ("live", bar.to_owned()),
        ("class", verdict.state.to_owned()),
        ("verdict", escaped(&verdict.text)),
        ("summary", html.summary.clone()),
        ("warnings", html.warnings.clone()),
        ("corrections", html.corrections.clone()),
        ("options", html.options.clone()),
        ("data", data),
        ("scripts", SCRIPTS.concat() + script),
    ];
    let mut parts = TEMPLATE.split("{{");
    let mut page = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (name, rest) = part.split_once("}}").unwrap_or(("", part));
        // Values are not searched again.
        if let Some((_, value)) = values.iter().find(|(known, _)| *known == name) {
            page += value;
        }
        page += rest;
    }
    page
}
