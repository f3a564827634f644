//! Ctrl-C and SIGTERM: the first is answered by a line at once, the second ends the program at once.
//!
//! What the first one does depends on how far the program is. While it only reads, nothing can be lost, and it ends there and then.
//! From [`listen`] on it raises a flag: work looks at it between a few rays, keeps what it has, and ends.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::io::Result;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// Exit code of a program that was asked to stop, by either signal.
pub(crate) const CODE: u8 = 130;

/// How soon the first signal is answered.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// How long a program that ends at once waits for a file that is being written.
const FILES_WAIT: Duration = Duration::from_secs(1);

/// What is said when a signal has come.
const HEARD: &str = "interrupt heard: stopping; what is done is kept; again to stop at once";
const ENDED: &str = "interrupt heard: ended; there was nothing to lose yet";

/// Says a line.
type Say = Box<dyn Fn(&str) + Send>;

/// One for the process, however many commands ask for it.
static INTERRUPT: OnceLock<Interrupt> = OnceLock::new();

struct Interrupt {
    raised: Arc<AtomicBool>,
    manner: Mutex<Manner>,
}

/// How the first signal is answered.
struct Manner {
    say: Say,
    /// What is done is kept; before, the program ends at once.
    gently: bool,
    answered: bool,
}

fn of_process(say: Say) -> Result<&'static Interrupt> {
    if let Some(interrupt) = INTERRUPT.get() {
        interrupt.manner.lock().unwrap_or_else(PoisonError::into_inner).say = say;
        return Ok(interrupt);
    }
    let raised = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: a signal first looks whether one came before.
        flag::register_conditional_shutdown(signal, CODE.into(), raised.clone())?;
        flag::register(signal, raised.clone())?;
    }
    let interrupt = Interrupt { raised, manner: Mutex::new(Manner { say, gently: false, answered: false }) };
    let interrupt = INTERRUPT.get_or_init(|| interrupt);
    let wait = || {
        while !answered() {
            std::thread::sleep(LOOK_EVERY);
        }
    };
    std::thread::Builder::new().name("interrupt".into()).spawn(wait)?;
    Ok(interrupt)
}

/// From now on a signal ends the program at once, with a line and with no file half-written.
///
/// # Errors
/// Where handlers of signals, or a thread, cannot be had.
pub(crate) fn begin(say: Say) -> Result<()> {
    of_process(say).map(|_| ())
}

/// From now on a first signal raises the flag; `say` says so, once, at once, from another thread or by [`answered`].
///
/// # Errors
/// As [`begin`].
pub(crate) fn listen(say: Say) -> Result<Arc<AtomicBool>> {
    let interrupt = of_process(say)?;
    interrupt.manner.lock().unwrap_or_else(PoisonError::into_inner).gently = true;
    Ok(interrupt.raised.clone())
}

/// The flag that the first signal raises; `None` before anything listens.
pub(crate) fn raised() -> Option<Arc<AtomicBool>> {
    INTERRUPT.get().map(|interrupt| interrupt.raised.clone())
}

/// Whether the flag is raised; the first to ask after that gives the answer.
pub(crate) fn answered() -> bool {
    let Some(interrupt) = INTERRUPT.get() else { return false };
    if !interrupt.raised.load(Ordering::Relaxed) {
        return false;
    }
    // The lock is held while it answers: no thread goes on before that is done.
    let mut manner = interrupt.manner.lock().unwrap_or_else(PoisonError::into_inner);
    if !std::mem::replace(&mut manner.answered, true) {
        (manner.say)(if manner.gently { HEARD } else { ENDED });
        if !manner.gently {
            engine::output::close_files(FILES_WAIT);
            std::process::exit(CODE.into());
        }
    }
    true
}
