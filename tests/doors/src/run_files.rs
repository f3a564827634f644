//! Files of a run folder that are read again: scores, the curve, what is known of the run, crops, when it was to stop.

use crate::folder::{File, Folder};
use crate::{Try, sound};
use engine::crop::Crop;
use engine::output::Disk;
use engine::run::planned_schedule;
use engine::{log, report};

const EVAL: &str = r#"{"psnr":20.5,"ssim":0.5,"ms_ssim":null,"lpips":null,"views":[{"name":"a","psnr":20.5,"ssim":0.5,"ms_ssim":null,"lpips":null,"render_seconds":0.1,"files":"000_a"}],"steps":2,"seconds":0.5,"protocol":{"scored":"whole"},"notes":["a note"]}"#;
const SUMMARY: &str = r#"{"system":"ngp","parameters":12,"scene":{"name":"two","format":"synthetic","train_views":2,"held_out":["a"],"sizes":[[8,6],[8,6]],"notes":["n"]},"plan":["line"],"steps":2,"seconds":0.5,"resumed_at":null,"timings":[["forward",0.1]],"skips":[{"what":"empty space","skipped":1,"total":2,"unit":"samples","bound":"0"}],"memory":{"images":1,"system":2,"peak":3},"machine":{"cpu":null,"threads":1}}"#;
const METRICS: &str = "step,seconds,loss,psnr_train,psnr_test,rays_per_s,samples_per_s,memory_mb\n1,0.1,1e-2,20,,100,1000,9\n\
                       2,0.2,9e-3,21,19.5,100,1000,9\n";
const CROP: &str = r#"{"box":[[-1.0,-1.0,0.0],[1.0,1.0,2.0]],"faint":0.05,"large":0.8,"alone":0.2,"up":[0,0,1]}"#;
const SCHEDULE: &str = "schedule.json";
const PLANNED: &str = r#"{"steps":100,"seconds":null,"eval_at":[1.0],"eval_every":10,"checkpoint_seconds":60.0}"#;

/// The files that inputs replace.
pub(crate) fn files() -> Vec<File> {
    let file = |name: &str, text: &str| (name.to_owned(), Some(text.as_bytes().to_vec()));
    vec![
        file("eval.json", EVAL),
        file("summary.json", SUMMARY),
        file("metrics.csv", METRICS),
        file("crop.json", CROP),
        file(SCHEDULE, PLANNED),
        file("heldout.txt", "# names\nview_02\n"),
    ]
}

pub(crate) fn open() -> Try {
    let mut folder = Folder::new(files());
    Box::new(move |bytes| {
        let [which, content @ ..] = bytes else { return };
        let name = folder.replace(*which, content).to_owned();
        let root = folder.path();
        match name.as_str() {
            "crop.json" => match Crop::read(&root.join("crop.json")) {
                Err(error) => sound::refused(&error.to_string(), "crop.json"),
                Ok(crop) => {
                    let crop = crop.expect("the file is there");
                    let again = root.join("again.json");
                    crop.write(&Disk, &again).unwrap_or_else(|error| panic!("what is read is written: {error}"));
                    assert_eq!(Crop::read(&again).ok().flatten(), Some(crop));
                }
            },
            SCHEDULE => drop(planned_schedule(root)),
            "heldout.txt" => match scene_io::Holdout::from_file(&root.join("heldout.txt")) {
                Err(error) => sound::refused(&error.to_string(), "heldout.txt"),
                Ok(names) => assert!(matches!(names, scene_io::Holdout::Names(names) if !names.is_empty())),
            },
            _ => {
                if let Err(error) = log::read(&root.join("metrics.csv")) {
                    sound::refused(&error.to_string(), "metrics.csv");
                }
                if let Err(error) = report::write(&Disk, root) {
                    sound::refused(&error.to_string(), &name);
                }
            }
        }
    })
}
