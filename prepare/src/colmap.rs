//! Poses by COLMAP 3.8 to 4.x, on the CPU: features, matches, the incremental mapper; or the global mapper of GLOMAP.

use crate::batches::batches;
use crate::error::PrepareError;
use crate::pairs::{ALL_PAIRS, loop_closures};
use crate::stage::{State, fresh_folder, hash, remove_folder};
use crate::task::Task;
use crate::tool::{Job, Log, Toolbox, run};
use crate::watch::{Event, Meter, Watch};
use scene_io::colmap::Model;
use scene_io::export::write_atomically;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Images of a block of the exhaustive matcher: only how often it says how far it is.
const BLOCK: usize = 10;
/// The files of a model. `rigs` and `frames` came with version 3.12.
const MODEL_FILES: [&str; 5] = ["cameras.bin", "images.bin", "points3D.bin", "rigs.bin", "frames.bin"];

/// COLMAP as it is installed.
#[derive(Clone, Debug)]
pub(crate) struct Colmap {
    program: PathBuf,
    pub(crate) version: String,
    /// What stands before `.use_gpu` and `.num_threads` of the extractor: `SiftExtraction` to 3.12, `FeatureExtraction` since.
    extraction: &'static str,
    /// The same of the matchers.
    matching: &'static str,
    /// Whether it has GLOMAP's mapper built in.
    has_global: bool,
}

/// What finds the poses once matches are there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Mapper {
    /// `colmap mapper`.
    Incremental,
    /// `colmap global_mapper`.
    Global,
    /// The program `glomap`.
    Glomap(PathBuf),
}

impl Colmap {
    /// The installed COLMAP, asked once what its options are called; `None` where there is none.
    pub(crate) fn find(tools: &Toolbox) -> Option<Self> {
        let program = tools.find("colmap")?;
        let help = tools.ask(&program, &["help"])?;
        let extractor = tools.ask(&program, &["feature_extractor", "-h"]).unwrap_or_default();
        let matcher = tools.ask(&program, &["exhaustive_matcher", "-h"]).unwrap_or_default();
        let newer = |text: &str, new: &'static str, old: &'static str| if text.contains(new) { new } else { old };
        Some(Self {
            program,
            version: version(&help).unwrap_or_else(|| "of unknown version".into()),
            extraction: newer(&extractor, "FeatureExtraction.use_gpu", "SiftExtraction.use_gpu")
                .trim_end_matches(".use_gpu"),
            matching: newer(&matcher, "FeatureMatching.use_gpu", "SiftMatching.use_gpu").trim_end_matches(".use_gpu"),
            has_global: help.contains("global_mapper"),
        })
    }

    /// The global mapper: GLOMAP's program, else that built into newer versions.
    pub(crate) fn global(&self, tools: &Toolbox) -> Option<Mapper> {
        tools.find("glomap").map(Mapper::Glomap).or(self.has_global.then_some(Mapper::Global))
    }

    /// Writes a model of as many photos as can be placed.
    ///
    /// # Errors
    /// [`PrepareError`] where the programs fail, or no photo could be placed.
    pub(crate) fn reconstruct(
        &self,
        task: &Task<'_>,
        mapper: &Mapper,
        log: &mut Log,
        watch: &mut dyn Watch,
    ) -> Result<(), PrepareError> {
        let features = hash([&task.inputs, "colmap", &self.version]);
        let matches = hash([features.as_str(), if task.in_order { "in order" } else { "all" }]);
        let map = hash([&matches, &format!("{mapper:?}")]);
        self.features(task, &features, log, watch)?;
        self.matches(task, &matches, log, watch)?;
        self.map(task, &map, mapper, log, watch)
    }

    fn database(task: &Task<'_>) -> PathBuf {
        task.stages.folder.join("database.db")
    }

