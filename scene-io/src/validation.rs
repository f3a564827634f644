//! Training frames that are held out to choose settings by, so that test frames are left for the last word.

use crate::options::VALIDATION;
use crate::splits::{by_name, find};
use crate::{ErrorKind, Frame, Holdout, Problem, Scene, SceneError, Split, Validation};
use std::path::Path;

impl Scene {
    /// Hold training frames out for choosing settings, as [`crate::LoadOptions::validation`] does while reading.
    ///
    /// # Errors
    /// [`crate::ErrorKind::Split`] where nothing would be held out or nothing be left to train on, and for names of frames that
    /// are not trained on.
    pub fn hold_for_validation(&mut self, validation: &Validation) -> Result<(), SceneError> {
        apply(&self.root, &mut self.frames, validation, &mut self.notes)
    }
}

/// Make validation frames of training frames as `validation` says. Test frames stay test frames: who measures validation frames
/// leaves them alone. Validation frames that the dataset has besides become unused, unless they are what is asked for.
pub(crate) fn apply(
    root: &Path,
    frames: &mut [Frame],
    validation: &Validation,
    notes: &mut Vec<String>,
) -> Result<(), SceneError> {
    let refuse = |what: String, remedy: &str| {
        Err(SceneError::new(ErrorKind::Split, Problem::new(root, what, remedy).field(VALIDATION)))
    };
    let count = |frames: &[Frame], split| frames.iter().filter(|f| f.split == split).count();
    let all = count(frames, Split::Train);
    let held = match validation {
        Validation::Dataset => None,
        Validation::Frames(Holdout::None) => return Ok(()),
        Validation::Frames(Holdout::Every(n)) => Some(every(frames, *n, 0)),
        Validation::Frames(Holdout::EveryFrom { every: n, first }) => Some(every(frames, *n, *first)),
        Validation::Frames(Holdout::Names(names)) => Some(named(root, frames, names)?),
    };
    if let Some(held) = held {
        frames.iter_mut().filter(|f| f.split == Split::Val).for_each(|f| f.split = Split::Unused);
        held.into_iter().for_each(|i| frames[i].split = Split::Val);
    }
    match (count(frames, Split::Train), count(frames, Split::Val)) {
        (0, _) => refuse(format!("no frames are left to train on, of {all}"), "hold fewer frames out"),
        (_, 0) if *validation == Validation::Dataset => {
            refuse("the dataset has no validation split of its own".into(), "write `--validation every:8`")
        }
        (_, 0) => {
            let what = format!("none of the {all} training frames is held out");
            refuse(what, "use `--validation none` if that is meant")
        }
        (_, n) => {
            let of = match validation {
                Validation::Dataset => "the dataset's own split".into(),
                Validation::Frames(_) => format!("of {all} training frames"),
            };
            let left = match count(frames, Split::Test) {
                0 => String::new(),
                tests => format!("; the {tests} test frames are not used"),
            };
            notes.push(format!("validation: {n} frames are held out and measured ({of}){left}"));
            Ok(())
        }
    }
}

/// One of `n` training frames in the order of their names, from the one at `first` on.
fn every(frames: &[Frame], n: usize, first: usize) -> Vec<usize> {
    let training = by_name(frames).into_iter().filter(|i| frames[*i].split == Split::Train);
    training.skip(first).step_by(n.max(1)).collect()
}

