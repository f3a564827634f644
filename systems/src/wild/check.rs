//! Which settings of methods cannot work.

use super::config::{FieldKind, WildConfig};
use engine::system::SystemError;

/// Least of what errors are measured by, colour units: thousands of times below the steps of 8-bit colours. With much smaller
/// ones derivatives overflow.
pub(super) const LEAST_SCALE: f32 = 1e-6;

impl WildConfig {
    /// Check what the parts do not check themselves.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the field.
    pub fn check(&self) -> Result<(), SystemError> {
        let refuse =
            |field, value: String, problem: &str| Err(SystemError::Config { field, value, problem: problem.into() });
        let sizes = [
            ("appearance_dims", self.appearance_dims),
            ("transient_dims", self.transient_dims),
            ("filter_width", self.filter_width),
        ];
        for (field, value) in sizes {
            if !(1..=512).contains(&value) {
                return refuse(field, value.to_string(), "must be in 1..=512");
            }
        }
        let positive = [
            ("trim_scale", self.trim_scale),
            ("judge_scale", self.judge_scale),
            ("filter_temperature", self.filter_temperature),
        ];
        for (field, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return refuse(field, value.to_string(), "must be positive and finite");
            }
        }
        for (field, value) in [("beta_min", self.beta_min), ("kernel_scale", self.kernel_scale)] {
            if !(LEAST_SCALE..=1e3).contains(&value) {
                return refuse(field, value.to_string(), "must be in 0.000001..=1000");
            }
        }
        if self.tail > 0.0 && self.tail < LEAST_SCALE {
            return refuse("tail", self.tail.to_string(), "must be 0, or in 0.000001..=1000");
        }
        let rates = [
            ("code_lr", self.code_lr),
            ("transient_lr", self.transient_lr),
            ("encoder_lr", self.encoder_lr),
            ("visibility_lr", self.visibility_lr),
            ("visibility_code_lr", self.visibility_code_lr),
            ("mask_size", self.mask_size),
            ("mask_size_start", self.mask_size_start),
            ("filter_lr", self.filter_lr),
        ];
        for (field, value) in rates {
            if !(value > 0.0 && value <= 1e3) {
                return refuse(field, value.to_string(), "must be above 0 and at most 1000");
            }
        }
        let prices = [
            ("lambda_u", self.lambda_u),
            ("code_size", self.code_size),
            ("tail", self.tail),
            ("view_weight", self.view_weight),
            ("mode_weight", self.mode_weight),
            ("filter_opacity", self.filter_opacity),
            ("filter_smoothness", self.filter_smoothness),
        ];
        for (field, value) in prices {
            if !(0.0..=1e3).contains(&value) {
                return refuse(field, value.to_string(), "must be in 0..=1000");
            }
        }
        if let Err(e) = self.robust_kernel().check() {
            return refuse("kernel_scale", self.kernel_scale.to_string(), &e.to_string());
        }
        if let Err(e) = self.trimming().check() {
            let Self { trim_quantile, trim_diffuse, trim_vote, patch, patch_inner, .. } = self;
            let value = format!("{trim_quantile}, {trim_diffuse}, {trim_vote}, {patch}, {patch_inner}");
            return refuse("trim_quantile, trim_diffuse, trim_vote, patch, patch_inner", value, &e.to_string());
        }
        if !(0.0..=1.0).contains(&self.track_share) {
            return refuse("track_share", self.track_share.to_string(), "must be in 0..=1");
        }
        for (field, value) in [("segment_share", self.segment_share), ("file_share", self.file_share)] {
            if !(value > 0.0 && value <= 1.0) {
                return refuse(field, value.to_string(), "must be above 0 and at most 1");
            }
        }
        if !(1..=65535).contains(&self.superpixels) {
            return refuse("superpixels", self.superpixels.to_string(), "must be in 1..=65535");
        }
        let steps =
            [("judge_first", self.judge_first), ("warmup_steps", self.warmup_steps), ("view_every", self.view_every)];
        for (field, value) in steps {
            if value == 0 {
                return refuse(field, value.to_string(), "must be at least 1");
            }
        }
        for (field, value) in [("patch", self.patch), ("lattice", self.lattice)] {
            if !(2..=256).contains(&value) {
                return refuse(field, value.to_string(), "must be in 2..=256");
            }
        }
        let counts = [
            ("lattices", self.lattices, 0..=4096),
            ("encoder_photos", self.encoder_photos, 1..=4096),
            ("encoder_side", self.encoder_side, 1..=1024),
            ("visibility_dims", self.visibility_dims, 1..=512),
            ("visibility_octaves", self.visibility_octaves, 0..=16),
            ("visibility_width", self.visibility_width, 1..=1024),
            ("visibility_depth", self.visibility_depth, 1..=16),
        ];
        for (field, value, range) in counts {
            if !range.contains(&value) {
                let (least, most) = range.into_inner();
                return refuse(field, value.to_string(), &format!("must be in {least}..={most}"));
            }
        }
        if self.encoder_channels.len() > 8 || self.encoder_channels.iter().any(|c| !(1..=1024).contains(c)) {
            let value = format!("{:?}", self.encoder_channels);
            return refuse("encoder_channels", value, "must be 1 to 8 numbers in 1..=1024");
        }
        if self.encoder_tilts.len() > 16 || !self.encoder_tilts.iter().all(|t| (-50.0..=50.0).contains(t)) {
            let value = format!("{:?}", self.encoder_tilts);
            return refuse("encoder_tilts", value, "must be at most 16 numbers in -50..=50");
        }
        if self.field == FieldKind::Mlp && (self.view_weight > 0.0 || self.mode_weight > 0.0) {
            let value = format!("{}, {}", self.view_weight, self.mode_weight);
            return refuse("view_weight, mode_weight", value, "must be 0 with `field = \"mlp\"`");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wild::{AppearanceKind, OccluderKind};

    #[test]
    fn settings_that_would_end_a_training_are_refused_before_it() {
        let good = |field| WildConfig::new(field, AppearanceKind::Codes, OccluderKind::Masks);
        for field in [FieldKind::Ngp, FieldKind::Mlp] {
            good(field).check().unwrap();
        }
        type Spoil = fn(&mut WildConfig);
        let spoils: [(&str, Spoil); 13] = [
            ("`quantile`", |c| c.trim_quantile = 7.0),
            ("`vote`", |c| c.trim_vote = -1.0),
            ("`diffuse`", |c| c.trim_diffuse = f32::NAN),
            ("`inner`", |c| c.patch_inner = 99),
            ("track_share", |c| c.track_share = 9.0),
            ("segment_share", |c| c.segment_share = 0.0),
            ("file_share", |c| c.file_share = 1.5),
            ("kernel_scale", |c| c.kernel_scale = -1.0),
            ("judge_first", |c| c.judge_first = 0),
            ("beta_min", |c| c.beta_min = 9e-7),
            ("tail", |c| c.tail = 1e-20),
            ("filter_lr", |c| c.filter_lr = 1e10),
            ("mask_size_start", |c| c.mask_size_start = f32::MAX),
        ];
        for (name, spoil) in spoils {
            let mut config = good(FieldKind::Ngp);
            spoil(&mut config);
            let error = config.check().unwrap_err().to_string();
            assert!(error.contains(name), "{name}: {error}");
        }
    }
}
