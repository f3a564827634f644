//! Ctrl-C and SIGTERM: the first asks to stop and is answered at once, the second stops at once.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::io::Result;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// How soon the first signal is answered.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// What is said when a signal has come.
pub(crate) const HEARD: &str = "stopping; what is done is kept (once more ends it at once)";

/// Says that a signal was heard.
type Answer = Box<dyn Fn() + Send>;

/// One for the process, however many commands ask for it.
static INTERRUPT: OnceLock<Interrupt> = OnceLock::new();

struct Interrupt {
    raised: Arc<AtomicBool>,
    answered: AtomicBool,
    /// Of the newest listener.
    answer: Mutex<Option<Answer>>,
}

/// A flag that the first signal raises.
///
/// # Errors
/// Where handlers of signals cannot be had.
pub(crate) fn flag() -> Result<Arc<AtomicBool>> {
    if let Some(interrupt) = INTERRUPT.get() {
        return Ok(interrupt.raised.clone());
    }
    let raised = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: a signal first looks whether one came before.
        flag::register_conditional_shutdown(signal, 130, raised.clone())?;
        flag::register(signal, raised.clone())?;
    }
    let interrupt = Interrupt { raised, answered: AtomicBool::new(false), answer: Mutex::new(None) };
    Ok(INTERRUPT.get_or_init(|| interrupt).raised.clone())
}

/// The flag of [`flag`]; when it is raised, `answer` is called once, at once, from another thread or by [`answered`].
///
/// # Errors
/// As [`flag`], and where there is no thread to be had.
pub(crate) fn listen(answer: Answer) -> Result<Arc<AtomicBool>> {
    let raised = flag()?;
    let Some(interrupt) = INTERRUPT.get() else { return Ok(raised) };
    let first = interrupt.answer.lock().unwrap_or_else(PoisonError::into_inner).replace(answer).is_none();
    if first {
        let wait = || {
            while !answered() {
                std::thread::sleep(LOOK_EVERY);
            }
        };
        std::thread::Builder::new().name("interrupt".into()).spawn(wait)?;
    }
    Ok(raised)
}

/// Whether the flag is raised; the first to ask after that gives the answer.
pub(crate) fn answered() -> bool {
    let Some(interrupt) = INTERRUPT.get() else { return false };
    if !interrupt.raised.load(Ordering::Relaxed) {
        return false;
    }
    // The lock is held while it answers: nobody goes on before that is done.
    let answer = interrupt.answer.lock().unwrap_or_else(PoisonError::into_inner);
    if !interrupt.answered.swap(true, Ordering::Relaxed)
        && let Some(answer) = answer.as_ref()
    {
        answer();
    }
    true
}
