//! Programs of others: found on the PATH, run with their lines read as they come, all of them kept in a log.

use crate::error::PrepareError;
use crate::watch::{Event, Watch};
use std::collections::VecDeque;
use std::env::consts::EXE_SUFFIX;
use std::ffi::{OsStr, OsString};
use std::fs::{File, OpenOptions};
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::time::Duration;

/// Lines of a failed program that are shown.
const LAST_LINES: usize = 8;
/// How often a running program is checked, when it says nothing.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Bytes of a line that are kept: a program may write without line ends.
const LONGEST_LINE: usize = 4000;

/// Where programs are searched for.
#[derive(Clone, Debug)]
pub struct Toolbox {
    path: OsString,
}

impl Toolbox {
    /// The PATH of this process.
    #[must_use]
    pub fn from_env() -> Self {
        Self { path: std::env::var_os("PATH").unwrap_or_default() }
    }

    /// These folders and no others.
    #[must_use]
    pub fn of_folders(folders: &[&Path]) -> Self {
        Self { path: std::env::join_paths(folders).unwrap_or_default() }
    }

    /// The first program of that name, or `None`. On Windows `NAME.exe` and `NAME.bat`.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<PathBuf> {
        let names = [format!("{name}{EXE_SUFFIX}"), format!("{name}.bat")];
        let names = if cfg!(windows) { &names[..] } else { &names[..1] };
        std::env::split_paths(&self.path)
            .filter(|folder| !folder.as_os_str().is_empty())
            .flat_map(|folder| names.iter().map(move |n| folder.join(n)))
            .find(|file| is_program(file))
    }

    /// What a short question to a program is answered: standard output, then standard error. `None` where it cannot be run.
    pub(crate) fn ask<S: AsRef<OsStr>>(&self, program: &Path, words: &[S]) -> Option<String> {
        let output = self.command(program).args(words).stdin(Stdio::null()).output().ok()?;
        let mut text = String::from_utf8_lossy(&output.stdout).into_owned();
        text.push_str(&String::from_utf8_lossy(&output.stderr));
        Some(text)
    }

    fn command(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        // COLMAP links Qt, which looks for a screen.
        command.env("PATH", &self.path).env("QT_QPA_PLATFORM", "offscreen");
        command
    }
}

#[cfg(unix)]
fn is_program(file: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    file.metadata().is_ok_and(|m| m.is_file() && m.permissions().mode() & 0o111 != 0)
}

#[cfg(not(unix))]
fn is_program(file: &Path) -> bool {
    file.is_file()
}

/// The log that everything programs say goes to.
#[derive(Debug)]
pub(crate) struct Log {
    pub(crate) path: PathBuf,
    file: File,
}

impl Log {
    /// Opens the log; earlier calls are kept.
    pub(crate) fn open(path: &Path) -> Result<Self, PrepareError> {
        let file = OpenOptions::new().create(true).append(true).open(path);
        Ok(Self { path: path.to_path_buf(), file: file.map_err(PrepareError::io(path, "open the log"))? })
    }

    pub(crate) fn line(&mut self, line: &str) {
        // A full disk shows itself elsewhere, with a name.
        let _ = writeln!(self.file, "{line}");
    }
}

/// What is run, and what to say if it fails.
pub(crate) struct Job<'a> {
    /// Name for messages.
    pub(crate) name: &'a str,
    /// The program.
    pub(crate) program: &'a Path,
    pub(crate) words: Vec<OsString>,
    /// Completes "should …".
    pub(crate) doing: &'a str,
    /// What to do where it fails.
    pub(crate) remedy: &'a str,
}

