//! Which photos come before and after each other.

use scene_io::{Frame, Size, Split};

/// A training photo and its neighbours in time: indices of frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) frame: usize,
    pub(super) before: Option<usize>,
    pub(super) after: Option<usize>,
}

/// The training photos in the order of time, at most so many: camera by camera, where several filmed at one time. Held-out photos are
/// no neighbours: nothing may be learnt from them. Nor are photos of another size.
pub(super) fn in_time(frames: &[Frame], most: Option<usize>) -> Vec<Place> {
    let camera = |i: usize| frames[i].ids.map_or(0, |ids| ids.camera);
    let time = |i: usize| frames[i].time.unwrap_or(i as f64);
    let size = |i: usize| Size::from(&frames[i].camera);
    let mut order: Vec<usize> = (0..frames.len()).filter(|i| frames[*i].split == Split::Train).collect();
    // Photos of one time keep the order of the file.
    order.sort_by(|a, b| camera(*a).cmp(&camera(*b)).then(time(*a).total_cmp(&time(*b))));
    order.truncate(most.unwrap_or(usize::MAX));
    let place = |(k, frame): (usize, &usize)| {
        let frame = *frame;
        let is_like = |i: &usize| camera(*i) == camera(frame) && size(*i) == size(frame);
        let before = order[..k].iter().rev().copied().find(|i| camera(*i) != camera(frame) || time(*i) < time(frame));
        let after = order[k..].iter().copied().find(|i| camera(*i) != camera(frame) || time(*i) > time(frame));
        Place { frame, before: before.filter(is_like), after: after.filter(is_like) }
    };
    order.iter().enumerate().map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::synthetic::{OrbitOptions, orbit};
    use scene_io::{FrameIds, Scene};

    fn scene() -> Scene {
        orbit(&OrbitOptions { width: 8, height: 8, train: 5, test: 2, rays: 1, ..OrbitOptions::default() })
    }

    fn numbers(scene: &Scene, most: Option<usize>) -> Vec<(usize, Option<usize>, Option<usize>)> {
        in_time(&scene.frames, most).iter().map(|p| (p.frame, p.before, p.after)).collect()
    }

    #[test]
    fn training_photos_are_neighbours_in_time() {
        let mut scene = scene();
        scene.frames.swap(1, 3);
        let all = [
            (0, None, Some(3)),
            (3, Some(0), Some(2)),
            (2, Some(3), Some(1)),
            (1, Some(2), Some(4)),
            (4, Some(1), None),
        ];
        assert_eq!(numbers(&scene, None), all);
        assert_eq!(numbers(&scene, Some(2)), [(0, None, Some(3)), (3, Some(0), None)]);
        scene.frames[2].split = Split::Test;
        assert_eq!(numbers(&scene, None)[1], (3, Some(0), Some(1)));
    }

    #[test]
    fn photos_of_one_time_or_of_two_sizes_are_no_neighbours() {
        let mut scene = scene();
        scene.frames[2].time = scene.frames[1].time;
        assert_eq!(numbers(&scene, None)[2], (2, Some(0), Some(3)));
        scene.frames[3].camera.width = 9;
        assert_eq!(numbers(&scene, None)[4], (4, None, None));
    }

    #[test]
    fn each_camera_has_its_own_neighbours() {
        let mut scene = scene();
        for (i, frame) in scene.frames.iter_mut().enumerate() {
            frame.ids = Some(FrameIds { time: i as u32, appearance: 0, camera: (i % 2) as u32 });
        }
        let all =
            [(0, None, Some(2)), (2, Some(0), Some(4)), (4, Some(2), None), (1, None, Some(3)), (3, Some(1), None)];
        assert_eq!(numbers(&scene, None), all);
    }
}
