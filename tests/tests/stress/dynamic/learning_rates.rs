//! Learning rates nobody should write: a training with finite numbers, or the one error of the guard.

use super::{build, has_part, is_sound, usual_operation, usual_stage};
use crate::common::{End, dataset, guarded, says, state_is_finite};
use stress::Tally;
use systems::registry::{Family, names};

const STEPS: u64 = 30;

pub(crate) fn cases(tally: &mut Tally) {
    let (stage, operation) = (usual_stage(), usual_operation());
    let data = [dataset(&stage), dataset(&operation)];
    for name in names(Family::Moving) {
        let (scene, data) = if name == "endo-nerf" { (&operation, &data[1]) } else { (&stage, &data[0]) };
        for rate in ["lr=0.0", "lr=1e-38", "lr=20.0", "lr=1e4", "lr=1e30", "lr=20.0+warp_lr=100.0+time_code_lr=100.0"] {
            let promise = "everything finite, or one error of the guard; 0 is refused by name";
            tally.case(format!("{name}, {rate}"), promise, || {
                let set = rate.split('+').chain(["elastic=0.1", "elastic_at=all"]);
                let set: Vec<&str> = set.filter(|setting| has_part(name, setting)).collect();
                let mut system = match build(name, scene, data, &set) {
                    Ok((system, _)) => system,
                    Err(e) if rate == "lr=0.0" => return says(&e, &["`lr`", "0"]),
                    Err(e) => return Err(e.to_string()),
                };
                match guarded(system.as_mut(), data, STEPS, state_is_finite)? {
                    End::Trained => is_sound(system.as_ref(), data),
                    End::Guarded => Ok(()),
                }
            });
        }
    }
}
