//! What a checkpoint holds.

use super::Ngp;
use crate::fields::Names;
use engine::system::{
    SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_counts, take_numbers, u64_tensor,
};
use optim::{Adam, NonFiniteGuard};

/// Of the field's features.
fn field_names() -> Names {
    Names::new("field.grid", "grid")
}

pub(super) fn save(ngp: &Ngp) -> Vec<Tensor<'_>> {
    let f = &ngp.field;
    let mut out = vec![
        f32_tensor("field.density", &f.density_params),
        f32_tensor("field.colour", &f.colour_params),
        u64_tensor(
            "counters",
            vec![ngp.rays as u64, ngp.sampler.updates(), ngp.guard.steps(), ngp.guard.bad_steps(), ngp.guard.entries()],
        ),
    ];
    f.features.push_state(&field_names(), &mut out);
    push_adam(&mut out, "density", &ngp.density_adam);
    push_adam(&mut out, "colour", &ngp.colour_adam);
    if let Some(head) = &ngp.head {
        out.push(f32_tensor("field.head", &head.params));
        push_adam(&mut out, "head", &head.adam);
    }
    out.extend(ngp.errors.iter().flat_map(|map| map.state()));
    out.extend(ngp.cues.iter().flat_map(|cues| cues.state()));
    out.extend(f.deform.iter().flat_map(|deform| deform.state()));
    out.extend(ngp.method.iter().flat_map(|method| method.state()));
    ngp.sampler.push_state(&mut out);
    out
}

/// All arrays are read and checked before the first is put in its place.
pub(super) fn load(ngp: &mut Ngp, tensors: &TensorMap) -> Result<(), SystemError> {
    let f = &ngp.field;
    let counters = take_counts(tensors, "counters", 5)?;
    let features = f.features.restored(&field_names(), tensors, counters[2])?;
    let density = take_numbers(tensors, "field.density", f.density_params.len())?;
    let colour = take_numbers(tensors, "field.colour", f.colour_params.len())?;
    let refused = |name: &str, problem: String| Err(SystemError::State { name: name.into(), problem });
    let most = ngp.config.batch.batch_rays;
    if counters[0] == 0 || counters[0] > most as u64 {
        return refused("counters", format!("{} rays a step; 1 to {most} expected (`batch_rays`)", counters[0]));
    }
    let adam = |name: String, old: &Adam| take_adam(tensors, &name, old);
    let density_adam = adam("density".into(), &ngp.density_adam)?;
    let colour_adam = adam("colour".into(), &ngp.colour_adam)?;
    let head = ngp.head.as_ref().map(|old| {
        Ok::<_, SystemError>((take_numbers(tensors, "field.head", old.params.len())?, adam("head".into(), &old.adam)?))
    });
    let head = head.transpose()?;
    let sampler = ngp.sampler.read_state(tensors, counters[1], counters[2])?;

    if let Some(map) = &mut ngp.errors {
        map.load_state(tensors)?;
    }
    if let Some(cues) = &mut ngp.cues {
        cues.load_state(tensors)?;
    }
    if let Some(deform) = &mut ngp.field.deform {
        deform.load_state(tensors)?;
    }
    if let Some(method) = &mut ngp.method {
        method.load_state(tensors)?;
    }
    (ngp.field.features, ngp.field.density_params, ngp.field.colour_params) = (features, density, colour);
    (ngp.density_adam, ngp.colour_adam) = (density_adam, colour_adam);
    ngp.sampler.restore(sampler);
    if let (Some(old), Some((params, adam))) = (&mut ngp.head, head) {
        (old.params, old.adam) = (params, adam);
        old.pack();
    }
    ngp.rays = counters[0] as usize;
    ngp.guard = NonFiniteGuard::default().resumed(counters[2], counters[3], counters[4]);
    ngp.field.pack();
    Ok(())
}
