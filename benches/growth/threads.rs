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

/// Least seconds of one stage over all rounds: on the clock, the same without waiting for other programs, and of CPU.
#[derive(Clone, Copy)]
struct Best {
    wall: f64,
    undisturbed: f64,
    cpu: f64,
}

impl Best {
    const NONE: Self = Self { wall: 0.0, undisturbed: 0.0, cpu: 0.0 };
    const UNKNOWN: Self = Self { wall: f64::INFINITY, undisturbed: f64::INFINITY, cpu: f64::INFINITY };

    fn combine(self, other: Self, f: fn(f64, f64) -> f64) -> Self {
        Self {
            wall: f(self.wall, other.wall),
            undisturbed: f(self.undisturbed, other.undisturbed),
            cpu: f(self.cpu, other.cpu),
        }
    }
}

/// Bakes with 1, 2 and all threads at a resolution of `limit`.
pub(crate) fn print(folder: &Path, limit: Option<f64>) -> Result<()> {
    let scene = furnished_room(folder)?;
    let resolution = limit.unwrap_or(PAGE) as u32;
    let mut counts = vec![1, 2, available_parallelism()?.get()];
    counts.sort_unstable();
    counts.dedup();
    let mut best = vec![[Best::UNKNOWN; STAGES.len()]; counts.len()];
    let mut pages: Vec<Vec<u8>> = Vec::new();
    // Rounds are interleaved, so that other load on the machine meets all of them.
    for _ in 0..ROUNDS {
        for (&threads, best) in counts.iter().zip(&mut best) {
            let baked = Job { scene: &scene, resolution, error: ERROR, threads: Some(threads) }.run()?;
            for (stage, best) in STAGES.iter().zip(best) {
                let [wall, cpu] = ["wall_s", "cpu_s"].map(|clock| baked.stage(stage, clock));
                let this = Best { wall, undisturbed: baked.undisturbed(stage), cpu };
                *best = best.combine(this, f64::min);
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

/// One row per notable stage, and one for all together; "alone" is the clock without waiting for other programs.
fn print_speed_up(title: &str, one: &[Best], many: &[Best]) {
    let columns = [
        Column::number("share %", 0),
        Column::seconds("1: wall s"),
        Column::seconds("alone s"),
        Column::seconds("CPU s"),
        Column::seconds("n: wall s"),
        Column::seconds("alone s"),
        Column::seconds("CPU s"),
        Column::number("wall ×", 2),
        Column::number("alone ×", 2),
    ];
    let mut table = Table::new(title, &columns);
    let sum = |stages: &[Best]| stages.iter().fold(Best::NONE, |a, b| a.combine(*b, |a, b| a + b));
    let (one_sum, many_sum) = (sum(one), sum(many));
    let mut row = |name: &str, one: Best, many: Best| {
        let share = one.cpu / one_sum.cpu;
        if share > NOTABLE {
            let mut cells = vec![100.0 * share];
            cells.extend([one, many].iter().flat_map(|best| [best.wall, best.undisturbed, best.cpu]));
            cells.extend([one.wall / many.wall, one.undisturbed / many.undisturbed]);
            table.push(name, cells);
        }
    };
    for (name, (&one, &many)) in STAGES.iter().zip(one.iter().zip(many)) {
        row(name, one, many);
    }
    row("all stages", one_sum, many_sum);
}
