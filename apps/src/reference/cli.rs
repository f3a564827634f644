//! The page of the command line, from the definitions that also make `--help`.

use super::table::{RENEW, Table};
use crate::app::{App, DYNAMIC, STATIC, WILD};
use crate::cli::Cli;
use clap::{Arg, Command, CommandFactory};
use std::collections::BTreeSet;
use systems::claims::Claim;
use systems::registry::{Family, family};

const APPS: [&App; 3] = [&STATIC, &WILD, &DYNAMIC];

/// The whole page.
pub(super) fn page() -> String {
    let apps = APPS.map(|app| {
        let mut command = Cli::of(app);
        command.build();
        command
    });
    let shared = data_options(&apps[0]);
    let mut page = format!(
        "# The command line\n\n<!-- made of the definitions behind `--help` by `{RENEW}`: change those, not this page -->\n\n\
         Three programs with the same commands and options: {}. Every one takes every system that fits the scene. *Only* a program: its \
         `--help` alone shows the option; the others take it, too, where the system is one of that program's. `PROGRAM COMMAND --help` \
         says the same as this page.\n\n{}\n\
         Exit codes: 0 done; 1 failed, or not everything was written; 2 wrong usage; 130 stopped by SIGINT or SIGTERM, with what was done \
         kept. Results go to standard output, progress and errors to standard error.\n\n## Options of every command\n\n{}\n",
        APPS.map(|app| format!("`{}` ({})", app.name, lower(app.about))).join(", "),
        commands(&apps),
        options(&apps, &[], |arg| arg.is_global_set()),
    );
    for command in visible(&apps) {
        let inside = [command.as_str()];
        let about = of(&apps, &command).and_then(Command::get_about).map(ToString::to_string).unwrap_or_default();
        page.push_str(&format!("## {command}\n\n{about}.{}\n\n", only(&apps, |app| shows_command(app, &command))));
        page.push_str(&format!("```text\n{}\n```\n\n", usage(&apps, &command)));
        let has_data = ["priors", "check", "train", "eval"].contains(&command.as_str());
        let own = options(&apps, &inside, |arg| {
            let elsewhere = has_data && shared.contains(arg.get_id().as_str());
            !arg.is_global_set() && !elsewhere
        });
        page.push_str(&format!("{own}\n"));
        if has_data {
            let what = if command == "eval" { ", with a file of Gaussians" } else { "" };
            page.push_str(&format!("And the options of [reading a dataset](#reading-a-dataset){what}.\n\n"));
        }
    }
    page.push_str(&format!(
        "## Reading a dataset\n\nOptions of `priors`, `check`, `train` and `eval FILE`. Formats, and what is held out of each where nothing is said: \
         [data.md](data.md).\n\n{}\n",
        options(&apps, &["train"], |arg| shared.contains(arg.get_id().as_str())),
    ));
    page.push_str(&systems());
    page.trim_end().to_owned() + "\n"
}

/// Options of `check` that `train` has, too: how a dataset is read.
fn data_options(app: &Command) -> BTreeSet<String> {
    let ids = |name: &str| -> BTreeSet<String> {
        let command = app.find_subcommand(name).into_iter();
        let own = command.flat_map(Command::get_arguments).filter(|arg| !arg.is_global_set() && !arg.is_positional());
        own.map(|arg| arg.get_id().to_string()).filter(|id| id != "help" && id != "version").collect()
    };
    ids("check").intersection(&ids("train")).cloned().collect()
}

/// Names of the commands that some app shows, in the order of `--help`.
fn visible(apps: &[Command]) -> Vec<String> {
    let defined = Cli::command();
    let names = defined.get_subcommands().map(|sub| sub.get_name().to_owned());
    names.filter(|name| name != "help" && apps.iter().any(|app| shows_command(app, name))).collect()
}

fn shows_command(app: &Command, name: &str) -> bool {
    app.find_subcommand(name).is_some_and(|sub| !sub.is_hide_set())
}

/// A command, of the first app that shows it.
fn of<'a>(apps: &'a [Command], name: &str) -> Option<&'a Command> {
    apps.iter().find(|app| shows_command(app, name))?.find_subcommand(name)
}

/// The line of usage.
fn usage(apps: &[Command], name: &str) -> String {
    let command = of(apps, name).cloned().map(|mut command| command.render_usage().to_string());
    command.unwrap_or_default().trim_start_matches("Usage: ").into()
}

/// Which apps have something, where not all do.
fn only(apps: &[Command], has: impl Fn(&Command) -> bool) -> String {
    let names: Vec<String> = apps.iter().filter(|app| has(app)).map(|app| format!("`{}`", app.get_name())).collect();
    if names.len() == apps.len() { String::new() } else { format!(" Only {}.", names.join(" and ")) }
}

