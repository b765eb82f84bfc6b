//! Growth with surfaces: the room filled with balls, on as many texels whatever their number.

use crate::bake::{Job, MEBIBYTE};
use crate::clutter::{CELLS, COARSEST, FIRST, balls};
use crate::table::{Column, Table};
use crate::{ERROR, glb, room, stages};
use anyhow::Result;
use lightkiln::accel::Accel;
use lightkiln::import::{self, ImportSettings};
use lightkiln::progress::Silent;
use std::path::Path;

const MOST_TRIANGLES: f64 = 260_000.0;
/// Texels along the page, one to a cell.
const PAGE: u32 = 256;
/// Cells per metre of the room: it takes less than half of the page, as do the balls.
const ROOM_DENSITY: f32 = 15.0;

/// A way to grow: step → number of balls, divisions of their faces, cells along these; none where it ends.
type Family = (&'static str, fn(u32) -> Option<(usize, usize, u32)>);

const FAMILIES: [Family; 3] = [
    ("meshes become finer", |step| Some((FIRST, COARSEST << step, CELLS))),
    ("objects become more and smaller", |step| {
        Some((FIRST << (2 * step), COARSEST, CELLS >> step)).filter(|f| f.2 > 0)
    }),
    ("the same without a lightmap on them", |step| Some((FIRST << (2 * step), COARSEST, 0))),
];

/// Bakes every family with up to `limit` triangles, each four times those before.
pub(crate) fn print(folder: &Path, limit: Option<f64>) -> Result<()> {
    let most = limit.unwrap_or(MOST_TRIANGLES);
    FAMILIES.iter().try_for_each(|family| print_family(folder, family, most))
}

fn print_family(folder: &Path, (name, at): &Family, most: f64) -> Result<()> {
    let columns = [
        Column::count("triangles"),
        Column::count("texels").flat(),
        Column::count("elements"),
        Column::count("links"),
        Column::seconds("CPU s"),
        Column::number("Mrays", 2),
        Column::number("peak MiB", 1),
        Column::number("B/new tri", 0).flat(),
        Column::number("BVH B/tri", 1).flat(),
        Column::number("audit %", 2).flat(),
        Column::number("again %", 0).flat(),
    ];
    let mut table = Table::new(&format!("surfaces: {name}, {PAGE}² page, error 2 %"), &columns);
    let mut bakes = Vec::new();
    let mut before = (f64::NAN, f64::NAN);
    let file = folder.join("clutter.glb");
    for (count, divisions, cells) in (0..).map_while(at) {
        if (count * 12 * divisions * divisions) as f64 > most {
            break;
        }
        let objects: Vec<_> = room::shell(ROOM_DENSITY).into_iter().chain(balls(count, divisions, cells)).collect();
        glb::write(&file, &objects, PAGE)?;
        drop(objects);
        let baked = Job { scene: &file, resolution: PAGE, error: ERROR, threads: None }.run()?;
        let (triangles, peak) = (baked.number("/scene/triangles"), baked.peak());
        table.push(
            "",
            vec![
                triangles,
                baked.number("/atlas/texels"),
                baked.number("/solver/elements"),
                baked.number("/solver/links"),
                baked.cpu(),
                1e-6 * baked.rays(),
                peak,
                (peak - before.1) * MEBIBYTE / (triangles - before.0),
                structure_bytes(&file)? / triangles,
                baked.audited(),
                baked.again(),
            ],
        );
        before = (triangles, peak);
        bakes.push((triangles, baked));
    }
    table.slopes();
    stages::print(columns[0], &bakes);
    Ok(())
}

/// Memory of the structure that rays go through, which the report does not tell.
fn structure_bytes(file: &Path) -> Result<f64> {
    let imported = import::load(file, &ImportSettings::default(), &Silent)?;
    Ok(Accel::build(&imported.scene).size() as f64)
}
