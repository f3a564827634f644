//! Learning rates nobody should write: a training with finite numbers, or the one error of the guard.

use super::{METHODS, build, is_sound, says, state_is_sound};
use crate::common::{dataset, tiny_scene};
use scene_io::{Disturbance, perturb};
use stress::{Tally, ensure};
use systems::system::SystemError;

const STEPS: u64 = 40;

pub(crate) fn cases(tally: &mut Tally) {
    let scene = perturb(tiny_scene(4, 0.82), Disturbance::Both, 3);
    let data = dataset(&scene);
    for name in METHODS {
        for rate in ["lr=0.0", "lr=1e-38", "lr=20.0", "lr=1e4", "lr=1e30"] {
            let fields: &[&[&str]] = if rate == "lr=1e4" && name != "hugs" { &[&[], &["field=mlp"]] } else { &[&[]] };
            for field in fields {
                let promise = "everything finite, or one error of the guard; 0 is refused by name";
                tally.case(format!("{name} {field:?}, {rate}"), promise, || {
                    let set: Vec<&str> = field.iter().copied().chain([rate]).collect();
                    let mut system = match build(name, &scene, &data, &set) {
                        Ok(system) => system,
                        Err(e) if rate == "lr=0.0" => return says(&e, &["`lr`", "0"]),
                        Err(e) => return Err(e.to_string()),
                    };
                    let steps = if field.is_empty() { STEPS } else { STEPS / 4 };
                    for step in 0..steps {
                        match system.step(&data, step) {
                            Ok(stats) => ensure(stats.nonfinite > 0 || stats.loss.is_finite(), || {
                                format!("step {step}: loss {} without a non-finite gradient", stats.loss)
                            })?,
                            Err(e @ SystemError::NonFinite { .. }) => {
                                says(&e, &["learning rate"])?;
                                return state_is_sound(system.as_ref());
                            }
                            Err(e) => return Err(format!("step {step}: {e}")),
                        }
                        // Never, not even for one step.
                        state_is_sound(system.as_ref()).map_err(|e| format!("step {step}: {e}"))?;
                    }
                    is_sound(system.as_ref(), &data)
                });
            }
        }
    }
}
