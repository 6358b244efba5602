//! The commands that talk to a server, with one of their own.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "support/commands.rs"]
mod commands;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::thread;
use std::time::Duration;

use commands::{Server, run, steadymesh};
use reqwest::Method;

/// A server with the default settings.
fn start() -> Server {
    Server::start_with(&[])
}

fn stream_url(server: &Server, stream: &str) -> String {
    format!("http://{}/v1/streams/{stream}", server.address)
}

/// A command that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A tetrahedron as a frame file, in a folder that the build owns.
fn frame(test: &str) -> String {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{test}.obj"));
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    std::fs::write(&path, text).unwrap();
    path.display().to_string()
}

#[test]
fn subscribe_ends_quietly_when_its_reader_has_read_enough() {
    let (server, file) = (start(), frame("pipe"));
    let url = stream_url(&server, "pipe");
    assert!(run(&format!("publish {url} {file}")).status.success());
    let endless = steadymesh(&format!("publish {url} {file} --loop --fps 50"))
        .stderr(Stdio::null())
        .spawn();
    let _publisher = Running(endless.unwrap());
    let mut subscriber = steadymesh(&format!("subscribe {url}"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    // As `head -1`: reads a line and closes the pipe.
    BufReader::new(subscriber.stdout.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    assert!(line.starts_with("{\"seq\":"), "{line}");
    let ended = subscriber.wait_with_output().unwrap();
    assert_eq!((ended.status.code(), said(&ended).as_str()), (Some(0), ""));
}

#[test]
fn a_second_publisher_is_refused_at_once_unless_it_takes_over() {
    let (server, file) = (start(), frame("takeover"));
    let publish = format!("publish {} {file}", stream_url(&server, "takeover"));
    let mut first = steadymesh(&format!("{publish} --transport ws --loop"))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let subscribe = format!("subscribe {} --frames 1", stream_url(&server, "takeover"));
    // The stream begins with the first publisher.
    while !run(&subscribe).status.success() {}
    for transport in ["ws", "http"] {
        let refused = run(&format!("{publish} --transport {transport}"));
        assert_eq!(refused.status.code(), Some(1));
        let reason = said(&refused);
        assert!(
            reason.contains("another publisher is connected"),
            "{reason}"
        );
        assert!(reason.contains("--takeover"), "{reason}");
    }
    assert!(first.try_wait().unwrap().is_none());
    let second = run(&format!("{publish} --transport ws --takeover"));
    assert!(second.status.success(), "{}", said(&second));
    let first = first.wait_with_output().unwrap();
    assert_eq!(first.status.code(), Some(1));
    assert!(said(&first).contains("another publisher has taken over"));
    let by_post = run(&format!("{publish} --transport http --takeover"));
    assert!(by_post.status.success(), "{}", said(&by_post));
}

/// Passes connections on to `server`, and cuts the first one once it has carried `bytes` to it.
fn breaking_proxy(server: &str, bytes: usize) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let server = server.to_owned();
    thread::spawn(move || {
        for (index, client) in listener.incoming().enumerate() {
            let (mut client, mut upstream) =
                (client.unwrap(), TcpStream::connect(&server).unwrap());
            let mut answers = (upstream.try_clone().unwrap(), client.try_clone().unwrap());
            thread::spawn(move || std::io::copy(&mut answers.0, &mut answers.1).ok());
            let most = if index == 0 { bytes } else { usize::MAX };
            let mut carried = 0;
            let mut buffer = [0; 256];
            while carried < most {
                match client.read(&mut buffer) {
                    Ok(count @ 1..) if upstream.write_all(&buffer[..count]).is_ok() => {
                        carried += count;
                    }
                    _ => break,
                }
            }
            client.shutdown(Shutdown::Both).ok();
            upstream.shutdown(Shutdown::Both).ok();
        }
    });
    address
}

#[test]
fn a_publisher_whose_connection_breaks_comes_back_and_loses_nothing() {
    let (server, file) = (start(), frame("breaking"));
    let proxy = breaking_proxy(&server.address, 2000);
    let files = [file.as_str()].repeat(40).join(" ");
    let url = format!("http://{proxy}/v1/streams/breaking");
    let done = run(&format!("publish {url} {files} --transport ws --fps 200"));
    assert!(done.status.success(), "{}", said(&done));
    assert!(said(&done).contains("40 frames sent"), "{}", said(&done));
}

#[test]
fn publish_says_that_it_computes_synthetic_frames_before_it_sends_them() {
    let server = start();
    let url = stream_url(&server, "synthetic");
    // A quarter of a frame a second in a loop of four seconds is one frame.
    let done = run(&format!(
        "publish {url} --synthetic --vertices 1000 --fps 0.25"
    ));
    assert!(done.status.success(), "{}", said(&done));
    let first = said(&done).lines().next().unwrap_or_default().to_owned();
    assert_eq!(
        first,
        "computing 1 synthetic frame of about 1000 vertices, then sending begins"
    );
}

#[test]
fn publish_finds_out_that_there_is_no_server_before_it_computes() {
    let nobody = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = nobody.local_addr().unwrap();
    drop(nobody);
    let failed = run(&format!("publish http://{address}/demo --synthetic"));
    assert_eq!(failed.status.code(), Some(1));
    let reason = said(&failed);
    assert!(!reason.contains("computing"), "{reason}");
    assert!(
        reason.starts_with(&format!("error: http://{address} cannot be reached: ")),
        "{reason}"
    );
}

/// The body of a request that succeeds.
fn request(method: Method, url: &str) -> Option<Vec<u8>> {
    steadymesh::tls::set_up();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build();
    runtime.unwrap().block_on(async {
        let request = reqwest::Client::new().request(method, url);
        let answer = request.send().await.unwrap();
        let is_good = answer.status().is_success();
        let body = answer.bytes().await.unwrap().to_vec();
        is_good.then_some(body)
    })
}

/// Every frame's Draco bytes, as `subscribe` wrote them.
fn received(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = std::fs::read_dir(folder).unwrap().map(Result::unwrap);
    files
        .filter(|file| file.path().extension().is_some_and(|end| end == "drc"))
        .map(|file| {
            let name = file.file_name().into_string().unwrap();
            (name, std::fs::read(file.path()).unwrap())
        })
        .collect()
}

#[test]
fn a_recording_that_is_replayed_gives_the_same_bytes_again() {
    let folder = tempfile::tempdir().unwrap();
    let recordings = folder.path().join("recordings");
    let url = format!("file://{}", recordings.display());
    let server = Server::start_with(&[
        ("STEADYMESH_RECORDINGS__URL", &url),
        ("STEADYMESH_STREAMS__DEFAULTS__TARGET_FACES", "300"),
        ("STEADYMESH_STREAMS__DEFAULTS__RECORD", "both"),
    ]);
    let rig = "--synthetic --vertices 1000 --fps 2 --transport ws";
    let stream = stream_url(&server, "demo");
    assert!(run(&format!("publish {stream} {rig}")).status.success());
    // The last of them.
    while request(Method::GET, &format!("{stream}/frames/7.drc")).is_none() {
        thread::sleep(Duration::from_millis(50));
    }
    request(Method::DELETE, &stream).unwrap();
    let id = loop {
        let streams = std::fs::read_dir(recordings.join("demo"));
        let found = streams.into_iter().flatten().next();
        let manifest = found.map(|entry| entry.unwrap().path().join("recording.json"));
        let text = manifest.map(|path| (std::fs::read_to_string(&path), path));
        if let Some((Ok(text), path)) = text
            && text.contains("\"end\"")
        {
            let id = path.parent().unwrap().file_name().unwrap().to_owned();
            break id.into_string().unwrap();
        }
        thread::sleep(Duration::from_millis(50));
    };
    let recording = format!("http://{}/v1/recordings/demo/{id}", server.address);
    let played = folder.path().join("played");
    let done = run(&format!(
        "subscribe {recording} --output {}",
        played.display()
    ));
    assert!(done.status.success(), "{}", said(&done));
    let first = received(&played);
    assert_eq!(first.len(), 8);
    for (name, place) in [
        ("by-server", recording.clone()),
        (
            "by-folder",
            recordings.join("demo").join(&id).display().to_string(),
        ),
    ] {
        let (again, output) = (stream_url(&server, name), folder.path().join(name));
        let done = run(&format!("replay {place} {again} --same-settings --speed 0"));
        assert!(done.status.success(), "{}", said(&done));
        assert!(said(&done).contains("8 frames sent"), "{}", said(&done));
        std::fs::create_dir(&output).unwrap();
        for file in first.keys() {
            let seq: u64 = file.trim_end_matches(".drc").parse().unwrap();
            let frame = loop {
                // The last ones may not be out yet.
                if let Some(frame) = request(Method::GET, &format!("{again}/frames/{seq}.drc")) {
                    break frame;
                }
                thread::sleep(Duration::from_millis(50));
            };
            std::fs::write(output.join(file), frame).unwrap();
        }
        assert_eq!(received(&output), first, "{name}");
    }
}
