//! One budget of memory for a process: what it holds, what it may take, what a run will need.
//!
//! ```text
//! mod.rs         what the process holds and may take, as the system counts it; the limit of `--memory`
//! expected.rs    what a run will need: the line that is printed before the start
//! rehearsal.rs   a few steps of a copy of the system, to see what training really takes
//! work.rs        how much the process has worked: what a rehearsal ends by
//! frames.rs      what the pictures of a camera path take
//! room.rs        refuses what no machine like this one could hold, before it is made
//! smaller.rs     settings that are reduced where a limit is too low for those planned
//! ```

mod expected;
pub mod frames;
mod rehearsal;
mod room;
mod smaller;
mod work;

pub use expected::ExpectedMemory;
pub use expected::Needs;
pub use rehearsal::rehearse;
pub use room::room_for;
pub use smaller::{Reduced, reduce};

use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes that this process may hold, as the user said; 0: no limit.
static LIMIT: AtomicU64 = AtomicU64::new(0);

/// Let this process hold at most `bytes`: the limit of `--memory`. From then on [`available_bytes`] knows it, and decoding
/// takes at most half of it at one time.
pub fn set_limit(bytes: u64) {
    LIMIT.store(bytes.max(1), Ordering::Relaxed);
    scene_io::DecodeMemory::of_process().set_limit(bytes / 2);
}

/// What [`set_limit`] said; `None` where nothing was said.
pub fn limit() -> Option<u64> {
    Some(LIMIT.load(Ordering::Relaxed)).filter(|&bytes| bytes > 0)
}

/// Resident and peak resident bytes of this process; `None` where the system does not say (only Linux is asked).
pub fn resident_bytes() -> Option<Resident> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    Some(Resident { now: field(&status, "VmRSS:")?, peak: field(&status, "VmHWM:")? })
}

/// Resident memory of the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resident {
    /// Bytes now.
    pub now: u64,
    /// Most bytes so far.
    pub peak: u64,
}

/// Bytes this process can still take: what the machine can give without swapping, or less where [`set_limit`] says so.
pub fn available_bytes() -> Option<u64> {
    let left = limit().map(|limit| limit.saturating_sub(resident_bytes().map_or(0, |held| held.now)));
    [scene_io::available_bytes(), left].into_iter().flatten().min()
}

fn field(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|l| l.strip_prefix(name))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Bytes for people: `12.3 MB`, powers of 1000.
pub fn human(bytes: u64) -> String {
    let b = bytes as f64;
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", b / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", b / 1e6),
        _ => format!("{:.2} GB", b / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_read_in_bytes() {
        let text = "VmPeak:\t  100 kB\nVmRSS:\t   12345 kB\nVmHWM:\t  20000 kB\n";
        assert_eq!(field(text, "VmRSS:"), Some(12_345 * 1024));
        assert_eq!(field(text, "VmSwap:"), None);
        assert_eq!(field("VmRSS: x kB", "VmRSS:"), None);
    }

    #[test]
    fn bytes_are_written_for_people() {
        assert_eq!([999, 1_500, 2_000_000, 3_210_000_000].map(human), ["999 B", "1.5 kB", "2.0 MB", "3.21 GB"]);
    }
}
