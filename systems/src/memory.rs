//! How much memory the process holds, as the system counts it.

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

/// Memory of the machine that can still be had without swapping, bytes.
pub fn available_bytes() -> Option<u64> {
    scene_io::available_bytes()
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
