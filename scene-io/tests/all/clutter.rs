//! Splits by name and list: cluttered and clean photos, Phototourism's tables.

use crate::common::{Dataset, colmap_binary, ngp_json};
use scene_io::{Dialect, Holdout, LoadOptions, Scene, Split, TrainPhotos, load};

fn clean() -> LoadOptions {
    LoadOptions::default().with_train_photos(TrainPhotos::Clean)
}

/// A COLMAP dataset below `below` with 8x6 images of these names.
fn colmap(below: &str, names: &[&str]) -> Dataset {
    let dataset = Dataset::new();
    for name in names {
        dataset.image(&format!("{below}images/{name}"), 8, 6);
    }
    for (file, bytes) in ["cameras", "images", "points3D"].iter().zip(colmap_binary(names)) {
        dataset.write(&format!("{below}sparse/{file}.bin"), bytes);
    }
    dataset
}

fn of(scene: &Scene, split: Split) -> Vec<&str> {
    scene.split(split).map(|i| scene.frames[i].name.as_str()).collect()
}

fn error(dataset: &Dataset, options: &LoadOptions) -> String {
    load(dataset.path(), options).unwrap_err().to_string()
}

const NAMES: [&str; 6] =
    ["1clutter000.png", "1clutter001.png", "0clean000.png", "0clean001.png", "2extra000.png", "other.png"];

#[test]
fn names_tell_cluttered_clean_and_extra_photos_apart() {
    let dataset = colmap("", &NAMES);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!(of(&scene, Split::Train), ["1clutter000.png", "1clutter001.png"]);
    assert_eq!(of(&scene, Split::Test), ["2extra000.png"]);
    assert_eq!(of(&scene, Split::Unused), ["0clean000.png", "0clean001.png", "other.png"]);
    assert!(scene.notes.iter().any(|n| n.contains("2 cluttered, 2 clean and 1 extra photos")), "{:?}", scene.notes);
    let scene = load(dataset.path(), &clean()).unwrap();
    assert_eq!(of(&scene, Split::Train), ["0clean000.png", "0clean001.png"]);
    assert_eq!(of(&scene, Split::Test), ["2extra000.png"]);
    // The caller's word comes first.
    let options = LoadOptions::default().with_holdout(Holdout::Names(vec!["other".into()]));
    let scene = load(dataset.path(), &options).unwrap();
    assert_eq!((of(&scene, Split::Test), scene.count(Split::Train)), (vec!["other.png"], 2));
}

