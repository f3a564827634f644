//! Static scenes from photographs: `nerf-static --help`.

fn main() -> std::process::ExitCode {
    apps::nerf_static()
}
