//! From lightmap and truth at audited texels to figures with intervals.
//!
//! With independent unbiased estimates a, b of a texel's truth, (L − a)(L − b) has the squared error of L as its mean,
//! whatever their noise; of several estimates all pairs are averaged. Intervals come from the infinitesimal jackknife
//! over texels. Based on: Hoeffding, "A Class of Statistics with Asymptotically Normal Distribution", 1948; Jaeckel,
//! "The Infinitesimal Jackknife", 1972.

use super::mean_channel;
use super::rounds::{AuditedTexel, ESTIMATES};
use crate::scene::{Rgb, Scene};
use serde::Serialize;
use std::collections::BTreeMap;

/// Estimates per texel.
const COUNT: f64 = ESTIMATES as f64;
/// Deviations of a normal figure within which it lies with 95 %.
pub(super) const COMMON: f64 = 1.96;
/// Share of the mean irradiance that is added to a texel's own where its relative error is taken.
const DARK: f64 = 0.01;
/// Noise of the truth, as a share of the errors, up to which errors of single texels say something.
const CLEAN: f64 = 0.5;
/// Audited texels from which on an object has figures of its own.
const ENOUGH: usize = 4;
/// Irradiance below which a scene counts as black, W/m².
const BLACK: f64 = 1e-12;

/// A figure and where the truth about it lies with 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Best guess.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Figures of one object.
#[derive(Clone, Debug, Serialize)]
pub struct ObjectFigure {
    /// Path of its node.
    pub path: String,
    /// Audited texels.
    pub texels: usize,
    /// Mean irradiance, W/m², mean of channels.
    pub mean: f64,
    /// Root of the mean squared error as a share of the object's own mean irradiance.
    pub error: Estimate,
    /// Mean of the lightmap by that of the truth, less one.
    pub bias: Estimate,
    /// Its share of the squared error of the whole lightmap.
    pub share: f64,
}

/// A mean with its variance, and the part of that which is noise of the truth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    pub(super) mean: f64,
    pub(super) variance: f64,
    pub(super) noise: f64,
}

/// Squared error of a texel without the noise of its truth, mean of channels.
pub(super) fn squared_error(t: &AuditedTexel) -> f64 {
    (0..3).map(|c| channel(t, &t.estimates, c).0).sum::<f64>() / 3.0
}

/// Of one channel, by some of the estimates: the mean of (L − a)(L − b) over all their pairs, and the variance of one.
fn channel(t: &AuditedTexel, estimates: &[Rgb], c: usize) -> (f64, f64) {
    let count = estimates.len() as f64;
    let misses = estimates.iter().map(|e| f64::from(t.baked[c] - e[c]));
    let (sum, squares) = misses.fold((0.0, 0.0), |(s, q), m| (s + m, q + m * m));
    let pairs = (sum * sum - squares) / (count * (count - 1.0));
    (pairs, (squares - sum * sum / count).max(0.0) / (count - 1.0))
}

/// The texel's truth, mean of channels.
fn truth(t: &AuditedTexel) -> f64 {
    t.estimates.iter().map(|&e| mean_channel(e)).sum::<f64>() / COUNT
}

/// About the variance of [`squared_error`] by noise.
fn noise(t: &AuditedTexel) -> f64 {
    noise_by(t, &t.estimates)
}

/// The same as some of the `estimates` tell it: channels are noisy together.
pub(super) fn noise_by(t: &AuditedTexel, estimates: &[Rgb]) -> f64 {
    let count = estimates.len() as f64;
    let of_channel = |c: usize| {
        let (squared, variance) = channel(t, estimates, c);
        // The square of an estimated variance is too large by this on average.
        let fourth = variance * variance * (count - 1.0) / (count + 1.0);
        (4.0 * squared.max(0.0) * variance / COUNT + 2.0 * fourth / (COUNT * (COUNT - 1.0))).sqrt()
    };
    ((0..3).map(of_channel).sum::<f64>() / 3.0).powi(2)
}

