//! The report of a sweep: a page that can be read alone, as Markdown and as HTML.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use pulldown_cmark::Event;

use super::claims::{Judged, error, error_name, judge, percent, worse};
use super::pictures::{Table, save, shown};
use super::results::{METRICS, Metric, Row, settings, to_csv, write};
use super::statistics::Mean;
use super::sweep::Sweep;
use super::tables::Kind;

/// Writes results, pictures and report of what is there; `picture` is where a row's picture lies.
pub(super) fn report(
    sweep: &Sweep,
    rows: &[Row],
    output: &Path,
    picture: &dyn Fn(&Row) -> PathBuf,
) -> anyhow::Result<()> {
    write(&output.join("results.csv"), to_csv(rows)?)?;
    save(sweep, rows, output, picture)?;
    let text = markdown(sweep, rows, &super::inputs::machines(output)?);
    write(&output.join("report.html"), html(&sweep.title, &text, output)?)?;
    write(&output.join("report.md"), text)
}

/// The metrics that a sweep asks for.
fn metrics(sweep: &Sweep) -> Vec<&'static Metric> {
    METRICS
        .iter()
        .filter(|m| sweep.metrics.is_empty() || sweep.metrics.iter().any(|n| n == m.name))
        .collect()
}

fn markdown(sweep: &Sweep, rows: &[Row], machines: &[String]) -> String {
    let cells = sweep.cells().len();
    let mut out = format!("# {}\n\n", sweep.title);
    if !sweep.about.is_empty() {
        let _ = writeln!(out, "{}\n", sweep.about.trim());
    }
    setup(&mut out, sweep, machines);
    let failed: Vec<&Row> = rows.iter().filter(|r| r.status != "done").collect();
    let converged = rows.iter().filter(|r| r.converged).count();
    let _ = writeln!(
        out,
        "{} of {cells} cells are here; {} were ended or failed; {converged} converged.\n",
        rows.len(),
        failed.len()
    );
    if rows.len() < cells {
        let _ = writeln!(
            out,
            "**This sweep is not complete: what follows is of the cells that are here.**\n"
        );
    }
    if !sweep.claim.is_empty() {
        claims(&mut out, sweep, rows);
    }
    if rows.len() < cells {
        let _ = writeln!(out, "## Recommendation\n\nNone before all cells are here.\n");
    } else {
        recommendation(&mut out, rows);
    }
    let _ = writeln!(out, "## Reconstructions\n\n![The reconstructions](grid.png)\n");
    let _ = writeln!(
        out,
        "Each is the seed with the median Chamfer distance, with the means over the seeds. Red: not all seeds converged.\n"
    );
    tables(&mut out, sweep, rows);
    let plots = [
        ("Heat maps", "heat.svg"),
        ("Loss over iterations", "curves.svg"),
        (
            "Chamfer distance over time, and in yellow what no other setting beats in both",
            "pareto.svg",
        ),
    ];
    for (title, file) in plots {
        let _ = writeln!(out, "## {title}\n\n![{title}]({file})\n");
    }
    if !failed.is_empty() {
        let _ = writeln!(
            out,
            "## What was ended or failed\n\n| cell | seed | status | reason |\n|---|---|---|---|"
        );
        for row in failed {
            let reason = field(&row.reason);
            let _ = writeln!(
                out,
                "| {}, {} | {} | {} | {reason} |",
                row.data,
                settings(&row.values),
                row.seed,
                row.status
            );
        }
        out.push('\n');
    }
    out
}

/// Text of a table's field.
fn field(text: &str) -> String {
    text.replace('|', "\\|")
}

