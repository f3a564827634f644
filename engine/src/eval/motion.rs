//! What is scored of a scene that moves, where the dataset holds the truth: what things that move look like, how far
//! everything is, whether points are found again, and where they go.

use super::masked::{inside, ssim_inside};
use crate::data::View;
use crate::error::RunError;
use crate::render::Rendered;
use image::RgbImage;
use scene_io::DepthMap;
use serde::{Deserialize, Serialize};

/// Scores of motion and depth; `None` where the dataset holds no truth for them. Means over views in an evaluation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MotionScore {
    /// PSNR of the pixels that show things that move at some time, dB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_moving: Option<f64>,
    /// PSNR of the pixels of a held-out view that were hidden when the photo of its time step was taken, dB: the truth about what
    /// does not belong to the place, of a view that shows the place itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_hidden: Option<f64>,
    /// Mean absolute error of z depth there, world units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_hidden: Option<f64>,
    /// PSNR of the others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_still: Option<f64>,
    /// Mean absolute error of z depth over the pixels whose depth is known, world units. A ray that ends nowhere counts with
    /// the whole depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_error: Option<f64>,
    /// The same, relative to the depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_relative: Option<f64>,
    /// PSNR of the pixels that training views show, too, dB (DyCheck's mPSNR: the sum of squares over the number of kept
    /// pixels; the usual one divides by all of them and flatters by `-10 log10(kept share)`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_covisible: Option<f64>,
    /// SSIM there, as DyCheck measures it (mSSIM: windows without a kept pixel count as 1). Pictures of less than 11 pixels
    /// have none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ssim_covisible: Option<f64>,
    /// Mean distance, pixels, from where things that move are shown in the held-out view nearby, to where the system's
    /// canonical points say so: see [`correspondence`](super::correspondence). Systems that warp nothing are scored too: they
    /// say that nothing moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flow_error: Option<f64>,
    /// Share of them that are found within 5 % of the picture's longer side (DyCheck's PCK-T), `0..=1`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flow_found: Option<f64>,
    /// Mean length of the true way until one frame on, of points of things that move, world units; see
    /// [`System::scene_flow`](crate::system::System::scene_flow).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene_motion: Option<f64>,
    /// Mean distance from where these points truly are one frame on to where the system says they are, world units. `None` too where
    /// the system says nothing of where points go.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene_flow_error: Option<f64>,
    /// The same distance in the picture of the view's camera, pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end_point_error: Option<f64>,
    /// As `scene_flow_error`, of points of things that stand still at all times.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene_flow_still: Option<f64>,
    /// As `end_point_error`, of these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end_point_still: Option<f64>,
}

impl MotionScore {
    /// Scores of one view.
    ///
    /// # Errors
    /// [`RunError::Scene`] for truth that cannot be read.
    pub(super) fn of(
        view: &View,
        rendered: &Rendered,
        picture: &RgbImage,
        truth: &RgbImage,
        used: Option<&[u8]>,
    ) -> Result<Self, RunError> {
        let (width, height) = (view.camera.width, view.camera.height);
        let mut score = Self::default();
        let counts = |k: usize| used.is_none_or(|mask| mask[k] >= 128);
        if let Some(moving) = view.source.read_moving()? {
            let moving: Vec<bool> = moving.resized(width, height).iter().collect();
            let mask = |what: bool| -> Vec<u8> {
                moving.iter().enumerate().map(|(k, &m)| if m == what && counts(k) { 255 } else { 0 }).collect()
            };
            score.psnr_moving = inside(picture, truth, &mask(true));
            score.psnr_still = inside(picture, truth, &mask(false));
        }
        if let Some(seen) = view.source.read_covisible()?.filter(|_| view.source.split.is_measured()) {
            let seen = seen.resized(width, height);
            let mask: Vec<u8> = seen.iter().enumerate().map(|(k, m)| if m && counts(k) { 255 } else { 0 }).collect();
            score.psnr_covisible = inside(picture, truth, &mask);
            score.ssim_covisible = ssim_inside(picture, truth, &mask);
        }
        let hidden = view.source.read_transient()?.filter(|_| view.source.split.is_measured());
        let hidden: Option<Vec<bool>> = hidden.map(|hidden| hidden.resized(width, height).iter().collect());
        if let Some(hidden) = &hidden {
            let mask: Vec<u8> = hidden.iter().enumerate().map(|(k, &h)| if h && counts(k) { 255 } else { 0 }).collect();
            score.psnr_hidden = inside(picture, truth, &mask);
        }
        if let Some(depth) = view.source.read_depth()? {
            [score.depth_error, score.depth_relative] = depth_errors(view, rendered, &depth, counts);
            if let Some(hidden) = &hidden {
                [score.depth_hidden, _] = depth_errors(view, rendered, &depth, |k| hidden[k] && counts(k));
            }
        }
        Ok(score)
    }

