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
const COVERED_WEIGHT: f64 = 0.1;

/// Sides may differ by this much more than their texels differ around the lookup. What jumps more than that is
/// light that really changes at the edge, for example under a wall, and must not bleed across.
const GRADIENT_TOLERANCE: f32 = 2.0;
/// The same, as a share of the values themselves.
const VALUE_TOLERANCE: f32 = 0.1;

/// A texel of a page.
type Place = (usize, u32);

/// A texel whose value changes.
struct Change {
    place: Place,
    value: Rgb,
}

/// Mends all seams of all instances. `pages` are filled around their charts. `filled` marks, beside the valid
/// texels, those empty ones that now have a value of their own.
pub(super) fn mend(
    atlas: &Atlas,
    texels: &Texels,
    scene: &Scene,
    pages: &mut [PageImage],
    filled: &mut [Vec<bool>],
    progress: &dyn Progress,
) -> Result<(), Cancelled> {
    let counter = Counter::new(progress, Stage::Post, atlas.layouts.len());
    let map = Map { texels, pages };
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
    }
    Ok(())
}

/// The pages before mending.
struct Map<'a> {
    texels: &'a Texels,
    pages: &'a [PageImage],
}

/// The four texels of a bilinear lookup and their weights.
type Footprint = [(Place, f32); 4];

impl Map<'_> {
    fn mend_instance(&self, seams: &[Seam]) -> Vec<Change> {
        let mut unknowns: HashMap<Place, u32> = HashMap::new();
        let mut places: Vec<Place> = Vec::new();
        let mut problem = Problem::default();
        for seam in seams {
            for lookup in lookups(seam) {
                let Some(footprints) = self.comparable(seam, lookup) else { continue };
                let mut equation: Equation = [(0, 0.0); TERMS];
                for (term, (place, weight)) in equation.iter_mut().zip(footprints) {
                    let unknown = *unknowns.entry(place).or_insert_with(|| {
                        places.push(place);
                        places.len() as u32 - 1
                    });
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
        let value = |x: DVec3| x.max(DVec3::ZERO).as_vec3();
        places.into_iter().zip(solution).map(|(place, x)| Change { place, value: value(x) }).collect()
    }

    /// Both footprints of a lookup, the second with negative weights; none if the sides cannot be or need not be
    /// brought together.
    fn comparable(&self, seam: &Seam, positions: [Vec2; 2]) -> Option<impl Iterator<Item = (Place, f32)>> {
        let [a, b] = [0, 1].map(|s| self.footprint(&seam.sides[s], positions[s]));
        let (a, b) = (a?, b?);
        let [(low_a, high_a), (low_b, high_b)] = [self.range(&a), self.range(&b)];
        let jump = (self.lookup(&a) - self.lookup(&b)).abs().max_element();
        let gradient = (high_a - low_a).max_element() + (high_b - low_b).max_element();
        let level = high_a.max(high_b).max_element();
        if jump > GRADIENT_TOLERANCE * gradient + VALUE_TOLERANCE * level {
            return None;
        }
        Some(a.into_iter().chain(b.map(|(place, weight)| (place, -weight))))
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

    /// Least and largest baked value around a footprint: of it and of the ring around it.
    fn range(&self, footprint: &Footprint) -> (Rgb, Rgb) {
        let (page, first) = footprint[0].0;
        let last = footprint[3].0.1;
        let image = &self.pages[page];
        let (width, height) = (image.width, image.height);
        let (mut low, mut high) = (Rgb::INFINITY, Rgb::ZERO);
        for y in (first / width).saturating_sub(1)..=(last / width + 1).min(height - 1) {
            for x in (first % width).saturating_sub(1)..=(last % width + 1).min(width - 1) {
                let i = (y * width + x) as usize;
                if image.valid[i] {
                    low = low.min(image.rgb[i]);
                    high = high.max(image.rgb[i]);
                }
            }
        }
        (low.min(high), high)
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
