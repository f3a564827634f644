//! Videos that say little: of one time, of one place, of nothing that moves, of nothing that stays, of nothing but the tool.

use super::{STEPS, build, operation, stage, trains, usual_operation, usual_stage};
use crate::common::{dataset, pictures, says};
use scene_io::synthetic::{MouthOptions, OrbitCamera, OrbitMotion, OrbitOptions, TissueOptions, TissueTool, mouth};
use scene_io::{DepthMap, DepthPlace, DepthSource, Frame, Image, ImageSource, Scene};
use std::sync::Arc;
use stress::{Tally, ensure};
use systems::registry::{Family, Needs, find, names};

/// What is promised of all systems on a scene.
struct Case {
    what: &'static str,
    scene: Scene,
    set: &'static [&'static str],
    /// Whether only a system that looks at measured depth may take it.
    needs_depth: bool,
    /// What `endo-nerf` says of it.
    told: &'static str,
}

const LED: &str = "rays: none under the masks, more where they often are";
const ANYWHERE: &str = "rays: anywhere";
const NO_DEPTH: &str = "depth: none is measured, so nothing is held to it";
const DEPTH: &str = "depth: measured depths lead samples and are held to";

/// Whether any pixel has a depth; without it a map is as good as none.
fn knows_depth(scene: &Scene) -> bool {
    let map = |frame: &Frame| frame.read_depth().expect("depth maps in memory can be read");
    scene.frames.iter().filter_map(map).any(|map| map.z.iter().any(|z| *z > 0.0))
}

/// Other numbers in the place of each depth map.
fn depths(mut scene: Scene, z: impl Fn(usize, usize, f32) -> f32) -> Scene {
    for (k, frame) in scene.frames.iter_mut().enumerate() {
        let Some(DepthPlace::Memory(map)) = frame.depth.as_ref().map(|depth| &depth.place) else { continue };
        let mapped = map.z.iter().enumerate().map(|(i, &old)| z(k, i, old)).collect();
        frame.depth = DepthMap::new(map.width, map.height, mapped).map(DepthSource::memory);
    }
    scene
}

fn times(mut scene: Scene, time: impl Fn(usize) -> f64) -> Scene {
    scene.frames.iter_mut().enumerate().for_each(|(i, frame)| frame.time = Some(time(i)));
    scene
}

/// A mask over what `hides` says.
fn masked(scene: Scene, hides: impl Fn(usize, usize) -> bool) -> Scene {
    pictures(scene, |k, image| {
        let n = (image.width * image.height) as usize;
        let mask = (0..n).map(|i| if hides(k, i) { 0 } else { 255 }).collect();
        Image { mask: Some(mask), ..image.clone() }
    })
}

fn of_sizes(mut scene: Scene) -> Scene {
    for (k, frame) in scene.frames.iter_mut().enumerate() {
        let (width, height) = [(16, 16), (40, 24), (1, 1)][k % 3];
        frame.camera = frame.camera.resized(width, height);
        if let ImageSource::Memory(image) = &frame.image {
            let mut image = image.resized(width, height);
            image.mask = Some((0..width * height).map(|i| if i % 3 == 0 { 0 } else { 255 }).collect());
            frame.image = ImageSource::Memory(Arc::new(image));
        }
    }
    scene
}

