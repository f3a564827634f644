//! The crate without an app: `prepare_scene VIDEO|FOLDER SCENE`, with progress on standard error.

use prepare::{Event, Request, Toolbox, UnknownCameras, Watch, prepare};
use std::process::ExitCode;

struct Lines;

impl Watch for Lines {
    fn event(&mut self, event: Event<'_>) {
        match event {
            Event::Note(text) => eprintln!("{text}"),
            Event::Warning(text) => eprintln!("warning: {text}"),
            Event::Part { stage, done, of, .. } => eprintln!("{stage}: {done} of {of}"),
            _ => {}
        }
    }
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [input, out] = &words[..] else {
        eprintln!("usage: prepare_scene VIDEO|FOLDER SCENE");
        return ExitCode::from(2);
    };
    let request = Request {
        input: input.into(),
        out: out.into(),
        frames: 100,
        longest_side: Some(1600),
        with: None,
        unknown_cameras: UnknownCameras::Shared,
        threads: None,
        tools: Toolbox::from_env(),
    };
    match prepare(&request, &mut Lines) {
        Ok(summary) => {
            println!("{summary:?}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
