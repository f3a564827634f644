//! Where and on what a page was made.

use float_core::{Simd, SimdLevel};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// The machine, the code and the day.
#[derive(Clone, Debug)]
pub(crate) struct Machine {
    /// `AMD EPYC, 2 cores, scalar + AVX2 + AVX-512, L2 1 MiB a core, L3 32 MiB, Linux`.
    pub(crate) line: String,
    /// Short hash, `+` behind it where tracked files differ from it; `unknown` without a repository.
    pub(crate) commit: String,
    /// UTC, `2026-11-21`.
    pub(crate) date: String,
    /// The words of the command.
    pub(crate) command: String,
}

impl Machine {
    /// Ask the system; what it does not say is left out.
    pub(crate) fn here(threads: usize) -> Self {
        let cpu = std::fs::read_to_string("/proc/cpuinfo").ok();
        let model = cpu.as_deref().and_then(cpu_model).unwrap_or_else(|| std::env::consts::ARCH.into());
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let levels: Vec<&str> = Simd::available().map(|s| level_name(s.level())).collect();
        let mut parts = vec![model, format!("{cores} cores"), levels.join(" + ")];
        parts.extend([2, 3].iter().filter_map(|&level| cache(level)));
        parts.push(std::env::consts::OS.into());
        parts.push(format!("{threads} threads where nothing else is said"));
        let words: Vec<String> = std::env::args().skip(1).collect();
        Self {
            line: parts.join(", "),
            commit: commit().unwrap_or_else(|| "unknown".into()),
            date: date(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())),
            command: ["nerf-bench".to_string()].into_iter().chain(words).collect::<Vec<_>>().join(" "),
        }
    }
}

/// A level for people.
pub(crate) fn level_name(level: SimdLevel) -> &'static str {
    match level {
        SimdLevel::Scalar => "scalar",
        SimdLevel::Avx2 => "AVX2",
        SimdLevel::Avx512 => "AVX-512",
    }
}

fn cpu_model(cpuinfo: &str) -> Option<String> {
    let line = cpuinfo.lines().find(|l| l.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_string())
}

/// `L2 1024K` of the first core.
fn cache(level: u32) -> Option<String> {
    let folder = Path::new("/sys/devices/system/cpu/cpu0/cache");
    let read = |index: u32, what: &str| {
        std::fs::read_to_string(folder.join(format!("index{index}/{what}"))).ok().map(|s| s.trim().to_string())
    };
    let index = (0..8).find(|&i| read(i, "level").is_some_and(|l| l == level.to_string()))?;
    Some(format!("L{level} {}", read(index, "size")?))
}

/// Asked of `git` when there is a repository around; a benchmark needs none.
fn commit() -> Option<String> {
    let git = |words: &[&str]| {
        let output = std::process::Command::new("git").args(words).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
    };
    let hash = git(&["rev-parse", "--short", "HEAD"])?;
    let changed = git(&["status", "--porcelain", "--untracked-files=no", "--", "*.rs", "*.toml"])?;
    Some(if changed.is_empty() { hash } else { format!("{hash}+") })
}

/// The day of a number of seconds since 1970, in the Gregorian calendar.
fn date(seconds: u64) -> String {
    // Days since 1 March of year 0; an era is 400 years.
    let days = seconds / 86_400 + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (year, month) = (era * 400 + year + u64::from(month >= 10), if month < 10 { month + 3 } else { month - 9 });
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        assert_eq!(date(0), "1970-01-01");
        assert_eq!(date(951_782_400), "2000-02-29");
        assert_eq!(date(1_795_219_200), "2026-11-21");
    }

    #[test]
    fn the_model_of_a_cpu_is_read() {
        assert_eq!(cpu_model("processor: 0\nmodel name\t: Fast One\n"), Some("Fast One".into()));
        assert_eq!(cpu_model("nothing"), None);
    }
}
