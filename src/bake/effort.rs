//! How finely the final gather works: error of the lightmap → errors of cells and probes.
//!
//! How much of a lightmap's error is the noise of probes depends on the scene: where the sun lights most of it, theirs is
//! a small part, and where many probes are done after their fewest rays, so is that of the others. A few probes tell.

use crate::gather::{CellSettings, FewestRays, Footprint, Probe, ProbeSettings, Source};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Share of the scene's mean irradiance below which errors of a texel count as if it were that bright.
const FLOOR: f32 = 0.25;
/// Times the scene's mean irradiance above which they count as if it were that bright.
const CEILING: f32 = 1.0;
/// Most rays that one probe casts on top of one per stratum, for an error of 2 %.
const MOST_RAYS: f32 = 1800.0;
/// Error of cells, in errors of the lightmap.
const CELL_ERROR: f32 = 0.5;
/// Standard errors of a probe, in errors of the lightmap: the smallest that is asked for, and the largest, from which on
/// noise would show.
const PROBE_ERROR: f32 = 0.8;
const LOOSEST: f32 = 1.6;
/// Share of the error asked for that is aimed at: what is foretold may be wrong.
const AIM: f32 = 0.9;
/// Texels whose probes are tried.
const TRIED: usize = 1024;
/// Steps from the largest error down to the smallest.
const STEPS: u32 = 16;
/// Share of what a probe is allowed from which on its error is that and not that of its fewest rays.
const REACHED: f32 = 0.7;

/// Elements up to which each casts all its rays, and least share of them.
const FEW_ELEMENTS: f32 = 65_536.0;
const LEAST_SHARE: f32 = 0.5;

/// Rays of each of so many elements, of which there would be `most` if they were few, for what need not be known well of
/// each: a point sees the more of them, the more they are.
pub(super) fn element_rays(most: u32, elements: usize) -> u32 {
    let share = (FEW_ELEMENTS / elements.max(1) as f32).sqrt().clamp(LEAST_SHARE, 1.0);
    (most as f32 * share).round() as u32
}

/// How much is asked of probes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Effort {
    /// Standard error, in errors of the lightmap.
    pub error: f32,
    /// Rays that each casts at least.
    pub fewest: FewestRays,
}

/// What is asked of probes that must be right alone.
pub(super) const CAREFUL: Effort = Effort { error: PROBE_ERROR, fewest: FewestRays::Many };

/// How finely the final gather works for a relative error of the lightmap, whose mean is about `mean`, W/m², with probes
/// of which `effort` is asked.
pub(super) fn cell_settings(error: f32, effort: Effort, mean: f32) -> CellSettings {
    // Enough to halve the error by four times the rays, but no endless run.
    let extra = (MOST_RAYS * (0.02 / error).powi(2)).min(1e6) as u32;
    let (floor, ceiling) = (FLOOR * mean, CEILING * mean);
    let probe = ProbeSettings { fewest: effort.fewest, extra, tolerance: effort.error * error, floor, ceiling };
    CellSettings { tolerance: CELL_ERROR * error, probe }
}

/// The least effort with which the error comes out as `error` asks, where that of direct light is `direct`, W/m²: few rays
/// if they do, or else the largest error of probes that start with many. With the rays that it took to find out.
pub(super) fn effort(source: &Source, footprint: &Footprint, error: f32, direct: f32, mean: f32) -> (Effort, u64) {
    let (few, cast) = try_probes(source, footprint, error, FewestRays::Few, mean);
    let most = f64::from(AIM * error * mean);
    if foretold(&few, LOOSEST, direct) <= most {
        return (Effort { error: LOOSEST, fewest: FewestRays::Few }, cast);
    }
    let (many, more) = try_probes(source, footprint, error, FewestRays::Many, mean);
    let mut steps = (0..=STEPS).map(|i| LOOSEST - (LOOSEST - PROBE_ERROR) * i as f32 / STEPS as f32);
    let error = steps.find(|&k| foretold(&many, k, direct) <= most).unwrap_or(PROBE_ERROR);
    (Effort { error, fewest: FewestRays::Many }, cast + more)
}

/// What came of a probe that was tried, W/m².
struct Tried {
    /// Its standard error, and the one that it was allowed.
    found: f32,
    allowed: f32,
}

/// Some probes with the largest error, and the rays that they cast.
fn try_probes(source: &Source, footprint: &Footprint, error: f32, fewest: FewestRays, mean: f32) -> (Vec<Tried>, u64) {
    let texels = source.lit.surfels.texels.len();
    let settings = cell_settings(error, Effort { error: LOOSEST, fewest }, mean).probe;
    let step = texels.div_ceil(TRIED).max(1);
    (0..texels.div_ceil(step))
        .into_par_iter()
        .map(|i| (i * step) as u32)
        .filter(|&t| !footprint.is_hidden(t))
        .map(|t| {
            let probe = Probe::gather(source, footprint, t, 0, &settings);
            let all = probe.irradiance.element_sum() / 3.0 + source.direct(t);
            let allowed = settings.tolerance * settings.yardstick(all);
            (Tried { found: probe.error, allowed }, u64::from(probe.rays))
        })
        .collect::<Vec<_>>()
        .into_iter()
        .fold((Vec::new(), 0), |(mut tried, rays), (probe, cast)| {
            tried.push(probe);
            (tried, rays + cast)
        })
}

/// Root of the mean squared error of the lightmap, W/m², if probes had that error, where that of direct light is `direct`.
fn foretold(tried: &[Tried], probe_error: f32, direct: f32) -> f64 {
    let square = |probe: &Tried| {
        let scale = if probe.found > REACHED * probe.allowed { probe_error / LOOSEST } else { 1.0 };
        f64::from(probe.found * scale).powi(2)
    };
    let squares = tried.iter().map(square).sum::<f64>() / tried.len().max(1) as f64;
    (squares + f64::from(direct).powi(2)).sqrt()
}