/// The frames that names mean; each has to be a training frame.
fn named(root: &Path, frames: &[Frame], names: &[String]) -> Result<Vec<usize>, SceneError> {
    let held = |name: &String| {
        let i = find(root, frames, name, VALIDATION, Split::Train)?;
        if frames[i].split == Split::Train {
            return Ok(i);
        }
        let what =
            format!("is a {} frame, and validation frames are held out of those trained on", frames[i].split.name());
        let problem = Problem::new(root, what, "name training frames").field(VALIDATION).value(name);
        Err(SceneError::new(ErrorKind::Split, problem))
    };
    names.iter().map(held).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splits::tests::{frames, split_of};
    use Split::{Test, Train, Unused, Val};
    use proptest::prelude::*;

    fn run(frames: &mut [Frame], word: &str) -> Result<Vec<String>, SceneError> {
        let mut notes = Vec::new();
        apply(Path::new("scene"), frames, &Validation::parse(word)?, &mut notes).map(|()| notes)
    }

    #[test]
    fn validation_frames_come_from_those_trained_on_and_test_frames_stay() {
        let all = [("d", Train), ("a", Test), ("b", Train), ("c", Train), ("e", Val), ("f", Train)];
        let mut f = frames(&all);
        let notes = run(&mut f, "every:2").unwrap(); // Of b, c, d, f: b and d.
        assert_eq!(split_of(&f), [Val, Test, Val, Train, Unused, Train]);
        assert!(notes[0].contains("2 frames") && notes[0].contains("of 4 training frames"), "{notes:?}");
        assert!(notes[0].contains("1 test frames are not used"), "{notes:?}");
        let mut f = frames(&all);
        run(&mut f, "every:2+1").unwrap();
        assert_eq!(split_of(&f), [Train, Test, Train, Val, Unused, Val]);
        let mut f = frames(&all);
        run(&mut f, "dataset").unwrap();
        assert_eq!(split_of(&f), [Train, Test, Train, Train, Val, Train]);
        let mut f = frames(&all);
        assert!(run(&mut f, "none").unwrap().is_empty());
        assert_eq!(split_of(&f), all.map(|(_, split)| split));
    }

    #[test]
    fn names_have_to_be_those_of_training_frames() {
        let folder = tempfile::tempdir().unwrap();
        let named = |names: &str| {
            let file = folder.path().join("names.txt");
            std::fs::write(&file, names).unwrap();
            let mut f = frames(&[("train/r_0", Train), ("train/r_1", Train), ("test/r_0", Test), ("test/r_9", Test)]);
            run(&mut f, &format!("names:{}", file.display())).map(|_| split_of(&f))
        };
        assert_eq!(named("train/r_1.png\n").unwrap(), [Train, Val, Test, Test]);
        assert_eq!(named("r_0\n").unwrap(), [Val, Train, Test, Test], "the training frame of that name");
        for (names, part) in [("r_9", "is a test frame"), ("r_7", "names no frame"), ("r_0\nr_1", "no frames are left")]
        {
            let error = named(names).unwrap_err().to_string();
            assert!(error.contains("--validation") && error.contains(part), "{error}");
        }
    }

    #[test]
    fn what_holds_nothing_or_everything_out_is_refused() {
        let two = [("a", Train), ("b", Train)];
        for (word, part) in [
            ("every:1", "no frames are left to train on, of 2"),
            ("every:9+5", "none of the 2 training frames"),
            ("dataset", "no validation split of its own"),
            ("every:0", "one frame of 0"),
            ("sometimes", "--validation"),
        ] {
            let error = run(&mut frames(&two), word).unwrap_err().to_string();
            assert!(error.contains(part), "{word}: {error}");
        }
    }

    proptest! {
        #![proptest_config(testkit::property::cases(64))]

        #[test]
        fn every_nth_of_the_training_frames_is_held_out(n in 2_usize..150, step in 2_usize..20, tests in 0_usize..9) {
            let names: Vec<String> = (0..n + tests).map(|i| format!("{i:04}")).collect();
            let split = |i| if i % 3 == 1 && i / 3 < tests { Test } else { Train };
            let mut f = frames(&names.iter().enumerate().map(|(i, n)| (n.as_str(), split(i))).collect::<Vec<_>>());
            let before = split_of(&f);
            let all = before.iter().filter(|s| **s == Train).count();
            run(&mut f, &format!("every:{step}")).unwrap();
            prop_assert_eq!(f.iter().filter(|f| f.split == Val).count(), all.div_ceil(step));
            let kept = |(a, b): (&Split, Split)| *a == b || (*a, b) == (Train, Val);
            prop_assert!(before.iter().zip(split_of(&f)).all(kept));
        }
    }
}
