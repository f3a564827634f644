//! Whether a system knows where the surface points of things are one frame on, where the truth is known.
//!
//! Points whose way is exactly known ([`SceneFlow`]) are given to the system where they truly are, so that errors of its depth do not
//! count. How far the end of the way that it says is from the true end counts: in world units (scene flow error), and in pixels of the
//! view's camera, which stays where it is (end-point error). Things that move at some time and things that stand still have scores of
//! their own: a system that says that nothing moves is off by the whole way of the former, and right about the latter.
//!
//! A system that says nothing of where points go has no such scores. That is not the same as saying that they stay.

use super::motion::MotionScore;
use crate::data::View;
use crate::system::{FlowSource, System};
use glam::DVec3;
use render_core::camera::Camera;
use scene_io::SceneFlow;

/// Write what a system says of the points of a view into its scores; nothing where the truth is not known.
pub(super) fn score(system: &dyn System, view: &View, score: &mut MotionScore) {
    let Some(truth) = &view.source.truth.scene_flow else { return };
    let points: Vec<[f64; 3]> = truth.points.iter().map(|point| point.x).collect();
    let mut said = vec![None; points.len()];
    let says = system.flow_source() != FlowSource::Nothing;
    if says {
        system.scene_flow(&points, view.time, truth.to, &mut said);
    }
    compare(truth, says, &said, &view.camera, score);
}

/// Scores of what is `said` of the points of `truth`, `[points]`; none where a system `says` nothing of them.
fn compare(truth: &SceneFlow, says: bool, said: &[Option<[f64; 3]>], camera: &Camera, score: &mut MotionScore) {
    let [moving, still] = [true, false].map(|moves| means(truth, said, camera, moves));
    score.scene_motion = moving.map(|of| of.way);
    if !says {
        return;
    }
    (score.scene_flow_error, score.end_point_error) = moving.map(|of| (of.error, of.pixels)).unzip();
    (score.scene_flow_still, score.end_point_still) = still.map(|of| (of.error, of.pixels)).unzip();
}

/// Means over points of one kind.
#[derive(Clone, Copy, Debug)]
struct Means {
    /// Length of the true way, world units.
    way: f64,
    /// Distance between the ends of the two ways, world units.
    error: f64,
    /// The same in the picture, pixels.
    pixels: f64,
}

