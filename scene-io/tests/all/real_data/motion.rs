//! Flow and masks of a DAVIS video.

use super::data;
use render_core::camera::{Camera, Pose};
use scene_io::{Frame, ImageSource, write_flo};

#[test]
fn flow_and_masks_of_a_real_video_are_read_and_written_again() {
    let Some(path) = data("davis/tennis") else { return };
    let folder = tempfile::tempdir().unwrap();
    for k in 1..=4 {
        let camera = Camera::pinhole(448, 256, 400.0, 400.0, 224.0, 128.0, Pose::IDENTITY);
        let photo = ImageSource::File(path.join(format!("rgb/{k:04}.jpg")));
        let mut frame = Frame::new(format!("{k:04}"), photo, camera);
        let file = path.join(format!("flow_sample/{k:04}.flo"));
        frame.priors.motion.forward = Some(file.clone());
        frame.priors.motion.mask = Some(path.join(format!("mask/{k:04}.png")));
        let flow = frame.read_flow_prior().unwrap().forward.unwrap();
        assert_eq!((flow.width, flow.height, flow.seen.count()), (448, 256, 448 * 256));
        if k == 1 {
            let first = [[0xa3, 0x04, 0x99, 0x3f], [0x6c, 0x87, 0xa6, 0xbd]].map(f32::from_le_bytes);
            assert_eq!(flow.vectors[0], first);
        }
        // All of it is valid, so the bytes are the same.
        let again = folder.path().join("again.flo");
        write_flo(&again, &flow).unwrap();
        assert!(std::fs::read(&again).unwrap() == std::fs::read(&file).unwrap(), "{}", file.display());
        let mask = frame.read_motion_mask().unwrap().unwrap();
        let share = mask.count() as f64 / (448.0 * 256.0);
        assert!(share > 0.03 && share < 0.04, "{share}");
        // The camera follows the player: what moves differs from the rest.
        let mean = |moves: bool| {
            let of = flow.vectors.iter().zip(mask.iter()).filter(|(_, m)| *m == moves);
            let across: Vec<f64> = of.map(|(vector, _)| f64::from(vector[0])).collect();
            across.iter().sum::<f64>() / across.len().max(1) as f64
        };
        assert!((mean(true) - mean(false)).abs() > 5.0, "{} {}", mean(true), mean(false));
    }
}
