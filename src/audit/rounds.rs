//! The sample as it grows: every round doubles its texels or its paths, whichever leaves more doubt.

use super::figures::Moment;
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
/// Paths of each estimate at first.
const FIRST_PATHS: u32 = 64;
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
    /// Paths of each estimate at every texel.
    paths: u32,
    meter: Meter<'a>,
}

/// A drawn texel with its sums over paths.
struct Traced {
    drawn: Drawn,
    sums: [DVec3; ESTIMATES],
    /// Paths of each estimate.
    paths: u32,
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
        Self { tracer, atlas, texels, population, seed, sample: Vec::new(), draws: 0, paths: FIRST_PATHS, meter }
    }

    /// The next round, given what the last one left in doubt. It casts about as many rays as all before it.
    pub(super) fn grow(&mut self, doubt: Option<Moment>) -> Result<(), Cancelled> {
        let is_noisy = doubt.is_some_and(|doubt| doubt.noise > 0.5 * doubt.variance);
        if self.draws == 0 || !is_noisy && 2 * self.sample.len() <= self.population.size {
            for draw in self.draws..(2 * self.draws).max(1) {
                let drawn = self.population.draw(draw, self.seed).into_iter();
                self.sample.extend(drawn.map(|drawn| Traced { drawn, sums: [DVec3::ZERO; ESTIMATES], paths: 0 }));
                self.draws += 1;
            }
        } else {
            self.paths *= 2;
        }
        let (tracer, meter, paths) = (&self.tracer, &self.meter, self.paths);
        self.sample.par_iter_mut().filter(|t| t.paths < paths).try_for_each(|t| t.trace(tracer, meter, paths))
    }

    /// Rays cast so far.
    pub(super) fn rays(&self) -> u64 {
        self.meter.rays.load(Ordering::Relaxed)
    }

    /// Paths per texel, all estimates together.
    pub(super) fn paths_per_texel(&self) -> u32 {
        ESTIMATES as u32 * self.paths
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
                estimates: traced.sums.map(|sum| (sum / f64::from(traced.paths)).as_vec3()),
            }
        };
        self.sample.iter().map(audited).collect()
    }
}

impl Traced {
    /// Brings all estimates to `paths` paths.
    fn trace(&mut self, tracer: &Tracer, meter: &Meter, paths: u32) -> Result<(), Cancelled> {
        let footprint = tracer.footprint(self.drawn.texel);
        for first in (self.paths..paths).step_by(STEP) {
            for (estimate, sum) in self.sums.iter_mut().enumerate() {
                let traced = tracer.paths(&footprint, estimate as u32, first..paths.min(first + STEP as u32));
                *sum += traced.sum;
                meter.advance(traced.rays)?;
            }
        }
        self.paths = paths;
        Ok(())
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
