//! Settings of systems for scenes that move: the last values that are accepted train, the first that are not are named.

use super::{STEPS, build, trains, usual_operation, usual_stage};
use crate::common::{dataset, says};
use glam::DVec3;
use scene_io::Point;
use stress::Tally;

/// Accepted at either end, by system.
const ACCEPTED: [(&str, &str); 14] = [
    ("ngp", "guided=true depth=1000.0 curriculum=1.0 horizon=1 horizon=9223372036854775807"),
    (
        "t-nerf",
        "time_octaves=0 time_octaves=1 time_octaves=16 time_input=codes time_input=network time_code_dims=1 time_code_dims=1024
        sees=place sees=point sees=point+sees_octaves=0 sees=point+sees_octaves=16
        time_input=codes+time_code_dims=1 time_input=codes+time_code_dims=1024 time_input=network+time_code_dims=1+warp_width=1
        time_input=network+time_code_dims=1024 time_code_lr=0.0 time_code_lr=100.0 warp_lr=0.0 warp_lr=100.0
        warp_warmup=0.0 warp_warmup=1e-300 warp_warmup=1.0",
    ),
    (
        "d-nerf",
        "warp_octaves=0 warp_octaves=1 warp_octaves=16 warp_width=1 warp_width=1024 warp_depth=1 warp_depth=16
        coherence=0.0 coherence=1000.0 coherence=1e-38 coherence=1000.0+coherence_reach=1e-5+coherence_scale=1e-6
        coherence=1000.0+coherence_reach=0.25+coherence_scale=1000.0 coherence=1000.0+warp=none coherence=1000.0+warp=rigid
        warp=none warp=rigid origin=tied origin=exact curriculum=0.0 curriculum=1e-300 curriculum=1.0
        warp_anneal=0.0 warp_anneal=1e-300 warp_anneal=1.0 horizon=1 horizon=9223372036854775807
        planes=[] planes=[1] planes=[1,1,1,1,1,1,1,1] planes=[512]+plane_features=1+plane_times=1
        planes=[4]+plane_times=1024 planes=[4]+plane_features=1 planes=[4]+plane_features=32
        planes=[4]+plane_lr=0.0 planes=[4]+plane_lr=100.0 warp_levels=0 warp_levels=1 warp_levels=1000
        warp_levels_from=0.0+warp_levels_until=0.0 warp_levels_from=1.0+warp_levels_until=0.0+horizon=1
        levels_anneal=1 levels_anneal=9223372036854775807 levels_anneal=9+levels_first=0
        levels_anneal=9+levels_first=1000",
    ),
    (
        "d-nerf",
        "field=mlp+width=8+warp_width=1+coarse=8+fine=8 field=mlp+width=8+warp_width=8+warp_depth=1+coarse=8+fine=8
        field=mlp+width=8+warp_width=8+warp_depth=9+coarse=8+fine=8+origin=exact+fine_networks=true
        field=mlp+width=8+warp_width=8+coarse=8+fine=8+warp_octaves=0+time_octaves=0
        field=mlp+width=8+warp_width=8+coarse=8+fine=8+warp_octaves=32+time_octaves=32
        field=mlp+width=8+warp_width=8+coarse=8+fine=8+warp_variation=1e-38+horizon=1
        field=mlp+width=8+warp_width=8+coarse=8+fine=8+warp_variation=1000.0+horizon=9223372036854775807
        field=mlp+width=8+warp_width=8+coarse=8+fine=8+precrop_share=1.0+precrop_side=0.0+curriculum_share=1.0
        field=mlp+width=8+warp_width=8+coarse=8+fine=8+precrop_share=0.0+curriculum_share=0.0+lr_decay_share=1e-6",
    ),
    (
        "nerfies",
        "elastic=0.0 elastic=1000.0 elastic=1000.0+elastic_at=all elastic_rise=0.0 elastic_rise=1.0+elastic=1000.0 elastic_scale=1e-6 elastic_scale=1000.0
        elastic=1000.0+elastic_scale=1e-6+elastic_at=all elastic=1e-38+elastic_at=all background_loss=0.0 background_loss=1000.0
        background_loss=1e-38 background_points=0 background_points=1 background_points=1048576 time_input=time time_input=network
        time_code_dims=1 time_code_dims=1024 time_code_lr=0.0 time_code_lr=100.0 warp_lr=0.0 warp_lr=100.0
        origin=exact+time_input=time origin=tied+time_input=time warp=translation warp=none
        origin=tied+time_input=time+warp=translation+planes_seen_by=both+elastic=1000.0+elastic_at=all
        origin=exact+time_input=time+warp=translation+planes_seen_by=both+background_loss=1000.0
         appearance=codes appearance=codes+appearance_dims=1 appearance=codes+appearance_dims=512
         appearance=codes+code_size=0.0 appearance=codes+warp=none+time_input=time
         elastic=1000.0+coherence=1000.0",
    ),
    (
        "hypernerf",
        "ambient=0 ambient=1 ambient=16 ambient_octaves=1 ambient_octaves=16 ambient_width=1 ambient_width=1024
        ambient_depth=1 ambient_depth=16 ambient_from=0.0 ambient_from=1.0 ambient_anneal=0.0
        ambient_anneal=1.0 ambient_from=0.0+ambient_anneal=0.0 ambient_from=0.0+ambient_anneal=1e-300+warp=none
        ambient_from=0.0+ambient_anneal=1e-300+sees=point",
    ),
    (
        "tineuvox",
        "voxels=8 voxels=32+voxels_every=1e-300 voxels_every=0.0 voxels_every=1.0 voxel_variation=0.0
        voxel_variation=100.0 features=1 features=8
        time_code_dims=1 time_code_dims=1024 sees_octaves=0 sees_octaves=16 warp_octaves=0 warp_octaves=16 sees=place
        warp_warmup=0.0 warp_warmup=1.0 warp_warmup=1.0+warp_lr=100.0",
    ),
    (
        "k-planes",
        "plane_vertices=2 plane_scales=[1] plane_scales=[1,1,1,1,1,1] plane_scales=[16] plane_features=1 plane_features=64
        plane_times=0 plane_times=1 plane_times=2 plane_times=1024 plane_variation=0.0 plane_variation=100.0
        plane_smoothness=0.0 plane_smoothness=100.0 plane_transients=0.0 plane_transients=100.0 decoder=hybrid
        decoder=explicit decoder=explicit+basis_width=1+basis_layers=1 decoder=explicit+basis_width=1024
        decoder=explicit+basis_layers=16 decoder=explicit+plane_features=1 decoder=explicit+sampler=proposal",
    ),
    (
        "4dgs",
        "motion_from=0.0 motion_from=0.99 motion_width=1 motion_width=512 motion_layers=0 motion_layers=8 motion_opacity=true
        motion_colour=true motion_opacity=true+motion_colour=true+sh_degree=0 motion_lr=1e-300 motion_lr=10.0 motion_lr_end=10.0
        motion_feature_lr=10.0 motion_feature_lr_end=1e-300 motion_coherence=1000.0 motion_coherence=1.0+motion_reach=1e-4
        motion_rest=0.0 motion_rest=1e-30 motion_rest=10.0 motion_coherence=1.0+motion_reach=10.0 plane_vertices=2 plane_scales=[1] plane_scales=[16] plane_features=1
        plane_features=64 plane_times=0 plane_times=2 plane_times=1024 plane_variation=100.0 plane_smoothness=100.0 plane_transients=100.0
        dssim=1.0 start=random start=points density=adc density=mcmc max_splats=1",
    ),
    (
        "degauss",
        "front_from=0.0 front_from=0.99 front_shades=false front_mask_lr=1e-300 front_mask_lr=100.0 front_structure=0.0
        front_structure=100.0 front_each=0.0 front_each=100.0 front_entropy=0.0 front_entropy=1000.0 front_sparsity=0.0 front_sparsity=1000.0 front_separation=0.0
        front_separation=1000.0 front_smoothness=0.0 front_smoothness=1000.0 front_brightness=0.0 front_brightness=1000.0 front_count=1
        front_count=1+front_max=1 front_max=1000 motion_from=0.0 motion_opacity=false+motion_colour=false sh_degree=0 start=random
        start=points density=adc density=mcmc max_splats=1",
    ),
    (
        "two-parts",
        "horizon=4+moving_from=0.5 horizon=4+moving_from=0.5+moving_levels=1+moving_features=1 horizon=4+moving_from=0.5+moving_log2_table=3
        horizon=4+moving_from=0.5+moving_n_min=1+moving_n_max=1 horizon=4+moving_from=0.5+moving_times=1+moving_times_max=1
        horizon=4+moving_from=0.5+moving_features=8+moving_times_max=16384 moving_from=1.0 levels=1",
    ),
    (
        "endo-nerf",
        "depth=0.0 depth=1e-38 depth=1000.0 depth_delta=1e-4 depth_delta=1000.0 cue_samples=0 cue_samples=1
        cue_samples=1024 cue_spread=0.0 cue_spread=1e-38 cue_spread=10.0 cue_anywhere=0.0 cue_anywhere=1.0
        cue_spread=0.0+cue_anywhere=0.0 refine_every=0 refine_every=1 refine_every=9223372036854775807 refine_rounds=0
        refine_rounds=9223372036854775807+refine_every=1 refine_share=0.0 refine_share=1.0+refine_every=1
        depth=0.0+cue_samples=0+accept_no_parallax=true guided=false guided=false+cue_samples=0 curriculum=0.3 sky=true",
    ),
    (
        "nsff",
        "horizon=4+moving_from=0.5+flow_share=1.0 horizon=4+moving_from=0.5+flow_share=1e-3 horizon=4+moving_from=0.5+flow_reach=1.0
        horizon=4+moving_from=0.5+flow_reach=1e-38 horizon=4+moving_from=0.5+flow_chain_from=0.0 flow_chain_from=1.0 flow_fades_in=1.0
        flow_fades_in=1e-3 horizon=4+moving_from=0.5+flow_renders=10.0 horizon=4+moving_from=0.5+flow_renders=0.0 flow_hidden=0.0
        horizon=4+moving_from=0.5+flow_cycle=10.0+flow_small=10.0+flow_spatial=10.0+flow_steady=10.0 horizon=4+moving_from=0.5+still_freezes=true
        horizon=4+moving_from=0.5+flow_by_share=false+flow_fades_in=0.25 horizon=4+moving_from=0.5+flow_mask=10.0+flow_entropy=10.0
        by_error=false moving_share=0.0 moving_entropy=10.0 planes=[]",
    ),
    (
        "dynamic-nerf",
        "horizon=4+moving_from=0.5+flow_order=10.0 horizon=4+moving_from=0.5+flow_still=10.0 horizon=4+moving_from=0.5+still_freezes=false
        horizon=4+moving_from=0.5+flow_mask=10.0 horizon=4+moving_from=0.5+flow_entropy=10.0 flow_mask=0.0 flow_entropy=0.0
        horizon=4+moving_from=0.5+flow_by_share=true+flow_fades_in=1e-3
        horizon=4+moving_from=0.5+flow_chain_from=0.0+flow_share=1.0 moving_from=1.0",
    ),
];

