//! What the words of the command line do.

mod baked;
mod check;
mod cloud_file;
mod demo;
mod eval;
mod eval_file;
mod export;
mod film;
mod layers;
mod masks;
pub(crate) mod prepare;
mod priors;
mod render;
mod train;
mod watcher;

use crate::app::App;
use crate::cli::{Cli, Command};
use crate::session::{Done, Failure, Session};

/// Do what the command line says.
pub(crate) fn run(app: &'static App, cli: Cli) -> Result<Done, Failure> {
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global()?;
    }
    if let Some(mib) = cli.memory {
        engine::memory::set_limit(mib << 20);
    }
    let session =
        Session { app, progress: cli.progress, lpips: cli.lpips_weights, threads: cli.threads, memory: cli.memory };
    session.show().begin()?;
    match cli.command {
        Command::Demo(args) => demo::run(&session, args),
        Command::Prepare(args) => prepare::run(&session, &args, cli.threads),
        Command::Priors(args) => priors::run(&session, &args),
        Command::Check(args) => check::run(app, &args),
        Command::Train(args) => train::run(&session, *args),
        Command::Eval(args) => eval::run(&session, &args),
        Command::Render(args) => render::run(&session, &args),
        Command::View(args) => crate::view::run(&session, &args),
        Command::Export(args) => export::run(&session, &args),
        Command::Masks(args) => masks::run(&session, &args),
    }
}
