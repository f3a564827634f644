//! Learning rates nobody should write: a training with finite numbers, or the one error of the guard.

use super::{build, is_sound, says, usual_operation, usual_stage};
use crate::common::{dataset, state_is_finite};
use stress::{Tally, ensure};
use systems::dynamic::SYSTEMS;
use systems::system::SystemError;

const STEPS: u64 = 30;

pub(crate) fn cases(tally: &mut Tally) {
    let (stage, operation) = (usual_stage(), usual_operation());
    let data = [dataset(&stage), dataset(&operation)];
    for name in SYSTEMS {
        let (scene, data) = if name == "endo-nerf" { (&operation, &data[1]) } else { (&stage, &data[0]) };
        for rate in ["lr=0.0", "lr=1e-38", "lr=20.0", "lr=1e4", "lr=1e30", "lr=20.0+warp_lr=100.0+moment_lr=100.0"] {
            let promise = "everything finite, or one error of the guard; 0 is refused by name";
            tally.case(format!("{name}, {rate}"), promise, || {
                let set: Vec<&str> = rate.split('+').chain(["elastic=0.1", "elastic_at=all"]).collect();
                let mut system = match build(name, scene, data, &set) {
                    Ok((system, _)) => system,
                    Err(e) if rate == "lr=0.0" => return says(&e, &["`lr`", "0"]),
                    Err(e) => return Err(e.to_string()),
                };
                for step in 0..STEPS {
                    match system.step(data, step) {
                        Ok(stats) => ensure(stats.nonfinite > 0 || stats.loss.is_finite(), || {
                            format!("step {step}: loss {} without a non-finite gradient", stats.loss)
                        })?,
                        Err(e @ SystemError::NonFinite { .. }) => {
                            says(&e, &["learning rate"])?;
                            return state_is_finite(system.as_ref());
                        }
                        Err(e) => return Err(format!("step {step}: {e}")),
                    }
                    // Never, not even for one step.
                    state_is_finite(system.as_ref()).map_err(|e| format!("step {step}: {e}"))?;
                }
                is_sound(system.as_ref(), data)
            });
        }
    }
}
