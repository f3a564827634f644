//! What can be wrong with a dataset, said so that a person can mend it.
//!
//! A [`Problem`] names the file, the place in it, the value found and what to do. Readers collect problems as they go;
//! [`crate::load`] fails on the first of severity [`Severity::Error`], [`crate::check`] lists all of them.

use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

/// How bad a [`Problem`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The scene can be trained, but the result may disappoint.
    Warning,
    /// The scene cannot be trained.
    Error,
}

/// Where in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    #[default]
    File,
    /// A line of a text file, counted from 1.
    Line(usize),
    /// A line and column of a text file, both counted from 1.
    LineColumn(usize, usize),
    /// A byte offset of a binary file, counted from 0.
    Byte(u64),
}

/// One thing wrong with a dataset.
///
/// Displayed as one line: ``file:line: frame `name`: `field` = value: what is wrong; what to do``.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Whether training is possible all the same.
    pub severity: Severity,
    /// The file (or folder) it was found in.
    pub file: PathBuf,
    /// Where in that file.
    pub place: Place,
    /// The frame concerned, by name.
    pub frame: Option<String>,
    /// The field concerned, as written in the file: `frames[3].transform_matrix[0][2]`, `qvec`, `fl_x`.
    pub field: Option<String>,
    /// The offending value.
    pub value: Option<String>,
    /// What is wrong.
    pub what: String,
    /// What to do about it.
    pub remedy: String,
}

impl Problem {
    /// A problem of severity [`Severity::Error`] with a whole file.
    pub fn new(file: impl AsRef<Path>, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            severity: Severity::Error,
            file: file.as_ref().to_path_buf(),
            place: Place::File,
            frame: None,
            field: None,
            value: None,
            what: what.into(),
            remedy: remedy.into(),
        }
    }

    /// The same as a [`Severity::Warning`].
    #[must_use]
    pub fn warning(mut self) -> Self {
        self.severity = Severity::Warning;
        self
    }

    /// Says where in the file.
    #[must_use]
    pub fn at(mut self, place: Place) -> Self {
        self.place = place;
        self
    }

    /// Says which frame.
    #[must_use]
    pub fn frame(mut self, name: impl Into<String>) -> Self {
        self.frame = Some(name.into());
        self
    }

    /// Says which field.
    #[must_use]
    pub fn field(mut self, field: impl Into<String>) -> Self {
        self.field = Some(field.into());
        self
    }

    /// Shows the offending value, cut to a readable length.
    #[must_use]
    pub fn value(mut self, value: impl fmt::Display) -> Self {
        const LONGEST: usize = 120; // characters; a whole matrix fits, a whole file does not
        let mut text = value.to_string();
        if let Some((cut, _)) = text.char_indices().nth(LONGEST) {
            text.truncate(cut);
            text.push('…');
        }
        self.value = Some(text);
        self
    }
}

/// Text as one line that is safe to print: line ends and other control characters, which files may hold in names and
/// terminals obey, are shown as escapes.
#[must_use]
pub fn one_line(text: &str) -> Cow<'_, str> {
    let breaks = |c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}');
    if !text.contains(breaks) {
        return text.into();
    }
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if breaks(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    out.into()
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut line = String::new();
        self.write(&mut line)?;
        f.write_str(&one_line(&line))
    }
}

impl Problem {
    fn write(&self, f: &mut impl fmt::Write) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        match self.place {
            Place::File => {}
            Place::Line(line) => write!(f, ":{line}")?,
            Place::LineColumn(line, column) => write!(f, ":{line}:{column}")?,
            Place::Byte(offset) => write!(f, ": byte {offset}")?,
        }
        if let Some(frame) = &self.frame {
            write!(f, ": frame `{frame}`")?;
        }
        match (&self.field, &self.value) {
            (Some(field), Some(value)) => write!(f, ": `{field}` = {value}")?,
            (Some(field), None) => write!(f, ": `{field}`")?,
            (None, Some(value)) => write!(f, ": `{value}`")?,
            (None, None) => {}
        }
        write!(f, ": {}", self.what)?;
        if !self.remedy.is_empty() {
            write!(f, "; {}", self.remedy)?;
        }
        Ok(())
    }
}

/// What sort of failure a [`SceneError`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The file system refused: missing, unreadable, unwritable, full.
    Io,
    /// A file is not what its name says: broken JSON, truncated binary.
    Format,
    /// A value cannot be: NaN pose, focal length 0, unknown camera model.
    Value,
    /// An image or mask cannot be decoded, or has the wrong size.
    Image,
    /// No known dataset layout was found, or files that belong to it are missing.
    Layout,
    /// Photos or a video without cameras: see [`crate::unposed`].
    NoCameras,
    /// No frames are left to train on, or those to hold out do not exist.
    Split,
    /// Decoding a file would take more memory than it may: see [`crate::DecodeMemory`].
    Memory,
}

/// A failure to read or write scene data: one line for the person, the cause in [`std::error::Error::source`].
#[derive(Debug, thiserror::Error)]
#[error("{problem}{}", more_text(*.more))]
pub struct SceneError {
    kind: ErrorKind,
    problem: Box<Problem>,
    more: usize,
    #[source]
    source: Option<Box<dyn std::error::Error + Send + Sync>>,
}

fn more_text(more: usize) -> String {
    match more {
        0 => String::new(),
        1 => " (and 1 more problem: `check` lists them)".into(),
        n => format!(" (and {n} more problems: `check` lists them)"),
    }
}

impl SceneError {
    /// An error of a kind.
    #[must_use]
    pub fn new(kind: ErrorKind, problem: Problem) -> Self {
        Self { kind, problem: Box::new(problem), more: 0, source: None }
    }

    /// A failed file operation: `doing` completes "cannot …".
    #[must_use]
    pub fn io(path: impl AsRef<Path>, doing: &str, source: std::io::Error) -> Self {
        use std::io::ErrorKind as Io;
        let remedy = match source.kind() {
            Io::NotFound => "check the path",
            Io::PermissionDenied => "check the permissions",
            Io::StorageFull => "free some space",
            _ => "check that the file can be reached",
        };
        let what = format!("cannot {doing}: {source}");
        Self::new(ErrorKind::Io, Problem::new(path, what, remedy)).caused_by(source)
    }

    /// Attaches the cause.
    #[must_use]
    pub fn caused_by(mut self, source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        self.source = Some(source.into());
        self
    }

    /// Names the frame, where none is named yet.
    #[must_use]
    pub fn in_frame(mut self, name: &str) -> Self {
        self.problem.frame.get_or_insert_with(|| name.to_owned());
        self
    }

    /// Says how many problems stand behind this first one.
    #[must_use]
    pub(crate) fn and_more(mut self, more: usize) -> Self {
        self.more = more;
        self
    }

    /// What sort of failure it is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// File, place, value and remedy.
    #[must_use]
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// The problem alone.
    #[must_use]
    pub fn into_problem(self) -> Problem {
        *self.problem
    }
}
