//! Which frames are trained on and which are held out.

use crate::files::plain_name;
use crate::listing::listing;
use crate::reading::DialectSplits;
use crate::{ErrorKind, Frame, Holdout, Problem, SceneError, Split};
use std::path::Path;

/// Splits frames as the caller says, else as the dialect does.
pub(crate) fn apply(
    root: &Path,
    frames: &mut [Frame],
    dialect: DialectSplits,
    holdout: Option<&Holdout>,
    notes: &mut Vec<String>,
) -> Result<(), SceneError> {
    let order = by_name(frames);
    match (holdout, dialect) {
        (Some(Holdout::None), _) => set_all(frames, Split::Train),
        (Some(Holdout::Every(0) | Holdout::EveryFrom { every: 0, .. }), _) => {
            let problem = Problem::new("--holdout", "one frame of 0 cannot be held out", "write `every:8` or `none`");
            return Err(SceneError::new(ErrorKind::Split, problem.value("every:0")));
        }
        (Some(Holdout::Every(n)), _) => every(frames, &order, *n, 0),
        (Some(Holdout::EveryFrom { every: n, first }), _) => every(frames, &order, *n, *first),
        (Some(Holdout::Names(names)), _) => by_names(root, frames, names, dialect)?,
        (None, DialectSplits::Explicit) => {}
        (None, _) if frames.len() == 1 => set_all(frames, Split::Train),
        (None, DialectSplits::Every(n)) => {
            every(frames, &order, n, 0);
            notes.push(format!("every {n}th frame by name, from the first, is held out"));
        }
        (None, DialectSplits::NineOfTen) => {
            nine_of_ten(frames, &order);
            notes.push("nine of ten frames by name, evenly spaced, are trained on".into());
        }
    }
    if frames.len() == 1 {
        notes.push("there is a single image: it can be trained on, but it shows no parallax, so no depth".into());
    }
    let count = |split| frames.iter().filter(|f| f.split == split).count();
    let (train, test) = (count(Split::Train), count(Split::Test));
    if train == 0 {
        return Err(empty(root, frames, "no frames are left to train on", "hold fewer frames out"));
    }
    match holdout {
        _ if test > 0 => Ok(()),
        Some(Holdout::Every(_) | Holdout::EveryFrom { .. } | Holdout::Names(_)) => {
            Err(empty(root, frames, "no frames are held out", "use `--holdout none` if that is meant"))
        }
        Some(Holdout::None) => Ok(()),
        None => {
            notes.push(format!("no test frames ({}): nothing will be measured", numbers(frames)));
            Ok(())
        }
    }
}

/// `100 train, 10 val, 25 test`.
pub(crate) fn numbers(frames: &[Frame]) -> String {
    let count = |split| frames.iter().filter(|f| f.split == split).count();
    let mut text = format!("{} frames: {} train", frames.len(), count(Split::Train));
    for split in [Split::Val, Split::Test, Split::Unused] {
        let n = count(split);
        if n > 0 || split == Split::Test {
            text.push_str(&format!(", {n} {}", split.name()));
        }
    }
    text
}

fn empty(root: &Path, frames: &[Frame], what: &str, remedy: &str) -> SceneError {
    let remedy =
        if frames.is_empty() { "check that the dataset lists frames and that their images are there" } else { remedy };
    SceneError::new(ErrorKind::Split, Problem::new(root, format!("{what} ({})", numbers(frames)), remedy))
}

pub(crate) fn by_name(frames: &[Frame]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.sort_by(|a, b| frames[*a].name.cmp(&frames[*b].name));
    order
}

fn set_all(frames: &mut [Frame], split: Split) {
    for frame in frames {
        frame.split = split;
    }
}

fn every(frames: &mut [Frame], order: &[usize], n: usize, first: usize) {
    for (i, frame) in order.iter().enumerate() {
        frames[*frame].split = if i % n == first { Split::Test } else { Split::Train };
    }
}

