//! One pass: a training that is disturbed a few times, gone on with each time, and compared; then its rendering and its evaluation.

use crate::cases::{Case, Ground, owned, text};
use crate::compare;
use crate::program::{Answer, Running};
use crate::room::Room;
use field_core::rng::Rng;
use std::fmt;
use std::fs;
use std::path::Path;
use std::time::Duration;

/// Disturbances of one training at most.
const MOST: u64 = 3;
/// Tries to end after the disturbances: none more than one is needed, but for a training without a checkpoint.
const TRIES: usize = 3;
/// Most work from a signal to the end of a command, seconds of a core.
const SOON: f64 = 5.0;

/// What is done to a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    Interrupt,
    Terminate,
    Kill,
    Full,
    FullForAWhile,
    ReadOnly,
}

impl Fault {
    fn draw(dice: &mut Dice, is_disk: bool) -> Self {
        let all = [Self::Interrupt, Self::Terminate, Self::Kill, Self::Full, Self::FullForAWhile, Self::ReadOnly];
        // Disks come less often: they take their time.
        let n = if is_disk && dice.below(10) < 4 { 6 } else { 3 };
        let first = if n == 6 { 3 } else { 0 };
        all[first + dice.below(3) as usize]
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Interrupt => "SIGINT",
            Self::Terminate => "SIGTERM",
            Self::Kill => "SIGKILL",
            Self::Full => "full disk",
            Self::FullForAWhile => "full for a while",
            Self::ReadOnly => "read-only",
        })
    }
}

/// When it is done.
#[derive(Clone, Copy, Debug)]
enum Moment {
    /// So many milliseconds after the start.
    After(u64),
    Training,
    Evaluation,
    Report,
}

/// Random numbers of a pass.
pub(crate) struct Dice {
    rng: Rng,
    drawn: u64,
}

impl Dice {
    pub(crate) fn new(seed: u64, pass: u64) -> Self {
        Self { rng: Rng::new(seed, 0x6b69_6c6c).substream(pass), drawn: 0 }
    }

    pub(crate) fn below(&mut self, n: u64) -> u64 {
        self.drawn += 1;
        self.rng.u64_at(self.drawn) % n.max(1)
    }
}

