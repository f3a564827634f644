//! What a checkpoint holds.

use super::Ngp;
use super::occupy::Occupy;
use crate::system::{SystemError, Tensor, TensorMap, f32_tensor, take_f32, take_u64, u64_tensor};
use optim::{Adam, NonFiniteGuard};
use render_core::occupancy::OccupancyGrid;

pub(super) fn save(ngp: &Ngp) -> Vec<Tensor<'_>> {
    let f = &ngp.field;
    let mut out = vec![
        f32_tensor("field.grid", &f.grid_params),
        f32_tensor("field.density", &f.density_params),
        f32_tensor("field.colour", &f.colour_params),
        f32_tensor("occupancy.thickness", ngp.occupy.grid.thickness()),
        f32_tensor("step.stretch", std::slice::from_ref(&ngp.stretch)),
        u64_tensor(
            "counters",
            vec![
                ngp.rays as u64,
                ngp.occupy.grid.updates(),
                ngp.guard.steps(),
                ngp.guard.bad_steps(),
                ngp.guard.entries(),
            ],
        ),
    ];
    let names = (0..ngp.grid_adam.len()).map(|l| format!("grid.{l}"));
    let names = names.chain(["density".into(), "colour".into()]);
    for (name, adam) in names.zip(ngp.grid_adam.iter().chain([&ngp.density_adam, &ngp.colour_adam])) {
        out.push(f32_tensor(format!("adam.{name}.m"), adam.first_moment()));
        out.push(f32_tensor(format!("adam.{name}.v"), adam.second_moment()));
        out.push(u64_tensor(format!("adam.{name}.steps"), vec![adam.steps()]));
    }
    out
}

/// All arrays are read and checked before the first is put in its place.
pub(super) fn load(ngp: &mut Ngp, tensors: &TensorMap) -> Result<(), SystemError> {
    let f = &ngp.field;
    let grid = take_f32(tensors, "field.grid", f.grid_params.len())?;
    let density = take_f32(tensors, "field.density", f.density_params.len())?;
    let colour = take_f32(tensors, "field.colour", f.colour_params.len())?;
    let thickness = take_f32(tensors, "occupancy.thickness", ngp.occupy.grid.cells())?;
    let stretch = take_f32(tensors, "step.stretch", 1)?[0];
    let counters = take_u64(tensors, "counters", 5)?;
    let adam = |name: String, old: &Adam| {
        let m = take_f32(tensors, &format!("adam.{name}.m"), old.len())?;
        let v = take_f32(tensors, &format!("adam.{name}.v"), old.len())?;
        let steps = take_u64(tensors, &format!("adam.{name}.steps"), 1)?[0];
        Adam::restore(old.config(), m, v, steps)
            .map_err(|e| SystemError::State { name: format!("adam.{name}"), problem: e.to_string() })
    };
    let grid_adam: Vec<Adam> =
        ngp.grid_adam.iter().enumerate().map(|(l, old)| adam(format!("grid.{l}"), old)).collect::<Result<_, _>>()?;
    let density_adam = adam("density".into(), &ngp.density_adam)?;
    let colour_adam = adam("colour".into(), &ngp.colour_adam)?;
    let occupancy = OccupancyGrid::from_state(Occupy::settings(&ngp.config, counters[1]), &thickness, counters[1])
        .map_err(|e| SystemError::State { name: "occupancy.thickness".into(), problem: e.to_string() })?;

    (ngp.field.grid_params, ngp.field.density_params, ngp.field.colour_params) = (grid, density, colour);
    (ngp.grid_adam, ngp.density_adam, ngp.colour_adam) = (grid_adam, density_adam, colour_adam);
    ngp.occupy.grid = occupancy;
    (ngp.rays, ngp.stretch) = (counters[0] as usize, stretch);
    ngp.guard = NonFiniteGuard::default().resumed(counters[2], counters[3], counters[4]);
    ngp.field.pack();
    Ok(())
}