/// The table of the commands.
fn commands(apps: &[Command]) -> String {
    let mut table = Table::new(&["command", "what it does"]);
    for name in visible(apps) {
        let about = of(apps, &name).and_then(Command::get_about).map(ToString::to_string).unwrap_or_default();
        let apps = only(apps, |app| shows_command(app, &name));
        table.row([format!("[`{name}`](#{name})"), format!("{about}.{apps}")]);
    }
    table.text()
}

/// The table of the options of a command, those that are wanted.
fn options(apps: &[Command], inside: &[&str], wanted: impl Fn(&Arg) -> bool) -> String {
    let mut table = Table::new(&["option", "default", "meaning"]);
    for id in in_order(inside) {
        let holders: Vec<&Arg> = apps.iter().filter_map(|app| shown(app, inside, &id)).collect();
        let Some(arg) = holders.first().filter(|arg| wanted(arg)) else { continue };
        let mut defaults: Vec<String> = holders.iter().map(|arg| default(arg)).collect();
        defaults.dedup();
        let only = only(apps, |app| shown(app, inside, &id).is_some());
        table.row([typed(arg), defaults.join(", "), format!("{}{only}", meaning(arg))]);
    }
    table.text()
}

/// An option that an app shows.
fn shown<'a>(app: &'a Command, inside: &[&str], id: &str) -> Option<&'a Arg> {
    let command = inside.iter().try_fold(app, |command, name| command.find_subcommand(name))?;
    command.get_arguments().find(|arg| arg.get_id() == id && !arg.is_hide_set())
}

/// The options of a command in the order of `--help`.
fn in_order(inside: &[&str]) -> Vec<String> {
    let defined = Cli::command();
    let own = inside.iter().try_fold(&defined, |command, name| command.find_subcommand(name));
    own.into_iter().flat_map(Command::get_arguments).map(|arg| arg.get_id().to_string()).collect()
}

/// An option as it is typed.
fn typed(arg: &Arg) -> String {
    let names = arg.get_value_names().unwrap_or_default();
    let value = names.first().map(ToString::to_string).unwrap_or_default();
    match arg.get_long() {
        None => format!("`{value}`"),
        Some(long) if arg.get_action().takes_values() => format!("`--{long} {value}`"),
        Some(long) => format!("`--{long}`"),
    }
}

fn default(arg: &Arg) -> String {
    let values: Vec<String> = arg.get_default_values().iter().map(|v| format!("`{}`", v.to_string_lossy())).collect();
    if arg.get_action().takes_values() { values.join(",") } else { String::new() }
}

/// What an option means, with its values where they are a list.
fn meaning(arg: &Arg) -> String {
    // The long text of `--system` lists the systems, which have a section of their own.
    let long = arg.get_long_help().filter(|_| arg.get_id() != "system").or(arg.get_help());
    let text = long.map(ToString::to_string).unwrap_or_default();
    let paragraphs: Vec<&str> = text.split("\n\n").map(|p| p.trim().trim_end_matches('.')).collect();
    let text = format!("{}.", paragraphs.join(". ").replace('\n', " "));
    let values: Vec<String> = (arg.get_possible_values().iter())
        .filter(|value| arg.get_action().takes_values() && !value.is_hide_set())
        .map(|value| match value.get_help() {
            Some(help) if !help.to_string().eq_ignore_ascii_case(value.get_name()) => {
                format!("`{}` ({})", value.get_name(), lower(&help.to_string()))
            }
            _ => format!("`{}`", value.get_name()),
        })
        .collect();
    let names = arg.get_possible_values();
    let said = names.iter().all(|value| text.contains(&format!("`{}`", value.get_name())));
    if values.is_empty() || said { text } else { format!("{text} One of {}.", values.join(", ")) }
}

/// A text that begins small, as within a sentence; abbreviations stay.
fn lower(text: &str) -> String {
    let mut letters = text.chars();
    match (letters.next(), letters.next()) {
        (Some(first), Some(second)) if !second.is_uppercase() && !second.is_ascii_digit() && second != '.' => {
            first.to_lowercase().chain(text.chars().skip(1)).collect()
        }
        _ => text.into(),
    }
}

/// What each system does otherwise than its paper, in full.
fn systems() -> String {
    let mut text = String::from(
        "## Systems\n\nValues of `--system`, and what each does otherwise than the paper it is named after. When to take which: \
         [README](../README.md#systems).\n",
    );
    for (of, app) in [(Family::Static, &STATIC), (Family::Wild, &WILD), (Family::Moving, &DYNAMIC)] {
        text.push_str(&format!("\n### Those of `{}`\n\n", app.name));
        for Claim { name, paper, differs, .. } in family(of).flat_map(|entry| entry.claims()) {
            let paper = if paper.is_empty() { String::new() } else { format!(" ({paper})") };
            text.push_str(&format!("* `{name}`{paper}: {differs}\n"));
        }
    }
    text
}
