//! Settings of methods for photographs from the wild; all of them can be given as `--set name=value`, beside those of the
//! field.

use field_core::conv::EncoderConfig;
use losses::kernel::Kernel;
use losses::trimmed::TrimmedMask;
use serde::{Deserialize, Serialize};

/// Which field the method trains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FieldKind {
    /// Hash grid and tiny networks: minutes.
    #[default]
    Ngp,
    /// The networks of NeRF, as published: hours.
    Mlp,
}

/// Where the light of photos comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AppearanceKind {
    /// All photos have the same.
    #[default]
    None,
    /// A free code for each photo (NeRF-W).
    Codes,
    /// A small network looks at the photo (Ha-NeRF).
    Encoder,
}

/// What is done about strangers in the photos.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OccluderKind {
    /// Nothing: there are none.
    #[default]
    None,
    /// What does not fit is left out (RobustNeRF).
    Robust,
    /// A second field explains them (NeRF-W).
    Transient,
    /// A network in image space says where they are (Ha-NeRF).
    Visibility,
    /// A network in image space says where they are and how they look (SF-NeRF).
    Filter,
    /// They are found after a short training, then masked (HuGS).
    Masks,
}

/// What the residual of a ray costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum KernelKind {
    /// Its square.
    #[default]
    Squared,
    /// Length of the residual.
    L1,
    /// Square near 0, length further out.
    Charbonnier,
    /// Logarithm further out.
    Cauchy,
    /// Bounded.
    GemanMcClure,
    /// Bounded, and sooner.
    Welsch,
}

/// Where the features of photos come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FeatureKind {
    /// Files beside the photos; none where no photo has one.
    #[default]
    Files,
    /// There are none.
    None,
}

/// What stays as it is of a filter that comes from another run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Freeze {
    /// What it makes of features.
    #[default]
    Features,
    /// Nothing.
    Nothing,
}

/// What votes on masks as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SegmentKind {
    /// Segments in files beside the photos; superpixels of photos that have none.
    #[default]
    Files,
    /// Superpixels, whatever files there are.
    Superpixels,
    /// Each pixel alone.
    Pixels,
}

/// What becomes of the field once masks are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Restart {
    /// It goes on.
    #[default]
    On,
    /// Another takes its place, as published.
    Anew,
}

/// How rays are told to be strangers, and left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Judging {
    /// From time to time, all photos as the field renders them: batches are random pixels.
    #[default]
    Photos,
    /// Every batch, of patches, before it is learnt from: as published.
    Batch,
    /// They are not.
    Never,
}

