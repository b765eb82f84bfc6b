//! Growth with exactness: the furnished room at falling error targets, judged by a bake at half the last one.

use crate::bake::{Baked, Job};
use crate::table::{Column, Table};
use crate::{furnished_room, stages};
use anyhow::{Result, anyhow};
use exr::prelude::read_first_flat_layer_from_file;
use std::path::Path;

/// Side of the page.
const PAGE: u32 = 128;
/// The first target, percent; each is half of the one before.
const COARSEST: f64 = 8.0;
/// The last one.
const FINEST: f64 = 1.0;

/// Bakes for targets down to `limit` percent.
pub(crate) fn print(folder: &Path, limit: Option<f64>) -> Result<()> {
    let scene = furnished_room(folder)?;
    let finest = limit.unwrap_or(FINEST);
    let bake = |percent: f64| {
        let baked = Job { scene: &scene, resolution: PAGE, error: percent / 100.0, threads: None }.run()?;
        let page = Page::read(baked.page())?;
        Ok::<(Baked, Page), anyhow::Error>((baked, page))
    };
    let targets = (0..).map(|i| COARSEST / f64::from(1 << i)).take_while(|&percent| percent >= finest);
    let columns = [
        Column::number("target %", 2),
        Column::seconds("CPU s"),
        Column::number("Mrays", 2),
        Column::count("links"),
        Column::count("probes"),
        Column::number("rRMSE %", 2),
        Column::number("audit %", 2),
        Column::number("from", 2).flat(),
        Column::number("to", 2).flat(),
        Column::number("again %", 0).flat(),
    ];
    // The judge comes first, so that rows are whole when they are printed.
    let judge_target = targets.clone().last().unwrap_or(COARSEST) / 2.0;
    let (judge, truth) = bake(judge_target)?;
    let title = format!("error: a furnished room, {PAGE}² page; rRMSE against the last row");
    let mut table = Table::new(&title, &columns);
    let row = |target: f64, baked: &Baked, rrmse: f64| {
        vec![
            target,
            baked.cpu(),
            1e-6 * baked.rays(),
            baked.number("/solver/links"),
            baked.number("/solver/probes"),
            rrmse,
            baked.audited(),
            100.0 * baked.number("/audit/error/low"),
            100.0 * baked.number("/audit/error/high"),
            baked.again(),
        ]
    };
    let mut bakes = Vec::new();
    for target in targets {
        let (baked, page) = bake(target)?;
        table.push("", row(target, &baked, 100.0 * page.rrmse(&truth)));
        bakes.push((target, baked));
    }
    table.slopes();
    table.push("judged by", row(judge_target, &judge, f64::NAN));
    stages::print(columns[0], &bakes);
    Ok(())
}

/// All values of a lightmap, channel by channel.
struct Page(Vec<f32>);

impl Page {
    fn read(path: &Path) -> Result<Self> {
        let image = read_first_flat_layer_from_file(path).map_err(|e| anyhow!("reading {}: {e}", path.display()))?;
        let channels = image.layer_data.channel_data.list;
        Ok(Self(channels.iter().flat_map(|c| c.sample_data.values_as_f32()).collect()))
    }

    /// Root of the mean squared difference to `truth` by its mean, over what is not empty there.
    fn rrmse(&self, truth: &Self) -> f64 {
        let pairs = self.0.iter().zip(&truth.0).filter(|(_, t)| **t > 0.0);
        let (mut count, mut squared, mut sum) = (0.0, 0.0, 0.0);
        for (value, truth) in pairs {
            count += 1.0;
            squared += f64::from(value - truth).powi(2);
            sum += f64::from(*truth);
        }
        (squared / count).sqrt() / (sum / count)
    }
}
