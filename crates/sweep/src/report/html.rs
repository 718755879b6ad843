//! The report as one HTML file with its pictures inside.

use std::path::Path;

use base64::Engine;
use pulldown_cmark::{Event, Options, Parser};

use crate::error::Error;

/// The pictures that become part of the page as SVG.
const VECTOR: [&str; 3] = ["heat.svg", "curves.svg", "pareto.svg"];

const STYLE: &str = "body{font-family:sans-serif;max-width:70em;margin:2em auto;padding:0 1em}\
                     table{border-collapse:collapse}\
                     td,th{border:1px solid #ccc;padding:.2em .6em}svg,img{max-width:100%}";

/// The page of a report in Markdown, with the pictures of `folder` in it.
///
/// It handles the Markdown of this crate's reports only. HTML in the texts of a sweep is shown as
/// text.
pub(crate) fn html(title: &str, markdown: &str, folder: &Path) -> Result<String, Error> {
    let mut body = String::new();
    let events = Parser::new_ext(markdown, Options::ENABLE_TABLES).map(|event| match event {
        Event::Html(text) | Event::InlineHtml(text) => Event::Text(text),
        event => event,
    });
    pulldown_cmark::html::push_html(&mut body, events);
    for file in VECTOR {
        inline_svg(&mut body, file, &std::fs::read_to_string(folder.join(file))?);
    }
    let png =
        base64::engine::general_purpose::STANDARD.encode(std::fs::read(folder.join("grid.png"))?);
    let body = body.replace("src=\"grid.png\"", &format!("src=\"data:image/png;base64,{png}\""));
    let title = title.replace('&', "&amp;").replace('<', "&lt;");
    Ok(format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
         <style>{STYLE}</style></head>\n<body>\n{body}</body></html>\n"
    ))
}

/// Replaces every image element of a file with the file's text.
fn inline_svg(body: &mut String, file: &str, svg: &str) {
    let element = format!("<img src=\"{file}\"");
    while let Some(start) = body.find(&element) {
        let end = body[start..].find("/>").map_or(body.len(), |e| start + e + 2);
        body.replace_range(start..end, svg);
    }
}
