//! How many cases a property runs, and how a failed one is run again.
//!
//! Every property of the workspace takes its configuration from here:
//!
//! ```
//! use proptest::prelude::*;
//!
//! proptest! {
//!     #![proptest_config(testkit::property::cases(64))]
//!
//!     # /*
//!     #[test]
//!     # */
//!     fn halves_are_smaller(x in 1e-30_f32..1e30) {
//!         prop_assert!(0.5 * x < x);
//!     }
//! }
//! # halves_are_smaller();
//! ```
//!
//! `PROPTEST_CASES=1000000 cargo test --release -p wildfield-render-core --test all quadrature::` runs a million of each, with seeds of its own in
//! every run; `PROPTEST_RNG_SEED=7` makes a run the same again.
//!
//! A case that fails is printed, shrunk, and its seed goes into a file beside the source: `quadrature.regressions` for
//! `quadrature.rs`. From then on that case runs before all others, so it is enough to run the test again; the line `cc ...` that is
//! printed does the same on another machine. Once the cause is mended, such a file is committed.

use proptest::test_runner::{Config, FileFailurePersistence, TestRunner, contextualize_config};

/// Rejected inputs (`prop_assume!`) that a property may have for each case it runs.
const REJECTS: u32 = 16;
/// Rejected parts of inputs (`prop_filter`) for each case.
const LOCAL_REJECTS: u32 = 256;

/// The configuration of a property that runs `cases` cases. `PROPTEST_CASES` wins over that, as the other variables of
/// proptest do; how many inputs may be rejected grows with the number of cases.
#[must_use]
pub fn cases(cases: u32) -> Config {
    cases_rejecting(cases, REJECTS)
}

/// [`cases`] for a property whose inputs are hard to hit: `rejects` of them may be thrown away for each case.
#[must_use]
pub fn cases_rejecting(cases: u32, rejects: u32) -> Config {
    let default = Config::default();
    let asked = contextualize_config(Config { cases, ..default.clone() }).cases;
    contextualize_config(Config {
        cases,
        max_global_rejects: asked.saturating_mul(rejects).max(default.max_global_rejects),
        max_local_rejects: asked.saturating_mul(LOCAL_REJECTS).max(default.max_local_rejects),
        failure_persistence: Some(Box::new(FileFailurePersistence::WithSource("regressions"))),
        ..default
    })
}

/// A runner for a property without `proptest!`, in the source file `file` (`file!()`).
#[must_use]
pub fn runner(cases: u32, file: &'static str) -> TestRunner {
    TestRunner::new(Config { source_file: Some(file), ..self::cases(cases) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::test_runner::TestError;

    /// What proptest makes of the configuration: with the variables of this process.
    fn asked(default: u32) -> u32 {
        std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(default)
    }

    #[test]
    fn the_number_is_what_the_property_says_or_what_the_environment_says() {
        for n in [1, 64, 1_000_000] {
            let config = cases(n);
            assert_eq!(config.cases, asked(n));
            assert!(config.max_global_rejects >= config.cases.saturating_mul(REJECTS).min(1 << 30));
        }
    }

    /// Run again by the test below, in a process of its own, with other variables.
    #[test]
    fn child_counts_its_cases() {
        let ran = std::cell::Cell::new(0);
        runner(5, file!())
            .run(&proptest::bool::ANY, |_| {
                ran.set(ran.get() + 1);
                Ok(())
            })
            .unwrap();
        println!("ran {} cases", ran.get());
        assert_eq!(ran.get(), asked(5));
    }

    #[test]
    fn the_environment_reaches_every_runner() {
        for (set, want) in [(None, 5), (Some("1234"), 1234)] {
            let mut child = std::process::Command::new(std::env::current_exe().unwrap());
            child.args(["--exact", "property::tests::child_counts_its_cases", "--nocapture"]);
            child.env_remove("PROPTEST_CASES").envs(set.map(|n| ("PROPTEST_CASES", n)));
            let out = child.output().unwrap();
            let said = String::from_utf8_lossy(&out.stdout).into_owned();
            assert!(out.status.success() && said.contains(&format!("ran {want} cases")), "{said}");
        }
    }

    #[test]
    fn a_failed_case_is_kept_and_runs_first_the_next_time() {
        let folder = std::env::temp_dir().join(format!("testkit-property-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let source = folder.join("wrong.rs");
        std::fs::write(&source, "").unwrap();
        let file: &'static str = Box::leak(source.to_str().unwrap().to_owned().into_boxed_str());
        // Wrong for one number in 64.
        let run = |runner: &mut TestRunner| {
            let ran = std::cell::Cell::new(0);
            let result = runner.run(&(0_u32..1 << 20), |x| {
                ran.set(ran.get() + 1);
                if x % 64 == 63 { Err(proptest::test_runner::TestCaseError::fail("found")) } else { Ok(()) }
            });
            (result, ran.get())
        };
        let config = |cases| Config {
            cases,
            rng_seed: proptest::test_runner::RngSeed::Random,
            max_shrink_iters: 100_000,
            ..runner(1, file).config().clone()
        };
        let (first, _) = run(&mut TestRunner::new(config(100_000)));
        let Err(TestError::Fail(_, found)) = first else { panic!("a wrong property passed") };
        let kept = std::fs::read_to_string(folder.join("wrong.regressions")).unwrap();
        assert!(kept.lines().any(|l| l.starts_with("cc ") && l.contains(&format!("shrinks to {found}"))), "{kept}");
        // Without a single new case, the seed finds it again.
        let (again, ran) = run(&mut TestRunner::new(config(0)));
        std::fs::remove_dir_all(&folder).unwrap();
        assert!(matches!(again, Err(TestError::Fail(_, x)) if x == found), "not found again in {ran} cases");
    }
}