    fn job<'a>(&'a self, words: Vec<OsString>, doing: &'a str, remedy: &'a str) -> Job<'a> {
        Job { name: "colmap", program: &self.program, words, doing, remedy }
    }

    fn features(
        &self,
        task: &Task<'_>,
        inputs: &str,
        log: &mut Log,
        watch: &mut dyn Watch,
    ) -> Result<(), PrepareError> {
        const STAGE: &str = "features";
        let database = Self::database(task);
        if matches!(task.stages.state(STAGE, inputs), State::Done(_)) && database.is_file() {
            watch.event(Event::Note("features: done before"));
            return Ok(());
        }
        // Features that were interrupted are found anew: a camera must not be cut in two.
        for ending in ["", "-wal", "-shm", "-journal"] {
            let mut file = database.clone().into_os_string();
            file.push(ending);
            // Not there is as well.
            let _ = std::fs::remove_file(file);
        }
        task.stages.forget("matches")?;
        task.stages.begin(STAGE, inputs)?;
        let mut meter = Meter::new("find features", task.names.len());
        let mut before = 0;
        for (i, batch) in batches(task.groups).into_iter().enumerate() {
            let list = task.stages.folder.join(format!("list-{i}.txt"));
            let text = batch.names.join("\n") + "\n";
            write_atomically(&list, |out| out.write_all(text.as_bytes()))?;
            let mut words = words(["feature_extractor", "--database_path"]);
            words.extend([database.clone().into(), "--image_path".into(), task.images.clone().into()]);
            words.extend(["--image_list_path".into(), list.into()]);
            let (model, parameters) = batch.camera();
            words.extend(["--ImageReader.camera_model".into(), model.into()]);
            if let Some(parameters) = parameters {
                words.extend(["--ImageReader.camera_params".into(), parameters.into()]);
            }
            let sharing = if batch.is_shared { "single_camera" } else { "single_camera_per_image" };
            words.extend([format!("--ImageReader.{sharing}").into(), "1".into()]);
            self.on_the_cpu(self.extraction, task, &mut words);
            let job = self.job(words, "find features", "see whether the photos open elsewhere");
            run(task.tools, &job, log, watch, |line, watch| {
                if let Some((done, _)) = fraction(line) {
                    meter.reach(before + done, watch);
                }
            })?;
            before += batch.names.len();
        }
        task.stages.finish(STAGE, inputs, task.names.len().into())
    }

    fn matches(&self, task: &Task<'_>, inputs: &str, log: &mut Log, watch: &mut dyn Watch) -> Result<(), PrepareError> {
        const STAGE: &str = "matches";
        match task.stages.state(STAGE, inputs) {
            State::Done(_) => {
                watch.event(Event::Note("matches: done before"));
                return Ok(());
            }
            State::Begun => watch.event(Event::Note("matches: going on where it was stopped")),
            State::New => {}
        }
        task.stages.forget("poses")?;
        task.stages.begin(STAGE, inputs)?;
        let n = task.names.len();
        if task.in_order && n > ALL_PAIRS {
            self.matcher(task, "sequential_matcher", Vec::new(), Meter::new("match neighbours", n), log, watch)?;
            let pairs = loop_closures(n);
            let list = task.stages.folder.join("pairs.txt");
            let lines: Vec<String> =
                pairs.iter().map(|(a, b)| format!("{} {}\n", task.names[*a], task.names[*b])).collect();
            write_atomically(&list, |out| out.write_all(lines.concat().as_bytes()))?;
            let words = vec!["--match_list_path".into(), list.into(), "--match_type".into(), "pairs".into()];
            self.matcher(task, "matches_importer", words, Meter::new("match far frames", pairs.len()), log, watch)?;
        } else {
            let pairs = n * n.saturating_sub(1) / 2;
            if pairs > ALL_PAIRS * ALL_PAIRS {
                watch.event(Event::Note(&format!("{pairs} pairs of photos are compared: this takes long")));
            }
            let words = vec!["--ExhaustiveMatching.block_size".into(), BLOCK.to_string().into()];
            let blocks = n.div_ceil(BLOCK);
            self.matcher(task, "exhaustive_matcher", words, Meter::new("match photos", blocks * blocks), log, watch)?;
        }
        task.stages.finish(STAGE, inputs, n.into())
    }

    fn matcher(
        &self,
        task: &Task<'_>,
        command: &str,
        more: Vec<OsString>,
        meter: Meter<'_>,
        log: &mut Log,
        watch: &mut dyn Watch,
    ) -> Result<(), PrepareError> {
        let mut words = words([command, "--database_path"]);
        words.push(Self::database(task).into());
        words.extend(more);
        self.on_the_cpu(self.matching, task, &mut words);
        let job = self.job(words, "compare photos", "run the same command again: it goes on where it was");
        let mut meter = meter;
        run(task.tools, &job, log, watch, |line, watch| {
            if let Some((done, of)) = fraction(line) {
                meter.reach_of(done, of, watch);
            }
        })
    }

    fn map(
        &self,
        task: &Task<'_>,
        inputs: &str,
        mapper: &Mapper,
        log: &mut Log,
        watch: &mut dyn Watch,
    ) -> Result<(), PrepareError> {
        const STAGE: &str = "poses";
        if matches!(task.stages.state(STAGE, inputs), State::Done(_)) && Model::read(&task.model).is_ok() {
            watch.event(Event::Note("poses: done before"));
            return Ok(());
        }
        task.stages.begin(STAGE, inputs)?;
        let models = task.stages.folder.join("models");
        fresh_folder(&models)?;
        let command = match mapper {
            Mapper::Incremental => Some("mapper"),
            Mapper::Global => Some("global_mapper"),
            Mapper::Glomap(_) => Some("mapper"),
        };
        let mut words: Vec<OsString> = command.into_iter().map(Into::into).collect();
        words.extend(["--database_path".into(), Self::database(task).into()]);
        words.extend(["--image_path".into(), task.images.clone().into()]);
        words.extend(["--output_path".into(), models.clone().into()]);
        if let (Some(threads), Mapper::Incremental) = (task.threads, mapper) {
            words.extend(["--Mapper.num_threads".into(), threads.to_string().into()]);
        }
        let remedy =
            "photos of one place need to overlap: take more of them, from more places, or keep more frames (--frames)";
        let job = match mapper {
            Mapper::Glomap(program) => Job { name: "glomap", program, words, doing: "place the photos", remedy },
            _ => self.job(words, "place the photos", remedy),
        };
        let mut meter = Meter::new("place photos", task.names.len());
        // The first pair is not counted among those registered.
        let mut placed = 1;
        let ran = run(task.tools, &job, log, watch, |line, watch| {
            if line.contains("Registering image #") {
                placed += 1;
                meter.reach(placed, watch);
            }
        });
        let found = largest(&models);
        let (best, others) = match (found, ran) {
            // COLMAP ends with a failure where it found nothing, which is not a failure of its own.
            (_, Err(PrepareError::Stopped)) => return Err(PrepareError::Stopped),
            (Some(found), Ok(())) => found,
            (_, Err(error)) => return Err(error),
            (None, Ok(())) => {
                let what = format!("none of the {} photos could be placed", task.names.len());
                return Err(PrepareError::NoCameras { what, remedy: remedy.into() });
            }
        };
        for count in others {
            watch.event(Event::Warning(&format!(
                "{count} photos hold together and not with the others: left out (photos in between would join them)"
            )));
        }
        install_model(&best, &task.model)?;
        remove_folder(&models)?;
        task.stages.finish(STAGE, inputs, serde_json::Value::Null)
    }

    fn on_the_cpu(&self, prefix: &str, task: &Task<'_>, words: &mut Vec<OsString>) {
        words.extend([format!("--{prefix}.use_gpu").into(), "0".into()]);
        if let Some(threads) = task.threads {
            words.extend([format!("--{prefix}.num_threads").into(), threads.to_string().into()]);
        }
    }
}

