//! What files say of motion, at its edge: nothing, the same everywhere, that nothing moves or that everything does, of one frame or of
//! two, of the wrong size.

use super::{STEPS, build, trains};
use crate::common::{QUERY, dataset, says};
use engine::data::Dataset;
use engine::options::Plan;
use engine::render::render;
use engine::system::{Query, System};
use scene_io::synthetic::{OrbitOptions, orbit, write_blender};
use scene_io::{BitMask, Flow, LoadOptions, Scene, load, write_flo};
use std::fs::{self, create_dir_all};
use std::path::{Path, PathBuf};
use stress::{Tally, Verdict, ensure};
use tempfile::TempDir;

/// Systems that learn from such files.
const SYSTEMS: [&str; 2] = ["nsff", "dynamic-nerf"];

/// A system that learns from masks of what moves alone.
const BY_MASKS: &str = "two-parts";

/// What moves comes at step 2 and is seen two frames on from then; at step 3 priors count less, and what masks say no more.
const SET: [&str; 6] = [
    "horizon=4",
    "moving_from=0.5",
    "flow_chain_from=0.5",
    "flow_fades_in=0.25",
    "batch_rays=1024",
    "batch_samples=8192",
];

/// The same without scene flow.
const SET_BY_MASKS: [&str; 4] = ["horizon=4", "moving_from=0.5", "batch_rays=1024", "batch_samples=8192"];

/// Side of a photo, pixels.
const SIDE: u32 = 16;

/// What is promised of a system on a film.
struct Case {
    what: &'static str,
    frames: usize,
    /// What is known of a frame, by its number, is written into the folder of the film.
    write: fn(&Path, usize),
    /// What the plan says.
    told: &'static [&'static str],
    /// Whether a part for what moves comes; `None` where the photos decide.
    moves: Option<bool>,
}

fn name(frame: usize) -> String {
    format!("r_{frame:03}")
}

/// A file of the film, in a folder that is there.
fn place(folder: &Path, name: String) -> PathBuf {
    let path = folder.join(name);
    create_dir_all(path.parent().unwrap()).unwrap();
    path
}

fn grey_of(folder: &Path, name: String, [width, height]: [u32; 2], value: impl Fn(u32, u32) -> u8) {
    let path = place(folder, name);
    image::GrayImage::from_fn(width, height, |x, y| image::Luma([value(x, y)])).save(path).unwrap();
}

fn mask(folder: &Path, frame: usize, moves: impl Fn(u32, u32) -> bool) {
    let value = |x, y| if moves(x, y) { 255 } else { 0 };
    grey_of(folder, format!("motion_masks/{}.png", name(frame)), [SIDE; 2], value);
}

fn disparity(folder: &Path, frame: usize, value: impl Fn(u32, u32) -> u8) {
    grey_of(folder, format!("disp/{}.png", name(frame)), [SIDE; 2], value);
}

fn flow_of(folder: &Path, name: &str, [width, height]: [u32; 2], vector: [f32; 2], seen: bool) {
    let seen = BitMask::from_fn(width, height, |_, _| seen);
    let flow = Flow { width, height, vectors: vec![vector; (width * height) as usize], seen };
    write_flo(&place(folder, format!("flow/{name}.flo")), &flow).unwrap();
}

/// Flow to both sides; at the ends of a film one of them leads nowhere.
fn flow(folder: &Path, frame: usize, vector: [f32; 2], seen: bool) {
    flow_of(folder, &format!("{}_fwd", name(frame)), [SIDE; 2], vector, seen);
    flow_of(folder, &format!("{}_bwd", name(frame)), [SIDE; 2], vector.map(|x| -x), seen);
}

fn left(x: u32, _: u32) -> bool {
    x < SIDE / 2
}

/// All that can be known: what moves is to the left.
fn all(folder: &Path, frame: usize) {
    flow(folder, frame, [0.5, -0.25], true);
    disparity(folder, frame, |x, y| (7 * x + 3 * y) as u8);
    mask(folder, frame, left);
}

/// A film of photos of so many times, and what is known of it.
fn film(frames: usize, write: impl Fn(&Path, usize)) -> Result<(TempDir, Scene), String> {
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    let options =
        OrbitOptions { width: SIDE, height: SIDE, train: frames, test: 0, rays: 1, ..OrbitOptions::default() };
    write_blender(&orbit(&options), folder.path()).map_err(|e| e.to_string())?;
    (0..frames).for_each(|frame| write(folder.path(), frame));
    let scene = load(folder.path(), &LoadOptions::default()).map_err(|e| e.to_string())?;
    Ok((folder, scene))
}