    /// Means of those that were measured.
    pub(super) fn mean(scores: impl Iterator<Item = Self> + Clone) -> Self {
        let mean = |value: fn(&Self) -> Option<f64>| {
            let values: Vec<f64> = scores.clone().filter_map(|s| value(&s)).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        Self {
            psnr_moving: mean(|s| s.psnr_moving),
            psnr_still: mean(|s| s.psnr_still),
            psnr_hidden: mean(|s| s.psnr_hidden),
            depth_hidden: mean(|s| s.depth_hidden),
            depth_error: mean(|s| s.depth_error),
            depth_relative: mean(|s| s.depth_relative),
            psnr_covisible: mean(|s| s.psnr_covisible),
            ssim_covisible: mean(|s| s.ssim_covisible),
            flow_error: mean(|s| s.flow_error),
            flow_found: mean(|s| s.flow_found),
            scene_motion: mean(|s| s.scene_motion),
            scene_flow_error: mean(|s| s.scene_flow_error),
            end_point_error: mean(|s| s.end_point_error),
            scene_flow_still: mean(|s| s.scene_flow_still),
            end_point_still: mean(|s| s.end_point_still),
        }
    }

    /// Scene flow error as a share of the mean true way: 1 of a system that says that nothing moves. `None` where nothing moved.
    #[must_use]
    pub fn scene_flow_share(&self) -> Option<f64> {
        let way = self.scene_motion.filter(|way| *way > 0.0)?;
        Some(self.scene_flow_error? / way)
    }

    /// Whether anything was measured.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// What was measured, in words.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let mut out = Vec::new();
        if let Some(db) = self.psnr_moving {
            out.push(format!("things that move: {db:.3} dB"));
        }
        if let Some(db) = self.psnr_still {
            out.push(format!("everything else: {db:.3} dB"));
        }
        if let Some(db) = self.psnr_covisible {
            let ssim = self.ssim_covisible.map_or(String::new(), |x| format!(", SSIM {x:.4}"));
            out.push(format!("what training views show, too: {db:.3} dB{ssim}"));
        }
        if let Some(db) = self.psnr_hidden {
            out.push(format!("what was hidden: {db:.3} dB"));
        }
        if let Some(error) = self.depth_hidden {
            out.push(format!("depth of what was hidden: {error:.4} world units off"));
        }
        if let (Some(error), Some(relative)) = (self.depth_error, self.depth_relative) {
            out.push(format!("depth: {error:.4} world units off, {:.2} %", 100.0 * relative));
        }
        if let (Some(error), Some(found)) = (self.flow_error, self.flow_found) {
            out.push(format!(
                "found again in another view, of what moves: {:.1} %, {error:.2} pixels off",
                100.0 * found
            ));
        }
        if let (Some(error), Some(pixels)) = (self.scene_flow_error, self.end_point_error) {
            let share = self.scene_flow_share().map_or(String::new(), |x| format!(", {:.1} % of its way", 100.0 * x));
            out.push(format!(
                "scene flow of what moves, one frame on: {error:.5} world units off{share}, {pixels:.3} pixels"
            ));
        }
        if let (Some(error), Some(pixels)) = (self.scene_flow_still, self.end_point_still) {
            out.push(format!(
                "scene flow of what stands still, one frame on: {error:.5} world units off, {pixels:.3} pixels"
            ));
        }
        out
    }
}

