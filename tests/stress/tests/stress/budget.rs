//! Error budgets from nothing to infinity: what is spent stays inside of them.

use render_core::budget::{Account, Budget, Radiance, Skip, terminate};
use stress::{MAGNITUDES, Tally, ensure};

pub(crate) fn cases(tally: &mut Tally) {
    let budgets = MAGNITUDES.into_iter().chain([1.0 / 255.0, -1.0, f32::NAN, f32::INFINITY]);
    for eps in budgets {
        for tau in MAGNITUDES {
            tally.case(
                format!("budget {eps:e}, samples of optical depth {tau:e}"),
                "what a ray leaves out is worth the budget at most; nothing at 0",
                || {
                    let taus = [tau; 1000];
                    let kept = terminate(&taus, eps);
                    let left = if kept < 1000 { (-f64::from(tau) * kept as f64).exp() } else { 0.0 };
                    ensure(left <= f64::from(eps.max(0.0)) * (1.0 + 1e-6), || format!("{left:e} is left out"))?;
                    let kept_all = kept == 1000 || eps > 0.0;
                    ensure(kept_all, || format!("{kept} of 1000 kept without a budget"))
                },
            );
        }
        for largest in [0.0_f32, 1e-38, 1.0, 1e6, 3e38] {
            tally.case(
                format!("budget {eps:e}, radiances to {largest:e}"),
                "all skips together cost the budget at most; none is taken for NaN, or with nothing to spend",
                || {
                    let budget = Budget::new(eps, Radiance { low: 0.0, high: largest }, [0.5, 0.0, 1.0]);
                    let (mut account, mut taken) = (Account::NEW, 0);
                    for round in 0..4_u32 {
                        for w in MAGNITUDES {
                            taken += u32::from(budget.drops(&mut account, w, 80 - 20 * round));
                            taken += u32::from(budget.affords(&mut account, Skip::Empty, w.into()));
                            taken += u32::from(budget.stops(&mut account, w.into()));
                        }
                    }
                    let nan = f64::NAN;
                    let spent = account.spent();
                    let none = !budget.stops(&mut account, nan)
                        && !budget.affords(&mut account, Skip::Branch, nan)
                        && !budget.drops(&mut account, f32::NAN, 1);
                    ensure(none, || "a skip of unknown cost was taken".into())?;
                    ensure(spent <= f64::from(eps.max(0.0)), || format!("{spent:e} spent"))?;
                    ensure(taken == 0 || eps > 0.0, || format!("{taken} skips without a budget"))
                },
            );
        }
    }
}