fn setup(out: &mut String, sweep: &Sweep, machines: &[String]) {
    let _ = writeln!(out, "## Setup\n\n| | |\n|---|---|");
    for (key, _) in &sweep.parameters {
        let _ = writeln!(out, "| {key} | {} |", field(&sweep.values(key).join(", ")));
    }
    let fixed: Vec<String> =
        sweep.fixed.iter().map(|(k, v)| format!("{k} = {}", super::sweep::text(v))).collect();
    let _ = writeln!(out, "| all cells | {} |", field(&fixed.join(", ")));
    for data in &sweep.data {
        let of = data.scene.as_deref().or(data.dataset.as_deref()).unwrap_or_default();
        let views = data.scene.as_ref().map_or(String::new(), |_| {
            format!(", {} views of {} × {} pixels", data.views, data.size, data.size)
        });
        let _ = writeln!(out, "| {} | {}{views} |", data.name, field(of));
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
    let (converged, test) = (&sweep.converged, &sweep.gradient);
    let _ = writeln!(
        out,
        "| converged | Chamfer distance at most {} of the bounding radius, and the loss at the end (a twentieth of the fit) at most {} times the lowest |",
        percent(converged.chamfer),
        converged.rise
    );
    let _ = writeln!(
        out,
        "| bias, variance | relative L2 (squared for the variance) of the derivative image of the silhouette by a random direction of the weights, {} × {} pixels, {} samples, {} runs, against contours |",
        test.size, test.size, test.spp, test.runs
    );
    let _ = writeln!(out, "\nMeans are over the seeds, with intervals of 95 % (Student).\n");
}

fn claims(out: &mut String, sweep: &Sweep, rows: &[Row]) {
    let _ = writeln!(
        out,
        "## Claims\n\nPairs of fits that differ in nothing but the parameter: ratios of errors, their geometric mean with a paired interval of 95 %, p of a paired t-test. The pairs of one \
         data set and seed count as one observation, their mean. A fit without a result counts as one bounding radius off.\n\n| claim | verdict |\n|---|---|"
    );
    let judged: Vec<Judged> = sweep.claim.iter().map(|claim| judge(sweep, claim, rows)).collect();
    for (claim, judged) in sweep.claim.iter().zip(&judged) {
        let _ = writeln!(out, "| {} | **{}** |", field(&claim.text), judged.verdict.name());
    }
    out.push('\n');
    for (claim, judged) in sweep.claim.iter().zip(&judged) {
        let _ = writeln!(out, "{} ({}):\n", claim.text, criterion(claim));
        judged.evidence.iter().for_each(|line| {
            let _ = writeln!(out, "- {line}");
        });
        out.push('\n');
    }
}

fn criterion(claim: &super::tables::Claim) -> String {
    let margin = percent(claim.margin);
    let only: Vec<String> =
        claim.only.iter().map(|(k, v)| format!("; only {k} = {}", super::sweep::text(v))).collect();
    let text = match claim.kind {
        Kind::Best => "reproduced if the intervals of all others are worse; not if one is better".to_owned(),
        Kind::Worse => format!("reproduced if worse for certain and by {margin} or more; not if by less for certain"),
        Kind::LittleGain => format!("reproduced if better by less than {margin} for certain; not if by more for certain"),
        Kind::OftenDiverges => {
            "reproduced if a quarter or more do not converge, and for certain more than one in twenty and than at the other value; not if fewer than a quarter for certain"
                .to_owned()
        }
    };
    text + &only.concat()
}

/// How much worse than the best a recommended setting may look, and how much slower than the
/// fastest of those.
const NEAR: f64 = 1.05;

/// A setting with how much worse it is than the best one.
struct Setting {
    values: Vec<(String, String)>,
    /// The geometric mean of the error over data sets and seeds.
    error: f64,
    seconds: f64,
    passes: f64,
    converged: bool,
    /// Against the best, paired.
    worse: Mean,
}

/// A cost with so many decimals, if it is known.
fn cost(v: f64, decimals: usize) -> String {
    if v.is_finite() { format!("{v:.decimals$}") } else { "-".to_owned() }
}

/// The fastest setting that nothing says is worse than the best.
fn recommendation(out: &mut String, rows: &[Row]) {
    let known = rows.iter().any(|r| r.numbers.contains_key("chamfer"));
    let Some(metric) = super::results::metric(if known { "chamfer" } else { "psnr" }) else {
        return;
    };
    // Data without a true surface says nothing of distances to one.
    let told =
        |data: &str| rows.iter().any(|r| r.data == data && r.numbers.contains_key(metric.name));
    let rows: Vec<Row> = rows.iter().filter(|r| told(&r.data)).cloned().collect();
    let mut places: Vec<Vec<(String, String)>> = Vec::new();
    for row in &rows {
        if !places.contains(&row.values) {
            places.push(row.values.clone());
        }
    }
    // One parameter for all, so that pairs of whole settings can be compared.
    let named: Vec<Row> = rows
        .iter()
        .map(|r| {
            let at = places.iter().position(|p| *p == r.values).unwrap_or(0);
            Row { values: vec![("setting".to_owned(), at.to_string())], ..r.clone() }
        })
        .collect();
    let of = |at: usize| named.iter().filter(move |r| r.value("setting") == at.to_string());
    let mean_error = |at: usize| {
        let logs: Vec<f64> = of(at).map(|r| error(r, metric).max(metric.least).ln()).collect();
        (logs.iter().sum::<f64>() / logs.len() as f64).exp()
    };
    let Some(best) = (0..places.len()).min_by(|&a, &b| mean_error(a).total_cmp(&mean_error(b)))
    else {
        return;
    };
    let mut all: Vec<Setting> = (0..places.len())
        .map(|at| {
            let average = |number: &dyn Fn(&Row) -> Option<f64>| {
                let known: Vec<f64> = of(at).filter_map(number).collect();
                if known.is_empty() {
                    f64::INFINITY
                } else {
                    known.iter().sum::<f64>() / known.len() as f64
                }
            };
            let (seconds, passes) =
                (average(&|r| r.numbers.get("seconds").copied()), average(&Row::passes));
            let worse = worse(&named, "setting", &at.to_string(), &best.to_string(), metric);
            let converged = of(at).all(|r| r.converged);
            Setting {
                values: places[at].clone(),
                error: mean_error(at),
                seconds,
                passes,
                worse,
                converged,
            }
        })
        .collect();
    all.sort_by(|a, b| a.error.total_cmp(&b.error));
    let equal = |s: &&Setting| {
        s.converged && s.worse.count > 1 && s.worse.low <= 1.0 && s.worse.mean <= NEAR
    };
    let least = all.iter().filter(equal).map(|s| s.seconds).fold(f64::INFINITY, f64::min);
    // Times closer than this are not told apart: the better one then.
    let fastest = all.iter().filter(equal).find(|s| s.seconds <= NEAR * least);
    let _ = writeln!(out, "## Recommendation\n");
    if let Some(fastest) = fastest {
        let _ = writeln!(
            out,
            "**{}**: the fastest, within 5 %, of the settings that always converged and whose {} is not worse than the best one's for certain, nor by 5 % as seen.\n",
            settings(&fastest.values),
            error_name(metric)
        );
    } else {
        let _ = writeln!(out, "None: there are no repeats, or no setting always converged.\n");
    }
    let _ = writeln!(
        out,
        "| setting | {} (geometric mean) | of the best, 95 % | seconds | evaluations, M values |\n|---|---|---|---|---|",
        error_name(metric)
    );
    for s in &all {
        let _ = writeln!(
            out,
            "| {} | {:.3} % | {} ({} to {}) | {} | {} |",
            settings(&s.values),
            100.0 * s.error,
            percent(s.worse.mean),
            percent(s.worse.low),
            percent(s.worse.high),
            cost(s.seconds, 1),
            cost(s.passes / 1e6, 0)
        );
    }
    let _ = writeln!(
        out,
        "\nSeconds are the machine's, and of what else ran there; evaluations of f are counted: a gradient as 2 values, a Hessian–vector product as 4, a parameter gradient as 6.\n"
    );
}

fn tables(out: &mut String, sweep: &Sweep, rows: &[Row]) {
    let _ = writeln!(out, "## Tables\n");
    for metric in metrics(sweep) {
        for table in Table::all(sweep) {
            let _ = writeln!(out, "{}: {}\n", table.title, metric.label);
            let _ = writeln!(
                out,
                "| {} ↓ {} → | {} |",
                table.rows.0,
                table.columns.0,
                table.columns.1.join(" | ")
            );
            let _ = writeln!(out, "|---{}|", "|---".repeat(table.columns.1.len()));
            for row in &table.rows.1 {
                let own = table
                    .columns
                    .1
                    .iter()
                    .map(|column| shown(&table.at(rows, row, column), metric));
                let _ = writeln!(out, "| {row} | {} |", own.collect::<Vec<_>>().join(" | "));
            }
            out.push('\n');
        }
    }
}

/// The page with its pictures inside. It knows the Markdown that is written above, no more.
fn html(title: &str, markdown: &str, folder: &Path) -> anyhow::Result<String> {
    let mut body = String::new();
    // A sweep's words are words: what looks like HTML in them is none.
    let parser = pulldown_cmark::Parser::new_ext(markdown, pulldown_cmark::Options::ENABLE_TABLES)
        .map(|event| match event {
            Event::Html(text) | Event::InlineHtml(text) => Event::Text(text),
            event => event,
        });
    pulldown_cmark::html::push_html(&mut body, parser);
    for file in ["heat.svg", "curves.svg", "pareto.svg"] {
        let svg = std::fs::read_to_string(folder.join(file))?;
        let at = format!("<img src=\"{file}\"");
        while let Some(start) = body.find(&at) {
            let end = body[start..].find("/>").map_or(body.len(), |e| start + e + 2);
            body.replace_range(start..end, &svg);
        }
    }
    let png = base64::Engine::encode(
        &base64::engine::general_purpose::STANDARD,
        std::fs::read(folder.join("grid.png"))?,
    );
    let body = body.replace("src=\"grid.png\"", &format!("src=\"data:image/png;base64,{png}\""));
    let title = title.replace('&', "&amp;").replace('<', "&lt;");
    Ok(format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title><style>\
         body{{font-family:sans-serif;max-width:70em;margin:2em auto;padding:0 1em}}table{{border-collapse:collapse}}\
         td,th{{border:1px solid #ccc;padding:.2em .6em}}svg,img{{max-width:100%}}</style></head>\n<body>\n{body}</body></html>\n"
    ))
}
