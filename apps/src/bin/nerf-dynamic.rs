//! A scene that moves, from a video of it: `nerf-dynamic --help`.

fn main() -> std::process::ExitCode {
    apps::nerf_dynamic()
}