/// What was done in a pass.
#[derive(Default)]
pub(crate) struct Done {
    pub(crate) faults: Vec<(Fault, &'static str)>,
    /// Most work from a signal to the end, seconds of a core.
    pub(crate) slowest: f64,
}

/// Do a pass in `room`.
pub(crate) fn run(ground: &Ground, case: &Case, room: &Room, dice: &mut Dice, done: &mut Done) -> Result<(), String> {
    let (want, want_pictures) = ground.undisturbed(case)?;
    let (run, pictures) = (room.path().join("run"), room.path().join("pictures"));
    let threads = ["1", "2"][dice.below(2) as usize];
    let minutes = ["60", "0.002", "0.0005"][dice.below(3) as usize];
    let more = ["--checkpoint-minutes", minutes, "--disk-wait", "1"];
    let first = ground.train(case, &run, threads, &more);
    let resume = || {
        let words = ["train", "--resume", "--out", text(&run), "--threads", threads, "--progress", "off"];
        owned(&[&words[..], &["--disk-wait", "1"]].concat())
    };
    for _ in 0..=dice.below(MOST) {
        let words = if compare::newest(&run).is_some() { resume() } else { first.clone() };
        disturb((ground, case, &want), (&words, "train", &run), room, dice, done)?;
    }
    for left in (0..TRIES).rev() {
        let before = Before::of(&run);
        let words = if before.step.is_some() { resume() } else { first.clone() };
        let answer = ground.apps.run(case.app, &words)?;
        match (answer.code, left) {
            (Some(0), _) => {
                before.check(&run, case.steps, &want)?;
                break;
            }
            (_, 0) => return Err(unexpected(&answer)),
            _ => {}
        }
    }
    // The checkpoints' rhythm is the schedule's own.
    let minutes: f64 = minutes.parse().map_err(|_| "minutes are a number")?;
    same_schedule(&want, &run, minutes * 60.0)?;
    compare::runs(&want, &run, case.steps)?;
    let again = ground.apps.run(case.app, &resume())?;
    if again.code != Some(0) || !again.out.contains("is finished") {
        return Err(unexpected(&again));
    }
    match dice.below(3) {
        0 => {
            let words = owned(&["eval", text(&run), "--threads", threads, "--progress", "off"]);
            disturb((ground, case, &want), (&words, "eval", &run), room, dice, done)?;
            succeed(ground, case, &words)?;
            compare::runs(&want, &run, case.steps)
        }
        1 => {
            let words = Ground::render(&run, &pictures, threads);
            disturb((ground, case, &want), (&words, "render", &pictures), room, dice, done)?;
            succeed(ground, case, &words)?;
            compare::pictures(&want_pictures, &pictures)?;
            compare::runs(&want, &run, case.steps)
        }
        _ => Ok(()),
    }
}

/// `schedule.json` of a disturbed run has its own time between checkpoints; the rest is that of the undisturbed one.
fn same_schedule(want: &Path, run: &Path, checkpoint_seconds: f64) -> Result<(), String> {
    let name = "schedule.json";
    let read = |folder: &Path| -> Result<serde_json::Value, String> {
        let bytes = fs::read(folder.join(name)).map_err(|e| format!("{name}: {e}"))?;
        serde_json::from_slice(&bytes).map_err(|e| format!("{name}: {e}"))
    };
    let (mut want_value, got) = (read(want)?, read(run)?);
    want_value["checkpoint_seconds"] = checkpoint_seconds.into();
    if want_value != got {
        return Err(format!("{name} is {got}, expected {want_value}"));
    }
    fs::copy(want.join(name), run.join(name)).map(|_| ()).map_err(|e| e.to_string())
}

fn succeed(ground: &Ground, case: &Case, words: &[String]) -> Result<(), String> {
    let answer = ground.apps.run(case.app, words)?;
    if answer.code == Some(0) { Ok(()) } else { Err(unexpected(&answer)) }
}

fn unexpected(answer: &Answer) -> String {
    let Answer { words, code, out, err, .. } = answer;
    format!("`{words}` ended with {code:?}:\n{out}{err}")
}

/// What must not get lost by going on.
struct Before {
    step: Option<u64>,
    views: std::collections::BTreeMap<std::path::PathBuf, std::time::SystemTime>,
}

impl Before {
    fn of(run: &Path) -> Self {
        Self { step: compare::newest(run), views: compare::kept(run) }
    }