/// Variance of Σ w·x, given the residuals w·(x − mean) of a sample from `population` texels, and the part of it that is
/// noise and stays when all texels are sampled.
fn variance(residuals: impl Iterator<Item = f64>, noise: f64, population: f64) -> f64 {
    let (mut count, mut sum) = (0.0, 0.0);
    for r in residuals {
        count += 1.0;
        sum += r * r;
    }
    if count < 2.0 {
        return f64::INFINITY;
    }
    let all = sum * count / (count - 1.0);
    noise + (all - noise).max(0.0) * (1.0 - count / population).max(0.0)
}

/// Mean squared error as a share of the squared mean irradiance.
pub(super) fn mean_square(texels: &[&AuditedTexel], population: f64) -> Moment {
    let total: f64 = texels.iter().map(|t| t.weight).sum();
    let mean = |f: fn(&AuditedTexel) -> f64| texels.iter().map(|t| t.weight * f(t)).sum::<f64>() / total;
    let (q, m) = (mean(squared_error), mean(truth).max(BLACK));
    let residual = |t: &&AuditedTexel| {
        t.weight / total * ((squared_error(t) - q) / (m * m) - 2.0 * q * (truth(t) - m) / (m * m * m))
    };
    let noise = texels.iter().map(|t| (t.weight / total).powi(2) * noise(t)).sum::<f64>() / m.powi(4);
    Moment { mean: q / (m * m), variance: variance(texels.iter().map(residual), noise, population), noise }
}

/// Root of a mean square with its interval at so many deviations. Noise is as likely to raise a mean square as to lower
/// it. Which texels were drawn is not: few with large errors make most of it, so that doubt acts as a factor below and
/// reaches farther above.
pub(super) fn root(square: &Moment, deviations: f64) -> Estimate {
    let mean = square.mean.max(0.0);
    let noise = deviations * square.noise.sqrt();
    let drawn = deviations * (square.variance - square.noise).max(0.0).sqrt();
    let relative = if mean > 0.0 { drawn / mean } else { 0.0 };
    let low = mean - noise.hypot(mean * (1.0 - (-relative).exp()));
    let high = mean + noise.hypot(drawn * (1.0 + 0.5 * relative.min(1.0)));
    Estimate { value: mean.sqrt(), low: low.max(0.0).sqrt(), high: high.sqrt() }
}

/// Mean of the lightmap by that of the truth, less one.
pub(super) fn bias(texels: &[&AuditedTexel], population: f64) -> Estimate {
    let total: f64 = texels.iter().map(|t| t.weight).sum();
    let mean = |f: &dyn Fn(&AuditedTexel) -> f64| texels.iter().map(|t| t.weight * f(t)).sum::<f64>() / total;
    let difference = |t: &AuditedTexel| mean_channel(t.baked) - truth(t);
    let m = mean(&truth).max(BLACK);
    let ratio = mean(&difference) / m;
    let residual = |t: &&AuditedTexel| t.weight / total * (difference(t) - ratio * truth(t)) / m;
    let noise = texels.iter().map(|t| (t.weight / total).powi(2) * own_noise(t).powi(2)).sum::<f64>() / (m * m);
    let reach = COMMON * variance(texels.iter().map(residual), noise, population).sqrt();
    Estimate { value: ratio, low: ratio - reach, high: ratio + reach }
}

/// Standard error of a texel's truth.
fn own_noise(t: &AuditedTexel) -> f64 {
    let truth = truth(t);
    let squares: f64 = t.estimates.iter().map(|&e| (mean_channel(e) - truth).powi(2)).sum();
    (squares / (COUNT * (COUNT - 1.0))).sqrt()
}

