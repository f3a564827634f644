//! What a checkpoint holds.

use super::occupy::Occupy;
use super::proposal::ProposalField;
use super::{MAX_STRETCH, Ngp};
use crate::fields::{Features, Names};
use engine::system::{
    SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_counts, take_f32, take_numbers, u64_tensor,
};
use optim::{Adam, NonFiniteGuard};
use render_core::occupancy::OccupancyGrid;

/// Of the field's features.
fn field_names() -> Names {
    Names::new("field.grid", "grid")
}

/// Of a proposal's features.
fn proposal_names(round: usize) -> Names {
    Names::new(format!("proposal.{round}.grid"), format!("proposal.{round}.grid"))
}

pub(super) fn save(ngp: &Ngp) -> Vec<Tensor<'_>> {
    let f = &ngp.field;
    let mut out = vec![
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
    f.features.push_state(&field_names(), &mut out);
    push_adam(&mut out, "density", &ngp.density_adam);
    push_adam(&mut out, "colour", &ngp.colour_adam);
    if let Some(head) = &f.head {
        out.push(f32_tensor("field.head", &head.params));
        push_adam(&mut out, "head", &head.adam);
    }
    out.extend(ngp.errors.iter().flat_map(|map| map.state()));
    out.extend(ngp.cues.iter().flat_map(|cues| cues.state()));
    out.extend(f.deform.iter().flat_map(|deform| deform.state()));
    out.extend(ngp.method.iter().flat_map(|method| method.state()));
    for (i, proposal) in ngp.proposals.iter().flat_map(|p| &p.fields).enumerate() {
        proposal.features.push_state(&proposal_names(i), &mut out);
        out.push(f32_tensor(format!("proposal.{i}.network"), &proposal.mlp_params));
        push_adam(&mut out, &format!("proposal.{i}.network"), &proposal.mlp_adam);
    }
    out
}

/// Parameters and moments of a proposal.
struct ProposalState {
    features: Box<dyn Features>,
    network: Vec<f32>,
    network_adam: Adam,
}

/// All arrays are read and checked before the first is put in its place.
pub(super) fn load(ngp: &mut Ngp, tensors: &TensorMap) -> Result<(), SystemError> {
    let f = &ngp.field;
    let counters = take_counts(tensors, "counters", 5)?;
    let features = f.features.restored(&field_names(), tensors, counters[2])?;
    let density = take_numbers(tensors, "field.density", f.density_params.len())?;
    let colour = take_numbers(tensors, "field.colour", f.colour_params.len())?;
    let thickness = take_f32(tensors, "occupancy.thickness", ngp.occupy.grid.cells())?;
    let stretch = take_numbers(tensors, "step.stretch", 1)?[0];
    let refused = |name: &str, problem: String| Err(SystemError::State { name: name.into(), problem });
    let most = ngp.config.batch_rays;
    if counters[0] == 0 || counters[0] > most as u64 {
        return refused("counters", format!("{} rays a step; 1 to {most} expected (`batch_rays`)", counters[0]));
    }
    if !(1.0..=MAX_STRETCH).contains(&stretch) {
        return refused("step.stretch", format!("{stretch}; 1 to {MAX_STRETCH} expected"));
    }
    let adam = |name: String, old: &Adam| take_adam(tensors, &name, old);
    let density_adam = adam("density".into(), &ngp.density_adam)?;
    let colour_adam = adam("colour".into(), &ngp.colour_adam)?;
    let proposal = |(i, old): (usize, &ProposalField)| {
        Ok(ProposalState {
            features: old.features.restored(&proposal_names(i), tensors, counters[2])?,
            network: take_numbers(tensors, &format!("proposal.{i}.network"), old.mlp_params.len())?,
            network_adam: adam(format!("proposal.{i}.network"), &old.mlp_adam)?,
        })
    };
    let proposals = ngp.proposals.iter().flat_map(|p| &p.fields).enumerate().map(proposal);
    let proposals: Vec<ProposalState> = proposals.collect::<Result<_, SystemError>>()?;
    let head = f.head.as_ref().map(|old| {
        Ok::<_, SystemError>((take_numbers(tensors, "field.head", old.params.len())?, adam("head".into(), &old.adam)?))
    });
    let head = head.transpose()?;
    let occupancy = OccupancyGrid::from_state(Occupy::settings(&ngp.config, counters[1]), &thickness, counters[1])
        .map_err(|e| SystemError::State { name: "occupancy.thickness".into(), problem: e.to_string() })?;

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
    ngp.occupy.grid = occupancy;
    if let (Some(field), Some((params, adam))) = (&mut ngp.field.head, head) {
        (field.params, field.adam) = (params, adam);
    }
    for (field, state) in ngp.proposals.iter_mut().flat_map(|p| &mut p.fields).zip(proposals) {
        (field.features, field.mlp_params, field.mlp_adam) = (state.features, state.network, state.network_adam);
        field.pack();
    }
    (ngp.rays, ngp.stretch) = (counters[0] as usize, stretch);
    ngp.guard = NonFiniteGuard::default().resumed(counters[2], counters[3], counters[4]);
    ngp.field.pack();
    Ok(())
}