    /// After another command: no step before the last checkpoint is gone, and no view that was measured at the end is measured again.
    fn check(&self, run: &Path, steps: u64, want: &Path) -> Result<(), String> {
        let now = compare::newest(run);
        if now < self.step {
            return Err(format!("the newest checkpoint was of step {:?} and is of {now:?}", self.step));
        }
        if self.step == Some(steps) {
            let compared = compare::compared(want);
            let is_compared = |path: &Path| compared.iter().any(|name| path.ends_with(name));
            for (path, written) in self.views.iter().filter(|(path, _)| !is_compared(path)) {
                if fs::metadata(path).and_then(|m| m.modified()).ok().as_ref() != Some(written) {
                    return Err(format!("{} was measured before and is measured again", path.display()));
                }
            }
        }
        Ok(())
    }
}

/// Start a command and do something to it.
fn disturb(
    (ground, case, want): (&Ground, &Case, &Path),
    (words, word, place): (&[String], &'static str, &Path),
    room: &Room,
    dice: &mut Dice,
    done: &mut Done,
) -> Result<(), String> {
    let fault = Fault::draw(dice, room.is_disk());
    done.faults.push((fault, word));
    let run = room.path().join("run");
    let before = Before::of(&run);
    let moment = match dice.below(5) {
        0 if word == "train" => Moment::Training,
        1 if word == "train" => Moment::Evaluation,
        2 if word == "train" => Moment::Report,
        _ => Moment::After(dice.below(900)),
    };
    let room_left = dice.below(400_000);
    // A disk cannot be made read-only while files are open on it, and a folder cannot be sealed before it is there.
    let is_protected = fault == Fault::ReadOnly && dice.below(2) == 0 && room.protect(true);
    let mut running = ground.apps.start(case.app, words)?;
    await_moment(&mut running, moment, place);
    let answer = match fault {
        Fault::Interrupt | Fault::Terminate | Fault::Kill => {
            let was_over = running.is_over();
            let since = running.worked();
            running.signal(match fault {
                Fault::Interrupt => "INT",
                Fault::Terminate => "TERM",
                _ => "KILL",
            });
            let answer = running.end()?;
            let seconds = answer.worked - since;
            done.slowest = done.slowest.max(if was_over { 0.0 } else { seconds });
            if seconds > SOON {
                return Err(format!("{seconds:.1} s of work from {fault} to the end of `{}`", answer.words));
            }
            match (fault, answer.code) {
                (_, Some(0)) | (Fault::Kill, None) => {}
                // Before the program has begun to listen.
                (_, None) if answer.out.is_empty() && answer.err.is_empty() => {}
                (Fault::Interrupt | Fault::Terminate, Some(130)) if answer.err.contains("interrupt heard") => {}
                _ => return Err(unexpected(&answer)),
            }
            answer
        }
        Fault::Full | Fault::FullForAWhile => {
            room.fill(room_left)?;
            if fault == Fault::FullForAWhile {
                std::thread::sleep(Duration::from_millis(100 + dice.below(700)));
                room.empty();
            }
            let answer = running.end();
            room.empty();
            let answer = answer?;
            may_have_failed(&answer)?;
            answer
        }
        Fault::ReadOnly => {
            let is_sealed = !is_protected && Room::seal(&run, true);
            if dice.below(2) == 0 {
                std::thread::sleep(Duration::from_millis(50 + dice.below(700)));
                lift(room, (is_protected, is_sealed), &run)?;
            }
            let answer = running.end();
            lift(room, (is_protected, is_sealed), &run)?;
            let answer = answer?;
            may_have_failed(&answer)?;
            answer
        }
    };
    before.check(&run, case.steps, want).map_err(|problem| format!("after {fault} in `{}`: {problem}", answer.words))
}

/// Make a disk or a folder writable again.
fn lift(room: &Room, (is_protected, is_sealed): (bool, bool), run: &Path) -> Result<(), String> {
    // Files that were made meanwhile were never sealed, and a folder may be gone.
    if is_sealed {
        Room::seal(run, false);
    }
    match is_protected && !room.protect(false) {
        true => Err("the disk cannot be made writable again".into()),
        false => Ok(()),
    }
}

/// With a disk that is full or read-only a command succeeds or says in one line what is wrong.
fn may_have_failed(answer: &Answer) -> Result<(), String> {
    let errors = answer.err.lines().filter(|line| line.starts_with("error: ")).count();
    match answer.code {
        Some(0) if errors == 0 => Ok(()),
        Some(1) if errors == 1 => Ok(()),
        _ => Err(unexpected(answer)),
    }
}

fn await_moment(running: &mut Running, moment: Moment, run: &Path) {
    let rows = || fs::read_to_string(run.join("metrics.csv")).map_or(0, |text| text.lines().count());
    let views = || fs::read_dir(run.join("renders")).map_or(0, Iterator::count);
    match moment {
        Moment::After(milliseconds) => {
            let since = std::time::Instant::now();
            running.until(&|| since.elapsed() >= Duration::from_millis(milliseconds));
        }
        Moment::Training => running.until(&|| rows() > 0),
        Moment::Evaluation => running.until(&|| views() > 2),
        Moment::Report => running.until(&|| run.join("summary.json").exists()),
    }
}
