//! `nerf-bench` from the outside: the files of quick sections are there, parse, and hold numbers only.

use assert_cmd::Command;
use std::fs;
use std::path::Path;

fn bench(words: &[&str]) -> std::process::Output {
    Command::cargo_bin("nerf-bench").unwrap().env_remove("WILDFIELD_DATA").args(words).output().unwrap()
}

/// Every cell of a numeric column is a finite number or empty.
fn check_csv(path: &Path) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    // Cells with commas are quoted; what is counted are commas outside of quotes.
    let cells = |line: &str| {
        let mut quoted = false;
        let commas = line.chars().filter(|&c| {
            quoted ^= c == '"';
            c == ',' && !quoted
        });
        commas.count() + 1
    };
    let columns = cells(lines.next().unwrap());
    let mut rows = 0;
    for line in lines {
        assert_eq!(cells(line), columns, "{}: {line}", path.display());
        rows += 1;
    }
    assert!(rows > 0, "{} has no rows", path.display());
    for word in text.split([',', '\n', ' ']) {
        if let Ok(x) = word.parse::<f64>() {
            assert!(x.is_finite(), "{}: {word}", path.display());
        }
    }
}

/// Tables parse, plots are whole, links lead somewhere.
fn check_pages(out: &Path) {
    for entry in fs::read_dir(out).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy();
        let text = fs::read_to_string(&path).unwrap();
        if name.ends_with(".csv") {
            check_csv(&path);
        } else if name.ends_with(".svg") {
            assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>") && !text.contains("NaN"), "{name}");
        } else {
            // Every file that a page names is there; nothing on it is NaN.
            for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
                assert!(out.join(link).exists(), "{name}: {link}");
            }
            assert!(!text.contains("NaN") && !text.contains("| inf"), "{name}");
        }
    }
}

#[test]
fn quick_sections_write_pages_tables_and_plots() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("pages");
    let answer = bench(&["--quick", "--only", "ceilings,quadrature", "--out", out.to_str().unwrap(), "--threads", "1"]);
    let err = String::from_utf8_lossy(&answer.stderr).into_owned();
    assert!(answer.status.success(), "{err}");
    assert!(String::from_utf8_lossy(&answer.stdout).trim_end().ends_with("README.md"));
    assert!(err.contains("ceilings") && err.contains("done"), "{err}");

    let names: Vec<String> =
        fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    for expected in [
        "README.md",
        "ceilings.md",
        "ceilings-ceilings.csv",
        "quadrature.md",
        "quadrature-orders.csv",
        "quadrature-bumps.svg",
    ] {
        assert!(names.iter().any(|n| n == expected), "{expected} is not in {names:?}");
    }
    check_pages(&out);
    let index = fs::read_to_string(out.join("README.md")).unwrap();
    assert!(index.contains("(ceilings.md)") && !index.contains("(kernels.md)"), "{index}");
    assert!(index.contains("--quick --only ceilings,quadrature"), "the command is on the page");

    // A second run of one section leaves the other's page alone and on the list.
    let before = fs::read(out.join("ceilings.md")).unwrap();
    let answer = bench(&["--quick", "--only", "quadrature", "--out", out.to_str().unwrap(), "--threads", "1"]);
    assert!(answer.status.success());
    assert_eq!(fs::read(out.join("ceilings.md")).unwrap(), before);
    assert!(fs::read_to_string(out.join("README.md")).unwrap().contains("(ceilings.md)"));
}

#[test]
fn what_cannot_be_done_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "in the way").unwrap();
    for (words, code, part) in [
        (&["--only", "weather"][..], 2, "weather"),
        (&["--quick", "--only", "training", "--protocol", "moon"], 1, "moon"),
        (&["--quick", "--only", "training", "--data", "/nowhere"], 1, "/nowhere"),
        (&["--quick", "--only", "ceilings", "--threads", "1", "--out", file.to_str().unwrap()], 1, "file"),
    ] {
        let answer = bench(words);
        let err = String::from_utf8_lossy(&answer.stderr).into_owned();
        assert_eq!(answer.status.code(), Some(code), "{words:?}: {err}");
        assert!(err.contains(part) && !err.contains("panicked"), "{words:?}: {err}");
        assert_eq!(err.lines().filter(|l| l.starts_with("error: ")).count(), 1, "{err}");
    }
}