/// Median and 95th percentile of the relative errors of texels, where the noise of their truth allows.
pub(super) fn percentiles(texels: &[AuditedTexel]) -> [Option<f64>; 2] {
    let total: f64 = texels.iter().map(|t| t.weight).sum();
    let mean = mean(texels);
    let scale = |t: &AuditedTexel| (truth(t).max(0.0) + DARK * mean).max(BLACK);
    let ranked = |f: &dyn Fn(&AuditedTexel) -> f64| {
        let mut all: Vec<(f64, f64)> = texels.iter().map(|t| (f(t) / scale(t), t.weight)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        all
    };
    let errors = ranked(&|t| (mean_channel(t.baked) - truth(t)).abs());
    let noises = ranked(&own_noise);
    [0.5, 0.95].map(|share| {
        let (error, noise) = (percentile(&errors, share * total)?, percentile(&noises, share * total)?);
        (noise <= CLEAN * error).then_some(error)
    })
}

/// The value up to which so much `weight` has come together.
fn percentile(ranked: &[(f64, f64)], weight: f64) -> Option<f64> {
    let mut sum = 0.0;
    let reached = ranked.iter().find(|(_, w)| {
        sum += w;
        sum >= weight
    });
    reached.or(ranked.last()).map(|&(value, _)| value)
}

/// Figures of every object with enough audited texels, largest share of the squared error first. `sizes` are the objects'
/// texels.
pub(super) fn objects(scene: &Scene, texels: &[AuditedTexel], sizes: &[usize]) -> Vec<ObjectFigure> {
    let mut of_object: BTreeMap<usize, Vec<&AuditedTexel>> = BTreeMap::new();
    for t in texels {
        of_object.entry(t.instance).or_default().push(t);
    }
    let sum = |texels: &[&AuditedTexel]| texels.iter().map(|t| t.weight * squared_error(t)).sum::<f64>().max(0.0);
    let all: f64 = of_object.values().map(|texels| sum(texels)).sum::<f64>().max(f64::MIN_POSITIVE);
    let figure = |(&instance, texels): (&usize, &Vec<&AuditedTexel>)| {
        let population = sizes[instance] as f64;
        let weight: f64 = texels.iter().map(|t| t.weight).sum();
        ObjectFigure {
            path: scene.instances[instance].path.clone(),
            texels: texels.len(),
            mean: texels.iter().map(|t| t.weight * truth(t)).sum::<f64>() / weight,
            error: root(&mean_square(texels, population), COMMON),
            bias: bias(texels, population),
            share: sum(texels) / all,
        }
    };
    let mut figures: Vec<ObjectFigure> =
        of_object.iter().filter(|(_, texels)| texels.len() >= ENOUGH).map(figure).collect();
    figures.sort_by(|a, b| b.share.total_cmp(&a.share));
    figures
}

/// The part of a texel's error that noise does not explain, as a share of `mean`, the irradiance of the whole lightmap.
pub(super) fn certain_error(t: &AuditedTexel, mean: f64) -> f64 {
    (squared_error(t) - COMMON * noise(t).sqrt()).max(0.0).sqrt() / mean.max(BLACK)
}

/// Mean irradiance over all audited texels, W/m², mean of channels.
pub(super) fn mean(texels: &[AuditedTexel]) -> f64 {
    let total: f64 = texels.iter().map(|t| t.weight).sum();
    texels.iter().map(|t| t.weight * truth(t)).sum::<f64>() / total.max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{hash2, unit_float};

    /// Texels whose truth is 2 and whose estimates are off by noise of that deviation; `baked` tells the lightmap.
    fn texels(count: u32, deviation: f32, baked: impl Fn(u32) -> f32) -> Vec<AuditedTexel> {
        let wobble = |i: u32, k: u32| 3f32.sqrt() * deviation * (2.0 * unit_float(hash2(i, k)) - 1.0);
        let estimate = |i: u32, k: u32| Rgb::splat(2.0 + wobble(i, k));
        let texel = |i: u32| AuditedTexel {
            texel: i,
            instance: (i % 2) as usize,
            page: 0,
            pixel: [0, 0],
            weight: 3.0,
            baked: Rgb::splat(baked(i)),
            estimates: std::array::from_fn(|k| estimate(i, k as u32)),
        };
        (0..count).map(texel).collect()
    }

    fn check(texels: &[AuditedTexel], error: f64) {
        let all: Vec<_> = texels.iter().collect();
        // Many figures are checked: few of them may lie beyond two deviations.
        let got = root(&mean_square(&all, 1e9), 3.0);
        assert!(got.low <= error && error <= got.high, "{got:?} for {error}");
    }

    #[test]
    fn noise_of_the_truth_does_not_count() {
        for deviation in [0.02, 0.2, 1.0] {
            check(&texels(4000, deviation, |_| 2.0), 0.0);
            check(&texels(4000, deviation, |_| 2.1), 0.05);
            check(&texels(4000, deviation, |i| if i % 3 == 0 { 2.3 } else { 2.0 }), 0.15 / 3f64.sqrt());
        }
    }

    #[test]
    fn rare_large_errors_do_not_hide_the_others() {
        // 1 % everywhere, and 100 % at one texel of a thousand.
        let sample = texels(1000, 1e-4, |i| if i == 500 { 4.0 } else { 2.02 });
        let got = root(&mean_square(&sample.iter().collect::<Vec<_>>(), 1e9), 3.0);
        let truth = (0.999f64 * 1e-4 + 0.001).sqrt();
        assert!(got.low > 0.005 && got.value > truth * 0.99 && got.high > 1.5 * truth, "{got:?}");
    }

    #[test]
    fn a_shift_is_bias_and_noise_is_none() {
        let shifted = texels(4000, 0.1, |_| 2.1);
        let b = bias(&shifted.iter().collect::<Vec<_>>(), 1e9);
        assert!(b.low < 0.05 && 0.05 < b.high && b.high - b.low < 0.01, "{b:?}");
        let noisy = texels(4000, 0.1, |i| if i % 4 < 2 { 2.1 } else { 1.9 });
        let b = bias(&noisy.iter().collect::<Vec<_>>(), 1e9);
        assert!(b.low < 0.0 && 0.0 < b.high, "{b:?}");
    }

    #[test]
    fn percentiles_are_given_only_where_noise_allows() {
        assert_eq!(percentiles(&texels(400, 0.5, |_| 2.02)), [None, None]);
        let [median, p95] = percentiles(&texels(400, 1e-4, |i| if i % 10 == 0 { 2.2 } else { 2.02 }));
        assert!((median.expect("clean") - 0.0099).abs() < 1e-3 && (p95.expect("clean") - 0.099).abs() < 1e-2);
    }

    #[test]
    fn a_whole_population_has_no_error_of_sampling() {
        let sample = texels(400, 0.0, |i| 2.0 + 0.001 * (i % 7) as f32);
        let all: Vec<_> = sample.iter().collect();
        assert!(mean_square(&all, 400.0).variance < 1e-20 && mean_square(&all, 4e5).variance > 1e-20);
    }

    #[test]
    fn objects_are_told_apart() {
        let instance = |path: &str| crate::scene::Instance {
            path: path.into(),
            node: 0,
            mesh: 0,
            transform: glam::Affine3A::IDENTITY,
            casts_shadows: true,
            lightmap: crate::scene::LightmapRequest::Default,
            group: None,
            gpu_instance: None,
        };
        let scene = Scene { instances: vec![instance("Good"), instance("Bad")], ..Scene::default() };
        let sample = texels(400, 0.01, |i| if i % 2 == 1 { 2.2 } else { 2.0 });
        let figures = objects(&scene, &sample, &[10_000, 10_000]);
        assert_eq!(figures[0].path, "Bad");
        assert!((figures[0].error.value - 0.1).abs() < 0.005 && figures[0].share > 0.98, "{:?}", figures[0]);
    }
}
