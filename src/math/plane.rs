//! Planes through noisy values on a page.

use glam::{Mat3, Vec2, Vec3};

/// What is known at one place.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// Place relative to where the plane is wanted.
    pub at: Vec2,
    /// What was found there.
    pub value: f32,
    /// Variance of that.
    pub variance: f32,
    /// By how much it counts for its distance, 0..=1.
    pub nearness: f32,
}

impl Known {
    /// What a plane's coefficients are multiplied with.
    fn row(&self) -> Vec3 {
        self.at.extend(1.0)
    }
}

/// By how much a place counts that is so far from where a plane is wanted, among those up to `reach` away along both
/// axes.
pub fn nearness(at: Vec2, reach: i32) -> f32 {
    1.0 - at.length_squared() / (2.0 * (reach as f32 + 1.0).powi(2))
}

/// The plane that fits values best, weighted by what is known of their noise.
pub struct PlaneFit {
    /// Of every value in the plane's at the place where it is wanted.
    pub weights: Vec<f32>,
    /// Variance of the plane's value there.
    pub variance: f32,
    /// Mean squared miss of the plane in units of the values' variances: about 1 if there is but noise.
    misfit: f32,
}

impl PlaneFit {
    /// Of more than three values.
    pub fn new(known: &[Known]) -> Self {
        let weight = |k: &Known| k.nearness / k.variance;
        let total: f32 = known.iter().map(weight).sum();
        // A little stiffness keeps slopes finite where the places lie on a line.
        let stiff = Mat3::from_diagonal(Vec3::new(1e-3, 1e-3, 0.0) * total);
        let normal = known.iter().fold(stiff, |sum, k| {
            let row = k.row();
            sum + Mat3::from_cols(row * row.x, row * row.y, row * row.z) * weight(k)
        });
        let inverse = normal.inverse();
        let parts: Vec<Vec3> = known.iter().map(|k| inverse * k.row() * weight(k)).collect();
        let plane: Vec3 = parts.iter().zip(known).map(|(&part, k)| part * k.value).sum();
        let misses = known.iter().map(|k| k.nearness * (k.value - plane.dot(k.row())).powi(2) / k.variance);
        let free = known.iter().map(|k| k.nearness).sum::<f32>() * (1.0 - 3.0 / known.len() as f32);
        let weights: Vec<f32> = parts.iter().map(|part| part.z).collect();
        let variance = weights.iter().zip(known).map(|(w, k)| w * w * k.variance).sum();
        Self { misfit: misses.sum::<f32>() / free, weights, variance }
    }

    /// Share of a value's distance from the plane that is more than noise: none where the plane misses all values by no
    /// more than that explains.
    pub fn detail(&self) -> f32 {
        1.0 - 1.0 / self.misfit.max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{hash2, unit_float};

    /// Values of `f` with evenly distributed noise on a grid of three by three.
    fn around(seed: u32, noise: f32, f: impl Fn(Vec2) -> f32) -> Vec<Known> {
        (0..9)
            .map(|i| {
                let at = Vec2::new((i % 3) as f32 - 1.0, (i / 3) as f32 - 1.0);
                let value = f(at) + noise * 12f32.sqrt() * (unit_float(hash2(seed, i)) - 0.5);
                Known { at, value, variance: noise * noise, nearness: nearness(at, 1) }
            })
            .collect()
    }

    fn value(fit: &PlaneFit, known: &[Known]) -> f32 {
        fit.weights.iter().zip(known).map(|(w, k)| w * k.value).sum()
    }

    #[test]
    fn planes_are_reproduced_and_noise_is_divided() {
        let f = |p: Vec2| 2.0 + 0.5 * p.x - 0.25 * p.y;
        let known = around(1, 1e-6, f);
        let fit = PlaneFit::new(&known);
        assert!((value(&fit, &known) - 2.0).abs() < 1e-5);
        let squares: f32 = (0..1000)
            .map(|seed| {
                let known = around(seed, 0.1, f);
                (value(&PlaneFit::new(&known), &known) - 2.0).powi(2)
            })
            .sum();
        let (found, foretold) = ((squares / 1000.0).sqrt(), PlaneFit::new(&around(0, 0.1, f)).variance.sqrt());
        assert!(found < 0.04 && (found / foretold - 1.0).abs() < 0.1, "{found} {foretold}");
    }

    #[test]
    fn steps_are_detail_and_noise_is_none() {
        let step = |p: Vec2| if p.x > 0.5 { 1.0 } else { 0.0 };
        assert!(PlaneFit::new(&around(3, 0.02, step)).detail() > 0.9);
        let mean = (0..100).map(|seed| PlaneFit::new(&around(seed, 0.1, |_| 1.0)).detail()).sum::<f32>() / 100.0;
        assert!(mean < 0.2, "{mean}");
    }
}
