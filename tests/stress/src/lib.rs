//! The stress list: inputs at the edge of what numbers can be, each with what was promised for it.
//!
//! A [`Case`](Tally::case) is a name, a promise in words, and a check. It fails when the check says so and when it
//! panics; both count, neither ends the list. [`run`] goes through the groups, at every SIMD level where that matters, and
//! ends with one line that CI shows ([`run_at_each_level`] does so for whole programs):
//!
//! ```text
//! stress: 1234 cases tried, 0 failed (math, libm)
//! ```
//!
//! The cases of the math crates are this package's tests, so that they can be built with `std` and with `libm`; those of
//! trainings and files are tests of the package `tests`.

use float_core::Simd;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::{Command, Stdio};
use std::time::Instant;

/// What a check says: nothing, or what is wrong.
pub type Verdict = Result<(), String>;

/// A group of cases.
#[derive(Clone, Copy, Debug)]
pub enum Group {
    /// Runs at each SIMD level of this machine.
    EachLevel(&'static str, fn(&mut Tally, Simd)),
    /// Runs once: no vector code, or none that takes a level.
    Once(&'static str, fn(&mut Tally)),
}

/// Cases tried, those left out, and those that failed.
#[derive(Debug, Default)]
pub struct Tally {
    tried: usize,
    left_out: usize,
    failed: Vec<String>,
    /// 4: cases 1, 5, 9, … are tried, the others left out. 0 and 1: every case is tried.
    one_in: usize,
}

impl Tally {
    /// A tally that tries one case and leaves out the next `one_in - 1`, again and again.
    #[must_use]
    pub fn sparse(one_in: usize) -> Self {
        Self { one_in, ..Self::default() }
    }

    /// Try one case. `promise` says in words what holds, for whoever reads the failure.
    pub fn case(&mut self, name: impl std::fmt::Display, promise: &str, check: impl FnOnce() -> Verdict) {
        if !(self.tried + self.left_out).is_multiple_of(self.one_in.max(1)) {
            self.left_out += 1;
            return;
        }
        self.tried += 1;
        let problem = match catch_unwind(AssertUnwindSafe(check)) {
            Ok(Ok(())) => return,
            Ok(Err(problem)) => problem,
            Err(panic) => format!("panicked: {}", panic_text(&*panic)),
        };
        self.failed.push(format!("{name}: promised: {promise}; {problem}"));
    }

    /// Cases tried so far.
    #[must_use]
    pub fn tried(&self) -> usize {
        self.tried
    }

    /// One line for each case that failed.
    #[must_use]
    pub fn failed(&self) -> &[String] {
        &self.failed
    }
}

/// What a panic said.
fn panic_text(panic: &(dyn std::any::Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("something that is not text")
}

/// Go through the groups, one line for each and one for all; what failed is listed.
///
/// # Panics
/// When a case failed, and when there was none.
pub fn run(list: &str, groups: &[Group]) {
    // Past the test harness, which would swallow it.
    report(list, groups, &mut std::io::stdout());
}

/// [`run`] for cases of whole programs, which ask for no level: in a process of its own for each level of this machine, whose
/// fastest it is there. `test` is the full name of the test that calls this, and calls nothing else. The fastest level of the
/// machine tries every case, the others one in [`ONE_IN`]: whole programs take long, and the list of the math crates tries every case
/// at every level.
///
/// # Panics
/// When a case failed at any level, when there was none, and when a process cannot be started.
pub fn run_at_each_level(list: &str, test: &str, groups: &[Group]) {
    if let Ok(name) = std::env::var(LEVEL) {
        let simd = Simd::available().find(|simd| format!("{:?}", simd.level()) == name);
        Simd::cap_best(simd.expect("a level that this machine has").level());
        assert_eq!(format!("{:?}", Simd::best().level()), name, "the cap does not hold");
        return run(&format!("{list} at {name}"), groups);
    }
    // All at once: a list has long stretches on one thread.
    let held: Vec<(String, bool)> = std::thread::scope(|scope| {
        let start = |simd: Simd| {
            let name = format!("{:?}", simd.level());
            scope.spawn(|| {
                let held = list_at(list, test, &name);
                (name, held)
            })
        };
        let started: Vec<_> = Simd::available().map(start).collect();
        started.into_iter().map(|level| level.join().expect("a list is run by a process of its own")).collect()
    });
    let failed: Vec<&str> = held.iter().filter(|(_, held)| !held).map(|(name, _)| name.as_str()).collect();
    assert!(failed.is_empty(), "{list} failed at {}", failed.join(", "));
}

/// Whether `list` holds in a process at the level `name`. Its lines are shown together when it has ended.
fn list_at(list: &str, test: &str, name: &str) -> bool {
    let mut command = Command::new(std::env::current_exe().expect("the path of this test"));
    if name != format!("{:?}", Simd::best().level()) {
        command.env(SPARSE, ONE_IN.to_string());
    }
    let child = command
        .args(["--exact", test, "--nocapture"])
        .env(LEVEL, name)
        // The levels share the cores: threads of one that wait for each other would take them from the others.
        .env("RAYON_NUM_THREADS", "1")
        .stdout(Stdio::piped())
        .spawn()
        .expect("this test as a process of its own");
    let answer = child.wait_with_output().expect("the end of a process that was started");
    let text = String::from_utf8_lossy(&answer.stdout);
    drop(std::io::stdout().lock().write_all(text.as_bytes()));
    // A test of another name would not run, and pass: the last line of the list must have come.
    let last = format!("({list} at {name}, ");
    answer.status.success() && text.lines().any(|line| line.starts_with("stress: ") && line.contains(&last))
}

/// Names the level to a process of [`run_at_each_level`].
const LEVEL: &str = "WILDFIELD_STRESS_LEVEL";
/// Tells it to try one case in so many; where it is not set, every case.
const SPARSE: &str = "WILDFIELD_STRESS_ONE_IN";
/// A slower level than the fastest tries one case in four of a list of whole programs.
pub const ONE_IN: usize = 4;

fn report(list: &str, groups: &[Group], out: &mut dyn Write) {
    // A closed stdout is not a reason to fail a test.
    let mut say = |line: &str| drop(writeln!(out, "{line}"));
    let one_in = std::env::var(SPARSE).map_or(1, |n| n.parse().expect("WILDFIELD_STRESS_ONE_IN is a number of cases"));
    let (mut tried, mut left_out, mut failed) = (0, 0, 0);
    for group in groups {
        let start = Instant::now();
        let mut tally = Tally::sparse(one_in);
        let (name, levels) = match *group {
            Group::EachLevel(name, cases) => {
                let mut levels = Vec::new();
                for simd in Simd::available() {
                    let mut at_level = Tally::default();
                    cases(&mut at_level, simd);
                    levels.push(format!("{:?}", simd.level()));
                    tally.tried += at_level.tried;
                    tally.failed.extend(at_level.failed.into_iter().map(|f| format!("{:?}: {f}", simd.level())));
                }
                (name, levels.join(", "))
            }
            Group::Once(name, cases) => {
                cases(&mut tally);
                (name, "once".to_string())
            }
        };
        assert!(tally.tried > 0, "the group `{name}` has no cases");
        let (n, bad, seconds) = (tally.tried, tally.failed.len(), start.elapsed().as_secs_f64());
        say(&format!("  {name:<14} {n:>6} cases, {bad} failed, {seconds:.2} s ({levels})"));
        for line in tally.failed.iter().take(SHOWN) {
            say(&format!("    FAILED {line}"));
        }
        if bad > SHOWN {
            say(&format!("    and {} more", bad - SHOWN));
        }
        (tried, left_out, failed) = (tried + n, left_out + tally.left_out, failed + bad);
    }
    let floats = if cfg!(feature = "libm") { "libm" } else { "std" };
    let left_out = if left_out > 0 { format!(", {left_out} left to the fastest level") } else { String::new() };
    say(&format!("stress: {tried} cases tried, {failed} failed ({list}, {floats}){left_out}"));
    assert!(tried > 0 && failed == 0, "{failed} of {tried} cases failed");
}

/// Failures shown of one group.
const SHOWN: usize = 20;

/// Magnitudes from nothing to the largest number: zero, denormals, the ends of the normal range, the thresholds of the
/// exponentials, and some in between.
pub const MAGNITUDES: [f32; 20] = [
    0.0,
    1e-45,
    1e-40,
    1e-38,
    f32::MIN_POSITIVE,
    1e-30,
    1e-20,
    1e-10,
    6e-8,
    1e-3,
    0.5,
    1.0,
    15.0,
    87.0,
    88.8,
    1e4,
    1e10,
    1e20,
    3e38,
    f32::MAX,
];

/// `Err` with this text unless `holds`.
///
/// # Errors
/// When it does not hold.
pub fn ensure(holds: bool, problem: impl FnOnce() -> String) -> Verdict {
    if holds { Ok(()) } else { Err(problem()) }
}

/// Every number is finite.
///
/// # Errors
/// Names the first that is not.
pub fn finite(what: &str, values: &[f32]) -> Verdict {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(i) => Err(format!("{what}[{i}] is {}", values[i])),
    }
}

/// `|got - want| <= bound`; a NaN anywhere is a failure.
///
/// # Errors
/// Says both, and by how much they differ.
pub fn close(what: &str, got: f64, want: f64, bound: f64) -> Verdict {
    let off = (got - want).abs();
    // Equal infinities are equal.
    if off <= bound || got == want {
        return Ok(());
    }
    Err(format!("{what} is {got:e}, expected {want:e}: off by {off:e}, allowed {bound:e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_and_panics_are_counted_and_do_not_end_the_list() {
        let mut tally = Tally::default();
        tally.case("good", "holds", || Ok(()));
        tally.case("bad", "holds", || Err("does not".into()));
        tally.case("worse", "does not panic", || panic!("at number {}", 3));
        tally.case("close", "NaN is never close", || close("x", f64::NAN, 1.0, 1e9));
        assert_eq!((tally.tried(), tally.failed().len()), (4, 3));
        assert_eq!(tally.failed()[0], "bad: promised: holds; does not");
        assert_eq!(tally.failed()[1], "worse: promised: does not panic; panicked: at number 3");
    }

    #[test]
    fn a_sparse_list_tries_its_first_case_and_says_how_many_it_left_out() {
        let mut tally = Tally::sparse(3);
        for k in 0..7 {
            tally.case(k, "every third holds", || if k % 3 == 0 { Ok(()) } else { Err("was to be left out".into()) });
        }
        assert_eq!((tally.tried(), tally.left_out, tally.failed().len()), (3, 4, 0));
    }

    #[test]
    fn a_list_with_a_failure_fails_and_says_so_in_its_last_line() {
        let listed = |groups: &[Group]| {
            let mut out = Vec::new();
            let held = catch_unwind(AssertUnwindSafe(|| report("self-test", groups, &mut out))).is_ok();
            (held, String::from_utf8(out).unwrap())
        };
        let good = Group::Once("good", |t| t.case("yes", "holds", || finite("x", &[0.0, 1.0])));
        let bad = Group::EachLevel("bad", |t, _| t.case("no", "holds", || Err("does not".into())));
        let levels = Simd::available().count();
        let (held, text) = listed(&[good]);
        assert!(held && text.contains("stress: 1 cases tried, 0 failed (self-test, "), "{text}");
        let (held, text) = listed(&[good, bad]);
        assert!(!held && text.contains(&format!("stress: {} cases tried, {levels} failed", 1 + levels)), "{text}");
        assert!(text.contains("FAILED Scalar: no: promised: holds; does not"), "{text}");
        assert!(!listed(&[]).0, "a list without cases shows nothing");
    }
}