/// Runs a program to its end. `on_line` gets each line it says, on either stream.
///
/// # Errors
/// [`PrepareError::Tool`] where it cannot be started or fails, after its last lines were passed on as notes;
/// [`PrepareError::Stopped`] when a stop was asked for: the program is ended first.
pub(crate) fn run(
    tools: &Toolbox,
    job: &Job<'_>,
    log: &mut Log,
    watch: &mut dyn Watch,
    mut on_line: impl FnMut(&str, &mut dyn Watch),
) -> Result<(), PrepareError> {
    let failed = |status: String, log: &Log| PrepareError::Tool {
        program: job.name.into(),
        doing: job.doing.into(),
        status,
        remedy: job.remedy.into(),
        log: log.path.clone(),
    };
    let shown: Vec<_> = job.words.iter().map(|w| w.to_string_lossy()).collect();
    log.line(&format!("$ {} {}", job.program.display(), shown.join(" ")));
    let mut command = tools.command(job.program);
    command.args(&job.words).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(e) => return Err(failed(e.to_string(), log)),
    };
    let lines = listen(&mut child);
    let mut last = VecDeque::new();
    loop {
        match lines.recv_timeout(LOOK_EVERY) {
            Ok(line) => {
                log.line(&line);
                on_line(&line, watch);
                if !line.trim().is_empty() {
                    last.push_back(line);
                    if last.len() > LAST_LINES {
                        last.pop_front();
                    }
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        if watch.stop_asked() {
            // It may be gone already.
            let _ = child.kill();
            let _ = child.wait();
            log.line("stopped");
            return Err(PrepareError::Stopped);
        }
    }
    let status = child.wait().map_err(PrepareError::io(job.program, "wait for the program"))?;
    log.line(&format!("{status}"));
    if status.success() {
        return Ok(());
    }
    for line in &last {
        watch.event(Event::Note(&format!("  {}: {}", job.name, line.trim_end())));
    }
    Err(failed(status.to_string(), log))
}

/// The lines of both streams, as they come. The channel closes when both are closed.
fn listen(child: &mut Child) -> mpsc::Receiver<String> {
    let (sender, lines) = mpsc::channel();
    if let Some(out) = child.stdout.take() {
        forward(out, sender.clone());
    }
    if let Some(err) = child.stderr.take() {
        forward(err, sender);
    }
    lines
}

fn forward(stream: impl Read + Send + 'static, sender: Sender<String>) {
    std::thread::spawn(move || {
        let mut line = Vec::new();
        for byte in BufReader::new(stream).bytes() {
            match byte {
                // Programs that redraw a line end it with a carriage return.
                Ok(b'\n' | b'\r') => {
                    let text = String::from_utf8_lossy(&line).into_owned();
                    line.clear();
                    if sender.send(text).is_err() {
                        return;
                    }
                }
                Ok(byte) if line.len() < LONGEST_LINE => line.push(byte),
                Ok(_) => {}
                Err(_) => break,
            }
        }
        if !line.is_empty() {
            // The receiver is gone where the program was ended.
            let _ = sender.send(String::from_utf8_lossy(&line).into_owned());
        }
    });
}

/// What to type to install a Debian package that other systems have under these names.
pub(crate) fn install(tools: &Toolbox, apt: &str, brew: &str, page: &str) -> String {
    if cfg!(target_os = "macos") {
        return format!("type `brew install {brew}`");
    }
    if tools.find("apt-get").is_some() {
        return format!("type `sudo apt-get install {apt}`");
    }
    format!("install it ({page}) and run this again")
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::watch::Silent;

    #[derive(Default)]
    struct Heard {
        notes: Vec<String>,
        stop: bool,
    }

    impl Watch for Heard {
        fn event(&mut self, event: Event<'_>) {
            if let Event::Note(text) = event {
                self.notes.push(text.into());
            }
        }

        fn stop_asked(&self) -> bool {
            self.stop
        }
    }

    fn shell(script: &str, watch: &mut dyn Watch) -> (Result<(), PrepareError>, Vec<String>, String) {
        let folder = tempfile::tempdir().unwrap();
        let mut log = Log::open(&folder.path().join("x.log")).unwrap();
        let words = vec!["-c".into(), script.into()];
        let program = Path::new("/bin/sh");
        let job = Job { name: "sh", program, words, doing: "speak", remedy: "speak louder" };
        let mut lines = Vec::new();
        let result = run(&Toolbox::from_env(), &job, &mut log, watch, |line, _| lines.push(line.to_string()));
        (result, lines, std::fs::read_to_string(&log.path).unwrap())
    }

    #[test]
    fn lines_come_whole_and_are_kept() {
        let (result, lines, log) = shell("printf 'a\\nb\\rc'", &mut Silent);
        result.unwrap();
        assert_eq!(lines, ["a", "b", "c"]);
        assert!(log.contains("a\nb\nc\n"), "{log}");
    }

    #[test]
    fn a_failure_shows_the_last_lines_and_what_to_do() {
        let mut heard = Heard::default();
        let (result, ..) = shell("for i in 1 2 3 4 5 6 7 8 9; do echo line $i >&2; done; exit 3", &mut heard);
        let error = result.unwrap_err().to_string();
        assert!(error.contains("sh failed while it should speak") && error.contains("speak louder"), "{error}");
        assert!(error.contains("x.log"), "{error}");
        assert_eq!(heard.notes.len(), 8);
        assert!(heard.notes[7].contains("line 9"), "{:?}", heard.notes);
    }

    #[test]
    fn a_program_is_ended_when_a_stop_is_asked_for() {
        let mut heard = Heard { stop: true, ..Heard::default() };
        let since = std::time::Instant::now();
        let (result, ..) = shell("sleep 30", &mut heard);
        assert!(matches!(result, Err(PrepareError::Stopped)));
        assert!(since.elapsed() < Duration::from_secs(20));
    }

    #[test]
    fn programs_are_found_by_name_and_only_if_they_can_run() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (tools, file) = (Toolbox::of_folders(&[folder.path()]), folder.path().join("colmap"));
        assert_eq!(tools.find("colmap"), None);
        std::fs::write(&file, "#!/bin/sh\n").unwrap();
        assert_eq!(tools.find("colmap"), None);
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o755)).unwrap();
        assert_eq!(tools.find("colmap"), Some(file));
    }
}
