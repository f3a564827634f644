//! Settings of the parts that are there, and of no others.

use crate::plan::made::{Points, capture};
use crate::registry::{Family, build, names};
use engine::options::{Plan, RunOptions};
use engine::system::SystemError;

fn planned(name: &str, set: &str) -> Result<Plan, SystemError> {
    let (scene, data) = capture(Points::None);
    // Of the hash grid: it is coarse.
    let coarse = if set.contains("mlp") { "" } else { "occupancy = 16\n" };
    let set = format!("{coarse}{set}");
    let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: set.parse().unwrap() };
    build(name, &scene, &data, &run).map(|(_, plan)| plan)
}

fn refused(name: &str, set: &str) -> String {
    planned(name, set).err().unwrap_or_else(|| panic!("{name} takes {set}")).to_string()
}

const CODES: [&str; 3] = ["appearance_dims", "code_lr", "code_size"];
const ENCODER: [&str; 10] = [
    "encoder_side",
    "encoder_channels",
    "encoder_lr",
    "encoder_tilts",
    "lattices",
    "lattice",
    "encoder_photos",
    "view_weight",
    "mode_weight",
    "view_every",
];
const KERNEL: [&str; 2] = ["kernel", "kernel_scale"];
const TRIMMING: [&str; 6] = ["judge_scale", "trim_quantile", "trim_diffuse", "trim_vote", "patch", "patch_inner"];
const ROBUST: [&str; 3] = ["judging", "judge_first", "trim_scale"];
const LIKELIHOOD: [&str; 4] = ["transient_dims", "transient_lr", "beta_min", "tail"];
const VISIBILITY: [&str; 9] = [
    "visibility_dims",
    "visibility_octaves",
    "visibility_width",
    "visibility_depth",
    "visibility_lr",
    "visibility_code_lr",
    "mask_size",
    "mask_size_start",
    "mask_size_steps",
];
const FILTER: [&str; 12] = [
    "filter_octaves",
    "filter_width",
    "filter_features",
    "filter_lr",
    "filter_hold",
    "filter_ease",
    "filter_temperature",
    "filter_opacity",
    "filter_smoothness",
    "filter_from",
    "filter_freeze",
    "filter_sha256",
];
const MASKS: [&str; 7] =
    ["warmup_steps", "restart", "track_share", "segments", "superpixels", "segment_share", "file_share"];

#[test]
fn a_system_has_the_settings_of_its_parts_and_of_no_others() {
    let field: Vec<String> = planned("plain", "").unwrap().config.keys().cloned().collect();
    // What a transient part of the field has besides.
    let head: Vec<String> = planned("nerf-u", "").unwrap().config.keys().cloned().collect();
    let parts: [(&str, &[&[&str]]); 10] = [
        ("plain", &[]),
        ("nerf-a", &[&CODES, &KERNEL]),
        ("nerf-u", &[&LIKELIHOOD, &["lambda_u"]]),
        ("nerf-w", &[&CODES, &LIKELIHOOD, &["lambda_u"]]),
        ("ha-nerf-a", &[&CODES, &ENCODER, &KERNEL]),
        ("ha-nerf-t", &[&VISIBILITY, &KERNEL]),
        ("ha-nerf", &[&CODES, &ENCODER, &VISIBILITY, &KERNEL]),
        ("sf-nerf", &[&CODES, &LIKELIHOOD, &FILTER]),
        ("robust-nerf", &[&ROBUST, &TRIMMING, &KERNEL]),
        ("hugs", &[&MASKS, &TRIMMING, &KERNEL]),
    ];
    for (name, parts) in parts {
        let set = if parts.iter().any(|part| part.contains(&"lattices")) { "encoder_channels = [4]" } else { "" };
        let got: Vec<String> = planned(name, set).unwrap().config.keys().cloned().collect();
        let of_field = if parts.iter().any(|part| part.contains(&"lambda_u")) { &head } else { &field };
        let own: Vec<&str> = parts.concat();
        for key in &own {
            assert!(got.iter().any(|got| got == key), "{name} has no `{key}`");
        }
        let more: Vec<&String> =
            got.iter().filter(|key| !own.contains(&key.as_str()) && !of_field.contains(key)).collect();
        assert!(more.is_empty(), "{name}: {more:?}");
        let of_parts = own.iter().filter(|key| !of_field.iter().any(|of| of == **key)).count();
        assert_eq!(got.len() - of_field.len(), of_parts, "{name}");
    }
}

