//! Requests that are half, double, foreign or false.

use super::*;
use crate::tools::{error_line, nerf, text};

#[test]
fn half_requests_are_closed_and_do_not_keep_others_out() {
    let (_folder, _, viewer) = viewer("2");
    let halves = [
        "",
        "G",
        "GET / HTTP/1.1\r\nHost: 127.0.0.1",
        &UPGRADE[..UPGRADE.len() - 2],
        "POST / HTTP/1.1\r\nHost: HOST\r\nContent-Length: 1000\r\n\r\nhalf",
        "POST / HTTP/1.1\r\nHost: HOST\r\nTransfer-Encoding: chunked\r\n\r\nffff\r\nhalf",
    ];
    let half = |i: usize| sent(&viewer, halves[i % halves.len()].replace("HOST", &viewer.address));
    let mut open: Vec<TcpStream> = (0..500).map(half).collect();
    // While they are open.
    let since = Instant::now();
    let page = viewer.http("GET /", &format!("Host: {}\r\n", viewer.address));
    assert!(page.starts_with("HTTP/1.1 200"), "{page}");
    assert!(since.elapsed() < Duration::from_secs(10));
    if let Ok(files) = std::fs::read_dir(format!("/proc/{}/fd", viewer.id())) {
        let files = files.count();
        assert!(files < 120, "{files} files are open");
    }
    for stream in &mut open {
        until_closed(stream);
    }
    assert!(since.elapsed() < Duration::from_secs(30), "{:?}", since.elapsed());
}

