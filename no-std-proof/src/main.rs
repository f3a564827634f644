//! Every math crate without `std`: one forward and one backward of each, and the numbers are right.
//!
//! The exit code is 0, or the number of the first proof that failed. See README.md for how a leak of `std` looks.
#![no_std]
#![no_main]

extern crate alloc;

mod field;
mod host;
mod image;
mod splat;
mod step;
mod wrong;

use host::say;
use wrong::Wrong;

/// One forward and one backward of something.
struct Proof {
    name: &'static str,
    run: fn() -> Result<(), Wrong>,
}

const PROOFS: [Proof; 14] = [
    Proof { name: "float-core: float functions", run: step::float_functions },
    Proof { name: "float-core: vector kernels", run: step::vector_kernels },
    Proof { name: "field-core: frequency encoding", run: field::frequency },
    Proof { name: "field-core: hash grid", run: field::hash_grid },
    Proof { name: "field-core: network", run: field::network },
    Proof { name: "field-core: tape", run: field::tape },
    Proof { name: "render-core: camera both ways", run: image::camera },
    Proof { name: "render-core: quadrature", run: image::quadrature },
    Proof { name: "splat-core: picture", run: splat::picture },
    Proof { name: "splat-core: gradients", run: splat::gradients },
    Proof { name: "splat-core: density control", run: splat::density },
    Proof { name: "losses: mean squared error", run: step::loss },
    Proof { name: "losses: PSNR", run: step::metric },
    Proof { name: "optim: Adam", run: step::adam },
];

/// Called by the C runtime.
#[unsafe(no_mangle)]
extern "C" fn main(_argc: i32, _argv: *const *const u8) -> i32 {
    for (number, proof) in (1..).zip(&PROOFS) {
        match (proof.run)() {
            Ok(()) => say(format_args!("ok  {}", proof.name)),
            Err(wrong) => {
                say(format_args!("BAD {}: {} is {}, expected {}", proof.name, wrong.what, wrong.got, wrong.want));
                return number;
            }
        }
    }
    0
}
