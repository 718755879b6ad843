//! The page of a run: one file, which a browser shows without an error.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::path::Path;
use std::process::Command;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;

use tests::browser::{OPTIONS, chromium};
use tests::input::{Folder, ball};
use tests::{dsdf_json, dsdf_ok};

/// Added to the head of a page: collects its errors, and refuses everything that it does not hold
/// itself. An attempt to load it is an error, too.
const HEAD: &str = r#"<meta http-equiv="Content-Security-Policy" content="default-src 'none';
  script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:">
<script>
const problems = [];
addEventListener("securitypolicyviolation", (event) =>
  problems.push(`${event.violatedDirective}: ${event.blockedURI}`));
addEventListener("error", (event) => problems.push(String(event.message)));
console.error = console.warn = (...words) => problems.push(words.join(" "));
</script>"#;

/// Added to the end of a page: uses it as a person does, and writes the result into the page.
const USE: &str = r#"<script>
setTimeout(() => {
  const result = { problems };
  try {
    const canvas = document.getElementById("surface");
    const gl = canvas.getContext("webgl2");
    const pixels = () => {
      viewer.draw();
      const all = new Uint8Array(4 * canvas.width * canvas.height);
      gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, all);
      return all;
    };
    const changed = (act) => {
      const before = pixels();
      act();
      const after = pixels();
      return after.filter((value, i) => value !== before[i]).length / after.length;
    };
    const key = (name) => () => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: name }));
    const first = pixels();
    result.drawn = first.filter((value, i) => i % 4 === 3 && value > 0).length / (first.length / 4);
    const names = ["ArrowLeft", "ArrowUp", "+", "-", "2", "3", "1", "c", "a", "0"];
    result.keys = Object.fromEntries(names.map((name) => [name, changed(key(name))]));
    const name = () => document.getElementById("view-name").textContent;
    result.first = name();
    document.getElementById("next").click();
    result.second = name();
    result.through = changed(() => document.getElementById("through").click());
    result.photograph = document.getElementById("photograph").naturalWidth;
    result.unnamed = [...document.querySelectorAll("input, button, canvas, img, svg")]
      .filter((e) => !(e.labels?.length || e.ariaLabel || e.alt || e.textContent.trim()))
      .map((e) => e.outerHTML.slice(0, 80));
    result.back = getComputedStyle(document.body).backgroundColor;
    result.wide = document.documentElement.scrollWidth > innerWidth;
  } catch (error) {
    problems.push(String(error));
  }
  const text = document.createElement("pre");
  text.id = "result";
  text.textContent = btoa(JSON.stringify(result));
  document.body.append(text);
}, 500);
</script></body>"#;

/// Shows a page and uses it. Returns the result of [`USE`].
fn used(browser: &str, page: &Path, options: &[&str]) -> Value {
    let html = std::fs::read_to_string(page).unwrap();
    let probe = page.with_extension("probe.html");
    // In front of all that could load something.
    let first = "<meta charset=\"utf-8\">";
    assert!(html.contains(first));
    let html = html.replacen(first, &format!("{first}{HEAD}"), 1);
    let end = html.rfind("</body>").unwrap();
    std::fs::write(&probe, format!("{}{USE}{}", &html[..end], &html[end + 7..])).unwrap();
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(browser)
        .args(OPTIONS)
        .args(["--dump-dom", "--window-size=900,900", "--virtual-time-budget=6000"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args(options)
        .arg(format!("file://{}", probe.canonicalize().unwrap().display()))
        .output()
        .unwrap();
    let dom = String::from_utf8_lossy(&output.stdout);
    let (_, rest) = dom.split_once("<pre id=\"result\">").unwrap_or_else(|| {
        panic!("no result: {}", String::from_utf8_lossy(&output.stderr));
    });
    let text = rest.split('<').next().unwrap();
    serde_json::from_slice(&STANDARD.decode(text).unwrap()).unwrap()
}

#[test]
fn a_run_is_one_page_that_a_browser_shows_without_an_error() {
    let folder = Folder::new();
    // The name of the run is text, and no markup.
    let (data, run) = (ball(&folder, "6"), folder.path("run <b>&amp;"));
    let fit = ["fit", &data, "-o", &run, "--iterations", "300", "--batch", "256", "--report"];
    let verdict = dsdf_json(&fit)["verdict"].clone();
    let of_fit = std::fs::read_to_string(Path::new(&run).join("report.html")).unwrap();
    let page = folder.path("report.html");
    let report = dsdf_json(&["report", &run, "-o", &page]);
    assert_eq!(report["verdict"], verdict);
    let html = std::fs::read_to_string(&page).unwrap();
    assert_eq!(html, of_fit, "the page of `fit --report` is that of `report`");
    assert_eq!(report["bytes"], html.len());
    assert!(html.len() < 10_000_000);
    assert!(html.contains("<h1>run &lt;b&gt;&amp;amp;</h1>"));
    assert!(html.contains(verdict["text"].as_str().unwrap()));
    // Nothing is loaded: the one address is the name of the format of SVG.
    let addresses = html.split("http").skip(1).filter(|rest| rest.starts_with([':', 's']));
    assert!(addresses.into_iter().all(|rest| rest.starts_with("://www.w3.org/2000/svg")));

    let Some(browser) = chromium() else { return };
    let light = used(&browser, Path::new(&page), &["--blink-settings=preferredColorScheme=1"]);
    assert_eq!(light["problems"], serde_json::json!([]), "{light}");
    assert!(light["drawn"].as_f64().unwrap() > 0.02, "{light}");
    for (key, changed) in light["keys"].as_object().unwrap() {
        assert!(changed.as_f64().unwrap() > 1e-4, "{key} changes nothing: {light}");
    }
    assert!(light["through"].as_f64().unwrap() > 1e-4, "{light}");
    assert!(light["first"].as_str().unwrap().starts_with("1 of 7: "), "{light}");
    assert!(light["second"].as_str().unwrap().starts_with("2 of 7: "), "{light}");
    assert_eq!((&light["photograph"], &light["wide"]), (&32.into(), &false.into()), "{light}");
    assert_eq!(light["unnamed"], serde_json::json!([]), "{light}");
    let narrow = ["--blink-settings=preferredColorScheme=0", "--window-size=420,900"];
    let dark = used(&browser, Path::new(&page), &narrow);
    assert_eq!((&dark["problems"], &dark["wide"]), (&serde_json::json!([]), &false.into()));
    assert_ne!(dark["back"], light["back"], "{dark}");
}

#[test]
fn a_run_that_was_stopped_has_a_page_too() {
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "3"), folder.path("run"));
    let fit = ["fit", &data, "-o", &run, "--iterations", "4000", "--stop-after", "2", "--report"];
    dsdf_ok(&fit);
    let text = |page: &str| std::fs::read_to_string(page).unwrap();
    assert!(text(&format!("{run}/report.html")).contains("The fit was stopped before its end"));
    let page = folder.path("report.html");
    let report = dsdf_json(&["report", &run, "-o", &page]);
    assert!(report["bytes"].as_u64().unwrap() > 10_000);
    assert!(text(&page).contains("2 of 4000 iterations") && text(&page).contains("not finished"));
}
