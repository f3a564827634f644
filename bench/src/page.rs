//! Sections as files: `SECTION.md`, a CSV a table, an SVG a plot, and the page that lists them all.

use crate::error::BenchError;
use crate::goals::{self, Goal};
use crate::machine::Machine;
use crate::plot::Plot;
use crate::table::Table;
use std::fs;
use std::path::Path;

/// Around the table of goals, where the list of sections finds it.
const GOALS: &str = "<!-- goals -->";
const GOALS_END: &str = "<!-- end of goals -->";

/// What one section found.
#[derive(Clone, Debug, Default)]
pub(crate) struct Section {
    pub(crate) title: &'static str,
    /// What is compared, and how.
    pub(crate) intro: &'static str,
    pub(crate) items: Vec<Item>,
    pub(crate) goals: Vec<Goal>,
}

/// A part of a section, in order.
#[derive(Clone, Debug)]
pub(crate) enum Item {
    Text(String),
    Table(Table),
    Plot(Plot),
}

/// Write a section's files into `out`; files that an earlier run left for the same tables and plots are replaced.
pub(crate) fn write(out: &Path, name: &str, machine: &Machine, section: &Section) -> Result<(), BenchError> {
    fs::create_dir_all(out).map_err(BenchError::file(out))?;
    let mut text = format!("# {}\n\n{}\n\n{}\n", section.title, made_by(machine), section.intro);
    if let Some(table) = goals::table(&section.goals)? {
        let file = format!("{name}-goals.csv");
        save(&out.join(&file), &table.csv())?;
        text += &format!("\n{} ([{file}]({file}))\n\n{GOALS}\n{}{GOALS_END}\n", table.caption, table.markdown());
    }
    for item in &section.items {
        match item {
            Item::Text(words) => text += &format!("\n{words}\n"),
            Item::Table(table) => {
                let file = format!("{name}-{}.csv", table.name);
                save(&out.join(&file), &table.csv())?;
                text += &format!("\n{} ([{file}]({file}))\n\n{}", table.caption, table.markdown());
            }
            Item::Plot(plot) => {
                let Some(svg) = plot.svg()? else { continue };
                let file = format!("{name}-{}.svg", plot.name);
                save(&out.join(&file), &svg)?;
                text += &format!("\n![{}]({file})\n", plot.title);
            }
        }
    }
    save(&out.join(format!("{name}.md")), &text)
}

/// Write `README.md`: every section that lies in `out`, in the order of `names`, with its targets.
pub(crate) fn write_index(out: &Path, names: &[String]) -> Result<(), BenchError> {
    let mut text = String::from(
        "# nerf-bench\n\nTime against error, and kernels against the ceilings of the machine they ran on. Each section is \
         one run on one machine; figures of different sections are compared with care. Times are medians of repetitions that \
         take turns, so ratios within a table hold on a busy machine too. Errors are against `f64` twins on the same inputs. Rows bear the \
         names of the systems here; none is all of the paper it is named after, and each page says what differs.\n\n\
         **How old they are.** Each page was measured at the commit in its first line; where the code has changed in what it shows, it \
         says so below that line. Verdicts of pages before 2026-11-24 were given by rules that are gone: a part that cost 0 dB counted as \
         \"yes\", and a curve by its best point. Today a part has to be worth 0.3 dB (a tenth of an error of depth) and a curve is \
         judged by its end.\n",
    );
    for name in names {
        let file = out.join(format!("{name}.md"));
        if !file.exists() {
            continue;
        }
        let section = fs::read_to_string(&file).map_err(BenchError::file(&file))?;
        let mut lines = section.lines();
        let title = lines.next().unwrap_or_default().trim_start_matches("# ");
        let made_by = lines.nth(1).unwrap_or_default();
        text += &format!("\n## [{title}]({name}.md)\n\n{made_by}\n");
        if let Some((_, rest)) = section.split_once(GOALS)
            && let Some((goals, _)) = rest.split_once(GOALS_END)
        {
            text += &format!("\n{}\n", goals.trim());
        }
    }
    save(&out.join("README.md"), &text)
}

/// Where the numbers come from, in one line.
fn made_by(machine: &Machine) -> String {
    let Machine { line, commit, date, command } = machine;
    format!("`{command}`, commit {commit}, {date}; {line}.")
}

/// Whole or not at all: pages are rewritten while runs of hours may be stopped.
fn save(path: &Path, text: &str) -> Result<(), BenchError> {
    let unfinished = path.with_extension("unfinished");
    fs::write(&unfinished, text).map_err(BenchError::file(path))?;
    fs::rename(&unfinished, path).map_err(BenchError::file(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_is_written_and_listed_with_its_goals() {
        let folder = tempfile::tempdir().unwrap();
        let machine = Machine { line: "M".into(), commit: "c".into(), date: "d".into(), command: "nerf-bench".into() };
        let mut table = Table::new("t", "Caption.", &["x"]);
        table.row([1.0.into()]).unwrap();
        let goal = Goal {
            work: "sums".into(),
            unit: "M/s",
            figure: 3.0,
            target: 2.0,
            ceiling: None,
            peer: None,
            error: "none".into(),
        };
        let section = Section { title: "Kernels", intro: "How.", items: vec![Item::Table(table)], goals: vec![goal] };
        write(folder.path(), "kernels", &machine, &section).unwrap();
        write_index(folder.path(), &["ceilings", "kernels"].map(String::from)).unwrap();
        let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(read("kernels.md").starts_with("# Kernels\n\n`nerf-bench`, commit c, d; M.\n"));
        assert_eq!(read("kernels-t.csv"), "x\n1\n");
        let index = read("README.md");
        assert!(index.contains("## [Kernels](kernels.md)") && index.contains("| sums | M/s |"), "{index}");
    }
}
