//! Writes the documents that are made of what the programs know: `docs/cli.md`, and the tables of systems in `README.md`.
//!
//! ```sh
//! cargo run -p apps --example docs
//! ```

use std::path::Path;

fn main() -> std::io::Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for page in apps::reference::pages(&root)? {
        if page.is == page.should {
            println!("{}: as it should be", page.path);
        } else {
            std::fs::write(root.join(page.path), page.should)?;
            println!("{}: renewed", page.path);
        }
    }
    Ok(())
}
