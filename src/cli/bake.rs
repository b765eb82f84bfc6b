//! `lightkiln bake`.

use super::args::BakeArguments;
use super::console::Console;
use super::failure::Failure;
use super::watch::Watch;
use lightkiln::audit::{Audit, Verdict};
use lightkiln::bake::{Report, bake};
use serde_json::json;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Bakes and says what came out.
pub(crate) fn run(options: &BakeArguments, console: Console, cancelled: &'static AtomicBool) -> Result<(), Failure> {
    let settings = options.settings();
    let watch = Watch::new(console, cancelled);
    let report = bake(&options.scene, &settings, &watch)?;
    drop(watch);
    tell(&settings.output.folder, &report, console);
    Ok(())
}

/// Says what a bake came to whose results are in `folder`.
pub(super) fn tell(folder: &Path, report: &Report, console: Console) {
    if let Some(audit) = &report.audit {
        console.event(&json!({
            "event": "audit",
            "target": audit.target,
            "verdict": audit.verdict,
            "error": audit.error,
            "worst": audit.objects.first().map(|object| &object.path),
        }));
        // What was not reached is said even where nobody watches.
        if audit.verdict == Verdict::Missed || console.is_watched() {
            console.say(&verdict(audit));
            let again: f64 = report.refinements.iter().map(|r| 100.0 * r.texels).sum();
            if again > 0.0 {
                console.say(&format!("{again:.0} % of the texels were gathered again to get there"));
            }
        }
    }
    console.result(folder, report);
    if console.is_watched() {
        console.say(&format!(
            "{} texels on {} in {:.1} s: {}",
            report.atlas.texels,
            pages(report.atlas.pages.len()),
            report.total.wall_s,
            folder.display()
        ));
    }
}

/// One line about the error: figure, interval, target, and where it was missed.
fn verdict(audit: &Audit) -> String {
    let percent = |share: f64| format!("{:.2} %", 100.0 * share);
    let end = match (audit.verdict, audit.objects.first()) {
        (Verdict::Met, _) => "met".into(),
        (Verdict::Uncertain, _) => "not certain; --audit thorough finds out".into(),
        (Verdict::Missed, None) => "missed; ask for a smaller --error".into(),
        (Verdict::Missed, Some(worst)) => {
            let share = 100.0 * worst.share;
            format!("missed; {share:.0} % of it lies on `{}`, the report lists the others", worst.path)
        }
    };
    format!(
        "error {} ({} to {}), target {}: {end}",
        percent(audit.error.value),
        percent(audit.error.low),
        percent(audit.error.high),
        percent(audit.target)
    )
}

fn pages(count: usize) -> String {
    if count == 1 { "1 page".into() } else { format!("{count} pages") }
}
