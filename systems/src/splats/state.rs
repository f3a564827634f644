//! A training to the arrays of a checkpoint, and back. The number of Gaussians is that of the arrays.

use super::config::SplatConfig;
use super::density::Density;
use super::optimiser::Optimiser;
use engine::system::{SystemError, Tensor, TensorData, TensorMap, f32_tensor, take_counts, take_numbers, u64_tensor};
use optim::NonFiniteGuard;
use splat_core::Gaussians;

/// Everything the next step depends on.
pub(super) fn push<'a>(
    cloud: &'a Gaussians,
    optimiser: &'a Optimiser,
    density: &'a Density,
    (steps, guard): (u64, &NonFiniteGuard),
) -> Vec<Tensor<'a>> {
    let counters = vec![steps, guard.steps(), guard.bad_steps(), guard.entries()];
    let mut out = vec![u64_tensor("splats.steps", counters)];
    for (field, numbers) in cloud.fields() {
        out.push(f32_tensor(name(field.name()), numbers));
    }
    optimiser.push(&mut out);
    density.push(&mut out);
    out
}

/// What [`push`] wrote.
pub(super) fn take(
    state: &TensorMap,
    config: &SplatConfig,
) -> Result<(Gaussians, Optimiser, Density, (u64, NonFiniteGuard)), SystemError> {
    let logits = name("logit");
    let n = match state.get(&logits).map(|t| &t.data) {
        Some(TensorData::F32(logit)) => logit.len(),
        _ => return Err(SystemError::State { name: logits, problem: "32-bit floats expected".into() }),
    };
    let refused = |e: splat_core::SplatError| SystemError::State { name: name(""), problem: e.to_string() };
    let mut cloud = Gaussians::new(n, config.sh_degree).map_err(refused)?;
    for (field, numbers) in cloud.fields_mut() {
        numbers.copy_from_slice(&take_numbers(state, &name(field.name()), numbers.len())?);
    }
    let optimiser = Optimiser::take(state, &cloud)?;
    let density = Density::take(state, config, n)?;
    let counters = take_counts(state, "splats.steps", 4)?;
    let guard = NonFiniteGuard::default().resumed(counters[1], counters[2], counters[3]);
    Ok((cloud, optimiser, density, (counters[0], guard)))
}

fn name(field: &str) -> String {
    format!("splats.{field}")
}
