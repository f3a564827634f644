//! Splits that names and lists beside the dataset give: cluttered and clean photos, Phototourism's tables.
//!
//! | convention | where | meaning |
//! | --- | --- | --- |
//! | NeRF On-the-go | `split.json` | `clutter`, `clean`, `extra`: indices into the frames sorted by name |
//! | Phototourism | `*.tsv` beside a COLMAP model | columns `filename`, `id`, `split`; rows without an id are dropped, ids are not used |
//! | RobustNeRF | file names | start with `clutter`, `clean` or `extra`, digits before that do not count |
//!
//! Of the first and the last, `extra` photos are tested on and [`TrainPhotos`] says whether cluttered or clean ones are
//! trained on. Frames that no list holds are unused. The Blender form's `transforms_train_clutter.json` and
//! `transforms_train_clean.json` are chosen between while the dialect is detected.

use crate::json::Document;
use crate::listing::listing;
use crate::options::{LoadOptions, TrainPhotos};
use crate::reading::{DialectSplits, Reading};
use crate::{Dialect, ErrorKind, Place, Problem, SceneError, Split, files};
use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// What a photo is for, as its convention says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Clutter,
    Clean,
    Extra,
}

impl Kind {
    const ALL: [Self; 3] = [Self::Clutter, Self::Clean, Self::Extra];

    fn word(self) -> &'static str {
        match self {
            Self::Clutter => "clutter",
            Self::Clean => "clean",
            Self::Extra => "extra",
        }
    }

    fn split(self, photos: TrainPhotos) -> Split {
        match (self, photos) {
            (Self::Extra, _) => Split::Test,
            (Self::Clutter, TrainPhotos::Clutter) | (Self::Clean, TrainPhotos::Clean) => Split::Train,
            _ => Split::Unused,
        }
    }

    /// From the start of a file's name: `clutter000.jpg`, `1extra012.JPG`.
    fn of_name(name: &str) -> Option<Self> {
        let file = name.rsplit('/').next()?.trim_start_matches(|c: char| c.is_ascii_digit() || "_-".contains(c));
        let file = file.to_ascii_lowercase();
        Self::ALL.into_iter().find(|kind| file.starts_with(kind.word()))
    }
}

/// Splits the frames as one of the conventions says, if the dataset follows one and says nothing itself.
pub(crate) fn apply(reading: &mut Reading, dialect: Dialect, options: &LoadOptions) -> Result<(), SceneError> {
    if reading.splits == DialectSplits::Explicit {
        // Blender's form chose its file already.
        return if dialect == Dialect::Blender { Ok(()) } else { expect_clutter(reading, options) };
    }
    let lists = reading.root.join("split.json");
    if lists.is_file() && on_the_go(&lists, reading, options)? {
        return Ok(());
    }
    if dialect == Dialect::Colmap
        && let Some(table) = find_table(reading)
    {
        expect_clutter(reading, options)?;
        return phototourism(&table, reading);
    }
    if by_file_names(reading, options)? {
        return Ok(());
    }
    expect_clutter(reading, options)
}

/// Nobody may believe to train on clean photos where the dataset does not tell them apart.
fn expect_clutter(reading: &Reading, options: &LoadOptions) -> Result<(), SceneError> {
    match options.train_photos {
        TrainPhotos::Clutter => Ok(()),
        TrainPhotos::Clean => Err(no_photos(&reading.root, TrainPhotos::Clean)),
    }
}

fn no_photos(place: &Path, photos: TrainPhotos) -> SceneError {
    let what = format!("holds no photos that are called {} photos", photos.name());
    let remedy = match photos {
        TrainPhotos::Clutter => "train on the clean ones",
        TrainPhotos::Clean => "train on the cluttered ones, which is the default",
    };
    SceneError::new(ErrorKind::Split, Problem::new(place, what, remedy))
}

