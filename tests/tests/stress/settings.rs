//! Settings that nobody should write: an error that names the setting, or a training that stays finite.

use crate::common::{build, dataset, state_is_finite, tiny_scene, train_psnr};
use engine::system::SystemError;
use stress::{Tally, ensure};

const NGP: &str = "
    near=0.0 near=-1.0 near=nan near=inf near=1e-6 near=1e-38 near=100.0 near=3e38
    lr=0.0 lr=-1.0 lr=nan lr=inf lr=1e-38 lr_tenfold=0.0 lr_tenfold=nan lr_tenfold=1e30 lr_hold=0
    radius=0.0 radius=-1.0 radius=nan radius=inf radius=1e-30 radius=1e30
    step_min=0.0 step_min=nan step_min=1e-6 step_min=1e-30 step_min=1e30 step_cone=-1.0 step_cone=nan step_cone=1.0
    levels=0 levels=33 features=0 features=3 log2_table=2 log2_table=29 n_min=0 n_max=1
    width=0 geometry=0 geometry=1 colour_layers=0 sh_degree=0 sh_degree=5
    occupancy=0 occupancy=7 occupancy=1000 cascades=0 cascades=17 occupancy_every=0 occupancy_times=65 occupancy_times=64
    occupancy_threshold=0.0 occupancy_threshold=nan occupancy_threshold=1e30
    density_bias=nan density_bias=1e30 density_bias=-1e30 density_bias=80.0
    samples_per_ray=0.0 samples_per_ray=nan samples_per_ray=1e-30 batch_samples=0 batch_samples=1 batch_rays=0 batch_rays=1
    weight_decay=-1.0 weight_decay=1.0 huber=-1.0 huber=nan huber=1e-38 nonsense=1";

const NERF: &str = "
    near=0.0 near=-1.0 near=nan near=1e-6 near=1e-38 near=100.0 lr=0.0 lr=nan lr=inf lr=1e-38 lr_decay=0 lr_decay=1
    radius=0.0 radius=nan radius=1e-30 radius=1e30 extent=0.0 extent=nan extent=1e30
    position_octaves=0 position_octaves=32 position_octaves=33 direction_octaves=0 direction_octaves=33
    width=0 width=1 width=2 depth=0 depth=1 coarse=0 coarse=2 coarse=3 fine=0 fine=1 density_noise=-1.0 density_noise=nan
    density_noise=1e30 batch_rays=0 batch_rays=1 nonsense=1";

pub(crate) fn cases(tally: &mut Tally) {
    let scene = tiny_scene(3, 0.82);
    let data = dataset(&scene);
    for (name, list) in [("ngp", NGP), ("nerf", NERF)] {
        for setting in list.split_whitespace() {
            tally.case(
                format!("{name} --set {setting}"),
                "one error that names the setting, or finite numbers",
                || {
                    let mut system = match build(name, &scene, &data, &[setting]) {
                        Ok(system) => system,
                        Err(e) => {
                            let (said, key) = (e.to_string(), setting.split('=').next().unwrap_or_default());
                            return ensure(said.contains(key) && !said.contains('\n'), || format!("said: {said}"));
                        }
                    };
                    for step in 0..4 {
                        match system.step(&data, step) {
                            Ok(_) => {}
                            Err(SystemError::NonFinite { .. }) => return state_is_finite(system.as_ref()),
                            Err(e) => return Err(e.to_string()),
                        }
                    }
                    state_is_finite(system.as_ref())?;
                    train_psnr(system.as_ref(), &data).map(drop)
                },
            );
        }
    }
}
