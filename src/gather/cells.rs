//! Shares probes between texels: every chart is covered by cells with a probe at each corner; a cell whose corners
//! do not foretell what lies between them is split, down to single texels. Where probes are close, they are rough at
//! first, and what they find is put together in the end.
//!
//! A probe depends on its texel alone, and whether a cell is split on its own probes alone, so that any subset of charts
//! can be gathered anywhere with the same bits.

mod blend;
mod draft;
mod fill;
mod judge;
mod rough;
mod tiles;

pub use draft::Gathering;
pub use tiles::Tiles;

use super::footprint::Footprint;
use super::probe::{Care, Probe, ProbeSettings, Told};
use super::source::Source;
use super::tally::Grouped;
use crate::atlas::{Atlas, NO_TEXEL, Texels};
use crate::progress::{Cancelled, Counter, Progress, Stage};
use crate::scene::Rgb;
use fill::{Filled, Finished, Outcome};
use glam::Vec2;
use judge::Verdict;
use rayon::prelude::*;
use std::collections::HashMap;

/// Texels along a side of the largest cells.
const SPACING: u32 = 16;
/// Texels along a side of cells up to which rough probes that are smoothed will do as corners.
const CLOSE: u32 = 3;
/// Probes between two looks at the gather.
const BATCH: usize = 4096;

/// How fine the cells become.
#[derive(Clone, Copy, Debug)]
pub struct CellSettings {
    /// Error at which a cell is fine enough, relative to the yardstick of probes.
    pub tolerance: f32,
    /// How its probes gather.
    pub probe: ProbeSettings,
}

/// A rectangle of texels with a probe at or near each corner. Page coordinates, bounds inclusive.
#[derive(Clone)]
struct Cell {
    chart: u32,
    x: [u32; 2],
    y: [u32; 2],
    /// Owns its last column and row.
    closed: [bool; 2],
    /// The cell it was cut from, if any: corners foretold by it tell its error.
    parent: Option<Rect>,
}

impl Cell {
    /// Texels from the first to the last along its longer side.
    fn size(&self) -> u32 {
        (self.x[1] - self.x[0]).max(self.y[1] - self.y[0])
    }
}

/// Corner texels and the rectangle they span.
#[derive(Clone)]
struct Rect {
    x: [u32; 2],
    y: [u32; 2],
    corners: [u32; 4],
}

/// What is known of all texels so far.
struct State<'a> {
    source: &'a Source<'a>,
    atlas: &'a Atlas,
    texels: &'a Texels,
    footprint: &'a Footprint<'a>,
    settings: &'a CellSettings,
    /// Probe of each texel, `NO_PROBE` if it has none.
    probe_of: Vec<u32>,
    /// Texels and their probes, in the order in which they were wanted.
    probes: Vec<(u32, Probe)>,
    /// What stands for rough probes in the end, by their number.
    smoothed: HashMap<u32, Probe>,
    /// Probes that were gathered before, by texel. They count once they are wanted.
    kept: HashMap<u32, Probe>,
}

/// Which look of a probe counts.
#[derive(Clone, Copy)]
enum Look {
    /// The first, whoever else has asked for a better one: cells then depend on nothing but themselves.
    First,
    /// The best by now.
    Best,
}

const NO_PROBE: u32 = u32::MAX;

/// Irradiance from everything but lamps at every texel, W/m².
pub struct Indirect {
    /// Per texel.
    pub irradiance: Vec<Rgb>,
    /// The same by light group.
    pub groups: Grouped,
    /// Sum of the squared errors to be expected over all texels of the cells, mean of channels, (W/m²)².
    pub squared_error: f64,
    /// Texels with their probes.
    pub probes: Vec<(u32, Probe)>,
    /// Rays cast.
    pub rays: u64,
}

