//! Pictures of splats through a lens are those of a camera without, bent.

use engine::render::plain_query;
use render_core::camera::{Camera, Lens, Pose};
use splat_core::{Gaussians, RasterSettings};
use systems::splats::Cloud;

/// Specks smaller than a pixel, a pixel or so apart.
fn specks() -> Cloud {
    let mut cloud = Gaussians::new(400, 0).unwrap();
    let n = cloud.len();
    for i in 0..n {
        let (x, y) = ((i % 20) as f32 - 9.5, (i / 20) as f32 - 9.5);
        for (k, at) in [0.09 * x, 0.09 * y, 2.0 + 0.01 * (x * y)].into_iter().enumerate() {
            cloud.mean[k * n + i] = at;
        }
        for k in 0..3 {
            cloud.dc[k * n + i] = ((i * (k + 3)) % 7) as f32 * 0.4 - 1.0;
        }
        cloud.wxyz[i] = 1.0;
    }
    cloud.log_scale.fill(0.004_f32.ln());
    cloud.logit.fill(3.0);
    Cloud::new(cloud, RasterSettings::DEFAULT)
}

#[test]
fn a_lens_that_hardly_bends_changes_hardly_anything() {
    let cloud = specks();
    let straight = Camera::pinhole(48, 40, 45.0, 45.0, 24.0, 20.0, Pose::IDENTITY);
    let bent = Camera { lens: Lens::Perspective { k: [1e-9, 0.0, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] }, ..straight };
    let query = plain_query([0.0; 3], 0.0);
    let [a, b] = [straight, bent].map(|camera| cloud.render(&camera, &query).unwrap().layers);
    let sum = |rgb: &[[f32; 3]]| rgb.as_flattened().iter().map(|x| f64::from(*x)).sum::<f64>();
    let square = a.rgb.as_flattened().iter().zip(b.rgb.as_flattened()).map(|(a, b)| f64::from(a - b).powi(2));
    let psnr = -10.0 * (square.sum::<f64>() / (3.0 * a.rgb.len() as f64)).log10();
    println!("{psnr:.2} dB; {:.3} and {:.3} of light", sum(&a.rgb), sum(&b.rgb));
    assert!(sum(&a.rgb) > 100.0, "there is something to see");
    // The canvas is finer, and interpolated.
    assert!(psnr > 30.0, "{psnr} dB");
    assert!((sum(&a.rgb) / sum(&b.rgb) - 1.0).abs() < 0.02, "as much light");
}
