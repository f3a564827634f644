//! A row of a page, and what is expected of it.

/// A system with its settings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    pub(super) name: &'static str,
    pub(super) system: &'static str,
    /// TOML.
    pub(super) set: &'static str,
    /// The same in quick runs besides: what makes it small.
    pub(super) quick: &'static str,
    /// The row whose steps this one does: a part is taken out, nothing else may differ.
    pub(super) without: Option<&'static str>,
    /// Whether motion masks are read where there are any.
    pub(super) masks: bool,
    /// Whether a picture takes minutes: few held-out views are measured, at the end alone.
    pub(super) slow: bool,
    pub(super) aims: &'static [Aim],
}

/// What was planned; others are named as their rows are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Aim {
    /// PSNR of things that move, above that of another, dB at least.
    Moving(&'static str, f64),
    /// PSNR above that of another, dB at least.
    Over(&'static str, f64),
    /// The time another took to its last PSNR, as a multiple of the time to reach that.
    Faster(&'static str, f64),
    /// Rays a second.
    Rays(f64),
    /// Held-out PSNR of `psnr` dB at least at the last measurement within `seconds` of training. A better one before that does not count.
    Within { seconds: f64, psnr: f64 },
    /// Its PSNR below that of the row it takes a part out of, dB at least.
    Costs(f64),
    /// The same of what was hidden.
    HiddenCosts(f64),
    /// Its error of depth of what was hidden, as a multiple of that of the row it takes a part out of.
    DepthCosts(f64),
}

impl Entry {
    pub(super) const fn new(system: &'static str) -> Self {
        Self { name: system, system, set: "", quick: "", without: None, masks: true, slow: false, aims: &[] }
    }

    /// The same under another name.
    pub(super) const fn named(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    pub(super) const fn quick(self, quick: &'static str) -> Self {
        Self { quick, ..self }
    }

    pub(super) const fn set(self, set: &'static str) -> Self {
        Self { set, ..self }
    }

    /// The same system with a part taken out.
    pub(super) const fn without(self, name: &'static str, set: &'static str) -> Self {
        Self { name, set, without: Some(self.name), aims: &[], ..self }
    }

    /// The same without motion masks.
    pub(super) const fn blind(self) -> Self {
        Self { masks: false, ..self }
    }

    /// The same, whose pictures take minutes.
    pub(super) const fn slow(self) -> Self {
        Self { slow: true, ..self }
    }

    pub(super) const fn aims(self, aims: &'static [Aim]) -> Self {
        Self { aims, ..self }
    }
}