const NO_FLOW: &str = "no optical flow to the neighbouring photos (`flow/`), so nothing is held to it";
const MASKS: &str = "movers: as the motion masks of all photos say";
const REFUSED: &str = "one line with the file and both sizes";

fn films() -> Vec<Case> {
    let case = |what, write: fn(&Path, usize), told| Case { what, frames: 6, write, told, moves: Some(true) };
    let everything: &[&str] = &["optical flow of 6 of 6 photos", "disparities of 6 of 6 photos", MASKS];
    let flat: &[&str] = &["disparities of 6 of 6 photos are the same everywhere, which says nothing of shapes"];
    let white: &[&str] = &["movers: everything", "the still part learns from nothing"];
    vec![
        Case {
            moves: None,
            ..case("no file at all", |_, _| {}, &[NO_FLOW, "no disparities (`disp/`)", "no motion masks"])
        },
        case("all that can be known", all, everything),
        case("no flow", |folder, k| mask(folder, k, left), &[NO_FLOW, MASKS]),
        case(
            "flow that is valid nowhere",
            |folder, k| {
                all(folder, k);
                flow(folder, k, [0.5, -0.25], false);
            },
            &[NO_FLOW],
        ),
        case(
            "flow at the end of numbers",
            |folder, k| {
                all(folder, k);
                flow(folder, k, [9e8, -9e8], true);
            },
            everything,
        ),
        case(
            "flow of twice the size",
            |folder, k| {
                all(folder, k);
                flow_of(folder, &format!("{}_fwd", name(k)), [2 * SIDE; 2], [1.0, -0.5], true);
            },
            everything,
        ),
        case(
            "constant disparity",
            |folder, k| {
                mask(folder, k, left);
                disparity(folder, k, |_, _| 100);
            },
            flat,
        ),
        case(
            "disparity of two values",
            |folder, k| {
                mask(folder, k, left);
                disparity(folder, k, |x, y| u8::from(x == 3 && y == 3));
            },
            &["held to the disparities of 6 of 6 photos"],
        ),
        Case {
            moves: Some(false),
            ..case("nothing moves", |folder, k| mask(folder, k, |_, _| false), &["movers: none, as the motion masks"])
        },
        case("everything moves", |folder, k| mask(folder, k, |_, _| true), white),
        case("one frame moves as a whole", |folder, k| mask(folder, k, |_, _| k == 2), &[MASKS]),
        Case {
            moves: None,
            ..case(
                "masks of half of the photos",
                |folder, k| {
                    if k % 2 == 0 {
                        mask(folder, k, left);
                    }
                },
                &["3 of 6 photos have a motion mask, so they are found"],
            )
        },
        Case { frames: 2, ..case("two frames", all, &["optical flow of 2 of 2 photos", MASKS]) },
        Case { moves: None, frames: 1, ..case("one frame", all, &["the photos are all of one time", NO_FLOW, MASKS]) },
    ]
}

/// Flow and disparity that cannot be read, and masks.
fn broken_but_masks(folder: &Path, frame: usize) {
    for file in [format!("flow/{}_fwd.flo", name(frame)), format!("disp/{}.npy", name(frame))] {
        fs::write(place(folder, file), "neither").unwrap();
    }
    mask(folder, frame, left);
}

/// What is promised where masks alone are looked at.
fn films_by_masks() -> Vec<Case> {
    let case = |what, write: fn(&Path, usize), told| Case { what, frames: 6, write, told, moves: Some(true) };
    let half: fn(&Path, usize) = |folder, k| {
        if k % 2 == 0 {
            mask(folder, k, left);
        }
    };
    vec![
        Case { moves: None, ..case("no file at all", |_, _| {}, &[]) },
        case("flow and disparity that cannot be read", broken_but_masks, &[MASKS]),
        Case {
            moves: Some(false),
            ..case("nothing moves", |folder, k| mask(folder, k, |_, _| false), &["movers: none, as the motion masks"])
        },
        case("everything moves", |folder, k| mask(folder, k, |_, _| true), &["movers: everything"]),
        case("one frame moves as a whole", |folder, k| mask(folder, k, |_, _| k == 2), &[MASKS]),
        Case {
            moves: None,
            ..case(
                "masks of half of the photos",
                half,
                &["movers: 3 of 6 photos have a motion mask, so they are found"],
            )
        },
        Case { moves: None, frames: 1, ..case("one frame", all, &[MASKS]) },
    ]
}

