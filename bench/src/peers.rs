//! Curves of other programs and of ours from the tables that the scripts of `bench/peers` write: a page a scene.

use crate::error::BenchError;
use crate::machine::Machine;
use crate::page::{self, Item, Section};
use crate::plot::{Axis, Plot, Scale, Series};
use crate::table::Table;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// What the pages of scenes begin with.
const STEM: &str = "peers-";

const INTRO: &str = "Other programs and ours on the same machine, photos, split and starting points, scored by the same program \
    (`nerf-static eval FILE --scene SCENE`); how: `bench/peers/README.md`. Seconds are training seconds: from the first step on, without \
    reading photos, writing files and measuring; wall seconds are from the start of the program to the end of the save. Memory is the \
    peak that the operating system counted.";

/// A metric of a row, `None` where it was not measured.
type Metric = fn(&Row) -> Option<f64>;

/// A row of a table: a save of a program.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    peer: String,
    program: String,
    scene: String,
    seconds: f64,
    wall_seconds: Option<f64>,
    steps: f64,
    gaussians: Option<f64>,
    psnr: Option<f64>,
    ssim: Option<f64>,
    lpips: Option<f64>,
    peak_mb: Option<f64>,
}

/// Write a page for each scene of the tables; the paths of the pages.
pub(crate) fn run(tables: &[PathBuf], out: &Path, machine: &Machine) -> Result<Vec<PathBuf>, BenchError> {
    let mut scenes: BTreeMap<String, Vec<Row>> = BTreeMap::new();
    for path in tables {
        let text = fs::read_to_string(path).map_err(BenchError::file(path))?;
        for row in rows(path, &text)? {
            scenes.entry(row.scene.clone()).or_default().push(row);
        }
    }
    let mut written = Vec::new();
    for (scene, rows) in &scenes {
        let name = format!("{STEM}{}", plain(scene));
        page::write(out, &name, machine, &section(scene, rows)?)?;
        written.push(out.join(format!("{name}.md")));
    }
    Ok(written)
}

/// Stems of the pages of scenes that lie in a folder, in the order of their names.
pub(crate) fn pages(out: &Path) -> Vec<String> {
    let names = fs::read_dir(out).into_iter().flatten().flatten().filter_map(|e| e.file_name().into_string().ok());
    let mut pages: Vec<String> = names
        .filter_map(|name| name.strip_suffix(".md").filter(|stem| stem.starts_with(STEM)).map(Into::into))
        .collect();
    pages.sort();
    pages
}

fn section(scene: &str, rows: &[Row]) -> Result<Section, BenchError> {
    let mut table = Table::new(
        "scores",
        "Every save that was scored",
        &["program", "seconds", "wall seconds", "steps", "Gaussians", "PSNR dB", "SSIM", "LPIPS", "peak MB"],
    );
    for row in rows {
        table.row([
            row.program.as_str().into(),
            row.seconds.into(),
            row.wall_seconds.into(),
            row.steps.into(),
            row.gaussians.into(),
            Table::decibels(row.psnr),
            row.ssim.into(),
            row.lpips.into(),
            row.peak_mb.into(),
        ])?;
    }
    let metrics: [(&'static str, &'static str, Metric); 3] = [
        ("psnr", "PSNR of held-out views, dB", |row| row.psnr),
        ("ssim", "SSIM of held-out views", |row| row.ssim),
        ("lpips", "LPIPS of held-out views (less is better)", |row| row.lpips),
    ];
    let mut items = vec![Item::Text(format!("Scene: **{scene}**."))];
    items.extend(metrics.map(|(name, label, metric)| {
        Item::Plot(Plot {
            name,
            title: format!("{scene}: {label}"),
            x: Axis { label: "training seconds", scale: Scale::Log },
            y: Axis { label, scale: Scale::Linear },
            series: series(rows, metric),
        })
    }));
    items.push(Item::Table(table.without_empty_columns()));
    Ok(Section { title: "Beside other programs", intro: INTRO, items, goals: Vec::new() })
}

/// A curve for each program.
fn series(rows: &[Row], metric: Metric) -> Vec<Series> {
    let mut curves: BTreeMap<(&str, &str), Vec<(f64, f64)>> = BTreeMap::new();
    for row in rows {
        let curve = curves.entry((&row.peer, &row.program)).or_default();
        curve.extend(metric(row).map(|value| (row.seconds, value)));
    }
    curves
        .into_iter()
        .filter(|(_, points)| !points.is_empty())
        .map(|((_, program), mut points)| {
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            Series::line(program, points)
        })
        .collect()
}

