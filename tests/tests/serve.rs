//! The page of a fit that runs: in a real browser, and against clients that mean no good.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::{Duration, Instant};

use tests::binary;
use tests::browser::{Browser, chromium};
use tests::input::{Folder, ball, refused};

/// A fit that runs, with a page.
struct Served {
    child: Child,
    lines: BufReader<ChildStderr>,
    url: String,
}

impl Served {
    /// Starts a fit and reads the address of its page.
    fn start(arguments: &[&str]) -> Self {
        let start = || Command::new(binary()).args(arguments).stderr(Stdio::piped()).spawn();
        let mut child = start().unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap());
        let mut fit = Served { child, lines, url: String::new() };
        let mut all = String::new();
        while fit.url.is_empty() {
            let mut line = String::new();
            assert!(fit.lines.read_line(&mut line).unwrap() > 0, "no page: {all}");
            fit.url = line.strip_prefix("page: ").unwrap_or_default().trim().to_owned();
            all += &line;
        }
        fit
    }

    fn address(&self) -> &str {
        self.url.strip_prefix("http://").unwrap().split_once('/').unwrap().0
    }

    fn token(&self) -> &str {
        self.url.split_once("?token=").unwrap().1
    }

    /// Waits for the end. Returns the exit status and the rest of standard error.
    fn end(mut self) -> (Option<i32>, String) {
        let mut rest = String::new();
        self.lines.read_to_string(&mut rest).unwrap();
        (self.child.wait().unwrap().code(), rest)
    }

    /// Waits for the end of a fit that was asked to stop, and compares the model with that of as many
    /// iterations without a page.
    fn has_the_bits_of_a_fit_alone(self, folder: &Folder, data: &str, run: &str) {
        let (status, rest) = self.end();
        assert_eq!(status, Some(130), "{rest}");
        let stopped = rest.split("stopped after ").nth(1).unwrap().split(' ').next().unwrap();
        let alone = folder.path("alone");
        let fit = ["fit", data, "-o", &alone, "--stop-after", stopped];
        tests::dsdf_ok(&[&fit[..], &FIT].concat());
        let model = |run: &str| fs::read(Path::new(run).join("model.safetensors")).unwrap();
        assert!(model(run) == model(&alone), "other bits after {stopped} iterations");
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        stream
    }

    /// Sends a request as it is, and returns what comes back until the end.
    fn raw(&self, request: &[u8]) -> String {
        let mut stream = self.connect();
        // The server may refuse the rest of a request.
        let _ = stream.write_all(request);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// The status of the answer to a request.
    fn status(&self, method: &str, target: &str) -> String {
        let answer = self.raw(format!("{method} {target} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes());
        answer.split(' ').nth(1).unwrap_or_default().to_owned()
    }
}

/// Waits until a fit has written a file.
fn wait_for(file: &Path) -> fs::Metadata {
    let start = Instant::now();
    loop {
        if let Ok(metadata) = fs::metadata(file) {
            return metadata;
        }
        assert!(start.elapsed() < Duration::from_secs(120), "no {}", file.display());
        std::thread::sleep(Duration::from_millis(50));
    }
}

const FIT: [&str; 4] = ["--iterations", "1000000", "--batch", "128"];

#[test]
fn a_browser_shows_a_fit_that_is_killed_resumed_and_stopped() {
    let Some(program) = chromium() else { return };
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "6"), folder.path("run <b>"));
    let start = ["fit", &data, "-o", &run];
    let fit = Served::start(&[&start[..], &FIT, &["--serve"]].concat());
    // A client that asks for news and never reads them.
    let mut deaf = fit.connect();
    deaf.write_all(format!("GET /news?token={} HTTP/1.1\r\n\r\n", fit.token()).as_bytes()).unwrap();

    let mut browser = Browser::start(&program);
    let pages = [0, 1].map(|_| browser.open(&fit.url));
    for page in &pages {
        browser.wait(page, "document.getElementById('step').textContent.includes('iterations')");
        browser.wait(page, "report.mesh.faces > 100 && report.views.length > 0");
        assert_eq!(browser.value(page, "document.querySelector('h1').textContent"), "run <b>");
        let drawn = browser.value(
            page,
            "(() => { viewer.draw(); const gl = document.getElementById('surface').getContext('webgl2');
               const all = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
               gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA,
                 gl.UNSIGNED_BYTE, all);
               return all.filter((value, i) => i % 4 === 3 && value > 0).length * 4 / all.length; })()",
        );
        assert!(drawn.as_f64().unwrap() > 0.02, "{drawn}");
        for (id, words) in
            [("summary", "6 to fit"), ("verdict", "The fit goes on"), ("curves", "loss")]
        {
            let text = browser.value(page, &format!("document.getElementById('{id}').textContent"));
            assert!(text.as_str().unwrap().contains(words), "{id}: {text}");
        }
    }

    // After a kill, the page waits. The address and the token are those of the run, so it goes on.
    let before = fit.url.clone();
    let mut killed = fit;
    wait_for(&Path::new(&run).join("checkpoint/state.safetensors"));
    killed.child.kill().unwrap();
    killed.end();
    browser.wait(&pages[0], "document.getElementById('step').textContent.includes('No answer')");
    let fit = Served::start(&["fit", "--resume", "-o", &run, "--serve"]);
    assert_eq!(fit.url, before);
    for page in &pages {
        browser.wait(page, "document.getElementById('step').textContent.includes('iterations')");
    }

    browser.wait(&pages[1], "!document.getElementById('stop').disabled");
    browser.value(&pages[1], "document.getElementById('stop').click()");
    for page in &pages {
        browser.wait(page, "document.getElementById('step').textContent.startsWith('stopped')");
        browser
            .wait(page, "document.getElementById('verdict').textContent.includes('was stopped')");
        assert_eq!(browser.value(page, "document.getElementById('stop').disabled"), true);
    }
    let (status, rest) = fit.end();
    assert_eq!(status, Some(130), "{rest}");
    assert!(rest.contains("--resume continues"), "{rest}");
    drop(deaf);
}

