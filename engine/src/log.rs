//! `metrics.csv`: one row an interval of training.

use crate::error::RunError;
use crate::folder::{Home, refuse_foreign};
use crate::output::{Disk, write_file};
use crate::progress::Reached;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The columns. Scripts read them: they stay.
pub const COLUMNS: &str = "step,seconds,loss,psnr_train,psnr_test,rays_per_s,samples_per_s,memory_mb";

/// One row; empty where not measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row {
    /// Steps done.
    pub step: u64,
    /// Training seconds, evaluation not counted.
    pub seconds: f64,
    /// Mean loss since the row before.
    pub loss: Option<f64>,
    /// PSNR of the training rays since the row before, dB.
    pub psnr_train: Option<f64>,
    /// Mean PSNR of the held-out views, dB.
    pub psnr_test: Option<f64>,
    /// Rays cast per second of training.
    pub rays_per_s: Option<f64>,
    /// Field evaluations per second of training.
    pub samples_per_s: Option<f64>,
    /// Resident memory of the process, MB (10^6 bytes).
    pub memory_mb: Option<f64>,
}

impl Row {
    fn line(&self) -> String {
        let show = |x: Option<f64>, digits: usize| x.map_or_else(String::new, |x| format!("{x:.digits$}"));
        format!(
            "{},{:.3},{},{},{},{},{},{}",
            self.step,
            self.seconds,
            self.loss.map_or_else(String::new, |x| format!("{x:.6e}")),
            show(self.psnr_train, 3),
            show(self.psnr_test, 3),
            show(self.rays_per_s, 0),
            show(self.samples_per_s, 0),
            show(self.memory_mb, 1),
        )
    }

    /// A row as it is written; `None` for any other line.
    #[must_use]
    pub fn parse(line: &str) -> Option<Self> {
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |i: usize| match cells.get(i).copied()? {
            "" => Some(None),
            text => text.parse().ok().map(Some),
        };
        Some(Self {
            step: cells.first()?.parse().ok()?,
            seconds: cells.get(1)?.parse().ok()?,
            loss: cell(2)?,
            psnr_train: cell(3)?,
            psnr_test: cell(4)?,
            rays_per_s: cell(5)?,
            samples_per_s: cell(6)?,
            memory_mb: cell(7)?,
        })
    }
}

/// An open `metrics.csv`. Each row is on its way to the disk before [`MetricsLog::write`] returns; all are kept in memory, too:
/// what could not be written is written with the next row, and a file that was removed is made again.
#[derive(Debug)]
pub struct MetricsLog {
    path: PathBuf,
    rows: Vec<Row>,
    /// `None` once the file must be written anew.
    file: Option<File>,
    /// Rows that are in the file, and the length of the file with them.
    written: usize,
    bytes: u64,
    /// The run folder, where the rows are of a run.
    home: Option<Home>,
}

impl MetricsLog {
    /// Start an empty file.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub fn create(path: &Path) -> Result<Self, RunError> {
        Self::of(path, Vec::new())
    }

    /// Continue the file of a run resumed at `step`: rows past it, and a last line cut short, are dropped. A missing
    /// file is started.
    ///
    /// # Errors
    /// [`RunError::Read`], [`RunError::Write`], [`RunError::Content`] when the columns are others.
    pub fn resume(path: &Path, step: u64) -> Result<Self, RunError> {
        let rows = if path.exists() { read(path)? } else { Vec::new() };
        Self::of(path, rows.into_iter().filter(|row| row.step <= step).collect())
    }

    fn of(path: &Path, rows: Vec<Row>) -> Result<Self, RunError> {
        let mut log = Self { path: path.to_path_buf(), rows, file: None, written: 0, bytes: 0, home: None };
        log.flush()?;
        Ok(log)
    }

    /// From now on the file is made again in this folder only, not in another that took its place.
    pub(crate) fn within(self, home: Home) -> Self {
        Self { home: Some(home), ..self }
    }

    /// Append a row.
    ///
    /// # Errors
    /// [`RunError::Write`]; the row is kept and written with the next one.
    pub fn write(&mut self, row: &Row) -> Result<(), RunError> {
        self.rows.push(*row);
        self.flush()
    }

    /// Put the PSNR of the held-out views, dB, beside the last row where it is of that step, into a row of its own otherwise.
    ///
    /// # Errors
    /// As [`MetricsLog::write`].
    pub fn measured(&mut self, at: Reached, psnr: f64) -> Result<(), RunError> {
        match self.rows.last_mut() {
            Some(row) if row.step == at.step => {
                row.psnr_test = Some(psnr);
                self.file = None;
            }
            _ => self.rows.push(Row { step: at.step, seconds: at.seconds, psnr_test: Some(psnr), ..Row::default() }),
        }
        self.flush()
    }

    /// Write what is not in the file yet.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub fn flush(&mut self) -> Result<(), RunError> {
        let text = |rows: &[Row]| rows.iter().map(|row| format!("{}\n", row.line())).collect::<String>();
        match &mut self.file {
            Some(file) if is_at(file, &self.path) => {
                let more = text(&self.rows[self.written..]);
                // One write call a row: a kill leaves whole rows.
                if let Err(error) = file.write_all(more.as_bytes()) {
                    // A part of a row is none.
                    let _ = file.set_len(self.bytes);
                    return Err(RunError::write(&self.path)(error));
                }
                self.bytes += more.len() as u64;
            }
            _ => {
                self.file = None;
                // The folder may have been replaced meanwhile: nothing is written among files of others, or of another run.
                let other =
                    |why: String| RunError::Write { path: self.path.clone(), source: std::io::Error::other(why) };
                if self.home.as_ref().is_some_and(|home| !home.stands()) {
                    return Err(other("the run folder was removed or replaced".into()));
                }
                refuse_foreign(self.path.parent().unwrap_or(Path::new("."))).map_err(|e| other(e.to_string()))?;
                let all = format!("{COLUMNS}\n{}", text(&self.rows));
                write_file(&Disk, &self.path, all.as_bytes())?;
                let file = OpenOptions::new().append(true).open(&self.path);
                self.file = Some(file.map_err(RunError::write(&self.path))?);
                self.bytes = all.len() as u64;
            }
        }
        self.written = self.rows.len();
        Ok(())
    }
}

