//! One place from photos of many people: `nerf-wild --help`.

fn main() -> std::process::ExitCode {
    apps::nerf_wild()
}
