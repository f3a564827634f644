//! Which files a page can have written: one, of a fixed name, beside what is shown.

use super::*;
use serde_json::json;
use std::fs;

#[test]
fn many_crops_are_kept_as_one_and_others_are_drawn_for_meanwhile() {
    let (folder, _, viewer) = viewer("600");
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    let mut savers: Vec<_> = (0..4).map(|_| viewer.connect()).collect();
    for i in 1..=1000 {
        for saver in &mut savers {
            saver.say(json!({ "type": "save", "crop": { "faint": f64::from(i) / 1000.0 } }).to_string());
        }
    }
    let id = live.ask(&scene["photos"][0], json!({}));
    live.best(id);
    let kept = folder.path().join("cloud.ply.crop.json");
    let since = Instant::now();
    loop {
        let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().file_name()).collect();
        let text = fs::read_to_string(&kept).unwrap_or_default();
        if text.contains("\"faint\": 1.0") && names.len() == 2 {
            break;
        }
        assert!(since.elapsed() < LONG, "{names:?}: {text}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(unix)]
#[test]
fn a_crop_does_not_go_where_a_link_points() {
    use std::os::unix::fs::symlink;
    let (folder, _, viewer) = viewer("600");
    let mine = folder.path().join("mine.txt");
    fs::write(&mine, "mine").unwrap();
    for name in ["cloud.ply.crop.json", "cloud.ply.crop.json.tmp"] {
        symlink(&mine, folder.path().join(name)).unwrap();
    }
    let mut live = viewer.connect();
    live.say(json!({ "type": "save", "crop": { "faint": 0.5 } }).to_string());
    assert_eq!(live.hear("saved")["file"], "cloud.ply.crop.json");
    assert_eq!(fs::read_to_string(&mine).unwrap(), "mine");
    let kept = fs::symlink_metadata(folder.path().join("cloud.ply.crop.json")).unwrap();
    assert!(kept.is_file(), "the link is gone, the crop is there");
    for name in ["../x", "/tmp/x", "crop.json/../../x"] {
        live.say(json!({ "type": "save", "crop": {}, "file": name }).to_string());
        assert!(live.hear("error")["message"].as_str().unwrap().contains("unknown field `file`"));
    }
}