#[test]
fn strangers_and_bad_clients_neither_read_nor_disturb_a_fit() {
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "6"), folder.path("run"));
    let fit = Served::start(&[&["fit", &data, "-o", &run][..], &FIT, &["--serve"]].concat());
    let token = fit.token().to_owned();
    assert!(fit.address().starts_with("127.0.0.1:"), "{}", fit.url);

    // The token opens the page, and a wrong one nothing.
    assert_eq!(fit.status("GET", &format!("/?token={token}")), "200");
    let wrong = format!("{}{}", &token[1..], if token.starts_with('0') { '1' } else { '0' });
    for target in ["/", "/?token=", "/news", "/scene", "/stop", &format!("/?token={wrong}")] {
        assert_eq!(fit.status("GET", target), "403", "{target}");
        assert_eq!(fit.status("POST", target), "403", "{target}");
    }
    // The token is for the owner of the run alone.
    #[cfg(unix)]
    {
        let known = wait_for(&Path::new(&run).join("serve.json"));
        assert_eq!(std::os::unix::fs::MetadataExt::mode(&known) & 0o777, 0o600);
    }

    // No file is served.
    let files = ["/fit.toml", "/../fit.toml", "/%2e%2e/fit.toml", "//etc/passwd", "/./news/../x"];
    for target in files {
        assert_eq!(fit.status("GET", &format!("{target}?token={token}")), "404", "{target}");
    }
    for (method, path) in [("DELETE", "/"), ("GET", "/stop"), ("PUT", "/scene"), ("POST", "/news")]
    {
        assert_eq!(fit.status(method, &format!("{path}?token={token}")), "405", "{method} {path}");
    }

    // Requests that are none, or huge.
    let head = format!("POST /scene?token={token} HTTP/1.1\r\nHost: x\r\n");
    let huge = format!("{head}A: {}\r\n\r\n", "a".repeat(1 << 20));
    let many = format!("{head}{}\r\n", "A: a\r\n".repeat(1000));
    let body = format!("{head}Content-Length: 1000000000\r\n\r\n{}", "a".repeat(1 << 20));
    for (request, statuses) in [
        (huge.as_bytes(), &["431", "400"][..]),
        (many.as_bytes(), &["431", "400"]),
        (body.as_bytes(), &["405"]),
        (b"\x16\x03\x01\x00\x05hello\r\n\r\n", &["400"]),
    ] {
        let answer = fit.raw(request);
        let status = answer.split(' ').nth(1).unwrap_or_default();
        // The server may be gone before all of the request was sent.
        assert!(answer.is_empty() || statuses.contains(&status), "{answer}");
    }

    flood(&fit);
    // There is room again.
    let again = (0..100).any(|_| {
        std::thread::sleep(Duration::from_millis(100));
        fit.status("GET", &format!("/?token={token}")) == "200"
    });
    assert!(again);

    assert_eq!(fit.status("POST", &format!("/stop?token={token}")), "202");
    fit.has_the_bits_of_a_fit_alone(&folder, &data, &run);
}

/// Opens a thousand connections that say nothing, and one that says a letter a second.
fn flood(fit: &Served) {
    let start = Instant::now();
    let connect = |_| TcpStream::connect(fit.address()).ok();
    let silent: Vec<TcpStream> = (0..1000).filter_map(connect).collect();
    assert!(silent.len() > 200);
    let mut slow = fit.connect();
    for letter in b"GET /news?" {
        if slow.write_all(&[*letter]).is_err() {
            break;
        }
        std::thread::sleep(Duration::from_secs(1));
    }
    let mut answer = Vec::new();
    let _ = slow.read_to_end(&mut answer);
    assert!(start.elapsed() < Duration::from_secs(25), "it waited {:?}", start.elapsed());
}

#[test]
fn an_address_that_cannot_be_used_is_refused() {
    let folder = Folder::new();
    let (data, run) = (ball(&folder, "6"), folder.path("run"));
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let fit = ["fit", &data, "-o", &run, "--iterations", "5", "--batch", "16"];
    refused(&[&fit[..], &["--serve", &address]].concat(), 2, &["--serve", &address, "free port"]);
    refused(&[&fit[..], &["--check", "--serve", &address]].concat(), 2, &["--serve", "free port"]);
    assert!(!Path::new(&run).exists(), "nothing is written");
    refused(&["fit", "-o", &run, "--serve", &data], 2, &["--serve", "such as 8000"]);
}
