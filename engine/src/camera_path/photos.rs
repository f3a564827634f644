//! A smooth path through the training cameras.

use super::BOUND;
use super::rig::{Rig, best, median};
use super::stretch::{Coverage, Frames, SeenPart, Track, seen_part};
use crate::error::RunError;
use glam::{DMat3, DVec3};
use render_core::camera::{Camera, Pose};
use render_core::path::{Ends, Rail, order};

/// Cameras that a path leads through, at most: of a sequence, and of a tour.
const SEQUENCE: usize = 64;
const TOUR: usize = 24;
/// A tour of fewer frames is not made shorter.
const FEW: usize = 6;
/// Way between two frames at most, in the measure of [`order::pose_distance`]: faster is too fast to look at. Frames are counted as
/// [`SLOW`] at least, so that two frames are not two neighbours.
const FASTEST: f64 = 0.15;
const SLOW: usize = 60;
/// A step this many times the usual one, and longer than the second, ends a sequence: the video was cut.
const CUT: [f64; 2] = [6.0, 0.5];
/// Smoothing: in steps between keys, and as a part of the way.
const CALM: [f64; 2] = [0.6, 1.0 / 24.0];
/// What is tried where frames leave what photos saw: less smoothing, then a longer focal length.
const TRIES: [[f64; 2]; 3] = [[1.0, 1.0], [0.3, 1.0], [0.3, 1.2]];
/// How far keys are turned to what most photos look at, as a part of the angle; less from the first of these angles on (radians),
/// and not at all from the second.
const AIM: f64 = 0.5;
const ELSEWHERE: [f64; 2] = [0.6, 1.0];
/// A path that keeps this much of its way is good.
const ENOUGH: f64 = 0.6;

/// Whether neighbours in order of time or name are near each other.
pub(super) fn is_sequence(rig: &Rig) -> bool {
    order::is_sequence(&rig.poses, rig.scale)
}

/// A key turned part of the way to what most photos look at, without a roll: a photo of a detail shows more of the thing then.
/// One that looks elsewhere keeps its view.
fn aimed(pose: &Pose, focus: DVec3) -> Pose {
    let (ahead, Some(to)) = (pose.r.z_axis, (focus - pose.c).try_normalize()) else { return *pose };
    let away = ahead.angle_between(to);
    let share = AIM * ((ELSEWHERE[1] - away) / (ELSEWHERE[1] - ELSEWHERE[0])).clamp(0.0, 1.0);
    let Some(axis) = ahead.cross(to).try_normalize() else { return *pose };
    Pose { r: DMat3::from_axis_angle(axis, share * away) * pose.r, c: pose.c }
}

/// Frames through the photos, and a line about which; `None` without photos.
pub(super) fn photos(
    rig: &Rig,
    frames: Frames,
    coverage: Option<Coverage<'_>>,
) -> Result<Option<(Vec<Camera>, String)>, RunError> {
    let (keys, how) = keys(rig, frames);
    let mut keys: Vec<Pose> = keys.iter().map(|pose| rig.focus.map_or(*pose, |focus| aimed(pose, focus))).collect();
    if let Some(coverage) = coverage {
        keys = seen_keys(rig, keys, coverage)?;
    }
    let count = keys.len();
    let ends = ends(&keys, rig.scale);
    let steps: Vec<f64> = keys.windows(2).map(|w| order::pose_distance(&w[0], &w[1], rig.scale)).collect();
    let usual = median(steps.clone()).unwrap_or(0.0);
    let way: f64 = steps.iter().sum();
    let wide = (CALM[0] * usual).max(CALM[1] * way);
    let rail = |calm: f64| Rail::new(&keys, ends, rig.scale, wide * calm);
    let Some(coverage) = coverage else {
        let Some(rail) = rail(1.0) else { return Ok(None) };
        let cameras = rail.frames(frames).into_iter().map(|pose| rig.camera(pose)).collect();
        return Ok(Some((cameras, format!("through {count} photos {how}"))));
    };
    let mut found: Vec<(SeenPart<Rail>, Camera)> = Vec::new();
    for [calm, focal] in TRIES {
        let Some(rail) = rail(calm) else { return Ok(None) };
        let optics = Camera { fx: rig.optics.fx * focal, fy: rig.optics.fy * focal, ..rig.optics };
        let kept = seen_part(rail, |pose| Camera { pose, ..optics }, coverage)?;
        let good = kept.passed && kept.share >= ENOUGH;
        found.push((kept, optics));
        if good {
            break;
        }
    }
    let value = |(kept, _): &(SeenPart<Rail>, Camera)| if kept.passed { 1.0 + kept.share } else { 0.0 };
    let Some((kept, optics)) = best(found, value) else { return Ok(None) };
    let part = if kept.share < 0.995 {
        format!(", the {:.0} % of the way that two photos saw", 100.0 * kept.share)
    } else {
        String::new()
    };
    let cameras = kept.track.frames(frames).into_iter().map(|pose| Camera { pose, ..optics }).collect();
    Ok(Some((cameras, format!("through {count} photos {how}{part}"))))
}