#[test]
fn clean_photos_are_refused_where_nothing_is_called_clean() {
    let dataset = colmap("", &["clutter0.png", "clutter1.png", "extra0.png"]);
    assert_eq!(load(dataset.path(), &LoadOptions::default()).unwrap().count(Split::Train), 2);
    assert!(error(&dataset, &clean()).contains("holds no photos that are called clean photos"));
    assert!(error(&Dataset::ngp(3), &clean()).contains("holds no photos that are called clean photos"));
    let blender = Dataset::new();
    blender.write("transforms_train.json", r#"{"camera_angle_x": 1.0, "frames": []}"#);
    assert!(error(&blender, &clean()).contains("no transforms_train_clean.json, so no clean photos"));
}

#[test]
fn names_without_extra_photos_are_no_convention() {
    let dataset = colmap("", &["clutter0.png", "clutter1.png", "cleaner.png"]);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!((scene.count(Split::Train), scene.count(Split::Test)), (2, 1));
    assert!(scene.notes.iter().any(|n| n.contains("every 8th frame")), "{:?}", scene.notes);
}

#[test]
fn lists_of_on_the_go_count_frames_in_the_order_of_names() {
    let dataset = Dataset::ngp(6);
    dataset.write("split.json", r#"{"clutter": [0, 2, 5], "clean": [1], "extra": [4]}"#);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::InstantNgp);
    assert_eq!(of(&scene, Split::Train), ["images/000.png", "images/002.png", "images/005.png"]);
    assert_eq!(of(&scene, Split::Test), ["images/004.png"]);
    assert_eq!(of(&scene, Split::Unused), ["images/001.png", "images/003.png"]);
    assert_eq!(of(&load(dataset.path(), &clean()).unwrap(), Split::Train), ["images/001.png"]);

    // A photo that is missing later must not shift the others.
    std::fs::remove_file(dataset.path().join("images/001.png")).unwrap();
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!(of(&scene, Split::Test), ["images/004.png"]);

    for (text, said) in [
        (r#"{"clutter": [0, 6], "extra": [4]}"#, "`clutter` = 6 (of 6 frames): there are not as many frames"),
        (r#"{"clutter": [-1], "extra": [4]}"#, "`clutter` = [-1]: is not a list of whole numbers"),
        (r#"{"clutter": [], "extra": [4]}"#, "holds no photos that are called clutter photos"),
        (r#"{"clutter": [0], "extra": [4]"#, "is not valid JSON"),
    ] {
        dataset.write("split.json", text);
        assert!(
            error(&dataset, &LoadOptions::default()).contains(said),
            "{}",
            error(&dataset, &LoadOptions::default())
        );
    }
    // Somebody else's file of that name.
    dataset.write("split.json", r#"{"folds": 3}"#);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert!(scene.notes.iter().any(|n| n.contains("lists no `clutter` and `extra` photos: not used")));
    dataset.write("transforms.json", ngp_json(0, ""));
    assert!(load(dataset.path(), &LoadOptions::default()).is_err());
}

const TABLE: &str = "filename\tid\tsplit\tdataset\n\
                     a.png\t7\ttrain\tgate\n\
                     b.png\t999\ttest\tgate\n\
                     c.png\t\ttrain\tgate\n\
                     d.png\t2\ttrain\tgate\r\n\
                     gone.png\t3\ttest\tgate\n";

#[test]
fn tables_of_phototourism_go_by_file_name_and_drop_rows_without_an_id() {
    for below in ["", "dense/"] {
        let dataset = colmap(below, &["a.png", "b.png", "c.png", "d.png", "e.png"]);
        dataset.write("gate.tsv", TABLE);
        let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
        assert_eq!(of(&scene, Split::Train), ["a.png", "d.png"]);
        assert_eq!(of(&scene, Split::Test), ["b.png"]);
        assert_eq!(of(&scene, Split::Unused), ["c.png", "e.png"]);
        let note = scene.notes.iter().find(|n| n.contains("gate.tsv")).unwrap();
        assert!(note.contains("splits of 3 photos") && note.contains("1 lines without an id dropped"), "{note}");
        assert!(note.contains("1 lines name no image"), "{note}");
        let held = LoadOptions::default().with_holdout(Holdout::None);
        assert_eq!(load(dataset.path(), &held).unwrap().count(Split::Train), 5);
    }
    // From the `dense` folder, the table stands above.
    let dataset = colmap("dense/", &["a.png", "b.png"]);
    dataset.write("gate.tsv", TABLE);
    let scene = load(&dataset.path().join("dense"), &LoadOptions::default()).unwrap();
    assert_eq!((of(&scene, Split::Train), of(&scene, Split::Test)), (vec!["a.png"], vec!["b.png"]));
}

#[test]
fn broken_tables_name_the_line() {
    let dataset = colmap("", &["a.png", "b.png"]);
    // Somebody else's.
    dataset.write("t.tsv", "time\tloss\n1\t2\n");
    assert_eq!(load(dataset.path(), &LoadOptions::default()).unwrap().count(Split::Test), 1);
    for (text, said) in [
        ("filename\tsplit\n", "t.tsv:1: `id` = filename split: the column is missing"),
        ("filename\tid\tsplit\na.png\t1\ttrian\n", "t.tsv:2: `split` = trian: is not a split"),
        ("filename\tid\tsplit\n\t1\ttrain\n", "t.tsv:2: `filename` = : is missing"),
        ("filename\tid\tsplit\na.png\t1\ttrain\na.png\t2\ttest\n", "t.tsv:3: `filename` = a.png: is in two splits"),
        ("filename\tid\tsplit\nx.png\t1\ttrain\n", "none of its 1 file names is one of the model's 2 images"),
        ("filename\tid\tsplit\na.png\t1\ttest\n", "no frames are left to train on"),
    ] {
        dataset.write("t.tsv", text);
        assert!(
            error(&dataset, &LoadOptions::default()).contains(said),
            "{}",
            error(&dataset, &LoadOptions::default())
        );
    }
}
