//! What is measured, a file a section.

mod budgets;
mod ceilings;
mod cloud_cost;
mod cost;
mod dynamic;
mod growth;
mod kernels;
mod maths;
mod precision;
mod quadrature;
mod scene;
mod splats;
mod tables;
mod training;
mod wild;

use crate::bench::{Bench, Keep, say};
use crate::cli::Cli;
use crate::error::BenchError;
use crate::machine::Machine;
use crate::name::Name;
use crate::page::{self, Item, Section};
use crate::peers;
use clap::ValueEnum;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// Measure a section.
fn section(name: Name, bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    match name {
        Name::Ceilings => ceilings::run(bench),
        Name::Kernels => kernels::run(bench),
        Name::Quadrature => quadrature::run(bench),
        Name::Maths => maths::run(bench),
        Name::Precision => precision::run(bench),
        Name::Tables => tables::run(bench),
        Name::Budgets => budgets::run(bench),
        Name::Growth => growth::run(bench),
        Name::Training => training::run(bench, keep),
        Name::Splats => splats::run(bench, keep),
        Name::WildLego100 => wild::lego100(bench, keep),
        Name::WildLego400 => wild::lego400(bench, keep),
        Name::WildYard => wild::yard(bench, keep),
        Name::WildPlaza => wild::plaza(bench, keep),
        Name::WildReal => wild::real(bench, keep),
        Name::WildCost => wild::cost(bench, keep),
        Name::CloudCost => cloud_cost::run(bench, keep),
        Name::DynamicWorkbench => dynamic::workbench(bench, keep),
        Name::DynamicOrbit => dynamic::orbit(bench, keep),
        Name::DynamicMouth => dynamic::mouth(bench, keep),
        Name::DynamicNr => dynamic::nr(bench, keep),
        Name::DynamicTissue => dynamic::tissue(bench, keep),
        Name::DynamicOrbitExact => dynamic::orbit_exact(bench, keep),
        Name::DynamicOrbitMade => dynamic::orbit_made(bench, keep),
        Name::DynamicWalkExact => dynamic::walk_exact(bench, keep),
        Name::DynamicWalkMade => dynamic::walk_made(bench, keep),
    }
}

/// Run what was asked for; each section is on the disk before the next begins, long ones a row at a time.
pub(crate) fn run(cli: &Cli) -> Result<(), BenchError> {
    check_protocols(&cli.protocol)?;
    let bench = Bench::new(cli)?;
    let machine = Machine::here(bench.pools.most());
    if !cli.peers.is_empty() {
        for page in peers::run(&cli.peers, &cli.out, &machine)? {
            let _ = writeln!(std::io::stdout().lock(), "{}", page.display());
        }
        return index(&cli.out);
    }
    let clock = Instant::now();
    for &name in Name::value_variants().iter().filter(|n| cli.only.is_empty() || cli.only.contains(n)) {
        say(&format!("{:4.0} s  {}", clock.elapsed().as_secs_f64(), name.file()));
        let keep = |so_far: &Section| {
            let mut so_far = measured_on(&bench, so_far.clone());
            so_far.items.push(Item::Text("**Unfinished**: more was to come.".into()));
            page::write(&cli.out, &name.file(), &machine, &so_far)
        };
        let whole = measured_on(&bench, section(name, &bench, &keep)?);
        page::write(&cli.out, &name.file(), &machine, &whole)?;
    }
    index(&cli.out)?;
    say(&format!("{:4.0} s  done", clock.elapsed().as_secs_f64()));
    // A closed pipe is not a failure of ours.
    let _ = writeln!(std::io::stdout().lock(), "{}", cli.out.join("README.md").display());
    Ok(())
}

/// The page that lists all others of a folder.
fn index(out: &Path) -> Result<(), BenchError> {
    let names: Vec<String> = Name::value_variants().iter().map(|n| n.file()).chain(peers::pages(out)).collect();
    page::write_index(out, &names)
}

/// A section that says where validation views were measured.
fn measured_on(bench: &Bench, mut section: Section) -> Section {
    section.items.extend(bench.validation.as_deref().map(|which| {
        Item::Text(format!(
            "Measured on **validation views** (`--validation {which}`) where photos were trained on: held out of the training \
             views, and no test view was looked at."
        ))
    }));
    section
}

/// Refuse names that mean nothing before an hour has passed.
fn check_protocols(wanted: &[String]) -> Result<(), BenchError> {
    let known = || training::names().chain(splats::names()).chain(wild::names()).chain(dynamic::names());
    match wanted.iter().find(|w| known().all(|k| k != w.as_str())) {
        Some(name) => {
            let known: Vec<&str> = known().collect();
            Err(BenchError::Part(format!("`--protocol {name}`: write one of {}", known.join(", "))))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn protocols_are_known_by_name() {
        assert!(check_protocols(&["fern".into(), "yard".into(), "nr".into()]).is_ok());
        assert!(check_protocols(&["moon".into()]).unwrap_err().to_string().contains("lego400"));
    }
}
