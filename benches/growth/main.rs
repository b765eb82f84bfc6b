//! How time and memory of a bake grow, with the error that was reached beside them. In: generated rooms. Out: tables with
//! slopes, the exponents of the power laws through their rows; CPU seconds, MiB.
//!
//! `cargo bench --bench growth` prints all parts, which takes some twelve minutes of CPU time;
//! `cargo bench --bench growth -- PART [LIMIT]` prints one:
//!
//! | part | what grows | LIMIT |
//! |---|---|---|
//! | `texels` | the resolution of a furnished room | largest side of the page, 512 |
//! | `surfaces` | triangles on as many texels: meshes become finer, or more and smaller | most triangles, 260000; up to 4200000 |
//! | `error` | what `--error` asks for, judged by a bake at half the last target | smallest target in percent, 1 |
//! | `threads` | processors: speed-up per stage, the best of three runs, and whether pages have equal bits | side of the page, 256 |
//!
//! Every bake is a process of its own, at the default settings, so audits and what is gathered again after them count.
//! Wall-clock times are shown as they were and without the time that threads waited for processors in other use.

mod bake;
mod clutter;
mod error;
mod faces;
mod glb;
mod layout;
mod room;
mod sampler;
mod stages;
mod surfaces;
mod table;
mod texels;
mod threads;

use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};

/// Error that bakes aim for where it is not what is measured.
const ERROR: f64 = 0.02;
/// Cells along the page of the furnished room, which is its least resolution.
const ROOM_CELLS: u32 = 64;

/// Prints one part; the scene files go into the folder.
type Part = fn(&Path, Option<f64>) -> Result<()>;

const PARTS: [(&str, Part); 4] =
    [("texels", texels::print), ("surfaces", surfaces::print), ("error", error::print), ("threads", threads::print)];

fn main() -> Result<()> {
    // Cargo itself passes `--bench`.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let number = |text: &String| text.parse().with_context(|| format!("the limit `{text}` is not a number"));
    let limit: Option<f64> = arguments.get(1).map(number).transpose()?;
    let chosen = |name: &str| arguments.first().is_none_or(|a| a == name);
    if !PARTS.iter().any(|(name, _)| chosen(name)) {
        bail!("there is no part `{}`; choose one of {:?}", arguments[0], PARTS.map(|(name, _)| name));
    }
    let folder = tempfile::tempdir()?;
    PARTS.iter().filter(|(name, _)| chosen(name)).try_for_each(|(_, print)| print(folder.path(), limit))
}

/// Writes the furnished room; returns its file.
fn furnished_room(folder: &Path) -> Result<PathBuf> {
    let file = folder.join("room.glb");
    glb::write(&file, &room::furnished(ROOM_CELLS), ROOM_CELLS)?;
    Ok(file)
}