/// Refused, whatever the system.
const REFUSED: &str = "
    time_octaves=17 warp_octaves=17 ambient_octaves=0 ambient_octaves=17 sees_octaves=17
    time_code_dims=0 time_code_dims=1025 warp_width=0 warp_width=1025 warp_depth=0 warp_depth=17 ambient=17
    ambient_width=0 ambient_width=1025 ambient_depth=0 ambient_depth=17 ambient=9223372036854775807
    ambient_width=9223372036854775807 warp_depth=9223372036854775807
    plane_features=0 plane_features=33 plane_times=0 plane_times=1025 planes=[0] planes=[513]
    planes=[1,1,1,1,1,1,1,1,1] planes=[9223372036854775807] plane_lr=-1.0 plane_lr=101.0 plane_lr=nan
    background_points=1048577 background_points=9223372036854775807
    elastic=-1.0 elastic=1001.0 elastic=nan elastic=inf elastic_scale=0.0 elastic_scale=-1.0 elastic_scale=9e-7
    elastic_scale=1001.0 elastic_scale=nan coherence=-1.0 coherence=1001.0 coherence=nan coherence=inf coherence_reach=0.0
    coherence_reach=0.26 coherence_reach=nan coherence_scale=0.0 coherence_scale=1001.0 coherence_scale=nan
    background_loss=-1.0 background_loss=1001.0 background_loss=nan background_loss=inf
    warp_lr=-1.0 warp_lr=101.0 warp_lr=nan warp_lr=inf warp_warmup=-0.1 warp_warmup=1.1 warp_warmup=nan time_code_lr=-1.0 time_code_lr=101.0 time_code_lr=nan
    depth=-1.0 depth=1001.0 depth=nan depth=inf depth_delta=0.0 depth_delta=9e-5 depth_delta=1001.0 depth_delta=nan
    cue_samples=1025 cue_samples=9223372036854775807 cue_samples=-1 cue_spread=-1.0 cue_spread=11.0 cue_spread=nan
    cue_anywhere=-0.1 cue_anywhere=1.1 cue_anywhere=nan refine_share=-0.1 refine_share=1.1 refine_share=nan
    refine_every=-1 refine_rounds=-1 curriculum=-1.0 curriculum=1.1 warp_anneal=-0.1 warp_anneal=1.5 warp_anneal=nan
    ambient_from=-0.1 ambient_from=1.5 ambient_anneal=1.5 ambient_anneal=nan horizon=0 horizon=-1 voxels_every=1.5
    voxels_every=-0.1 warp_levels_from=1.5 warp_levels_until=-0.1 warp_levels_until=nan origin=tied voxels=0 voxels=7 voxels=513 time_code_dims=1.5 time_code_dims=-1
    time_input=nonsense warp=nonsense origin=nonsense sees=nonsense elastic_at=nonsense guided=nonsense
    plane_vertices=1 plane_vertices=1025 plane_scales=[] plane_scales=[0] plane_scales=[17] plane_variation=-1.0
    plane_variation=nan plane_smoothness=101.0 plane_transients=inf
    flow_mask=-1.0 flow_mask=11.0 flow_mask=nan flow_entropy=-1.0 flow_entropy=inf flow_steady=nan flow_share=0.0 flow_share=1.1
    flow_reach=0.0 flow_reach=nan flow_chain_from=1.5 flow_fades_in=0.0 flow_disparity=11.0 flow_by_share=nonsense";