/// Settings of a method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WildConfig {
    /// `ngp` or `mlp`.
    pub field: FieldKind,
    /// `none`, `codes` or `encoder`.
    pub appearance: AppearanceKind,
    /// `none`, `robust`, `transient`, `visibility`, `filter` or `masks`.
    pub occluders: OccluderKind,

    /// Length of an appearance code.
    pub appearance_dims: usize,
    /// Length of a transient code.
    pub transient_dims: usize,
    /// Learning rate of codes, as a part of that of the field's networks.
    pub code_lr: f32,
    /// Transient, filter: learning rate of the codes of strangers, likewise.
    pub transient_lr: f32,
    /// Factor of the mean square of appearance codes in the loss.
    pub code_size: f32,

    /// Encoder: longest side of what it sees of a photo, pixels.
    pub encoder_side: usize,
    /// Encoder: channels after its first convolution and after each one that halves.
    pub encoder_channels: Vec<usize>,
    /// Encoder: its learning rate, as a part of that of the field's networks.
    pub encoder_lr: f32,
    /// Encoder: tilts of the tones it sees besides, for each channel; none as published.
    pub encoder_tilts: Vec<f32>,
    /// Encoder: lattices that a batch is made of at least, all of whose photos it looks at in that step (as published); 0:
    /// batches are random pixels, codes are free, and the encoder learns to say them, looking at the photos by turns.
    pub lattices: usize,
    /// Encoder: pixels along a side of a lattice, spread over half a photo or more.
    pub lattice: usize,
    /// Encoder, by turns: photos it looks at in a step.
    pub encoder_photos: usize,
    /// Encoder: weight of its finding a photo's light in a lattice rendered in that light; 0: none is rendered. `--field ngp`
    /// alone does it.
    pub view_weight: f32,
    /// Encoder: weight of other light looking different there.
    pub mode_weight: f32,
    /// Encoder: such a lattice is rendered in one step of so many, and weighs so many times as much.
    pub view_every: u64,

    /// Robust, masks, and codes alone: `squared`, `l1`, `charbonnier`, `cauchy`, `gemanmcclure` or `welsch`.
    pub kernel: KernelKind,
    /// Scale of the kernels from `charbonnier` on, colour units.
    pub kernel_scale: f32,
    /// Robust: who leaves strangers out, `photos`, `batch` or `never`.
    pub judging: Judging,
    /// Robust, by photos: steps before the first judgement; the others follow after twice as many, and so on.
    pub judge_first: u64,
    /// Robust, by photos: a stranger's residual is so many times that of most photos at the same place.
    pub judge_scale: f32,
    /// Robust: share of the rays (by photos: at the same place) that a residual is compared with.
    pub trim_quantile: f32,
    /// Robust, by batch: that residual times this is the largest of an inlier.
    pub trim_scale: f32,
    /// Robust: share of inliers around a ray that makes it one.
    pub trim_diffuse: f32,
    /// Robust: share of inliers in a patch that makes its inner block so.
    pub trim_vote: f32,
    /// Robust: pixels (by photos: squares) along a side of a patch, and of its inner block.
    pub patch: usize,
    /// See `patch`.
    pub patch_inner: usize,

    /// Transient, filter: least uncertainty of a pixel, colour units.
    pub beta_min: f32,
    /// Transient, filter: an error well above this costs its length instead of its square, colour units; 0: its square
    /// always, as published.
    pub tail: f32,
    /// Transient: price of transient density.
    pub lambda_u: f32,

    /// Visibility: length of a photo's code.
    pub visibility_dims: usize,
    /// Visibility: octaves of a pixel's place.
    pub visibility_octaves: usize,
    /// Visibility: width and number of the network's hidden layers.
    pub visibility_width: usize,
    /// See `visibility_width`.
    pub visibility_depth: usize,
    /// Visibility: learning rate of the network and of the codes, as a part of that of the field's networks.
    pub visibility_lr: f32,
    /// See `visibility_lr`.
    pub visibility_code_lr: f32,
    /// Visibility: price of leaving pixels out. A pixel is left out entirely from the squared error of four times this on.
    pub mask_size: f32,
    /// Visibility: that price in the first step, and the step from which on it is `mask_size`.
    pub mask_size_start: f32,
    /// See `mask_size_start`.
    pub mask_size_steps: u64,

    /// Filter: octaves of the place in the photo.
    pub filter_octaves: usize,
    /// Filter: width of its layers; `transient_dims` is the length of its codes.
    pub filter_width: usize,
    /// Filter: `files`, the features beside the photos where there are any, or `none`.
    pub filter_features: FeatureKind,
    /// Filter: a run of `sf-nerf`, or the array file of one of its checkpoints, whose filter this one begins with; empty: from
    /// scratch. Codes and field begin anew.
    pub filter_from: String,
    /// Filter of another run: what stays as it is of it, `features` (the branch that sees them) or `nothing`.
    pub filter_freeze: Freeze,
    /// Filter of another run: SHA-256 of the file it was read from; taken down when it is.
    pub filter_sha256: String,
    /// Filter: temperature of its opacities; towards 0 they are a coin toss.
    pub filter_temperature: f32,
    /// Filter: price of opacity.
    pub filter_opacity: f32,
    /// Filter: price of opacities that change over the picture.
    pub filter_smoothness: f32,
    /// Filter: learning rate, as a part of that of the field's networks.
    pub filter_lr: f32,
    /// Filter: steps in which all but the branch of the place learns at a tenth of that, and steps from there until it does
    /// not.
    pub filter_hold: u64,
    /// See `filter_hold`.
    pub filter_ease: u64,

    /// Masks: steps of the training that comes before them.
    pub warmup_steps: u64,
    /// Masks: the field goes `on` with them, or begins `anew`.
    pub restart: Restart,
    /// Masks: share of the photos that a static feature is seen in.
    pub track_share: f32,
    /// Masks: `files`, `superpixels` or `pixels`; photos without a file have superpixels.
    pub segments: SegmentKind,
    /// Masks: superpixels of a photo.
    pub superpixels: usize,
    /// Masks: share of a superpixel that has to be static, and of a segment from a file.
    pub segment_share: f32,
    /// See `segment_share`.
    pub file_share: f32,
}