/// Gives every frame its split by kind; frames without a kind become unused.
fn assign(place: &Path, reading: &mut Reading, kinds: &[Option<Kind>], photos: TrainPhotos) -> Result<(), SceneError> {
    for (frame, kind) in reading.frames.iter_mut().zip(kinds) {
        frame.split = kind.map_or(Split::Unused, |kind| kind.split(photos));
    }
    if !reading.frames.iter().any(|f| f.split == Split::Train) {
        return Err(no_photos(place, photos));
    }
    reading.splits = DialectSplits::Explicit;
    let count = |kind| kinds.iter().filter(|k| **k == Some(kind)).count();
    let [clutter, clean, extra] = Kind::ALL.map(count);
    reading.notes.push(format!(
        "{clutter} cluttered, {clean} clean and {extra} extra photos: trained on are the {} ones, tested on the extra ones",
        if photos == TrainPhotos::Clutter { "cluttered" } else { "clean" }
    ));
    let none: Vec<&str> =
        reading.frames.iter().zip(kinds).filter(|(_, k)| k.is_none()).map(|(f, _)| f.name.as_str()).collect();
    if !none.is_empty() {
        reading.notes.push(format!("neither cluttered, clean nor extra, so not used: {}", listing(&none)));
    }
    Ok(())
}

/// `split.json`; false where it is another program's.
fn on_the_go(file: &Path, reading: &mut Reading, options: &LoadOptions) -> Result<bool, SceneError> {
    let document = Document::read(file)?;
    let format = |p: Problem| SceneError::new(ErrorKind::Format, p);
    let Ok(top) = document.top() else { return Ok(false) };
    if !top.has("extra") || !(top.has("clutter") || top.has("clean")) {
        reading.notes.push(format!("{} lists no `clutter` and `extra` photos: not used", file.display()));
        return Ok(false);
    }
    let mut order: Vec<usize> = (0..reading.frames.len()).collect();
    order.sort_by(|a, b| reading.frames[*a].name.cmp(&reading.frames[*b].name));
    let mut kinds = vec![None; order.len()];
    // Extra comes last: what is measured is not trained on.
    for kind in Kind::ALL {
        for index in top.indices(kind.word()).map_err(format)?.unwrap_or_default() {
            let Some(at) = order.get(index) else {
                let problem =
                    Problem::new(file, "there are not as many frames", "are photos missing, or is it another scene's?");
                let value = format!("{index} (of {} frames)", order.len());
                return Err(SceneError::new(ErrorKind::Split, problem.field(kind.word()).value(value)));
            };
            kinds[*at] = Some(kind);
        }
    }
    assign(file, reading, &kinds, options.train_photos)?;
    Ok(true)
}

/// RobustNeRF's names; false unless some frames are to be trained on and some to be tested on.
fn by_file_names(reading: &mut Reading, options: &LoadOptions) -> Result<bool, SceneError> {
    let kinds: Vec<Option<Kind>> = reading.frames.iter().map(|f| Kind::of_name(&f.name)).collect();
    let is_training = |k: &Option<Kind>| matches!(k, Some(Kind::Clutter | Kind::Clean));
    if !kinds.contains(&Some(Kind::Extra)) || !kinds.iter().any(is_training) {
        return Ok(false);
    }
    let root = reading.root.clone();
    assign(&root, reading, &kinds, options.train_photos)?;
    Ok(true)
}

/// The first table of the dataset's folder, of its `dense` folder, or of the folder above where this one is `dense`.
/// Other programs' tables, without columns `filename` and `split`, do not count.
fn find_table(reading: &mut Reading) -> Option<PathBuf> {
    let root = &reading.root;
    let above = root.parent().filter(|_| root.file_name().is_some_and(|n| n == "dense"));
    let folders = [Some(root.clone()), Some(root.join("dense")), above.map(Path::to_path_buf)];
    let mut tables: Vec<PathBuf> = folders
        .into_iter()
        .flatten()
        .flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten())
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|p| p.is_file() && p.extension().is_some_and(|e| e == "tsv") && is_table(p))
        .collect();
    tables.sort();
    if let [first, _, ..] = tables.as_slice() {
        reading.notes.push(format!("{} tables of splits: used is {}", tables.len(), first.display()));
    }
    tables.into_iter().next()
}

