//! Speed-up with threads, stage by stage, and whether the lightmaps have equal bits.

use crate::bake::{Job, STAGES};
use crate::table::{Column, Table};
use crate::{ERROR, furnished_room};
use anyhow::Result;
use std::fs;
use std::path::Path;
use std::thread::available_parallelism;

/// Side of the page.
const PAGE: f64 = 256.0;
/// Bakes of which the fastest counts, stage by stage.
const ROUNDS: usize = 3;
/// Share of the time above which a stage is shown.
const NOTABLE: f64 = 0.05;

/// Least seconds of one stage over all rounds.
#[derive(Clone, Copy)]
struct Best {
    wall: f64,
    cpu: f64,
}

/// Bakes with 1, 2 and all threads at a resolution of `limit`.
pub(crate) fn print(folder: &Path, limit: Option<f64>) -> Result<()> {
    let scene = furnished_room(folder)?;
    let resolution = limit.unwrap_or(PAGE) as u32;
    let mut counts = vec![1, 2, available_parallelism()?.get()];
    counts.sort_unstable();
    counts.dedup();
    let mut best = vec![[Best { wall: f64::INFINITY, cpu: f64::INFINITY }; STAGES.len()]; counts.len()];
    let mut pages: Vec<Vec<u8>> = Vec::new();
    // Rounds are interleaved, so that other load on the machine meets all of them.
    for _ in 0..ROUNDS {
        for (&threads, best) in counts.iter().zip(&mut best) {
            let baked = Job { scene: &scene, resolution, error: ERROR, threads: Some(threads) }.run()?;
            for (stage, best) in STAGES.iter().zip(best) {
                best.wall = best.wall.min(baked.stage(stage, "wall_s"));
                best.cpu = best.cpu.min(baked.stage(stage, "cpu_s"));
            }
            pages.push(fs::read(baked.page())?);
        }
    }
    for (&threads, of_threads) in counts.iter().zip(&best).skip(1) {
        print_speed_up(&format!("threads: {threads} against 1, {resolution}² page"), &best[0], of_threads);
    }
    let equal = pages.windows(2).all(|pair| pair[0] == pair[1]);
    println!("\nthe pages of all {} bakes {}", pages.len(), if equal { "have equal bits" } else { "DIFFER" });
    Ok(())
}

/// One row per notable stage, and one for all stages together.
fn print_speed_up(title: &str, one: &[Best], many: &[Best]) {
    let columns = [
        Column::number("share %", 0),
        Column::seconds("wall s, 1"),
        Column::seconds("wall s"),
        Column::number("speed-up", 2),
        Column::seconds("CPU s, 1"),
        Column::seconds("CPU s"),
        Column::number("CPU/wall", 2),
    ];
    let mut table = Table::new(title, &columns);
    let sum = |stages: &[Best]| {
        stages.iter().fold(Best { wall: 0.0, cpu: 0.0 }, |a, b| Best { wall: a.wall + b.wall, cpu: a.cpu + b.cpu })
    };
    let (one_sum, many_sum) = (sum(one), sum(many));
    let mut row = |name: &str, one: Best, many: Best| {
        let share = one.wall / one_sum.wall;
        if share > NOTABLE {
            let speed_up = one.wall / many.wall;
            let used = many.cpu / many.wall;
            table.push(name, vec![100.0 * share, one.wall, many.wall, speed_up, one.cpu, many.cpu, used]);
        }
    };
    for (name, (&one, &many)) in STAGES.iter().zip(one.iter().zip(many)) {
        row(name, one, many);
    }
    row("all stages", one_sum, many_sum);
}
