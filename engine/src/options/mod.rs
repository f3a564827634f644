//! What a run was asked for and what was decided from it: plain data, without the work that follows from it.

mod appearance;
mod background;
mod data;
mod plan;
mod request;
mod schedule;
mod set;

pub use appearance::{EvalAppearance, Part};
pub use background::Background;
pub use data::{DataOptions, IMAGE_MEMORY_MIB};
pub use plan::{Choice, Plan, Purpose, RunOptions};
pub use request::{Request, RunConfig};
pub use schedule::{Schedule, Stop};
pub use set::parse_set;
