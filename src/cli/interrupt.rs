//! Ctrl-C and the signals that ask a process to end: a request first, then an exit within a second.

use super::console::Console;
use super::failure::INTERRUPTED;
use lightkiln::output::files;
use std::process::exit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

/// True once the user asked to stop.
static CANCELLED: AtomicBool = AtomicBool::new(false);

/// How long the stages may take to end in their own way. The process is gone within a second, even inside an
/// unwrapper or a write that cannot be interrupted.
const GRACE: Duration = Duration::from_millis(800);

/// True once the user was told.
static ANNOUNCED: AtomicBool = AtomicBool::new(false);

/// Tells the user, once, whether the stages ended by themselves or were left.
pub(crate) fn announce(console: &Console) {
    if !ANNOUNCED.swap(true, Ordering::SeqCst) {
        console.error("interrupted", "interrupted; nothing was written");
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
