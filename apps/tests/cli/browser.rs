//! The page of `view` in a real browser: it shows pictures, they follow the hand, nobody else is asked for anything.
//!
//! Screenshots are left in `target/screenshots` for people to look at.

use crate::chromium::{Chromium, program};
use crate::tools::{SMALL, error_line, nerf, text};
use crate::view::trained;
use crate::viewing::Viewer;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Where screenshots go: beside the programs.
fn screenshots() -> PathBuf {
    let program = crate::tools::program().get_program().to_owned();
    let folder = Path::new(&program).ancestors().nth(2).unwrap().join("screenshots");
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// A browser, or a loud line.
fn browser(test: &str) -> Option<Chromium> {
    match program() {
        Some(program) => Some(Chromium::start(&program)),
        None => {
            testkit::golden::skipped(test, "no Chromium is installed (Debian: apt-get install chromium)");
            None
        }
    }
}

/// A number that differs where pixels do.
const PIXELS: &str = "(() => { let h = 0; const text = document.getElementById('view').toDataURL();
    for (let i = 0; i < text.length; i++) h = (h * 31 + text.charCodeAt(i)) | 0; return h; })()";

/// A sharp picture is there.
const SHARP: &str = "document.body.dataset.quality === '2'";

/// Drag over the picture, wait for a sharp one, and say what is on the canvas.
fn after_drag(browser: &mut Chromium, from: (f64, f64), to: (f64, f64)) -> Value {
    let before = browser.value("Number(document.body.dataset.pictures)").as_u64().unwrap();
    browser.drag(from, to, 8);
    browser.wait(&format!("Number(document.body.dataset.pictures) > {before} && {SHARP}"));
    browser.value(PIXELS)
}

#[test]
fn the_page_shows_pictures_that_follow_the_hand() {
    let Some(mut browser) = browser("the_page_shows_pictures_that_follow_the_hand") else { return };
    let (_folder, run) = trained("60");
    let viewer = Viewer::start("nerf-static", &run);
    browser.look((1000, 700), 1.0, "dark");
    browser.open(&format!("http://{}/", viewer.address));
    browser.wait(SHARP);
    let first = browser.value(PIXELS);
    browser.screenshot(&screenshots().join("desktop-dark.png"));
    let turned = after_drag(&mut browser, (300.0, 300.0), (420.0, 340.0));
    assert_ne!(turned, first, "a drag turns the scene");
    browser.screenshot(&screenshots().join("desktop-turned.png"));
    assert_eq!(browser.value("document.getElementById('photo').value"), "", "we have left the photo");

    // Back, by key: the same pixels.
    let key = |kind: &str| serde_json::json!({ "type": kind, "code": "KeyR", "key": "r" });
    let before = browser.value("Number(document.body.dataset.pictures)");
    browser.call("Input.dispatchKeyEvent", key("keyDown"));
    browser.call("Input.dispatchKeyEvent", key("keyUp"));
    browser.wait(&format!("Number(document.body.dataset.pictures) > {before} && {SHARP}"));
    assert_eq!(browser.value(PIXELS), first);

    // Every layer has its button, and shows something else.
    let layers = browser.value("[...document.getElementById('layer').children].map((b) => b.value)");
    assert_eq!(layers, serde_json::json!(["colour", "depth", "normals", "opacity", "photo"]));
    for layer in ["depth", "photo", "colour"] {
        let before = browser.value("Number(document.body.dataset.pictures)");
        browser.value(&format!("document.querySelector('#layer [value={layer}]').click()"));
        browser.wait(&format!("Number(document.body.dataset.pictures) > {before} && {SHARP}"));
        assert_eq!(browser.value(PIXELS) == first, layer == "colour", "{layer}");
    }
    browser.value("document.getElementById('next').click()");
    browser.wait("document.getElementById('photo').value === '1'");

    for (name, size, scale, scheme) in [
        ("desktop-light", (1280, 800), 1.0, "light"),
        ("phone-dark", (390, 844), 2.0, "dark"),
        ("phone-light", (390, 844), 2.0, "light"),
    ] {
        browser.look(size, scale, scheme);
        browser.open(&format!("http://{}/", viewer.address));
        browser.wait(SHARP);
        assert_eq!(browser.value("document.documentElement.scrollWidth <= innerWidth"), true, "{name} fits");
        if size.0 < 600 {
            browser.screenshot(&screenshots().join(format!("{name}-closed.png")));
            let before = browser.value("Number(document.body.dataset.pictures)");
            browser.value("document.getElementById('toggle').click()");
            browser.wait(&format!("Number(document.body.dataset.pictures) > {before} && {SHARP}"));
        }
        browser.screenshot(&screenshots().join(format!("{name}.png")));
    }
    let complaints = browser.complaints();
    assert!(complaints.is_empty(), "{complaints:#?}");
    let (page, live) = (format!("http://{}/", viewer.address), format!("ws://{}/live", viewer.address));
    let requests = browser.requests();
    assert!(requests.contains(&page) && requests.contains(&live), "{requests:?}");
    let strange: Vec<&String> = requests
        .iter()
        .filter(|url| **url != page && **url != live && *url != "about:blank" && !url.starts_with("data:"))
        .collect();
    assert!(strange.is_empty(), "{strange:?}");
}