#[test]
fn missing_datasets_are_skipped_loudly() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("pages");
    let data = folder.path().to_str().unwrap();
    let answer = bench(&["--only", "training", "--protocol", "fern", "--data", data, "--out", out.to_str().unwrap()]);
    let err = String::from_utf8_lossy(&answer.stderr).into_owned();
    assert!(answer.status.success(), "{err}");
    assert!(err.contains("SKIPPED: fern"), "{err}");
    let answer = bench(&["--only", "dynamic-nr", "--data", data, "--out", out.to_str().unwrap()]);
    let err = String::from_utf8_lossy(&answer.stderr).into_owned();
    assert!(answer.status.success() && err.contains("SKIPPED: nr"), "{err}");
    assert!(fs::read_to_string(out.join("dynamic-nr.md")).unwrap().contains("**Not run**"));
}

#[test]
fn the_page_of_splats_has_times_with_errors_and_both_systems() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("pages");
    let answer = bench(&["--quick", "--only", "splats", "--threads", "2", "--out", out.to_str().unwrap()]);
    let err = String::from_utf8_lossy(&answer.stderr).into_owned();
    assert!(answer.status.success(), "{err}");
    check_pages(&out);
    let rows = |name: &str| {
        let text = fs::read_to_string(out.join(format!("splats-{name}.csv"))).unwrap();
        text.lines().skip(1).map(|l| l.split(',').map(String::from).collect()).collect::<Vec<Vec<String>>>()
    };
    // Six parts of a step, a step and a render of two clouds, at two sizes.
    let kernels = rows("kernels");
    assert_eq!(kernels.len(), 2 * (6 + 4));
    for row in fs::read_to_string(out.join("splats-kernels.csv")).unwrap().lines().skip(1) {
        let cells: Vec<&str> = row.rsplit(',').take(5).collect();
        let [_, error, _, all, one] = cells[..] else { panic!("{row}") };
        assert!(one.parse::<f64>().unwrap() > 0.0 && all.parse::<f64>().unwrap() > 0.0, "{row}");
        if row.contains("optimiser") {
            assert_eq!(error, "", "{row}");
        } else {
            let error = error.parse::<f64>().unwrap();
            assert!(error > 0.0 && error < 1e-2, "{row}");
        }
    }
    assert_eq!(rows("systems").iter().map(|r| r[1].as_str()).collect::<Vec<_>>(), ["splat", "ngp"]);
    assert_eq!(rows("budgets").len(), 4);
    assert_eq!(rows("skips").len(), 4 * 3);
}

#[test]
fn pages_of_moving_scenes_have_a_row_a_system_and_end_finished() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("pages");
    let only = "dynamic-orbit,dynamic-mouth,dynamic-nr";
    let answer = bench(&["--quick", "--only", only, "--steps", "4", "--out", out.to_str().unwrap()]);
    let err = String::from_utf8_lossy(&answer.stderr).into_owned();
    assert!(answer.status.success(), "{err}");
    check_pages(&out);
    let table = fs::read_to_string(out.join("dynamic-orbit-systems.csv")).unwrap();
    assert!(
        table.starts_with("system,not as published,train / test views,steps,seconds,PSNR,moving,still,SSIM,"),
        "{table}"
    );
    let systems: Vec<&str> = table.lines().skip(1).map(|line| line.split(',').next().unwrap()).collect();
    assert_eq!(systems[..6], ["ngp", "t-nerf", "d-nerf", "nerfies", "hypernerf", "tineuvox"]);
    assert!(systems.len() > 6 && table.lines().skip(1).all(|line| line.contains("12 / 2,4,")), "{table}");
    let curves = fs::read_to_string(out.join("dynamic-orbit-curves.csv")).unwrap();
    assert_eq!(curves.lines().count(), table.lines().count());
    let page = fs::read_to_string(out.join("dynamic-orbit.md")).unwrap();
    assert!(page.contains("dynamic-orbit-time.svg") && !page.contains("Unfinished"), "{page}");
    let mouth = fs::read_to_string(out.join("dynamic-mouth-systems.csv")).unwrap();
    for row in ["hypernerf,", "\"hypernerf, no ambient coordinates\","] {
        assert!(mouth.lines().any(|line| line.starts_with(row)), "{row} {mouth}");
    }
    let video = fs::read_to_string(out.join("dynamic-nr.md")).unwrap();
    assert!(video.contains("A quick run") && !video.contains('|'), "files are not read in quick runs: {video}");
}
