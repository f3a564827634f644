//! The `metrics.csv` of a training that another process may still be writing: only what is new is read.

use engine::log::Row;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::PathBuf;

/// A growing file of rows.
#[derive(Debug)]
pub(crate) struct Tail {
    path: PathBuf,
    /// Bytes read, up to the end of a line.
    offset: u64,
    /// The last line read, with its end: a file that holds something else there is another file.
    last: Vec<u8>,
    rows: Vec<Row>,
}

impl Tail {
    pub(crate) fn new(path: PathBuf) -> Self {
        Self { path, offset: 0, last: Vec::new(), rows: Vec::new() }
    }

    /// Rows so far.
    pub(crate) fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Read what was written since. A line that is still being written waits for its end; lines that are not rows are left
    /// out; a file that is not there has no rows.
    pub(crate) fn read(&mut self) {
        if self.more().is_err() {
            *self = Self::new(std::mem::take(&mut self.path));
        }
    }

    fn more(&mut self) -> io::Result<()> {
        let mut file = File::open(&self.path)?;
        if !self.goes_on(&mut file)? {
            *self = Self::new(std::mem::take(&mut self.path));
            file.seek(SeekFrom::Start(0))?;
        }
        let mut new = Vec::new();
        file.read_to_end(&mut new)?;
        for line in new.split_inclusive(|b| *b == b'\n').filter(|line| line.ends_with(b"\n")) {
            self.offset += line.len() as u64;
            self.last = line.to_vec();
            self.rows.extend(std::str::from_utf8(line).ok().and_then(|text| Row::parse(text.trim_end())));
        }
        Ok(())
    }

    /// Whether the file still begins as it was read; leaves it at the end of what was read.
    fn goes_on(&self, file: &mut File) -> io::Result<bool> {
        if file.metadata()?.len() < self.offset {
            return Ok(false);
        }
        file.seek(SeekFrom::Start(self.offset - self.last.len() as u64))?;
        let mut here = vec![0; self.last.len()];
        file.read_exact(&mut here)?;
        Ok(here == self.last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::log::COLUMNS;
    use std::fs;
    use std::io::Write;

    fn steps(tail: &mut Tail) -> Vec<u64> {
        tail.read();
        tail.rows().iter().map(|row| row.step).collect()
    }

    #[test]
    fn rows_are_read_as_they_are_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let mut tail = Tail::new(path.clone());
        assert!(steps(&mut tail).is_empty());
        fs::write(&path, format!("{COLUMNS}\n10,1.0,0.5,12.0,,,,\n20,2.0,0.")).unwrap();
        assert_eq!(steps(&mut tail), [10]);
        assert_eq!(tail.rows()[0].loss, Some(0.5));
        let mut file = fs::OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(b"25,13.0,,,,\n\xff\n30,3.0,,,14.0,,,\n").unwrap();
        assert_eq!(steps(&mut tail), [10, 20, 30]);
        assert_eq!((tail.rows()[1].loss, tail.rows()[2].psnr_test), (Some(0.25), Some(14.0)));
        assert_eq!(steps(&mut tail), [10, 20, 30], "nothing is read twice");
    }

    #[test]
    fn a_file_that_was_written_anew_is_read_anew() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let mut tail = Tail::new(path.clone());
        let write = |rows: &str| fs::write(&path, format!("{COLUMNS}\n{rows}")).unwrap();
        write("10,1,,,,,,\n20,2,,,,,,\n30,3,,,,,,\n");
        assert_eq!(steps(&mut tail), [10, 20, 30]);
        // Resumed at 10: shorter.
        write("10,1,,,,,,\n");
        assert_eq!(steps(&mut tail), [10]);
        // Begun anew, and longer already.
        write("5,1,,,,,,\n6,2,,,,,,\n");
        assert_eq!(steps(&mut tail), [5, 6]);
        fs::remove_file(&path).unwrap();
        assert!(steps(&mut tail).is_empty());
    }
}
