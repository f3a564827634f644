//! Learning rates nobody should write: a training with finite numbers, or the one error of the guard.

use super::{METHODS, build, is_sound, state_is_sound};
use crate::common::{End, dataset, guarded, says, tiny_scene};
use scene_io::{PerturbationKind, perturb};
use stress::Tally;

const STEPS: u64 = 40;

pub(crate) fn cases(tally: &mut Tally) {
    let scene = perturb(tiny_scene(4, 0.82), PerturbationKind::Both, 3);
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
                    match guarded(system.as_mut(), &data, steps, state_is_sound)? {
                        End::Trained => is_sound(system.as_ref(), &data),
                        End::Guarded => Ok(()),
                    }
                });
            }
        }
    }
}
