//! `.splat`.

use super::*;

/// A record by hand.
fn record(mean: [f32; 3], scale: [f32; 3], rgba: [u8; 4], q: [u8; 4]) -> Vec<u8> {
    let mut bytes: Vec<u8> = mean.into_iter().chain(scale).flat_map(f32::to_le_bytes).collect();
    bytes.extend(rgba);
    bytes.extend(q);
    bytes
}

#[test]
fn records_built_by_hand_are_read() {
    let e = std::f32::consts::E;
    let bytes = [
        record([1.0, -2.0, 3.5], [1.0, e, 1.0 / e], [255, 0, 51, 204], [255, 128, 128, 1]),
        record([0.0; 3], [2.0; 3], [128; 4], [128; 4]),
    ]
    .concat();
    let SplatFile { cloud, widening, notes } = parse("a.splat", &bytes).unwrap();
    assert_eq!((cloud.len(), cloud.degree(), widening), (2, 0, None));
    assert_eq!([cloud.mean[0], cloud.mean[2], cloud.mean[4]], [1.0, -2.0, 3.5]);
    assert!(apart(&[cloud.log_scale[0], cloud.log_scale[2], cloud.log_scale[4]], &[0.0, 1.0, -1.0]) < 1e-6);
    let colour = [0, 2, 4].map(|k| 0.5 + SH_0 * cloud.dc[k]);
    assert!(apart(&colour, &[1.0, 0.0, 0.2]) < 1e-6);
    assert!((opacity(cloud.logit[0]) - 0.8).abs() < 1e-6);
    assert!(apart(&[cloud.wxyz[0], cloud.wxyz[6]], &[0.5_f32.sqrt(), -(0.5_f32.sqrt())]) < 1e-6);
    // No direction: not turned.
    assert_eq!([1, 3, 5, 7].map(|k| cloud.wxyz[k]), [1.0, 0.0, 0.0, 0.0]);
    assert_eq!(notes, ["1 rotation without direction taken as none"]);
}

#[test]
fn ends_of_the_ranges_become_useful_numbers() {
    let plain = |scale: [f32; 3], a: u8| record([0.0; 3], scale, [9, 9, 9, a], [255, 128, 128, 128]);
    let bytes = [
        plain([0.0, 1.0, 1.0], 0),
        plain([-1.0, 1.0, 1.0], 255),
        plain([f32::NAN, 1.0, 1.0], 7),
        plain([f32::INFINITY, 1.0, 1.0], 7),
        record([f32::NAN, 0.0, 0.0], [1.0; 3], [9; 4], [9; 4]),
    ]
    .concat();
    let file = parse("a.splat", &bytes).unwrap();
    assert_eq!(file.cloud.len(), 2);
    assert_eq!(file.cloud.log_scale[..2], [-20.0, 0.0]);
    assert!(file.cloud.logit[0] < -13.8 && file.cloud.logit[1] > 13.8);
    for note in ["3 Gaussians that are not finite", "1 Gaussian without extent", "2 opacities", "1 negative size"] {
        has_note(&file.notes, note);
    }
}

#[test]
fn cuts_inside_a_record_are_errors() {
    let cloud = trained::small();
    let bytes = encode("a.splat", &cloud).0;
    assert_eq!(bytes.len(), 32 * cloud.len());
    for length in 0..bytes.len() {
        match parse("a.splat", &bytes[..length]) {
            Ok(file) => assert_eq!(32 * file.cloud.len(), length),
            Err(error) => assert!(length % 32 != 0 && error.to_string().contains("not a multiple of 32"), "{error}"),
        }
    }
}

#[test]
fn what_covers_most_comes_first() {
    let mut cloud = Gaussians::new(4, 0).unwrap();
    cloud.mean[..4].copy_from_slice(&[0.0, 1.0, 2.0, 3.0]);
    cloud.log_scale[..4].copy_from_slice(&[0.0, 2.0, 0.0, 1.0]);
    cloud.logit.copy_from_slice(&[0.0, -700.0, 0.0, 0.0]);
    let file = parse("a.splat", &encode("a.splat", &cloud).0).unwrap();
    // Of two alike, the first stays first.
    assert_eq!(file.cloud.mean[..4], [3.0, 0.0, 2.0, 1.0]);
}

#[test]
fn what_is_lost_is_said_and_what_does_not_fit_refused() {
    let mut cloud = Gaussians::new(2, 2).unwrap();
    cloud.dc[1] = 3.0;
    cloud.log_scale[0] = -150.0;
    (0..4).for_each(|k| cloud.wxyz[2 * k + 1] = 0.0);
    let (bytes, notes) = encode("a.splat", &cloud);
    for note in ["degree 1 to 2 left out", "1 colour outside [0, 1]", "1 size below", "1 rotation without direction"] {
        has_note(&notes, note);
    }
    assert_eq!(parse("a.splat", &bytes).unwrap().notes, Vec::<String>::new());
    cloud.log_scale[3] = 89.0;
    let written = encode_splats(Path::new("a.splat"), &cloud, &SplatOptions::default());
    refused(written, &["`log_scale[1]` = 89", "Gaussian 1 is larger"]);
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn a_cloud_comes_back_within_one_step(cloud in any_cloud(0..=0_usize, 8)) {
        let n = cloud.len();
        let (bytes, notes) = encode("a.splat", &cloud);
        prop_assert!(notes.is_empty(), "{notes:?}");
        let back = parse("a.splat", &bytes).unwrap().cloud;
        prop_assert_eq!(back.len(), n);
        for j in 0..n {
            // Positions are exact, so they tell who is who.
            let of = |field: &[f32], rows: usize, i: usize| (0..rows).map(|k| field[k * n + i]).collect::<Vec<f32>>();
            let at = of(&back.mean, 3, j);
            let i = (0..n).find(|i| of(&cloud.mean, 3, *i) == at).unwrap();
            prop_assert!(apart(&of(&cloud.log_scale, 3, i), &of(&back.log_scale, 3, j)) < 2e-6);
            prop_assert!((opacity(cloud.logit[i]) - opacity(back.logit[j])).abs() <= 0.5 / 255.0 + 1e-6);
            let half = 0.5 / 255.0 / f64::from(SH_0) + 1e-6;
            prop_assert!(apart(&of(&cloud.dc, 3, i), &of(&back.dc, 3, j)) <= half);
            if let Some(want) = rotation(&cloud, i) {
                // Of the bytes themselves: 255 stands for 256, one step off.
                for (k, want) in want.into_iter().enumerate() {
                    let got = (f64::from(bytes[32 * j + 28 + k]) - 128.0) / 128.0;
                    prop_assert!((got - want).abs() <= 1.0 / 128.0 + 1e-12);
                }
            }
        }
    }
}
