//! A disk that fills up costs what was being written and nothing else.

use crate::common::{Watch, arrays, request, resume, sky_scene, start, with_parts};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use systems::RunError;
use systems::checkpoint::newest_step;
use systems::options::Request;
use systems::output::{Disk, Storage, StorageFile, write_file};
use systems::run::Run;
use systems::train::{Schedule, Stop};

/// A file system with `left` bytes.
struct Filling {
    left: Arc<AtomicU64>,
}

struct FillingFile {
    file: File,
    left: Arc<AtomicU64>,
}

impl Storage for Filling {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StorageFile>> {
        Ok(Box::new(FillingFile { file: File::create(path)?, left: self.left.clone() }))
    }
}

impl Write for FillingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let left = self.left.load(Ordering::Relaxed);
        if left == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let n = self.file.write(&bytes[..bytes.len().min(left as usize)])?;
        self.left.store(left - n as u64, Ordering::Relaxed);
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl StorageFile for FillingFile {
    fn sync(&mut self) -> io::Result<()> {
        self.file.sync_all()
    }
}

#[test]
fn a_full_disk_leaves_the_earlier_checkpoint_usable() {
    let whole = tempfile::tempdir().unwrap();
    start(whole.path(), &Disk, Stop::Steps(20), &mut Watch::default()).unwrap();
    // Room for nothing, for a part of the arrays, and for the arrays but not the JSON file.
    let size = arrays(whole.path(), 20).len() as u64;
    for room in [0, size / 2, size + 100] {
        let folder = tempfile::tempdir().unwrap();
        start(folder.path(), &Disk, Stop::Steps(10), &mut Watch::default()).unwrap();
        let storage = Filling { left: Arc::new(AtomicU64::new(room)) };
        let error = with_parts(&storage, &sky_scene(8, 16, false), |parts| {
            let watch = &mut Watch::default();
            let mut run = Run::open(folder.path(), &Request::default(), parts, watch).unwrap();
            run.train(&Schedule::new(Stop::Steps(20)), None, watch, &Default::default()).unwrap_err()
        });
        assert!(
            matches!(&error, RunError::Write { source, .. } if source.kind() == io::ErrorKind::StorageFull),
            "{error}"
        );
        assert!(error.to_string().contains("step-00000020"), "{error}");
        assert_eq!(newest_step(folder.path()), Some(10));
        let leftovers = fs::read_dir(folder.path().join("checkpoint")).unwrap();
        assert!(leftovers.flatten().all(|e| e.path().extension().is_some_and(|e| e != "tmp")));
        resume(folder.path(), Stop::Steps(20), &mut Watch::default()).unwrap();
        assert_eq!(arrays(folder.path(), 20), arrays(whole.path(), 20), "resumed once there is room");
    }
}

#[test]
fn a_failed_write_leaves_the_file_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("eval.json");
    write_file(&Disk, &path, b"old").unwrap();
    let storage = Filling { left: Arc::new(AtomicU64::new(2)) };
    assert!(write_file(&storage, &path, b"new and longer").is_err());
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn an_output_folder_that_cannot_be_is_found_out_before_training() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a_file");
    fs::write(&file, b"").unwrap();
    let below = file.join("run");
    let error = with_parts(&Disk, &sky_scene(8, 16, false), |parts| {
        Run::create(&below, &request(), parts, &mut Watch::default()).map(|_| ()).unwrap_err()
    });
    assert!(matches!(&error, RunError::Write { path, .. } if *path == below), "{error}");

    let storage = Filling { left: Arc::new(AtomicU64::new(0)) };
    let error = with_parts(&storage, &sky_scene(8, 16, false), |parts| {
        Run::create(&folder.path().join("run"), &request(), parts, &mut Watch::default()).map(|_| ()).unwrap_err()
    });
    assert!(matches!(error, RunError::Write { .. }), "{error}");
}