impl WildConfig {
    /// Settings where nothing is said.
    #[must_use]
    pub fn new(field: FieldKind, appearance: AppearanceKind, occluders: OccluderKind) -> Self {
        let mlp = field == FieldKind::Mlp;
        let filter = occluders == OccluderKind::Filter;
        Self {
            field,
            appearance,
            occluders,
            appearance_dims: match (mlp, appearance) {
                (true, _) => 48,
                // What the encoder says has an error in each of them.
                (false, AppearanceKind::Encoder) => 6,
                (false, _) => 16,
            },
            transient_dims: match (filter, mlp) {
                (false, true) => 16,
                (false, false) => 32,
                (true, true) => 128,
                (true, false) => 32,
            },
            code_lr: if mlp { 1.0 } else { 0.25 },
            transient_lr: if mlp || occluders == OccluderKind::Transient { 1.0 } else { 0.25 },
            // Where strangers have codes too, light has to be free to move first.
            code_size: match occluders {
                _ if !mlp && appearance == AppearanceKind::Encoder => 3e-2,
                OccluderKind::None | OccluderKind::Robust | OccluderKind::Masks | OccluderKind::Transient if !mlp => {
                    1e-2
                }
                _ => 1e-5,
            },
            encoder_side: if mlp { 128 } else { 32 },
            encoder_channels: if mlp { EncoderConfig::published() } else { EncoderConfig::small() }.channels,
            encoder_lr: if mlp { 1.0 } else { 0.2 },
            encoder_tilts: if mlp { vec![] } else { vec![-10.0, 0.0, 10.0] },
            lattices: if mlp { 1 } else { 0 },
            lattice: 32,
            encoder_photos: 12,
            // Twice the published ones, as half the squared error is not what pixels cost here.
            view_weight: if mlp { 0.0 } else { 2e-3 },
            mode_weight: if mlp { 0.0 } else { 2e-6 },
            view_every: 4,
            kernel: if mlp { KernelKind::Squared } else { KernelKind::Charbonnier },
            kernel_scale: 0.05,
            judging: if mlp { Judging::Batch } else { Judging::Photos },
            judge_first: if mlp { 1000 } else { 50 },
            judge_scale: 4.0,
            trim_quantile: 0.5,
            trim_scale: if mlp { 1.0 } else { 2.0 },
            trim_diffuse: 0.5,
            trim_vote: 0.6,
            patch: 16,
            patch_inner: 8,
            beta_min: match (filter, mlp) {
                (true, true) => 0.03,
                _ => 0.1,
            },
            tail: if mlp || filter { 0.0 } else { 0.05 },
            lambda_u: 0.01,
            visibility_dims: if mlp { 128 } else { 32 },
            visibility_octaves: 10,
            visibility_width: if mlp { 256 } else { 64 },
            visibility_depth: if mlp { 4 } else { 2 },
            visibility_lr: if mlp { 1.0 } else { 0.1 },
            visibility_code_lr: if mlp { 1.0 } else { 0.5 },
            mask_size: 6e-3,
            mask_size_start: 5e-2,
            mask_size_steps: if mlp { 2121 } else { 500 },
            filter_octaves: if mlp { 15 } else { 8 },
            filter_width: if mlp { 128 } else { 64 },
            filter_features: FeatureKind::Files,
            filter_from: String::new(),
            filter_freeze: Freeze::Features,
            filter_sha256: String::new(),
            filter_temperature: 1.0,
            filter_opacity: 0.2,
            filter_smoothness: 5e-7,
            filter_lr: 0.1,
            filter_hold: if mlp { 12_000 } else { 250 },
            filter_ease: if mlp { 10_000 } else { 250 },
            warmup_steps: if mlp { 1000 } else { 100 },
            restart: if mlp { Restart::Anew } else { Restart::On },
            track_share: 0.1,
            segments: SegmentKind::Files,
            superpixels: 400,
            segment_share: if mlp { 0.5 } else { 0.25 },
            file_share: if mlp { 0.5 } else { 0.8 },
        }
    }

    /// Whether batches are made of patches.
    #[must_use]
    pub fn draws_patches(&self) -> bool {
        (self.occluders == OccluderKind::Robust && self.judging == Judging::Batch)
            || (self.appearance == AppearanceKind::Encoder && self.lattices > 0)
    }

    /// What a residual costs that is not left out.
    #[must_use]
    pub fn robust_kernel(&self) -> Kernel {
        let c = self.kernel_scale;
        match self.kernel {
            KernelKind::Squared => Kernel::Squared,
            KernelKind::L1 => Kernel::L1,
            KernelKind::Charbonnier => Kernel::Charbonnier { c },
            KernelKind::Cauchy => Kernel::Cauchy { c },
            KernelKind::GemanMcClure => Kernel::GemanMcClure { c },
            KernelKind::Welsch => Kernel::Welsch { c },
        }
    }

    /// How residuals become masks.
    #[must_use]
    pub fn trimming(&self) -> TrimmedMask {
        TrimmedMask {
            quantile: self.trim_quantile,
            diffuse: self.trim_diffuse,
            vote: self.trim_vote,
            patch: self.patch,
            inner: self.patch_inner,
            ..TrimmedMask::default()
        }
    }

    /// Pixels along a side of those patches.
    #[must_use]
    pub fn patch_side(&self) -> usize {
        if self.occluders == OccluderKind::Robust { self.patch } else { self.lattice }
    }
}
