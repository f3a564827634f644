//! What the tests of several scenes ask.

use crate::{ImageSource, Scene};

/// The bytes of all pictures, which are in memory.
pub(in crate::synthetic) fn pixels(scene: &Scene) -> Vec<&[u8]> {
    fn data(image: &ImageSource) -> &[u8] {
        match image {
            ImageSource::Memory(image) => &image.data,
            ImageSource::File(path) => panic!("{} is a file", path.display()),
        }
    }
    scene.frames.iter().map(|f| data(&f.image)).collect()
}

/// A scene made with a number of threads.
pub(in crate::synthetic) fn on_threads(threads: usize, scene: impl FnOnce() -> Scene + Send) -> Scene {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(scene)
}

/// `run(seed, threads)` gives the same scene with any number of threads, and other pictures with another seed.
pub(in crate::synthetic) fn is_deterministic(run: impl Fn(u64, usize) -> Scene) {
    let (a, b, c) = (run(3, 1), run(3, 3), run(4, 2));
    assert_eq!(pixels(&a), pixels(&b));
    assert_ne!(pixels(&a), pixels(&c));
    for (a, b) in a.frames.iter().zip(&b.frames) {
        assert!(a.camera == b.camera && a.name == b.name && a.time == b.time);
        assert_eq!(a.read_moving().unwrap().unwrap(), b.read_moving().unwrap().unwrap());
        assert_eq!(a.read_depth().unwrap(), b.read_depth().unwrap());
        assert_eq!(a.read_flow().unwrap(), b.read_flow().unwrap());
        assert_eq!(a.truth.scene_flow, b.truth.scene_flow);
    }
}
