//! The error of a lightmap with an interval that only ever shrinks, and whether it meets the target.

use super::figures::{self, Estimate, mean_square, root};
use super::rounds::Rounds;
use super::sample::Population;
use super::{Audit, AuditSettings};
use crate::accel::Accel;
use crate::atlas::{Atlas, Texels};
use crate::progress::{Cancelled, Progress, Stage};
use crate::scene::Rgb;
use serde::Serialize;

/// Half width of the interval, as a share of the error or of the target if that is larger, at which the audit is content.
const PRECISE: f64 = 0.15;
/// Chance that the truth lies outside of some round's interval.
const RISK: f64 = 0.05;

/// Whether the target was met.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The whole interval lies at or below the target.
    Met,
    /// The whole interval lies above it.
    Missed,
    /// The interval holds the target.
    Uncertain,
}

/// Audits a lightmap: `baked` has the irradiance of every texel, W/m², `usable` is false for texels that were filled
/// from their neighbours because they lie inside other geometry. None if there is nothing to audit.
pub fn audit(
    accel: &Accel,
    atlas: &Atlas,
    texels: &Texels,
    usable: &[bool],
    baked: &[Rgb],
    settings: &AuditSettings,
    progress: &dyn Progress,
) -> Result<Option<Audit>, Cancelled> {
    progress.report(Stage::Audit, 0.0);
    let population = Population::new(atlas, texels, usable);
    if population.size == 0 {
        return Ok(None);
    }
    let size = population.size;
    // Through text, so that 0.02 does not become 0.019999999552965164.
    let target = settings.target.to_string().parse().unwrap_or_else(|_| f64::from(settings.target));
    let mut rounds = Rounds::new(accel, (atlas, texels), population, settings.seed, settings.most_rays, progress);
    let (mut known, mut doubt) = (None, None);
    for round in 1.. {
        rounds.grow(baked, doubt)?;
        let sample = rounds.audited(baked);
        let square = mean_square(&sample.iter().collect::<Vec<_>>(), size as f64);
        let error = narrowed(known, root(&square, deviations(round)));
        (known, doubt) = (Some(error), Some(square));
        let is_precise = 0.5 * (error.high - error.low) <= PRECISE * error.value.max(target);
        // The next round costs as much as all so far.
        if !is_precise && 2 * rounds.rays() <= settings.most_rays {
            continue;
        }
        progress.report(Stage::Audit, 1.0);
        let [median, p95] = figures::percentiles(&sample);
        return Ok(Some(Audit {
            target,
            verdict: Verdict::of(&error, target),
            error,
            bias: figures::bias(&sample.iter().collect::<Vec<_>>(), size as f64),
            median,
            p95,
            rounds: round,
            paths_per_texel: rounds.paths_per_texel(),
            rays: rounds.rays(),
            population: size,
            audited: sample.len(),
            objects: figures::objects(accel.scene(), &sample, &sizes(atlas, texels, usable)),
            texels: sample,
        }));
    }
    unreachable!("budgets are finite")
}

/// Usable texels of every instance.
fn sizes(atlas: &Atlas, texels: &Texels, usable: &[bool]) -> Vec<usize> {
    let mut sizes = vec![0; atlas.layouts.len()];
    for (chart, range) in atlas.charts.iter().zip(&texels.charts) {
        sizes[chart.instance] += range.clone().filter(|&t| usable[t as usize]).count();
    }
    sizes
}

/// Standard deviations that the interval of a round reaches, so that all rounds' intervals hold together: the risks
/// RISK/(k(k+1)) of rounds k add up to [`RISK`]. Within 0.0005 (Abramowitz, Stegun, 26.2.23).
fn deviations(round: u32) -> f64 {
    let k = f64::from(round);
    let t = (-2.0 * (0.5 * RISK / (k * (k + 1.0))).ln()).sqrt();
    t - (2.515_517 + t * (0.802_853 + t * 0.010_328)) / (1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308)))
}

/// A round's estimate within what was known before: intervals only ever shrink.
fn narrowed(known: Option<Estimate>, new: Estimate) -> Estimate {
    let Some(Estimate { low, high, .. }) = known else { return new };
    Estimate { value: new.value.clamp(low, high), low: new.low.clamp(low, high), high: new.high.clamp(low, high) }
}

impl Verdict {
    fn of(error: &Estimate, target: f64) -> Self {
        if error.high <= target {
            Self::Met
        } else if error.low > target {
            Self::Missed
        } else {
            Self::Uncertain
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn risks_add_up() {
        for (round, tail) in [(1, 0.025), (2, 0.05 / 6.0), (5, 0.05 / 30.0)] {
            // Two-sided tail of the normal distribution by its continued fraction.
            let z = deviations(round);
            let fraction = (1..60).rev().fold(z, |f, k| z + f64::from(k) / f);
            let got = 2.0 * (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt() / fraction;
            assert!((got / tail - 1.0).abs() < 0.01, "round {round}: {got} instead of {tail}");
        }
        let risk: f64 = (1..100_000).map(|k| RISK / (f64::from(k) * (f64::from(k) + 1.0))).sum();
        assert!(risk <= RISK);
    }

    #[test]
    fn more_rounds_never_undo_a_verdict() {
        let estimate = |value: f64, reach: f64| Estimate { value, low: value - reach, high: value + reach };
        let rounds = [estimate(0.021, 0.01), estimate(0.012, 0.007), estimate(0.03, 0.004), estimate(0.018, 0.001)];
        let mut known = None;
        let mut verdicts = Vec::new();
        for round in rounds {
            let error = narrowed(known, round);
            assert!(known.is_none_or(|k: Estimate| k.low <= error.low && error.high <= k.high));
            assert!(error.low <= error.value && error.value <= error.high);
            known = Some(error);
            verdicts.push(Verdict::of(&error, 0.02));
        }
        assert_eq!(verdicts, [Verdict::Uncertain, Verdict::Met, Verdict::Met, Verdict::Met]);
    }
}
