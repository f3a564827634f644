//! The vector functions at the ends of the numbers, against `f64`.

use float_core::Simd;
use float_core::vecmath::Function;
use stress::{MAGNITUDES, Tally, ensure};

pub(crate) fn cases(tally: &mut Tally, simd: Simd) {
    let ends = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0];
    let arguments: Vec<f32> = MAGNITUDES.iter().flat_map(|&x| [x, -x]).chain(ends).collect();
    for function in Function::ALL {
        for &x in &arguments {
            tally.case(format!("{}({x:e})", function.name()), "within the error that its docs state", || {
                // Whole vectors and a rest.
                let worst = function.worst(simd, &[x; 37], &[function.exact(x.into()); 37]);
                let bound = function.bound(simd.level());
                ensure(worst.ulp <= bound, || format!("{} ulp, stated: {bound}", worst.ulp))
            });
        }
    }
}
