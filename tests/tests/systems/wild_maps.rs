//! Clouds that read their colours in a reference photo: any photo has an appearance without a fit, and it is worth what it costs.

use crate::wild_clouds::{check_bits, check_named, check_read_off, check_worth};

const NAME: &str = "gs-w";

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let field = ["start=field", "field_steps=3", "refill=0.5", "judge_first=1"];
    let head = ["occluders=visibility_head", "judge_from=0.0", "head_side=16", "tone_direction=true"];
    check_bits(NAME, &[&["judge_first=2"], &["occluders=visibility", "judge_from=0.0"], &head, &field]);
}

#[test]
fn an_appearance_changes_colours_alone_is_read_off_another_photo_and_baked() {
    check_read_off(NAME);
}

#[test]
fn maps_of_each_photo_are_worth_what_they_cost() {
    check_worth(NAME, 3.0);
}

#[test]
fn a_setting_that_cannot_work_is_named() {
    let of_maps = ["encoder_side=20", "sampled_maps=5", "map_channels=0", "encoder_lr=0.2", "tone_direction=3"];
    check_named(NAME, &of_maps);
    check_named(NAME, &["appearance_dims=8", "appearance=encoder", "visibility_weight=0.1", "depth_weight=0.1"]);
}