fn words<const N: usize>(words: [&str; N]) -> Vec<OsString> {
    words.map(OsString::from).into()
}

/// `3.8` of `COLMAP 3.8 -- Structure-from-Motion …`.
fn version(help: &str) -> Option<String> {
    let line = help.lines().find(|l| l.contains("COLMAP "))?;
    let word = line.split("COLMAP ").nth(1)?.split_whitespace().next()?;
    word.starts_with(|c: char| c.is_ascii_digit()).then(|| word.to_string())
}

/// How far a program says it is: `[3/50]`, or `[2/5, 4/5]` for blocks of blocks.
fn fraction(line: &str) -> Option<(usize, usize)> {
    let inner = line.split_once('[')?.1.split_once(']')?.0;
    let one = |text: &str| {
        let (a, b) = text.trim().split_once('/')?;
        Some((a.trim().parse::<usize>().ok()?, b.trim().parse::<usize>().ok().filter(|b| *b > 0)?))
    };
    match inner.split_once(',') {
        Some((outer, inner)) => {
            let ((a, of_a), (b, of_b)) = (one(outer)?, one(inner)?);
            Some((a.checked_sub(1)?.checked_mul(of_b)?.checked_add(b)?, of_a.checked_mul(of_b)?))
        }
        None => one(inner),
    }
}

