//! Who keeps a place, and who loses it.

use super::*;
use serde_json::json;

#[test]
fn silent_clients_lose_their_places_and_the_ninth_gets_in() {
    let (_folder, _, viewer) = viewer("2");
    let since = Instant::now();
    let mut silent: Vec<TcpStream> = (0..8).map(|_| silent(&viewer)).collect();
    let (status, mut ninth) = upgrade(&viewer);
    assert!(status.contains(" 503 "), "{status}");
    assert!(String::from_utf8_lossy(&until_closed(&mut ninth)).contains("8 pages are open already"));
    for stream in &mut silent {
        until_closed(stream);
    }
    let took = since.elapsed();
    assert!(took >= Duration::from_secs(2) && took < Duration::from_secs(20), "{took:?}");
    welcome(&viewer).hear("scene");
}

#[test]
fn a_client_that_answers_keeps_its_place_however_idle() {
    let (_folder, _, viewer) = viewer("3");
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    assert!(live.idle(Duration::from_secs(8)), "thrown out");
    let id = live.ask(&scene["photos"][0], json!({}));
    live.best(id);
}

#[test]
fn a_client_that_asks_and_does_not_read_loses_its_place() {
    let (_folder, _, viewer) = viewer("2");
    // Every frame is a sign of life, and gets an answer that is not read.
    let nonsense = frame(TEXT, format!(r#"{{"type": "{}"}}"#, "x".repeat(250)).as_bytes()).repeat(200);
    let mut clients: Vec<TcpStream> = (0..8).map(|_| silent(&viewer)).collect();
    std::thread::scope(|scope| clients.iter_mut().for_each(|client| drop(scope.spawn(|| pour(client, &nonsense)))));
    welcome(&viewer).hear("scene");
}

#[test]
fn places_of_clients_that_vanish_are_free_at_once() {
    let (_folder, _, viewer) = viewer("600");
    for _ in 0..5 {
        let clients: Vec<TcpStream> = (0..8).map(|_| seat(&viewer)).collect();
        drop(clients);
    }
    welcome(&viewer).hear("scene");
}

#[test]
fn it_ends_at_once_whoever_hangs_on() {
    let (_folder, _, mut viewer) = viewer("600");
    let half = sent(&viewer, "GET / HTTP/1.1\r\nHost: ");
    let quiet = silent(&viewer);
    let mut busy = silent(&viewer);
    busy.write_all(&frame(TEXT, b"{").repeat(2000)).unwrap();
    let mut fragment = silent(&viewer);
    fragment.write_all(&frame(TEXT_BEGINS, b"{")).unwrap();
    let mut asked = viewer.connect();
    let scene = asked.hear("scene");
    asked.ask(&scene["photos"][0], json!({ "width": 2400, "height": 2400, "limit": 2400 }));
    let since = Instant::now();
    assert_eq!(viewer.interrupt(), Some(0));
    assert!(since.elapsed() < Duration::from_secs(10), "{:?}", since.elapsed());
    drop((half, quiet, busy, fragment, asked));
}