/// What a gather starts from.
#[derive(Default)]
pub struct Start {
    /// Irradiance of the texels that are left as they are, W/m².
    pub irradiance: Vec<Rgb>,
    /// The same by light group.
    pub groups: Grouped,
    /// Per texel: whether its cell is to be gathered; all are where it is empty.
    pub wanted: Vec<bool>,
    /// Probes of an earlier gather that came to no end.
    pub probes: Vec<(u32, Probe)>,
}

/// Gathers at the corners of adaptive cells and interpolates between them. `watch` is called now and then.
pub fn indirect(
    source: &Source,
    atlas: &Atlas,
    texels: &Texels,
    footprint: &Footprint,
    settings: &CellSettings,
    start: Start,
    watch: &mut dyn FnMut(&Gathering),
    progress: &dyn Progress,
) -> Result<Indirect, Cancelled> {
    let (probe_of, probes) = (vec![NO_PROBE; texels.len()], Vec::new());
    let Start { mut irradiance, groups, wanted, probes: kept } = start;
    // A gather that starts from nothing starts with no groups either.
    let mut groups = if irradiance.is_empty() { Grouped::new(source.groups(), texels.len()) } else { groups };
    irradiance.resize(texels.len(), Rgb::ZERO);
    let kept = kept.into_iter().collect();
    let mut state =
        State { source, atlas, texels, footprint, settings, probe_of, probes, smoothed: HashMap::new(), kept };
    let mut cells: Vec<Cell> = (0..atlas.charts.len()).flat_map(|c| state.lattice(c)).collect();
    if !wanted.is_empty() {
        cells.retain(|cell| state.owned(cell).iter().any(|&(t, _)| wanted[t as usize]));
    }
    let counter = Counter::new(progress, Stage::Gather, cells.par_iter().map(|cell| state.owned(cell).len()).sum());
    let mut finished: Vec<Finished> = Vec::new();
    while !cells.is_empty() {
        let corners: Vec<[u32; 4]> = cells.par_iter().map(|c| state.corners(c)).collect();
        let mut look =
            |state: &State| watch(&Gathering { state, cells: &cells, finished: &finished, irradiance: &irradiance });
        state.gather(corners.iter().flatten().copied(), &mut look, progress)?;
        let verdicts: Vec<Verdict> =
            cells.par_iter().zip(&corners).map(|(c, &corners)| state.judge(c, corners, Look::First)).collect();
        let middles = verdicts.iter().filter_map(|verdict| if let Verdict::Ask(t) = verdict { Some(*t) } else { None });
        // Rough probes tell where light bends, but those that many texels hang on must be known well.
        let is_large = |cell: &Cell, verdict: &Verdict| cell.size() > CLOSE && !matches!(verdict, Verdict::Split);
        let large = cells.iter().zip(&corners).zip(&verdicts).filter(|((cell, _), verdict)| is_large(cell, verdict));
        state.refine(large.flat_map(|((_, &corners), _)| corners), &mut look, progress)?;
        state.gather(middles.clone(), &mut look, progress)?;
        state.refine(middles, &mut look, progress)?;
        let verdicts: Vec<Verdict> = cells
            .par_iter()
            .zip(&corners)
            .zip(verdicts)
            .map(|((cell, &corners), verdict)| match is_large(cell, &verdict) {
                true => state.judge(cell, corners, Look::Best),
                false => verdict,
            })
            .collect();
        let outcomes: Vec<Outcome> = cells
            .par_iter()
            .zip(&corners)
            .zip(&verdicts)
            .map(|((cell, &corners), &verdict)| {
                let outcome = state.settle(cell, corners, verdict);
                if let Outcome::Done(Finished { cell, .. }) = &outcome {
                    counter.advance(state.owned(cell).len())?;
                }
                Ok(outcome)
            })
            .collect::<Result<_, Cancelled>>()?;
        cells.clear();
        for outcome in outcomes {
            match outcome {
                Outcome::Split(children) => cells.extend(children),
                Outcome::Done(cell) => finished.push(cell),
            }
        }
    }
    let mut look =
        |state: &State| watch(&Gathering { state, cells: &[], finished: &finished, irradiance: &irradiance });
    state.smooth(&finished, &mut look, progress)?;
    let filled: Vec<Filled> = finished.par_iter().map(|cell| state.fill(cell)).collect();
    let squared_error = filled.iter().map(|filled| filled.squared_error).sum();
    for Filled { values, groups: parts, .. } in &filled {
        for (i, &(texel, value)) in values.iter().enumerate() {
            irradiance[texel as usize] = value;
            groups.of_mut(texel as usize).copy_from_slice(parts.of(i));
        }
    }
    let rays = state.probes.iter().map(|(_, p)| p.rays as u64).sum();
    Ok(Indirect { irradiance, groups, squared_error, probes: state.probes, rays })
}

