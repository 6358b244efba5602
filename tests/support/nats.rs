//! A `nats-server` of a test's own, with JetStream in a folder of its own.

#![allow(dead_code, reason = "not every test kills it")]

use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use steadymesh::bus::{Bus, Options};
use tempfile::TempDir;

/// A worker that has not answered for so long is dead.
pub const ACK_WAIT: Duration = Duration::from_millis(700);

/// Runs every test over the bus in memory and over one in NATS.
macro_rules! over_both {
    ($($name:ident)*) => {
        mod in_process {
            use super::*;
            $(#[tokio::test]
            async fn $name() {
                super::$name(Bus::in_process(ACK_WAIT, 1000)).await;
            })*
        }
        mod jet_stream {
            use super::*;
            $(#[tokio::test]
            async fn $name() {
                let nats = Nats::start();
                super::$name(nats.bus().await).await;
            })*
        }
    };
}

/// A running server, which ends with the test.
pub struct Nats {
    process: Child,
    port: u16,
    folder: TempDir,
}

impl Nats {
    /// Starts it; Debian's package is `nats-server`.
    pub fn start() -> Self {
        let port = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
            .port();
        let folder = tempfile::tempdir().unwrap();
        let process = spawn(port, &folder);
        Self {
            process,
            port,
            folder,
        }
    }

    pub fn url(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }

    pub fn options(&self) -> Options {
        Options {
            url: self.url(),
            credentials_file: None,
            prefix: "test".to_owned(),
            replicas: 1,
            ack_wait: ACK_WAIT,
            max_bytes: 64 << 20,
            max_age: Duration::from_secs(60),
        }
    }

    /// A connection to it.
    pub async fn bus(&self) -> Bus {
        Bus::jet_stream(self.options()).await.unwrap()
    }

    /// Ends it without a farewell.
    pub fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// Starts it again where it was.
    pub fn restart(&mut self) {
        self.process = spawn(self.port, &self.folder);
    }

    /// Starts it again without anything that it had.
    pub fn restart_empty(&mut self) {
        self.folder = tempfile::tempdir().unwrap();
        self.restart();
    }
}

impl Drop for Nats {
    fn drop(&mut self) {
        self.process.kill().ok();
        self.process.wait().ok();
    }
}

fn spawn(port: u16, folder: &TempDir) -> Child {
    let mut process = Command::new("nats-server")
        .args(["--addr", "127.0.0.1", "--port", &port.to_string()])
        .args(["--jetstream", "--store_dir"])
        .arg(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("nats-server is installed: scripts/install-dependencies test");
    let began = Instant::now();
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert_eq!(process.try_wait().unwrap(), None, "nats-server runs");
        assert!(
            began.elapsed() < Duration::from_secs(10),
            "nats-server listens"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    process
}
