//! Speed, error and ceilings of this machine, in one command: `nerf-bench --help`.

fn main() -> std::process::ExitCode {
    bench::nerf_bench()
}
