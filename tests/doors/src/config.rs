//! What a run is told: `config.toml`, and the words after `--set`, `--holdout` and their like.
//!
//! The first byte of an input says which: `0` the file, `1` words of the command line, one a line.

use crate::folder::Folder;
use crate::{Try, sound};
use engine::camera_path::PathKind;
use engine::eval::EvalAppearance;
use engine::folder::config;
use engine::options::{RunConfig, parse_set};
use scene_io::{Dialect, Holdout, TrainPhotos};

pub(crate) fn open() -> Try {
    let mut folder = Folder::new(vec![("config.toml".into(), None)]);
    Box::new(move |bytes| match bytes {
        [b'0', content @ ..] => {
            folder.replace(b'0', content);
            if let Some(config) = config(folder.path()) {
                try_config(&config);
            }
        }
        [_, content @ ..] => {
            let text = String::from_utf8_lossy(content);
            text.lines().for_each(try_word);
        }
        [] => {}
    })
}

fn try_config(config: &RunConfig) {
    let text = toml::to_string(config).unwrap_or_else(|error| panic!("what is read is written: {error}"));
    let again: RunConfig = toml::from_str(&text).unwrap_or_else(|error| panic!("what is written is read: {error}"));
    // `nan` is not equal to itself.
    assert_eq!(format!("{again:?}"), format!("{config:?}"));
    if let Err(error) = config.data.load_options() {
        sound::one_line(&error.to_string());
    }
    assert!(config.data.image_bytes() >= config.data.image_memory.unwrap_or(0));
}

fn try_word(word: &str) {
    // What somebody types is shown as it is.
    if word.contains(char::is_control) {
        return;
    }
    match parse_set(word) {
        Ok((key, _)) => assert!(!key.is_empty()),
        Err(line) => sound::one_line(&line),
    }
    // Files of names have a door of their own.
    if !word.starts_with("names:") {
        match Holdout::parse(word) {
            Ok(Holdout::EveryFrom { every, first }) => assert!(first < every),
            Ok(Holdout::Every(every)) => assert!(every > 0),
            Ok(_) => {}
            Err(error) => sound::one_line(&error.to_string()),
        }
    }
    if let Err(line) = word.parse::<Dialect>() {
        sound::one_line(&line);
    }
    if let Err(line) = word.parse::<TrainPhotos>() {
        sound::one_line(&line);
    }
    match word.parse::<EvalAppearance>() {
        Ok(appearance) => assert_eq!(appearance.to_string(), word),
        Err(line) => sound::one_line(&line),
    }
    match word.parse::<PathKind>() {
        Ok(PathKind::File(path)) => assert_eq!(path.as_os_str(), word),
        Ok(path) => assert_eq!(path.to_string(), word),
        Err(line) => sound::one_line(&line),
    }
}
