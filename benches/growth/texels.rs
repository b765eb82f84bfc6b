//! Growth with texels: a furnished room at rising resolution.

use crate::bake::{Job, MEBIBYTE};
use crate::table::{Column, Table};
use crate::{ERROR, ROOM_CELLS, furnished_room, stages};
use anyhow::Result;
use std::path::Path;

const LARGEST_PAGE: f64 = 512.0;

/// Bakes at resolutions up to `limit`, each twice the one before.
pub(crate) fn print(folder: &Path, limit: Option<f64>) -> Result<()> {
    let scene = furnished_room(folder)?;
    let largest = limit.unwrap_or(LARGEST_PAGE);
    let resolutions = (0..).map(|i| ROOM_CELLS << i).take_while(|&r| f64::from(r) <= largest);
    let columns = [
        Column::count("texels"),
        Column::seconds("CPU s"),
        Column::number("CPU µs/tx", 1).flat(),
        Column::number("peak MiB", 1),
        Column::number("B/new tx", 0).flat(),
        Column::number("Mrays", 2),
        Column::number("rays/tx", 1).flat(),
        Column::count("elements"),
        Column::count("links"),
        Column::number("audit %", 2).flat(),
        Column::number("again %", 0).flat(),
    ];
    let mut table = Table::new("texels: a furnished room, error 2 %", &columns);
    let mut bakes = Vec::new();
    let mut before = (f64::NAN, f64::NAN);
    for resolution in resolutions {
        let baked = Job { scene: &scene, resolution, error: ERROR, threads: None }.run()?;
        let (texels, peak) = (baked.number("/atlas/texels"), baked.peak());
        let per_new_texel = (peak - before.1) * MEBIBYTE / (texels - before.0);
        table.push(
            "",
            vec![
                texels,
                baked.cpu(),
                1e6 * baked.cpu() / texels,
                peak,
                per_new_texel,
                1e-6 * baked.rays(),
                baked.rays() / texels,
                baked.number("/solver/elements"),
                baked.number("/solver/links"),
                baked.audited(),
                baked.again(),
            ],
        );
        before = (texels, peak);
        bakes.push((texels, baked));
    }
    table.slopes();
    stages::print(columns[0], &bakes);
    Ok(())
}
