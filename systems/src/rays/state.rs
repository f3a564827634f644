//! What a checkpoint holds.

use super::driver::RaySystem;
use crate::fields::Names;
use engine::system::{
    SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_counts, take_numbers, u64_tensor,
};
use optim::{Adam, NonFiniteGuard};

/// Name of the place in the schedule.
const COURSE: &str = "field.position";

/// Of the field's features.
fn field_names() -> Names {
    Names::new("field.grid", "grid")
}

pub(super) fn save(driver: &RaySystem) -> Vec<Tensor<'_>> {
    let f = &driver.field;
    let mut out = vec![
        f32_tensor("field.density", &f.density_params),
        f32_tensor("field.colour", &f.colour_params),
        u64_tensor(
            "counters",
            vec![
                driver.rays as u64,
                driver.sampler.updates(),
                driver.guard.steps(),
                driver.guard.bad_steps(),
                driver.guard.entries(),
            ],
        ),
    ];
    f.features.push_state(&field_names(), &mut out);
    push_adam(&mut out, "density", &driver.density_adam);
    push_adam(&mut out, "colour", &driver.colour_adam);
    if let Some(head) = &driver.head {
        out.push(f32_tensor("field.head", &head.params));
        push_adam(&mut out, "head", &head.adam);
    }
    out.extend(driver.errors.iter().flat_map(|map| map.state()));
    out.extend(driver.cues.iter().flat_map(|cues| cues.state()));
    out.extend(f.deform.iter().flat_map(|deform| deform.state()));
    out.extend(driver.movers_state());
    out.extend(driver.photo_model.iter().flat_map(|photo_model| photo_model.state()));
    driver.sampler.push_state(&mut out);
    out.extend(driver.course.state(COURSE));
    out
}

/// All arrays are read and checked before the first is put in its place.
pub(super) fn load(driver: &mut RaySystem, tensors: &TensorMap) -> Result<(), SystemError> {
    let f = &driver.field;
    let counters = take_counts(tensors, "counters", 5)?;
    let course = driver.course.restored(tensors, COURSE)?;
    let done = course.done(counters[2]);
    let features = f.features.restored(&field_names(), tensors, done)?;
    let density = take_numbers(tensors, "field.density", f.density_params.len())?;
    let colour = take_numbers(tensors, "field.colour", f.colour_params.len())?;
    let refused = |name: &str, problem: String| Err(SystemError::State { name: name.into(), problem });
    let most = driver.config.batch.batch_rays;
    if counters[0] == 0 || counters[0] > most as u64 {
        return refused("counters", format!("{} rays a step; 1 to {most} expected (`batch_rays`)", counters[0]));
    }
    let adam = |name: String, old: &Adam| take_adam(tensors, &name, old);
    let density_adam = adam("density".into(), &driver.density_adam)?;
    let colour_adam = adam("colour".into(), &driver.colour_adam)?;
    let head = driver.head.as_ref().map(|old| {
        Ok::<_, SystemError>((take_numbers(tensors, "field.head", old.params.len())?, adam("head".into(), &old.adam)?))
    });
    let head = head.transpose()?;
    let sampler = driver.sampler.read_state(tensors, counters[1], done)?;

    if let Some(map) = &mut driver.errors {
        map.load_state(tensors)?;
    }
    if let Some(cues) = &mut driver.cues {
        cues.load_state(tensors)?;
    }
    if let Some(deform) = &mut driver.field.deform {
        deform.load_state(tensors)?;
    }
    if let Some(photo_model) = &mut driver.photo_model {
        photo_model.load_state(tensors)?;
    }
    driver.load_movers(tensors, done)?;
    (driver.field.features, driver.field.density_params, driver.field.colour_params) = (features, density, colour);
    (driver.density_adam, driver.colour_adam) = (density_adam, colour_adam);
    driver.sampler.restore(sampler);
    if let (Some(old), Some((params, adam))) = (&mut driver.head, head) {
        (old.params, old.adam) = (params, adam);
        old.pack();
    }
    driver.course = course;
    driver.rays = counters[0] as usize;
    driver.guard = NonFiniteGuard::default().resumed(counters[2], counters[3], counters[4]);
    driver.field.pack();
    Ok(())
}