/// The rows of a table.
fn rows(path: &Path, text: &str) -> Result<Vec<Row>, BenchError> {
    let problem = |what: String| BenchError::Part(format!("`{}`: {what}", path.display()));
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
    let find = |name: &str| {
        let place = header.iter().position(|column| *column == name);
        place.ok_or_else(|| problem(format!("has no column `{name}`; is it a table of bench/peers?")))
    };
    let names = ["peer", "program", "scene"].map(find);
    let [peer, program, scene] = names;
    let (peer, program, scene) = (peer?, program?, scene?);
    let mut numbers = Vec::new();
    for name in ["seconds", "wall_seconds", "steps", "gaussians", "psnr", "ssim", "lpips", "peak_mb"] {
        numbers.push((name, find(name)?));
    }
    let mut found = Vec::new();
    for (at, line) in lines.enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        if cells.len() != header.len() {
            return Err(problem(format!("line {} has {} cells, not {}", at + 2, cells.len(), header.len())));
        }
        let number = |name: &str| -> Result<Option<f64>, BenchError> {
            let cell = numbers.iter().find(|(known, _)| *known == name).map_or("", |(_, place)| cells[*place]);
            match cell.parse::<f64>() {
                Ok(x) if x.is_finite() => Ok(Some(x)),
                _ if cell.is_empty() => Ok(None),
                _ => Err(problem(format!("line {}: {name} is `{cell}`, which is not a number", at + 2))),
            }
        };
        let needed = |name: &str| number(name)?.ok_or_else(|| problem(format!("line {}: {name} is empty", at + 2)));
        found.push(Row {
            peer: cells[peer].into(),
            program: cells[program].into(),
            scene: cells[scene].into(),
            seconds: needed("seconds")?,
            wall_seconds: number("wall_seconds")?,
            steps: needed("steps")?,
            gaussians: number("gaussians")?,
            psnr: number("psnr")?,
            ssim: number("ssim")?,
            lpips: number("lpips")?,
            peak_mb: number("peak_mb")?,
        });
    }
    Ok(found)
}

/// A scene's name as a part of a file name.
fn plain(scene: &str) -> String {
    scene.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "peer,scene,seconds,wall_seconds,steps,gaussians,psnr,ssim,lpips,peak_mb,program\n";

    #[test]
    fn curves_of_two_tables_are_in_one_plot() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(
            path("a.csv"),
            format!("{HEADER}A,lego,2.5,3,10,100,20.5,0.8,,300,A 1.0\nA,lego,5,6,20,200,22,0.9,,300,A 1.0\n"),
        )
        .unwrap();
        fs::write(path("b.csv"), format!("{HEADER}B,lego,3,4,10,,21,0.7,,200,B 2.0\n")).unwrap();
        let machine = Machine { line: "M".into(), commit: "c".into(), date: "d".into(), command: "nerf-bench".into() };
        let written = run(&[path("a.csv"), path("b.csv")], folder.path(), &machine).unwrap();
        assert_eq!(written, [path("peers-lego.md")]);
        let page = fs::read_to_string(&written[0]).unwrap();
        assert!(page.contains("| A 1.0 | 2.50 | 3 | 10 | 100 | 20.50 |") && !page.contains("LPIPS |"), "{page}");
        let plot = fs::read_to_string(path("peers-lego-psnr.svg")).unwrap();
        assert!(plot.contains("A 1.0") && plot.contains("B 2.0"));
        assert!(!path("peers-lego-lpips.svg").exists(), "nothing was measured");
        assert_eq!(pages(folder.path()), ["peers-lego"]);
    }

    #[test]
    fn what_is_wrong_with_a_table_is_said() {
        let wrong = |text: &str| rows(Path::new("x.csv"), text).unwrap_err().to_string();
        assert!(wrong("").contains("no column `peer`"));
        assert!(wrong(&format!("{HEADER}A,lego,2\n")).contains("line 2 has 3 cells"));
        assert!(wrong(&format!("{HEADER}A,lego,soon,,1,,,,,,A\n")).contains("seconds is `soon`"));
        assert!(wrong(&format!("{HEADER}A,lego,,,1,,,,,,A\n")).contains("seconds is empty"));
        assert!(wrong(&format!("{HEADER}A,lego,1,,1,,NaN,,,,A\n")).contains("psnr is `NaN`"));
        assert_eq!(rows(Path::new("x.csv"), HEADER).unwrap(), []);
    }
}
