//! The command line.

use crate::name::Name;
use clap::Parser;
use std::path::PathBuf;

/// Time against error, and kernels against the ceilings of this machine: writes Markdown, CSV and SVG.
#[derive(Debug, Parser)]
#[command(name = "nerf-bench", version, about)]
pub(crate) struct Cli {
    /// Under two minutes: all sections at smaller sizes, training on the embedded scene only
    #[arg(long)]
    pub(crate) quick: bool,

    /// Sections to run; the pages of the others stay as they are
    #[arg(long, value_enum, value_delimiter = ',', value_name = "SECTION,…")]
    pub(crate) only: Vec<Name>,

    /// Tables of the scripts in `bench/peers`: their curves are drawn, a page a scene, and nothing is measured
    #[arg(long, value_delimiter = ',', value_name = "CSV,…", conflicts_with_all = ["quick", "only"])]
    pub(crate) peers: Vec<PathBuf>,

    /// Folder the pages go to
    #[arg(long, default_value = "docs/bench", value_name = "DIR")]
    pub(crate) out: PathBuf,

    /// Folder of the datasets that are trained (default: variable WILDFIELD_DATA, else `../shared/data`)
    #[arg(long, value_name = "DIR")]
    pub(crate) data: Option<PathBuf>,

    /// Protocols to train, where not all (`lego100`, `fox135`, …)
    #[arg(long, value_delimiter = ',', value_name = "NAME,…")]
    pub(crate) protocol: Vec<String>,

    /// Training seconds of each protocol, and of each row of the pages of moving scenes (default: 300, and what keeps such a
    /// page below an hour)
    #[arg(long, value_name = "S", value_parser = seconds, conflicts_with = "steps")]
    pub(crate) seconds: Option<f64>,

    /// Training steps of each row of the pages of moving scenes and of those from the wild
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) steps: Option<u64>,

    /// Measure the held-out views of moving scenes at the end of each row alone: pages of large pictures take minutes instead of an hour, and
    /// have no curves
    #[arg(long, conflicts_with = "quick")]
    pub(crate) at_end: bool,

    /// Measure views held out of the training views in the place of the test views, which are not looked at: `every:8`,
    /// `names:FILE`, `dataset`. For choosing settings by a protocol; `every:8+4` leaves the first photo, whose light lego's protocols
    /// are measured in
    #[arg(long, value_name = "WHICH", value_parser = validation, conflicts_with = "quick")]
    pub(crate) validation: Option<String>,

    /// Threads where a figure is for several (default: all cores)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
}

/// A word that is read only for what it says.
fn validation(text: &str) -> Result<String, String> {
    scene_io::Validation::parse(text).map(|_| text.into()).map_err(|e| e.to_string())
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("write a number above 0".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
        assert!(Cli::try_parse_from(["nerf-bench", "--quick", "--only", "kernels,maths", "--out", "x"]).is_ok());
        assert!(Cli::try_parse_from(["nerf-bench", "--only", "weather"]).is_err());
        assert!(Cli::try_parse_from(["nerf-bench", "--seconds", "nan"]).is_err());
        assert!(Cli::try_parse_from(["nerf-bench", "--seconds", "9", "--steps", "9"]).is_err());
        assert!(Cli::try_parse_from(["nerf-bench", "--steps", "0"]).is_err());
        assert!(Cli::try_parse_from(["nerf-bench", "--validation", "every:8+4"]).is_ok());
        assert!(Cli::try_parse_from(["nerf-bench", "--validation", "sometimes"]).is_err());
        assert!(Cli::try_parse_from(["nerf-bench", "--validation", "every:8", "--quick"]).is_err());
        assert!(Cli::try_parse_from(["nerf-bench", "--at-end", "--quick"]).is_err());
    }
}