/// Means over the points of things that move, or of those that do not; `None` where there are none. A point of which nothing is said
/// counts as one that stays.
fn means(truth: &SceneFlow, said: &[Option<[f64; 3]>], camera: &Camera, moves: bool) -> Option<Means> {
    let camera = camera.prepare();
    let longer = f64::from(camera.camera().width.max(camera.camera().height));
    let (mut sum, mut n) = (Means { way: 0.0, error: 0.0, pixels: 0.0 }, 0_u64);
    for (point, said) in truth.points.iter().zip(said).filter(|(point, _)| point.moves == moves) {
        let [x, way] = [point.x, point.way].map(DVec3::from);
        let said = said.map_or(DVec3::ZERO, DVec3::from);
        sum.way += way.length();
        sum.error += (said - way).length();
        let ends = camera.project(x + said).zip(camera.project(x + way));
        // What is behind the camera, or far beside the picture, is no farther off than all of it.
        sum.pixels += ends.map_or(longer, |(said, true_end)| (said - true_end).length().min(longer));
        n += 1;
    }
    let mean = |sum: f64| sum / n as f64;
    (n > 0).then(|| Means { way: mean(sum.way), error: mean(sum.error), pixels: mean(sum.pixels) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Dataset;
    use crate::system::follow_canonical;
    use scene_io::synthetic::{MouthOptions, OrbitOptions, Tissue, TissueOptions, mouth, orbit, tissue};
    use scene_io::{ImageStore, Scene, Split, StoreOptions};
    use std::sync::Arc;

    fn small_tissue() -> TissueOptions {
        TissueOptions { width: 40, height: 30, frames: 13, rays: 1, ..TissueOptions::default() }
    }

    fn made_orbit() -> Scene {
        orbit(&OrbitOptions { width: 40, height: 40, train: 30, test: 4, rays: 1, ..OrbitOptions::default() })
    }

    fn made_mouth() -> Scene {
        mouth(&MouthOptions { width: 40, height: 40, train: 30, val: 0, test: 4, rays: 1, ..MouthOptions::default() })
    }

    /// Scores of what is said of the points of the held-out views at their time.
    fn scored(scene: &Scene, says: impl Fn(f64, &SceneFlow) -> Vec<Option<[f64; 3]>>) -> MotionScore {
        let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
        let data = Dataset::new(scene, store, scene.split(Split::Test).collect()).unwrap();
        let one = |view: &View| {
            let truth = view.source.truth.scene_flow.as_ref().unwrap();
            let mut score = MotionScore::default();
            let said = says(view.time, truth);
            compare(truth, said.iter().any(Option::is_some), &said, &view.camera, &mut score);
            score
        };
        let scores: Vec<MotionScore> = data.views().iter().map(one).collect();
        MotionScore::mean(scores.iter().copied())
    }

    /// What is said of each point, whatever the time.
    fn of_each(says: impl Fn([f64; 3]) -> Option<[f64; 3]>) -> impl Fn(f64, &SceneFlow) -> Vec<Option<[f64; 3]>> {
        move |_, truth| truth.points.iter().map(|point| says(point.way)).collect()
    }

    fn is(found: Option<f64>, want: f64) {
        assert!((found.unwrap() - want).abs() < 1e-9, "{found:?}, not {want}");
    }

    #[test]
    fn who_says_that_nothing_moves_is_off_by_the_whole_way() {
        for scene in [made_orbit(), made_mouth(), tissue(&small_tissue())] {
            let score = scored(&scene, of_each(|_| Some([0.0; 3])));
            println!("{}: {score:?}", scene.name);
            is(score.scene_flow_share(), 1.0);
            assert!(score.scene_flow_error.unwrap() > 1e-3 && score.end_point_error.unwrap() > 0.05, "{score:?}");
            // All of the tissue moves.
            assert_eq!(score.scene_flow_still.is_some(), scene.name != "tissue");
            assert!(score.scene_flow_still.is_none_or(|error| error < 1e-12), "{score:?}");
            assert!(score.end_point_still.is_none_or(|error| error < 1e-9), "{score:?}");
        }
    }

    #[test]
    fn an_exact_canonical_map_is_off_by_nothing() {
        let options = small_tissue();
        let (sheet, scene) = (Tissue::new(options.seed, options.tool), tissue(&options));
        let rest = sheet.at(0.0);
        let map = |points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]| {
            let now = sheet.at(time);
            for (out, &x) in out.iter_mut().zip(points) {
                let x = DVec3::from(x);
                let material = now.material(x);
                // What is before the tissue or behind it goes with it.
                *out = (rest.place(material) + (x - now.place(material))).to_array();
            }
        };
        let bounds = scene.bounds.unwrap();
        let bounds = [bounds.min, bounds.max].map(|corner| corner.to_array());
        let score = scored(&scene, |time, truth| {
            let points: Vec<[f64; 3]> = truth.points.iter().map(|point| point.x).collect();
            let mut said = vec![None; points.len()];
            follow_canonical(&map, bounds, &points, [time, truth.to], &mut said);
            said
        });
        println!("{score:?}");
        assert!(score.scene_flow_share().unwrap() < 1e-3 && score.end_point_error.unwrap() < 1e-3, "{score:?}");
        assert!(score.scene_motion.unwrap() > 0.5, "{score:?}");
    }

    #[test]
    fn errors_are_as_large_as_they_are() {
        let scene = made_orbit();
        let aside = scored(&scene, of_each(|way| Some([way[0] + 0.01, way[1], way[2]])));
        is(aside.scene_flow_error, 0.01);
        is(aside.scene_flow_still, 0.01);
        // A focal length of 64.7 pixels, 4 units away: 0.16 pixels across the line of sight, less along it.
        for pixels in [aside.end_point_error, aside.end_point_still] {
            assert!((0.02..0.25).contains(&pixels.unwrap()), "{aside:?}");
        }
        let half = scored(&scene, of_each(|way| Some(way.map(|x| 0.5 * x))));
        is(half.scene_flow_share(), 0.5);
        // Behind all cameras.
        let far = scored(&scene, of_each(|_| Some([0.0, 0.0, 1e6])));
        assert_eq!(far.end_point_error, Some(40.0));
    }

    #[test]
    fn what_says_nothing_has_no_score_and_not_a_good_one() {
        let scene = made_orbit();
        let silent = scored(&scene, of_each(|_| None));
        assert!(silent.scene_motion.unwrap() > 0.0);
        let scores = [silent.scene_flow_error, silent.end_point_error, silent.scene_flow_still, silent.end_point_still];
        assert_eq!((scores, silent.scene_flow_share()), ([None; 4], None));
        assert!(silent.words().is_empty(), "{:?}", silent.words());
        // A point that is left out counts as one that stays.
        let partly = scored(&scene, of_each(|way| if way[0] > 0.0 { Some(way) } else { None }));
        assert!((0.05..0.95).contains(&partly.scene_flow_share().unwrap()), "{partly:?}");
        assert_eq!(partly.words().len(), 2);
    }

    #[test]
    fn without_truth_there_is_nothing_to_score() {
        let scene = orbit(&OrbitOptions { width: 8, height: 8, train: 1, test: 1, rays: 1, ..OrbitOptions::default() });
        assert!(scene.frames.iter().all(|frame| frame.truth.scene_flow.is_none()));
        let no_truth = SceneFlow { to: 0.5, points: Vec::new() };
        let mut score = MotionScore::default();
        compare(&no_truth, true, &[], &scene.frames[0].camera, &mut score);
        assert!(score.is_empty());
    }
}
