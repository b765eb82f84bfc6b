//! The sample as it grows: every round doubles its texels or all paths together, whichever leaves more doubt.
//!
//! More paths go where noise leaves doubt. How many those of one half of a texel's estimates become is told by the other
//! half: numbers of paths that hang on what these very paths found would bias the estimates.

use super::figures::{self, Moment};
use super::path::Tracer;
use super::sample::{Drawn, Population};
use crate::accel::Accel;
use crate::atlas::{Atlas, Texels};
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::Rgb;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Estimates of a texel's truth: the more, the less noise in the products of pairs, down to √½ of that of two.
pub const ESTIMATES: usize = 8;
/// Estimates that have the same number of paths.
const HALF: usize = ESTIMATES / 2;
/// Paths of each estimate at first, and what more come in.
const FIRST_PATHS: u32 = 64;
/// Times its paths that a texel may get in one round.
const MOST_TIMES: f64 = 16.0;
/// Halvings of the interval in which the number of paths is looked for that a round can pay.
const HALVINGS: u32 = 64;
/// Paths between two looks at whether the user wants to stop.
const STEP: usize = 512;

/// A texel with its truth.
#[derive(Clone, Copy, Debug)]
pub struct AuditedTexel {
    /// Index into the texels.
    pub texel: u32,
    /// Scene instance that it lies on.
    pub instance: usize,
    /// Page.
    pub page: usize,
    /// Place on the page.
    pub pixel: [u16; 2],
    /// Texels that it stands for.
    pub weight: f64,
    /// What the lightmap has, W/m².
    pub baked: Rgb,
    /// Independent unbiased estimates of the truth, W/m².
    pub estimates: [Rgb; ESTIMATES],
}

/// What is known so far.
pub(super) struct Rounds<'a> {
    tracer: Tracer<'a>,
    atlas: &'a Atlas,
    texels: &'a Texels,
    pub(super) population: Population,
    seed: u32,
    sample: Vec<Traced>,
    /// Draws of texels in the sample.
    draws: u32,
    meter: Meter<'a>,
}

/// A drawn texel with its sums over paths.
struct Traced {
    drawn: Drawn,
    sums: [DVec3; ESTIMATES],
    /// Paths of each estimate of either half.
    paths: [u32; 2],
}

/// Counts rays and tells how far the audit is.
struct Meter<'a> {
    progress: &'a dyn Progress,
    most: u64,
    rays: AtomicU64,
}

impl<'a> Rounds<'a> {
    /// Nothing is known yet. The audit may cast about `most_rays`.
    pub(super) fn new(
        accel: &'a Accel<'a>,
        (atlas, texels): (&'a Atlas, &'a Texels),
        population: Population,
        seed: u32,
        most_rays: u64,
        progress: &'a dyn Progress,
    ) -> Self {
        let tracer = Tracer::new(accel, atlas, texels, seed);
        let meter = Meter { progress, most: most_rays, rays: AtomicU64::new(0) };
        Self { tracer, atlas, texels, population, seed, sample: Vec::new(), draws: 0, meter }
    }

    /// The next round, given the lightmap, `baked` (W/m² per texel), and what the last round left in doubt. It casts no more
    /// rays than about all before it.
    pub(super) fn grow(&mut self, baked: &[Rgb], doubt: Option<Moment>) -> Result<(), Cancelled> {
        let is_noisy = doubt.is_some_and(|doubt| doubt.noise > 0.5 * doubt.variance);
        let wanted = if self.draws == 0 || !is_noisy && 2 * self.sample.len() <= self.population.size {
            for draw in self.draws..(2 * self.draws).max(1) {
                let drawn = self.population.draw(draw, self.seed).into_iter();
                self.sample.extend(drawn.map(|drawn| Traced { drawn, sums: [DVec3::ZERO; ESTIMATES], paths: [0; 2] }));
                self.draws += 1;
            }
            self.sample.iter().map(|t| t.paths.map(|paths| paths.max(FIRST_PATHS))).collect()
        } else {
            shared_out(&self.sample, &self.audited(baked))
        };
        let (tracer, meter) = (&self.tracer, &self.meter);
        let (sample, wanted): (_, Vec<[u32; 2]>) = (self.sample.par_iter_mut(), wanted);
        sample.zip(wanted).try_for_each(|(t, paths)| t.trace(tracer, meter, paths))
    }

    /// Rays cast so far.
    pub(super) fn rays(&self) -> u64 {
        self.meter.rays.load(Ordering::Relaxed)
    }

    /// Paths per texel, all estimates together: the mean.
    pub(super) fn paths_per_texel(&self) -> u32 {
        let all: u64 = self.sample.iter().map(|t| HALF as u64 * u64::from(t.paths[0] + t.paths[1])).sum();
        (all / self.sample.len().max(1) as u64) as u32
    }

    /// The sample beside what the lightmap has, `baked` (W/m² per texel).
    pub(super) fn audited(&self, baked: &[Rgb]) -> Vec<AuditedTexel> {
        let audited = |traced: &Traced| {
            let t = traced.drawn.texel as usize;
            let chart = &self.atlas.charts[self.texels.chart[t] as usize];
            AuditedTexel {
                texel: traced.drawn.texel,
                instance: chart.instance,
                page: chart.page,
                pixel: self.texels.pixel[t],
                weight: traced.drawn.weight / f64::from(self.draws),
                baked: baked[t],
                estimates: traced.estimates(),
            }
        };
        self.sample.iter().map(audited).collect()
    }
}

