//! What was to be reached, and what another program takes: measured before on a machine of the class, for the start of fox135.

/// What is timed as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Work {
    Render,
    Step,
}

impl Work {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Render => "render in all",
            Self::Step => "training step in all",
        }
    }
}

/// A whole at a size, milliseconds.
pub(super) struct Target {
    pub(super) work: Work,
    /// Of 135x240 along each axis.
    pub(super) scale: u32,
    /// Of 100 k Gaussians, not 11 k.
    pub(super) larger: bool,
    pub(super) target: Option<f64>,
    /// OpenSplat 1.1.5 on the CPU.
    pub(super) peer: Option<f64>,
}

/// The Gaussians that the targets are about, at least.
pub(super) const GAUSSIANS: usize = 11_000;
/// Second core, speed-up of a training step: aimed at, and OpenSplat's.
pub(super) const SECOND_CORE: (f64, f64) = (1.9, 1.12);

#[rustfmt::skip]
pub(super) const TARGETS: [Target; 7] = [
    Target { work: Work::Step, scale: 1, larger: false, target: Some(10.0), peer: Some(145.0) },
    Target { work: Work::Step, scale: 4, larger: false, target: Some(20.0), peer: Some(2000.0) },
    Target { work: Work::Step, scale: 4, larger: true, target: Some(60.0), peer: None },
    Target { work: Work::Render, scale: 1, larger: false, target: None, peer: Some(63.0) },
    Target { work: Work::Render, scale: 4, larger: false, target: Some(25.0), peer: Some(1250.0) },
    Target { work: Work::Render, scale: 1, larger: true, target: None, peer: None },
    Target { work: Work::Render, scale: 4, larger: true, target: Some(50.0), peer: None },
];
