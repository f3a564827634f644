//! Many messages, and large ones.

use super::*;
use serde_json::json;

/// What the memory of the server may grow by while it is flooded, KiB: pictures, and what waits for clients that do not read.
const ROOM: u64 = 60 << 10;

/// What a picture of the largest size may take while it is drawn, KiB.
const LARGEST: u64 = 600 << 10;

fn wish(id: u32) -> String {
    json!({ "type": "draw", "id": id, "width": 64, "height": 48, "position": [0.5, 0.5, -3.0], "wxyz": [1, 0, 0, 0],
            "fov": 1.0, "layer": "colour", "limit": 64 })
    .to_string()
}

#[test]
fn of_many_wishes_the_newest_is_met() {
    let (_folder, _, viewer) = viewer("600");
    let mut live = viewer.connect();
    live.hear("scene");
    for id in 1..=5000 {
        live.say(wish(id));
    }
    let mut pictures = 0;
    loop {
        let picture = live.see();
        pictures += 1;
        if picture.id == 5000 && picture.quality == 2 {
            break;
        }
    }
    assert!(pictures < 1000, "{pictures} pictures for 5000 wishes");
}

#[test]
fn floods_do_not_grow_memory() {
    const TEST: &str = "floods_do_not_grow_memory";
    let (_folder, _, viewer) = viewer("2");
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    let id = live.ask(&scene["photos"][0], json!({}));
    live.best(id);
    let Some(before) = memory(&viewer, "VmRSS:", TEST) else { return };
    drop(live);
    let floods: [Vec<u8>; 7] = [
        frame(PING, &[7; 125]).repeat(500),
        frame(TEXT, wish(1).as_bytes()).repeat(200),
        frame(TEXT, b"nonsense").repeat(2000),
        // Parts of a message that never ends: empty ones, and some of a byte.
        [frame(TEXT_BEGINS, b"["), frame(TEXT_GOES_ON, b"").repeat(5000)].concat(),
        [frame(TEXT_BEGINS, b"["), frame(TEXT_GOES_ON, b"1").repeat(5000)].concat(),
        // A message as long as it may be, and one that says it is far longer.
        frame(TEXT, &[b' '; 16 << 10]).repeat(20),
        [vec![TEXT, 0x80 | 127], (1_u64 << 62).to_be_bytes().to_vec(), vec![0; 60_000]].concat(),
    ];
    for flood in &floods {
        // They send for a second or until they are thrown out, and read nothing.
        let mut clients: Vec<TcpStream> = (0..8).map(|_| seat(&viewer)).collect();
        std::thread::scope(|scope| {
            for client in &mut clients {
                scope.spawn(|| {
                    let since = Instant::now();
                    client.set_write_timeout(Some(Duration::from_millis(100))).unwrap();
                    while since.elapsed() < Duration::from_secs(1) {
                        match client.write(flood) {
                            Err(e) if !matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => return,
                            _ => {}
                        }
                    }
                });
            }
        });
    }
    let Some(most) = memory(&viewer, "VmHWM:", TEST) else { return };
    println!("{TEST}: {before} KiB before, {most} KiB at most");
    assert!(most < before + ROOM, "{before} KiB before, {most} KiB at most");
    let mut live = welcome(&viewer);
    live.hear("scene");
    let id = live.ask(&scene["photos"][0], json!({}));
    live.best(id);
}

#[test]
fn the_largest_picture_is_that_of_the_page() {
    let (_folder, _, viewer) = viewer("600");
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    let photo = &scene["photos"][0];
    for wrong in [json!({ "limit": 2401 }), json!({ "width": 5000 }), json!({ "height": 4_000_000_000_u32 })] {
        live.ask(photo, wrong);
        let word = live.hear("error");
        assert!(word["message"].as_str().unwrap().contains("write a number from"), "{word}");
    }
    let id = live.ask(photo, json!({ "width": 4096, "height": 1024, "limit": 2400 }));
    assert_eq!(live.best(id).pixels.dimensions(), (2400, 600));
    const TEST: &str = "the_largest_picture_is_that_of_the_page";
    let Some(before) = memory(&viewer, "VmRSS:", TEST) else { return };
    for layer in ["normals", "depth", "colour"] {
        let id = live.ask(photo, json!({ "width": 4096, "height": 4096, "limit": 2400, "layer": layer }));
        assert_eq!(live.best(id).pixels.dimensions(), (2400, 2400));
    }
    let Some(most) = memory(&viewer, "VmHWM:", TEST) else { return };
    println!("{TEST}: {before} KiB before, {most} KiB at most");
    assert!(most < before + LARGEST, "{before} KiB before, {most} KiB at most");
    // Eight pages at a time: such pictures are drawn one after the other.
    let mut pages: Vec<_> = (0..7).map(|_| viewer.connect()).chain([live]).collect();
    let wish = json!({ "width": 2400, "height": 2400, "limit": 2400, "layer": "normals" });
    let ids: Vec<u32> = pages.iter_mut().map(|page| page.ask(photo, wish.clone())).collect();
    for (page, id) in pages.iter_mut().zip(ids) {
        assert_eq!(page.best(id).pixels.dimensions(), (2400, 2400));
    }
    let Some(all) = memory(&viewer, "VmHWM:", TEST) else { return };
    println!("{TEST}: {all} KiB at most for eight pages");
    assert!(all < before + 2 * LARGEST, "{before} KiB before, {all} KiB at most for eight pages");
}
