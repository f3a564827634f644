//! Writes the valid inputs of every door into a folder: `cargo run -p doors --example seeds -- fuzz/corpus`.

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let root = PathBuf::from(std::env::args_os().nth(1).unwrap_or_else(|| "fuzz/corpus".into()));
    for door in doors::DOORS {
        let folder = root.join(door.name);
        std::fs::create_dir_all(&folder)?;
        for (name, bytes) in (door.seeds)() {
            std::fs::write(folder.join(name), bytes)?;
        }
    }
    Ok(())
}