/// Refused by systems that have no such part.
const ABSENT: [(&str, &str); 9] = [
    ("ngp", "warp_lr=0.0"),
    ("t-nerf", "warp=rigid"),
    ("t-nerf", "coherence=1000.0"),
    ("d-nerf", "elastic=1000.0"),
    ("d-nerf", "background_loss=1000.0"),
    ("nerfies", "ambient=2"),
    ("tineuvox", "planes=[4]"),
    ("tineuvox", "log2_table=8"),
    ("hypernerf", "sampler=proposal"),
];

pub(crate) fn cases(tally: &mut Tally) {
    let (mut stage, operation) = (usual_stage(), usual_operation());
    let at = |k: u32| DVec3::new(f64::from(k % 3) - 1.0, f64::from(k / 3) - 1.0, 0.0) * 0.3;
    stage.points = (0..9).map(|k| Point { xyz: at(k), rgb: [100; 3] }).collect();
    let data = [dataset(&stage), dataset(&operation)];
    for (name, list) in ACCEPTED {
        let (scene, data) = if name == "endo-nerf" { (&operation, &data[1]) } else { (&stage, &data[0]) };
        for written in list.split_whitespace() {
            let set: Vec<&str> = written.split('+').collect();
            tally.case(format!("{name} --set {set:?}"), "trains, everything finite", || {
                let (mut system, _) = build(name, scene, data, &set).map_err(|e| e.to_string())?;
                trains(system.as_mut(), data, STEPS)
            });
        }
    }
    for setting in REFUSED.split_whitespace() {
        tally.case(format!("--set {setting}"), "one line that names the setting and the value", || {
            let (key, value) = setting.split_once('=').unwrap_or_default();
            // As it was written, or as numbers and lists are.
            let number = value.parse::<f32>().map(|v| v.to_string()).unwrap_or(value.replace(',', ", "));
            let of_planes = ["vertices", "scales", "variation", "smoothness", "transients"];
            let name = match key.split_once('_') {
                _ if key.starts_with("voxels") => "tineuvox",
                Some(("plane", rest)) if of_planes.contains(&rest) => "k-planes",
                Some(("flow", _)) => "nsff",
                _ => "hypernerf",
            };
            match build(name, &stage, &data[0], &[setting]) {
                Err(e) => says(&e, &[key]).and(says(&e, &[value]).or(says(&e, &[&number]))),
                Ok(_) => Err("taken".into()),
            }
        });
    }
    for (name, setting) in ABSENT {
        tally.case(format!("{name} --set {setting}"), "one line that says that there is no such setting", || {
            let key = setting.split('=').next().unwrap_or_default();
            match build(name, &stage, &data[0], &[setting]) {
                Err(e) => says(&e, &[&format!("`set` = {key}"), "there is no such setting"]),
                Ok(_) => Err("taken".into()),
            }
        });
    }
    tally.case("--set nonsense=1", "one line that names it", || {
        match build("d-nerf", &stage, &data[0], &["nonsense=1"]) {
            Err(e) => says(&e, &["`set` = nonsense"]),
            Ok(_) => Err("taken".into()),
        }
    });
    tally.case("a system that is none", "one line that names those there are", || {
        match build("c-nerf", &stage, &data[0], &[]) {
            Err(e) => says(&e, &["c-nerf", "d-nerf", "endo-nerf"]),
            Ok(_) => Err("taken".into()),
        }
    });
}
