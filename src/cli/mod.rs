//! The binary's side of the command line: what was typed, what is shown, and what the process returns.

pub(crate) mod args;
pub(crate) mod bake;
pub(crate) mod console;
pub(crate) mod failure;
pub(crate) mod info;
pub(crate) mod interrupt;
mod options;
pub(crate) mod relight;
pub(crate) mod tiles;
mod watch;

use failure::Failure;

/// Starts the threads that all stages share: `count`, or as many as there are processors.
pub(crate) fn start_threads(count: Option<usize>) -> Result<(), Failure> {
    rayon::ThreadPoolBuilder::new().num_threads(count.unwrap_or(0)).build_global().map_err(|e| {
        Failure::environment(
            "threads",
            anyhow::Error::new(e).context("cannot start threads; ask for fewer with --threads"),
        )
    })
}
