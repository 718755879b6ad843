//! A browser without a window, driven over the pipe of its debugging protocol.
#![allow(clippy::unwrap_used, reason = "a test may fail by panic")]

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// A Chromium that is installed. Without one, see [`installed`](crate::installed).
pub fn chromium() -> Option<String> {
    let calls = ["chromium", "chromium-browser", "google-chrome"].map(|name| [name, "--version"]);
    crate::installed("Chromium", &calls.each_ref().map(|call| &call[..]))
}

/// The options of all calls: WebGL without a graphics card, and no connection of its own.
pub const OPTIONS: [&str; 10] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
];

/// A browser that runs.
#[derive(Debug)]
pub struct Browser {
    process: Child,
    commands: File,
    answers: BufReader<File>,
    calls: u64,
    _profile: tempfile::TempDir,
}

/// A page that is open in a browser.
#[derive(Clone, Debug)]
pub struct Page(String);

impl Browser {
    /// Starts a browser.
    ///
    /// # Panics
    /// If it cannot be started.
    pub fn start(program: &str) -> Self {
        let profile = tempfile::tempdir().unwrap();
        let [input, output] = ["in", "out"].map(|name| profile.path().join(name));
        assert!(Command::new("mkfifo").args([&input, &output]).status().unwrap().success());
        // The protocol uses the files 3 and 4.
        let process = Command::new("sh")
            .args(["-c", r#"exec "$0" "$@" 3<"$FROM" 4>"$TO""#, program])
            .args(OPTIONS)
            .args(["--remote-debugging-pipe", "--window-size=900,900"])
            .arg(format!("--user-data-dir={}", profile.path().join("profile").display()))
            .env("FROM", &input)
            .env("TO", &output)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let commands = OpenOptions::new().write(true).open(&input).unwrap();
        let answers = BufReader::new(File::open(&output).unwrap());
        Browser { process, commands, answers, calls: 0, _profile: profile }
    }

    fn call(&mut self, method: &str, params: &Value, page: Option<&Page>) -> Value {
        self.calls += 1;
        let mut message = json!({"id": self.calls, "method": method, "params": params});
        if let Some(Page(session)) = page {
            message["sessionId"] = json!(session);
        }
        self.commands.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let mut bytes = Vec::new();
            self.answers.read_until(0, &mut bytes).unwrap();
            assert_eq!(bytes.pop(), Some(0), "the browser has ended");
            let answer: Value = serde_json::from_slice(&bytes).unwrap();
            // All else is news.
            if answer["id"] == self.calls {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// Opens a page.
    pub fn open(&mut self, url: &str) -> Page {
        let target = self.call("Target.createTarget", &json!({ "url": url }), None);
        let attach = json!({"targetId": target["targetId"], "flatten": true});
        let session = self.call("Target.attachToTarget", &attach, None);
        Page(session["sessionId"].as_str().unwrap().to_owned())
    }

    /// The value of an expression in JavaScript.
    ///
    /// # Panics
    /// If it throws.
    pub fn value(&mut self, page: &Page, expression: &str) -> Value {
        let call = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let result = self.call("Runtime.evaluate", &call, Some(page));
        assert!(result["exceptionDetails"].is_null(), "{expression}: {result}");
        result["result"]["value"].clone()
    }

    /// Waits until an expression in JavaScript is true.
    ///
    /// # Panics
    /// If it is not within two minutes.
    pub fn wait(&mut self, page: &Page, expression: &str) {
        let start = Instant::now();
        // A page that is being loaded has none of its elements yet.
        let safe = format!("(() => {{ try {{ return {expression} }} catch {{ return null }} }})()");
        while self.value(page, &safe) != json!(true) {
            if start.elapsed() > Duration::from_secs(120) {
                let text = self.value(page, "document.body.innerText");
                panic!("not within two minutes: {expression}; the page: {text}");
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.commands.write_all(b"{\"id\":0,\"method\":\"Browser.close\"}\0");
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(5) {
            if let Ok(Some(_)) = self.process.try_wait() {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
