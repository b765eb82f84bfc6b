//! Which texels are audited: strata by object, within an object one texel out of every run of its texels, by hash.
//!
//! A run is a stretch of charts in their order on the page, so that all parts of an object are looked at.

use crate::atlas::{Atlas, Texels};
use crate::math::{hash2, hash3, unit_float};

/// Share of all texels in the first draw, and bounds of their number.
const SHARE: f64 = 0.002;
const FEWEST: usize = 256;
const MOST: usize = 1024;
/// Objects that would get less than this many texels are drawn from together.
const MATTERS: f64 = 0.5;

/// A drawn texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Drawn {
    pub(super) texel: u32,
    /// Texels that it stands for.
    pub(super) weight: f64,
}

/// The texels that draws are made from.
pub(super) struct Population {
    /// Texels of every stratum.
    strata: Vec<Vec<u32>>,
    /// Texels of all strata.
    pub(super) size: usize,
}

impl Population {
    /// All `usable` texels: one stratum per object that matters, one for all the others.
    pub(super) fn new(atlas: &Atlas, texels: &Texels, usable: &[bool]) -> Self {
        let mut objects = vec![Vec::new(); atlas.layouts.len()];
        for (chart, range) in atlas.charts.iter().zip(&texels.charts) {
            objects[chart.instance].extend(range.clone().filter(|&t| usable[t as usize]));
        }
        let size = objects.iter().map(Vec::len).sum();
        let rate = count(size) as f64 / size.max(1) as f64;
        let (mut strata, small): (Vec<_>, Vec<_>) =
            objects.into_iter().filter(|o| !o.is_empty()).partition(|o| o.len() as f64 * rate >= MATTERS);
        if !small.is_empty() {
            strata.push(small.concat());
        }
        Self { strata, size }
    }

    /// Draw number `draw`: about [`SHARE`] of the texels, at most all of them.
    pub(super) fn draw(&self, draw: u32, seed: u32) -> Vec<Drawn> {
        let rate = count(self.size) as f64 / self.size.max(1) as f64;
        let of_stratum = |(s, stratum): (usize, &Vec<u32>)| -> Vec<Drawn> {
            let n = ((stratum.len() as f64 * rate).round() as usize).clamp(1, stratum.len());
            let run = |i: usize| i * stratum.len() / n;
            let pick = |i: usize| {
                let (first, end) = (run(i), run(i + 1));
                let u = unit_float(hash3(hash2(seed, draw), s as u32, i as u32));
                let index = first + (u * (end - first) as f32) as usize;
                Drawn { texel: stratum[index.min(end - 1)], weight: (end - first) as f64 }
            };
            (0..n).map(pick).collect()
        };
        self.strata.iter().enumerate().flat_map(of_stratum).collect()
    }
}

/// Texels of one draw out of `size`.
fn count(size: usize) -> usize {
    ((size as f64 * SHARE) as usize).clamp(FEWEST, MOST).min(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::Chart;

    fn population(objects: &[u32]) -> Population {
        let mut first = 0;
        let (mut atlas, mut texels) = (Atlas::default(), Texels::default());
        for (instance, &n) in objects.iter().enumerate() {
            atlas.charts.push(Chart { instance, page: 0, x: 0..1, y: 0..1 });
            atlas.layouts.push(None);
            texels.charts.push(first..first + n);
            first += n;
        }
        Population::new(&atlas, &texels, &vec![true; first as usize])
    }

    #[test]
    fn every_object_that_matters_is_looked_at_and_weights_add_up() {
        let population = population(&[100_000, 40_000, 300, 5, 5, 5]);
        for draw in 0..4 {
            let drawn = population.draw(draw, 7);
            let of = |low: u32, high: u32| drawn.iter().filter(|d| (low..high).contains(&d.texel)).count();
            assert!(of(0, 100_000) >= 180 && of(100_000, 140_000) >= 70 && of(140_000, 140_300) >= 1);
            assert_eq!(drawn.iter().map(|d| d.weight).sum::<f64>(), 140_315.0);
        }
        assert_ne!(population.draw(0, 7), population.draw(1, 7));
        assert_eq!(population.draw(1, 7), population.draw(1, 7));
    }

    #[test]
    fn small_scenes_are_audited_whole() {
        let population = population(&[100, 20]);
        let mut drawn: Vec<u32> = population.draw(0, 1).iter().map(|d| d.texel).collect();
        drawn.sort_unstable();
        assert_eq!(drawn, (0..120).collect::<Vec<_>>());
    }
}