/// Mean absolute and relative error of z depth; the truth is brought to the view's size.
fn depth_errors(
    view: &View,
    rendered: &Rendered,
    truth: &DepthMap,
    counts: impl Fn(usize) -> bool,
) -> [Option<f64>; 2] {
    let (width, height) = (view.camera.width, view.camera.height);
    let (truth, axis) = (truth.resized(width, height), view.camera.optical_axis());
    let (mut sum, mut relative, mut n) = (0.0, 0.0, 0_u64);
    for (k, &z) in truth.z.iter().enumerate() {
        let [x, y] = [k as u32 % width, k as u32 / width];
        let Some(ray) = view.ray(x, y).filter(|_| z > 0.0 && counts(k)) else { continue };
        let t = f64::from(rendered.layers.depth[k]);
        let found = if t.is_finite() { t * ray.d.dot(axis) } else { 0.0 };
        let error = (found - f64::from(z)).abs();
        sum += error;
        relative += error / f64::from(z);
        n += 1;
    }
    let mean = |sum: f64| (n > 0).then(|| sum / n as f64);
    [mean(sum), mean(relative)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Dataset;
    use crate::render::plain_query;
    use crate::system::Layers;
    use glam::DMat3;
    use render_core::camera::Camera;
    use render_core::pose::Pose;
    use scene_io::synthetic::{TabletopOptions, tabletop};
    use scene_io::{
        BitMask, DepthSource, Frame, Image, ImageSource, ImageStore, Scene, Split, StoreOptions, TruthMask,
    };
    use std::sync::Arc;

    const W: u32 = 6;
    const H: u32 = 4;

    /// The left third moves, the lower half was hidden, the first column has no depth.
    fn frame() -> Frame {
        let pose = Pose { r: DMat3::from_rotation_x(0.4), c: [1.0, 2.0, 3.0].into() };
        let camera = Camera::pinhole(W, H, 5.0, 5.0, 3.0, 2.0, pose);
        let image = Image::rgb(W, H, vec![100; 3 * (W * H) as usize]).unwrap();
        let mask = |is_set: fn(u32, u32) -> bool| Some(TruthMask::Memory(Arc::new(BitMask::from_fn(W, H, is_set))));
        let z = (0..W * H).map(|k| if k % W == 0 { 0.0 } else { 2.0 + 0.1 * k as f32 }).collect();
        let mut frame = Frame::new("a", ImageSource::Memory(Arc::new(image)), camera);
        frame.split = Split::Test;
        frame.depth = Some(DepthSource::memory(DepthMap::new(W, H, z).unwrap()));
        frame.truth.moving = mask(|x, _| x < 2);
        frame.truth.transient = mask(|_, y| y >= 2);
        frame
    }

    fn data(frame: Frame) -> Dataset {
        let scene = tabletop(&TabletopOptions { train: 0, test: 0, ..Default::default() });
        let scene = Scene { frames: vec![frame], ..scene };
        let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
        Dataset::new(&scene, store, vec![0]).unwrap()
    }

    /// Scores of a render that is off by 20 steps where things move and by 5 elsewhere, and whose depths are `depth(z)`.
    fn scored(frame: Frame, depth: impl Fn(usize, f32) -> f32, used: Option<&[u8]>) -> MotionScore {
        let data = data(frame);
        let view = data.view(0);
        let z = view.source.read_depth().unwrap().map_or(vec![2.0; (W * H) as usize], |map| map.z);
        let mut layers = Layers::nothing((W * H) as usize, &plain_query([0.0; 3], 0.0));
        for (k, (out, &z)) in layers.depth.iter_mut().zip(&z).enumerate() {
            let ray = view.ray(k as u32 % W, k as u32 / W).unwrap();
            // Along the ray.
            *out = (f64::from(depth(k, z)) / ray.d.dot(view.camera.optical_axis())) as f32;
        }
        let truth = RgbImage::from_pixel(W, H, image::Rgb([100; 3]));
        let picture = RgbImage::from_fn(W, H, |x, _| image::Rgb([if x < 2 { 120 } else { 105 }; 3]));
        let rendered = Rendered { width: W, height: H, layers };
        MotionScore::of(view, &rendered, &picture, &truth, used).unwrap()
    }

    fn db(steps: f64) -> f64 {
        -20.0 * (steps / 255.0).log10()
    }

    fn is(found: Option<f64>, want: f64) {
        assert!((found.unwrap() - want).abs() < 1e-5 * want.abs().max(1.0), "{found:?}, not {want}");
    }

    #[test]
    fn each_part_of_a_picture_has_its_score() {
        let score = scored(frame(), |_, z| 1.1 * z, None);
        is(score.psnr_moving, db(20.0));
        is(score.psnr_still, db(5.0));
        // A third of what was hidden moves.
        is(score.psnr_hidden, db(((400.0 + 2.0 * 25.0) / 3.0_f64).sqrt()));
        is(score.depth_relative, 0.1);
        let known: Vec<f64> = (0..W * H).filter(|k| k % W != 0).map(|k| 2.0 + 0.1 * f64::from(k)).collect();
        is(score.depth_error, 0.1 * known.iter().sum::<f64>() / known.len() as f64);
        let low: Vec<f64> = (2 * W..W * H).filter(|k| k % W != 0).map(|k| 2.0 + 0.1 * f64::from(k)).collect();
        is(score.depth_hidden, 0.1 * low.iter().sum::<f64>() / low.len() as f64);
        let words = score.words();
        assert_eq!(words.len(), 5, "{words:?}");
        assert!(words[0].starts_with("things that move: 22.1") && words[4].ends_with("10.00 %"), "{words:?}");
    }

    #[test]
    fn what_training_views_show_too_is_scored_of_test_views_alone() {
        let mask = TruthMask::Memory(Arc::new(BitMask::from_fn(W, H, |x, _| (1..3).contains(&x))));
        let mut seen = frame();
        seen.truth.covisible = Some(mask);
        let score = scored(seen.clone(), |_, z| z, None);
        is(score.psnr_covisible, db(((400.0 + 25.0) / 2.0_f64).sqrt()));
        assert_eq!(score.ssim_covisible, None, "six pixels are less than a window");
        assert!(score.words()[2].starts_with("what training views show, too: 24.8"), "{:?}", score.words());
        seen.split = Split::Train;
        assert_eq!(scored(seen, |_, z| z, None).psnr_covisible, None);
    }

    #[test]
    fn a_ray_that_ends_nowhere_counts_with_the_whole_depth() {
        let score = scored(frame(), |_, _| f32::INFINITY, None);
        is(score.depth_relative, 1.0);
        let exact = scored(frame(), |_, z| z, None);
        assert!(exact.depth_error.unwrap() < 1e-6 && exact.depth_relative.unwrap() < 1e-6);
    }

    #[test]
    fn pixels_that_are_not_used_do_not_count() {
        let used: Vec<u8> = (0..W * H).map(|k| if k % W == 1 { 255 } else { 0 }).collect();
        let score = scored(frame(), |_, z| 1.1 * z, Some(&used));
        is(score.psnr_moving, db(20.0));
        assert_eq!(score.psnr_still, None, "none of them is left");
        is(score.psnr_hidden, db(20.0));
        let none = scored(frame(), |_, z| z, Some(&[0; 24]));
        assert!(none.is_empty() && none.words().is_empty(), "{none:?}");
    }

    #[test]
    fn nothing_is_said_where_nothing_is_known() {
        let mut bare = frame();
        (bare.depth, bare.truth) = (None, Default::default());
        assert!(scored(bare, |_, z| z, None).is_empty());
        // What a training photo's tool hid is not known.
        let mut training = frame();
        training.split = Split::Train;
        let score = scored(training, |_, z| z, None);
        assert!(score.psnr_hidden.is_none() && score.depth_hidden.is_none() && score.psnr_moving.is_some());
        let holes = DepthSource::memory(DepthMap::new(W, H, vec![0.0; 24]).unwrap());
        let mut without = frame();
        without.depth = Some(holes);
        let score = scored(without, |_, _| 1.0, None);
        assert!(score.depth_error.is_none() && score.depth_relative.is_none() && score.psnr_moving.is_some());
    }

    #[test]
    fn means_are_over_views_that_have_a_score() {
        let of = |moving, depth| MotionScore { psnr_moving: moving, depth_error: depth, ..MotionScore::default() };
        let scores = [of(Some(20.0), None), of(None, Some(0.5)), of(Some(30.0), None)];
        assert_eq!(MotionScore::mean(scores.into_iter()), of(Some(25.0), Some(0.5)));
        assert!(MotionScore::mean([].into_iter()).is_empty());
    }
}
