//! Optical flow, disparity and motion masks in folders beside the photos: found, read, reported, refused.

use crate::common::{Dataset, npy};
use scene_io::{BitMask, Depth, Flow, FlowPrior, LoadOptions, Report, Scene, check, load, write_flo};

fn scene(dataset: &Dataset) -> Scene {
    load(dataset.path(), &LoadOptions::default()).unwrap()
}

fn report(dataset: &Dataset) -> Report {
    check(dataset.path(), &LoadOptions::default(), Depth::Pixels)
}

/// Flow of an 8x6 photo, not valid in its first column.
fn flow(x: f32) -> Flow {
    let seen = BitMask::from_fn(8, 6, |column, _| column > 0);
    let vectors = (0..48).map(|k| if k % 8 > 0 { [x, -0.5] } else { [0.0; 2] }).collect();
    Flow { width: 8, height: 6, vectors, seen }
}

/// Three photos: flow between all neighbours, disparity of two, a mask of one.
fn moving() -> Dataset {
    let dataset = Dataset::ngp(3);
    write_flo(&dataset.file("flow/000_fwd.flo"), &flow(1.5)).unwrap();
    write_flo(&dataset.file("flow/001_bwd.flo"), &flow(-1.5)).unwrap();
    dataset.write("flow_i1/00001_fwd.npy", npy(&[6, 8, 2], &[0.25; 96]));
    dataset.write("flow/002_bwd.npy", npy(&[6, 8, 2], &[-0.25; 96]));
    let values: Vec<f32> = (0..48).map(|k| if k == 7 { f32::NAN } else { k as f32 }).collect();
    dataset.write("disp/000.npy", npy(&[6, 8], &values));
    let grey = image::ImageBuffer::from_fn(4, 3, |x, y| image::Luma([(1000 * x + y) as u16]));
    grey.save(dataset.file("disp/001.png")).unwrap();
    dataset.grey("motion_masks/001.png", (8, 6), |x, _| if x < 2 { 255 } else { 0 });
    dataset
}

#[test]
fn photos_have_the_motion_of_their_files_and_none_without() {
    let dataset = moving();
    let scene = scene(&dataset);
    let frames = &scene.frames;
    for note in [
        "2 of 3 frames have optical flow to the next photo",
        "2 of 3 frames have optical flow to the photo before",
        "2 of 3 frames have disparity",
        "1 of 3 frames have masks of what moves",
    ] {
        assert!(scene.notes.iter().any(|n| n == note), "{:?}", scene.notes);
    }
    let first = frames[0].read_flow_prior().unwrap();
    assert_eq!(first, FlowPrior { forward: Some(flow(1.5)), backward: None });
    let second = frames[1].read_flow_prior().unwrap();
    assert_eq!(second.backward, Some(flow(-1.5)));
    let forward = second.forward.unwrap();
    assert_eq!((forward.vectors[47], forward.seen.count()), ([0.25; 2], 48));
    // Half as wide: vectors are half as long, and edges of what is valid are not.
    let small = first.resized(4, 3).forward.unwrap();
    assert_eq!((small.vectors[1], small.seen.get(1, 0), small.seen.get(0, 0)), ([0.75, -0.25], true, false));
    let disparity = frames[0].read_disparity().unwrap().unwrap();
    assert_eq!((disparity.values[7], disparity.known.get(7, 0), disparity.range()), (0.0, false, Some([0.0, 47.0])));
    assert_eq!(frames[1].read_disparity().unwrap().unwrap().values[5], 1001.0);
    let mask = frames[1].read_motion_mask().unwrap().unwrap();
    assert_eq!((mask.count(), mask.get(1, 5), mask.get(2, 5)), (12, true, false));
    assert_eq!(frames[2].read_flow_prior().unwrap().forward, None);
    assert_eq!((frames[2].read_disparity().unwrap(), frames[2].read_motion_mask().unwrap()), (None, None));
    assert!(frames[2].priors.motion.backward.is_some() && !frames[2].priors.is_empty());
    // None of it is a mask of the loss or truth.
    assert!(frames.iter().all(|f| f.mask.is_none() && f.truth.flow.is_none() && f.truth.moving.is_none()));
}

