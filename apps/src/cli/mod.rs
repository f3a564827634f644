//! The command line: words others script against. The same words mean the same in every app; see [`crate::app`] for what
//! differs.

mod families;
mod results;
mod training;
mod words;

pub(crate) use families::default_system;
pub(crate) use results::{Eval, Export, Masks, Render, View};
pub(crate) use training::{Check, Data, Demo, Prepare, Priors, Train};
pub(crate) use words::{BackgroundWord, Layer, MeshMethod, ProgressKind, VideoWord};

use crate::app::App;
use clap::error::ErrorKind;
use clap::{Arg, CommandFactory, FromArgMatches, Parser, Subcommand};
use engine::run::DefaultSystem;
use std::any::TypeId;
use std::ffi::OsString;
use std::path::PathBuf;

#[derive(Debug, Parser)]
#[command(version, propagate_version = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,

    /// Threads to use (default: all cores). The result does not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,

    /// Memory that the program may hold at most (default: what the machine has). What does not fit is planned smaller or refused
    ///
    /// Tables, batches, Gaussians and photos held at a time are planned smaller. What a run will need is printed before it starts,
    /// from a few steps of a copy.
    #[arg(long, global = true, value_name = "MIB", value_parser = clap::value_parser!(u64).range(64..=1 << 30))]
    pub(crate) memory: Option<u64>,

    /// How progress is shown
    #[arg(long, global = true, value_enum, default_value_t = ProgressKind::Auto, value_name = "HOW")]
    pub(crate) progress: ProgressKind,

    /// SqueezeNet weights of the LPIPS metric, a safetensors file (or the variable WILDFIELD_LPIPS); without, LPIPS is n/a
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// The whole job on an embedded synthetic scene: train, evaluate, render, report
    Demo(Demo),
    /// Photos or a video to a scene with cameras, which `train` reads
    Prepare(Prepare),
    /// Optical flow between neighbouring photos of a scene that moves, and which pixels move, as files
    Priors(Priors),
    /// Read a dataset; list frames, cameras, splits, priors, problems. Exit code not 0 if it cannot be trained
    Check(Check),
    /// Reconstruct a scene into a run folder
    Train(Box<Train>),
    /// Measure the held-out views of the newest checkpoint, or those of a dataset with a file of Gaussians
    Eval(Box<Eval>),
    /// Render pictures along a camera path
    Render(Render),
    /// Look around in a run or a file of Gaussians on a web page; a run also while it trains
    View(View),
    /// Write points, a mesh, Gaussians or cameras, in the input's frame and scale
    Export(Export),
    /// Write which pixels of the training photos show the place itself, and score that where the truth is known
    Masks(Masks),
}

impl Cli {
    /// The command line of an app. Words that it does not have are not shown, and refused by [`Cli::read`].
    pub(crate) fn of(app: &App) -> clap::Command {
        let mut command = Self::command().name(app.name).about(app.about).mut_subcommand("demo", |demo| {
            demo.mut_arg("out", |out| out.required(false).default_value(app.demo_folder))
        });
        for word in ["demo", "train"] {
            command = command.mut_subcommand(word, |sub| sub.mut_arg("system", |arg| arg.long_help(systems_of(app))));
        }
        command = command.mut_subcommand("train", |train| {
            train.mut_arg("set", |arg| {
                let what = arg.get_help().map(ToString::to_string).unwrap_or_default();
                arg.long_help(format!("{what}\n\n{}", families::part_words()))
            })
        });
        for (word, argument) in families::words_of_others(app.family) {
            command = command.mut_subcommand(word, |sub| match argument {
                Some(argument) => sub.mut_arg(argument, |a| a.hide(true)),
                None => sub.hide(true),
            });
        }
        with_negative_numbers(command)
    }

    /// Read the words of a command line, the program's name first.
    ///
    /// # Errors
    /// What is wrong with them, for the person; `--help` and `--version` come this way, too.
    pub(crate) fn read(app: &App, words: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        let mut command = Self::of(app);
        let matches = command.try_get_matches_from_mut(words)?;
        if let Some(problem) = families::foreign_word(app, &matches) {
            return Err(command.error(ErrorKind::UnknownArgument, problem));
        }
        Self::from_arg_matches(&matches).map_err(|e| e.format(&mut command))
    }
}

/// Options that are numbers take `-3` for one, which would be taken for an option: so the line is said that names the numbers there may be.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let numbers = [
        TypeId::of::<f64>(),
        TypeId::of::<f32>(),
        TypeId::of::<usize>(),
        TypeId::of::<u64>(),
        TypeId::of::<u32>(),
        TypeId::of::<u16>(),
    ];
    let of_number = |arg: Arg| {
        let of = arg.get_value_parser().type_id();
        let is_number = numbers.iter().any(|number| of == *number);
        if is_number { arg.allow_negative_numbers(true) } else { arg }
    };
    command.mut_args(of_number).mut_subcommands(with_negative_numbers)
}

/// The systems of an app, for `--help`: no name of a paper without what is done otherwise here.
fn systems_of(app: &App) -> String {
    let default = match app.default_system {
        DefaultSystem::Chosen(_) => format!("without it {}", families::default_system(app.family)),
        DefaultSystem::Named(name) => format!("without it `{name}`"),
    };
    let own = systems::registry::family(app.family).flat_map(|entry| entry.claims());
    let others = systems::registry::entries().iter().filter(|entry| !entry.families.contains(&app.family));
    let others: Vec<&str> = others.map(|entry| entry.claim.name).collect();
    format!(
        "Method ({default}). What each does otherwise than the paper it is named after:\n\n{}\n\nThe systems of the other apps, \
         where they fit the scene: {}",
        systems::claims::listing(own),
        others.join(", ")
    )
}

#[cfg(test)]
mod tests;
