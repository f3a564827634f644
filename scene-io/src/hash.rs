//! A fingerprint of a scene, so that a run is resumed on the data it was started on.

use crate::Scene;
use render_core::camera::Lens;
use sha2::{Digest, Sha256};

impl Scene {
    /// SHA-256, in hex, over names, image sizes, cameras, splits and times of all frames in order, which have
    /// masks, and what is done to pictures when they are decoded.
    ///
    /// Pixels are not part of it (they are not read), nor are paths: a dataset may move.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let mut hash = Sha256::new();
        let text = |hash: &mut Sha256, text: &str| {
            hash.update((text.len() as u64).to_le_bytes());
            hash.update(text.as_bytes());
        };
        hash.update(b"wildfield scene 1");
        text(&mut hash, self.dialect.name());
        hash.update((self.frames.len() as u64).to_le_bytes());
        for frame in &self.frames {
            let camera = &frame.camera;
            text(&mut hash, &frame.name);
            text(&mut hash, frame.split.name());
            hash.update(camera.width.to_le_bytes());
            hash.update(camera.height.to_le_bytes());
            hash.update([u8::from(frame.mask.is_some()), u8::from(frame.time.is_some())]);
            let mut numbers = vec![camera.fx, camera.fy, camera.cx, camera.cy, frame.time.unwrap_or(0.0)];
            numbers.extend(camera.pose.r.to_cols_array());
            numbers.extend(camera.pose.c.to_array());
            match camera.lens {
                Lens::Perspective { k, p } => {
                    numbers.push(0.0);
                    numbers.extend(k);
                    numbers.extend(p);
                }
                Lens::Fisheye { k } => {
                    numbers.push(1.0);
                    numbers.extend(k);
                }
                Lens::Fov { omega } => numbers.extend([2.0, omega]),
                Lens::ThinPrismFisheye { k, p, s } => {
                    numbers.push(3.0);
                    numbers.extend(k);
                    numbers.extend(p);
                    numbers.extend(s);
                }
            }
            if let Some(ids) = &frame.ids {
                numbers.extend([ids.time, ids.appearance, ids.camera].map(f64::from));
            }
            if let Some(perturbation) = &frame.perturbation {
                numbers.extend(perturbation.numbers());
            }
            for number in numbers {
                // -0 and 0 are the same camera.
                hash.update((number + 0.0).to_le_bytes());
            }
        }
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}
