//! Adam, AdamW, schedules and clipping against PyTorch's, step by step.

use float_core::Simd;
use optim::{Adam, AdamConfig, Decay, LearningRate, Schedule, Warmup, clip};
use std::path::Path;
use testkit::golden::{Golden, Kind, Record, assert_close};

fn golden() -> Golden {
    Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/optim.json")).unwrap()
}

fn config(record: &Record) -> AdamConfig {
    let rate = record.param("weight_decay").f64();
    let decay = match record.op.as_str() {
        _ if rate == 0.0 => Decay::None,
        "adamw" => Decay::Decoupled(rate),
        _ => Decay::L2(rate),
    };
    let number = |name| record.param(name).f64();
    AdamConfig::DEFAULT.with_betas(number("beta1"), number("beta2")).with_eps(number("eps")).with_decay(decay)
}

#[test]
fn adam_and_adamw_follow_the_golden_trajectories() {
    let golden = golden();
    let mut compared = 0;
    for record in golden.op("adam").chain(golden.op("adamw")) {
        let n = record.input("params").data.len();
        for simd in Simd::available() {
            let mut params = record.input("params").f32();
            let mut adam = Adam::new(n, config(record));
            let (grads, trajectory) = (record.input("gradients"), record.output("trajectory"));
            for t in 0..grads.shape[0] {
                let grad: Vec<f32> = grads.row(t).iter().map(|&g| g as f32).collect();
                assert_eq!(adam.step(simd, record.param("lr").f64(), &mut params, &grad), 0);
                assert!(params.iter().all(|p| p.is_finite()), "{} step {t}", record.label());
                // `tiny_1e-30` underflows in the second moment: finite is all f32 can promise there.
                if record.note.contains("underflows in f32") {
                    continue;
                }
                let (rtol, atol) = if record.kind == Kind::Random { (2e-6, 1e-6) } else { (1e-4, 0.0) };
                assert_close(&format!("{} step {t}", record.label()), &params, trajectory.row(t), rtol, atol);
                compared += 1;
            }
            if !record.note.contains("underflows in f32") {
                let label = record.label();
                // 50 sums round the moments 50 times.
                assert_close(&format!("{label} m"), adam.first_moment(), &record.output("exp_avg").data, 1e-5, 1e-45);
                assert_close(
                    &format!("{label} v"),
                    adam.second_moment(),
                    &record.output("exp_avg_sq").data,
                    1e-5,
                    1e-45,
                );
            }
        }
    }
    assert!(compared >= 20 * 50, "only {compared} steps compared");
}

#[test]
fn schedules_match_the_golden_rates() {
    let golden = golden();
    type Make = fn(&Record) -> LearningRate;
    fn log_lerp(r: &Record) -> Schedule {
        let number = |name| r.param(name).f64();
        let steps = r.param("max_steps").usize() as u64;
        Schedule::LogLerp { lr_init: number("lr_init"), lr_final: number("lr_final"), steps }
    }
    let schedules: [(&str, Make); 6] = [
        ("schedule_exp", |r| {
            let (lr, rate) = (r.param("lr").f64(), r.param("rate").f64());
            Schedule::Exponential { lr, rate, steps: r.param("steps").usize() as u64 }.into()
        }),
        ("schedule_loglerp", |r| log_lerp(r).into()),
        ("schedule_loglerp_delay", |r| {
            let (start, steps) = (r.param("delay_mult").f64(), r.param("delay_steps").usize() as u64);
            LearningRate { schedule: log_lerp(r), warmup: Warmup::Sine { start, steps } }
        }),
        ("schedule_linear_warmup", |r| {
            let steps = r.param("warmup_steps").usize() as u64;
            LearningRate { schedule: Schedule::Constant { lr: r.param("lr").f64() }, warmup: Warmup::Linear { steps } }
        }),
        ("schedule_cosine", |r| {
            let (lr_max, lr_min) = (r.param("lr_max").f64(), r.param("lr_min").f64());
            Schedule::Cosine { lr_max, lr_min, steps: r.param("total_steps").usize() as u64 }.into()
        }),
        ("schedule_gamma", |r| Schedule::Gamma { lr: r.param("lr").f64(), gamma: r.param("gamma").f64() }.into()),
    ];
    for (op, make) in schedules {
        for record in golden.op(op) {
            let rate = make(record);
            let got: Vec<f64> = record.input("step").indices().iter().map(|&s| rate.at(s as u64)).collect();
            assert_close(&record.label(), &got, &record.output("lr").data, 1e-12, 0.0);
        }
    }
}

#[test]
fn clipping_matches_the_golden_gradients() {
    let golden = golden();
    for simd in Simd::available() {
        for record in golden.op("clip_norm") {
            let mut g: Vec<Vec<f32>> = ["g0", "g1", "g2"].iter().map(|name| record.input(name).f32()).collect();
            let mut slices: Vec<&mut [f32]> = g.iter_mut().map(Vec::as_mut_slice).collect();
            let clipped = clip::clip_by_global_norm(simd, record.param("max_norm").f64(), &mut slices);
            let norm = record.output("total_norm");
            assert_close(&record.label(), &[clipped.norm], &norm.data, 1e-12, 0.0);
            check_slices(record, &g);
        }
        for record in golden.op("clip_value") {
            let mut g: Vec<Vec<f32>> = ["g0", "g1", "g2"].iter().map(|name| record.input(name).f32()).collect();
            for g in &mut g {
                clip::clip_by_value(simd, record.param("limit").f32(), g);
            }
            check_slices(record, &g);
        }
    }
}

fn check_slices(record: &Record, got: &[Vec<f32>]) {
    for (i, g) in got.iter().enumerate() {
        assert_close(&record.label(), g, &record.output(&format!("clipped{i}")).data, 1e-7, 0.0);
    }
}