/// The model with most photos, and how many photos each other one has.
fn largest(folder: &Path) -> Option<(PathBuf, Vec<usize>)> {
    let entries = std::fs::read_dir(folder).ok()?;
    let folders = entries.filter_map(|e| e.ok().map(|e| e.path())).chain([folder.to_path_buf()]);
    let mut models: Vec<(usize, PathBuf)> = folders
        .filter_map(|f| Model::read(&f).ok().map(|m| (m.images.len(), f)))
        .filter(|(count, _)| *count > 0)
        .collect();
    models.sort_by(|a, b| b.0.cmp(&a.0).then_with(|| a.1.cmp(&b.1)));
    let mut models = models.into_iter();
    let (_, best) = models.next()?;
    Some((best, models.map(|(count, _)| count).collect()))
}

/// Copies a model to where the scene is read from, in place of any that was there.
fn install_model(from: &Path, to: &Path) -> Result<(), PrepareError> {
    fresh_folder(to)?;
    let texts = MODEL_FILES.map(|f| f.replace(".bin", ".txt"));
    for name in MODEL_FILES.iter().map(|f| f.to_string()).chain(texts) {
        let source = from.join(&name);
        if source.is_file() {
            let target = to.join(&name);
            std::fs::copy(&source, &target).map_err(PrepareError::io(&target, "write the model"))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_read_from_what_colmap_says() {
        assert_eq!(fraction("Processed file [3/50]"), Some((3, 50)));
        assert_eq!(fraction("Matching block [2/5, 4/5] in 1.2s"), Some((9, 25)));
        assert_eq!(fraction("I20260101 pairing.cc:12] Processing image [7/9]"), Some((7, 9)));
        for line in ["", "[", "[a/b]", "[1/0]", "[0/5, 1/5]", "no fraction"] {
            assert_eq!(fraction(line), None, "{line}");
        }
    }

    #[test]
    fn versions_are_read() {
        assert_eq!(version("COLMAP 3.8 -- Structure-from-Motion\n").as_deref(), Some("3.8"));
        assert_eq!(version("x\nCOLMAP 4.2.1 (Commit abc)").as_deref(), Some("4.2.1"));
        assert_eq!(version("COLMAP knows no version"), None);
    }

    #[cfg(unix)]
    #[test]
    fn options_are_called_what_the_installed_version_calls_them() {
        let folder = tempfile::tempdir().unwrap();
        let tools = Toolbox::of_folders(&[folder.path()]);
        assert!(Colmap::find(&tools).is_none());
        let script = "case $1 in help) echo 'COLMAP 3.8 -- x';; *) echo ' --SiftExtraction.use_gpu --SiftMatching.use_gpu';; esac";
        crate::testing::fake_program(folder.path(), "colmap", script);
        let old = Colmap::find(&tools).unwrap();
        assert_eq!((old.version.as_str(), old.extraction, old.matching), ("3.8", "SiftExtraction", "SiftMatching"));
        assert_eq!(old.global(&tools), None);
        let script = "case $1 in help) echo 'COLMAP 4.2.1'; echo '  global_mapper';; \
                      *) echo ' --FeatureExtraction.use_gpu --FeatureMatching.use_gpu';; esac";
        crate::testing::fake_program(folder.path(), "colmap", script);
        let new = Colmap::find(&tools).unwrap();
        assert_eq!((new.extraction, new.matching), ("FeatureExtraction", "FeatureMatching"));
        assert_eq!(new.global(&tools), Some(Mapper::Global));
        crate::testing::fake_program(folder.path(), "glomap", "exit 0");
        assert_eq!(new.global(&tools), Some(Mapper::Glomap(folder.path().join("glomap"))));
    }
}
