//! The audit: how far a finished lightmap is from the scene's true irradiance. A path tracer of its own estimates the
//! truth at a hashed sample of texels; lightmap, texels and scene → error with interval, and whether the target was met.
//!
//! It shares no estimate with the bake: of the lighting stages it knows nothing, and asks only the scene, the atlas and
//! the ray queries. Independent estimates of the truth at each texel make the squared error unbiased, however noisy they
//! are.
//!
//! **When a target counts as met.** After every round there is an interval for the error. The intervals of all rounds
//! are wide enough to hold together with 95 %, so the truth lies in their intersection, and that is what is reported. A
//! target is met once all of it lies at or below the target, missed once all of it lies above. More rounds can only
//! narrow an intersection, and a larger budget only adds rounds to those of a smaller one: neither can turn a target
//! that was met into one that was not.
//! Based on: Darling, Robbins, "Confidence Sequences for Mean, Variance, and Median", 1967.

mod emitters;
mod figures;
mod footprint;
mod lamps;
mod path;
mod rounds;
mod sample;
mod shapes;
mod verdict;

pub use figures::{Estimate, ObjectFigure};
pub use path::Tracer;
pub use rounds::{AuditedTexel, ESTIMATES};
pub use verdict::{Verdict, audit};

use crate::atlas::Texels;
use crate::scene::Rgb;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;

/// What an audit is asked to find out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AuditSettings {
    /// Relative error that the lightmap aims for.
    pub target: f32,
    /// Most rays that the audit casts, but for those of the first round.
    pub most_rays: u64,
    /// Makes the choice of texels and paths; from the scene's hash.
    pub seed: u32,
}

/// How much an audit may cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Effort {
    /// No audit.
    Off,
    /// About a tenth of the bake's time.
    #[default]
    Auto,
    /// About as long as the bake.
    Thorough,
}

/// Audited texels of a tile.
const PER_TILE: usize = 8;
/// Rays of the bake for one of the audit.
const SHARE: u64 = 8;
/// Rays that every audit may cast: two seconds of work.
const LEAST_BUDGET: u64 = 5_000_000;

impl Effort {
    /// Most rays of an audit after a bake that has cast `baked`; none if there is no audit.
    pub fn most_rays(self, baked: u64) -> Option<u64> {
        match self {
            Self::Off => None,
            Self::Auto => Some((baked / SHARE).max(LEAST_BUDGET)),
            Self::Thorough => Some(baked.max(4 * LEAST_BUDGET)),
        }
    }
}

/// What was found out.
#[derive(Clone, Debug, Serialize)]
pub struct Audit {
    /// Relative error that was aimed for.
    pub target: f64,
    /// Whether it was met.
    pub verdict: Verdict,
    /// Root of the mean squared error over texels and channels, as a share of the mean irradiance.
    pub error: Estimate,
    /// Mean of the lightmap by that of the truth, less one.
    pub bias: Estimate,
    /// Median of the texels' relative errors; none where the truth is too noisy for single texels.
    pub median: Option<f64>,
    /// 95th percentile of them.
    pub p95: Option<f64>,
    /// Rounds of sampling.
    pub rounds: u32,
    /// Paths per texel, all estimates together.
    pub paths_per_texel: u32,
    /// Rays cast.
    pub rays: u64,
    /// Texels that can be audited: those that the bake does not fill from their neighbours.
    pub population: usize,
    /// Texels that were audited.
    pub audited: usize,
    /// Objects with enough audited texels, largest share of the squared error first.
    pub objects: Vec<ObjectFigure>,
    /// The audited texels; not part of the report.
    #[serde(skip)]
    pub texels: Vec<AuditedTexel>,
}

impl Audit {
    /// Every audited texel with the part of its error that noise does not explain, as a share of the mean irradiance.
    pub fn errors(&self) -> impl Iterator<Item = (&AuditedTexel, f64)> {
        let mean = figures::mean(&self.texels);
        self.texels.iter().map(move |t| (t, figures::certain_error(t, mean)))
    }

    /// All of `texels` in runs with about [`PER_TILE`] audited ones each, and the squared error that each run brings to the
    /// lightmap's, as a share of the squared mean irradiance; noise may make it negative. The order of texels follows
    /// charts and blocks, so that a run is a piece of surface.
    pub fn tiles(&self, texels: usize) -> Vec<(Range<u32>, f64)> {
        let scale = self.texels.iter().map(|t| t.weight).sum::<f64>() * figures::mean(&self.texels).powi(2);
        let mut audited: Vec<&AuditedTexel> = self.texels.iter().collect();
        audited.sort_by_key(|t| t.texel);
        let runs: Vec<&[&AuditedTexel]> = audited.chunks(PER_TILE).collect();
        let start = |i: usize| if i == 0 { 0 } else { runs.get(i).map_or(texels as u32, |run| run[0].texel) };
        let square = |run: &[&AuditedTexel]| run.iter().map(|t| t.weight * figures::squared_error(t)).sum::<f64>();
        let tile =
            |(i, run): (usize, &&[&AuditedTexel])| (start(i)..start(i + 1), square(run) / scale.max(f64::MIN_POSITIVE));
        runs.iter().enumerate().map(tile).collect()
    }

    /// Squared error that each chart brings to the lightmap's, as a share of the squared mean irradiance, and charts'
    /// audited texels; noise may make it negative. The charts to refine first are those with the largest.
    pub fn charts(&self, texels: &Texels) -> BTreeMap<u32, (f64, usize)> {
        let scale = self.texels.iter().map(|t| t.weight).sum::<f64>() * figures::mean(&self.texels).powi(2);
        let mut charts = BTreeMap::new();
        for t in &self.texels {
            let (error, count) = charts.entry(texels.chart[t.texel as usize]).or_insert((0.0, 0));
            *error += t.weight * figures::squared_error(t) / scale.max(f64::MIN_POSITIVE);
            *count += 1;
        }
        charts
    }
}

/// Mean of the channels.
fn mean_channel(value: Rgb) -> f64 {
    f64::from(value.element_sum()) / 3.0
}