#[test]
fn the_page_waits_for_a_training_and_keeps_the_camera_through_checkpoints() {
    let Some(mut browser) = browser("the_page_waits_for_a_training_and_keeps_the_camera_through_checkpoints") else {
        return;
    };
    let (folder, scene) = crate::tools::dataset();
    let run = folder.path().join("run");
    fs::create_dir(&run).unwrap();
    let viewer = Viewer::start("nerf-static", &run);
    browser.look((1000, 700), 1.0, "dark");
    browser.open(&format!("http://{}/", viewer.address));
    browser.wait("document.getElementById('notice-text').textContent.includes('no checkpoint yet')");
    browser.screenshot(&screenshots().join("waiting.png"));

    let words = ["train", "--out", text(&run), "--progress", "off", "--steps"];
    let answer = nerf(&[&words[..], &["20", text(&scene)], &SMALL].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    browser.wait(&format!("document.body.dataset.step === '20' && {SHARP}"));
    let turned = after_drag(&mut browser, (300.0, 300.0), (420.0, 340.0));
    let answer = nerf(&[&words[..], &["60", "--resume"]].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    browser.wait("document.body.dataset.step === '60'");
    browser.wait(&format!("{SHARP} && {PIXELS} !== {turned}"));
    assert_eq!(browser.value("document.getElementById('photo').value"), "", "the camera stays where it was turned to");
    browser.wait("document.getElementById('training-facts').textContent.includes('step 60 of 60')");
    browser.screenshot(&screenshots().join("trained.png"));

    // The program ends: the page says so, and does not pretend.
    drop(viewer);
    browser.wait("document.getElementById('notice-text').textContent.includes('connection is lost')");
    browser.screenshot(&screenshots().join("lost.png"));
    let answer = nerf(&["view", text(&scene)]);
    assert!(answer.code == 1 && error_line(&answer).contains("not a run folder"), "{}", answer.err);
}

/// Three times what a client may be silent, on a page that does nothing and then on one that is frozen like a tab in the back.
#[test]
fn a_page_that_does_nothing_keeps_its_place() {
    let Some(mut browser) = browser("a_page_that_does_nothing_keeps_its_place") else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cloud.ply");
    crate::view::write_cloud(&file);
    let viewer = Viewer::start_with("nerf-static", &file, &["--patience", "3"]);
    browser.look((400, 300), 1.0, "dark");
    browser.open(&format!("http://{}/", viewer.address));
    browser.wait(SHARP);
    // A page that connects again asks for a picture again.
    let pictures = browser.value("document.body.dataset.pictures");
    std::thread::sleep(Duration::from_secs(9));
    assert_eq!(browser.value("document.body.dataset.pictures"), pictures);
    let state = |state: &str| serde_json::json!({ "state": state });
    browser.call("Page.setWebLifecycleState", state("frozen"));
    std::thread::sleep(Duration::from_secs(9));
    browser.call("Page.setWebLifecycleState", state("active"));
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(browser.value("document.body.dataset.pictures"), pictures);
}
