//! The report of a sweep, as Markdown and as HTML.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::report::claims::{Judgement, judge};
use crate::report::files::write_whole;
use crate::report::html::html;
use crate::report::metrics::{METRICS, Metric};
use crate::report::options::text;
use crate::report::pairs::percent;
use crate::report::plots::save_pictures;
use crate::report::recommendation::recommendation;
use crate::report::result_table::{ResultTable, mean_with_interval};
use crate::report::results::{CellResult, describe};
use crate::report::results_csv::to_csv;
use crate::report::schema::Options;
use crate::report::schema::{Claim, ClaimKind};
use crate::report::sweep::Sweep;

/// The plots at the end of the report: headings and files.
const PLOTS: [(&str, &str); 3] = [
    ("Heat maps", "heat.svg"),
    ("Loss over iterations", "curves.svg"),
    ("Chamfer distance over time, and in yellow its Pareto front", "pareto.svg"),
];

/// Writes `results.csv`, the pictures, `report.html` and `report.md` into the folder `output`.
///
/// `machines` are lines of text about the machines that ran the cells. `picture` gives the file of
/// a result's picture; the file need not exist.
///
/// # Errors
/// If a file cannot be written.
pub fn write_report(
    sweep: &Sweep,
    results: &[CellResult],
    machines: &[String],
    output: &Path,
    picture: &dyn Fn(&CellResult) -> PathBuf,
) -> Result<(), Error> {
    write_whole(&output.join("results.csv"), to_csv(results)?)?;
    save_pictures(sweep, results, output, picture)?;
    let text = markdown(sweep, results, machines);
    write_whole(&output.join("report.html"), html(&sweep.title, &text, output)?)?;
    write_whole(&output.join("report.md"), text)
}

/// The whole report.
fn markdown(sweep: &Sweep, results: &[CellResult], machines: &[String]) -> String {
    let complete = results.len() >= sweep.cells().len();
    let mut out = format!("# {}\n\n", sweep.title);
    if !sweep.about.is_empty() {
        let _ = writeln!(out, "{}\n", sweep.about.trim());
    }
    setup(&mut out, sweep, machines);
    counts(&mut out, sweep, results);
    if !sweep.claim.is_empty() {
        claims(&mut out, sweep, results);
    }
    if complete {
        recommendation(&mut out, results);
    } else {
        let _ = writeln!(out, "## Recommendation\n\nNone, since cells are missing.\n");
    }
    reconstructions(&mut out);
    tables(&mut out, sweep, results);
    for (title, file) in PLOTS {
        let _ = writeln!(out, "## {title}\n\n![{title}]({file})\n");
    }
    failures(&mut out, results);
    out
}

/// Text of a table's field.
fn field(text: &str) -> String {
    text.replace('|', "\\|")
}

/// Options with their values, as text of a table's field.
fn list(options: &Options) -> String {
    let each: Vec<String> = options.iter().map(|(k, v)| format!("{k} = {}", text(v))).collect();
    field(&each.join(", "))
}

/// The section "Setup": parameters, data, budget, machines and criteria.
fn setup(out: &mut String, sweep: &Sweep, machines: &[String]) {
    let _ = writeln!(out, "## Setup\n\n| | |\n|---|---|");
    for key in sweep.parameters.keys() {
        let _ = writeln!(out, "| {key} | {} |", field(&sweep.values(key).join(", ")));
    }
    for (key, settings) in &sweep.settings {
        for (value, options) in settings {
            let _ = writeln!(out, "| {} | {} |", field(&format!("{key} = {value}")), list(options));
        }
    }
    let _ = writeln!(out, "| all cells | {} |", list(&sweep.fixed));
    for data in &sweep.data {
        let source = data.scene.as_deref().or(data.dataset.as_deref()).unwrap_or_default();
        let views = data.scene.as_ref().map_or(String::new(), |_| {
            format!(", {} views of {} × {} pixels", data.views, data.size, data.size)
        });
        let _ = writeln!(out, "| {} | {}{views} |", data.name, field(source));
    }
    let budget = match (sweep.iterations, &sweep.time) {
        (Some(n), _) => format!("{n} iterations"),
        (None, Some(time)) => format!("{time} of wall time"),
        (None, None) => "the preset's".to_owned(),
    };
    let seeds: Vec<String> = sweep.seeds.iter().map(ToString::to_string).collect();
    let _ = writeln!(out, "| budget of a fit | {budget} |\n| seeds | {} |", seeds.join(", "));
    for machine in machines {
        let _ = writeln!(out, "| run on | {} |", field(machine));
    }
    criteria(out, sweep);
}

/// The rows of the setup about convergence and about the gradient test.
fn criteria(out: &mut String, sweep: &Sweep) {
    let (converged, test) = (&sweep.converged, &sweep.gradient);
    let _ = writeln!(
        out,
        "| converged | Chamfer distance at most {} of the bounding radius, and the loss at the \
         end (mean over a twentieth of the fit) at most {} times the lowest |",
        percent(converged.chamfer),
        converged.rise
    );
    let _ = writeln!(
        out,
        "| bias, variance | relative L2 (squared for the variance) of the silhouette's derivative \
         image along a random direction of the weights: {} × {} pixels, {} samples a pixel, {} \
         runs; the reference is the contour integral |",
        test.size, test.size, test.spp, test.runs
    );
    let _ = writeln!(out, "\nMeans are over the seeds, with intervals of 95 % (Student).\n");
}