/// The cameras that the path leads through, in its order, and how they were chosen.
fn keys(rig: &Rig, frames: Frames) -> (Vec<Pose>, &'static str) {
    let longest = FASTEST * frames.0.max(SLOW) as f64;
    if is_sequence(rig) {
        let moving = rig.times.first() != rig.times.last();
        // Of a scene that moves all of the time is shown, however fast.
        let piece = if moving { rig.poses.clone() } else { window(&piece(rig), rig.scale, longest) };
        let near: Vec<Pose> = order::without_outliers(&piece, rig.scale).into_iter().map(|i| piece[i]).collect();
        let how = if moving { "in order of time" } else { "in order of names" };
        return (thinned(&near, SEQUENCE), how);
    }
    let near: Vec<Pose> = order::without_outliers(&rig.poses, rig.scale).into_iter().map(|i| rig.poses[i]).collect();
    let mut count = TOUR;
    loop {
        let few: Vec<Pose> = order::farthest_points(&near, rig.scale, count).into_iter().map(|i| near[i]).collect();
        let way: Vec<Pose> = order::tour(&few, rig.scale).into_iter().map(|i| few[i]).collect();
        if order::path_length(&way, rig.scale) <= longest || count <= FEW {
            return (way, "by the shortest way");
        }
        count -= 2;
    }
}

/// The longest piece of a sequence without a cut.
fn piece(rig: &Rig) -> Vec<Pose> {
    let steps: Vec<f64> = rig.poses.windows(2).map(|w| order::pose_distance(&w[0], &w[1], rig.scale)).collect();
    let usual = median(steps.clone()).unwrap_or(0.0);
    let cuts = (0..steps.len()).filter(|&i| steps[i] > CUT[0] * usual && steps[i] > CUT[1]).map(|i| i + 1);
    let bounds: Vec<usize> = [0].into_iter().chain(cuts).chain([rig.poses.len()]).collect();
    let pieces = bounds.windows(2).map(|w| &rig.poses[w[0]..w[1]]);
    best(pieces, |piece| piece.len() as f64).unwrap_or_default().to_vec()
}

/// The part of a sequence with most photos of all that are not longer than `longest`.
fn window(poses: &[Pose], scale: f64, longest: f64) -> Vec<Pose> {
    let mut at = vec![0.0];
    at.extend(poses.windows(2).scan(0.0, |sum, w| {
        *sum += order::pose_distance(&w[0], &w[1], scale);
        Some(*sum)
    }));
    let end = |first: usize| (first..poses.len()).take_while(|&i| at[i] - at[first] <= longest).count();
    let first = best(0..poses.len(), |&i| end(i) as f64).unwrap_or(0);
    poses.iter().skip(first).take(end(first)).copied().collect()
}

/// At most `n` of a sequence, evenly, with its ends.
fn thinned(poses: &[Pose], most: usize) -> Vec<Pose> {
    if poses.len() <= most {
        return poses.to_vec();
    }
    (0..most).map(|k| poses[k * (poses.len() - 1) / (most - 1)]).collect()
}

/// Keys that show what another photo saw, too; the best of them where few do.
fn seen_keys(rig: &Rig, keys: Vec<Pose>, coverage: Coverage<'_>) -> Result<Vec<Pose>, RunError> {
    // The photos of a sequence are many: those between measured ones are as good as they are.
    let stride = keys.len().div_ceil(TOUR).max(1);
    let cameras: Vec<Camera> = keys.iter().step_by(stride).map(|pose| rig.camera(*pose)).collect();
    let shares = coverage.shares(&cameras)?;
    let mut sorted = shares.clone();
    sorted.sort_unstable_by(|a, b| b.total_cmp(a));
    let least = (shares.len() / 3).max(3).min(shares.len());
    let bound = sorted.get(least.saturating_sub(1)).map_or(0.0, |share| share.min(BOUND));
    Ok(keys.into_iter().enumerate().filter(|(i, _)| shares[i / stride] >= bound).map(|(_, pose)| pose).collect())
}

/// Whether the last key is as near to the first as keys are to each other.
fn ends(keys: &[Pose], scale: f64) -> Ends {
    let (Some(first), Some(last)) = (keys.first(), keys.last()) else { return Ends::Open };
    let steps: Vec<f64> = keys.windows(2).map(|w| order::pose_distance(&w[0], &w[1], scale)).collect();
    let longest = steps.iter().copied().fold(0.0, f64::max);
    let back = order::pose_distance(last, first, scale);
    let around = keys.len() >= 6 && back <= 1.5 * longest && back < 0.2 * steps.iter().sum::<f64>();
    if around { Ends::Closed } else { Ends::Open }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_turned_half_of_the_way_to_the_thing_and_not_at_all_from_elsewhere() {
        let level = Pose::look_at(DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
        let turned = aimed(&level, DVec3::new(5.0, 0.0, 5.0 * 0.4_f64.tan()));
        assert!((turned.r.z_axis.angle_between(DVec3::X) - 0.2).abs() < 1e-9);
        assert!(turned.r.x_axis.z.abs() < 1e-12, "without a roll");
        for focus in [DVec3::NEG_X, DVec3::Z * 3.0, DVec3::ZERO, DVec3::X] {
            assert_eq!(aimed(&level, focus), level, "{focus}");
        }
    }

    #[test]
    fn a_window_holds_as_many_photos_as_fit() {
        let at = |x: f64| Pose { c: DVec3::X * x, ..Pose::IDENTITY };
        let poses: Vec<Pose> = [0.0, 2.0, 4.0, 5.0, 5.5, 6.0, 9.0].map(at).to_vec();
        let found = window(&poses, 1.0, 2.5);
        assert_eq!((found.len(), found[0].c.x), (4, 4.0));
        assert_eq!(window(&poses, 1.0, 100.0).len(), 7);
        assert!(window(&[], 1.0, 1.0).is_empty());
        assert_eq!(thinned(&poses, 3).iter().map(|p| p.c.x).collect::<Vec<_>>(), [0.0, 5.0, 9.0]);
    }
}
