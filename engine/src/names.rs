//! Frames by what people call them: the whole name, the name without its extension, or the end of the path; and what files
//! about them are called.

use crate::error::RunError;
use std::cmp::Ordering;
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

/// As [`find`], and where no name ends so, the only one that `wanted` is a part of (`0042` means `images/IMG_0042_left.jpg`).
///
/// # Errors
/// As [`find`].
pub fn find_part(names: &[&str], wanted: &str, option: &str) -> Result<usize, RunError> {
    let holding: Vec<usize> = (0..names.len()).filter(|&i| names[i].contains(wanted)).collect();
    let known = names.iter().any(|name| *name == wanted || is_meant(name, wanted));
    match holding.as_slice() {
        _ if known || wanted.is_empty() => find(names, wanted, option),
        [one] => Ok(*one),
        [] => find(names, wanted, option),
        several => {
            let named = listing(&several.iter().map(|&i| names[i]).collect::<Vec<_>>());
            Err(RunError::Option(format!("{option}: may mean {named}; write more of the name")))
        }
    }
}

/// Order of names as people count: runs of digits by their number (`r_2` before `r_10`), everything else by its characters.
pub fn natural(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a.as_bytes(), b.as_bytes());
    let digits = |text: &[u8]| text.iter().take_while(|c| c.is_ascii_digit()).count();
    while let (Some(&x), Some(&y)) = (left.first(), right.first()) {
        let (i, j) = (digits(left), digits(right));
        let order = if i > 0 && j > 0 {
            let number = |text: &[u8]| text.iter().skip_while(|c| **c == b'0').copied().collect::<Vec<u8>>();
            let (p, q) = (number(&left[..i]), number(&right[..j]));
            (left, right) = (&left[i..], &right[j..]);
            p.len().cmp(&q.len()).then(p.cmp(&q))
        } else {
            (left, right) = (&left[1..], &right[1..]);
            x.cmp(&y)
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    left.len().cmp(&right.len()).then_with(|| a.cmp(b))
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

    #[test]
    fn part_of_a_name_is_enough_where_only_one_has_it() {
        let names = ["images/IMG_0042_left.jpg", "images/IMG_0043_left.jpg", "images/IMG_0043_right.jpg", "b/42.jpg"];
        for (wanted, want) in [("0042", 0), ("0043_r", 2), ("42", 3), ("IMG_0042_left", 0), ("b/", 3)] {
            assert_eq!(find_part(&names, wanted, "`x`").unwrap(), want, "{wanted}");
        }
        for (wrong, part) in [
            ("0043", "may mean `images/IMG_0043_left.jpg`, `images/IMG_0043_right.jpg`"),
            ("0050", "no such photo; there are `images/IMG_0042_left.jpg`, "),
            ("", "no such photo"),
        ] {
            let error = find_part(&names, wrong, "`--path hold:x`").unwrap_err().to_string();
            assert!(error.starts_with("`--path hold:x`: ") && error.contains(part), "{wrong}: {error}");
        }
    }

    #[test]
    fn numbers_in_names_are_counted() {
        let mut names =
            vec!["r_10", "r_2", "r_02b", "r_2b", "r", "q_100", "99999999999999999999999", "100000000000000000000000"];
        names.sort_by(|a, b| natural(a, b));
        let want =
            ["99999999999999999999999", "100000000000000000000000", "q_100", "r", "r_2", "r_02b", "r_2b", "r_10"];
        assert_eq!(names, want);
    }
}
