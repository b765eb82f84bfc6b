//! Seam mending: bilinear lookups on both sides of a cut through a smooth surface are made to agree.
//!
//! Least squares over the texels that such lookups touch, as in Iwanicki, "Lighting Technology of The Last of Us",
//! 2013. Units are those of the pages.

use super::edges::{Seam, Side, seams};
use super::least_squares::{Equation, Problem, TERMS, mismatch};
use crate::atlas::{Atlas, PageImage, Texels};
use crate::progress::{Cancelled, Counter, Progress, Stage};
use crate::scene::{Rgb, Scene};
use glam::{DVec3, Vec2};
use rayon::prelude::*;
use std::collections::HashMap;

/// Lookups per texel of a seam's length.
const SAMPLES_PER_TEXEL: f32 = 2.0;

/// Resistance to change of a texel that no chart covers, relative to a lookup, and what full coverage adds to it: what
/// was baked weighs more than what was only filled in.
const EMPTY_WEIGHT: f64 = 0.01;
const COVERED_WEIGHT: f64 = 3.0;

/// Share of its value by which a baked texel may change: what is left of a jump shows less than a texel that is wrong.
const MOST_CHANGE: f32 = 0.3;

/// Share of the differences around a lookup, within three texels on each side, by which the sides may disagree because
/// they are sampled at different points of one slope. What jumps more than that is light that really changes at the
/// edge, for example under a wall, and must not bleed across.
const GRADIENT_TOLERANCE: f32 = 0.5;
/// Share of the values themselves that is allowed on top, for their error.
const VALUE_TOLERANCE: f32 = 0.1;

/// A texel of a page.
type Place = (usize, u32);

/// A texel whose value changes.
struct Change {
    place: Place,
    value: Rgb,
    /// The part's.
    part: Rgb,
}

/// Mends all seams of all instances. `pages` are filled around their charts. `filled` marks, beside the valid
/// texels, those empty ones that now have a value of their own. `part` holds a part of the light of `pages`, and is
/// changed as that part of them: what may be mended, and by how much, the whole decides.
pub(super) fn mend(
    atlas: &Atlas,
    texels: &Texels,
    scene: &Scene,
    pages: &mut [PageImage],
    filled: &mut [Vec<bool>],
    mut part: Option<&mut [PageImage]>,
    progress: &dyn Progress,
) -> Result<(), Cancelled> {
    let counter = Counter::new(progress, Stage::Post, atlas.layouts.len());
    let map = Map { texels, pages, part: part.as_deref() };
    let changes: Vec<Vec<Change>> = (0..atlas.layouts.len())
        .into_par_iter()
        .map(|instance| {
            let changes = map.mend_instance(&seams(scene, atlas, instance));
            counter.advance(1)?;
            Ok(changes)
        })
        .collect::<Result<_, Cancelled>>()?;
    // In the order of the instances, because two of them may touch the same empty texel.
    for change in changes.into_iter().flatten() {
        let (page, i) = change.place;
        pages[page].rgb[i as usize] = change.value;
        filled[page][i as usize] = true;
        if let Some(part) = &mut part {
            part[page].rgb[i as usize] = change.part;
        }
    }
    Ok(())
}

/// The pages before mending.
struct Map<'a> {
    texels: &'a Texels,
    pages: &'a [PageImage],
    part: Option<&'a [PageImage]>,
}

/// Least and largest value per channel.
#[derive(Clone, Copy)]
struct Range {
    low: Rgb,
    high: Rgb,
}