#[test]
fn a_request_that_trickles_is_closed() {
    let (_folder, _, viewer) = viewer("2");
    for start in ["GET / HTTP/1.1\r\nX: ", "GET /live HTTP/1.1\r\nUpgrade: websocket\r\nX: "] {
        let mut stream = sent(&viewer, start);
        let since = Instant::now();
        while stream.write_all(b"x").is_ok() {
            assert!(since.elapsed() < Duration::from_secs(30), "{start} still open");
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

#[test]
fn requests_that_say_two_things_are_refused() {
    let (_folder, _, viewer) = viewer("600");
    let ours = "Origin: http://HOST\r\n";
    let with = |more: &str| UPGRADE.replacen("\r\n\r\n", &format!("\r\n{more}\r\n"), 1);
    let evil = "Origin: http://evil.example\r\n";
    for (request, part) in [
        (with(&format!("{ours}{evil}")), "400: the header `origin` came more than once"),
        (with(&format!("{evil}{ours}")), "400: the header `origin` came more than once"),
        (with(&format!("{ours}{ours}")), "400: the header `origin` came more than once"),
        (with("Host: evil.example\r\n"), "400: the header `host` came more than once"),
        (with("Host: HOST\r\n"), "400: the header `host` came more than once"),
        (with("Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"), "400: the header `sec-websocket-key`"),
        (with("Sec-WebSocket-Version: 8\r\n"), "400: the header `sec-websocket-version`"),
        (with("Upgrade: h2c\r\n"), "400: the header `upgrade`"),
        (with(evil), "403: this viewer talks to its own page only"),
        (with("Origin: null\r\n"), "403: this viewer talks to its own page only"),
        (with("Origin:\r\n"), "403: this viewer talks to its own page only"),
        (with("Origin: http://HOST/\r\n"), "403: this viewer talks to its own page only"),
        (with("Origin: http://HOST, http://evil.example\r\n"), "403: this viewer talks to its own page only"),
        (with(ours).replace("/live", "http://evil.example/live"), "403: this viewer does not answer to that name"),
        (with(ours).replace("Host: HOST", "Host: evil.example"), "403: this viewer does not answer to that name"),
        (with("").replace("Host: HOST\r\n", ""), "403: this viewer does not answer to that name"),
        ("GET / HTTP/1.0\r\n\r\n".into(), "403: this viewer does not answer to that name"),
        ("CONNECT evil.example:80 HTTP/1.1\r\nHost: HOST\r\n\r\n".into(), "403: "),
        ("GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: 4\r\n\r\nbody".into(), "413: requests with a body"),
    ] {
        let answer = answer(&viewer, &request);
        assert!(answer.contains(part) && answer.starts_with("HTTP/1."), "{request}: {answer}");
        assert!(!answer.contains("<!doctype"), "{request}");
        // Refusals, too, say what a browser may do with them.
        for header in ["nosniff", "frame-ancestors 'none'", "connect-src 'none'", "x-frame-options: DENY"] {
            assert!(answer.contains(header), "{header}: {answer}");
        }
    }
    // One byte too much or too little in the handshake, and it is none.
    for (from, to) in [
        ("Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n", ""),
        ("Sec-WebSocket-Version: 13", "Sec-WebSocket-Version: 12"),
        ("Upgrade: websocket\r\n", ""),
        ("Connection: Upgrade", "Connection: close"),
        ("GET", "POST"),
    ] {
        let answer = answer(&viewer, &UPGRADE.replace(from, to));
        assert!(answer.starts_with("HTTP/1.1 4"), "{to}: {answer}");
    }
    assert!(viewer.http("GET /", &format!("Host: {0}\r\nOrigin: http://{0}\r\n", viewer.address)).contains(" 200 "));
}

#[test]
fn nothing_is_smuggled_behind_a_request() {
    let (_folder, _, viewer) = viewer("600");
    let hidden = "GET / HTTP/1.1\r\nHost: HOST\r\n\r\n";
    let head = "POST / HTTP/1.1\r\nHost: HOST\r\n";
    for request in [
        format!("{head}Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n{hidden}"),
        format!("{head}Transfer-Encoding: chunked\r\nContent-Length: 4\r\n\r\n0\r\n\r\n{hidden}"),
        format!("{head}Transfer-Encoding: chunked, identity\r\n\r\n0\r\n\r\n{hidden}"),
        format!("{head}Transfer-Encoding: xchunked\r\n\r\n0\r\n\r\n{hidden}"),
        format!("{head}Content-Length: 0\r\nContent-Length: 5\r\n\r\n{hidden}"),
        format!("{head}Content-Length: 5, 5\r\n\r\nabcde{hidden}"),
        format!("{head}Content-Length: -1\r\n\r\n{hidden}"),
        format!("{head}Content-Length : 5\r\n\r\nabcde{hidden}"),
        format!("{head}X: a\r\n folded\r\n\r\n{hidden}"),
        format!("{head}\r\n{hidden}"),
    ] {
        let answer = answer(&viewer, &request);
        assert!(!answer.contains("<!doctype") && answer.matches("HTTP/1.1 ").count() <= 1, "{request}: {answer}");
    }
    // One request a connection, also of good ones.
    let answer = answer(&viewer, &hidden.repeat(3));
    assert!(answer.matches("HTTP/1.1 200").count() == 1, "{answer}");
}

#[test]
fn large_heads_and_rubbish_are_refused() {
    let (_folder, _, viewer) = viewer("600");
    for request in [
        format!("GET /{} HTTP/1.1\r\nHost: HOST\r\n\r\n", "a".repeat(100_000)),
        format!("GET / HTTP/1.1\r\nHost: HOST\r\nX: {}\r\n\r\n", "a".repeat(100_000)),
        format!("GET / HTTP/1.1\r\nHost: HOST\r\n{}\r\n", "X: a\r\n".repeat(200)),
        "\u{0}\u{1}\r\n\r\n".repeat(100),
        "GET / HTTP/9.9\r\nHost: HOST\r\n\r\n".into(),
        "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".into(),
    ] {
        // The answer may be lost where more was sent than was read.
        let mut stream = TcpStream::connect(&viewer.address).unwrap();
        stream.set_read_timeout(Some(LONG)).unwrap();
        let _ = stream.write_all(request.replace("HOST", &viewer.address).as_bytes());
        let answer = String::from_utf8_lossy(&until_closed(&mut stream)).into_owned();
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 4"), "{answer}");
    }
    assert!(viewer.http("GET /", &format!("Host: {}\r\n", viewer.address)).contains(" 200 "));
}

#[test]
fn a_port_that_is_taken_is_one_line() {
    let (_folder, file, viewer) = viewer("600");
    let port = viewer.address.rsplit_once(':').unwrap().1;
    let answer = nerf(&["view", text(&file), "--port", port]);
    let line = error_line(&answer);
    assert!(answer.code == 1 && line.contains("`--port ") && line.contains(port), "{}", answer.err);
}

#[test]
fn a_viewer_for_everybody_says_what_that_opens() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cloud.ply");
    write_cloud(&file);
    let viewer = Viewer::start_with("nerf-static", &file, &["--host", "0.0.0.0"]);
    let said = viewer.said();
    let warnings: Vec<&str> = said.lines().filter(|line| line.contains("warning")).collect();
    assert!(
        warnings.len() == 1 && warnings[0].contains("`--host 0.0.0.0`") && warnings[0].contains("password"),
        "{said}"
    );
    let (_folder, _, local) = self::viewer("600");
    assert!(!local.said().contains("warning"), "{}", local.said());
}