#[test]
fn check_says_what_motion_is_there() {
    let dataset = moving();
    let report = report(&dataset);
    let motion = report.motion.unwrap();
    assert_eq!((motion.forward, motion.backward, motion.disparities, motion.masks), (2, 2, 2, 1));
    assert!((motion.valid - (2.0 + 2.0 * 7.0 / 8.0) / 4.0).abs() < 1e-12 && (motion.moving - 0.25).abs() < 1e-12);
    let text = report.to_string();
    assert!(text.contains("flow: 2 to the next photo, 2 to the one before, 93.8 % of the pixels valid\n"), "{text}");
    assert!(text.contains("disparity: 2 maps, no unit\n"), "{text}");
    assert!(text.contains("motion masks: 1, 25.0 % of the pixels move\n"), "{text}");
    assert!(report.problems.is_empty(), "{text}");
    let none = check(Dataset::ngp(3).path(), &LoadOptions::default(), Depth::Pixels);
    assert_eq!(none.motion, None);
}

#[test]
fn motion_that_says_nothing_is_a_warning() {
    let dataset = moving();
    let lost = Flow { seen: BitMask::new(8, 6), ..flow(1.0) };
    write_flo(&dataset.file("flow/000_fwd.flo"), &lost).unwrap();
    dataset.write("disp/000.npy", npy(&[6, 8], &[2.0; 48]));
    dataset.write("disp/001.npy", npy(&[6, 8], &[f32::INFINITY; 48]));
    // Ones instead of white.
    dataset.grey("motion_masks/001.png", (8, 6), |_, _| 1);
    let report = report(&dataset);
    let text = report.to_string();
    for said in [
        "warning: ",
        "a flow is valid nowhere in images/000.png",
        "the disparity is the same everywhere, which says nothing of shapes, in images/000.png",
        "no disparity is known anywhere in images/001.png",
        "everything moves, as the masks say, in images/001.png",
    ] {
        assert!(text.contains(said), "no `{said}` in {text}");
    }
    assert!(report.can_train() && report.problems.len() == 4, "{text}");
}

#[test]
fn files_of_another_shape_and_broken_ones_are_named() {
    for (name, bytes, said) in [
        (
            "flow/000_fwd.npy",
            npy(&[8, 6, 2], &[0.0; 96]),
            "000_fwd.npy: frame `images/000.png`: the flow is 6x8 and its photo 8x6: rows and columns may be swapped",
        ),
        (
            "flow/000_fwd.npy",
            npy(&[2, 6, 8], &[0.0; 96]),
            "frame `images/000.png`: `flow.shape` = [2, 6, 8]: is not a flow",
        ),
        (
            "flow/000_bwd.npz",
            b"PK\x03\x04".to_vec(),
            "000_bwd.npz: byte 0: frame `images/000.png`: is not a .npz archive",
        ),
        (
            "flow/000_bwd.flo",
            b"PIEH\x08\0\0\0\x06\0\0\0".to_vec(),
            "byte 12: frame `images/000.png`: is 8x6 and holds 0 bytes",
        ),
        ("disp/000.npy", npy(&[8, 6], &[0.0; 48]), "the disparity is 6x8 and its photo 8x6"),
        ("disp/000.npy", npy(&[48], &[0.0; 48]), "000.npy: frame `images/000.png`: `shape` = [48]"),
        ("motion_masks/000.png", b"\x89PNG\r\n\x1a\nbroken".to_vec(), "the image is broken or cut off"),
    ] {
        let dataset = Dataset::ngp(3);
        dataset.write(name, bytes);
        let report = report(&dataset);
        let text = report.to_string();
        assert!(text.contains(said), "no `{said}` in {text}");
        assert!(!report.can_train() && report.problems.len() == 1, "{text}");
    }
    let dataset = Dataset::ngp(3);
    dataset.grey("motion_masks/000.png", (6, 8), |_, _| 0);
    assert!(report(&dataset).to_string().contains("the motion mask is 6x8 and its photo 8x6"));
}
