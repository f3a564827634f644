//! Image metrics against golden vectors: `tests/golden/metrics.json`, ops `image_pair`, `masked_pair`, `ms_ssim` and
//! `segmentation`.
//!
//! Images are 8 bit and everything but the LPIPS network is `f64`, so the `f64` tolerances apply to all but LPIPS.

use losses::metrics::{
    Confusion, EmptyClass, Image, Lpips, MaskedSsim, MetricError, SsimVariant, lpips::LpipsTensor, masked_mse,
    masked_psnr, masked_ssim, ms_ssim, mse, psnr, ssim,
};
use safetensors::SafeTensors;
use std::{borrow::Cow, path::PathBuf};
use testkit::golden::{Golden, Record, data_dir, skipped};

fn golden() -> Golden {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/metrics.json");
    Golden::read(path.as_ref()).unwrap()
}

/// Bytes of a pair, and `[height, width, channels]`.
struct Pair {
    a: Vec<u8>,
    b: Vec<u8>,
    shape: [usize; 3],
}

impl Pair {
    fn new(record: &Record) -> Self {
        let (a, b) = (record.input("a_u8"), record.input("b_u8"));
        assert_eq!(a.shape, b.shape, "{}", record.label());
        let shape = a.shape.clone().try_into().expect("height, width, channels");
        Self { a: a.bytes(), b: b.bytes(), shape }
    }

    fn images(&self) -> [Image<'_>; 2] {
        let [height, width, channels] = self.shape;
        [&self.a, &self.b].map(|x| Image::from_u8(width, height, channels, x).unwrap())
    }
}

#[track_caller]
fn near(record: &Record, what: &str, got: f64, bound: f64) {
    let want = record.output(what).scalar();
    assert!((got - want).abs() <= bound, "{}: {what} is {got}, expected {want} to {bound}", record.label());
}

#[test]
fn psnr_and_ssim_match_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("image_pair") {
        let pair = Pair::new(record);
        let [a, b] = pair.images();
        near(record, "mse", mse(&a, &b).unwrap(), 1e-14);
        match record.get("outputs", "psnr") {
            Some(_) => near(record, "psnr", psnr(&a, &b).unwrap(), 1e-9),
            None => assert_eq!(psnr(&a, &b), Ok(f64::INFINITY), "{}", record.label()),
        }
        near(record, "ssim", ssim(&a, &b, SsimVariant::REFERENCE).unwrap(), 1e-10);
        count += 1;
    }
    assert_eq!(count, 11);
}

#[test]
fn images_in_f32_match_golden() {
    for record in golden().op("image_pair") {
        let pair = Pair::new(record);
        let [height, width, channels] = pair.shape;
        let unit = |x: &[u8]| x.iter().map(|&x| f32::from(x) / 255.0).collect::<Vec<_>>();
        let (a, b) = (unit(&pair.a), unit(&pair.b));
        let [a, b] = [&a, &b].map(|x| Image::from_f32(width, height, channels, x).unwrap());
        if record.get("outputs", "psnr").is_some() {
            near(record, "psnr", psnr(&a, &b).unwrap(), 1e-4);
        }
        near(record, "ssim", ssim(&a, &b, SsimVariant::REFERENCE).unwrap(), 2e-5);
    }
}

#[test]
fn masked_metrics_match_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("masked_pair") {
        let of = record.param("pair").str();
        let pair = Pair::new(golden.op("image_pair").find(|r| r.name == of).expect("the pair of the mask"));
        let [a, b] = pair.images();
        let mask = record.input("mask").f32();
        near(record, "masked_mse", masked_mse(&a, &b, &mask).unwrap(), 1e-14);
        near(record, "masked_ssim", masked_ssim(&a, &b, &mask, MaskedSsim::DyCheck).unwrap(), 1e-10);
        match record.get("outputs", "masked_psnr") {
            Some(_) => near(record, "masked_psnr", masked_psnr(&a, &b, &mask).unwrap(), 1e-9),
            None if mask.iter().all(|&m| m == 0.0) => {
                assert_eq!(masked_psnr(&a, &b, &mask), Err(MetricError::EmptyMask), "{}", record.label());
            }
            None => assert_eq!(masked_psnr(&a, &b, &mask), Ok(f64::INFINITY), "{}", record.label()),
        }
        count += 1;
    }
    assert_eq!(count, 24);
}

#[test]
fn ms_ssim_matches_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("ms_ssim") {
        let pair = Pair::new(record);
        let [a, b] = pair.images();
        near(record, "ms_ssim", ms_ssim(&a, &b).unwrap(), 1e-9);
        count += 1;
    }
    assert_eq!(count, 5);
}

/// The records have up to five classes, ours are two: each class in turn against all others.
#[test]
fn segmentation_matches_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("segmentation") {
        let (prediction, truth) = (record.input("pred").bytes(), record.input("gt").bytes());
        let others = |x: &[u8], class: usize| x.iter().map(|&x| u8::from(usize::from(x) != class)).collect::<Vec<_>>();
        let classes = record.param("classes").usize();
        for class in 0..classes {
            let counts = Confusion::of(&others(&prediction, class), &others(&truth, class)).unwrap();
            let at = |gt: usize, pred: usize| record.output("confusion").data[gt * classes + pred] as u64;
            assert_eq!(counts.true_positive, at(class, class), "{}", record.label());
            assert_eq!(counts.false_negative, (0..classes).map(|c| at(class, c)).sum::<u64>() - at(class, class));
            let scores = counts.scores(EmptyClass::LeftOut);
            // Absent classes are -1 there.
            assert_eq!(scores.iou_transient.unwrap_or(-1.0), record.output("iou").data[class], "{}", record.label());
            assert_eq!(scores.f1.unwrap_or(-1.0), record.output("f1").data[class], "{}", record.label());
            // Of two classes the other is what is not this one: the means are theirs.
            if classes == 2 {
                near(record, "miou", scores.miou.unwrap(), 1e-15);
            }
        }
        count += 1;
    }
    assert_eq!(count, 6);
}

/// The published weights: the file named by `WILDFIELD_LPIPS`, or `weights/lpips_squeeze.safetensors` beside the data.
fn weights_file() -> Option<PathBuf> {
    let path = match std::env::var_os("WILDFIELD_LPIPS") {
        Some(path) => PathBuf::from(path),
        None => data_dir(env!("CARGO_MANIFEST_DIR"))?.join("../weights/lpips_squeeze.safetensors"),
    };
    path.is_file().then_some(path)
}

#[test]
fn lpips_matches_golden() {
    let Some(path) = weights_file() else {
        skipped(
            "lpips_matches_golden",
            "no file `../shared/weights/lpips_squeeze.safetensors`, and WILDFIELD_LPIPS names none",
        );
        return;
    };
    let bytes = std::fs::read(path).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let net = Lpips::new(|name| {
        let tensor = file.tensor(name).ok()?;
        let value = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        let data = Cow::Owned(tensor.data().chunks_exact(4).map(value).collect());
        Some(LpipsTensor { shape: tensor.shape().to_vec(), data })
    })
    .unwrap();
    for record in golden().op("image_pair") {
        let pair = Pair::new(record);
        let [a, b] = pair.images();
        for simd in float_core::Simd::available() {
            let layers = net.clone().with_simd(simd).layers(&a, &b).unwrap();
            near(record, "lpips_squeeze", layers.iter().sum(), 2e-6);
            if let Some(want) = record.get("outputs", "lpips_layers") {
                testkit::golden::assert_close(&record.label(), &layers, &want.data, 0.0, 1e-6);
            }
        }
    }
}
