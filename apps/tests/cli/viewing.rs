//! A viewer that runs, and a page's side of the talk with it.

use crate::tools::prepared;
use serde_json::{Value, json};
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};

/// Nothing a test waits for takes so long.
const PATIENCE: Duration = Duration::from_secs(60);

/// A running `view`; ends with this value.
pub(crate) struct Viewer {
    child: Child,
    errors: NamedTempFile,
    /// `127.0.0.1:PORT`.
    pub(crate) address: String,
}

impl Viewer {
    /// Start `PROGRAM view WHAT` and wait until it says where. Clients here answer pings only while they read: it is patient.
    pub(crate) fn start(program: &str, what: &Path) -> Self {
        Self::start_with(program, what, &["--patience", "600"])
    }

    /// As [`Viewer::start`], with more words.
    pub(crate) fn start_with(program: &str, what: &Path, more: &[&str]) -> Self {
        let errors = NamedTempFile::new().unwrap();
        let mut child = std::process::Command::new(prepared(program).get_program())
            .args(["view", what.to_str().unwrap(), "--threads", "2", "--progress", "off"])
            .args(more)
            .stdout(Stdio::piped())
            .stderr(Stdio::from(File::create(errors.path()).unwrap()))
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.strip_prefix("http://").and_then(|rest| rest.split_once('/')).map(|(a, _)| a.to_string());
        let said = std::fs::read_to_string(errors.path()).unwrap();
        let address = address.unwrap_or_else(|| panic!("no address: {line}{said}"));
        Self { child, errors, address }
    }

    /// Its process.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// What it said on standard error.
    pub(crate) fn said(&self) -> String {
        std::fs::read_to_string(self.errors.path()).unwrap()
    }

    /// Answer to a plain request; `headers` end with a line break each.
    pub(crate) fn http(&self, request: &str, headers: &str) -> String {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        write!(stream, "{request} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    /// Connect as the page does, from a page of `origin`.
    pub(crate) fn try_connect(&self, origin: Option<&str>) -> Result<Live, String> {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut request = format!("ws://{}/live", self.address).into_client_request().unwrap();
        if let Some(origin) = origin {
            request.headers_mut().insert("Origin", HeaderValue::from_str(origin).unwrap());
        }
        match tungstenite::client(request, stream) {
            Ok((socket, _)) => Ok(Live { socket, id: 0, training: Value::Null }),
            Err(e) => Err(e.to_string()),
        }
    }

    pub(crate) fn connect(&self) -> Live {
        self.try_connect(Some(&format!("http://{}", self.address))).unwrap()
    }

    /// Ctrl-C; the exit code.
    pub(crate) fn interrupt(&mut self) -> Option<i32> {
        let id = self.child.id().to_string();
        assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        let since = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code();
            }
            assert!(since.elapsed() < PATIENCE, "it does not end");
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let said = std::fs::read_to_string(self.errors.path()).unwrap_or_default();
        if !std::thread::panicking() {
            assert!(!said.contains("panicked"), "{said}");
        }
    }
}

/// A picture that came.
pub(crate) struct Picture {
    pub(crate) id: u32,
    pub(crate) step: u32,
    /// 0 in time, 1 better, 2 as good as asked for.
    pub(crate) quality: u8,
    /// 0 the scene itself, 1 the cloud that stands for it, 2 both.
    pub(crate) drawer: u8,
    pub(crate) file: Vec<u8>,
    pub(crate) pixels: image::RgbImage,
}

/// A connection.
pub(crate) struct Live {
    socket: WebSocket<TcpStream>,
    id: u32,
    /// The newest word about the training.
    pub(crate) training: Value,
}

impl Live {
    pub(crate) fn say(&mut self, text: impl Into<String>) {
        self.socket.send(Message::text(text.into())).unwrap();
    }

    pub(crate) fn say_bytes(&mut self, bytes: Vec<u8>) {
        self.socket.send(Message::binary(bytes)).unwrap();
    }

    /// Read and answer pings for a while; false when the connection ends.
    pub(crate) fn idle(&mut self, a_while: Duration) -> bool {
        let since = Instant::now();
        self.socket.get_ref().set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        while since.elapsed() < a_while {
            match self.socket.read() {
                Ok(_) => {}
                Err(tungstenite::Error::Io(e)) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(_) => return false,
            }
        }
        self.socket.get_ref().set_read_timeout(Some(PATIENCE)).unwrap();
        true
    }

    /// The next text of a kind; pictures and other words are passed over.
    pub(crate) fn hear(&mut self, kind: &str) -> Value {
        let since = Instant::now();
        loop {
            assert!(since.elapsed() < PATIENCE, "no word `{kind}`");
            if let Message::Text(text) = self.socket.read().unwrap() {
                let word: Value = serde_json::from_str(&text).unwrap();
                if word["type"] == "training" {
                    self.training = word.clone();
                }
                if word["type"] == kind {
                    return word;
                }
            }
        }
    }

    /// The next picture.
    pub(crate) fn see(&mut self) -> Picture {
        let since = Instant::now();
        loop {
            assert!(since.elapsed() < PATIENCE, "no picture");
            match self.socket.read().unwrap() {
                Message::Binary(bytes) => {
                    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
                    let file = bytes[28..].to_vec();
                    let pixels = image::load_from_memory(&file).unwrap().into_rgb8();
                    let size = [20, 22].map(|at| u32::from(u16::from_le_bytes([bytes[at], bytes[at + 1]])));
                    assert_eq!(<[u32; 2]>::from(pixels.dimensions()), size);
                    return Picture {
                        id: number(0),
                        step: number(4),
                        quality: bytes[24],
                        drawer: bytes[25],
                        file,
                        pixels,
                    };
                }
                Message::Text(text) => {
                    let word: Value = serde_json::from_str(&text).unwrap();
                    assert_ne!(word["type"], "error", "{word}");
                    if word["type"] == "training" {
                        self.training = word;
                    }
                }
                Message::Ping(_) | Message::Pong(_) => {}
                other => panic!("{other:?}"),
            }
        }
    }

    /// Ask for a picture from a photo's camera, with more words; its number.
    pub(crate) fn ask(&mut self, photo: &Value, more: Value) -> u32 {
        self.id += 1;
        let fov = 2.0 * photo["tangents"][1].as_f64().unwrap().atan();
        let mut wish = json!({
            "type": "draw", "id": self.id, "width": 60, "height": 60, "position": photo["position"],
            "wxyz": photo["wxyz"], "fov": fov, "layer": "colour", "limit": 60,
        });
        for (key, value) in more.as_object().unwrap() {
            wish[key] = value.clone();
        }
        self.say(wish.to_string());
        self.id
    }

    /// The best picture of a wish.
    pub(crate) fn best(&mut self, id: u32) -> Picture {
        loop {
            let picture = self.see();
            if picture.id == id && picture.quality == 2 {
                return picture;
            }
        }
    }
}