fn orbits() -> Vec<Case> {
    let options = OrbitOptions { train: 6, ..OrbitOptions::default() };
    let case = |what, scene| Case { what, scene, set: &[], needs_depth: false, told: NO_DEPTH };
    let frozen = || stage(OrbitOptions { camera: OrbitCamera::Frozen, ..options });
    let mut timeless = usual_stage();
    timeless.frames.iter_mut().for_each(|frame| frame.time = None);
    let mut ordered = timeless.clone();
    assert!(ordered.time_by_order());
    let lips = MouthOptions { width: 16, height: 16, train: 6, val: 0, test: 0, rays: 1, ..MouthOptions::default() };
    let black = pictures(usual_stage(), |_, image| Image { data: vec![0; image.data.len()], ..image.clone() });
    vec![
        case("one frame", stage(OrbitOptions { train: 1, ..options })),
        case("two frames", stage(OrbitOptions { train: 2, ..options })),
        Case { needs_depth: true, ..case("a frozen camera", frozen()) },
        Case { set: &["accept_no_parallax=true"], ..case("a frozen camera that is accepted", frozen()) },
        case("a camera that walks", stage(OrbitOptions { camera: OrbitCamera::Walking, ..options })),
        case("everything moves", stage(OrbitOptions { motion: OrbitMotion::Everything, ..options })),
        case("lips that touch, part and touch again", mouth(&lips)),
        case("nothing moves", stage(OrbitOptions { motion: OrbitMotion::Nothing, ..options })),
        case("duplicate times", times(usual_stage(), |i| (i / 2) as f64 / 2.0)),
        case("unsorted times", times(usual_stage(), |i| (i * 5 % 6) as f64 / 5.0)),
        case("unsorted duplicates", times(usual_stage(), |i| [1.0, 0.0, 1.0, 0.5, 0.0, 0.5][i])),
        case("all frames at time 0", times(usual_stage(), |_| 0.0)),
        case("all frames at time 1", times(usual_stage(), |_| 1.0)),
        case("times a hair apart", times(usual_stage(), |i| 0.5 + i as f64 * 1e-16)),
        case("no times", timeless),
        case("the order for time", ordered),
        case("transparent pictures", black),
        Case { told: ANYWHERE, ..case("pictures of different sizes with masks", of_sizes(usual_stage())) },
        Case { told: LED, ..case("masks of an object that moves", masked(usual_stage(), |k, i| i % 16 < 3 * k)) },
    ]
}

fn operations() -> Vec<Case> {
    let options = TissueOptions { frames: 4, ..TissueOptions::default() };
    let with = |tool| operation(TissueOptions { tool, ..options });
    let case = |what, scene, told| Case { what, scene, set: &[], needs_depth: true, told };
    let mut some = usual_operation();
    some.frames.iter_mut().skip(1).for_each(|frame| frame.depth = None);
    let mut bare = usual_operation();
    bare.frames.iter_mut().for_each(|frame| frame.depth = None);
    let accepted: &[&str] = &["accept_no_parallax=true"];
    vec![
        case("tissue behind a tool", usual_operation(), LED),
        Case {
            needs_depth: false,
            ..case("one frame of tissue", operation(TissueOptions { frames: 1, ..options }), DEPTH)
        },
        case("no tool and no masks", with(TissueTool::Absent), ANYWHERE),
        case("masks without a tool", masked(with(TissueTool::Absent), |_, _| false), LED),
        case("one mask without a tool", masked(usual_operation(), |k, i| k != 1 && i % 16 < 4), LED),
        case(
            "a tool everywhere once",
            masked(usual_operation(), |k, i| k == 2 || i % 16 < 4),
            "1 of 4 photos lie all under",
        ),
        case("a tool everywhere but once", masked(usual_operation(), |k, _| k != 2), "3 of 4 photos lie all under"),
        case("a tool everywhere", with(TissueTool::Everywhere), "masks over everything"),
        case("the same pixels always hidden", masked(usual_operation(), |_, i| i % 16 < 4), LED),
        case("depth with holes", depths(usual_operation(), |_, i, z| if i % 3 == 0 { 0.0 } else { z }), DEPTH),
        case(
            "depth that is not always a number",
            depths(usual_operation(), |_, i, z| [z, f32::NAN, -z, f32::INFINITY, z][i % 5]),
            DEPTH,
        ),
        case("depth of one photo all holes", depths(usual_operation(), |k, _, z| if k == 1 { 0.0 } else { z }), DEPTH),
        case("one depth alone", depths(usual_operation(), |k, i, z| if k == 1 && i == 77 { z } else { 0.0 }), DEPTH),
        case("depth of one photo alone", some.clone(), DEPTH),
        case("depth all equal", depths(usual_operation(), |_, _, _| 40.0), DEPTH),
        case("depth at the end of numbers", depths(usual_operation(), |_, i, z| if i == 5 { 1e30 } else { z }), DEPTH),
        case("depth next to nothing", depths(usual_operation(), |_, i, z| if i == 5 { 1e-30 } else { z }), DEPTH),
        case("no depth", bare.clone(), NO_DEPTH),
        Case { set: accepted, needs_depth: false, ..case("no depth, and that is accepted", bare, NO_DEPTH) },
        Case {
            set: accepted,
            needs_depth: false,
            ..case("nothing but holes, and that is accepted", depths(usual_operation(), |_, _, _| 0.0), NO_DEPTH)
        },
        case("nothing but holes", depths(usual_operation(), |_, _, _| 0.0), NO_DEPTH),
        case("depth that is never a number", depths(usual_operation(), |_, i, _| [f32::NAN, -1.0][i % 2]), NO_DEPTH),
        case("holes alone for the photo that has a depth map", depths(some.clone(), |_, _, _| 0.0), NO_DEPTH),
        case("duplicate times of tissue", times(usual_operation(), |i| (i / 2) as f64), LED),
        case("tissue at one time", times(usual_operation(), |_| 0.0), LED),
    ]
}

