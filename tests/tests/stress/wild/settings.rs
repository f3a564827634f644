//! Settings of methods: the last values that are accepted train, the first that are not are named.

use super::{METHODS, STEPS, build, trains};
use crate::common::{dataset, says, tiny_scene};
use scene_io::{PerturbationKind, perturb};
use stress::Tally;

/// Accepted at either end, by method.
const ACCEPTED: [(&str, &str); 13] = [
    (
        "robust-nerf",
        "judging=batch judging=never judge_first=1 judge_first=9223372036854775807 judge_scale=1e-38 judge_scale=3e38
        trim_quantile=0.0 trim_quantile=1.0 trim_diffuse=0.0 trim_diffuse=1.0 trim_vote=0.0 trim_vote=1.0
        patch=4 patch=256 patch_inner=0 patch_inner=1 kernel=l1 kernel=squared
        kernel=charbonnier+kernel_scale=1e-6 kernel=charbonnier+kernel_scale=1000.0 kernel=cauchy+kernel_scale=1e-6
        kernel=cauchy+kernel_scale=1000.0 kernel=gemanmcclure+kernel_scale=1e-6 kernel=gemanmcclure+kernel_scale=1000.0
        kernel=welsch+kernel_scale=1e-6 kernel=welsch+kernel_scale=1000.0
        judging=batch+trim_scale=1e-38 judging=batch+trim_scale=3e38 judging=batch+trim_quantile=0.0
        judging=batch+trim_quantile=1.0 judging=batch+trim_diffuse=1.0+trim_vote=1.0 judging=batch+patch=2+patch_inner=2
        judging=batch+patch=16+patch_inner=0",
    ),
    (
        "nerf-w",
        "appearance_dims=1 appearance_dims=512 transient_dims=1 transient_dims=512 beta_min=1e-6 beta_min=1000.0
        tail=0.0 tail=1e-6 tail=1000.0 lambda_u=0.0 lambda_u=1000.0 code_size=0.0 code_size=1000.0
        code_lr=1e-38 code_lr=1000.0 transient_lr=1e-38 transient_lr=1000.0 mixture=proportional
        beta_min=1e-6+tail=0.0 beta_min=1000.0+tail=1000.0",
    ),
    ("nerf-a", "appearance_dims=1 appearance_dims=512 kernel=squared kernel=welsch+kernel_scale=1e-6 code_size=1000.0"),
    ("nerf-u", "transient_dims=1 transient_dims=512 lambda_u=0.0 lambda_u=1000.0 beta_min=1e-6+tail=1e-6"),
    (
        "ha-nerf",
        "encoder_side=1024+encoder_channels=[1] encoder_channels=[1024] encoder_lr=1e-38 encoder_lr=1000.0
        encoder_tilts=[] encoder_tilts=[-50.0,50.0]
        encoder_tilts=[-50.0,-40.0,-30.0,-20.0,-10.0,-5.0,-2.0,-1.0,0.0,1.0,2.0,5.0,10.0,20.0,30.0,50.0]
        lattices=1 lattices=4096+lattice=2+view_weight=0.0+mode_weight=0.0 lattice=64 encoder_photos=1
        encoder_photos=4096 view_weight=0.0 view_weight=1000.0 mode_weight=0.0 mode_weight=1000.0
        view_every=9223372036854775807 appearance_dims=1 appearance_dims=512",
    ),
    ("ha-nerf-a", "view_weight=1000.0+mode_weight=1000.0 lattices=2 code_lr=1000.0 code_size=1000.0"),
    (
        "ha-nerf-t",
        "visibility_dims=1 visibility_dims=512 visibility_octaves=0 visibility_octaves=16 visibility_width=1
        visibility_width=1024 visibility_depth=16 visibility_lr=1e-38 visibility_lr=1000.0 visibility_code_lr=1e-38
        visibility_code_lr=1000.0 mask_size=1e-38 mask_size=1000.0 mask_size_start=1e-38 mask_size_start=1000.0
        mask_size_steps=0 mask_size_steps=1 mask_size_steps=9223372036854775807
        mask_size=1e-38+mask_size_start=1e-38 mask_size=1000.0+mask_size_start=1000.0",
    ),
    (
        "sf-nerf",
        "filter_octaves=1 filter_octaves=32 filter_width=1 filter_width=512 transient_dims=1 transient_dims=512
        filter_temperature=1e-38 filter_temperature=3e38 filter_opacity=0.0 filter_opacity=1000.0 filter_smoothness=0.0
        filter_smoothness=1000.0 filter_lr=1e-38 filter_lr=1000.0 filter_hold=0 filter_hold=9223372036854775807
        filter_ease=0 filter_ease=9223372036854775807 filter_hold=9223372036854775807+filter_ease=9223372036854775807
        filter_features=none beta_min=1e-6 beta_min=1000.0 tail=1e-6 tail=1000.0 appearance=none appearance=encoder
        filter_temperature=1e-38+filter_smoothness=1000.0+filter_octaves=32",
    ),
    (
        "hugs",
        "warmup_steps=1 warmup_steps=9223372036854775807 restart=anew track_share=0.0 track_share=1.0 segments=pixels
        segments=superpixels superpixels=1 superpixels=65535 segment_share=1e-38 segment_share=1.0 file_share=1e-38
        file_share=1.0 judge_scale=1e-38 judge_scale=3e38 appearance=codes appearance=encoder",
    ),
    (
        "wild-gaussians",
        "appearance=none occluders=none occluders=residual appearance=none+occluders=none appearance_dims=1
        appearance_dims=256 tone_width=1 tone_width=512 tone_scale=1e-38 tone_scale=1000.0 code_lr=1e-38 code_lr=1000.0
        place_code_lr=0.0 place_code_lr=1000.0 tone_lr=1e-38 tone_lr=1000.0 judge_first=1 judge_first=9223372036854775807
        judge_scale=1e-38 judge_scale=3e38 trim_quantile=0.0 trim_quantile=1.0 patch=4 patch=256
        occluders=residual+judge_from=0.0+judge_warmup=0.0 occluders=residual+judge_warmup=1.0
        occluders=residual+uncertainty_weight=2.0 occluders=residual+uncertainty_weight=1e-38
        occluders=errors occluders=auto judge_every=1 judge_every=9223372036854775807 sky=yes sky=no sky=auto sky=yes+sky_splats=1 sky=yes+sky_splats=100000",
    ),
    (
        "spotless",
        "chance_fade=0.0 chance_fade=1.0 inlier_share=0.0 inlier_share=1.0 inlier_share=0.0+chance_fade=0.0
        occluders=none occluders=photos occluders=residual appearance=codes dssim=0.2 opacity_decay=0.9",
    ),
    (
        "gs-w",
        "appearance=none appearance=codes occluders=none occluders=visibility encoder_side=16 encoder_side=512
        sampled_maps=0 sampled_maps=4 map_channels=1 map_channels=64 tone_width=1 tone_width=512 tone_scale=1e-38
        tone_scale=1000.0 sample_weight=0.0 sample_weight=1000.0 place_code_lr=0.0 place_code_lr=1000.0 tone_lr=1e-38
        tone_lr=1000.0 encoder_lr=1e-38 encoder_lr=0.1 occluders=visibility+judge_from=0.0
        occluders=visibility+visibility_weight=1e-38 occluders=visibility+visibility_weight=3e38
        occluders=visibility+visibility_left=1e-38 tone_direction=true occluders=visibility_head
        occluders=visibility_head+head_side=16 occluders=visibility_head+head_side=512
        occluders=visibility_head+head_lr=1e-38 occluders=visibility_head+head_lr=0.1
        occluders=visibility_head+visibility_weight=1e-38 occluders=visibility_head+visibility_weight=3e38",
    ),
    (
        "wild-gs",
        "appearance=none appearance=codes appearance=maps occluders=none occluders=visibility encoder_side=16
        encoder_side=512 plane_side=16 plane_side=512 plane_channels=1 plane_channels=64 plane_crop=0.0 plane_crop=0.4
        plane_from=0.0 plane_from=1.0 photo_dims=0 photo_dims=256 plane_from=1.0+photo_dims=0 tone_width=1
        tone_width=512 tone_scale=1e-38 tone_scale=1000.0 place_code_lr=0.0 place_code_lr=1000.0 tone_lr=1e-38
        tone_lr=1000.0 encoder_lr=1e-38 encoder_lr=0.1 depth_weight=0.0 depth_weight=3e38
        occluders=visibility+visibility_weight=1e-38 occluders=visibility+visibility_left=1.0",
    ),
];

