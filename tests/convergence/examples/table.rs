//! Error of each quadrature rule and sampler against its number of samples, as CSV on standard output:
//! `cargo run --release -p convergence --example table > convergence.csv`.

use convergence::Study;

fn main() {
    let study = Study { repeats: 3, ..Study::default() };
    println!("rule,sampler,density,samples,error,worst,bias,seconds");
    for row in study.rows(512) {
        println!(
            "{},{},{},{:.1},{:e},{:e},{:e},{:e}",
            row.rule, row.sampler, row.density, row.samples, row.error, row.worst, row.bias, row.seconds
        );
    }
}
