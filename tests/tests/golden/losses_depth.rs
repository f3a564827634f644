//! Depth losses against golden vectors: `tests/golden/losses_depth.json`.

use losses::depth::median::{Alignment, aligned, aligned_backward};
use losses::depth::pearson::{pearson, pearson_backward};
use losses::depth::ranking::{MARGIN, ranking, ranking_backward};
use losses::depth::{ScaleShift, supervised, supervised_backward};
use losses::edge_variation::{DepthAndPhoto, edge_variation, edge_variation_backward};
use losses::kernel::Kernel;
use testkit::golden::{Golden, Kind, assert_close};

fn golden() -> Golden {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/losses_depth.json");
    Golden::read(path.as_ref()).unwrap()
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

#[test]
fn scale_and_shift_match_golden() {
    for record in golden().op("scale_shift") {
        let input = |name| record.input(name).f32();
        let (p, t, w) = (input("pred"), input("gt"), input("mask"));
        let fit = ScaleShift::fit(&p, &t, &w).unwrap().unwrap();
        // Sums are f64 and inputs exact: the bounds of f64 hold. The golden values of depths near 1000 with a spread of
        // 0.3 are themselves 1e-9 off those of rational arithmetic, which are these:
        let (rtol, atol) = if record.name == "ill_conditioned" {
            assert_close(
                "scale and shift",
                &[fit.scale, fit.shift],
                &[0.333_172_328_065_831_5, -332.726_665_128_248_2],
                1e-12,
                0.0,
            );
            (2e-9, 0.0)
        } else {
            (1e-12, 1e-13)
        };
        for (name, got) in [("scale", fit.scale), ("shift", fit.shift), ("loss", fit.loss)] {
            assert_close(&format!("{} {name}", record.label()), &[got], &record.output(name).data, rtol, atol);
        }
        if record.kind != Kind::Random {
            continue;
        }
        let bars = ["scale", "shift", "loss"].map(|name| record.cotangent(name).scalar());
        let (mut p_bar, mut t_bar) = (vec![0.0; p.len()], vec![0.0; p.len()]);
        fit.backward(&p, &t, &w, bars, &mut p_bar, &mut t_bar).unwrap();
        for (name, got) in [("pred", p_bar), ("gt", t_bar)] {
            assert_close(&format!("{} {name}_bar", record.label()), &wide(&got), &record.grad(name).data, 1e-6, 1e-9);
        }
    }
}

#[test]
fn aligned_depth_matches_golden() {
    for record in golden().op("median_depth_loss") {
        let (p, t) = (record.input("pred").f32(), record.input("gt").f32());
        let scratch = &mut Vec::new();
        let Some(side) = Alignment::of(&p, scratch) else {
            // Constant depth: the golden adds 1e-10 to the spread, here it has no shape to compare.
            assert_eq!((record.name.as_str(), aligned(&p, &t, scratch).unwrap()), ("constant", 0.0));
            continue;
        };
        let normal: Vec<f64> = p.iter().map(|&p| side.normal(p)).collect();
        // 1e-10 beside spreads of about 1.
        assert_close(&record.label(), &normal, &record.output("normalised").data, 1e-9, 1e-9);
        let got = aligned(&p, &t, scratch).unwrap();
        assert_close(&format!("{} loss", record.label()), &[got], &record.output("loss").data, 1e-8, 1e-9);
        let mut bar = vec![0.0; p.len()];
        aligned_backward(&p, &t, record.cotangent("loss").scalar(), &mut bar, scratch).unwrap();
        let normal_bar = &record.cotangent("normalised").data;
        side.backward(&p, |i| normal_bar[i], &mut bar).unwrap();
        assert_close(&format!("{} bar", record.label()), &wide(&bar), &record.grad("pred").data, 1e-6, 1e-8);
    }
}

#[test]
fn variation_less_where_the_photo_has_an_edge_matches_golden() {
    let mut seen = 0;
    for record in golden().op("edge_tv") {
        let (depth, image) = (record.input("d").f32(), record.input("img"));
        let size = [image.shape[1], image.shape[0]];
        let pixels = image.f32();
        let photo: Vec<f32> = (0..3).flat_map(|c| pixels.iter().skip(c).step_by(3).copied()).collect();
        let of = DepthAndPhoto { size, depth: &depth, photo: &photo };
        let mut bar = vec![0.0; depth.len()];
        let loss = edge_variation_backward(&of, record.cotangent("loss").scalar(), &mut bar).unwrap();
        assert_eq!(loss, edge_variation(&of).unwrap());
        assert_close(&record.label(), &[loss], &record.output("loss").data, 1e-12, 0.0);
        assert_close(&format!("{} bar", record.label()), &wide(&bar), &record.grad("d").data, 1e-5, 1e-7);
        seen += 1;
    }
    assert_eq!(seen, 1);
}

#[test]
fn correlation_matches_golden() {
    let mut seen = 0;
    for record in golden().op("pearson_depth") {
        let (p, t) = (record.input("pred").f32(), record.input("gt").f32());
        let mut bar = vec![0.0; p.len()];
        let loss = pearson_backward(&p, &t, 2, record.cotangent("loss").scalar(), &mut bar).unwrap();
        assert_eq!(loss, pearson(&p, &t, 2).unwrap());
        seen += 1;
        if ["pred_constant", "gt_constant", "both_constant", "n1", "tiny_variance"].contains(&record.name.as_str()) {
            // The golden adds 1e-6 to the spread, and its gradients reach 1e5; here there is no shape to compare.
            assert!(loss == 0.0 && bar.iter().all(|g| *g == 0.0), "{}: {loss} {bar:?}", record.label());
            continue;
        }
        // 1e-6 beside spreads of about 1.
        assert_close(&record.label(), &[loss], &record.output("loss").data, 1e-5, 5e-6);
        assert_close(&format!("{} bar", record.label()), &wide(&bar), &record.grad("pred").data, 1e-5, 2e-7);
    }
    assert_eq!(seen, 10);
}

#[test]
fn the_order_of_pairs_matches_golden() {
    let mut seen = 0;
    for record in golden().op("order_ranking") {
        let (p, t) = (record.input("pred").f32(), record.input("gt").f32());
        let mut bar = vec![0.0; p.len()];
        let loss = ranking_backward(&p, &t, MARGIN, record.cotangent("loss").scalar(), &mut bar).unwrap();
        assert_eq!(loss, ranking(&p, &t, MARGIN).unwrap());
        assert_close(&record.label(), &[loss], &record.output("loss").data, 1e-7, 1e-11);
        assert_close(&format!("{} bar", record.label()), &wide(&bar), &record.grad("pred").data, 1e-6, 0.0);
        seen += 1;
    }
    assert_eq!(seen, 2);
}

/// DynamicNeRF's loss of depth order: the moving part's depth is the still part's where nothing moves, which is held.
#[test]
fn the_moving_parts_depth_where_nothing_moves_matches_golden() {
    let mut seen = 0;
    for record in golden().op("order_dynerf") {
        let [moving, still, rests] = ["depth_d", "depth_s", "static_mask"].map(|name| record.input(name).f32());
        let rays: f64 = rests.iter().map(|w| f64::from(*w)).sum();
        let squared = Kernel::Squared;
        let loss = supervised(squared, &moving, &still, &rests).unwrap() / rays;
        assert_close(&record.label(), &[loss], &record.output("loss").data, 2e-6, 0.0);
        let mut bar = vec![0.0; moving.len()];
        let loss_bar = record.cotangent("loss").scalar() / rays;
        supervised_backward(squared, &moving, &still, &rests, loss_bar, &mut bar).unwrap();
        assert_close(&format!("{} bar", record.label()), &wide(&bar), &record.grad("depth_d").data, 1e-6, 0.0);
        seen += 1;
    }
    assert_eq!(seen, 1);
}