fn needs_times(name: &str) -> bool {
    find(name).is_some_and(|entry| entry.needs == Needs::Times)
}

pub(crate) fn cases(tally: &mut Tally) {
    for Case { what, scene, set, needs_depth, told } in orbits().into_iter().chain(operations()) {
        let data = dataset(&scene);
        let (has_maps, has_depth) = (scene.frames.iter().any(|frame| frame.depth.is_some()), knows_depth(&scene));
        for name in names(Family::Moving) {
            // Parallax, depth that somebody looks at, or nothing.
            let refused = needs_depth && !(name == "endo-nerf" && has_depth);
            tally.case(
                format!("{name}, {what}"),
                "trains, everything finite, or one line that says why not",
                || match (build(name, &scene, &data, set), refused) {
                    (Err(e), false) if needs_times(name) && scene.frames.iter().all(|frame| frame.time.is_none()) => {
                        says(&e, &[name, "no photo has a time", "nerf-dynamic"])
                    }
                    (Ok((mut system, plan)), false) => {
                        ensure(plan.lines.iter().all(|line| !line.contains('\n')), || "not one line each".into())?;
                        let said = name != "endo-nerf" || plan.lines.iter().any(|line| line.contains(told));
                        ensure(said, || format!("does not say `{told}`: {:?}", plan.lines))?;
                        trains(system.as_mut(), &data, STEPS)
                    }
                    (Err(e), true) => {
                        let holes = if has_maps && !has_depth { "nothing but holes" } else { "" };
                        says(&e, &["accept_no_parallax", "same pose", "no parallax", holes])
                    }
                    (Ok(_), true) => Err("taken".into()),
                    (Err(e), false) => Err(e.to_string()),
                },
            );
        }
    }
    tally.case("no frame at all", "no panic, everything finite, or one line", || {
        let scene = stage(OrbitOptions { train: 0, ..OrbitOptions::default() });
        let data = dataset(&scene);
        for name in names(Family::Moving) {
            match build(name, &scene, &data, &[]) {
                Ok((mut system, _)) => trains(system.as_mut(), &data, STEPS).map_err(|e| format!("{name}: {e}"))?,
                Err(e) => says(&e, &[])?,
            }
        }
        Ok(())
    });
    tally.case("a depth map of another shape than its photo", "one line that names the frame", || {
        let mut scene = usual_operation();
        scene.frames[1].depth = DepthMap::new(5, 9, vec![1.0; 45]).map(DepthSource::memory);
        match build("endo-nerf", &scene, &dataset(&scene), &[]) {
            Err(e) => says(&e, &["depth", "5x9", "16x12", &scene.frames[1].name]),
            Ok(_) => Err("taken".into()),
        }
    });
}