/// Likewise on the published networks.
const ACCEPTED_MLP: [(&str, &str); 5] = [
    ("robust-nerf", "patch=8 judging=photos judging=never kernel=gemanmcclure+kernel_scale=1e-6 trim_quantile=0.0"),
    (
        "nerf-w",
        "appearance_dims=1+transient_dims=1 appearance_dims=512 beta_min=1e-6 beta_min=1000.0 tail=1e-6 lambda_u=1000.0",
    ),
    ("ha-nerf", "lattices=1 lattices=0 visibility_depth=16 mask_size=1e-38 mask_size=1000.0"),
    ("sf-nerf", "filter_octaves=32 filter_temperature=1e-38 filter_temperature=3e38 filter_smoothness=1000.0"),
    ("hugs", "restart=on restart=anew warmup_steps=1"),
];

/// Refused by any system that has them.
const REFUSED: &str = "
    appearance_dims=0 appearance_dims=513 transient_dims=0 transient_dims=513 filter_width=0 filter_width=513
    lattices=4097 encoder_photos=0 encoder_photos=4097 encoder_side=0 encoder_side=1025 visibility_dims=0
    visibility_dims=513 visibility_octaves=17 visibility_width=0 visibility_width=1025 visibility_depth=0
    visibility_depth=17 superpixels=0 superpixels=65536 judge_first=0 warmup_steps=0 view_every=0
    patch=0 patch=1 patch=257 lattice=0 lattice=1 lattice=257 patch_inner=9 patch_inner=300
    encoder_channels=[0] encoder_channels=[1025] encoder_channels=[1,1,1,1,1,1,1,1,1] encoder_channels=[]
    encoder_tilts=[50.5] encoder_tilts=[nan] filter_octaves=0 filter_octaves=33
    encoder_tilts=[0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,0.0]
    trim_quantile=-0.1 trim_quantile=1.1 trim_quantile=nan trim_diffuse=-0.1 trim_diffuse=1.1 trim_diffuse=nan
    trim_vote=-0.1 trim_vote=1.1 trim_vote=nan track_share=-0.1 track_share=1.1 track_share=nan
    segment_share=0.0 segment_share=1.1 segment_share=nan file_share=0.0 file_share=1.1 file_share=nan
    kernel=nonsense judging=nonsense occluders=nonsense appearance=nonsense restart=nonsense segments=nonsense
    filter_features=nonsense filter_freeze=nonsense field=nonsense lambda_u=word appearance_dims=1.5
    appearance_dims=-1 filter_from=no/such/run";