impl Range {
    fn union(self, other: Range) -> Range {
        Range { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn width(self) -> f32 {
        (self.high - self.low).max_element()
    }
}

/// The four texels of a bilinear lookup and their weights.
type Footprint = [(Place, f32); 4];

impl Map<'_> {
    fn mend_instance(&self, seams: &[Seam]) -> Vec<Change> {
        let mut unknowns: HashMap<Place, u32> = HashMap::new();
        let mut places: Vec<Place> = Vec::new();
        let mut ranges: Vec<Range> = Vec::new();
        let mut problem = Problem::default();
        for seam in seams {
            for lookup in lookups(seam) {
                let Some((terms, range)) = self.comparable(seam, lookup) else { continue };
                let mut equation: Equation = [(0, 0.0); TERMS];
                for (term, (place, weight)) in equation.iter_mut().zip(terms) {
                    let unknown = *unknowns.entry(place).or_insert_with(|| {
                        places.push(place);
                        ranges.push(range);
                        places.len() as u32 - 1
                    });
                    ranges[unknown as usize] = ranges[unknown as usize].union(range);
                    *term = (unknown, weight);
                }
                problem.equations.push(equation);
            }
        }
        problem.values = places.iter().map(|&p| self.value(p).as_dvec3()).collect();
        problem.weights = places.iter().map(|&p| self.weight(p)).collect();
        if problem.equations.iter().all(|e| mismatch(e, &problem.values) == DVec3::ZERO) {
            return Vec::new();
        }
        let solution = problem.solve();
        // No new extremes: what agrees by overshooting would show as a bright or dark line.
        let value = |x: DVec3, range: &Range| x.as_vec3().max(range.low).min(range.high);
        let changes = places.into_iter().zip(solution).zip(&ranges);
        let change = |((place, x), range): ((Place, DVec3), &Range)| {
            let mut value = value(x, range);
            if self.texel(place).is_some() {
                let own = self.value(place);
                value = value.clamp(own * (1.0 - MOST_CHANGE), own * (1.0 + MOST_CHANGE));
            }
            Change { place, value, part: value * self.share(place) }
        };
        changes.map(change).collect()
    }

    /// The part's share of the light at a place or, where that is dark, around it.
    fn share(&self, (page, i): Place) -> Rgb {
        let Some(part) = self.part else { return Rgb::ZERO };
        let (whole, part) = (&self.pages[page], &part[page]);
        let (x, y) = (i % whole.width, i / whole.width);
        let columns = || x.saturating_sub(1)..(x + 2).min(whole.width);
        let around = || {
            let rows = y.saturating_sub(1)..(y + 2).min(whole.height);
            rows.flat_map(|y| columns().map(move |x| (y * whole.width + x) as usize))
        };
        let own = (whole.rgb[i as usize], part.rgb[i as usize]);
        let sums = (around().map(|i| whole.rgb[i]).sum::<Rgb>(), around().map(|i| part.rgb[i]).sum::<Rgb>());
        Rgb::from_array(std::array::from_fn(|c| {
            let (whole, part) = if own.0[c] > 0.0 { own } else { sums };
            if whole[c] > 0.0 { part[c] / whole[c] } else { 0.0 }
        }))
    }

    /// Both footprints of a lookup, the second with negative weights, and the range of the values around them; none if
    /// the sides cannot or need not be brought together.
    fn comparable(
        &self,
        seam: &Seam,
        positions: [Vec2; 2],
    ) -> Option<(impl Iterator<Item = (Place, f32)> + use<>, Range)> {
        let [a, b] = [0, 1].map(|s| self.footprint(&seam.sides[s], positions[s]));
        let (a, b) = (a?, b?);
        let (around_a, around_b) = (self.range(&a), self.range(&b));
        let both = around_a.union(around_b);
        let jump = (self.lookup(&a) - self.lookup(&b)).abs().max_element();
        let gradient = around_a.width() + around_b.width();
        if jump > GRADIENT_TOLERANCE * gradient + VALUE_TOLERANCE * both.high.max_element() {
            return None;
        }
        Some((a.into_iter().chain(b.map(|(place, weight)| (place, -weight))), both))
    }

    /// Texels of a bilinear lookup. None if another chart's texels are among them, or none of the side's own.
    fn footprint(&self, side: &Side, position: Vec2) -> Option<Footprint> {
        let page = &self.pages[side.page];
        let p = position - 0.5;
        let (corner, f) = (p.floor(), p - p.floor());
        let clamped = |x: f32, n: u32| (x.max(0.0) as u32).min(n - 1);
        let texel = |dx: f32, dy: f32| {
            let (x, y) = (clamped(corner.x + dx, page.width), clamped(corner.y + dy, page.height));
            (side.page, y * page.width + x)
        };
        let footprint = [
            (texel(0.0, 0.0), (1.0 - f.x) * (1.0 - f.y)),
            (texel(1.0, 0.0), f.x * (1.0 - f.y)),
            (texel(0.0, 1.0), (1.0 - f.x) * f.y),
            (texel(1.0, 1.0), f.x * f.y),
        ];
        let charts = || footprint.iter().filter_map(|(place, _)| self.chart(*place));
        (charts().all(|c| c == side.chart) && charts().next().is_some()).then_some(footprint)
    }

    fn lookup(&self, footprint: &Footprint) -> Rgb {
        footprint.iter().map(|(place, weight)| self.value(*place) * *weight).sum()
    }

    /// Baked values of a footprint, of which at least one exists, and of the ring around it.
    fn range(&self, footprint: &Footprint) -> Range {
        let (page, first) = footprint[0].0;
        let last = footprint[3].0.1;
        let image = &self.pages[page];
        let (width, height) = (image.width, image.height);
        let mut range = Range { low: Rgb::INFINITY, high: Rgb::ZERO };
        for y in (first / width).saturating_sub(1)..=(last / width + 1).min(height - 1) {
            for x in (first % width).saturating_sub(1)..=(last % width + 1).min(width - 1) {
                let i = (y * width + x) as usize;
                if image.valid[i] {
                    range = range.union(Range { low: image.rgb[i], high: image.rgb[i] });
                }
            }
        }
        range
    }

    fn value(&self, (page, i): Place) -> Rgb {
        self.pages[page].rgb[i as usize]
    }

    /// Texel at a place, none where no chart covers it.
    fn texel(&self, (page, i): Place) -> Option<usize> {
        self.pages[page].valid[i as usize].then(|| self.texels.pages[page].texel[i as usize] as usize)
    }

    fn chart(&self, place: Place) -> Option<u32> {
        self.texel(place).map(|t| self.texels.chart[t])
    }

    fn weight(&self, place: Place) -> f64 {
        let coverage = self.texel(place).map_or(0.0, |t| f64::from(self.texels.coverage[t]));
        EMPTY_WEIGHT + COVERED_WEIGHT * coverage
    }
}

/// Positions of the lookups along a seam, on both sides.
fn lookups(seam: &Seam) -> impl Iterator<Item = [Vec2; 2]> + use<> {
    let sides = seam.sides.map(|s| s.ends);
    let length = sides.iter().map(|[a, b]| a.distance(*b)).fold(0.0, f32::max);
    let count = (length * SAMPLES_PER_TEXEL).ceil().max(1.0) as u32;
    (0..count).map(move |i| {
        let t = (i as f32 + 0.5) / count as f32;
        sides.map(|[a, b]| a.lerp(b, t))
    })
}