/// Numbers of finished, failed and converged cells.
fn counts(out: &mut String, sweep: &Sweep, results: &[CellResult]) {
    let cells = sweep.cells().len();
    let failed = results.iter().filter(|r| r.status != "done").count();
    let converged = results.iter().filter(|r| r.converged).count();
    let _ = writeln!(
        out,
        "{} of {cells} cells are finished. {failed} of them failed or exceeded a limit; \
         {converged} converged.\n",
        results.len()
    );
    if results.len() < cells {
        let _ = writeln!(
            out,
            "**This sweep is not complete: the report is about the finished cells only.**\n"
        );
    }
}

/// The section "Claims": the verdicts, then the criterion and the evidence of each.
fn claims(out: &mut String, sweep: &Sweep, results: &[CellResult]) {
    let _ = writeln!(
        out,
        "## Claims\n\nA claim is judged by pairs of fits that differ in one parameter only. The \
         evidence is the geometric mean of the ratio of their errors, with a paired interval of \
         95 % and the p value of a paired t-test. The pairs of one data set and seed count as one \
         observation, their mean. A fit without a result counts as one bounding radius off.\n\n\
         | claim | verdict |\n|---|---|"
    );
    let judgements: Vec<Judgement> =
        sweep.claim.iter().map(|claim| judge(sweep, claim, results)).collect();
    for (claim, judgement) in sweep.claim.iter().zip(&judgements) {
        let _ = writeln!(out, "| {} | **{}** |", field(&claim.text), judgement.verdict.name());
    }
    out.push('\n');
    for (claim, judgement) in sweep.claim.iter().zip(&judgements) {
        let _ = writeln!(out, "{} ({}):\n", claim.text, criterion(claim));
        for line in &judgement.evidence {
            let _ = writeln!(out, "- {line}");
        }
        out.push('\n');
    }
}

/// The criterion of a claim in words.
fn criterion(claim: &Claim) -> String {
    let margin = percent(claim.margin);
    let words = match claim.kind {
        ClaimKind::Best => "reproduced if the whole interval of every other value is above \
                            100 %; not reproduced if the whole interval of one value is below \
                            100 %"
            .to_owned(),
        ClaimKind::Worse => format!(
            "reproduced if the whole interval is above 100 % and the mean is worse by {margin} or \
             more; not reproduced if the whole interval is worse by less than {margin}"
        ),
        ClaimKind::LittleGain => format!(
            "reproduced if the whole interval is better by less than {margin}; not reproduced if \
             the whole interval is better by more than {margin}"
        ),
        ClaimKind::OftenDiverges => "reproduced if a quarter or more do not converge and the \
                                     whole interval is above one in twenty and above the share at \
                                     the other value; not reproduced if the whole interval is \
                                     below a quarter"
            .to_owned(),
    };
    let only = claim.only.iter().map(|(k, v)| format!("; only {k} = {}", text(v)));
    words + &only.collect::<String>()
}

/// The section "Reconstructions", whose picture is `grid.png`.
fn reconstructions(out: &mut String) {
    let _ = writeln!(
        out,
        "## Reconstructions\n\n![The reconstructions](grid.png)\n\n\
         Each picture is the seed with the median Chamfer distance; the numbers below it are means \
         over the seeds. A red count means that not all seeds converged.\n"
    );
}

/// The metrics that a sweep selects for its report.
fn selected_metrics(sweep: &Sweep) -> impl Iterator<Item = &'static Metric> {
    let selected =
        |m: &&Metric| sweep.metrics.is_empty() || sweep.metrics.iter().any(|name| name == m.name);
    METRICS.iter().filter(selected)
}

/// The section "Tables": every metric over every table of the sweep.
fn tables(out: &mut String, sweep: &Sweep, results: &[CellResult]) {
    let _ = writeln!(out, "## Tables\n");
    for metric in selected_metrics(sweep) {
        for table in ResultTable::all(sweep) {
            let columns = &table.columns.values;
            let _ = writeln!(out, "{}: {}\n", table.title, metric.label);
            let _ = writeln!(
                out,
                "| {} ↓ {} → | {} |\n|---{}|",
                table.rows.parameter,
                table.columns.parameter,
                columns.join(" | "),
                "|---".repeat(columns.len())
            );
            for row in &table.rows.values {
                let field =
                    |column: &String| mean_with_interval(&table.at(results, row, column), metric);
                let fields: Vec<String> = columns.iter().map(field).collect();
                let _ = writeln!(out, "| {row} | {} |", fields.join(" | "));
            }
            out.push('\n');
        }
    }
}

/// The section of failed cells, if there are any.
fn failures(out: &mut String, results: &[CellResult]) {
    let failed: Vec<&CellResult> = results.iter().filter(|r| r.status != "done").collect();
    if failed.is_empty() {
        return;
    }
    let _ = writeln!(
        out,
        "## Cells that failed or exceeded a limit\n\n\
         | cell | seed | status | reason |\n|---|---|---|---|"
    );
    for result in failed {
        let _ = writeln!(
            out,
            "| {}, {} | {} | {} | {} |",
            result.data,
            describe(&result.values),
            result.seed,
            result.status,
            field(&result.reason)
        );
    }
    out.push('\n');
}