/// Above 0 and finite, and what else is too small or too large.
const POSITIVE: [(&str, &str); 13] = [
    ("beta_min", "9e-7 1001.0"),
    ("kernel_scale", "9e-7 1001.0"),
    ("code_lr", "1001.0"),
    ("transient_lr", "1001.0"),
    ("trim_scale", ""),
    ("judge_scale", ""),
    ("encoder_lr", "1001.0"),
    ("visibility_lr", "1001.0"),
    ("visibility_code_lr", "1001.0"),
    ("mask_size", "1001.0"),
    ("mask_size_start", "1001.0"),
    ("filter_temperature", ""),
    ("filter_lr", "1001.0"),
];

/// From 0 to 1000.
const PRICES: [&str; 7] =
    ["lambda_u", "code_size", "tail", "view_weight", "mode_weight", "filter_opacity", "filter_smoothness"];

/// A system that has a setting.
fn system_with(key: &str) -> &'static str {
    match key {
        "transient_dims" | "transient_lr" | "beta_min" | "tail" | "lambda_u" => "nerf-w",
        "judging" | "judge_first" | "judge_scale" | "patch" | "patch_inner" => "robust-nerf",
        "superpixels" | "warmup_steps" | "restart" | "segments" | "segment_share" | "file_share" | "track_share" => {
            "hugs"
        }
        _ if key.starts_with("filter") => "sf-nerf",
        _ if key.starts_with("trim") => "robust-nerf",
        _ => "ha-nerf",
    }
}

pub(crate) fn cases(tally: &mut Tally) {
    let scene = perturb(tiny_scene(4, 0.82), PerturbationKind::Both, 3);
    let data = dataset(&scene);
    let accepted = ACCEPTED.iter().map(|(name, list)| (name, list, None));
    let mlp = ACCEPTED_MLP.iter().map(|(name, list)| (name, list, Some("field=mlp")));
    for (name, list, field) in accepted.chain(mlp) {
        for written in list.split_whitespace() {
            let set: Vec<&str> = field.into_iter().chain(written.split('+')).collect();
            tally.case(format!("{name} --set {set:?}"), "trains, everything finite", || {
                let mut system = build(name, &scene, &data, &set).map_err(|e| e.to_string())?;
                trains(system.as_mut(), &data, STEPS)
            });
        }
    }
    let mut refused: Vec<String> = REFUSED.split_whitespace().map(str::to_string).collect();
    for (key, beyond) in POSITIVE {
        let values = ["0.0", "-1.0", "nan", "inf", "1e39"].into_iter().chain(beyond.split_whitespace());
        refused.extend(values.map(|v| format!("{key}={v}")));
    }
    refused.extend(PRICES.iter().flat_map(|key| ["-1.0", "1001.0", "nan", "inf"].map(|v| format!("{key}={v}"))));
    // A tail so short that there is nothing before it.
    refused.push("tail=9e-7".into());
    for setting in &refused {
        tally.case(format!("--set {setting}"), "one line that names the setting and the value", || {
            let (key, value) = setting.split_once('=').unwrap_or_default();
            // As it was written, or as numbers and lists are.
            let number = value.parse::<f32>().map(|v| v.to_string()).unwrap_or(value.replace(',', ", "));
            let name = system_with(key);
            match build(name, &scene, &data, &[setting]) {
                Err(e) => says(&e, &[key]).and(says(&e, &[value]).or(says(&e, &[&number]))),
                Ok(_) => Err("taken".into()),
            }
        });
    }
    tally.case("--set nonsense=1", "one line that names it", || {
        match build("nerf-w", &scene, &data, &["nonsense=1"]) {
            Err(e) => says(&e, &["`set` = nonsense"]),
            Ok(_) => Err("taken".into()),
        }
    });
    for name in METHODS {
        for set in [&[][..], &["field=mlp"]] {
            tally.case(format!("{name} {set:?}, one step"), "trains, everything finite", || {
                let mut system = build(name, &scene, &data, set).map_err(|e| e.to_string())?;
                trains(system.as_mut(), &data, 1)
            });
        }
    }
}