impl State<'_> {
    /// The largest cells of a chart, evenly spaced between its first and last texels.
    fn lattice(&self, chart: usize) -> Vec<Cell> {
        let c = &self.atlas.charts[chart];
        if self.texels.charts[chart].is_empty() {
            return Vec::new();
        }
        let (xs, ys) = (lines(&c.x), lines(&c.y));
        let mut cells = Vec::new();
        for (j, y) in ys.windows(2).enumerate() {
            for (i, x) in xs.windows(2).enumerate() {
                cells.push(Cell {
                    chart: chart as u32,
                    x: [x[0], x[1]],
                    y: [y[0], y[1]],
                    closed: [i + 2 == xs.len(), j + 2 == ys.len()],
                    parent: None,
                });
            }
        }
        cells
    }

    /// Texel at a page position if it belongs to the chart.
    fn texel(&self, chart: u32, x: u32, y: u32) -> Option<u32> {
        let page = &self.texels.pages[self.atlas.charts[chart as usize].page];
        let t = page.texel[y as usize * page.width as usize + x as usize];
        (t != NO_TEXEL && self.texels.charts[chart as usize].contains(&t)).then_some(t)
    }

    /// The usable texels of the cell nearest to its corners: left and right of the first row, then of the last.
    fn corners(&self, cell: &Cell) -> [u32; 4] {
        let usable = |x, y| self.texel(cell.chart, x, y).filter(|&t| !self.footprint.is_hidden(t));
        std::array::from_fn(|k| {
            let (cx, cy) = (cell.x[k & 1], cell.y[k >> 1]);
            if let Some(t) = usable(cx, cy) {
                return t;
            }
            let mut best = (u32::MAX, NO_TEXEL);
            for y in cell.y[0]..=cell.y[1] {
                for x in cell.x[0]..=cell.x[1] {
                    let d = x.abs_diff(cx).pow(2) + y.abs_diff(cy).pow(2);
                    if d < best.0
                        && let Some(t) = usable(x, y)
                    {
                        best = (d, t);
                    }
                }
            }
            best.1
        })
    }

    /// Gathers those of the probes `wanted` that are still lacking. `look` is called after every [`BATCH`].
    fn gather(
        &mut self,
        wanted: impl Iterator<Item = u32>,
        look: &mut dyn FnMut(&State),
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        let wanted = wanted.filter(|&t| t != NO_TEXEL && self.probe_of[t as usize] == NO_PROBE).collect();
        let probe = |state: &State, t: u32| {
            // One that was refined counts as such once this gather asks for that.
            let first = state.kept.get(&t).map(|probe| probe.first().clone());
            first.unwrap_or_else(|| state.gathered(t, state.is_rough(t)))
        };
        let put = |state: &mut State, t: u32, probe| {
            state.probe_of[t as usize] = state.probes.len() as u32;
            state.probes.push((t, probe));
        };
        self.in_batches(wanted, probe, put, look, progress)
    }

    /// Takes those of the probes `wanted` further that are rough.
    fn refine(
        &mut self,
        wanted: impl Iterator<Item = u32>,
        look: &mut dyn FnMut(&State),
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        let wanted = wanted.filter(|&t| t != NO_TEXEL && self.probe(t).care == Care::Rough).collect();
        let probe = |state: &State, t: u32| match state.kept.get(&t) {
            Some(kept) if kept.care != Care::Rough => kept.clone(),
            _ => state.probe(t).refined(state.gathered(t, false)),
        };
        let put = |state: &mut State, t: u32, probe| state.probes[state.probe_of[t as usize] as usize].1 = probe;
        self.in_batches(wanted, probe, put, look, progress)
    }

    /// Makes a `probe` for every texel, once, and `put`s them where they belong. `look` is called after every [`BATCH`].
    fn in_batches(
        &mut self,
        mut texels: Vec<u32>,
        probe: impl Fn(&State, u32) -> Probe + Sync,
        put: impl Fn(&mut State, u32, Probe),
        look: &mut dyn FnMut(&State),
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        texels.sort_unstable();
        texels.dedup();
        for batch in texels.chunks(BATCH) {
            let make = |&t: &u32| if progress.is_cancelled() { Err(Cancelled) } else { Ok(probe(self, t)) };
            let new: Vec<Probe> = batch.par_iter().map(make).collect::<Result<_, _>>()?;
            batch.iter().zip(new).for_each(|(&t, probe)| put(self, t, probe));
            look(self);
        }
        Ok(())
    }

    /// What the probe of a texel tells.
    fn tells(&self, texel: u32, look: Look) -> Told {
        match look {
            Look::First => self.probe(texel).told_first(),
            Look::Best => self.best(texel).told(),
        }
    }

    /// What is known best of a texel: what it and those around it say together, once all have been asked.
    fn best(&self, texel: u32) -> &Probe {
        let i = self.probe_of[texel as usize] as usize;
        self.smoothed.get(&(i as u32)).unwrap_or(&self.probes[i].1)
    }

    fn probe(&self, texel: u32) -> &Probe {
        &self.probes[self.probe_of[texel as usize] as usize].1
    }

    /// Texels that the cell must fill, with their page positions.
    fn owned(&self, cell: &Cell) -> Vec<(u32, Vec2)> {
        let end = |a: [u32; 2], closed: bool| if closed { a[1] + 1 } else { a[1] };
        let mut out = Vec::new();
        for y in cell.y[0]..end(cell.y, cell.closed[1]) {
            for x in cell.x[0]..end(cell.x, cell.closed[0]) {
                if let Some(t) = self.texel(cell.chart, x, y) {
                    out.push((t, Vec2::new(x as f32, y as f32)));
                }
            }
        }
        out
    }
}

/// Columns or rows at which the largest cells of a chart end.
fn lines(range: &std::ops::Range<u32>) -> Vec<u32> {
    let last = range.end.saturating_sub(range.start).saturating_sub(1);
    let n = last.div_ceil(SPACING).max(1);
    (0..=n).map(|i| range.start + (2 * i * last + n) / (2 * n)).collect()
}

/// Cuts a cell at its middle lines.
fn split(cell: &Cell, corners: [u32; 4]) -> Vec<Cell> {
    let halves = |a: [u32; 2], closed: bool| -> Vec<([u32; 2], bool)> {
        if a[1] - a[0] > 1 {
            let middle = (a[0] + a[1]) / 2;
            vec![([a[0], middle], false), ([middle, a[1]], closed)]
        } else {
            vec![(a, closed)]
        }
    };
    let parent = Rect { x: cell.x, y: cell.y, corners };
    let mut children = Vec::new();
    for (y, close_y) in halves(cell.y, cell.closed[1]) {
        for (x, close_x) in halves(cell.x, cell.closed[0]) {
            children.push(Cell { chart: cell.chart, x, y, closed: [close_x, close_y], parent: Some(parent.clone()) });
        }
    }
    children
}
