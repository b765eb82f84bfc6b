//! `lightkiln solve`, `gather` and `merge`: a bake on more than one machine.

use super::args::{GatherArguments, MergeArguments, SolveArguments};
use super::bake::tell;
use super::console::{Console, print_line};
use super::failure::Failure;
use super::watch::Watch;
use lightkiln::bake::{self, GatheredTiles, Solving, TilesDone};
use lightkiln::output::TileSet;
use lightkiln::output::solved::{SolutionHead, solution_path};
use serde_json::{Value, json};
use std::path::{Path, absolute};
use std::sync::atomic::AtomicBool;

/// Writes a solution and says how many tiles it has.
pub(crate) fn solve(options: &SolveArguments, console: Console, cancelled: &'static AtomicBool) -> Result<(), Failure> {
    let settings = options.settings();
    let watch = Watch::resuming(console, cancelled);
    // Other machines look for the scene where this one found it.
    let scene = absolute(&options.scene).unwrap_or_else(|_| options.scene.clone());
    let Solving { solution, existed } = bake::solve(&scene, &settings, &watch)?;
    drop(watch);

    let folder = &settings.output.folder;
    let path = solution_path(folder);
    console.event(&json!({
        "event": "result",
        "folder": folder.display().to_string(),
        "outputs": [path.display().to_string()],
        "existed": existed,
        "solution": facts(&solution),
    }));
    if console.is_watched() {
        let was = if existed { "is there already, with" } else { "has" };
        console.say(&format!("`{}` {was} {} to gather", path.display(), tiles(solution.tiles)));
    }
    Ok(())
}

/// Gathers tiles and says which.
pub(crate) fn gather(
    options: &GatherArguments,
    console: Console,
    cancelled: &'static AtomicBool,
) -> Result<(), Failure> {
    let settings = options.settings();
    let watch = Watch::resuming(console, cancelled);
    let GatheredTiles { solution, gathered, file } = bake::gather_tiles(&settings, &watch)?;
    drop(watch);

    let outputs: Vec<String> = file.iter().map(|file| file.display().to_string()).collect();
    console.event(&json!({
        "event": "result",
        "folder": settings.folder.display().to_string(),
        "outputs": outputs,
        "gathered": gathered,
        "solution": facts(&solution),
    }));
    if console.is_watched() {
        match gathered.is_empty() {
            true => console.say("all these tiles are there already"),
            false => console.say(&format!("tiles {gathered} of {}: {}", solution.tiles, outputs.join(", "))),
        }
    }
    Ok(())
}

/// Merges tiles and says what came out.
pub(crate) fn merge(options: &MergeArguments, console: Console, cancelled: &'static AtomicBool) -> Result<(), Failure> {
    let watch = Watch::new(console, cancelled);
    let (folder, report) = bake::merge(&options.settings(), &watch)?;
    drop(watch);
    tell(&folder, &report, console);
    Ok(())
}

/// Shows what a folder holds of a solution, as text or as one `info` line of JSON.
pub(crate) fn show(folder: &Path, console: Console) -> Result<(), Failure> {
    let TilesDone { solution, done, faults } = bake::tiles_done(folder)?;
    let missing = TileSet::all(solution.tiles).without(&done);
    let faults: Vec<String> = faults.iter().map(ToString::to_string).collect();
    if console.is_json() {
        console.event(&json!({
            "event": "info",
            "solution": facts(&solution),
            "done": done,
            "missing": missing,
            "faults": faults,
        }));
        return Ok(());
    }
    let or_none = |tiles: &TileSet| if tiles.is_empty() { "none".into() } else { tiles.to_string() };
    let mut lines = vec![
        ("scene", solution.scene.display().to_string()),
        ("version", solution.key.origin()),
        ("texels", solution.texels.to_string()),
        ("tiles", solution.tiles.to_string()),
        ("done", or_none(&done)),
        ("missing", or_none(&missing)),
    ];
    lines.extend(faults.into_iter().map(|fault| ("fault", fault)));
    print_line(&solution_path(folder).display().to_string());
    lines.iter().for_each(|(name, text)| print_line(&format!("  {name:<12} {text}")));
    Ok(())
}

/// A solution for programs.
fn facts(solution: &SolutionHead) -> Value {
    json!({
        "identity": solution.identity,
        "tiles": solution.tiles,
        "texels": solution.texels,
        "scene": solution.scene.display().to_string(),
        "scene_hash": solution.key.scene(),
        "version": solution.key.origin(),
        "settings": solution.key.settings(),
    })
}

fn tiles(count: u32) -> String {
    if count == 1 { "1 tile".into() } else { format!("{count} tiles") }
}
