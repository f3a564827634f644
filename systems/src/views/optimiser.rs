//! Adam over a cloud: a rate for each kind of parameter, and rows that come and go.

use super::cloud_parameters::CloudParameters;
use super::config::StepRates;
use engine::system::{SystemError, Tensor, TensorMap, push_adam, take_adam};
use float_core::Simd;
use optim::{Adam, AdamConfig};
use splat_core::density::{Fresh, Rows};
use splat_core::{Gaussians, MAX_DEGREE, SplatError, rest_len};

/// Kerbl et al., 2023: an epsilon this small makes steps that know no scale of the gradient.
const ADAM: AdamConfig = AdamConfig::DEFAULT.with_eps(1e-15);
/// Names of the groups in checkpoints: fields of the cloud, the last one band by band.
const NAMES: [&str; 8] = ["mean", "log_scale", "wxyz", "logit", "dc", "band1", "band2", "band3"];
/// Name of the group of extra rows.
const EXTRA: &str = "extra";
const LOGIT: usize = 3;

/// Moments of all parameters of a cloud. Bands of spherical harmonics that are not active yet have neither gradient nor
/// moments, so that leaving them out is exact.
#[derive(Clone, Debug)]
pub(super) struct Optimiser {
    groups: Vec<Adam>,
    /// Of the extra rows, where there are any.
    extra: Option<Adam>,
    /// Number of extra rows.
    rows: usize,
}

/// Rows of coefficients of band `degree` (from 1) among those above the constant one.
fn band(degree: usize) -> [usize; 2] {
    [3 * rest_len(degree - 1), 3 * rest_len(degree)]
}

/// Rows of each group.
fn rows(degree: usize) -> impl Iterator<Item = usize> {
    let bands = (1..=degree.min(MAX_DEGREE)).map(|d| band(d)[1] - band(d)[0]);
    [3, 3, 4, 1, 3].into_iter().chain(bands)
}

/// The parameters of each group, in order.
fn groups(cloud: &mut Gaussians) -> Vec<&mut [f32]> {
    let (n, degree) = (cloud.len(), cloud.degree());
    let mut out = Vec::with_capacity(NAMES.len());
    let mut fields = cloud.fields_mut().map(|(_, values)| values).into_iter();
    out.extend(fields.by_ref().take(5));
    for mut rest in fields {
        for d in 1..=degree {
            let [from, to] = band(d);
            let (this, more) = std::mem::take(&mut rest).split_at_mut((to - from) * n);
            out.push(this);
            rest = more;
        }
    }
    out
}

impl Optimiser {
    pub(super) fn new(cloud: &CloudParameters) -> Self {
        let groups = rows(cloud.gaussians.degree()).map(|rows| Adam::new(rows * cloud.len(), ADAM)).collect();
        let extra = (cloud.rows > 0).then(|| Adam::new(cloud.extra.len(), ADAM));
        Self { groups, extra, rows: cloud.rows }
    }

    /// One step of all parameters but the bands above `degree`. Returns how many entries of the gradient were not finite.
    pub(super) fn step(
        &mut self,
        simd: Simd,
        rates: &StepRates,
        degree: usize,
        cloud: &mut CloudParameters,
        gradient: &mut CloudParameters,
    ) -> usize {
        let by_group = rates.groups();
        let mut bad = 0;
        let parameters = groups(&mut cloud.gaussians).into_iter().zip(groups(&mut gradient.gaussians));
        for (k, ((params, grad), adam)) in parameters.zip(&mut self.groups).enumerate().take(5 + degree) {
            if !params.is_empty() {
                bad += adam.step(simd, by_group[k], params, grad);
            }
        }
        if let Some(adam) = self.extra.as_mut().filter(|adam| !adam.is_empty()) {
            bad += adam.step(simd, rates.extra, &mut cloud.extra, &gradient.extra);
        }
        bad
    }

    /// The moments of the Gaussians that are left, and none for new ones.
    pub(super) fn follow(&mut self, changed: &Rows, degree: usize) -> Result<(), SplatError> {
        let groups = self.groups.iter_mut().zip(rows(degree)).chain(self.extra.as_mut().map(|adam| (adam, self.rows)));
        for (adam, rows) in groups {
            let m = changed.apply("moments", adam.first_moment(), rows, Fresh::Is(0.0))?;
            let v = changed.apply("moments", adam.second_moment(), rows, Fresh::Is(0.0))?;
            *adam = restored(adam, m, v);
        }
        Ok(())
    }

    /// Opacities were set: their moments no longer hold.
    pub(super) fn forget_opacity(&mut self) {
        let adam = &mut self.groups[LOGIT];
        let zeros = vec![0.0; adam.len()];
        *adam = restored(adam, zeros.clone(), zeros);
    }

    pub(super) fn push<'a>(&'a self, prefix: &str, out: &mut Vec<Tensor<'a>>) {
        for (name, adam) in NAMES.iter().zip(&self.groups) {
            push_adam(out, &format!("{prefix}{name}"), adam);
        }
        if let Some(adam) = &self.extra {
            push_adam(out, &format!("{prefix}{EXTRA}"), adam);
        }
    }

    /// Take what [`push`](Self::push) wrote, for a cloud of as many Gaussians as this one's.
    pub(super) fn take(&mut self, prefix: &str, state: &TensorMap) -> Result<(), SystemError> {
        for (name, adam) in NAMES.iter().zip(&mut self.groups) {
            *adam = take_adam(state, &format!("{prefix}{name}"), adam)?;
        }
        if let Some(adam) = &mut self.extra {
            *adam = take_adam(state, &format!("{prefix}{EXTRA}"), adam)?;
        }
        Ok(())
    }
}

fn restored(like: &Adam, m: Vec<f32>, v: Vec<f32>) -> Adam {
    Adam::restore(like.config(), m, v, like.steps()).expect("moments of an optimiser stay moments when rows move")
}
