//! Times: whatever the files write, 0 to 1 over the sequence.

use super::*;

#[test]
fn times_in_range_are_kept_and_frame_numbers_mapped() {
    let scene = plain(&Dataset::d_nerf(&["0.0", "0.5", "1.0"], &["0.25"]));
    assert_eq!(times(&scene), [0.0, 0.5, 1.0, 0.25]);
    assert!(!scene.notes.iter().any(|n| n.contains("time")), "{:?}", scene.notes);
    // Frame numbers, unsorted, test frames beyond training: one map for all.
    let scene = plain(&Dataset::d_nerf(&["8", "3", "4"], &["0", "10"]));
    assert_eq!(times(&scene), [0.8, 0.3, 0.4, 0.0, 1.0]);
    notes(
        &scene,
        &["times 0 to 10 were mapped to 0 to 1", "2 of 2 test frames lie before the first or after the last"],
    );
    let scene = plain(&Dataset::d_nerf(&["-1.5", "0.5"], &["-0.5"]));
    assert_eq!(times(&scene), [0.0, 1.0, 0.5]);
    // The difference of the largest numbers is none.
    let scene = plain(&Dataset::d_nerf(&["-1.7e308", "1.7e308"], &["0"]));
    assert_eq!(times(&scene), [0.0, 1.0, 0.5]);
}

#[test]
fn times_that_do_not_start_at_0_are_shifted() {
    let scene = plain(&Dataset::d_nerf(&["0.25", "0.75"], &["0.5"]));
    assert_eq!(times(&scene), [0.0, 0.5, 0.25]);
    notes(&scene, &["no frame has time 0: times 0.25 to 0.75 were shifted"]);
    // D-NeRF's loader wants the first frame listed at 0; here it may be any.
    let scene = plain(&Dataset::d_nerf(&["0.5", "0.0", "1.0"], &["0.5"]));
    assert_eq!(times(&scene), [0.5, 0.0, 1.0, 0.5]);
    notes(&scene, &["the first training frame has time 0.5, which D-NeRF's own loader refuses"]);
}

#[test]
fn duplicate_and_unsorted_times_are_views_of_one_time() {
    let scene = plain(&Dataset::d_nerf(&["0.5", "0.0", "0.5", "1.0", "0.0"], &["0.5"]));
    assert_eq!(times(&scene), [0.5, 0.0, 0.5, 1.0, 0.0, 0.5]);
    let dataset = Dataset::d_nerf(&["0.5", "0.0", "0.5", "1.0", "0.0"], &["0.5"]);
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train() && report.to_string().contains("times: 6 frames, 3 distinct, 0 to 1"), "{report}");
}

#[test]
fn one_frame_and_equal_times_cannot_move() {
    let dataset = Dataset::d_nerf(&["0.0"], &[]);
    dataset.remove("transforms_test.json");
    let scene = plain(&dataset);
    assert_eq!(times(&scene), [0.0]);
    notes(&scene, &["there is a single time step: nothing can move"]);
    let scene = plain(&Dataset::d_nerf(&["7", "7"], &["7"]));
    assert_eq!(times(&scene), [0.0; 3]);
    notes(&scene, &["all 3 frames have the same time: nothing can move"]);
}

#[test]
fn missing_times_are_the_place_in_the_list() {
    let dataset = Dataset::d_nerf(&["0.0", "", "1.0"], &["0.25"]);
    let scene = plain(&dataset);
    assert_eq!(times(&scene), [0.0, 0.5, 1.0, 0.25]);
    notes(&scene, &["warning: ", "1 of 3 frames have no time: train/r_1; their place in the list is taken for it"]);
    warns(&dataset, "1 of 3 frames have no time");
    let scene = plain(&Dataset::d_nerf(&["0.0", "0.5", "1.0"], &["", ""]));
    assert_eq!(times(&scene), [0.0, 0.5, 1.0, 0.0, 1.0]);
    notes(&scene, &["transforms_test.json have no time: their order is taken for it, 0 to 1"]);
    // In no frame: a scene that stands still, until the caller says otherwise.
    let mut scene = plain(&Dataset::d_nerf(&["", "", ""], &["", ""]));
    assert!(scene.frames.iter().all(|f| f.time.is_none()));
    assert!(scene.time_by_order());
    assert_eq!(times(&scene), [0.0, 0.25, 0.5, 0.75, 1.0]);
    notes(&scene, &["the order of the 5 frames is taken for it"]);
    assert!(!scene.time_by_order());
}

#[test]
fn times_that_are_no_numbers_name_frame_and_field() {
    for (time, what) in
        [("NaN", "not a finite number"), ("Infinity", "not a finite number"), ("\"late\"", "not a number")]
    {
        let dataset = Dataset::d_nerf(&["0.0", time], &["0.5"]);
        refused(&dataset, &["transforms_train.json", "frame `train/r_1`", "`frames[1].time`", what]);
    }
}

#[test]
fn exported_cameras_keep_their_times() {
    let dataset = Dataset::d_nerf(&["3", "7", "11"], &["5"]);
    let scene = plain(&dataset);
    let file = dataset.path().join("transforms.json");
    export::write_transforms(&file, &scene.frames).unwrap();
    let again = load(&file, &LoadOptions::default().with_holdout(Holdout::None)).unwrap();
    for frame in &again.frames {
        let same = scene.frames.iter().find(|f| format!("{}.png", f.name) == frame.name).unwrap();
        assert_eq!((frame.time, frame.camera.pose.c), (same.time, same.camera.pose.c), "{}", frame.name);
    }
}

#[test]
fn different_exposures_are_told() {
    let dataset = Dataset::d_nerf(&["0", "1", "2"], &["3"]);
    let file = dataset.path().join("transforms_train.json");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.replacen("{\"time\": 0,", "{\"exposures\": -3, \"time\": 0,", 1)).unwrap();
    assert!(!plain(&dataset).notes.iter().any(|n| n.contains("exposures")));
    dataset.edit("transforms_train.json", "{\"time\": 1,", "{\"exposures\": 1, \"time\": 1,");
    notes(&plain(&dataset), &["2 exposures (-3 to 1)"]);
}

proptest! {
    #![proptest_config(testkit::property::cases(24))]

    #[test]
    fn time_is_between_0_and_1_in_the_order_written(
        written in prop::collection::vec(prop_oneof![-1e3..1e3_f64, 0.0..1.0_f64, (0..9_i32).prop_map(f64::from)], 2..7),
    ) {
        let texts: Vec<String> = written.iter().map(f64::to_string).collect();
        let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
        let got = times(&plain(&Dataset::d_nerf(&texts[1..], &texts[..1])));
        // Test frames come last in the scene.
        let got: Vec<f64> = got.iter().cycle().skip(texts.len() - 1).take(texts.len()).copied().collect();
        prop_assert!(got.contains(&0.0) && got.iter().all(|t| (0.0..=1.0).contains(t)), "{got:?}");
        for i in 1..got.len() {
            // Rounding may make two of them one.
            prop_assert!((got[i] - got[0]) * (written[i] - written[0]) >= 0.0);
            prop_assert!(written[i] != written[0] || got[i] == got[0]);
        }
    }
}