#[test]
fn a_setting_of_an_absent_part_is_refused_and_the_part_named() {
    for (name, set, want) in [
        (
            "nerf-w",
            "filter_width = 16",
            "`set` = filter_width: is a setting of `occluders = \"filter\"`, and here `occluders` is \"transient\"",
        ),
        (
            "robust-nerf",
            "code_lr = 0.5",
            "`set` = code_lr: is a setting of `appearance = \"codes\"`, and here `appearance` is \"none\"",
        ),
        (
            "nerf-a",
            "encoder_side = 32",
            "`set` = encoder_side: is a setting of `appearance = \"encoder\"`, and here `appearance` is \"codes\"",
        ),
        (
            "plain",
            "warmup_steps = 3",
            "`set` = warmup_steps: is a setting of `occluders = \"masks\"`, and here `occluders` is \"none\"",
        ),
        (
            "sf-nerf",
            "field = 'mlp'\nlambda_u = 0.1",
            "`set` = lambda_u: is a setting of `occluders = \"transient\"`, and here `occluders` is \"filter\"",
        ),
    ] {
        assert_eq!(refused(name, set), want);
    }
    let error = refused("nerf-w", "nonsense = 1");
    assert!(error.starts_with("`set` = nonsense: there is no such setting; there are "), "{error}");
    assert!(error.contains("appearance_dims") && error.contains("lambda_u") && !error.contains("filter"), "{error}");
}

#[test]
fn a_part_that_is_chosen_brings_its_settings() {
    let plan = planned("robust-nerf", "appearance = 'codes'\ncode_lr = 0.5").unwrap();
    assert_eq!(plan.config["code_lr"].as_float(), Some(0.5));
    let plan = planned("nerf-w", "occluders = 'visibility'\nmask_size = 0.5").unwrap();
    assert_eq!(plan.config["mask_size"].as_float(), Some(0.5));
    assert!(!plan.config.contains_key("lambda_u"));
    let error = refused("nerf-w", "occluders = 'visibility'\nlambda_u = 0.5");
    assert_eq!(
        error,
        "`set` = lambda_u: is a setting of `occluders = \"transient\"`, and here `occluders` is \"visibility\""
    );
}

#[test]
fn planned_values_of_both_fields() {
    for (name, key, ngp, mlp) in [
        ("nerf-w", "appearance_dims", "16", "48"),
        ("nerf-w", "transient_dims", "32", "16"),
        ("nerf-w", "tail", "0.05000000074505806", "0.0"),
        ("nerf-w", "code_size", "0.009999999776482582", "0.000009999999747378752"),
        ("sf-nerf", "transient_dims", "32", "128"),
        ("sf-nerf", "beta_min", "0.10000000149011612", "0.029999999329447746"),
        ("sf-nerf", "code_size", "0.000009999999747378752", "0.000009999999747378752"),
        ("ha-nerf-t", "visibility_width", "64", "256"),
        ("ha-nerf-t", "kernel", "\"charbonnier\"", "\"squared\""),
        ("robust-nerf", "judging", "\"photos\"", "\"batch\""),
        ("robust-nerf", "patch", "8", "8"),
        ("hugs", "restart", "\"on\"", "\"anew\""),
        ("hugs", "file_share", "0.800000011920929", "0.5"),
    ] {
        let got = ["occupancy = 16", "field = 'mlp'"].map(|set| value_of(name, set, key));
        assert_eq!(got, [ngp, mlp], "{name} {key}");
    }
}

fn value_of(name: &str, set: &str, key: &str) -> String {
    let (scene, data) = capture(Points::None);
    let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: set.parse().unwrap() };
    build(name, &scene, &data, &run).unwrap().1.config[key].to_string()
}

#[test]
fn systems_have_the_names_that_they_were_asked_for_by() {
    let (scene, data) = capture(Points::None);
    for name in names(Family::Wild).into_iter().filter(|name| !["auto", "plain"].contains(name)) {
        let set = match name {
            "ha-nerf-a" | "ha-nerf" => "occupancy = 16\nencoder_channels = [4]",
            "wild-gaussians" | "spotless" | "gs-w" | "wild-gs" | "degauss" => "max_splats = 100",
            _ => "occupancy = 16",
        };
        let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: set.parse().unwrap() };
        assert_eq!(build(name, &scene, &data, &run).unwrap().0.name(), name);
    }
}