/// The plan says of such files what is promised, and no more.
fn says_only(plan: &Plan, told: &[&str]) -> Verdict {
    let of_files = |line: &&String| ["movers:", "scene flow:", "depth:"].iter().any(|of| line.starts_with(of));
    let said: Vec<&String> = plan.lines.iter().filter(of_files).collect();
    let is_told = said.len() == told.len() && said.iter().zip(told).all(|(line, part)| line.starts_with(part));
    ensure(is_told, || format!("says {said:?} instead of {told:?}"))
}

/// A part for what moves is there, or nothing is; each is told.
fn found(system: &mut dyn System, data: &Dataset, moves: bool) -> Verdict {
    let has_part = system.state().iter().any(|tensor| tensor.name == "moving.cells");
    ensure(has_part == moves, || format!("a moving part: {has_part}"))?;
    let news = system.news().unwrap_or_default();
    let told = if moves { "something moves in" } else { "nothing moves" };
    ensure(news.contains(told) && !news.contains('\n'), || format!("does not say `{told}`: {news}"))?;
    let Some(view) = data.views().first().filter(|_| !moves) else { return Ok(()) };
    let shown = |time| render(&*system, &view.camera, &Query { time, ..QUERY }).layers.rgb;
    ensure(shown(0.0) == shown(1.0), || "the picture changes, although nothing moves".into())
}

pub(crate) fn cases(tally: &mut Tally) {
    for Case { what, frames, write, told, moves } in films() {
        for name in SYSTEMS {
            tally.case(format!("{name}, {what}"), "the plan says so; trains, everything finite", || {
                let (_folder, scene) = film(frames, write)?;
                let data = dataset(&scene);
                let (mut system, plan) = build(name, &scene, &data, &SET).map_err(|e| e.to_string())?;
                for part in told {
                    let said = plan.lines.iter().any(|line| line.contains(part));
                    ensure(said, || format!("does not say `{part}`: {:?}", plan.lines))?;
                }
                trains(system.as_mut(), &data, STEPS)?;
                moves.map_or(Ok(()), |moves| found(system.as_mut(), &data, moves))
            });
        }
    }
    for Case { what, frames, write, told, moves } in films_by_masks() {
        tally.case(format!("{BY_MASKS}, {what}"), "the plan says so of masks alone; trains, everything finite", || {
            let (_folder, scene) = film(frames, write)?;
            let data = dataset(&scene);
            let (mut system, plan) = build(BY_MASKS, &scene, &data, &SET_BY_MASKS).map_err(|e| e.to_string())?;
            says_only(&plan, told)?;
            trains(system.as_mut(), &data, STEPS)?;
            moves.map_or(Ok(()), |moves| found(system.as_mut(), &data, moves))
        });
    }
    type Write = fn(&Path);
    let write: [(&str, Write); 3] = [
        ("flow", |folder| flow_of(folder, "r_002_fwd", [SIDE, SIDE / 2], [1.0, 0.0], true)),
        ("disparity", |folder| grey_of(folder, "disp/r_002.png".into(), [SIDE, SIDE / 2], |x, _| x as u8)),
        ("motion mask", |folder| grey_of(folder, "motion_masks/r_002.png".into(), [SIDE, SIDE / 2], |_, _| 0)),
    ];
    for (what, write) in write {
        let refused = |name: &str, set: &[&str]| -> Verdict {
            let (_folder, scene) = film(4, |folder, _| write(folder))?;
            match build(name, &scene, &dataset(&scene), set) {
                Err(e) => says(&e, &[what, "r_002", "16x8", "16x16"]),
                Ok(_) => Err("taken".into()),
            }
        };
        for name in SYSTEMS {
            tally.case(format!("{name}, {what} of the wrong size"), REFUSED, || refused(name, &SET));
        }
        if what == "motion mask" {
            tally.case(format!("{BY_MASKS}, {what} of the wrong size"), REFUSED, || refused(BY_MASKS, &SET_BY_MASKS));
        }
    }
}
