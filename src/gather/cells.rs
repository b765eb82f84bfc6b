//! Shares probes between texels: every chart is covered by cells with a probe at each corner; a cell whose corners
//! do not foretell what lies between them is split, down to single texels.
//!
//! A probe depends on its texel alone and a cell on its own probes alone, so that any subset of charts can be gathered
//! anywhere with the same bits.
//! Based on: Ward, Rubinstein, Clear, "A Ray Tracing Solution for Diffuse Interreflection", 1988 (how far irradiance
//! reaches follows from the harmonic mean distance to what is seen).

mod blend;
mod draft;
mod tiles;

pub use draft::Gathering;
pub use tiles::Tiles;

use super::footprint::Footprint;
use super::probe::{Probe, ProbeSettings};
use super::source::Source;
use super::tally::{Grouped, share_out};
use crate::atlas::{Atlas, NO_TEXEL, Texels};
use crate::progress::{Cancelled, Counter, Progress, Stage};
use crate::scene::Rgb;
use blend::Blend;
use glam::Vec2;
use rayon::prelude::*;
use std::collections::HashMap;

/// Texels along a side of the largest cells.
const SPACING: u32 = 16;
/// Share of the irradiance that linear interpolation over one harmonic mean distance gets wrong.
const CURVATURE: f32 = 0.06;
/// Share of the difference between corners that may be curvature.
const BEND: f32 = 0.08;
/// A cell whose corners were foretold exactly still is this share as bad as its surroundings suggest.
const TRUST: f32 = 0.3;
/// Texels along a side from which on a cell is also looked at in its middle.
const CHECKED: u32 = 4;
/// Mean over a cell of the square of an error that is one in its middle and falls to none at its corners.
const SAG: f32 = 0.28;
/// Share of the irradiance that interpolation misses at most, as far as is foretold.
const MOST_OFF: f32 = 0.5;
/// Probes between two looks at the gather.
const BATCH: usize = 4096;
/// Cosine of the largest angle between a texel's normal and the one interpolated for it.
const COS_NORMAL: f32 = 0.99;

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
    /// Probes that were gathered before, by texel. They count once they are wanted.
    kept: HashMap<u32, Probe>,
}

/// What the corners of a cell say of it.
#[derive(Clone, Copy)]
enum Verdict {
    /// Interpolation will do.
    Fine,
    /// It will not.
    Split,
    /// It will do if the corners foretell the probe of this texel.
    Ask(u32),
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
    let mut state = State { source, atlas, texels, footprint, settings, probe_of, probes, kept };
    let mut cells: Vec<Cell> = (0..atlas.charts.len()).flat_map(|c| state.lattice(c)).collect();
    if !wanted.is_empty() {
        cells.retain(|cell| state.owned(cell).iter().any(|&(t, _)| wanted[t as usize]));
    }
    let counter = Counter::new(progress, Stage::Gather, cells.par_iter().map(|cell| state.owned(cell).len()).sum());
    let mut squared_error = 0.0;
    while !cells.is_empty() {
        let corners: Vec<[u32; 4]> = cells.par_iter().map(|c| state.corners(c)).collect();
        let mut look =
            |state: &State| watch(&Gathering { state, cells: &cells, irradiance: &irradiance, squared_error });
        state.gather(corners.iter().flatten().copied(), &mut look, progress)?;
        let verdicts: Vec<Verdict> =
            cells.par_iter().zip(&corners).map(|(c, &corners)| state.judge(c, corners)).collect();
        let middles = verdicts.iter().filter_map(|verdict| if let Verdict::Ask(t) = verdict { Some(*t) } else { None });
        state.gather(middles, &mut look, progress)?;
        let outcomes: Vec<Outcome> = cells
            .par_iter()
            .zip(&corners)
            .zip(&verdicts)
            .map(|((cell, &corners), &verdict)| {
                let outcome = state.settle(cell, corners, verdict);
                if let Outcome::Done { values, .. } = &outcome {
                    counter.advance(values.len())?;
                }
                Ok(outcome)
            })
            .collect::<Result<_, Cancelled>>()?;
        cells.clear();
        for outcome in outcomes {
            match outcome {
                Outcome::Split(children) => cells.extend(children),
                Outcome::Done { values, groups: parts, squared_error: square } => {
                    squared_error += square;
                    for (i, (texel, value)) in values.into_iter().enumerate() {
                        irradiance[texel as usize] = value;
                        groups.of_mut(texel as usize).copy_from_slice(parts.of(i));
                    }
                }
            }
        }
    }
    let rays = state.probes.iter().map(|(_, p)| p.rays as u64).sum();
    Ok(Indirect { irradiance, groups, squared_error, probes: state.probes, rays })
}