/// The frames at `linspace(0, n - 1, ceil(0.9 n))`, cut to whole numbers, are trained on.
fn nine_of_ten(frames: &mut [Frame], order: &[usize]) {
    set_all(frames, Split::Test);
    let n = order.len();
    let train = (9 * n).div_ceil(10);
    let step = if train > 1 { (n - 1) as f64 / (train - 1) as f64 } else { 0.0 };
    for i in 0..train {
        let at = if i + 1 == train && train > 1 { n - 1 } else { (i as f64 * step) as usize };
        frames[order[at]].split = Split::Train;
    }
}

/// The named frames are the test split. Other test frames of an explicit split become unused, the rest is trained on.
fn by_names(root: &Path, frames: &mut [Frame], names: &[String], dialect: DialectSplits) -> Result<(), SceneError> {
    let mut held = vec![false; frames.len()];
    for name in names {
        held[find(root, frames, name, "holdout", Split::Test)?] = true;
    }
    for (frame, held) in frames.iter_mut().zip(held) {
        frame.split = match (held, dialect, frame.split) {
            (true, ..) => Split::Test,
            (false, DialectSplits::Explicit, Split::Test) => Split::Unused,
            (false, DialectSplits::Explicit, split) => split,
            (false, ..) => Split::Train,
        };
    }
    Ok(())
}

/// The frame a name means: the first of these that any frame fits: the whole name; the name without extension; the end
/// of the path; the end of the path without extension. Among several, the only one of the split that is `likely`. Errors name the
/// `option`.
pub(crate) fn find(
    root: &Path,
    frames: &[Frame],
    name: &str,
    option: &str,
    likely: Split,
) -> Result<usize, SceneError> {
    let name = plain_name(name);
    let fits: [&dyn Fn(&str) -> bool; 4] =
        [&|n| n == name, &|n| without_extension(n) == without_extension(&name), &|n| is_path_end(n, &name), &|n| {
            is_path_end(without_extension(n), without_extension(&name))
        }];
    let refuse = |what: String, remedy: &str| {
        let problem = Problem::new(root, what, remedy).field(option).value(&name);
        Err(SceneError::new(ErrorKind::Split, problem))
    };
    for fit in fits {
        let found: Vec<usize> = (0..frames.len()).filter(|i| fit(&frames[*i].name)).collect();
        match found.as_slice() {
            [] => {}
            [one] => return Ok(*one),
            several => {
                let meant: Vec<usize> = several.iter().copied().filter(|i| frames[*i].split == likely).collect();
                if let [one] = meant.as_slice() {
                    return Ok(*one);
                }
                let names: Vec<&str> = several.iter().map(|i| frames[*i].name.as_str()).collect();
                return refuse(format!("names several frames: {}", listing(&names)), "write more of the path");
            }
        }
    }
    let mut names: Vec<&str> = frames.iter().map(|f| f.name.as_str()).collect();
    names.truncate(5);
    refuse(
        format!("names no frame of the scene; its frames are called {}", names.join(", ")),
        "correct the name in the list of held-out frames",
    )
}

fn without_extension(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, extension)) if !extension.contains('/') && !stem.is_empty() => stem,
        _ => name,
    }
}

