//! Names of the sections, on the command line and of their pages.

use clap::ValueEnum;

/// A section, in the order of the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Name {
    /// What the machine can do: FMA, memory, random reads
    Ceilings,
    /// Networks, grids, compositing, optimiser: time, error, share of the ceiling
    Kernels,
    /// Quadrature rules and samplers: time against error
    Quadrature,
    /// Vector functions against the standard library
    Maths,
    /// f32 against bf16 in networks
    Precision,
    /// Layouts of hash grids: time against the error of a fit
    Tables,
    /// Skipped work: time, bound and true error
    Budgets,
    /// Cost against samples, pixels, table size, width, threads
    Growth,
    /// PSNR over time
    Training,
    /// Gaussians: time and error of the kernels, PSNR over time, error budgets
    Splats,
    /// Perturbed photos of lego, small: what systems for the wild win back
    WildLego100,
    /// The same, larger
    WildLego400,
    /// Things in the way: the same, and masks against the truth
    WildYard,
    /// Appearance and occluders at once
    WildPlaza,
    /// Real photographs of many people
    WildReal,
    /// What a step of each system for the wild costs
    WildCost,
    /// What a step of each cloud costs, part by part
    CloudCost,
    /// A moving scene, path-traced: systems for moving scenes
    DynamicWorkbench,
    /// A moving scene, embedded: the same
    DynamicOrbit,
    /// A thing that opens, splits and closes again, embedded: the same, and ambient coordinates
    DynamicMouth,
    /// A real video
    DynamicNr,
    /// Tissue behind a tool: what masks and measured depth are worth
    DynamicTissue,
    /// Scene flow without each of its parts, with exact priors: orbit, whose camera jumps
    DynamicOrbitExact,
    /// The same with priors made of the photos
    DynamicOrbitMade,
    /// The same of a camera that walks, with exact priors
    DynamicWalkExact,
    /// The same with priors made of the photos
    DynamicWalkMade,
}

impl Name {
    /// Of its page, without extension: as on the command line.
    pub(crate) fn file(self) -> String {
        self.to_possible_value().map_or_else(String::new, |name| name.get_name().to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_section_has_a_page_of_its_own() {
        let mut files: Vec<String> = Name::value_variants().iter().map(|name| name.file()).collect();
        assert!(files.iter().all(|file| !file.is_empty()));
        assert!(["wild-lego100", "dynamic-nr", "ceilings"].iter().all(|page| files.iter().any(|file| file == page)));
        let all = files.len();
        files.sort();
        files.dedup();
        assert_eq!(files.len(), all);
    }
}
