//! Ctrl-C and SIGTERM: the first asks the loop to write a checkpoint and stop, the second stops at once.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A flag that the first signal raises.
pub(crate) fn flag() -> std::io::Result<Arc<AtomicBool>> {
    let raised = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: a signal first looks whether one came before.
        flag::register_conditional_shutdown(signal, 130, raised.clone())?;
        flag::register(signal, raised.clone())?;
    }
    Ok(raised)
}
