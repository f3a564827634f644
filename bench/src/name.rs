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
    /// Disturbed photos of lego, small: what systems for the wild win back
    WildLego100,
    /// The same, larger
    WildLego400,
    /// Things in the way: the same, and masks against the truth
    WildYard,
    /// Light and strangers at once
    WildPlaza,
    /// Real photographs of many people
    WildReal,
    /// What a step of each system for the wild costs
    WildCost,
    /// A moving scene, path-traced: systems for moving scenes
    DynamicWorkbench,
    /// A moving scene, embedded: the same
    DynamicOrbit,
    /// A real video
    DynamicNr,
    /// Tissue behind a tool: what masks and measured depth are worth
    DynamicTissue,
}

impl Name {
    /// Of its page, without extension.
    pub(crate) fn file(self) -> &'static str {
        match self {
            Self::Ceilings => "ceilings",
            Self::Kernels => "kernels",
            Self::Quadrature => "quadrature",
            Self::Maths => "maths",
            Self::Precision => "precision",
            Self::Tables => "tables",
            Self::Budgets => "budgets",
            Self::Growth => "growth",
            Self::Training => "training",
            Self::WildLego100 => "wild-lego100",
            Self::WildLego400 => "wild-lego400",
            Self::WildYard => "wild-yard",
            Self::WildPlaza => "wild-plaza",
            Self::WildReal => "wild-real",
            Self::WildCost => "wild-cost",
            Self::DynamicWorkbench => "dynamic-workbench",
            Self::DynamicOrbit => "dynamic-orbit",
            Self::DynamicNr => "dynamic-nr",
            Self::DynamicTissue => "dynamic-tissue",
        }
    }
}
