//! How finely the final gather works: error of the lightmap → errors of cells and probes.
//!
//! How much of a lightmap's error is the noise of probes depends on the scene: where the sun lights most of it, theirs is
//! a small part, and where many probes are done after their fewest rays, so is that of the others. A few probes tell.

use crate::gather::{CellSettings, Footprint, Probe, ProbeSettings, Source};
use rayon::prelude::*;

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
pub(super) const PROBE_ERROR: f32 = 0.8;
const LOOSEST: f32 = 1.6;
/// Share of the error asked for that is aimed at: what is foretold may be wrong.
const AIM: f32 = 0.9;
/// Texels whose probes are tried.
const TRIED: usize = 1024;
/// Steps from the largest error down to the smallest.
const STEPS: u32 = 16;
/// Share of what a probe is allowed from which on its error is that and not that of its fewest rays.
const REACHED: f32 = 0.7;

/// How finely the final gather works for a relative error of the lightmap, whose mean is about `mean`, W/m², with probes
/// that have a standard error of `probe_error` of it.
pub(super) fn cell_settings(error: f32, probe_error: f32, mean: f32) -> CellSettings {
    // Enough to halve the error by four times the rays, but no endless run.
    let extra = (MOST_RAYS * (0.02 / error).powi(2)).min(1e6) as u32;
    let probe = ProbeSettings { extra, tolerance: probe_error * error, floor: FLOOR * mean, ceiling: CEILING * mean };
    CellSettings { tolerance: CELL_ERROR * error, probe }
}

/// The largest standard error of probes, in errors of the lightmap, with which that comes out as `error` asks, where
/// that of direct light is `direct`, W/m². With the rays that it took to find out.
pub(super) fn probe_error(source: &Source, footprint: &Footprint, error: f32, direct: f32, mean: f32) -> (f32, u64) {
    let texels = source.lit.surfels.texels.len();
    let settings = cell_settings(error, LOOSEST, mean).probe;
    let step = texels.div_ceil(TRIED).max(1);
    let tried: Vec<(f32, f32, u32)> = (0..texels.div_ceil(step))
        .into_par_iter()
        .map(|i| (i * step) as u32)
        .filter(|&t| !footprint.is_hidden(t))
        .map(|t| {
            let probe = Probe::gather(source, footprint, t, 0, &settings);
            let all = probe.irradiance.element_sum() / 3.0 + source.direct(t);
            (probe.error, settings.tolerance * settings.yardstick(all), probe.rays)
        })
        .collect();
    let foretold = |probe_error: f32| {
        let square = |&(found, allowed, _): &(f32, f32, u32)| {
            let scale = if found > REACHED * allowed { probe_error / LOOSEST } else { 1.0 };
            f64::from(found * scale).powi(2)
        };
        let squares = tried.iter().map(square).sum::<f64>() / tried.len().max(1) as f64;
        (squares + f64::from(direct).powi(2)).sqrt()
    };
    let most = f64::from(AIM * error * mean);
    let steps = (0..=STEPS).map(|i| LOOSEST - (LOOSEST - PROBE_ERROR) * i as f32 / STEPS as f32);
    let rays = tried.iter().map(|(_, _, rays)| u64::from(*rays)).sum();
    (steps.into_iter().find(|&k| foretold(k) <= most).unwrap_or(PROBE_ERROR), rays)
}