fn is_path_end(name: &str, end: &str) -> bool {
    name.strip_suffix(end).is_some_and(|rest| rest.is_empty() || rest.ends_with('/'))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::{Image, ImageSource};
    use proptest::prelude::*;
    use render_core::camera::{Camera, Pose};
    use std::sync::Arc;

    /// Frames of one pixel with these names and splits.
    pub(crate) fn frames(names: &[(&str, Split)]) -> Vec<Frame> {
        let image = Arc::new(Image::rgb(1, 1, vec![0; 3]).unwrap());
        let camera = Camera::pinhole(1, 1, 1.0, 1.0, 0.5, 0.5, Pose::IDENTITY);
        let frame = |(name, split): &(&str, Split)| Frame {
            split: *split,
            ..Frame::new(*name, ImageSource::Memory(Arc::clone(&image)), camera)
        };
        names.iter().map(frame).collect()
    }

    pub(crate) fn split_of(frames: &[Frame]) -> Vec<Split> {
        frames.iter().map(|f| f.split).collect()
    }

    fn run(frames: &mut [Frame], dialect: DialectSplits, holdout: Option<Holdout>) -> Result<Vec<String>, SceneError> {
        let mut notes = Vec::new();
        apply(Path::new("scene"), frames, dialect, holdout.as_ref(), &mut notes).map(|()| notes)
    }

    use Split::{Test, Train, Unused, Val};

    #[test]
    fn every_counts_in_the_order_of_names() {
        let mut f = frames(&[("c", Train), ("a", Train), ("b", Train), ("d", Train)]);
        run(&mut f, DialectSplits::Every(8), Some(Holdout::Every(2))).unwrap();
        assert_eq!(split_of(&f), [Test, Test, Train, Train]); // a and c
    }

    #[test]
    fn names_leave_other_test_frames_unused() {
        let mut f = frames(&[
            ("train/r_0", Train),
            ("train/r_24", Train),
            ("val/r_0", Val),
            ("test/r_0", Test),
            ("test/r_24", Test),
        ]);
        let names = |n: &[&str]| Some(Holdout::Names(n.iter().map(|s| (*s).to_owned()).collect()));
        run(&mut f, DialectSplits::Explicit, names(&["./test/r_24.png"])).unwrap();
        assert_eq!(split_of(&f), [Train, Train, Val, Unused, Test]);
        // Ambiguous without its folder, except that one of them is a test frame.
        run(&mut f, DialectSplits::Explicit, names(&["r_24"])).unwrap();
        assert_eq!(split_of(&f), [Train, Train, Val, Unused, Test]);
        let error = run(&mut f, DialectSplits::Explicit, names(&["r_0"])).unwrap_err().to_string();
        assert!(error.contains("train/r_0, val/r_0, test/r_0"), "{error}");
        let error = run(&mut f, DialectSplits::Explicit, names(&["r_1"])).unwrap_err().to_string();
        assert!(error.contains("`holdout` = r_1: names no frame"), "{error}");
    }

    #[test]
    fn empty_splits_are_reported_with_their_numbers() {
        let one = [("a", Train)];
        let error = run(&mut frames(&one), DialectSplits::Every(8), Some(Holdout::Every(8))).unwrap_err().to_string();
        assert!(error.contains("no frames are left to train on (1 frames: 0 train, 1 test)"), "{error}");
        let notes = run(&mut frames(&one), DialectSplits::Every(8), None).unwrap();
        assert!(notes.iter().any(|n| n.contains("single image")), "{notes:?}");
        assert!(run(&mut frames(&one), DialectSplits::Every(8), Some(Holdout::None)).is_ok());
        assert!(run(&mut [], DialectSplits::Every(8), None).is_err());
        assert!(run(&mut [], DialectSplits::NineOfTen, None).is_err());
        assert!(run(&mut frames(&[("a", Test)]), DialectSplits::Explicit, None).is_err());
    }

    proptest! {
        #![proptest_config(testkit::property::cases(64))]

        #[test]
        fn nine_of_ten_keeps_both_ends_and_the_share(n in 1_usize..400) {
            let names: Vec<String> = (0..n).map(|i| format!("{i:04}")).collect();
            let mut f = frames(&names.iter().map(|n| (n.as_str(), Train)).collect::<Vec<_>>());
            let order = by_name(&f);
            nine_of_ten(&mut f, &order);
            let train = f.iter().filter(|f| f.split == Train).count();
            prop_assert_eq!(train, (9 * n).div_ceil(10));
            prop_assert!(f[0].split == Train && f[n - 1].split == Train);
        }

        #[test]
        fn every_holds_out_the_rounded_up_share(n in 1_usize..200, every_n in 1_usize..20) {
            let names: Vec<String> = (0..n).map(|i| format!("{i:04}")).collect();
            let mut f = frames(&names.iter().map(|n| (n.as_str(), Train)).collect::<Vec<_>>());
            let order = by_name(&f);
            every(&mut f, &order, every_n, 0);
            prop_assert_eq!(f.iter().filter(|f| f.split == Test).count(), n.div_ceil(every_n));
            let mut starts = 0;
            for first in 0..every_n {
                every(&mut f, &order, every_n, first);
                starts += f.iter().filter(|f| f.split == Test).count();
            }
            prop_assert_eq!(starts, n);
        }
    }
}
