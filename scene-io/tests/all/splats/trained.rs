//! A cloud that was trained by the code of 3DGS. Skipped, and said so, where the data is not there.

use super::*;
use std::collections::HashMap;

/// Numbers as training makes them: six Gaussians of degree 1.
pub(super) fn small() -> Gaussians {
    let mut cloud = Gaussians::new(6, 1).unwrap();
    let mut state = 1_u32;
    for (field, numbers) in cloud.fields_mut() {
        for x in numbers {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let u = (state >> 8) as f32 / (1 << 23) as f32 - 1.0;
            *x = match field {
                splat_core::Field::LogScale => 2.0 * u - 4.0,
                splat_core::Field::Logit => 4.0 * u,
                _ => 0.9 * u,
            };
        }
    }
    cloud
}

pub(super) fn file() -> Option<PathBuf> {
    let path = "gaussian_ply/trained_iteration_7000/point_cloud/iteration_7000/point_cloud.ply";
    testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), path, "splats")
}

#[test]
fn a_trained_cloud_is_read_and_written_byte_for_byte() {
    let Some(path) = file() else { return };
    let SplatFile { cloud, widening, notes } = read_splats(&path).unwrap();
    assert_eq!((cloud.len(), cloud.degree(), widening, notes), (9080, 3, None, vec![]));
    // Trained colours and sizes are those of a picture, not of columns mixed up.
    let mean = |numbers: &[f32]| numbers.iter().map(|x| f64::from(*x)).sum::<f64>() / numbers.len() as f64;
    let rest: f64 = mean(&cloud.rest.iter().map(|x| x.abs()).collect::<Vec<_>>());
    assert!(rest < 0.1 && (-12.0..6.0).contains(&mean(&cloud.log_scale)), "{rest}, {}", mean(&cloud.log_scale));
    assert!(encode("a.ply", &cloud).0 == std::fs::read(&path).unwrap());
}

#[test]
fn a_trained_cloud_survives_spz() {
    let Some(path) = file() else { return };
    let cloud = read_splats(&path).unwrap().cloud;
    let (bytes, notes) = encode("a.spz", &cloud);
    let back = parse("a.spz", &bytes).unwrap();
    println!("SPZ: {} bytes, of PLY {}; {notes:?}", bytes.len(), std::fs::metadata(&path).unwrap().len());
    let back = back.cloud;
    assert_eq!((back.len(), back.degree()), (9080, 3));
    let far = cloud.mean.iter().fold(0.0_f32, |m, x| m.max(x.abs()));
    assert!(apart(&back.mean, &cloud.mean) <= 2.0 * f64::from(far) * 2_f64.powi(-23));
    let within = |field: &[f32], low: f32, high: f32| field.iter().map(|x| x.clamp(low, high)).collect::<Vec<_>>();
    assert!(apart(&back.log_scale, &within(&cloud.log_scale, -10.0, 5.9375)) <= 0.5 / 16.0 + 1e-6);
    assert!(apart(&back.dc, &within(&cloud.dc, -10.0 / 3.0, 10.0 / 3.0)) <= 0.5 / 255.0 / 0.15 + 1e-6);
    assert!(apart(&back.rest, &within(&cloud.rest, -1.0, 1.0)) <= 0.5 * 16.0 / 128.0 + 1e-6);
    assert!(opacities_apart(&back, &cloud) <= 0.5 / 255.0 + 1e-6);
    assert!(turned(&back, &cloud) < 0.005, "{}", turned(&back, &cloud));
}

#[test]
fn a_trained_cloud_survives_splat() {
    let Some(path) = file() else { return };
    let cloud = read_splats(&path).unwrap().cloud;
    let (bytes, notes) = encode("a.splat", &cloud);
    has_note(&notes, "degree 1 to 3 left out");
    let back = parse("a.splat", &bytes).unwrap().cloud;
    assert_eq!((bytes.len(), back.len(), back.degree()), (32 * 9080, 9080, 0));
    // Positions tell who is who, but for copies that training left where they were made.
    let place = |cloud: &Gaussians, i: usize| [0, 1, 2].map(|k| cloud.mean[9080 * k + i].to_bits());
    let mut whose: HashMap<[u32; 3], Vec<usize>> = HashMap::new();
    (0..9080).for_each(|i| whose.entry(place(&cloud, i)).or_default().push(i));
    let volume = |i: usize| (0..3).map(|k| f64::from(cloud.log_scale[9080 * k + i])).sum::<f64>();
    let keys: Vec<f64> = (0..9080)
        .filter_map(|j| <[usize; 1]>::try_from(whose[&place(&back, j)].as_slice()).ok())
        .map(|[i]| volume(i) + opacity(cloud.logit[i]).ln())
        .collect();
    assert!(keys.len() > 8000);
    assert!(keys.windows(2).all(|w| w[1] <= w[0] + 1e-9));
    let sorted = |field: &[f32]| {
        let mut row = field[..9080].to_vec();
        row.sort_by(f32::total_cmp);
        row
    };
    assert_eq!(sorted(&back.mean), sorted(&cloud.mean));
    assert!(apart(&sorted(&back.log_scale), &sorted(&cloud.log_scale)) < 1e-5);
}
