//! Ctrl-C and the signals that ask a process to end: a request first, then an exit within a second.

use super::console::Console;
use super::failure::INTERRUPTED;
use lightkiln::output::files;
use std::path::Path;
use std::process::exit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// True once the user asked to stop.
static CANCELLED: AtomicBool = AtomicBool::new(false);

/// How long the stages may take to end in their own way. The process is gone within a second, even inside an
/// unwrapper or a write that cannot be interrupted.
const GRACE: Duration = Duration::from_millis(800);

/// True once the user was told.
static ANNOUNCED: AtomicBool = AtomicBool::new(false);

/// What an interrupted bake leaves behind.
#[derive(Default)]
struct Left {
    state: Option<String>,
    checkpoint: Option<String>,
}

static LEFT: Mutex<Left> = Mutex::new(Left { state: None, checkpoint: None });

fn left() -> MutexGuard<'static, Left> {
    // Both fields are meaningful on their own, whatever happened in between.
    LEFT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The results show what the bake has `reached`.
pub(crate) fn remember_state(reached: &str, predicted_error: f64) {
    let percent = 100.0 * predicted_error;
    left().state = Some(format!("the results are those of the state `{reached}`, about {percent:.1} % off"));
}

/// The work can go on from a checkpoint, by `how`.
pub(crate) fn remember_checkpoint(checkpoint: &Path, how: &str) {
    left().checkpoint = Some(format!("{how} goes on from `{}`", checkpoint.display()));
}

/// Tells the user, once, whether the stages ended by themselves or were left.
pub(crate) fn announce(console: &Console) {
    if !ANNOUNCED.swap(true, Ordering::SeqCst) {
        let left = std::mem::take(&mut *left());
        let state = left.state.unwrap_or_else(|| "no results were written".into());
        let parts = ["interrupted".to_owned(), state].into_iter().chain(left.checkpoint);
        console.error("interrupted", &parts.collect::<Vec<_>>().join("; "));
    }
}

/// Starts to listen. Returns the flag that the first signal raises.
pub(crate) fn listen(console: Console) -> &'static AtomicBool {
    let handler = move || {
        if CANCELLED.swap(true, Ordering::SeqCst) {
            leave(console);
        }
        thread::spawn(move || {
            thread::sleep(GRACE);
            leave(console);
        });
    };
    // Without a handler a signal ends the process in the system's way, which leaves no results either.
    if let Err(e) = ctrlc::set_handler(handler) {
        tracing::debug!("signals are not handled: {e}");
    }
    &CANCELLED
}

/// Ends the process now.
fn leave(console: Console) -> ! {
    files::abandon();
    announce(&console);
    exit(INTERRUPTED)
}