enum Outcome {
    Split(Vec<Cell>),
    /// Texels with their irradiance, whole and by light group, and the sum of their squared errors as far as these are
    /// known.
    Done {
        values: Vec<(u32, Rgb)>,
        groups: Grouped,
        squared_error: f64,
    },
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
        let mut wanted: Vec<u32> = wanted.filter(|&t| t != NO_TEXEL && self.probe_of[t as usize] == NO_PROBE).collect();
        wanted.sort_unstable();
        wanted.dedup();
        let Self { source, footprint, settings, .. } = *self;
        for wanted in wanted.chunks(BATCH) {
            let kept = &self.kept;
            let new: Vec<Probe> = wanted
                .par_iter()
                .map(|&t| {
                    let gathered = || Probe::gather(source, footprint, t, &settings.probe);
                    let probe = kept.get(&t).cloned().unwrap_or_else(gathered);
                    if progress.is_cancelled() { Err(Cancelled) } else { Ok(probe) }
                })
                .collect::<Result<_, Cancelled>>()?;
            for (&t, probe) in wanted.iter().zip(new) {
                self.probe_of[t as usize] = self.probes.len() as u32;
                self.probes.push((t, probe));
            }
            look(self);
        }
        Ok(())
    }

    fn probe(&self, texel: u32) -> &Probe {
        &self.probes[self.probe_of[texel as usize] as usize].1
    }

    /// What the corners say of a cell whose corners have probes. A large cell that is fine by them is also asked in its
    /// middle, for what is narrow may pass between corners unseen.
    fn judge(&self, cell: &Cell, corners: [u32; 4]) -> Verdict {
        let size = cell.size();
        if size <= 1 || corners[0] == NO_TEXEL {
            return Verdict::Fine;
        }
        let owned = self.owned(cell);
        if !owned.is_empty() && !self.is_fine(cell, corners, &owned) {
            return Verdict::Split;
        }
        let middle = || self.texel(cell.chart, (cell.x[0] + cell.x[1]) / 2, (cell.y[0] + cell.y[1]) / 2);
        match middle().filter(|&t| size >= CHECKED && !self.footprint.is_hidden(t)) {
            Some(middle) if !owned.is_empty() => Verdict::Ask(middle),
            _ => Verdict::Fine,
        }
    }

    /// Splits the cell, or interpolates its texels.
    fn settle(&self, cell: &Cell, corners: [u32; 4], verdict: Verdict) -> Outcome {
        if corners[0] == NO_TEXEL {
            // Nothing in reach can be lit.
            let values: Vec<_> = self.owned(cell).into_iter().map(|(t, _)| (t, Rgb::ZERO)).collect();
            let groups = Grouped::new(self.source.groups(), values.len());
            return Outcome::Done { values, groups, squared_error: 0.0 };
        }
        let blend = Blend::new(self, &Rect { x: cell.x, y: cell.y, corners });
        let asked = match verdict {
            Verdict::Split => return Outcome::Split(split(cell, corners)),
            Verdict::Ask(middle) if !self.is_foretold(corners, &blend, middle) => {
                return Outcome::Split(split(cell, corners));
            }
            Verdict::Ask(middle) => Some(middle),
            Verdict::Fine => None,
        };
        let value = |(t, p): (u32, Vec2)| {
            // One probe more in the middle of a smooth cell would show as a dot.
            let e = match self.probe_of[t as usize] {
                own if own == NO_PROBE || asked == Some(t) => self.told(corners, &blend, p).max(Rgb::ZERO),
                own => self.probes[own as usize].1.irradiance,
            };
            (t, e)
        };
        let owned = self.owned(cell);
        let values: Vec<_> = owned.iter().copied().map(value).collect();
        let mut groups = Grouped::new(self.source.groups(), owned.len());
        if groups.groups() > 0 {
            for (i, (&(t, p), &(_, whole))) in owned.iter().zip(&values).enumerate() {
                let row = groups.of_mut(i);
                match self.probe_of[t as usize] {
                    own if own == NO_PROBE || asked == Some(t) => self.told_groups(corners, &blend, p, row),
                    own => row.copy_from_slice(&self.probes[own as usize].1.groups),
                }
                share_out(whole, row);
            }
        }
        let noise = corners.iter().map(|&c| self.probe(c).error.powi(2)).sum::<f32>() / 4.0;
        let bend = match asked {
            Some(middle) => SAG * self.miss(corners, &blend, middle).powi(2),
            None if cell.size() > 1 => self.likely_error(cell.parent.as_ref(), corners).powi(2),
            None => 0.0,
        };
        let squared_error = f64::from(noise + bend) * values.len() as f64;
        Outcome::Done { values, groups, squared_error }
    }

    /// What [`State::told`] says, by light group.
    fn told_groups(&self, corners: [u32; 4], blend: &Blend, p: Vec2, row: &mut [Rgb]) {
        for (corner, weight) in corners.into_iter().zip(blend.weights(p)) {
            row.iter_mut().zip(&self.probe(corner).groups).for_each(|(sum, &e)| *sum += e * weight);
        }
    }

    /// Irradiance at a page position as the corners have it, W/m².
    fn told(&self, corners: [u32; 4], blend: &Blend, p: Vec2) -> Rgb {
        blend.value(p, |k| self.probe(corners[k]).irradiance)
    }

    /// By how much the corners miss the probe of a texel, W/m², mean of channels.
    fn miss(&self, corners: [u32; 4], blend: &Blend, texel: u32) -> f32 {
        let [x, y] = self.texels.pixel[texel as usize].map(f32::from);
        (self.told(corners, blend, Vec2::new(x, y)) - self.probe(texel).irradiance).element_sum().abs() / 3.0
    }

    /// True if the corners foretell the probe of the texel in the middle.
    fn is_foretold(&self, corners: [u32; 4], blend: &Blend, middle: u32) -> bool {
        let found = self.probe(middle);
        let all = found.irradiance.element_sum() / 3.0 + self.source.direct(middle);
        let tolerance = self.settings.tolerance * self.settings.probe.yardstick(all);
        self.miss(corners, blend, middle) <= 2.0 * tolerance + 2.0 * found.error
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

    /// Largest distance between corners on a diagonal, shortened to how far the middle is, and harmonic mean distance to
    /// what they see, metres.
    fn size_and_reach(&self, corners: [u32; 4]) -> (f32, f32) {
        let position = |k: usize| self.texels.position[corners[k] as usize];
        let size = position(0).distance(position(3)).max(position(1).distance(position(2))) * 0.7;
        (size, corners.map(|c| self.probe(c).distance).into_iter().fold(f32::INFINITY, f32::min))
    }

    /// Mean irradiance of the corners, W/m², mean of channels.
    fn mean(&self, corners: [u32; 4]) -> f32 {
        corners.iter().map(|&c| self.probe(c).irradiance.element_sum() / 3.0).sum::<f32>() / 4.0
    }

    /// By how much interpolation between the corners is expected to miss, W/m², mean of channels.
    fn expected_error(&self, parent: Option<&Rect>, corners: [u32; 4]) -> f32 {
        let probes = corners.map(|c| self.probe(c));
        let values = probes.map(|p| p.irradiance.element_sum() / 3.0);
        let mean = self.mean(corners);
        let noise = probes.iter().map(|p| p.error).fold(0.0, f32::max);
        let low = values.iter().copied().fold(f32::INFINITY, f32::min);
        let high = values.iter().copied().fold(0.0, f32::max);
        let (size, reach) = self.size_and_reach(corners);
        let ratio = size / reach.max(1e-12);
        let mut expected = CURVATURE * ratio * ratio * mean + BEND * (high - low - 2.0 * noise).max(0.0);
        if let Some(parent) = parent {
            let blend = Blend::new(self, parent);
            let miss = corners.map(|c| self.miss(parent.corners, &blend, c)).into_iter().fold(0.0, f32::max);
            // Halving a cell quarters its curvature; what was foretold well needs no further cut.
            expected = expected.min((0.5 * miss).max(TRUST * expected));
        }
        expected
    }

    /// The same without the caution that makes cells fine in time.
    fn likely_error(&self, parent: Option<&Rect>, corners: [u32; 4]) -> f32 {
        self.expected_error(parent, corners).min(MOST_OFF * self.mean(corners))
    }

    /// True if interpolation between the corners is expected to stay within the tolerance.
    fn is_fine(&self, cell: &Cell, corners: [u32; 4], owned: &[(u32, Vec2)]) -> bool {
        let (source, settings) = (self.source, self.settings);
        let t = self.texels;
        let mean = self.mean(corners);
        let direct = corners.map(|c| source.direct(c)).into_iter().fold(f32::INFINITY, f32::min);
        let tolerance = settings.tolerance * settings.probe.yardstick(mean + direct);
        if self.expected_error(cell.parent.as_ref(), corners) > tolerance {
            return false;
        }
        let (size, reach) = self.size_and_reach(corners);
        // What something stands on shares no light with what lies around.
        let covered = self.footprint.covered();
        let first = covered[corners[0] as usize];
        if corners.iter().chain(owned.iter().map(|(t, _)| t)).any(|&t| covered[t as usize] != first) {
            return false;
        }
        // Folds and steps in the surface show in normals and positions before they show in light.
        let slack = 0.02 * reach + 0.25 * size / cell.size().max(1) as f32;
        let blend = Blend::new(self, &Rect { x: cell.x, y: cell.y, corners });
        owned.iter().all(|&(texel, p)| {
            let n = blend.value(p, |k| t.shading_normal[corners[k] as usize]);
            let at = blend.value(p, |k| t.position[corners[k] as usize]);
            let i = texel as usize;
            n.dot(t.shading_normal[i]) >= COS_NORMAL * n.length()
                && at.distance(t.position[i]) <= slack.max(size * 0.25)
        })
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
