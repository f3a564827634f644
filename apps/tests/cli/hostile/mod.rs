//! The viewer among clients that mean no good: bytes as they are, without a client's manners.

mod files;
mod floods;
mod requests;
mod seats;

use crate::view::write_cloud;
use crate::viewing::{Live, Viewer};
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Nothing a test waits for takes so long.
const LONG: Duration = Duration::from_secs(60);

/// A viewer of a file of Gaussians that waits `patience` seconds for its clients.
fn viewer(patience: &str) -> (TempDir, PathBuf, Viewer) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cloud.ply");
    write_cloud(&file);
    let viewer = Viewer::start_with("nerf-static", &file, &["--patience", patience]);
    (folder, file, viewer)
}

/// A connection over which `bytes` were sent.
fn sent(viewer: &Viewer, bytes: impl AsRef<[u8]>) -> TcpStream {
    let mut stream = TcpStream::connect(&viewer.address).unwrap();
    stream.set_read_timeout(Some(LONG)).unwrap();
    stream.write_all(bytes.as_ref()).unwrap();
    stream
}

/// All that comes until the other side closes the connection, in whatever way.
fn until_closed(stream: &mut TcpStream) -> Vec<u8> {
    let mut bytes = Vec::new();
    match stream.read_to_end(&mut bytes) {
        Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => panic!("it is not closed: {e}"),
        _ => bytes,
    }
}

/// The answer to a request written as it is; `HOST` stands for the viewer's address.
fn answer(viewer: &Viewer, request: &str) -> String {
    let mut stream = sent(viewer, request.replace("HOST", &viewer.address));
    String::from_utf8_lossy(&until_closed(&mut stream)).into_owned()
}

/// The request that opens a WebSocket.
const UPGRADE: &str = "GET /live HTTP/1.1\r\nHost: HOST\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
                       Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n";

/// The status line of the answer to [`UPGRADE`], and the connection, from which nothing else was read.
fn upgrade(viewer: &Viewer) -> (String, TcpStream) {
    let mut stream = sent(viewer, UPGRADE.replace("HOST", &viewer.address));
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        stream.read_exact(&mut byte).unwrap();
        head.push(byte[0]);
    }
    (String::from_utf8_lossy(&head).lines().next().unwrap_or_default().to_string(), stream)
}

/// An open WebSocket that nobody reads.
fn silent(viewer: &Viewer) -> TcpStream {
    let (status, stream) = upgrade(viewer);
    assert!(status.contains(" 101 "), "{status}");
    stream
}

/// A place for a WebSocket, taken as soon as there is one.
fn seat(viewer: &Viewer) -> TcpStream {
    let since = Instant::now();
    loop {
        let (status, stream) = upgrade(viewer);
        if status.contains(" 101 ") {
            return stream;
        }
        assert!(since.elapsed() < LONG, "no place: {status}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// As [`seat`], for a client with manners.
fn welcome(viewer: &Viewer) -> Live {
    let since = Instant::now();
    loop {
        match viewer.try_connect(None) {
            Ok(live) => return live,
            Err(e) => assert!(since.elapsed() < LONG, "no place: {e}"),
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// First byte of a frame: the last of its message, or not; its kind.
const TEXT: u8 = 0x81;
const TEXT_BEGINS: u8 = 0x01;
const TEXT_GOES_ON: u8 = 0x00;
const PING: u8 = 0x89;

/// A frame of a WebSocket, masked with zeros.
fn frame(first: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![first];
    match payload.len() {
        n @ 0..126 => bytes.push(0x80 | n as u8),
        n @ 126..65536 => {
            bytes.push(0x80 | 126);
            bytes.extend((n as u16).to_be_bytes());
        }
        n => {
            bytes.push(0x80 | 127);
            bytes.extend((n as u64).to_be_bytes());
        }
    }
    bytes.extend([0; 4]);
    bytes.extend(payload);
    bytes
}

/// Send `bytes` again and again and read nothing, until the other side has closed the connection.
fn pour(stream: &mut TcpStream, bytes: &[u8]) {
    let since = Instant::now();
    stream.set_write_timeout(Some(Duration::from_millis(100))).unwrap();
    loop {
        match stream.write(bytes) {
            Ok(_) => {}
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return,
        }
        assert!(since.elapsed() < LONG, "it is not closed");
    }
}

/// A number of `/proc/PID/status`, KiB; `None`, loudly, where there is no such file.
fn memory(viewer: &Viewer, field: &str, test: &str) -> Option<u64> {
    let Ok(status) = std::fs::read_to_string(format!("/proc/{}/status", viewer.id())) else {
        testkit::golden::skipped(test, "there is no /proc/PID/status");
        return None;
    };
    let line = status.lines().find(|line| line.starts_with(field)).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().ok()
}
