//! Folders of datasets, in which one file at a time is replaced.

use crate::Try;
use crate::folder::{File, Folder};
use crate::scenes::Scene;
use crate::sound;
use render_core::camera::Camera;
use scene_io::export::{write_colmap, write_transforms};
use scene_io::{
    Depth, Dialect, Holdout, ImageStore, LoadOptions, MaskPolarity, Masks, MissingImages, Severity, StoreOptions,
    TrainPhotos, check, load, load_cameras,
};
use std::path::Path;

/// The file that lists names to hold out, for the ways of reading that do.
const HOLDOUT: &str = "holdout.txt";

/// What is done with a folder; the second byte of an input counts them from `0`.
#[derive(Clone, Copy)]
enum Use {
    /// Read, and everything that belongs to it.
    Load,
    /// Read without images.
    Cameras,
    /// Looked through, as the command `check` does.
    Check,
    /// Written for other programs, and read again.
    Write,
}

/// A door to a folder.
pub(crate) fn open(scene: fn() -> Scene) -> Try {
    let Scene { doors, beside } = scene();
    let (n, mut folder) = (doors.len(), Folder::new(doors.into_iter().chain(beside).collect::<Vec<File>>()));
    Box::new(move |bytes| {
        let [which, how, content @ ..] = bytes else { return };
        let name = folder.replace(which.wrapping_sub(b'0') % n as u8 + b'0', content).to_owned();
        let (what, options) = way(how.wrapping_sub(b'0'), folder.path(), &name);
        try_folder(folder.path(), what, &options);
    })
}

/// How the folder is read: what is done with it, and what the caller says.
fn way(how: u8, root: &Path, name: &str) -> (Use, LoadOptions) {
    let what = [Use::Load, Use::Check, Use::Cameras, Use::Write][usize::from(how % 4)];
    let mut options = LoadOptions::default();
    match how / 4 % 8 {
        1 => options.holdout = Some(Holdout::Every(2)),
        2 => options.masks = Masks::Off,
        3 => options.mask_polarity = MaskPolarity::WhiteIsIgnored,
        4 => options.missing_images = Some(MissingImages::Skip),
        5 => options.train_photos = TrainPhotos::Clean,
        6 => options.masks = Masks::Folder(root.join("masks")),
        7 => options.longest_side = Some(4),
        _ => {}
    }
    if name == HOLDOUT {
        options.holdout = match Holdout::from_file(&root.join(HOLDOUT)) {
            Ok(names) => Some(names),
            Err(error) => {
                sound::refused(&error.to_string(), HOLDOUT);
                None
            }
        };
    }
    (what, options)
}

fn try_folder(root: &Path, what: Use, options: &LoadOptions) {
    let place = root.display().to_string();
    match what {
        Use::Load | Use::Write => match load(root, options) {
            Err(error) => sound::refused(&error.to_string(), &place),
            Ok(scene) => {
                sound::scene(&scene);
                scene.frames.iter().for_each(|frame| sound::inside(frame, root));
                if matches!(what, Use::Write) {
                    return written(root, &scene);
                }
                scene.frames.iter().for_each(|frame| sound::belongings(frame, root));
                assert_eq!(scene.fingerprint().len(), 64);
                pictures(&scene, &place);
            }
        },
        Use::Cameras => match load_cameras(root, options) {
            Err(error) => sound::refused(&error.to_string(), &place),
            Ok(scene) => sound::scene(&scene),
        },
        Use::Check => {
            let report = check(root, options, Depth::Pixels);
            if let Some(scene) = &report.scene {
                sound::scene(scene);
            }
            for problem in report.problems.iter().chain(&report.capture) {
                sound::one_line(&problem.to_string());
            }
            let errors = report.problems.iter().any(|p| p.severity == Severity::Error);
            assert_eq!(report.can_train(), report.scene.is_some() && !errors);
            if report.can_train() {
                assert!(load(root, options).is_ok(), "`check` finds no fault, and `load` does");
            }
            let last = if report.can_train() { "can be trained" } else { "cannot be trained" };
            assert!(report.to_string().ends_with(last));
        }
    }
}