fn is_table(path: &Path) -> bool {
    let mut header = String::new();
    let read = std::fs::File::open(path).map(|file| BufReader::new(file.take(4096)).read_line(&mut header));
    let has = |name: &str| header.trim_start_matches('\u{feff}').split('\t').any(|h| h.trim() == name);
    matches!(read, Ok(Ok(_))) && has("filename") && has("split")
}

/// A table of file names and splits.
fn phototourism(file: &Path, reading: &mut Reading) -> Result<(), SceneError> {
    let text = files::read_text(file)?;
    let wrong = |line: usize, field: &str, value: &str, what: &str, remedy: &str| {
        let problem = Problem::new(file, what, remedy).at(Place::Line(line)).field(field).value(value);
        SceneError::new(ErrorKind::Split, problem)
    };
    let mut lines = text.lines().enumerate();
    let header: Vec<&str> = lines.next().map_or("", |(_, l)| l).split('\t').map(str::trim).collect();
    let column = |name: &str| {
        header.iter().position(|h| *h == name).ok_or_else(|| {
            wrong(1, name, &header.join(" "), "the column is missing", "write the columns filename, id, split, dataset")
        })
    };
    let (name_at, id_at, split_at) = (column("filename")?, column("id")?, column("split")?);
    let mut split_of: HashMap<String, Split> = HashMap::new();
    let mut dropped = 0;
    for (i, line) in lines.filter(|(_, l)| !l.trim().is_empty()) {
        let cells: Vec<&str> = line.split('\t').map(str::trim).collect();
        let cell = |at: usize| cells.get(at).copied().unwrap_or("");
        if cell(id_at).is_empty() {
            dropped += 1;
            continue;
        }
        let split = match cell(split_at) {
            "train" => Split::Train,
            "val" => Split::Val,
            "test" => Split::Test,
            other => return Err(wrong(i + 1, "split", other, "is not a split", "write train or test")),
        };
        if cell(name_at).is_empty() {
            return Err(wrong(i + 1, "filename", "", "is missing", "name the photo, or remove the line"));
        }
        if split_of.insert(cell(name_at).to_owned(), split).is_some_and(|before| before != split) {
            return Err(wrong(i + 1, "filename", cell(name_at), "is in two splits", "remove one of the lines"));
        }
    }
    let rows = split_of.len();
    let (mut matched, mut unused) = (0, Vec::new());
    for frame in &mut reading.frames {
        let last = frame.name.rsplit('/').next().unwrap_or(&frame.name);
        match split_of.get(&frame.name).or_else(|| split_of.get(last)) {
            Some(split) => {
                frame.split = *split;
                matched += 1;
            }
            None => {
                frame.split = Split::Unused;
                unused.push(frame.name.as_str());
            }
        }
    }
    if matched == 0 {
        let what = format!("none of its {rows} file names is one of the model's {} images", reading.frames.len());
        let problem = Problem::new(file, what, "is it another scene's table? Remove it");
        return Err(SceneError::new(ErrorKind::Split, problem));
    }
    reading.splits = DialectSplits::Explicit;
    let mut note = format!("splits of {matched} photos from {}", file.display());
    if dropped > 0 {
        note.push_str(&format!("; {dropped} lines without an id dropped"));
    }
    if rows > matched {
        note.push_str(&format!("; {} lines name no image of the model", rows - matched));
    }
    reading.notes.push(note);
    if !unused.is_empty() {
        reading.notes.push(format!("in the model and not in the table, so not used: {}", listing(&unused)));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_read_from_the_start_of_file_names() {
        for (name, kind) in [
            ("clutter000.jpg", Some(Kind::Clutter)),
            ("images/1extra012.JPG", Some(Kind::Extra)),
            ("0_Clean_3.png", Some(Kind::Clean)),
            ("clutter/000.jpg", None),
            ("unclean.jpg", None),
            ("", None),
        ] {
            assert_eq!(Kind::of_name(name), kind, "{name}");
        }
    }
}
