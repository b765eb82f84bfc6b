//! `lightkiln relight`.

use super::args::RelightArguments;
use super::console::Console;
use super::failure::Failure;
use super::watch::Watch;
use lightkiln::bake::relight;
use std::sync::atomic::AtomicBool;

/// Relights and says what came out.
pub(crate) fn run(options: &RelightArguments, console: Console, cancelled: &'static AtomicBool) -> Result<(), Failure> {
    let settings = options.settings();
    let watch = Watch::new(console, cancelled);
    let report = relight(&settings, &watch)?;
    drop(watch);

    let folder = settings.out();
    console.result(folder, &report);
    if console.is_watched() {
        let error = report.relight.as_ref().map_or(0.0, |r| r.expected_error);
        let beside = if error > 0.0 { format!(", expected error {:.1} %", 100.0 * error) } else { String::new() };
        console.say(&format!("relit in {:.1} s{beside}: {}", report.total.wall_s, folder.display()));
    }
    Ok(())
}