/// Paths of either half of every texel's estimates for which the figure's noise falls most: about twice as many as now.
fn shared_out(sample: &[Traced], audited: &[AuditedTexel]) -> Vec<[u32; 2]> {
    let now: Vec<[f64; 2]> = sample.iter().map(|t| t.paths.map(f64::from)).collect();
    // What is left of noise goes about as the inverse of paths: the best numbers of them go as its root times the paths
    // that it was found with, each half's by the other's.
    let urge = |(t, now): (&AuditedTexel, &[f64; 2])| {
        let noise = |half: usize| figures::noise_by(t, &t.estimates[half * HALF..(half + 1) * HALF]);
        [1, 0].map(|other| (noise(other) * now[other]).sqrt() * t.weight)
    };
    let urges: Vec<[f64; 2]> = audited.iter().zip(&now).map(urge).collect();
    let at = |level: f64, urge: f64, now: f64| (level * urge).clamp(now, MOST_TIMES * now);
    let pairs = || urges.iter().flatten().zip(now.iter().flatten());
    let budget = 2.0 * now.iter().flatten().sum::<f64>();
    let most = pairs().filter(|(urge, _)| **urge > 0.0).map(|(urge, now)| MOST_TIMES * now / urge).fold(0.0, f64::max);
    let (mut low, mut high) = (0.0, most);
    for _ in 0..HALVINGS {
        let level = 0.5 * (low + high);
        let is_paid = pairs().map(|(&urge, &now)| at(level, urge, now)).sum::<f64>() <= budget;
        (low, high) = if is_paid { (level, high) } else { (low, level) };
    }
    let whole = |paths: f64| (paths / f64::from(FIRST_PATHS)).round() as u32 * FIRST_PATHS;
    let shared: Vec<[u32; 2]> =
        urges.iter().zip(&now).map(|(urge, now)| [0, 1].map(|h| whole(at(low, urge[h], now[h])))).collect();
    // Where no half sees noise in the other, all get more: a round must not be in vain.
    let is_vain = shared.iter().zip(sample).all(|(&shared, t)| shared == t.paths);
    if is_vain { sample.iter().map(|t| t.paths.map(|paths| 2 * paths)).collect() } else { shared }
}

impl Traced {
    /// Brings the estimates of both halves to so many `paths`.
    fn trace(&mut self, tracer: &Tracer, meter: &Meter, paths: [u32; 2]) -> Result<(), Cancelled> {
        if paths == self.paths {
            return Ok(());
        }
        let footprint = tracer.footprint(self.drawn.texel);
        for (estimate, sum) in self.sums.iter_mut().enumerate() {
            let (before, paths) = (self.paths[estimate / HALF], paths[estimate / HALF]);
            for first in (before..paths).step_by(STEP) {
                let traced = tracer.paths(&footprint, estimate as u32, first..paths.min(first + STEP as u32));
                *sum += traced.sum;
                meter.advance(traced.rays)?;
            }
        }
        self.paths = paths;
        Ok(())
    }

    fn estimates(&self) -> [Rgb; ESTIMATES] {
        std::array::from_fn(|i| (self.sums[i] / f64::from(self.paths[i / HALF])).as_vec3())
    }
}

impl Meter<'_> {
    fn advance(&self, rays: u64) -> Result<(), Cancelled> {
        if self.progress.is_cancelled() {
            return Err(Cancelled);
        }
        let rays = self.rays.fetch_add(rays, Ordering::Relaxed) + rays;
        self.progress.report(Stage::Audit, (rays as f64 / self.most as f64).min(1.0));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Texels with the lightmap's value 1 whose estimates in either half are off by so much, up and down in turn.
    fn texels(off: &[[f32; 2]], paths: u32) -> (Vec<Traced>, Vec<AuditedTexel>) {
        let drawn = |texel: usize| Drawn { texel: texel as u32, weight: 1.0 };
        let sign = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let estimates = |off: &[f32; 2]| std::array::from_fn(|i| Rgb::splat(1.0 + sign(i) * off[i / HALF]));
        let traced = |t: usize| Traced { drawn: drawn(t), sums: [DVec3::ZERO; ESTIMATES], paths: [paths; 2] };
        let audited = |(t, off): (usize, &[f32; 2])| AuditedTexel {
            texel: t as u32,
            instance: 0,
            page: 0,
            pixel: [0, 0],
            weight: 1.0,
            baked: Rgb::ONE,
            estimates: estimates(off),
        };
        ((0..off.len()).map(traced).collect(), off.iter().enumerate().map(audited).collect())
    }

    #[test]
    fn paths_go_where_noise_is_and_the_other_half_says_so() {
        let mut off = vec![[0.01, 0.01]; 40];
        (off[3], off[7]) = ([0.3, 0.3], [0.3, 0.0]);
        let (sample, audited) = texels(&off, 640);
        let shared = shared_out(&sample, &audited);
        assert!(shared[3].iter().all(|&paths| paths > 4000), "{shared:?}");
        assert!(shared[7][0] == 640 && shared[7][1] > 4000, "{shared:?}");
        assert!(shared.iter().flatten().all(|paths| (640..=640 * 16).contains(paths)));
        let all: u32 = shared.iter().flatten().sum();
        assert!(all <= 2 * 80 * 640 + 80 * FIRST_PATHS, "{all}");
    }

    #[test]
    fn a_round_is_never_in_vain() {
        let (sample, audited) = texels(&[[0.0, 0.0]; 5], 64);
        assert_eq!(shared_out(&sample, &audited), [[128, 128]; 5]);
    }
}
