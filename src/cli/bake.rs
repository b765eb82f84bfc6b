//! `lightkiln bake`.

use super::args::BakeArguments;
use super::console::Console;
use super::failure::Failure;
use super::watch::Watch;
use lightkiln::bake::bake;
use serde_json::json;
use std::sync::atomic::AtomicBool;

/// Bakes and says what came out.
pub(crate) fn run(options: &BakeArguments, console: Console, cancelled: &'static AtomicBool) -> Result<(), Failure> {
    let settings = options.settings();
    let watch = Watch::new(console, cancelled);
    let report = bake(&options.scene, &settings, &watch)?;
    drop(watch);

    let folder = settings.output.folder;
    console.event(&json!({
        "event": "result",
        "folder": folder.display().to_string(),
        "outputs": report.outputs.iter().map(|name| folder.join(name).display().to_string()).collect::<Vec<_>>(),
        "report": report,
    }));
    if console.is_watched() {
        console.say(&format!(
            "{} texels on {} in {:.1} s: {}",
            report.atlas.texels,
            pages(report.atlas.pages.len()),
            report.total.wall_s,
            folder.display()
        ));
    }
    Ok(())
}

fn pages(count: usize) -> String {
    if count == 1 { "1 page".into() } else { format!("{count} pages") }
}
