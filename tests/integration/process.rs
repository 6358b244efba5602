//! The binary as an operator runs it: with a file, an environment, signals, and its log.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use serde_json::Value;

/// A running server whose log is JSON.
pub struct Process {
    child: Child,
    lines: Receiver<String>,
    seen: Vec<String>,
    /// Where the API is.
    pub api: String,
    file: PathBuf,
    /// What the file begins with.
    head: String,
    _folder: tempfile::TempDir,
}

impl Process {
    /// Starts it with this level of the log, what else is in the file, and the environment.
    pub fn start(level: &str, rest: &str, environment: &[(&str, &str)]) -> Self {
        // For the test's own clients.
        steadymesh::tls::set_up();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("steadymesh.toml");
        let own = "listen = '127.0.0.1:0'\ninternal_listen = '127.0.0.1:0'\n";
        let log = format!("log = {{ level = '{level}', format = 'json' }}\n");
        let head = format!("{own}{log}");
        std::fs::write(&file, format!("{head}{rest}")).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_steadymesh"))
            .arg("serve")
            .arg("--config")
            .arg(&file)
            .envs(environment.iter().copied())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (sender, lines) = channel();
        let log = BufReader::new(child.stderr.take().unwrap());
        std::thread::spawn(move || {
            for line in log.lines().map_while(Result::ok) {
                sender.send(line).ok();
            }
        });
        let mut process = Self {
            child,
            lines,
            seen: Vec::new(),
            api: String::new(),
            file,
            head,
            _folder: folder,
        };
        let line = process.wait_for("player and API on");
        let address = line.split("player and API on ").nth(1).unwrap();
        process.api = address.split(',').next().unwrap().to_owned();
        process
    }

    /// The next line with this text.
    pub fn wait_for(&mut self, text: &str) -> String {
        loop {
            let line = self.lines.recv_timeout(Duration::from_secs(20));
            let line = line.unwrap_or_else(|_| panic!("{text} is not in {:#?}", self.seen));
            self.seen.push(line.clone());
            if line.contains(text) {
                return line;
            }
        }
    }

    pub fn url(&self, path: &str) -> String {
        format!("{}{path}", self.api)
    }

    /// Writes another file, with this beside addresses and the log, and sends SIGHUP.
    pub fn reload(&mut self, rest: &str) {
        std::fs::write(&self.file, format!("{}{rest}", self.head)).unwrap();
        self.signal("-HUP");
    }

    fn signal(&self, signal: &str) {
        let id = self.child.id().to_string();
        let sent = Command::new("kill").args([signal, &id]).status();
        assert!(sent.unwrap().success());
    }

    /// Sends SIGTERM, waits for the end, and returns the log, line by line.
    pub fn stop(mut self) -> Vec<String> {
        self.signal("-TERM");
        assert!(self.child.wait().unwrap().success());
        self.seen.extend(self.lines.iter());
        std::mem::take(&mut self.seen)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // After a test that has failed.
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

/// A line of the log.
pub fn parse(line: &str) -> Value {
    serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))
}

/// The id of the request that a line belongs to.
pub fn request_id(line: &Value) -> Option<&str> {
    let spans = line["spans"].as_array()?;
    spans.iter().find_map(|span| span["request_id"].as_str())
}