/// Every picture is decoded, or refused by name.
fn pictures(scene: &scene_io::Scene, place: &str) {
    match ImageStore::new(&scene.frames, StoreOptions::default()) {
        Err(error) => sound::refused(&error.to_string(), place),
        Ok(store) => {
            for (i, frame) in scene.frames.iter().enumerate() {
                match store.get(i) {
                    Err(error) => sound::refused(&error.to_string(), place),
                    Ok(image) => {
                        let pixels = image.width as usize * image.height as usize;
                        assert_eq!((image.width, image.height), (frame.camera.width, frame.camera.height));
                        assert_eq!(image.data.len(), pixels * usize::from(image.channels));
                        assert!(image.mask.as_ref().is_none_or(|mask| mask.len() == pixels));
                    }
                }
            }
        }
    }
}

/// Cameras that are written are read again as they were.
fn written(root: &Path, scene: &scene_io::Scene) {
    let file = root.join("again.json");
    match write_transforms(&file, &scene.frames) {
        // A lens that the format has no name for.
        Err(error) => sound::refused(&error.to_string(), "again.json"),
        Ok(()) => same(scene, &read_again(&file), |frame| match &frame.image {
            scene_io::ImageSource::File(path) => path.display().to_string(),
            scene_io::ImageSource::Memory(_) => frame.name.clone(),
        }),
    }
    let _ = std::fs::remove_file(&file);
    let folder = root.join("again");
    std::fs::create_dir_all(&folder).expect("a folder");
    match write_colmap(&folder, &scene.frames, &scene.points) {
        Err(error) => sound::refused(&error.to_string(), &folder.display().to_string()),
        Ok(()) => {
            let model = scene_io::colmap::Model::read(&folder)
                .unwrap_or_else(|error| panic!("what is written is read: {error}"));
            assert_eq!((model.images.len(), model.points.len()), (scene.frames.len(), scene.points.len()));
            assert!(model.problems.is_empty(), "{}", model.problems[0]);
        }
    }
    let _ = std::fs::remove_dir_all(&folder);
}

/// Reads a written file. The file says no splits, so the names of the photos do: those of clean photos alone are read as
/// clean ones, all others as cluttered ones, whichever choice the folder was read with.
fn read_again(file: &Path) -> scene_io::Scene {
    let options =
        LoadOptions::default().with_dialect(Dialect::Nerfstudio).with_holdout(Holdout::None).with_masks(Masks::Off);
    load(file, &options.clone().with_train_photos(TrainPhotos::Clutter))
        .or_else(|_| load(file, &options.with_train_photos(TrainPhotos::Clean)))
        .unwrap_or_else(|error| panic!("what is written is read: {error}"))
}

fn same(scene: &scene_io::Scene, again: &scene_io::Scene, name: impl Fn(&scene_io::Frame) -> String) {
    assert_eq!(scene.frames.len(), again.frames.len(), "frames are lost");
    let find = |frame| again.frames.iter().find(|other| name(other) == name(frame)).map(|other| other.camera);
    for frame in &scene.frames {
        let other = find(frame).unwrap_or_else(|| panic!("{:?} is lost", frame.name));
        assert!(near(&frame.camera, &other), "{:?} became {other:?}", frame.camera);
    }
}

fn near(a: &Camera, b: &Camera) -> bool {
    let [ca, cb] = [a, b].map(|c| [c.fx, c.fy, c.cx, c.cy, c.pose.c.x, c.pose.c.y, c.pose.c.z]);
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + a.abs());
    let turned = (a.pose.r - b.pose.r).to_cols_array();
    (a.width, a.height) == (b.width, b.height)
        && ca.iter().zip(&cb).all(|(a, b)| close(*a, *b))
        && turned.iter().all(|x| x.abs() < 1e-9)
}