/// Whether an open file is the one at a path.
fn is_at(file: &File, path: &Path) -> bool {
    let (Ok(open), Ok(there)) = (file.metadata(), fs::metadata(path)) else { return false };
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        (open.dev(), open.ino()) == (there.dev(), there.ino())
    }
    #[cfg(not(unix))]
    {
        open.len() == there.len()
    }
}

/// The rows of a `metrics.csv`; lines that are not rows are left out.
///
/// # Errors
/// [`RunError::Read`], [`RunError::Content`] when the first line is not [`COLUMNS`].
pub fn read(path: &Path) -> Result<Vec<Row>, RunError> {
    let text = fs::read_to_string(path).map_err(RunError::read(path))?;
    let mut lines = text.lines();
    if lines.next().map(str::trim_end) != Some(COLUMNS) {
        return Err(RunError::Content {
            path: path.to_path_buf(),
            problem: format!("the first line is not `{COLUMNS}`: move the file away"),
        });
    }
    Ok(lines.filter_map(Row::parse).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_past_the_checkpoint_and_torn_lines_are_dropped_on_resume() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let mut log = MetricsLog::create(&path).unwrap();
        for step in [10, 20, 30] {
            log.write(&Row { step, seconds: 0.5, loss: Some(0.25), ..Row::default() }).unwrap();
        }
        drop(log);
        let mut text = fs::read_to_string(&path).unwrap();
        text += "40,0.9";
        fs::write(&path, text).unwrap();

        let mut log = MetricsLog::resume(&path, 20).unwrap();
        log.write(&Row { step: 21, psnr_test: Some(31.5), ..Row::default() }).unwrap();
        let rows = read(&path).unwrap();
        assert_eq!(rows.iter().map(|r| r.step).collect::<Vec<_>>(), [10, 20, 21]);
        assert_eq!(rows[0], Row { step: 10, seconds: 0.5, loss: Some(0.25), ..Row::default() });
        assert_eq!(rows[2].psnr_test, Some(31.5));
    }

    #[test]
    fn a_file_that_is_removed_comes_back_with_all_its_rows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("runs/metrics.csv");
        fs::create_dir(folder.path().join("runs")).unwrap();
        let mut log = MetricsLog::create(&path).unwrap();
        let row = |step| Row { step, ..Row::default() };
        log.write(&row(1)).unwrap();
        fs::remove_dir_all(folder.path().join("runs")).unwrap();
        assert!(matches!(log.write(&row(2)), Err(RunError::Write { .. })));
        fs::create_dir(folder.path().join("runs")).unwrap();
        log.write(&row(3)).unwrap();
        assert_eq!(read(&path).unwrap(), [1, 2, 3].map(row));
        log.measured(Reached { step: 3, seconds: 0.5 }, 20.0).unwrap();
        log.measured(Reached { step: 4, seconds: 0.5 }, 21.0).unwrap();
        let psnrs: Vec<_> = read(&path).unwrap().iter().map(|r| (r.step, r.psnr_test)).collect();
        assert_eq!(psnrs, [(1, None), (2, None), (3, Some(20.0)), (4, Some(21.0))]);
    }

    #[cfg(unix)]
    #[test]
    fn the_file_of_another_run_that_took_the_folders_place_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let (run, moved) = (folder.path().join("run"), folder.path().join("moved"));
        fs::create_dir(&run).unwrap();
        let path = run.join("metrics.csv");
        let row = |step| Row { step, ..Row::default() };
        let mut log = MetricsLog::create(&path).unwrap().within(Home::of(&run));
        log.write(&row(1)).unwrap();
        fs::rename(&run, &moved).unwrap();
        fs::create_dir(&run).unwrap();
        MetricsLog::create(&path).unwrap().write(&row(7)).unwrap();
        assert!(matches!(log.write(&row(2)), Err(RunError::Write { .. })));
        assert_eq!(read(&path).unwrap(), [row(7)]);
        // Moved back, it is the same again.
        fs::remove_dir_all(&run).unwrap();
        fs::rename(&moved, &run).unwrap();
        log.write(&row(3)).unwrap();
        assert_eq!(read(&path).unwrap(), [1, 2, 3].map(row));
    }

    #[test]
    fn a_file_with_other_columns_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        fs::write(&path, "a,b\n1,2\n").unwrap();
        assert!(matches!(MetricsLog::resume(&path, 5), Err(RunError::Content { .. })));
        assert_eq!(fs::read_to_string(&path).unwrap(), "a,b\n1,2\n", "a refused file is left alone");
    }
}
