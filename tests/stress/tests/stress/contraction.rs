//! Contraction of points from nothing to the end of the numbers.

use float_core::Simd;
use render_core::contract::{Norm, contract, contract_batch, contract_batch_backward, inv_contract};
use stress::{MAGNITUDES, Tally, close, ensure, finite};

pub(crate) fn cases(tally: &mut Tally, simd: Simd) {
    for norm in [Norm::L2, Norm::Max] {
        for a in MAGNITUDES {
            for b in MAGNITUDES {
                tally.case(
                    format!("{norm:?}, x = ({a:e}, -{b:e}, {a:e})"),
                    "within 1e-6 of f64, norm at most 2",
                    || {
                        let x = [a, -b, a];
                        // Seventeen points: a whole vector and a tail.
                        let rows: Vec<f32> = x.iter().flat_map(|&v| [v; 17]).collect();
                        let (mut y, mut x_bar) = (vec![f32::NAN; 51], vec![0.0; 51]);
                        contract_batch(simd, norm, &rows, &mut y).map_err(|e| e.to_string())?;
                        contract_batch_backward(simd, norm, &rows, &[1.0; 51], &mut x_bar)
                            .map_err(|e| e.to_string())?;
                        let want = contract(norm, x.map(f64::from));
                        for i in 0..51 {
                            // Among the denormals, a quotient and a product round to a multiple of 1.4e-45 each.
                            close("y", y[i].into(), want[i / 17], 1e-6 * want[i / 17].abs() + 3e-45)?;
                        }
                        let length = match norm {
                            Norm::L2 => want.iter().map(|v| v * v).sum::<f64>().sqrt(),
                            Norm::Max => want.iter().fold(0.0, |m: f64, v| m.max(v.abs())),
                        };
                        ensure(length <= 2.0, || format!("norm {length}"))?;
                        finite("x_bar", &x_bar)?;
                        let back = inv_contract(norm, [y[0], y[17], y[34]]);
                        finite("the way back", &back)
                    },
                );
            }
        }
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        tally.case(format!("a coordinate {bad}"), "its neighbours in the batch are as without it", || {
            let mut x: Vec<f32> = (0..60).map(|i| (i as f32 * 0.7).sin() * 30.0).collect();
            let (mut clean, mut y) = (vec![0.0; 60], vec![0.0; 60]);
            contract_batch(simd, Norm::L2, &x, &mut clean).map_err(|e| e.to_string())?;
            x[5] = bad;
            contract_batch(simd, Norm::L2, &x, &mut y).map_err(|e| e.to_string())?;
            let differ = (0..60).find(|i| i % 20 != 5 && clean[*i].to_bits() != y[*i].to_bits());
            ensure(differ.is_none(), || format!("entry {differ:?} changed"))
        });
    }
}
