//! The apps as processes: started, waited for, signalled.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Longest time a command may take before it counts as hanging.
const PATIENCE: Duration = Duration::from_secs(240);
/// How often something is looked at.
pub(crate) const LOOK: Duration = Duration::from_millis(3);

/// The app whose name this program was started under; `None` under its own.
pub(crate) fn as_app() -> Option<ExitCode> {
    let name = std::env::args_os().next()?;
    match Path::new(&name).file_name()?.to_str()? {
        "nerf-static" => Some(apps::nerf_static()),
        "nerf-dynamic" => Some(apps::nerf_dynamic()),
        "nerf-wild" => Some(apps::nerf_wild()),
        _ => None,
    }
}

/// Where the apps lie under their names: links to this program.
pub(crate) struct Apps(PathBuf);

impl Apps {
    /// Make them in `folder`.
    pub(crate) fn in_folder(folder: &Path) -> Result<Self, String> {
        let own = std::env::current_exe().map_err(|e| e.to_string())?;
        for name in ["nerf-static", "nerf-dynamic", "nerf-wild"] {
            link(&own, &folder.join(name)).map_err(|e| e.to_string())?;
        }
        Ok(Self(folder.into()))
    }

    /// Start one.
    pub(crate) fn start(&self, app: &str, words: &[String]) -> Result<Running, String> {
        let mut command = Command::new(self.0.join(app));
        command.env_remove("WILDFIELD_LPIPS").args(words).stdin(Stdio::null());
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let words = format!("{app} {}", words.join(" "));
        Ok(Running { child: child.map_err(|e| format!("{words}: {e}"))?, words, since: Instant::now(), worked: 0.0 })
    }

    /// Run one to its end.
    pub(crate) fn run(&self, app: &str, words: &[String]) -> Result<Answer, String> {
        self.start(app, words)?.end()
    }
}

#[cfg(unix)]
fn link(to: &Path, at: &Path) -> std::io::Result<()> {
    std::os::unix::fs::symlink(to, at)
}

/// Not asked for: there are no signals, so there is no campaign.
#[cfg(not(unix))]
fn link(_: &Path, _: &Path) -> std::io::Result<()> {
    Err(std::io::ErrorKind::Unsupported.into())
}

/// A command that goes on.
pub(crate) struct Running {
    child: Child,
    words: String,
    since: Instant,
    /// Work done when last looked at, seconds of a core.
    worked: f64,
}

/// What became of a command.
pub(crate) struct Answer {
    pub(crate) code: Option<i32>,
    pub(crate) out: String,
    pub(crate) err: String,
    pub(crate) words: String,
    /// See [`Running::worked`].
    pub(crate) worked: f64,
}

impl Running {
    pub(crate) fn is_over(&mut self) -> bool {
        self.worked = work_of(self.child.id()).unwrap_or(self.worked);
        !matches!(self.child.try_wait(), Ok(None))
    }

    /// Seconds of a core that it has worked: those of the clock where the system does not say. A busy machine does not make them
    /// more.
    pub(crate) fn worked(&mut self) -> f64 {
        let _ = self.is_over();
        if cfg!(target_os = "linux") { self.worked } else { self.since.elapsed().as_secs_f64() }
    }

    /// Wait until `is_due`, or the command is over.
    pub(crate) fn until(&mut self, is_due: &dyn Fn() -> bool) {
        while !is_due() && !self.is_over() && self.since.elapsed() < PATIENCE {
            std::thread::sleep(LOOK);
        }
    }

    /// Send a signal: `INT`, `TERM`, `KILL`.
    pub(crate) fn signal(&mut self, name: &str) {
        if self.is_over() {
            return;
        }
        let id = self.child.id().to_string();
        // Until it is waited for, its number is its own: at worst there is nothing left to end.
        let _ = Command::new("kill").args([&format!("-{name}"), &id]).stderr(Stdio::null()).status();
    }

    /// Its answer; a command that hangs is killed and is an error.
    pub(crate) fn end(mut self) -> Result<Answer, String> {
        while !self.is_over() {
            if self.since.elapsed() > PATIENCE {
                let _ = self.child.kill();
                return Err(format!("`{}` went on for {} s", self.words, PATIENCE.as_secs()));
            }
            std::thread::sleep(LOOK);
        }
        let worked = self.worked();
        let output = self.child.wait_with_output().map_err(|e| format!("{}: {e}", self.words))?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        let answer = Answer { code: code_of(output.status), out, err, words: self.words, worked };
        match answer.err.contains("panicked") || answer.err.contains("abort") {
            true => Err(format!("`{}` panicked: {}", answer.words, answer.err)),
            false => Ok(answer),
        }
    }
}

/// Seconds of a core that a process has worked; `None` where the system does not say, or once it is gone.
fn work_of(id: u32) -> Option<f64> {
    /// Ticks of the clock that processes are measured with, a second.
    const TICKS: f64 = 100.0;
    let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // After the name, which may hold anything.
    let numbers: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |i: usize| numbers.get(i)?.parse::<f64>().ok();
    let worked = ticks(11)? + ticks(12)?;
    (worked > 0.0).then_some(worked / TICKS)
}

fn code_of(status: ExitStatus) -> Option<i32> {
    status.code()
}
