//! Frames by what people call them: the whole name, the name without its extension, or the end of the path; and what files
//! about them are called.

use crate::error::RunError;
use std::path::Path;

/// Which name is meant by `wanted`: that name itself; else the only one that is `wanted` without its extension or ends
/// with it (`r_0` and `train/r_0` both mean `./train/r_0.png`).
///
/// # Errors
/// [`RunError::Option`] that begins with `option` and names what there is, where none is meant or several are.
pub fn find<'a>(names: &[&'a str], wanted: &str, option: &str) -> Result<usize, RunError> {
    if let Some(exact) = names.iter().position(|name| *name == wanted) {
        return Ok(exact);
    }
    let meant: Vec<usize> = (0..names.len()).filter(|&i| is_meant(names[i], wanted)).collect();
    let of = |indices: &[usize]| listing(&indices.iter().map(|&i| names[i]).collect::<Vec<&'a str>>());
    match meant.as_slice() {
        [one] => Ok(*one),
        [] => {
            let all: Vec<usize> = (0..names.len()).collect();
            Err(RunError::Option(format!("{option}: no such photo; there are {}", of(&all))))
        }
        several => Err(RunError::Option(format!("{option}: may mean {}; write more of the path", of(several)))),
    }
}

/// A frame's name as part of a file name: letters, digits, `-`, `_`, `.`; no extension.
pub(crate) fn stem(name: &str) -> String {
    let name = Path::new(name).with_extension("");
    let clean = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    name.to_string_lossy().chars().map(clean).collect::<String>().trim_start_matches('.').to_string()
}

fn is_meant(name: &str, wanted: &str) -> bool {
    let stem = Path::new(name).with_extension("");
    let ends = |name: &str| name.strip_suffix(wanted).is_some_and(|rest| rest.is_empty() || rest.ends_with('/'));
    !wanted.is_empty() && (ends(name) || ends(&stem.to_string_lossy()))
}

/// The first few of some names.
fn listing(names: &[&str]) -> String {
    const SHOWN: usize = 6;
    let shown = names.iter().take(SHOWN).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    match names.len() {
        0 => "none".into(),
        n if n > SHOWN => format!("{shown} and {} more", n - SHOWN),
        _ => shown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_photo_is_found_by_name_by_stem_and_by_the_end_of_its_path() {
        let names = ["train/r_0.png", "test/r_0.png", "train/r_10.png", "r_10"];
        for (wanted, want) in [("train/r_0.png", 0), ("train/r_0", 0), ("test/r_0", 1), ("r_10", 3), ("r_10.png", 2)] {
            assert_eq!(find(&names, wanted, "`x`").unwrap(), want, "{wanted}");
        }
        for (wrong, part) in [("r_0", "may mean `train/r_0.png`, `test/r_0.png`"), ("_10", "no such"), ("", "no such")]
        {
            let error = find(&names, wrong, "`image:x`").unwrap_err().to_string();
            assert!(error.starts_with("`image:x`: ") && error.contains(part), "{wrong}: {error}");
        }
        assert!(find(&[], "x", "`x`").unwrap_err().to_string().contains("there are none"));
    }
}
