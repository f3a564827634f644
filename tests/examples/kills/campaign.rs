//! Many passes, a line each, and a table of what was done.

use crate::cases::{CASES, Ground};
use crate::pass::{self, Dice, Done};
use crate::room::Room;
use std::collections::BTreeMap;
use std::process::ExitCode;
use std::time::Instant;

/// Do passes `first .. first + count` of a seed.
pub(crate) fn run(count: u64, seed: u64, first: u64) -> ExitCode {
    if cfg!(not(unix)) {
        println!("SKIPPED: the kill campaign, as this system has no signals");
        return ExitCode::SUCCESS;
    }
    let begun = Instant::now();
    let folder = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(e) => return failed(&format!("there is no room for runs: {e}")),
    };
    let ground = match Ground::new(folder.path()) {
        Ok(ground) => ground,
        Err(problem) => return failed(&problem),
    };
    println!("{count} passes of seed {seed}, from pass {first} on");
    let (mut table, mut failures, mut slowest) = (BTreeMap::new(), Vec::new(), 0.0_f64);
    for number in first..first + count {
        let mut dice = Dice::new(seed, number);
        let case = &CASES[dice.below(CASES.len() as u64) as usize];
        let since = Instant::now();
        let mut done = Done::default();
        let room = Room::new(&folder.path().join(format!("room-{number}")));
        let verdict = room.and_then(|room| {
            if number == first && !room.is_disk() {
                println!("SKIPPED: full and read-only disks, as no disk can be mounted here (it takes root on Linux)");
            }
            pass::run(&ground, case, &room, &mut dice, &mut done)
        });
        let faults: Vec<String> = done.faults.iter().map(|(fault, word)| format!("{fault} in {word}")).collect();
        let what = format!("{} {}: {}", case.app, case.system, faults.join(", "));
        match &verdict {
            Ok(()) => println!("pass {number}: same bits, {:.1} s, {what}", since.elapsed().as_secs_f64()),
            Err(problem) => println!("pass {number}: FAILED, {what}: {problem}"),
        }
        for (fault, word) in done.faults {
            *table.entry((word, fault.to_string())).or_insert(0) += 1;
        }
        slowest = slowest.max(done.slowest);
        failures.extend(verdict.is_err().then_some(number));
        // Runs that came out well are not needed any more.
        let _ = std::fs::remove_dir_all(folder.path().join(format!("room-{number}")));
    }
    println!("\n{:8} {:16} times", "command", "disturbed by");
    for ((word, fault), times) in &table {
        println!("{word:8} {fault:16} {times}");
    }
    println!("most work from a signal to the end: {slowest:.1} s of a core");
    let seconds = begun.elapsed().as_secs_f64();
    println!("{count} passes, {} failed {failures:?}, seed {seed}, {seconds:.0} s", failures.len());
    if failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn failed(problem: &str) -> ExitCode {
    eprintln!("error: {problem}");
    ExitCode::FAILURE
}
